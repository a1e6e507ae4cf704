"""Build the tables of a result as text, ready for print."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from vibrident.base.amounts import amount, pretty, scaled
from vibrident.base.settings import Word, python_word, rendered
from vibrident.data.records import STANDARD_GRAVITY
from vibrident.physics.models import installed
from vibrident.physics.naming import parameter_name
from vibrident.result import MeasuredCurve, Parameter, Result
from vibrident.show import words
from vibrident.show.coverage import coverage, interval_text, parameter_factor
from vibrident.show.curves import column, principal
from vibrident.show.formulas import Mixed, Words, symbol
from vibrident.show.language import ENGLISH, Translator
from vibrident.show.numbers import (
    NONE,
    fit_unit,
    nominal_frequency,
    parameter_scale,
    percent,
    plain,
    printed,
    reference_quantity,
    reference_unit,
    rounded,
    rounded_parameter,
    sensitivity_scale,
    signed,
    uncertainty,
    with_sign,
    with_u,
)
from vibrident.show.views import Column, Doubt, Facts, FloatArray, K, Table, columns, count

MAX_ROWS = 200  # of the table of measured points; more are thinned evenly, and the report says so


def facts(result: Result) -> tuple[tuple[str, str], ...]:
    """Return what was calibrated and how, as pairs of name and text."""
    pairs = [(key.replace("_", " "), str(value)) for key, value in result.sensor.items() if value]
    reference = "none: free decays"
    if result.has_gain:
        reference = f"{reference_quantity(result)}, in {pretty(reference_unit(result))}"
    pairs += [
        ("model", result.model),
        ("estimator", result.estimator),
        ("reference", reference),
        ("response", f"in {pretty(result.response_unit)}"),
    ]
    pairs += [
        (f"known of the {row['channel']}", _removed_response(row))
        for row in result.settings.get("known_responses", ())
    ]
    pairs += [("corrected for", correction) for correction in corrections(result)]
    if result.has_gain:
        pairs.append(("frequencies", _band(result.measured)))
    return tuple(pairs)


def corrections(result: Result) -> list[str]:
    """Return the stated effects that the data are corrected for, with amount and u."""
    texts = []
    for row in result.settings.get("corrected_for", ()):
        size, u = (amount(row[name], row["unit"], 3) for name in ("amount", "standard_uncertainty"))
        texts.append(f"{row['source']} ({row['kind']}) of {size}, as the data show it; u = {u}")
    return texts


def _removed_response(row: Mapping[str, Any]) -> str:
    low, high = row["band_hz"]
    return f"{row['source']}, taken out from {low:.4g} to {high:.4g} Hz"


def _band(measured: MeasuredCurve) -> str:
    frequency_hz = measured.frequency_hz
    if not frequency_hz.size:
        return "no measured points"
    low = f"{frequency_hz.min():.5g} Hz"
    high = f"{frequency_hz.max():.5g} Hz"
    return f"{count(frequency_hz.size, 'point')}, {low}" + (f" to {high}" if high != low else "")


def doubts(result: Result, word: Word = python_word) -> tuple[Doubt, ...]:
    """Explain every warning in plain words; ``word``: a surface's words for settings."""
    blocks = []
    for code in result.warning_codes:
        kind = words.explain(code)
        messages = tuple(warning.message for warning in result.warnings if warning.code == code)
        blocks.append(Doubt(kind.title, code, messages, kind.meaning, rendered(kind.action, word)))
    return tuple(blocks)


def parameters(result: Result) -> Table:
    """Tabulate value, u, k, U, unit and interval of each parameter, derived ones last."""
    rows = []
    k = parameter_factor(result)
    for name, parameter in sorted(result.parameters.items(), key=lambda item: item[1].derived):
        number = rounded_parameter(parameter, k, parameter_scale(result, parameter))
        full = parameter_name(name)
        has_u = parameter.standard_uncertainty is not None
        rows.append(
            (
                full.words,
                symbol(name),
                number.value,
                number.standard,
                plain(k, 3) if has_u else NONE,
                number.expanded,
                number.unit or "1",
                number.interval,
                words.remark(parameter),
            )
        )
    heads = (
        *columns("parameter", "symbol"),
        *columns("value", "u", "k", "U", kind="number"),
        *columns("unit", "95 % interval", "remark"),
    )
    notes = (one_frequency(result), between_samples(result), per_g(result), small_signals(result))
    notes += (words.COVERAGE, coverage(result).text(), interval_text(result))
    return Table(heads, tuple(rows), notes=tuple(note for note in notes if note))


