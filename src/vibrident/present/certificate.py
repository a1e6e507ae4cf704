"""What a calibration certificate says, as text: from the result and the calibration file's [certificate] alone.

The fields are those of practice under ISO 16063 and DKD-R 3-1. What is not stated is a blank to fill, never a value.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from vibrident.naming import pretty
from vibrident.nominal import same
from vibrident.present import tables, words
from vibrident.present.coverage import coverage, interval_text, parameter_factor
from vibrident.present.numbers import (
    COVERAGE_FACTOR,
    NONE,
    plain,
    reference_unit,
    sensitivity_scale,
    sensor_name,
    with_u,
)
from vibrident.present.points import Point, measured_band, nominal_points, reference_point
from vibrident.present.views import Column, Table, columns, count
from vibrident.result import Result

#: Keys that have a place of their own; others are listed as further statements.
_PLACED = {
    *("number", "laboratory", "laboratory_address", "accreditation", "customer", "customer_address", "order_number"),
    *("date_of_receipt", "date_of_calibration", "date_of_issue", "place", "condition", "mounting", "direction"),
    *("amplitude", "conditioning", "procedure", "traceability", "instruments", "operator", "approved_by", "remarks"),
    *("temperature_c", "temperature_uncertainty_c", "relative_humidity_percent", "air_pressure_hpa"),
    *("relative_humidity_uncertainty_percent", "air_pressure_uncertainty_hpa", "reference_frequency_hz"),
}
_SENSOR = {"manufacturer": "Manufacturer", "type": "Type", "serial_number": "Serial number"}
_CURVE_NOTE = (
    "The values are those of the identified model at f. The nominal frequencies are those of ISO 266 inside the "
    "measured band; f is the exact base-10 frequency, or the nominal value where the data were taken at those."
)


@dataclass(frozen=True)
class Field:
    """A labelled statement; None is a blank to fill."""

    label: str
    text: str | None


@dataclass(frozen=True)
class Certificate:
    """A certificate, ready to be set in type.

    Attributes:
        title: what kind of document it is.
        number: of the certificate; None is a blank.
        laboratory: lines of the letterhead; empty for a blank.
        sensor: one line for the running head.
        groups: titled lists of fields.
        instruments: table of instruments used; no rows is a blank to fill.
        traceability: statement; None is a blank.
        reference: sensitivity at the reference frequency, and how that was chosen.
        sensitivity: table at nominal frequencies; None if the band holds no nominal frequency.
        parameters: table of the model's parameters.
        statements: paragraphs on uncertainty, phase and adequacy.
        doubts: title and sentences of each warning.
        remarks: as stated.
        signatures: who signs, and where.
        files: data files with their SHA-256.
        made_by: program and time of the evaluation.
    """

    title: str
    number: str | None
    laboratory: tuple[str, ...]
    sensor: str
    groups: tuple[tuple[str, tuple[Field, ...]], ...]
    instruments: Table
    traceability: str | None
    reference: tuple[Field, ...]
    sensitivity: Table | None
    parameters: Table
    statements: tuple[str, ...]
    doubts: tuple[tuple[str, tuple[str, ...]], ...]
    remarks: tuple[str, ...]
    signatures: tuple[Field, ...]
    files: Table
    made_by: str


def certificate(result: Result) -> Certificate:
    """Say everything that a certificate states of a result."""
    stated = result.certificate
    letterhead = (stated.get(key) for key in ("laboratory", "laboratory_address", "accreditation"))
    return Certificate(
        title="Calibration certificate",
        number=_text(stated, "number"),
        laboratory=tuple(str(line) for line in letterhead if line),
        sensor=sensor_name(result.sensor),
        groups=_groups(result),
        instruments=_instruments(stated),
        traceability=_text(stated, "traceability"),
        reference=_reference(result),
        sensitivity=sensitivity_table(result),
        parameters=_parameters(result),
        statements=_statements(result),
        doubts=_doubts(result),
        remarks=_remarks(stated),
        signatures=(
            Field("Calibrated by", _text(stated, "operator")),
            Field("Approved by", _text(stated, "approved_by")),
        ),
        files=_files(result),
        made_by=_made_by(result),
    )


def _text(stated: Mapping[str, Any], key: str) -> str | None:
    value = stated.get(key)
    return None if value is None or value == "" else str(value)


def _groups(result: Result) -> tuple[tuple[str, tuple[Field, ...]], ...]:
    stated, sensor = result.certificate, result.sensor
    others = {key: value for key, value in sensor.items() if key not in _SENSOR and value}
    device = [Field(label, _text(sensor, key)) for key, label in _SENSOR.items()]
    device += [Field(_words(key), str(value)) for key, value in others.items()]
    device += _given(stated, {"condition": "Condition on receipt"})
    order = [Field("Customer", _lines(stated, "customer", "customer_address"))]
    order += _given(stated, {"order_number": "Order number", "date_of_receipt": "Date of receipt"})
    order += [Field("Date of calibration", _text(stated, "date_of_calibration"))]
    order += [Field("Date of issue", _text(stated, "date_of_issue")), *_given(stated, {"place": "Place"})]
    conditions = [Field("Mounting", _text(stated, "mounting"))]
    conditions += _given(
        stated, {"direction": "Direction", "amplitude": "Amplitude", "conditioning": "Signal conditioning"}
    )
    conditions += [Field("Temperature", _ambient(stated, "temperature", "c", "°C"))]
    conditions += [Field("Relative humidity", _ambient(stated, "relative_humidity", "percent", "%"))]
    if stated.get("air_pressure_hpa") is not None:
        conditions.append(Field("Air pressure", _ambient(stated, "air_pressure", "hpa", "hPa")))
    quantity = result.reference.get("quantity", "acceleration")
    method = [
        Field("Procedure", _text(stated, "procedure")),
        Field("Reference quantity", f"{quantity}, in {pretty(reference_unit(result))}"),
        Field("Measured band", _band(result)),
        Field("Evaluation", f"model {result.model}, estimator {result.estimator}"),
    ]
    groups = [("Object", device), ("Order", order), ("Conditions", conditions), ("Method", method)]
    further = [Field(_words(key), _plain(value)) for key, value in stated.items() if key not in _PLACED]
    groups += [("Further statements", further)] if further else []
    return tuple((title, tuple(fields)) for title, fields in groups)


def _given(stated: Mapping[str, Any], labels: Mapping[str, str]) -> list[Field]:
    """Fields that appear only where they are stated."""
    return [Field(label, str(stated[key])) for key, label in labels.items() if stated.get(key)]


def _lines(stated: Mapping[str, Any], *keys: str) -> str | None:
    return "\n".join(str(stated[key]) for key in keys if stated.get(key)) or None


def _words(key: str) -> str:
    text = key.replace("_", " ")
    return text[:1].upper() + text[1:]


def _plain(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key}: {_plain(item)}" for key, item in value.items())
    if isinstance(value, list | tuple):
        return "; ".join(_plain(item) for item in value)
    return tables.leaf(value)


def _ambient(stated: Mapping[str, Any], name: str, suffix: str, unit: str) -> str | None:
    """A condition with its expanded uncertainty, both as they were stated."""
    value, expanded = stated.get(f"{name}_{suffix}"), stated.get(f"{name}_uncertainty_{suffix}")
    if value is None:
        return None
    return f"{value:.12g} {unit}" + (f" (U = {expanded:.12g} {unit}, k = 2)" if expanded is not None else "")


def _band(result: Result) -> str:
    band = measured_band(result)
    if band is None:
        return "no measured points"
    points = count(len(result.measured.frequency_hz), "measured point")
    return f"{band[0]:.5g} Hz to {band[1]:.5g} Hz, {points}"


def _instruments(stated: Mapping[str, Any]) -> Table:
    header = ("Instrument", "Manufacturer, type", "Serial number", "Certificate", "Calibrated until")
    rows = []
    for item in stated.get("instruments") or ():
        entry = item if isinstance(item, Mapping) else {"name": item}
        maker = " ".join(str(entry[key]) for key in ("manufacturer", "type") if entry.get(key))
        rest = (str(entry.get(key) or "") for key in ("serial_number", "certificate", "calibrated_until"))
        rows.append((str(entry.get("name", "")), maker, *rest))
    return Table(columns(*header), tuple(rows)).telling()


def _reference(result: Result) -> tuple[Field, ...]:
    point, why = reference_point(result)
    if point is None:
        return (Field("Reference frequency", None), Field("Reason", f"{why[:1].upper()}{why[1:]}."))
    scale = sensitivity_scale(result)
    magnitude, expanded = with_u(point.magnitude, point.magnitude_uncertainty, scale.factor)
    exact = "" if same(float(point.nominal), point.frequency_hz) else f" (computed at {exact_frequency(point)} Hz)"
    fields = [
        Field("Reference frequency", f"{point.nominal} Hz{exact}; {why}"),
        Field("Magnitude |S|", f"{magnitude} {scale.unit}{_bar(expanded, scale.unit)}"),
    ]
    if point.phase_deg is not None:
        phase, phase_u = with_u(point.phase_deg, point.phase_deg_uncertainty, 1.0)
        fields.append(Field("Phase of S", f"{phase}°{_bar(phase_u, '°')}"))
    return tuple(fields)


def _bar(expanded: str, unit: str) -> str:
    space = "" if unit == "°" else " "
    return "" if expanded == NONE else f", U = {expanded}{space}{unit} (k = {COVERAGE_FACTOR:g})"


def sensitivity_table(result: Result) -> Table | None:
    """Magnitude, phase and U at the nominal frequencies of the measured band; None if it holds no nominal frequency."""
    points = nominal_points(result)
    if not points:
        return None
    scale = sensitivity_scale(result)
    phases = any(point.phase_deg is not None for point in points)
    heads = [("nominal", "Hz"), ("f", "Hz"), ("magnitude", scale.unit), ("U", scale.unit), ("U", "%")]
    heads += [("phase", "°"), ("U", "°")] if phases else []
    rows = tuple(_row(point, scale.factor, phases) for point in points)
    notes = (_CURVE_NOTE, words.PHASE) if phases else (_CURVE_NOTE,)
    return Table(tuple(Column(title, "number", unit) for title, unit in heads), rows, notes=notes)


def exact_frequency(point: Point) -> str:
    """The frequency that a point's values belong to, in Hz, five digits."""
    return f"{point.frequency_hz:#.5g}".rstrip(".") if point.frequency_hz < 1e5 else f"{point.frequency_hz:.0f}"


