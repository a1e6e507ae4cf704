"""One sensor over time: results of the same serial number by date, with the drift of each quantity and its E_n."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass

from vibrident.comparison import not_comparable
from vibrident.plots.units import sensor_name
from vibrident.report.numbers import NONE
from vibrident.report.side_by_side import Quantity, Value, difference, error, printed_value, quantities
from vibrident.report.tables import Table
from vibrident.result import Result

#: Derived quantities say nothing that the estimated ones do not.
_DERIVED = ("natural angular frequency", "resonance frequency", "conversion coefficient")


@dataclass(frozen=True)
class History:
    """Calibrations of one sensor in the order of their dates.

    Attributes:
        sensor: one line.
        dates: of each calibration.
        labels: of each calibration: its date, and its name where a date is there twice.
        results: in the same order.
        quantities: that all or some of the results have, the sensitivity at the reference frequency first.
        evaluated: a date is that of the evaluation, because none of the calibration is stated.
    """

    sensor: str
    dates: tuple[datetime.date, ...]
    labels: tuple[str, ...]
    results: tuple[Result, ...]
    quantities: tuple[Quantity, ...]
    evaluated: bool


def histories(results: Sequence[Result], names: Sequence[str]) -> tuple[History, ...]:
    """A history of each serial number that has results of at least two dates."""
    groups: dict[tuple[str, ...], list[tuple[datetime.date, str, Result]]] = {}
    for result, name in zip(results, names, strict=True):
        serial, date = str(result.sensor.get("serial_number") or ""), date_of(result)
        if serial and date is not None:
            kind = (serial, *(str(result.sensor.get(key) or "") for key in ("manufacturer", "type")))
            groups.setdefault(kind, []).append((date, name, result))
    found = []
    for entries in groups.values():
        entries.sort(key=lambda entry: entry[0])
        dates = tuple(entry[0] for entry in entries)
        if len(set(dates)) > 1:
            found.append(_history(entries, dates))
    return tuple(found)


def _history(entries: Sequence[tuple[datetime.date, str, Result]], dates: tuple[datetime.date, ...]) -> History:
    results = tuple(result for _, _, result in entries)
    shown = tuple(q for q in quantities(results) if q.label not in _DERIVED and q.values[0] is not None)
    labels = tuple(f"{day}{f' ({name})' if dates.count(day) > 1 else ''}" for day, name, _ in entries)
    evaluated = any(not result.certificate.get("date_of_calibration") for result in results)
    return History(sensor_name(results[0].sensor), dates, labels, results, shown, evaluated)


def date_of(result: Result) -> datetime.date | None:
    """Date of calibration as stated, else of the evaluation; None where neither can be read."""
    for text in (result.certificate.get("date_of_calibration"), result.provenance.get("time")):
        try:
            return datetime.date.fromisoformat(str(text)[:10])
        except ValueError:
            continue
    return None


def drift_table(history: History) -> Table:
    """Each quantity at each date, its change from the first date, and E_n to the first and to the one before."""
    rows = []
    for quantity in history.quantities:
        unit = "" if quantity.scale.unit == "1" else quantity.scale.unit
        for i, (label, value) in enumerate(zip(history.labels, quantity.values, strict=True)):
            first, before = _base(quantity, 0), _base(quantity, i - 1)
            rows.append(
                (
                    quantity.label if i == 0 else "",
                    unit if i == 0 else "",
                    label,
                    *printed_value(value, quantity.scale.factor),
                    difference(value, first, quantity) if i and first is not None else "",
                    _en(history, quantity, i, 0) if i else "",
                    _en(history, quantity, i, i - 1) if i and before is not None else NONE if i else "",
                )
            )
    notes = [
        "Change is from the first date; E_n to the first date and to the date before, with U (k = 2): |E_n| > 1 is a "
        "change that the uncertainties do not explain, as far as the calibrations are independent."
    ]
    if history.evaluated:
        notes.append("Where no date of calibration is stated, the date is that of the evaluation.")
    header = ("quantity", "unit", "date", "value", "U", "change", "E_n to first", "E_n to previous")
    return Table(header, tuple(rows), (3, 4, 5, 6, 7), notes=tuple(notes))


def _base(quantity: Quantity, i: int) -> Value | None:
    return quantity.values[i] if i >= 0 else None


def _en(history: History, quantity: Quantity, i: int, base: int) -> str:
    reference = quantity.values[base]
    if reference is None:
        return NONE
    return not_comparable(history.results[base], history.results[i]) or error(quantity.values[i], reference)
