"""Read the options of ``vibrident history`` that state a date, a tolerance or a question."""

from __future__ import annotations

import datetime
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from vibrident.app.cli.options import unreadable_error
from vibrident.base.errors import InputError

if TYPE_CHECKING:
    from vibrident.lab.history.document import Question
    from vibrident.lab.history.due import Tolerance
    from vibrident.lab.history.query import StoredSensor
    from vibrident.lab.history.store import Store


def open_store(url: str | None) -> Store:
    """Open a history; None opens the default one."""
    from vibrident.lab.history.store import Store

    return Store(url)


def read_date(text: str | None, option: str) -> datetime.date | None:
    """Read a date such as 2025-03-31; None for none."""
    if text is None:
        return None
    try:
        return datetime.date.fromisoformat(text)
    except ValueError:
        raise unreadable_error(
            option, text, "a date such as 2025-03-31", "write year, month and day"
        ) from None


def read_tolerance(text: str | None, nominal: float | None) -> Tolerance | None:
    """Read a tolerance such as 1% or 0.01."""
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
    from vibrident.lab.history.due import Tolerance

    try:
        percent = text.strip().endswith("%")
        value = float(text.strip().removesuffix("%")) * (0.01 if percent else 1.0)
    except ValueError:
        value = 0.0
    if not 0 < value < 1:
        remedy = "give a number between 0 and 100 with %, or between 0 and 1"
        raise unreadable_error(
            "--tolerance", text, "a part of the value, such as 1% or 0.01", remedy
        )
    return Tolerance(value, nominal)


def build_question(
    quantity: str | None,
    frequency: float | None,
    tolerance: Tolerance | None,
    limits: Path | None,
    interval: float | None,
    until: datetime.date | None = None,
) -> Question:
    """Return the question about the history that the options state."""
    if quantity is not None and frequency is not None:
        raise InputError(
            "Two quantities are asked for.",
            expected="a parameter, or the sensitivity at a frequency",
            found="both",
            where="--quantity, --frequency",
            remedy="leave out --quantity or --frequency",
        )
    from vibrident.lab.history.document import Question
    from vibrident.lab.history.schema import REFERENCE_SENSITIVITY

    name = quantity or REFERENCE_SENSITIVITY
    of_type = None if limits is None else _tolerances_by_type(limits, name, frequency)
    return Question(name, frequency, until, of_type or (lambda _: tolerance), interval)


def _tolerances_by_type(
    limits: Path, quantity: str, frequency_hz: float | None
) -> Callable[[StoredSensor], Tolerance | None]:
    """Return a function from a sensor to its tolerance, from a limits file.

    The limits of the sensitivity hold for the reference sensitivity too.
    """
    from vibrident.lab.fleet.limits import read_limits
    from vibrident.lab.history.due import Tolerance

    specification = read_limits(limits)
    name = "sensitivity" if quantity == "reference_sensitivity" else quantity

    def tolerance(sensor: StoredSensor) -> Tolerance | None:
        limit = specification.limit(sensor.type or None, name)
        if limit is None or not limit.nominal or frequency_hz is not None:
            return None
        relative = limit.half_width / abs(limit.nominal)
        return Tolerance(relative, limit.nominal, limit.unit or "")

    return tolerance
