"""Tables, lists and sentences of a history, from its document alone."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence

from vibrident.base.amounts import UnitScale, scaled
from vibrident.base.fields import GivenFields
from vibrident.physics.naming import in_words
from vibrident.show.comparison import assumption, both_ways
from vibrident.show.formulas import Words
from vibrident.show.numbers import NONE, frequency_text, pair, plain, signed
from vibrident.show.views import Column, Facts, Sentence, Table, columns
from vibrident.use.comparison import COVERAGE_FACTOR as K


def quantity_name(document: GivenFields) -> str:
    """Return the quantity in words, with its frequency."""
    quantity = document["quantity"]
    if quantity["frequency_hz"] is None:
        return in_words(quantity["name"])
    return f"sensitivity at {frequency_text(quantity['frequency_hz'])}"


def scale_of(document: GivenFields) -> UnitScale:
    """Return the scale from the quantity's unit to one with a suitable prefix."""
    unit = document["quantity"]["unit"]
    sizes = [
        abs(row["value"])
        for row in document["calibrations"]
        if row["unit"] == unit and row["value"]
    ]
    return scaled(unit, sizes[-1] if sizes else 0.0)


def calibrations(document: GivenFields) -> Table:
    """Return a table of all calibrations with U and E_n to the one before.

    Calibrations that are not valid stand with the reason.
    """
    scale = scale_of(document)
    rows = []
    for row in document["calibrations"]:
        comparable = row["unit"] == document["quantity"]["unit"]
        sizes = (scale.times(row["value"]), scale.times(row["U"])) if comparable else (None, None)
        en = row["en"]
        rows.append(
            (
                str(row["id"]),
                row["date"] + ("" if row["date_stated"] else " (evaluated)"),
                *pair(*sizes),
                "" if row["series"] is None else str(row["series"]),
                both_ways(en["correlated"], en["identified"]) if en else "",
                signed(en["ordinary"], 2) if en else "",
                row["left_out"] if row["left_out"] not in ("", row["standing"]) else "",
                row["standing"],
                ", ".join(row["warnings"]) or "none",
            )
        )
    heads = (
        Column("id", "number"),
        Column("date"),
        Column("value", "number", scale.printed),
        *columns("U", "series", Words("E_n"), Words("ordinary E_n"), kind="number"),
        *columns("left out", "standing", "warnings"),
    )
    notes = [
        Words(
            "U has k = 2. E_n is to the calibration before, with U of the difference: what both "
            "share (the same reference, the same stated source) is no part of it. Ordinary E_n "
            "takes them as independent, and is too small where they are not. |E_n| > 1 is a "
            "change that the uncertainties do not explain."
        ),
    ]
    agreements = [row["en"] for row in document["calibrations"] if row["en"]]
    notes += [assumption(list(itertools.chain.from_iterable(en["assumed"] for en in agreements)))]
    return Table(heads, tuple(rows), notes=tuple(filter(None, notes))).telling()


def chart(document: GivenFields, width: int = 54) -> Facts | None:
    """Return the values as text, by date; None for a single value.

    A bar shows the unshared part of U, and the last line the prediction.
    """
    rows = [
        (row["date"], row["value"], K * (row["u_own"] or row["u"]))
        for row in document["calibrations"]
        if row["counts"]
    ]
    if len(rows) < 2:
        return None
    if not document["drift"]["why"]:
        ahead = document["drift"]["prediction"]
        rows.append((f"{ahead['date']} expected", ahead["reading"]["value"], ahead["reading"]["U"]))
    low = min(value - half for _, value, half in rows)
    high = max(value + half for _, value, half in rows)

    def column_of(value: float) -> int:
        return round((width - 1) * (value - low) / (high - low)) if high > low else 0

    lines = []
    for date, value, half in rows:
        start = column_of(value - half)
        centre = column_of(value)
        end = column_of(value + half)
        bar = ["─" if start <= i <= end else " " for i in range(width)]
        bar[start] = "├"
        bar[end] = "┤"
        bar[centre] = "●"
        lines.append((date, "".join(bar).rstrip()))
    return Facts(tuple(lines), "Each with the part of U that it does not share")


def series(document: GivenFields) -> list[Sentence]:
    """Return a sentence for each series after the first."""
    rows = document["series"][1:]
    return [
        Sentence(f"Series {row['series']} begins on {row['from']}: {row['why']}.") for row in rows
    ]


