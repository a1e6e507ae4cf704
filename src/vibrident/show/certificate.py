"""What a calibration certificate says, as text: from the result and the calibration file's [certificate] alone.

The fields are those of practice under ISO 16063 and DKD-R 3-1. What is not stated is a blank to fill, never a value.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from vibrident.base.amounts import pretty
from vibrident.base.nominal import same
from vibrident.result import Result
from vibrident.show import figures, tables, words
from vibrident.show.coverage import coverage, interval_text, parameter_factor, scatter_only, unstated
from vibrident.show.findings import findings
from vibrident.show.formulas import Words
from vibrident.show.history import date_of
from vibrident.show.numbers import (
    COVERAGE_FACTOR,
    NONE,
    plain,
    printed,
    reference_unit,
    sensitivity_scale,
    sensor_name,
    with_u,
)
from vibrident.show.points import Point, measured_band, nominal_points, reference_point
from vibrident.show.views import (
    Beside,
    Column,
    Document,
    Fact,
    Facts,
    Letterhead,
    Sentence,
    Signatures,
    Table,
    columns,
    count,
    document,
    listed,
    section,
)

#: Keys that have a place of their own; others are listed as further statements.
_PLACED = {
    *("number", "laboratory", "laboratory_address", "accreditation", "customer", "customer_address", "order_number"),
    *("date_of_receipt", "date_of_calibration", "date_of_issue", "place", "condition", "mounting", "direction"),
    *("amplitude", "conditioning", "procedure", "traceability", "instruments", "operator", "approved_by", "remarks"),
    *("temperature_c", "temperature_uncertainty_c", "relative_humidity_percent", "air_pressure_hpa"),
    *("relative_humidity_uncertainty_percent", "air_pressure_uncertainty_hpa", "reference_frequency_hz"),
}
MOST_FILES = 30  # data files listed; the result lists them all
_SENSOR = {"manufacturer": "Manufacturer", "type": "Type", "serial_number": "Serial number"}
_CURVE_NOTE = (
    "The values are those of the identified model at f. The nominal frequencies are those of ISO 266 inside the "
    "measured band; f is the exact base-10 frequency, or the nominal value where the data were taken at those."
)


def certificate(result: Result) -> Document:
    """Everything that a certificate states of a result, to be signed."""
    stated, curve = result.certificate, figures.sensitivity(result) if len(result.response.frequency_hz) > 1 else None
    nominal = sensitivity(result) or Sentence("The measured band holds no nominal one-third-octave frequency.")
    sections = [
        section("instruments", "Instruments", instruments(result)),
        section("traceability", "Traceability", Sentence(_text(stated, "traceability") or "")),
        section("reference", "Result at the reference frequency", reference(result)),
        section("limits", "What limits these results", *_doubts(result)),
        findings(result),
        section("sensitivity", "Sensitivity at nominal frequencies", nominal),
        section("curve", "Sensitivity over frequency", curve and replace(curve, caption="")),
        section("parameters", "Parameters of the model", parameters(result)),
        section("data", "Data", _files(result)),
        section("statements", "Statements", *map(Sentence, statements(result))),
        section("remarks", "Remarks", *map(Sentence, remarks(result))),
        section("signatures", "", Signatures(signatures(result))),
    ]
    return replace(
        document(title(result), (*scatter_only(result), Beside(groups(result))), sections),
        letterhead=letterhead(result),
    )


def title(result: Result) -> str:
    """What the document is: a certificate states an uncertainty of the sensor, not of the scatter alone."""
    return "Measurement report" if unstated(result) else "Calibration certificate"


def letterhead(result: Result) -> Letterhead:
    """Who issues the certificate, its number, and what stands on each of its pages."""
    stated = result.certificate
    lines = (stated.get(key) for key in ("laboratory", "laboratory_address", "accreditation"))
    version, time = result.provenance.get("vibrident"), result.provenance.get("time")
    made_by = f"vibrident{f' {version}' if version else ''}" + (f", {time}" if time else "")
    return Letterhead(
        lines=tuple(str(line) for line in lines if line),
        number=_text(stated, "number"),
        subject=sensor_name(result.sensor),
        foot=f"Evaluated with {made_by}. The results hold for the object and the conditions stated.",
        date=date_of(result),
    )


def signatures(result: Result) -> tuple[Fact, ...]:
    """Who signs."""
    labels = {"operator": "Calibrated by", "approved_by": "Approved by"}
    return tuple((label, _text(result.certificate, key)) for key, label in labels.items())


def _text(stated: Mapping[str, Any], key: str) -> str | None:
    value = stated.get(key)
    return None if value is None or value == "" else str(value)


def groups(result: Result) -> tuple[Facts, ...]:
    """What was calibrated, for whom, under which conditions and how."""
    stated, sensor = result.certificate, result.sensor
    others = {key: value for key, value in sensor.items() if key not in _SENSOR and value}
    device = [(label, _text(sensor, key)) for key, label in _SENSOR.items()]
    device += [(_words(key), str(value)) for key, value in others.items()]
    device += _given(stated, {"condition": "Condition on receipt"})
    order = [("Customer", _lines(stated, "customer", "customer_address"))]
    order += _given(stated, {"order_number": "Order number", "date_of_receipt": "Date of receipt"})
    order += [("Date of calibration", _text(stated, "date_of_calibration"))]
    order += [("Date of issue", _text(stated, "date_of_issue")), *_given(stated, {"place": "Place"})]
    conditions = [("Mounting", _text(stated, "mounting"))]
    conditions += _given(
        stated, {"direction": "Direction", "amplitude": "Amplitude", "conditioning": "Signal conditioning"}
    )
    conditions += [("Temperature", _ambient(stated, "temperature", "c", "°C"))]
    conditions += [("Relative humidity", _ambient(stated, "relative_humidity", "percent", "%"))]
    if stated.get("air_pressure_hpa") is not None:
        conditions.append(("Air pressure", _ambient(stated, "air_pressure", "hpa", "hPa")))
    method = [
        ("Procedure", _text(stated, "procedure")),
        ("Reference quantity", f"{result.quantity}, in {pretty(reference_unit(result))}"),
        ("Measured band", _band(result)),
        ("Evaluation", f"model {result.model}, estimator {result.estimator}"),
    ]
    further = [(_words(key), _plain(value)) for key, value in stated.items() if key not in _PLACED]
    titled = {"Object": device, "Order": order, "Conditions": conditions, "Method": method}
    titled |= {"Further statements": further} if further else {}
    return tuple(Facts(tuple(rows), title) for title, rows in titled.items())


def _given(stated: Mapping[str, Any], labels: Mapping[str, str]) -> list[Fact]:
    """Rows that appear only where they are stated."""
    return [(label, str(stated[key])) for key, label in labels.items() if stated.get(key)]


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
    return f"{printed(f'{value:.12g}')} {unit}" + (
        f" (U = {expanded:.12g} {unit}, k = 2)" if expanded is not None else ""
    )


def _band(result: Result) -> str:
    band = measured_band(result)
    if band is None:
        return "no measured points"
    points = count(len(result.measured.frequency_hz), "measured point")
    return f"{band[0]:.5g} Hz to {band[1]:.5g} Hz, {points}"


def instruments(result: Result) -> Table:
    """The instruments used; no rows are a blank to fill."""
    header = ("Instrument", "Manufacturer, type", "Serial number", "Certificate", "Calibrated until")
    rows = []
    for item in result.certificate.get("instruments") or ():
        entry = item if isinstance(item, Mapping) else {"name": item}
        maker = " ".join(str(entry[key]) for key in ("manufacturer", "type") if entry.get(key))
        rest = (str(entry.get(key) or "") for key in ("serial_number", "certificate", "calibrated_until"))
        rows.append((str(entry.get("name", "")), maker, *rest))
    return Table(columns(*header), tuple(rows)).telling()


def reference(result: Result) -> Facts:
    """The sensitivity at the reference frequency, and how that was chosen."""
    point, why = reference_point(result)
    if point is None:
        return Facts((("Reference frequency", None), ("Reason", f"{why[:1].upper()}{why[1:]}.")))
    scale = sensitivity_scale(result)
    magnitude, expanded = with_u(point.magnitude, point.magnitude_uncertainty, scale.factor)
    exact = "" if same(float(point.nominal), point.frequency_hz) else f" (computed at {exact_frequency(point)} Hz)"
    rows: list[Fact] = [
        ("Reference frequency", f"{point.nominal} Hz{exact}; {why}"),
        ("Magnitude |S|", f"{magnitude} {scale.unit}{_bar(expanded, scale.unit)}"),
    ]
    if point.phase_deg is not None:
        phase, phase_u = with_u(point.phase_deg, point.phase_deg_uncertainty, 1.0)
        rows.append(("Phase of S", f"{phase}°{_bar(phase_u, '°')}"))
    return Facts(tuple(rows))


def _bar(expanded: str, unit: str) -> str:
    space = "" if unit == "°" else " "
    return "" if expanded == NONE else f", U = {expanded}{space}{unit} (k = {COVERAGE_FACTOR:g})"


def sensitivity(result: Result) -> Table | None:
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


def parameters(result: Result) -> Table:
    """The parameter table without the columns that a certificate does not need."""
    whole = tables.parameters(result)
    few = parameter_factor(result) != COVERAGE_FACTOR
    names = ("parameter", "symbol", "value", "u", *(("k",) if few else ()), "U", "unit", "remark")
    kept = whole.select(tuple(whole.header.index(name) for name in names)).telling()
    per_g = tables.per_g(result)
    return replace(kept, notes=(per_g,) if per_g else ())


def statements(result: Result) -> tuple[str, ...]:
    """Paragraphs on uncertainty, phase and adequacy."""
    covers = result.settings.get("uncertainty_covers")
    reference = result.settings.get("reference_standard_uncertainty")
    uncertainty = (
        "U is the expanded uncertainty, U = k·u with the standard uncertainty u (GUM) and the coverage factor",
        coverage(result).text,
        interval_text(result),
    )
    verdict = (
        f"The model {'describes' if result.fit.adequate else 'does not describe'} the data within their uncertainties."
    )
    parts = (
        Words(" ".join(part for part in uncertainty if part)),
        f"It covers: {covers}." if covers else "",
        f"It includes the reference's relative standard uncertainty of {plain(100.0 * reference, 3)} %."
        if reference
        else "",
        " ".join((verdict, tables.worst(result.measured))).strip(),
        tables.small_signals(result),
        tables.UNSTATED if _unstated(result) else "",
    )
    return tuple(part for part in parts if part)


def _unstated(result: Result) -> bool:
    unknown = [p.standard_uncertainty is None for p in result.parameters.values()]
    return any(unknown) or bool(np.isnan(result.response.magnitude_uncertainty).any())


def _doubts(result: Result) -> Iterator[Sentence]:
    for code in result.warning_codes:
        messages = (warning.message for warning in result.warnings if warning.code == code)
        title = words.explain(code).title
        yield Sentence(" ".join(messages), "doubt", f"{title[:1].upper()}{title[1:]}.")
    if not (result.warnings or result.fit.adequate):
        yield Sentence("The model is not adequate for these data.", "doubt")


def remarks(result: Result) -> tuple[str, ...]:
    """As stated."""
    stated = result.certificate.get("remarks") or ()
    return (stated,) if isinstance(stated, str) else tuple(str(remark) for remark in stated)


def _files(result: Result) -> Table | None:
    """Data files with their SHA-256."""
    entries = [entry for entry in result.provenance.get("files") or () if isinstance(entry, Mapping)]
    known = [entry for entry in entries if entry.get("file") or entry.get("sha256")]
    rows = tuple((str(entry.get("file") or NONE), str(entry.get("sha256") or NONE)) for entry in known)
    kept = listed(len(rows), MOST_FILES)
    more = (f"and {len(rows) - kept} more, listed in result.json",) if len(rows) > kept else ()
    return Table(columns("Data file", "SHA-256"), rows[:kept], notes=more) if rows else None