def _row(point: Point, factor: float, phases: bool) -> tuple[str, ...]:
    magnitude, expanded = with_u(point.magnitude, point.magnitude_uncertainty, factor)
    relative = NONE
    if point.magnitude_uncertainty is not None and point.magnitude:
        _, relative = with_u(abs(point.magnitude), point.magnitude_uncertainty, 100.0 / abs(point.magnitude))
    row = (point.nominal, exact_frequency(point), magnitude, expanded, relative)
    return row + with_u(point.phase_deg, point.phase_deg_uncertainty, 1.0) if phases else row


def _parameters(result: Result) -> Table:
    """The parameter table without the columns that a certificate does not need."""
    whole = tables.parameters(result)
    few = parameter_factor(result) != COVERAGE_FACTOR
    names = ("parameter", "symbol", "value", "u", *(("k",) if few else ()), "U", "unit", "remark")
    kept = whole.select(tuple(whole.header.index(name) for name in names)).telling()
    per_g = tables.per_g(result)
    return replace(kept, notes=(per_g,) if per_g else ())


def _statements(result: Result) -> tuple[str, ...]:
    covers = result.settings.get("uncertainty_covers")
    reference = result.settings.get("reference_standard_uncertainty")
    parts = [
        "U is the expanded uncertainty, U = k·u with the standard uncertainty u (GUM) and the coverage factor "
        + coverage(result).text,
        "It covers: " + str(covers) + "." if covers else "",
        f"It includes the reference's relative standard uncertainty of {plain(100.0 * reference, 3)} %."
        if reference
        else "",
    ]
    verdict = (
        f"The model {'describes' if result.fit.adequate else 'does not describe'} the data within their uncertainties."
    )
    parts.append(interval_text(result))
    more = (tables.small_signals(result), *((tables.UNSTATED,) if _unstated(result) else ()))
    return (
        " ".join(part for part in parts if part),
        " ".join((verdict, tables.worst(result.measured))).strip(),
        *(part for part in more if part),
    )