def one_frequency(result: Result) -> str:
    """Return the frequency at which the sensitivity of a gain alone holds; empty for others."""
    model = installed(result.model)
    frequencies = set(result.measured.frequency_hz.tolist())
    if model is None or not model.is_gain_alone or len(frequencies) != 1:
        return ""
    hz = frequencies.pop()
    return f"The sensitivity is that at {hz:.6g} Hz, the only frequency that was measured."


def between_samples(result: Result) -> str:
    """Return what the reference does between its samples; empty for a band-limited motion."""
    choice = str(result.settings.get("estimator_choice", ""))
    return f"{choice[:1].upper()}{choice[1:]}." if choice.startswith("the reference") else ""


def small_signals(result: Result) -> str:
    """Return what a sensitivity means for a nonlinear spring; empty for a linear sensor."""
    model = installed(result.model)
    return " ".join(addon.remark for addon in model.add_ons if addon.remark) if model else ""


def per_g(result: Result, translate: Translator = ENGLISH) -> str:
    """Return the sensitivity per standard gravity; empty where it is not one to acceleration."""
    model = installed(result.model)
    sensitivity = result.parameters.get(model.gain_name) if model else None
    if sensitivity is None or not sensitivity.unit.endswith(("/(m/s^2)", "/(m/s²)")):
        return ""
    u = sensitivity.standard_uncertainty
    unit = sensitivity.unit[: sensitivity.unit.rindex("/(")] + "/g"
    k = parameter_factor(result)
    per_gravity = Parameter(
        sensitivity.value * STANDARD_GRAVITY,
        unit,
        None if u is None else u * STANDARD_GRAVITY,
        (None, None),
    )
    number = rounded_parameter(per_gravity, k)
    bar = f", U = {number.expanded} {number.unit} (k = {plain(k, 3)})" if u else ""
    value = f"{number.value} {number.unit}{bar}"
    return Mixed(translate("text", "per_g", g=f"{STANDARD_GRAVITY}", value=value))


def correlation(result: Result) -> Table | None:
    """Tabulate the correlation of the estimated parameters."""
    names = result.correlation.names
    if not names:
        return None
    short = [symbol(name) or name for name in names]
    rows = tuple(
        (parameter_name(name).words, *(signed(value, 3) for value in row))
        for name, row in zip(names, result.correlation.matrix, strict=False)
    )
    return Table((Column(""), *columns(*short, kind="number")), rows)


def fit(result: Result) -> Table:
    """Tabulate every metric of the fit with its unit and definition."""
    unit = fit_unit(result)
    scale = scaled(unit, result.fit.rmse or 0.0)  # one for all of its metrics
    units = ("1", pretty(unit), f"({pretty(unit)})²" if "/" in unit else f"{pretty(unit)}²")
    rows = []
    for field, metric in words.METRICS.items():
        value = getattr(result.fit, field)
        text = plain(value, 6 if field in ("r2", "explained", "coherent") else 4)
        metric_unit = units[metric.in_response_unit]
        if metric.in_response_unit == 1 and value:
            text = plain(value * scale.factor, 4)
            metric_unit = scale.unit
        rows.append((metric.label, text, metric_unit, metric.definition))
    verdict = "adequate" if result.fit.adequate else "not adequate (see the warnings)"
    lead = (
        "e is the residual, measured minus predicted response; y is the measured response. "
        f"Verdict on the model: {verdict}."
    )
    heads = (Column("metric"), Column("value", "number"), *columns("unit", "definition"))
    return Table(heads, tuple(rows), (lead,))


