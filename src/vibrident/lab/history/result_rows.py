"""Rows that the store keeps of a result."""

from __future__ import annotations

import datetime
import hashlib
import json
import math
import zlib
from dataclasses import dataclass

from vibrident.base.errors import InputError
from vibrident.base.fields import Fields
from vibrident.lab.history import schema
from vibrident.result import Parameter, Result
from vibrident.result.document import plain
from vibrident.show.history import date_of
from vibrident.show.numbers import unit_of_sensitivity
from vibrident.show.points import nominal_points, reference_point
from vibrident.use.comparison import shared_sources

#: Digits kept of the SHA-256 of a data file: enough to recognise results of the same data.
_FILE_DIGITS = 20
SENSOR_KEYS = ("manufacturer", "type", "serial_number", "axis")
_OF_PARAMETERS = ("value", "unit", "standard_uncertainty", "identifiable", "derived")
_OF_POINTS = (
    *("frequency_hz", "magnitude", "magnitude_uncertainty"),
    *("phase_deg", "phase_deg_uncertainty"),
)


@dataclass(frozen=True)
class ResultRows:
    """Result as rows by table, without the keys that the database gives."""

    sensor: Fields
    calibration: Fields
    parameters: list[Fields]
    points: list[Fields]


def rows_of(
    result: Result, serial_number: str | None = None, date: datetime.date | None = None
) -> ResultRows:
    """Return the rows of a result.

    Args:
        result: the result.
        serial_number: of the sensor, if the result states none.
        date: of the calibration, if the result states none.

    Raises:
        InputError: the serial number or the date is in neither the result nor the arguments.
    """
    sensor = {key: str(result.sensor.get(key) or "").strip() for key in SENSOR_KEYS}
    sensor["serial_number"] = _serial_number(sensor["serial_number"], serial_number)
    stated_date = result.certificate.get("date_of_calibration")
    when = date_of(result)
    if stated_date is not None and when is not None and date not in (None, when):
        raise InputError(
            "The date is not that of the result.",
            expected=f"{when}, as its certificate states",
            found=str(date),
            where="⟦history.date⟧",
            remedy=(
                "leave it out; correct a stored date by an event of kind redated, or "
                "date_of_calibration in the calibration file, and identify again"
            ),
        )
    when = when if date is None else date
    if when is None:
        key = '[certificate] date_of_calibration = "2025-03-31"'
        raise _missing(
            "date of its calibration",
            key,
            "⟦history.date⟧",
            "none" if stated_date is None else repr(stated_date),
        )
    calibration = {
        "sha256": identity(result),
        "date": when,
        "date_stated": stated_date is not None or date is not None,
        "model": result.model,
        "estimator": result.estimator,
        "adequate": result.fit.adequate,
        "chi2_reduced": plain(result.fit.chi2_reduced),
        "warnings": json.dumps(result.warning_codes),
        "laboratory": str(result.certificate.get("laboratory") or ""),
        "certificate_number": str(result.certificate.get("number") or ""),
        "data_files": json.dumps(_data_files(result)),
        "document": zlib.compress(result.to_json().encode()),
    }
    return ResultRows(sensor, calibration, _parameters(result), _points(result))


def identity(result: Result) -> str:
    """Return the SHA-256 of a result's values, without its layout and its excerpts."""
    document = {name: value for name, value in result.to_dict().items() if name != "signals"}
    text = json.dumps(document, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _serial_number(of_result: str, argument: str | None) -> str:
    argument = (argument or "").strip()
    if argument and of_result and argument != of_result:
        raise InputError(
            "The serial number is not that of the result.",
            expected=f"{of_result}, as the result states",
            found=argument,
            where="⟦history.serial_number⟧",
            remedy="leave the option away, or give the result of that sensor",
        )
    if not (of_result or argument):
        raise _missing(
            "serial number", '[sensor] serial_number = "4711"', "⟦history.serial_number⟧"
        )
    return of_result or argument


def _missing(what: str, key: str, option: str, value: str = "none") -> InputError:
    return InputError(
        f"The result does not state the {what}, so it cannot be added to a history.",
        expected=key.split(" ", 1)[1].partition(" =")[0],
        found=value,
        where="result.json, sensor and certificate",
        remedy=f"state {key} in the calibration file, or give {option}",
    )


def _data_files(result: Result) -> list[str]:
    hashes = (str(entry.get("sha256") or "") for entry in result.provenance.get("files") or ())
    return sorted({text[:_FILE_DIGITS] for text in hashes if text})


def _parameters(result: Result) -> list[Fields]:
    """Return the rows of the parameters, and of the sensitivity at the reference frequency."""
    parameters = dict(result.parameters)
    shared = {name: shared_sources(result, parameter=name) for name in parameters}
    frequencies_hz = {}
    at = None if result.is_tracked else reference_point(result)[0]
    if at is not None and math.isfinite(at.magnitude):
        name = schema.REFERENCE_SENSITIVITY
        numbers = at.magnitude, unit_of_sensitivity(result), at.magnitude_uncertainty
        parameters = {name: Parameter(*numbers, (None, None), derived=True)} | parameters
        shared[name] = shared_sources(result, sensitivity=(at.frequency_hz, at.magnitude))
        frequencies_hz[name] = at.frequency_hz
    return [
        {
            "name": name,
            **{key: plain(getattr(parameter, key)) for key in _OF_PARAMETERS},
            "frequency_hz": frequencies_hz.get(name),
            "shared": json.dumps(shared[name]),
        }
        for name, parameter in parameters.items()
    ]


def _points(result: Result) -> list[Fields]:
    """Return the nominal points of a calibration; a tracked result is none."""
    points = () if result.is_tracked else nominal_points(result)
    return [
        {
            "nominal_hz": float(point.nominal),
            **{key: plain(getattr(point, key)) for key in _OF_POINTS},
        }
        for point in points
        if math.isfinite(point.magnitude)
    ]
