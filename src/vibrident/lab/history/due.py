"""Due date of a calibration: by the risk of being outside a tolerance, and by ILAC-G24."""

from __future__ import annotations

import datetime
import math
from dataclasses import dataclass

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.io.units import conversion
from vibrident.lab.history.life import DAYS_A_YEAR, Life

RISK = 0.05  # probability of being outside the tolerance at which a calibration is due
FARTHEST_YEARS = 20.0  # latest date considered, in years after the last calibration
#: Number of coarse dates at which the risk is computed; the date is refined between two of them.
_COARSE_DATES = 24
#: ILAC-G24 / OIML D 10, method 1: found within this part of the tolerance, the interval is
#: extended, else reduced.
STAIRCASE_PART = 0.8
STAIRCASE_LONGER = 1.25
STAIRCASE_SHORTER = 0.7


@dataclass(frozen=True)
class Tolerance:
    """Permitted deviation of a sensor from the value it is used with."""

    relative: float  # half width, relative to the nominal value
    nominal: float | None = None  # the value it is used with; None for that of its last calibration
    unit: str = ""  # of the nominal value; empty for that of the life

    def nominal_of(self, life: Life) -> float | None:
        """Return the nominal value, in the life's unit; None where it is not stated.

        Raises:
            InputError: it is in a unit that measures something else.
        """
        if self.nominal is None or not self.unit:
            return self.nominal
        unit = life.entries[-1].unit
        factor = conversion(self.unit, unit)
        if factor is None:
            raise InputError(
                "The limit is in a unit that measures something else.",
                expected=f"a unit of the calibrations, such as {unit}",
                found=self.unit,
                where="limits file",
                remedy="correct nominal and unit of the limit",
            )
        return self.nominal * factor

    def limits(self, life: Life) -> tuple[float, float]:
        """Return lower and upper limit, in the life's unit; errors as of :meth:`nominal_of`."""
        nominal = self.nominal_of(life)
        centre = nominal if nominal is not None else float(life.value[-1])
        return centre - self.relative * abs(centre), centre + self.relative * abs(centre)


@dataclass(frozen=True)
class Due:
    """Due date of a sensor, with its reasons."""

    # by the risk; None if that stays below ``RISK`` for ``FARTHEST_YEARS``, or for the reason in
    # ``why``
    date: datetime.date | None
    why: str  # reason if there is no date, such as a sensor that was recalled; else empty
    risk_today: float | None  # probability of being outside the tolerance today
    risk_at_end: float | None  # at the end of the interval in force
    interval_years: float  # the interval in force
    by_interval: datetime.date  # date by that
    # interval by ILAC-G24's staircase; None with fewer than two dates in the series
    staircase_years: float | None
    by_staircase: datetime.date | None  # date by that


def due(
    life: Life, tolerance: Tolerance, interval_years: float | None, today: datetime.date
) -> Due:
    """Return when the next calibration is due, for a life with at least one.

    ``interval_years``: in force; None for the time between the last two calibrations, a year if
    there is only one.
    """
    last = life.entries[-1].date
    force = interval_years or interval_in_force(life)
    by_interval = later(last, force)
    stairs = staircase(life, tolerance, force)
    by_stairs = None if stairs is None else later(last, stairs)
    if why := life.recalled or life.without_drift:
        return Due(None, why, None, None, force, by_interval, stairs, by_stairs)
    now, end = (risk(life, tolerance, date) for date in (max(today, last), by_interval))
    by_risk = _first_date(life, tolerance)
    why = (
        ""
        if by_risk is not None
        else f"the risk stays below {100 * RISK:g} % for {FARTHEST_YEARS:g} years"
    )
    return Due(by_risk, why, now, end, force, by_interval, stairs, by_stairs)


def risk(life: Life, tolerance: Tolerance, date: datetime.date) -> float:
    """Return the probability that the sensor is outside the tolerance at a date."""
    assert life.drift is not None
    at = np.array([life.years[-1] + (date - life.entries[-1].date).days / DAYS_A_YEAR])
    return float(life.drift.outside(at, *tolerance.limits(life))[0])


def _first_date(life: Life, tolerance: Tolerance) -> datetime.date | None:
    """Return the first date at which the risk reaches its limit, or None.

    It is the day of the calibration if the limit is reached already.
    """
    assert life.drift is not None
    dates = np.concatenate([[0.0], np.geomspace(1 / 24, FARTHEST_YEARS, _COARSE_DATES)])
    limits = tolerance.limits(life)
    while True:
        is_outside = life.drift.outside(life.years[-1] + dates, *limits) >= RISK
        if not is_outside.any():
            return None
        first = int(np.argmax(is_outside))
        if first == 0 or dates[first] - dates[first - 1] < 0.5 / DAYS_A_YEAR:
            return later(life.entries[-1].date, float(dates[first]))
        dates = np.linspace(dates[first - 1], dates[first], _COARSE_DATES)


def interval_in_force(life: Life) -> float:
    """Return the time between the last two dates of calibration, to a tenth of a year.

    It is a year where there is only one date.
    """
    gaps = np.diff(np.unique(life.years))
    return max(round(float(gaps[-1]), 1), 0.1) if gaps.size else 1.0


def staircase(life: Life, tolerance: Tolerance, interval_years: float) -> float | None:
    """Return the next interval by ILAC-G24's staircase, or None.

    It follows from the deviation of the sensor from the value it was used with.
    """
    before = np.flatnonzero((life.years < life.years[-1]) & (life.group == life.group[-1]))
    if not before.size:
        return None
    nominal = tolerance.nominal_of(life)
    used = nominal if nominal is not None else float(life.value[before[-1]])
    deviation = abs(float(life.value[-1]) / used - 1.0) if used else math.inf
    factor = (
        STAIRCASE_LONGER if deviation <= STAIRCASE_PART * tolerance.relative else STAIRCASE_SHORTER
    )
    return factor * interval_years


def later(date: datetime.date, years: float) -> datetime.date:
    """Return a date so many years later, at most the last one that Python can represent."""
    days = min(round(years * DAYS_A_YEAR), (datetime.date.max - date).days)
    return date + datetime.timedelta(days=days)
