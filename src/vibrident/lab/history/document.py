"""Documents of ``history show`` and ``history due`` as plain values."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.base.errors import InputError
from vibrident.base.fields import Fields, NamedNumbers
from vibrident.data.records import FloatArray
from vibrident.lab.history import control, query, schema
from vibrident.lab.history.drift import Mixture
from vibrident.lab.history.due import RISK, Tolerance, due, interval_in_force, later
from vibrident.lab.history.life import Entry, Life, covariance, life, years_between
from vibrident.lab.history.query import StoredSensor
from vibrident.lab.history.schema import REFERENCE_SENSITIVITY
from vibrident.lab.history.store import Store
from vibrident.result import Result
from vibrident.result.document import plain
from vibrident.use.comparison import COVERAGE_FACTOR as K

SCHEMA = "vibrident.history/1"
#: Number of dates at which a figure shows the prediction, from the last calibration on.
_CURVE = 25


@dataclass(frozen=True)
class Question:
    """Question to a history."""

    # name of a parameter, or the sensitivity at the reference frequency
    quantity: str = REFERENCE_SENSITIVITY
    # nominal frequency, for the sensitivity there instead of that at the reference frequency
    frequency_hz: float | None = None
    until: datetime.date | None = None  # to predict for; None for the end of the interval in force
    # of each sensor; None for no due date
    tolerance: Callable[[StoredSensor], Tolerance | None] = lambda _: None
    # in force; None for the time between the last two calibrations
    interval_years: float | None = None
    today: datetime.date | None = None  # the date that counts as today


def of_sensor(store: Store, sensor: StoredSensor, question: Question = Question()) -> Fields:
    """Return the document of one sensor.

    Raises:
        InputError: no calibration of the sensor has the quantity.
    """
    entries = query.entries(store, sensor.id, question.quantity, question.frequency_hz).get(
        sensor.id, []
    )
    if all(entry.value is None for entry in entries):
        raise _no_such_quantity(store, sensor, question)
    history = _life(store, sensor, entries)
    document = {
        "schema": SCHEMA,
        "store": store.printed,
        "sensor": sensor.as_dict(),
        "quantity": _quantity(history, question.quantity),
        "calibrations": _calibrations(history),
        "events": history.events,
        "series": _series(history),
        "drift": _drift(history, question) if history.entries else {"why": "no calibration counts"},
        "control": _control(history),
        "due": _due(history, sensor, question),
    }
    return plain(document)


def _life(store: Store, sensor: StoredSensor, entries: Sequence[Entry]) -> Life:
    """Return the life of a sensor by these calibrations and its events."""
    return life(entries, query.events(store, sensor.id).get(sensor.id, []))


def of_result(store: Store, result: Result) -> Fields | None:
    """Return the document of the sensor of a result.

    None if there is no store or it holds no calibration of this sensor.
    """
    sensor = query.stored_sensor(store, result.sensor)
    return None if sensor is None else of_sensor(store, sensor)


def random_walks(store: Store, result: Result) -> NamedNumbers:
    """Return parameter → its relative random walk in a year, for those that the store knows."""
    sensor = query.stored_sensor(store, result.sensor)
    walks = dict[str, float]()
    if sensor is None:
        return walks
    for name in result.parameters:
        entries = query.entries(store, sensor.id, name).get(sensor.id, [])
        drift = _life(store, sensor, entries).drift if entries else None
        if drift is not None:
            walks[name] = drift.wandering() / abs(result.parameters[name].value)
    return walks


def _no_such_quantity(store: Store, sensor: StoredSensor, question: Question) -> InputError:
    at = question.frequency_hz
    column = schema.parameter.c.name if at is None else schema.point.c.nominal_hz
    stored_values = query.known_values(store, sensor.id, column)
    return InputError(
        "No calibration of this sensor has such a quantity.",
        expected=", ".join(value if at is None else f"{value:g}" for value in stored_values),
        found=question.quantity if at is None else f"{at:g} Hz",
        where=sensor.name,
        remedy=(
            "give one of these as "
            f"{'⟦history.quantity⟧' if at is None else '⟦history.frequency_hz⟧'}"
        ),
    )


def all_due(
    store: Store, question: Question, type_name: str | None = None, sensor_id: int | None = None
) -> list[Fields]:
    """Return the due dates of the sensors that have the quantity, the earliest first.

    Args:
        store: the store.
        question: to each history.
        type_name: of the sensors; None: of all types.
        sensor_id: of one sensor; None: all.
    """
    events = query.events(store, sensor_id)
    sensors = {
        overview.sensor.id: overview.sensor for overview in query.overviews(store, type_name)
    }
    rows = []
    for key, entries in query.entries(
        store, sensor_id, question.quantity, question.frequency_hz
    ).items():
        if key not in sensors or all(entry.value is None for entry in entries):
            continue
        history = life(entries, events.get(key, []))
        due_values = _due(history, sensors[key], question) or _without_risk(history, question)
        last = history.entries[-1].date if history.entries else None
        recalled = history.recalled if history.entries else ""
        facts = {"last": last, "calibrations": len(history.entries), "recalled": recalled}
        rows.append(plain(sensors[key].as_dict() | facts | due_values))
    return sorted(rows, key=lambda row: (_first_due(row), row["serial_number"]))


def _first_due(row: Fields) -> str:
    """Return the earlier of the dates by the risk and by the interval in force.

    It is a late date if there is neither. A sensor that was recalled is not due.
    """
    dates = [row["date"], None if row["recalled"] else row["by_interval"]]
    return min((date for date in dates if date), default="9999-12-32")


def _without_risk(history: Life, question: Question) -> Fields:
    """Return the due date without a tolerance: that of the interval in force.

    There is none if no calibration counts.
    """
    unknown = dict.fromkeys(
        ("date", "risk_today", "risk_at_end", "staircase_years", "by_staircase")
    )
    why = "no calibration counts"
    interval = by_interval = None
    if history.entries:
        why = "no tolerance for its type"
        interval = question.interval_years or interval_in_force(history)
        by_interval = later(history.entries[-1].date, interval)
    return unknown | {"why": why, "interval_years": interval, "by_interval": by_interval}


def _quantity(history: Life, name: str) -> Fields:
    entries = history.entries or [entry for entry, _ in history.left_out if entry.value is not None]
    present = entries[-1]
    return {
        "name": name,
        "unit": present.unit,
        "frequency_hz": present.frequency_hz,
        "coverage_factor": K,
    }


def _calibrations(history: Life) -> list[Fields]:
    counted = {entry.id: i for i, entry in enumerate(history.entries)}
    reasons = {entry.id: reason for entry, reason in history.left_out}
    entries = sorted(
        [*history.entries, *(entry for entry, _ in history.left_out)], key=lambda e: (e.date, e.id)
    )
    rows = []
    for entry in entries:
        number = counted.get(entry.id)
        row = {
            "id": entry.id,
            "date": entry.date,
            "value": entry.value,
            "u": entry.u,
            "U": None if entry.u is None else K * entry.u,
            "u_own": entry.u_own,
            "unit": entry.unit,
            "standing": entry.standing or "added",
            "shared": entry.shared,
            **entry.facts,
            "counts": number is not None,
            "left_out": reasons.get(entry.id, ""),
            "series": None if number is None else int(history.group[number]) + 1,
            "en": history.agreement(number) if number else None,
        }
        rows.append(row)
    return rows


def _series(history: Life) -> list[Fields]:
    starts = [(0, "the first calibration"), *((item.index, item.why) for item in history.breaks)]
    return [
        {"series": number, "from": history.entries[index].date, "why": why}
        for number, (index, why) in enumerate(starts, 1)
        if history.entries
    ]


def _drift(history: Life, question: Question) -> Fields:
    drift = history.drift
    if drift is None:
        return {"why": history.without_drift}
    interval = question.interval_years or interval_in_force(history)
    last = history.entries[-1]
    until = question.until or later(last.date, interval)
    if until < last.date:
        raise InputError(
            "The date to predict for lies before the last calibration.",
            expected=f"a date from {last.date} on",
            found=str(until),
            where="⟦history.until⟧",
            remedy="give a later date",
        )
    rate = drift.rate()
    size = abs(float(history.value[-1])) or 1.0
    # of a calibration of the same quality as the last one, with the same reference
    shared = np.array([covariance(entry, last._replace(id=-1)) for entry in history.entries])
    reading = drift.reading(_year(history, until), shared, float(last.u or 0.0))
    return {
        "why": "",
        "rate_per_year": _mixture(rate)
        | {"relative": rate.value / size, "relative_u": rate.u / size},
        "random_walk_per_root_year": drift.wandering(),
        "probability": drift.probability,
        "prediction": {"date": until}
        | _mixture(_sensitivity_at(history, until))
        | {"reading": _mixture(reading)},
        "curve": _curve(history, until),
    }


def _sensitivity_at(history: Life, date: datetime.date) -> Mixture:
    assert history.drift is not None
    return history.drift.sensitivity(_year(history, date))


def _year(history: Life, date: datetime.date) -> float:
    return years_between(history.entries[0].date, date)


def _curve(history: Life, until: datetime.date) -> list[Fields]:
    """Return the prediction from the last calibration on."""
    first = history.entries[-1].date.toordinal()
    days = sorted({round(day) for day in np.linspace(first, until.toordinal(), _CURVE)})
    return [
        {"date": date} | _mixture(_sensitivity_at(history, date))
        for date in map(datetime.date.fromordinal, days)
    ]


def _mixture(mixture: Mixture) -> Fields:
    values = {"value": mixture.value, "u": mixture.u, "U": K * mixture.u}
    return values | {"interval_95": mixture.interval_95}


def _control(history: Life) -> Fields | None:
    """Return both charts over all series; each series restarts them.

    ``if_new``: dates of alarms where a source that no instrument identifies is new each time; None
    where there is none.
    """
    residuals, restart, indices = _residuals(history, history.covariance)
    if not residuals:
        return None
    dates = [history.entries[i].date for i in indices]
    charts = control.charts(np.array(residuals), np.array(restart))
    unassumed: Sequence[control.ControlChart | None] = [None] * len(charts)
    if history.assumed:
        anew, *_ = _residuals(history, history.identified_covariance)
        unassumed = control.charts(np.array(anew), np.array(restart))
    return {
        "false_alarm_probability": control.FALSE_ALARM,
        "false_alarm_over": control.LIFE,
        "dates": dates,
        "residuals": residuals,
        "assumed": history.assumed,
        "charts": [
            vars(chart)
            | {"alarm_dates": [dates[i] for i in chart.alarm]}
            | {"if_new": None if if_new is None else [dates[i] for i in if_new.alarm]}
            for chart, if_new in zip(charts, unassumed, strict=True)
        ],
    }


def _residuals(history: Life, covariance: FloatArray) -> tuple[list[float], list[bool], list[int]]:
    """Return recursive residuals, where a series restarts, and the places of the calibrations."""
    residuals = []
    restart = []
    indices = []
    for number in np.unique(history.group):
        group_indices = np.flatnonzero(history.group == number)
        if group_indices.size > 1:
            block = np.ix_(group_indices, group_indices)
            residuals += control.recursive_residuals(
                history.value[group_indices], covariance[block]
            ).tolist()
            restart += [True] + [False] * (group_indices.size - 2)
            indices += group_indices[1:].tolist()
    return residuals, restart, indices


def _due(history: Life, sensor: StoredSensor, question: Question) -> Fields | None:
    tolerance = question.tolerance(sensor)
    if tolerance is None or not history.entries:
        return None
    today = question.today or datetime.date.today()
    dates = due(history, tolerance, question.interval_years, today)
    limits = tolerance.limits(history)
    return vars(dates) | {"risk": RISK, "limits": limits, "tolerance": tolerance.relative}


def listed(store: Store, type_name: str | None = None) -> list[Fields]:
    """Return the sensors of a store, or of a type."""
    return [
        plain(sensor.as_dict() | {"calibrations": times, "first": first, "last": last})
        for sensor, times, first, last in query.overviews(store, type_name)
    ]
