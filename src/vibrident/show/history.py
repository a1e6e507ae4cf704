"""Show one sensor over time: results by date, with the drift of each quantity and its E_n."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.result import Result
from vibrident.show import axes
from vibrident.show.comparison import (
    ComparedQuantity,
    assumed,
    assumption,
    difference,
    error,
    quantities,
    value_texts,
)
from vibrident.show.formulas import Words
from vibrident.show.numbers import NONE, sensor_name, with_sign
from vibrident.show.views import (
    GREY,
    MEASURED,
    Figure,
    FloatArray,
    Look,
    Panel,
    Series,
    Stack,
    Table,
    columns,
)
from vibrident.use.comparison import not_comparable

#: Derived quantities say nothing that the estimated ones do not.
_DERIVED = (
    *("natural angular frequency", "free period"),
    *("resonance frequency", "conversion coefficient"),
)


@dataclass(frozen=True)
class SensorHistory:
    """Calibrations of one sensor in the order of their dates."""

    sensor: str  # one line
    dates: tuple[datetime.date, ...]  # of each calibration
    # of each calibration: its date, and its name where a date is there twice
    labels: tuple[str, ...]
    results: tuple[Result, ...]  # in the same order
    # that all or some of the results have, the sensitivity at the reference frequency first
    quantities: tuple[ComparedQuantity, ...]
    # a date is that of the evaluation, because no date of the calibration is stated
    evaluated: bool


def histories(results: Sequence[Result], names: Sequence[str]) -> tuple[SensorHistory, ...]:
    """Return a history of each serial number that has results of at least two dates."""
    groups: dict[tuple[str, ...], list[tuple[datetime.date, str, Result]]] = {}
    for result, name in zip(results, names, strict=True):
        kind = tuple(
            str(result.sensor.get(key) or "") for key in ("serial_number", "manufacturer", "type")
        )
        date = date_of(result)
        if kind[0] and date is not None:
            groups.setdefault(kind, []).append((date, name, result))
    found_histories = []
    for entries in groups.values():
        entries.sort(key=lambda entry: entry[0])
        dates = tuple(entry[0] for entry in entries)
        if len(set(dates)) > 1:
            found_histories.append(_history(entries, dates))
    return tuple(found_histories)


def _history(
    entries: Sequence[tuple[datetime.date, str, Result]], dates: tuple[datetime.date, ...]
) -> SensorHistory:
    results = tuple(result for _, _, result in entries)
    quantities_shown = tuple(
        q for q in quantities(results) if q.label not in _DERIVED and q.values[0] is not None
    )
    labels = tuple(
        f"{day}{f' ({name})' if dates.count(day) > 1 else ''}" for day, name, _ in entries
    )
    evaluated = any(not result.certificate.get("date_of_calibration") for result in results)
    return SensorHistory(
        sensor_name(results[0].sensor), dates, labels, results, quantities_shown, evaluated
    )


def date_of(result: Result) -> datetime.date | None:
    """Return the stated date of calibration, else that of the evaluation; None if unreadable."""
    stated_date = result.certificate.get("date_of_calibration")
    try:
        return datetime.date.fromisoformat(
            str(result.provenance.get("time") if stated_date is None else stated_date)[:10]
        )
    except ValueError:
        return None


def drift(history: SensorHistory, name: str) -> Figure:
    """Change of each quantity from the first date, in percent where it can be, with U (k = 2)."""
    days = np.array([float(date.toordinal()) for date in history.dates])
    x = axes.dates("Date", history.dates)
    panels = []
    for quantity in history.quantities:
        change, half, unit = changes(quantity)
        texts = tuple(
            f"{label}: {with_sign(f'{value:.3g}')} {unit}"
            for label, value in zip(history.labels, change, strict=True)
        )
        bars = half if np.isfinite(half).any() else None
        series = (
            Series(days, change, "", Look(GREY, "dotted", 1.0)),
            Series(days, change, "", MEASURED, "points", bars, texts=texts),
        )
        ends = np.concatenate([change - np.nan_to_num(half), change + np.nan_to_num(half), [0.0]])
        y = axes.linear(f"Change\nin {unit}", ends, most=4)
        panels.append(Panel(x, y, series, 0.95, quantity.label, rules=(0.0,)))
    caption = Words(
        "Change from the first date; bars: U (k = 2). Calibrations agree where E_n is within ±1."
    )
    return Figure(name, f"Drift of {history.sensor}", (Stack(tuple(panels)),), "", caption)


def changes(quantity: ComparedQuantity) -> tuple[FloatArray, FloatArray, str]:
    """Return changes from the first value, U of each value, and their unit: % if possible."""
    pairs = [(None, None) if v is None else (v.value, v.expanded) for v in quantity.values]
    value, expanded = np.array(pairs, dtype=float).T
    if quantity.relative and value[0]:
        return 100.0 * (value / value[0] - 1.0), 100.0 * expanded / abs(value[0]), "%"
    return (
        (value - value[0]) * quantity.scale.factor,
        expanded * quantity.scale.factor,
        quantity.scale.unit,
    )


def drift_table(history: SensorHistory) -> Table:
    """Return each quantity by date, its change from the first, and E_n to first and previous."""
    rows = []
    for quantity in history.quantities:
        unit = quantity.scale.printed
        for i, (label, value) in enumerate(zip(history.labels, quantity.values, strict=True)):
            first = quantity.values[0]
            assumption_text = (label, *value_texts(value, quantity.scale.factor))
            if i == 0:
                rows.append((quantity.label, unit, *assumption_text, "", "", ""))
                continue
            change = "" if first is None else difference(value, first, quantity)
            rows.append(
                (
                    "",
                    "",
                    *assumption_text,
                    change,
                    _en(history, quantity, i, 0),
                    _en(history, quantity, i, i - 1),
                )
            )
    notes = [
        Words(
            "Change is from the first date; E_n to the first date and to the date before, with U "
            "(k = 2): |E_n| > 1 is a change that the uncertainties do not explain. Stated sources "
            "that both share, such as the same reference, are no part of U of the difference."
        )
    ]
    if assumption_text := assumption(assumed(history.quantities)):
        notes.append(assumption_text)
    if history.evaluated:
        notes.append(
            Words("Where no date of calibration is stated, the date is that of the evaluation.")
        )
    heads = columns(
        "value", "U", "change", Words("E_n to first"), Words("E_n to previous"), kind="number"
    )
    return Table((*columns("quantity", "unit", "date"), *heads), tuple(rows), notes=tuple(notes))


def _en(history: SensorHistory, quantity: ComparedQuantity, i: int, base: int) -> str:
    reference = quantity.values[base]
    if reference is None:
        return NONE
    return not_comparable(history.results[base], history.results[i]) or error(
        quantity.values[i], reference
    )