def _unstated(result: Result) -> bool:
    known = [*result.response.magnitude_uncertainty, *(p.standard_uncertainty for p in result.parameters.values())]
    return any(u is None for u in known)


def _doubts(result: Result) -> tuple[tuple[str, tuple[str, ...]], ...]:
    found = []
    for code in result.warning_codes:
        messages = tuple(warning.message for warning in result.warnings if warning.code == code)
        title = words.explain(code).title
        found.append((title[:1].upper() + title[1:], messages))
    return tuple(found)


def _remarks(stated: Mapping[str, Any]) -> tuple[str, ...]:
    remarks = stated.get("remarks") or ()
    return (remarks,) if isinstance(remarks, str) else tuple(str(remark) for remark in remarks)


def _files(result: Result) -> Table:
    entries = [entry for entry in result.provenance.get("files") or () if isinstance(entry, Mapping)]
    known = [entry for entry in entries if entry.get("file") or entry.get("sha256")]
    rows = tuple((str(entry.get("file") or NONE), str(entry.get("sha256") or NONE)) for entry in known)
    return Table(columns("Data file", "SHA-256"), rows)


def _made_by(result: Result) -> str:
    version, time = result.provenance.get("vibrident"), result.provenance.get("time")
    return f"vibrident{f' {version}' if version else ''}" + (f", {time}" if time else "")
