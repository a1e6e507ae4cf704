"""A complete Markdown report from a result alone."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from vibrident.plots import applicable
from vibrident.plots.units import nominal_frequency, pretty, reference_unit, scaled, sensitivity_unit, sensor_name
from vibrident.records import STANDARD_GRAVITY
from vibrident.report import words
from vibrident.report.numbers import COVERAGE_FACTOR, NONE, pair, percent, plain, stated
from vibrident.report.weights import weight_rows
from vibrident.result import MeasuredCurve, Parameter, Result

#: Rows of the table of measured points; more are thinned evenly, and the report says so.
MOST_ROWS = 200

_CAPTIONS = {
    "sensitivity": "Sensitivity over frequency, model and measurement, with U (k = 2)",
    "deviation": "Deviation of the model from the measurement, with U (k = 2)",
    "signals": "Measured and predicted response in time, residual underneath",
    "residuals": "Residuals by record or frequency, and their distribution",
    "training": "Loss and parameters by iteration",
}


def render(
    result: Result,
    pictures: str | os.PathLike[str] | None = None,
    relative_to: str | os.PathLike[str] | None = None,
) -> str:
    """Write the report as Markdown text (GitHub tables).

    Args:
        result: any result.
        pictures: folder in which ``plots.save_all`` has drawn; the pictures found there are linked.
        relative_to: folder in which the report will lie, for the links; by default the folder of pictures.

    Returns:
        the text, ending in a line end.
    """
    links = _links(result, pictures, relative_to)
    parts = [
        _head(result),
        _parameters(result),
        links.get("sensitivity"),
        _correlation(result),
        _fit(result),
        *(links[name] for name in ("signals", "residuals") if name in links),
        _measured(result),
        links.get("deviation"),
        _warnings(result),
        _training(result),
        links.get("training"),
        _weights(result),
        _section("Settings", _tree(result.settings)),
        _section("Provenance", _tree(result.provenance)),
    ]
    return "\n\n".join(part.strip("\n") for part in parts if part) + "\n"


def _links(
    result: Result, pictures: str | os.PathLike[str] | None, relative_to: str | os.PathLike[str] | None
) -> dict[str, str]:
    if pictures is None:
        return {}
    base = Path(pictures if relative_to is None else relative_to)
    found = {}
    for name in applicable(result):  # not what an earlier result left there
        files = (Path(pictures) / f"{name}.{suffix}" for suffix in ("svg", "png"))
        file = next((file for file in files if file.is_file()), None)
        if file is not None:
            link = Path(os.path.relpath(file, base)).as_posix()
            found[name] = f"![{_CAPTIONS[name]}](<{link}>)\n\n*{_CAPTIONS[name]}.*"
    return found


def _section(title: str, body: str) -> str:
    return f"## {title}\n\n{body}" if body else ""


def _table(header: Sequence[str], rows: Iterable[Sequence[str]], right: Iterable[int] = ()) -> str:
    numbers = set(right)
    rule = ["---:" if i in numbers else "---" for i in range(len(header))]
    return "\n".join(f"| {' | '.join(_cell(c) for c in row)} |" for row in (header, rule, *rows))


def _cell(text: str) -> str:
    return _safe(text).replace("|", "\\|")


def _safe(text: str) -> str:
    """Text of others as text: one line, no HTML, no emphasis by accident."""
    line = " ".join(str(text).split())
    for mark in ("\\", "`", "*", "_", "[", "]", "<", ">"):
        line = line.replace(mark, {"<": "&lt;", ">": "&gt;"}.get(mark, "\\" + mark))
    return line


def _head(result: Result) -> str:
    name = sensor_name(result.sensor)
    adequate = "adequate" if result.fit.adequate else "**not adequate**"
    doubts = f"{_count(len(result.warnings), 'warning')}, explained below" if result.warnings else "no warnings"
    quantity = result.reference.get("quantity", "acceleration")
    rows = [(key.replace("_", " "), str(value)) for key, value in result.sensor.items() if value]
    rows += [
        ("model", result.model),
        ("estimator", result.estimator),
        ("reference", f"{quantity}, in {pretty(reference_unit(result))}"),
        ("response", f"in {pretty(result.response_unit)}"),
        ("frequencies", _band(result.measured)),
    ]
    title = f"# Calibration of {_safe(name)}" if name else "# Calibration"
    return f"{title}\n\nThe model is {adequate} for these data; {doubts}.\n\n{_table(('', ''), rows)}"


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}{'' if number == 1 else 's'}"


def _band(measured: MeasuredCurve) -> str:
    known = [f for f in measured.frequency_hz if f is not None]
    if not known:
        return "no measured points"
    low, high = f"{min(known):.5g} Hz", f"{max(known):.5g} Hz"
    return f"{_count(len(known), 'point')}, {low}" + (f" to {high}" if high != low else "")


def _parameters(result: Result) -> str:
    ordered = sorted(result.parameters.items(), key=lambda item: item[1].derived)
    rows = []
    for name, parameter in ordered:
        number = stated(parameter)
        full = words.parameter_name(name)
        known = parameter.standard_uncertainty is not None
        rows.append(
            (
                full.words,
                full.symbol,
                number.value,
                number.standard,
                f"{COVERAGE_FACTOR:g}" if known else NONE,
                number.expanded,
                number.unit or "1",
                number.interval,
                words.remark(parameter),
            )
        )
    header = ("parameter", "symbol", "value", "u", "k", "U", "unit", "95 % interval", "remark")
    text = _table(header, rows, right=(2, 3, 4, 5))
    return _section("Parameters", "\n\n".join(part for part in (text, _per_g(result), words.COVERAGE) if part))


def _per_g(result: Result) -> str:
    sensitivity = result.parameters.get("sensitivity")
    if sensitivity is None or not sensitivity.unit.endswith(("/(m/s^2)", "/(m/s²)")):
        return ""
    u = sensitivity.standard_uncertainty
    unit = sensitivity.unit[: sensitivity.unit.rindex("/(")] + "/g"
    per_g = stated(
        Parameter(sensitivity.value * STANDARD_GRAVITY, unit, None if u is None else u * STANDARD_GRAVITY, (None, None))
    )
    bar = f", U = {per_g.expanded} {per_g.unit} (k = 2)" if u else ""
    return f"Per standard gravity (g = {STANDARD_GRAVITY} m/s²): S0 = {per_g.value} {per_g.unit}{bar}."


def _correlation(result: Result) -> str:
    names = result.correlation.names
    if not names:
        return ""
    short = [words.parameter_name(name).symbol or name for name in names]
    rows = [
        (name.replace("_", " "), *(NONE if value is None else f"{value:+.3f}" for value in row))
        for name, row in zip(names, result.correlation.matrix, strict=False)
    ]
    body = _table(("", *short), rows, right=range(1, len(names) + 1))
    return _section("Correlation of the estimated parameters", body)


def _fit(result: Result) -> str:
    unit = result.response_unit if result.signals else sensitivity_unit(result.response_unit, reference_unit(result))
    rows = []
    for field, metric in words.METRICS.items():
        value = getattr(result.fit, field)
        power = metric.in_response_unit
        if power == 1 and value:
            scale = scaled(unit, value)
            text, label = plain(value * scale.factor, 4), scale.unit
        else:
            text = plain(value, 6 if field == "r2" else 4)
            label = {0: "1", 1: pretty(unit), 2: f"({pretty(unit)})²"}[power]
        rows.append((metric.label, text, label, metric.definition))
    verdict = "adequate" if result.fit.adequate else "not adequate (see the warnings)"
    lead = (
        "e is the residual, measured minus predicted response; y is the measured response. "
        f"Verdict on the model: {verdict}."
    )
    return _section("Fit", f"{lead}\n\n{_table(('metric', 'value', 'unit', 'definition'), rows, right=(1,))}")


def _measured(result: Result) -> str:
    measured = result.measured
    count = len(measured.frequency_hz)
    if count == 0:
        return ""
    magnitudes = sorted(abs(m) for m in measured.magnitude if m)
    unit = sensitivity_unit(result.response_unit, reference_unit(result))
    scale = scaled(unit, magnitudes[len(magnitudes) // 2] if magnitudes else 0.0)
    phases = any(phase is not None for phase in measured.phase_deg)
    header = ["frequency / Hz", "nominal / Hz", f"magnitude / ({scale.unit})", f"U / ({scale.unit})", "deviation"]
    if phases:
        header += ["phase / °", "U / °", "deviation / °"]
    header.append("record")
    step = max(1, -(-count // MOST_ROWS))
    rows = []
    for i in range(0, count, step):
        magnitude, expanded = _with_u(measured.magnitude[i], _at(measured.magnitude_uncertainty, i), scale.factor)
        row = [
            f"{measured.frequency_hz[i]:.6g}",
            nominal_frequency(measured.frequency_hz[i]) or "",
            magnitude,
            expanded,
            percent(_at(measured.deviation_percent, i)),
        ]
        if phases:
            phase, phase_u = _with_u(measured.phase_deg[i], _at(measured.phase_deg_uncertainty, i), 1.0)
            shift = _at(measured.deviation_phase_deg, i)
            row += [phase, phase_u, NONE if shift is None else f"{(shift + 180) % 360 - 180:+.3f}"]
        rows.append([*row, _at(measured.record, i) or ""])
    used = [j for j in range(len(header)) if j != 1 or any(row[1] for row in rows)]
    table = _table([header[j] for j in used], [[row[j] for j in used] for row in rows], right=range(len(used) - 1))
    thinned = f" Every {step}th of {count} points is listed." if step > 1 else ""
    lead = f"Deviation is model − measured, of the magnitude relative to the measured one; U with k = 2.{thinned}"
    summary = _worst(measured)
    notes = words.PHASE if phases else ""
    return _section("Measured points and the model", "\n\n".join(x for x in (lead, summary, table, notes) if x))


def _at(values: Sequence[Any], index: int) -> Any:
    return values[index] if index < len(values) else None


def _with_u(value: float | None, u: float | None, factor: float) -> tuple[str, str]:
    """Value to the place of its U, and U."""
    if value is None:
        return NONE, NONE
    return pair(value * factor, None if u is None else COVERAGE_FACTOR * u * factor)


def _worst(measured: MeasuredCurve) -> str:
    known = [
        (abs(d), f) for d, f in zip(measured.deviation_percent, measured.frequency_hz, strict=False) if d is not None
    ]
    if not known:
        return ""
    largest, where = max(known)
    mean = sum(d for d, _ in known) / len(known)
    return f"Mean absolute deviation {plain(mean, 2)} %, largest {plain(largest, 2)} % at {where:.5g} Hz."


def _warnings(result: Result) -> str:
    if not result.warnings:
        return _section("Warnings", "None.")
    parts = []
    for code in result.warning_codes:
        explained = words.explain(code)
        messages = [f"> {_safe(w.message)}" for w in result.warnings if w.code == code]
        parts.append(
            f"### {explained.title[:1].upper()}{explained.title[1:]} (`{code}`)\n\n"
            + "\n>\n".join(messages)
            + f"\n\n{explained.meaning}\n\n**What to do:** {explained.action}"
        )
    return _section("Warnings", "\n\n".join(parts))


def _training(result: Result) -> str:
    training = result.training
    if training is None:
        return ""
    losses = [loss for loss in training.loss if loss is not None]
    ran = f"; loss {plain(losses[0], 4)} → {plain(losses[-1], 4)}" if losses else ""
    steps = _count(training.iterations, "iteration")
    return _section("Training", f"Optimiser {_safe(training.optimiser)}: {_safe(training.status)}, {steps}{ran}.")


def _weights(result: Result) -> str:
    if not result.weights:
        return ""
    rows = [(row.name, row.layer, row.euler, "; ".join(row.lines)) for row in weight_rows(result.weights)]
    body = _table(("weight", "layer", "under forward Euler (paper, Table 1)", "value"), rows)
    return _section("Weights of the network", f"{body}\n\nRows of a matrix are separated by semicolons.")


def _tree(values: Any, depth: int = 0) -> str:
    """Nested settings as nested bullets."""
    lines = []
    pairs = values.items() if isinstance(values, Mapping) else enumerate(values, 1)
    for key, value in pairs:
        bullet = f"{'  ' * depth}- {_safe(str(key).replace('_', ' '))}:"
        if isinstance(value, (Mapping, list, tuple)) and value:
            if isinstance(value, (list, tuple)) and not any(isinstance(v, (Mapping, list, tuple)) for v in value):
                lines.append(f"{bullet} {_safe(', '.join(_leaf(v) for v in value))}")
            else:
                lines += [bullet, _tree(value, depth + 1)]
        else:
            lines.append(f"{bullet} {_safe(_leaf(value))}")
    return "\n".join(lines)


def _leaf(value: Any) -> str:
    if value is None or (isinstance(value, (Mapping, list, tuple)) and not value):
        return NONE
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.12g}" if isinstance(value, float) else str(value)
