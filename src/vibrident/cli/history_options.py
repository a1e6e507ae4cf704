"""Options of the history command as values: dates, tolerances, and what is asked."""

from __future__ import annotations

import datetime
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from vibrident.cli.options import not_read
from vibrident.errors import InputError

if TYPE_CHECKING:
    from vibrident.history.document import Question
    from vibrident.history.due import Tolerance
    from vibrident.history.query import StoredSensor


def read_date(text: str | None, option: str) -> datetime.date | None:
    """A date of an option.

    Raises:
        InputError: the text cannot be read.
    """
    if text is None:
        return None
    try:
        return datetime.date.fromisoformat(text)
    except ValueError:
        raise not_read(option, text, "a date such as 2025-03-31", "write year, month and day") from None


def read_tolerance(text: str | None, nominal: float | None) -> Tolerance | None:
    """A tolerance such as 1% or 0.01.

    Raises:
        InputError: the text cannot be read, or the nominal value cannot be used.
    """
    if nominal is not None and (not math.isfinite(nominal) or nominal == 0):
        raise InputError(
            "A tolerance is relative to the nominal value, which cannot be 0.",
            expected="a finite number other than 0, in the quantity's unit",
            found=f"{nominal:g}",
            where="--nominal",
            remedy="give the value that the sensor is used with, or leave --nominal out",
        )
    if text is None:
        return None
    from vibrident.history.due import Tolerance

    try:
        percent = text.strip().endswith("%")
        value = float(text.strip().removesuffix("%")) * (0.01 if percent else 1.0)
    except ValueError:
        value = 0.0
    if not 0 < value < 1:
        remedy = "give a number between 0 and 100 with %, or between 0 and 1"
        raise not_read("--tolerance", text, "a part of the value, such as 1% or 0.01", remedy)
    return Tolerance(value, nominal)


def question(
    quantity: str | None,
    frequency: float | None,
    tolerance: Tolerance | None,
    limits: Path | None,
    interval: float | None,
    until: datetime.date | None = None,
) -> Question:
    """What is asked of a history.

    Raises:
        InputError: two quantities are asked for, or the limits cannot be used.
    """
    if quantity is not None and frequency is not None:
        raise InputError(
            "Two quantities are asked for.",
            expected="a parameter, or the sensitivity at a frequency",
            found="both",
            where="--quantity, --frequency",
            remedy="give one of the two",
        )
    from vibrident.history.document import Question

    asked = Question(frequency_hz=frequency, until=until, tolerance=tolerance, interval_years=interval)
    asked = asked if quantity is None else replace(asked, quantity=quantity)
    return asked if limits is None else replace(asked, tolerances=_by_type(limits, asked))


def _by_type(limits: Path, asked: Question) -> Callable[[StoredSensor], Tolerance | None]:
    """The tolerance of a sensor, from a limits file; of the reference sensitivity as of the sensitivity."""
    from vibrident.fleet.limits import read_limits
    from vibrident.history.due import Tolerance

    known = read_limits(limits)
    name = "sensitivity" if asked.quantity == "reference_sensitivity" else asked.quantity

    def tolerance(sensor: StoredSensor) -> Tolerance | None:
        limit = known.limit(sensor.type or None, name)
        if limit is None or not limit.nominal or asked.frequency_hz is not None:
            return None
        return Tolerance(limit.half_width / abs(limit.nominal), limit.nominal)

    return tolerance