def measured(result: Result) -> Table | None:
    """Return the measured points with the model's deviation from each; None without points."""
    points = result.measured
    total = len(points.frequency_hz)
    if total == 0:
        return None
    scale = sensitivity_scale(result)
    has_phases = bool(np.isfinite(points.phase_deg).any())
    has_noise = bool(np.isfinite(points.magnitude_noise).any())
    step = max(1, -(-total // MAX_ROWS))
    thinned = slice(None, None, step)
    hz = points.frequency_hz[thinned].tolist()
    magnitudes = _point_cells(
        points,
        thinned,
        "magnitude",
        scale.factor,
        column(points, "deviation_percent"),
        column(points, "deviation_uncertainty_percent"),
        percent,
    )
    phases = [("",) * 5] * len(hz)
    if has_phases:
        phases = _point_cells(
            points,
            thinned,
            "phase_deg",
            1.0,
            principal(column(points, "deviation_phase_deg")),
            column(points, "deviation_phase_uncertainty_deg"),
            _phase_deviation_text,
        )
    names = points.record[thinned] or ("",) * len(hz)
    rows = tuple(
        (f"{f:.6g}", nominal_frequency(f) or "", *magnitude, *phase, name)
        for f, magnitude, phase, name in zip(hz, magnitudes, phases, names, strict=True)
    )
    leads = [
        "Deviation is model − measured, of the magnitude relative to the measured one; U with "
        "k = 2."
    ]
    if step > 1:
        leads[0] += f" Every {step}th of {total} points is listed."
    leads += filter(None, [worst(points), _APART if has_noise else ""])
    notes = []
    if has_phases:
        notes.append(ENGLISH("text", "phase"))
    if np.isnan(points.magnitude_uncertainty).any():
        notes.append(ENGLISH("text", "unstated"))
    return Table(_measured_heads(scale.unit), rows, tuple(leads), tuple(notes)).telling()


def _measured_heads(unit: str) -> tuple[Column, ...]:
    """Return the columns of :func:`measured`; ``unit``: of the sensitivity."""
    numbers = (
        ("frequency", "Hz"),
        ("nominal", "Hz"),
        ("magnitude", unit),
        ("U", unit),
        ("noise", unit),
        ("deviation", ""),
        (Words("E_n"), ""),
        ("phase", "°"),
        ("U", "°"),
        ("noise", "°"),
        ("deviation", "°"),
        (Words("E_n of phase"), ""),
    )
    return (*(Column(title, "number", per) for title, per in numbers), Column("record"))


def _point_cells(
    points: MeasuredCurve,
    thinned: slice,
    quantity: str,
    factor: float,
    deviation: FloatArray,
    deviation_u: FloatArray,
    deviation_text: Callable[[float, float], str],
) -> list[tuple[str, ...]]:
    """Return value, U, U of the noise, deviation and E_n of each listed point, as text.

    Args:
        points: measured.
        thinned: the listed ones.
        quantity: name of the curve's field.
        factor: from the field to the unit that is printed.
        deviation: of the model from each point, shape (n,).
        deviation_u: its standard uncertainty, shape (n,).
        deviation_text: from a deviation and its U to text.
    """
    has_noise = bool(np.isfinite(points.magnitude_noise).any())
    arrays = (
        column(points, quantity),
        column(points, f"{quantity}_uncertainty"),
        column(points, f"{quantity}_noise"),
        deviation,
        K * deviation_u,
    )
    lists = (values[thinned].tolist() for values in arrays)
    cells = []
    for value, u, noise, off, off_expanded in zip(*lists, strict=True):
        en = signed(off / off_expanded, 2) if off_expanded else NONE
        cells.append(
            (
                *with_u(value, u, factor),
                uncertainty(K * noise * factor) if has_noise else "",
                deviation_text(off, off_expanded),
                en if has_noise else "",
            )
        )
    return cells


_APART = Words(
    "U is of noise and stated systematic effects together, noise the U of the point's noise alone. "
    "E_n is the deviation over its own U, which is not that of the point: the model follows what "
    "is common to all points."
)


def _phase_deviation_text(deviation_deg: float, expanded_deg: float) -> str:
    """Return a deviation of the phase: to the place of its U, else three places."""
    if expanded_deg > 0.0 and not math.isnan(deviation_deg):
        return with_sign(rounded(deviation_deg, expanded_deg)[0])
    return signed(deviation_deg, 3)


def worst(points: MeasuredCurve, translate: Translator = ENGLISH) -> str:
    """Return mean and largest deviation of the magnitude in words; empty if none is known."""
    deviations = np.abs(points.deviation_percent)
    if np.isnan(deviations).all():
        return ""
    index = int(np.nanargmax(deviations))
    return translate(
        "text",
        "worst",
        mean=plain(float(np.nanmean(deviations)), 2),
        largest=plain(float(deviations[index]), 2),
        frequency=f"{points.frequency_hz[index]:.5g}",
    )


def training(result: Result) -> str:
    """Return the course of the optimisation in a sentence; empty if it is not known."""
    run = result.training
    if run is None:
        return ""
    # losses of other weights cannot be compared
    first = run.weighting_changes[-1] if run.weighting_changes else 0
    losses = [loss for loss in run.loss[first:] if loss is not None]
    course = ""
    if losses:
        course = f"; loss {plain(losses[0], 4)} → {plain(losses[-1], 4)}"
        if first:
            course += f" with the last weights, from iteration {first + 1} on"
    return f"Optimiser {run.optimiser}: {run.status}, {count(run.iterations, 'iteration')}{course}."


def leaf(value: Any) -> str:
    """Return a setting as text."""
    if value is None or (isinstance(value, dict | list | tuple) and not value):
        return NONE
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return printed(str(value))
    return plain(value) if isinstance(value, float) else str(value)


def values(settings: Mapping[str, Any]) -> tuple[Facts | Table, ...]:
    """Tabulate nested settings: names with values, and each list of alike mappings by itself."""
    rows = []
    lists = []
    for name, value in _leaves(settings, "") if settings else ():
        if isinstance(value, list):
            lists.append(_listed(name, value))
        else:
            rows.append((name, leaf(value) or NONE))
    return (*((Facts(tuple(rows)),) if rows else ()), *lists)


def _leaves(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Yield the path of each setting, and its value or its list of alike mappings."""
    if isinstance(value, Mapping) and len(value) > 1 and _are_alike_mappings(list(value.values())):
        yield name, [{"": spoken_key(key), **row} for key, row in value.items()]
    elif isinstance(value, list | tuple) and _are_alike_mappings(value):
        yield name, list(value)
    elif isinstance(value, list | tuple) and not any(
        isinstance(item, Mapping | list | tuple) for item in value
    ):
        yield name, ", ".join(leaf(item) for item in value) or NONE
    elif isinstance(value, Mapping | list | tuple) and value:
        items = value.items() if isinstance(value, Mapping) else enumerate(value, 1)
        for key, item in items:
            yield from _leaves(item, f"{name} · {spoken_key(key)}" if name else spoken_key(key))
    else:
        yield name, value


def spoken_key(key: Any) -> str:
    """Return a key of the settings in words; foreign names, such as a file's, stay."""
    name = str(key)
    return name.replace("_", " ") if name.isidentifier() and name.islower() else name


def _listed(title: str, rows: list[Mapping[str, Any]]) -> Table:
    keys = list(dict.fromkeys(key for row in rows for key in row))
    numeric = {key for key in keys if all(isinstance(row.get(key, 0), int | float) for row in rows)}
    heads = tuple(Column(spoken_key(key), "number" if key in numeric else "text") for key in keys)
    return Table(
        heads, tuple(tuple(leaf(row.get(key, "")) for key in keys) for row in rows), title=title
    )


def _are_alike_mappings(values: Sequence[Any]) -> bool:
    """Return whether these are mappings of plain values that share most of their keys."""
    if not values or not all(isinstance(value, Mapping) and value for value in values):
        return False
    if any(
        isinstance(item, Mapping | list | tuple) and item
        for value in values
        for item in value.values()
    ):
        return False
    keys = [set(value) for value in values]
    return len(set.intersection(*keys)) * 2 >= len(set.union(*keys))