def drift(document: GivenFields) -> Facts:
    """Return the drift, and the prediction."""
    values = document["drift"]
    scale = scale_of(document)
    if values["why"]:
        return Facts((("drift", f"not known: {values['why']}"),), "Drift")
    rate = values["rate_per_year"]
    prediction = values["prediction"]
    percent = "; ({} ± {}) %/a".format(*pair(100 * rate["relative"], 200 * rate["relative_u"]))
    likely = ", ".join(
        f"{name} {100 * share:.0f} %" for name, share in values["probability"].items()
    )
    rows = (
        ("steady drift, if there is one", f"{_with_u(rate, scale, '/a')}{percent}"),
        (
            "random walk, if it is one",
            f"{plain(values['random_walk_per_root_year'] * scale.factor, 2)} {scale.unit}/√a",
        ),
        ("probability", likely),
        (f"sensor on {prediction['date']}", _with_u(prediction, scale)),
        (
            f"calibration on {prediction['date']}",
            f"{_with_u(prediction['reading'], scale)}, by the same reference",
        ),
    )
    return Facts(rows, "Drift")


def _with_u(values: GivenFields, scale: UnitScale, per: str = "") -> str:
    value, expanded = pair(values["value"] * scale.factor, values["U"] * scale.factor)
    unit = f"{scale.printed}{per}" if scale.printed else per.replace("/", "1/")
    return f"({value} ± {expanded}) {unit}".rstrip()


def control(document: GivenFields) -> Facts | None:
    """Return the alarms of the control charts; None without charts."""
    values = document["control"]
    if values is None:
        return None
    over = (
        f"{100 * values['false_alarm_probability']:g} % over {values['false_alarm_over']} "
        "comparisons"
    )
    rows = []
    for chart in values["charts"]:
        length = f"mean {chart['average_run_length']:.0f} to a false alarm"
        alarms = _alarms(chart["alarm_dates"])
        rows.append((chart["name"], f"{alarms} (false alarms: {over}; {length})"))
        if chart["if_new"] not in (None, chart["alarm_dates"]):
            sources = ", ".join(values["assumed"])
            rows.append((f"{chart['name']}, if not the same: {sources}", _alarms(chart["if_new"])))
    return Facts(tuple(rows), "Control charts")


def _alarms(dates: Sequence[str]) -> str:
    return f"alarm on {', '.join(dates)}" if dates else "no alarm"


def due(document: GivenFields) -> Facts | None:
    """Return the due date; None where none was asked for."""
    values = document["due"]
    scale = scale_of(document)
    if values is None:
        return None
    low, high = (plain(limit * scale.factor, 6) for limit in values["limits"])
    rows = [
        ("tolerance", f"±{100 * values['tolerance']:g} %: {low} to {high} {scale.unit}"),
        (f"due by a risk of {100 * values['risk']:g} %", values["date"] or values["why"]),
        (
            "due by the interval in force",
            f"{values['by_interval']} ({values['interval_years']:g} a)",
        ),
    ]
    if values["by_staircase"]:
        rows.append(
            (
                "due by the staircase",
                f"{values['by_staircase']} ({values['staircase_years']:.3g} a)",
            )
        )
    if values["risk_today"] is not None:
        rows.append(("risk today", _percent(values["risk_today"])))
        rows.append((f"risk on {values['by_interval']}", _percent(values["risk_at_end"])))
    return Facts(tuple(rows), "Next calibration")


def _percent(value: float | None) -> str:
    if value is None:
        return NONE
    return (
        f"{100 * value:.2g} %"
        if 1e-4 <= value < 0.995
        else "100 %"
        if value >= 0.995
        else "below 0.01 %"
    )


def events(document: GivenFields) -> Table | None:
    """Return the events, except added calibrations."""
    rows = tuple(
        (
            event["date"],
            event["kind"],
            str(event["calibration_id"] or ""),
            event["by"],
            event["note"],
        )
        for event in document["events"]
        if event["kind"] != "added"
    )
    return Table(columns("date", "event", "calibration", "by", "note"), rows) if rows else None


def all_due(rows: Sequence[GivenFields]) -> Table:
    """Return the due dates of many sensors."""
    heads = columns("last", "due by risk", "by interval", "by staircase", "risk today")
    cells = (
        (
            row["last"] or NONE,
            row["date"] or row["why"],
            row["by_interval"] or NONE,
            row["by_staircase"] or NONE,
            _percent(row["risk_today"]),
        )
        for row in rows
    )
    return _sensors(rows, ("type",), heads, cells)


def listed(rows: Sequence[GivenFields]) -> Table:
    """Return the sensors of a store."""
    return _sensors(
        rows,
        ("type", "manufacturer"),
        columns("first", "last"),
        ((r["first"], r["last"]) for r in rows),
    )


def _sensors(
    rows: Sequence[GivenFields],
    keys: tuple[str, ...],
    heads: tuple[Column, ...],
    cells: Iterable[tuple[str, ...]],
) -> Table:
    """Return a table with a row a sensor: its names, number of calibrations, and further cells."""
    body = (
        (
            f"{row['serial_number']} {row.get('axis', '')}".rstrip(),
            *(row.get(key, "") for key in keys),
            str(row["calibrations"]),
            *more,
        )
        for row, more in zip(rows, cells, strict=True)
    )
    return Table(
        (*columns("serial number", *keys), Column("calibrations", "number"), *heads), tuple(body)
    )
