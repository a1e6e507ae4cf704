"""Checks of the simulator's settings."""

from __future__ import annotations

import math

from vibrident.errors import InputError


def require(condition: bool, problem: str, *, expected: str, found: object, where: str, remedy: str) -> None:
    """Raise InputError unless ``condition`` holds."""
    if not condition:
        raise InputError(problem, expected=expected, found=str(found), where=where, remedy=remedy)


def require_positive(where: str, **values: float) -> None:
    """Every value is a finite number above zero."""
    for name, value in values.items():
        require(
            math.isfinite(value) and value > 0,
            f"{name} is not usable.",
            expected="a finite number above 0",
            found=repr(value),
            where=where,
            remedy=f"correct {name}",
        )


def require_not_negative(where: str, **values: float) -> None:
    """Every value is a finite number, zero or above."""
    for name, value in values.items():
        require(
            math.isfinite(value) and value >= 0,
            f"{name} is not usable.",
            expected="a finite number, 0 or above",
            found=repr(value),
            where=where,
            remedy=f"correct {name}",
        )


def require_finite(where: str, **values: float) -> None:
    """Every value is a finite number."""
    for name, value in values.items():
        require(
            math.isfinite(value),
            f"{name} is not usable.",
            expected="a finite number",
            found=repr(value),
            where=where,
            remedy=f"correct {name}",
        )


def require_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    """``value`` is one of ``choices``."""
    require(
        value in choices,
        f"{name} is not known.",
        expected=" | ".join(choices),
        found=repr(value),
        where="simulate",
        remedy="name one of the expected",
    )
