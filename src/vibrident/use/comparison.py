"""Comparison of results of one sensor with each other, or with the truth of a simulation."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from vibrident.base.errors import InputError
from vibrident.base.fields import Fields, GivenFields, NamedNumbers, NamedTexts
from vibrident.physics.naming import is_gain
from vibrident.result import Parameter, Result
from vibrident.result.document import plain
from vibrident.use.model_choice import criteria, recommendation

SCHEMA = "vibrident.comparison/1"
TRUTH_SCHEMA = "vibrident.truth/1"
COVERAGE_FACTOR = 2.0  # k of every expanded uncertainty that is compared


@dataclass(frozen=True)
class Deviation:
    """Deviation of a parameter from a value to compare with.

    Attributes:
        true: that value, in the parameter's unit.
        percent: 100 (value / true − 1); None for a true zero.
        in_u: (value − true) / standard uncertainty; None where there is no uncertainty.
    """

    true: float
    percent: float | None
    in_u: float | None


def deviation(parameter: Parameter, true: float) -> Deviation | None:
    """Return the deviation of a parameter from a value in its unit, or None if it has no value."""
    if parameter.value is None:
        return None
    u = parameter.standard_uncertainty
    percent = 100.0 * (parameter.value / true - 1.0) if true else None
    return Deviation(true, percent, (parameter.value - true) / u if u else None)


def deviations(result: Result, truth: NamedNumbers) -> dict[str, Deviation]:
    """Return the deviation of every parameter whose true value is known."""
    differences = {
        name: deviation(p, truth[name]) for name, p in result.parameters.items() if name in truth
    }
    return {name: value for name, value in differences.items() if value is not None}


def normalized_error(
    value: float,
    expanded: float,
    compared: float,
    expanded_compared: float,
    covariance: float = 0.0,
) -> float | None:
    """Return E_n = (one − other)/U(one − other) (ISO 13528, ISO/IEC 17043).

    Two values agree where |E_n| ≤ 1. U² = U_one² + U_other² − 2 k² cov (GUM 5.2.2): what both
    share, such as a reference, is no part of their difference.

    Args:
        value: the first value.
        expanded: its expanded uncertainty U, k = 2.
        compared: the second value, in the same unit.
        expanded_compared: its expanded uncertainty.
        covariance: of the two values; zero for independent ones.

    Returns:
        E_n; None where the difference has no uncertainty.
    """
    square = expanded**2 + expanded_compared**2 - 2.0 * COVERAGE_FACTOR**2 * covariance
    return (value - compared) / math.sqrt(square) if square > 0 else None


#: Kinds of contributions that stay the same from one calibration to the next while their source
#: does. All others are new each time: a sensor is mounted anew, and an ellipse is fitted to the
#: signals of the day.
REPEATED_KINDS = ("gain", "timing", "phase", "clock")
#: Row of the budget for the calibration of the reference.
REFERENCE_SOURCE = "calibration of the reference"


def shared_sources(
    result: Result, *, parameter: str | None = None, sensitivity: tuple[float, float] | None = None
) -> NamedNumbers:
    """Return the systematic contributions that another calibration may share, by a key.

    Two calibrations share a contribution where the key is the same: kind, source in words, its
    standard uncertainty to two digits (a source that was calibrated anew has another), the
    laboratory, and the instruments that the certificate states (with serial number and
    certificate): for the calibration of the reference all of them, for another source those whose
    name or serial number its words contain.

    Args:
        result: the result.
        parameter: contributions to this parameter, in its unit.
        sensitivity: contributions to the sensitivity at a frequency instead: frequency in Hz, and
            value in its unit. A gain acts on it as it is at that frequency, other sources as on the
            parameter for the gain.

    Returns:
        Key to standard uncertainty, above zero.
    """
    contributions: NamedNumbers = {}
    for row in result.settings.get("uncertainty_budget") or ():
        kind = str(row.get("kind", ""))
        if kind in REPEATED_KINDS:
            u = (
                _sensitivity_share(result, row, *sensitivity)
                if sensitivity is not None
                else _share(row, parameter)
            )
            if math.isfinite(u) and u > 0:
                key = _identity(result, row)
                contributions[key] = math.hypot(contributions.get(key, 0.0), u)
    return contributions


def shared_covariance(sources: NamedNumbers, compared: NamedNumbers) -> float:
    """Return the covariance of two values from the sources that they share.

    Each source is fully correlated (GUM F.1.2.3).
    """
    return sum(u * compared[key] for key, u in sources.items() if key in compared)


def stated_sources(shared: NamedNumbers) -> NamedNumbers:
    """Return the sources that an instrument with serial number or certificate identifies.

    That any other source stays the same from one calibration to the next is an assumption.
    """
    return {key: u for key, u in shared.items() if _names_an_instrument(key)}


def assumed_sources(sources: NamedNumbers, compared: NamedNumbers) -> tuple[str, ...]:
    """Return the words of the sources that two values share by assumption, each once."""
    common = (key for key in sources if key in compared and not _names_an_instrument(key))
    return tuple(dict.fromkeys(key.split("|")[1] for key in common))


def _names_an_instrument(key: str) -> bool:
    """Return whether a key from :func:`_identity` holds a serial number or a certificate."""
    return any("".join(listed.split("/")[-2:]) for listed in key.split("|")[4:])


def _share(row: GivenFields, parameter: str | None) -> float:
    return abs(float((row.get("contributions") or {}).get(parameter) or 0.0))


def _sensitivity_share(
    result: Result, row: GivenFields, frequency_hz: float, sensitivity: float
) -> float:
    if row.get("kind") == "gain":
        return abs(_relative_gain(result, row, frequency_hz) * sensitivity)
    for name, parameter in result.parameters.items():
        if is_gain(name) and parameter.value:
            return _share(row, name) / abs(result.parameters[name].value) * abs(sensitivity)
    return 0.0


def _relative_gain(result: Result, row: GivenFields, frequency_hz: float) -> float:
    """Return the relative u of a gain at a frequency.

    The row of the budget holds the largest of a gain that is stated by frequency.
    """
    largest = float(row.get("standard_uncertainty") or 0.0)
    points = result.settings.get("point_budget") or {}
    measured = result.measured
    for source in points.get("sources") or ():
        if source.get("source") == row.get("source"):
            f = np.asarray(points["frequency_hz"], dtype=float)
            order = np.argsort(f)
            by_frequency = np.argsort(measured.frequency_hz)
            size = np.interp(
                f, measured.frequency_hz[by_frequency], np.abs(measured.magnitude[by_frequency])
            )
            relative = np.asarray(source["magnitude"], dtype=float) / size
            return min(largest, float(np.interp(frequency_hz, f[order], relative[order])))
    return largest


def _identity(result: Result, row: GivenFields) -> str:
    words = " ".join(str(row.get("source", "")).casefold().replace("|", " ").split())
    size = f"{float(row.get('standard_uncertainty') or 0.0):.2g}"
    instruments = [
        {key: str(value).casefold() for key, value in entry.items()}
        for entry in result.certificate.get("instruments") or ()
        if isinstance(entry, Mapping)
    ]
    if words != REFERENCE_SOURCE:
        named = ("name", "serial_number")
        instruments = [
            entry
            for entry in instruments
            if any(entry.get(key) and entry[key] in words for key in named)
        ]
    fields = ("name", "manufacturer", "type", "serial_number", "certificate")
    listed = sorted("/".join(entry.get(key, "") for key in fields) for entry in instruments)
    laboratory = " ".join(str(result.certificate.get("laboratory") or "").casefold().split())
    return "|".join([str(row["kind"]), words, size, laboratory, *listed])


def not_comparable(result_a: Result, result_b: Result) -> str:
    """Return the reason why E_n of two results is not valid; empty if it is valid.

    E_n compares independent measurements of one thing: not two evaluations of the same data, not
    two sensors.
    """
    first, second = (
        {entry.get("sha256") for entry in result.provenance.get("files") or ()}
        for result in (result_a, result_b)
    )
    if (first & second) - {None, ""}:
        return "same data"
    serials = [str(result.sensor.get("serial_number") or "") for result in (result_a, result_b)]
    if all(serials) and serials[0] != serials[1]:
        return "another sensor"
    return ""


def document(
    results: Mapping[str, Result],
    truth: NamedNumbers | None = None,
    cross_validations: Mapping[str, GivenFields] | None = None,
) -> Fields:
    """Return the plain values of ``comparison.json``.

    Args:
        results: name of the method to its result; at least one.
        truth: true values by parameter name; deviations are from these, else from the first result.
        cross_validations: name of the method to its cross-validation, as plain values.
    """
    first = next(iter(results))
    zero = truth or {
        name: p.value for name, p in results[first].parameters.items() if p.value is not None
    }
    units = {name: p.unit for name, p in results[first].parameters.items()}
    return {
        "schema": SCHEMA,
        "deviations_from": "truth" if truth else first,
        "truth": dict(truth) if truth else None,
        "methods": [
            _method(name, result, zero, units, bool(truth))
            | {"cross_validation": (cross_validations or {}).get(name)}
            for name, result in results.items()
        ],
        "recommendation": asdict(recommendation(results)),
    }


def _method(
    name: str, result: Result, zero: NamedNumbers, units: NamedTexts, is_truth: bool
) -> Fields:
    parameters = {}
    for key, parameter in result.parameters.items():
        same_quantity = units.get(key, parameter.unit) == parameter.unit
        off = deviation(parameter, zero[key]) if key in zero and same_quantity else None
        parameters[key] = {
            "value": parameter.value,
            "unit": parameter.unit,
            "standard_uncertainty": parameter.standard_uncertainty,
            "deviation_percent": None if off is None else off.percent,
        }
        # two results of the same data are not independent: their u say nothing of their difference
        if is_truth:
            parameters[key]["deviation_in_u"] = None if off is None else off.in_u
    return {
        "name": name,
        "model": result.model,
        "estimator": result.estimator,
        "discretisation": result.settings.get("discretisation"),
        "parameters": parameters,
        "fit": plain(result.fit),
        "criteria": asdict(criteria(result)),
        "warnings": list(result.warning_codes),
        "time_s": result.settings.get("time_s"),
    }


def read_truth(path: str | os.PathLike[str]) -> NamedNumbers:
    """Read true values by parameter name from the ``truth.json`` of ``vibrident simulate``.

    Raises:
        InputError: the file cannot be read or is not of that kind.
    """
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
        if content["schema"] != TRUTH_SCHEMA:
            raise ValueError(f"schema {content['schema']!r}")
        return {str(name): float(entry["value"]) for name, entry in content["parameters"].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(
            "The file of true values cannot be read.",
            expected=f"a truth.json that ⟦command = simulate⟧ wrote (schema {TRUTH_SCHEMA})",
            found=f"{type(error).__name__}: {error}",
            where=str(path),
            remedy="give the truth.json that lies beside the simulated calibration",
        ) from error
