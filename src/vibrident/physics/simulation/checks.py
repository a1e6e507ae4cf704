"""Checks of the simulator's settings."""

from __future__ import annotations

import math

from vibrident.base.errors import InputError, unknown


def require(condition: bool, problem: str, **message: str) -> None:
    """Raise InputError unless ``condition`` holds.

    ``message``: its ``expected``, ``found``, ``where`` and ``remedy``.
    """
    if not condition:
        raise InputError(problem, **message)


def require_usable(usable: bool, name: str, value: object, expected: str, where: str) -> None:
    """Raise InputError unless the setting ``name`` has a usable value."""
    require(
        usable,
        f"{name} is not usable.",
        expected=expected,
        found=repr(value),
        where=where,
        remedy=f"correct {name}",
    )


def require_positive(where: str, **values: float) -> None:
    """Raise InputError unless every value is a finite number above zero."""
    for name, value in values.items():
        require_usable(
            math.isfinite(value) and value > 0, name, value, "a finite number above 0", where
        )


def require_not_negative(where: str, **values: float) -> None:
    """Raise InputError unless every value is a finite number, zero or above."""
    for name, value in values.items():
        require_usable(
            math.isfinite(value) and value >= 0, name, value, "a finite number, 0 or above", where
        )


def require_finite(where: str, **values: float) -> None:
    """Raise InputError unless every value is a finite number."""
    for name, value in values.items():
        require_usable(math.isfinite(value), name, value, "a finite number", where)


def require_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    """Raise InputError unless ``value`` is one of ``choices``."""
    if value not in choices:
        raise unknown(f"{name} is not known.", value, choices, "simulate")
