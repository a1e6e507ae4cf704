"""Limits file: the limits of parameters, by type of sensor, and the verdict on values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pydantic import Field

from vibrident.base.errors import InputError, unknown
from vibrident.data.io.schema_errors import validated
from vibrident.data.io.sections import FileSection, Number, Positive
from vibrident.data.io.toml_text import read_toml
from vibrident.data.io.units import conversion
from vibrident.data.records import BoolArray, FloatArray
from vibrident.physics.naming import parameter_names

K = 2.0  # coverage factor of the uncertainty in a verdict


class Limit(FileSection):
    """Limit of a parameter, from an entry of ``[[limits]]``."""

    type: str | None = Field(
        default=None, min_length=1, description="a sensor's type in quotes, not empty"
    )
    parameter: str = Field(min_length=1, description="a parameter's name in quotes")
    nominal: Number
    tolerance: Positive | None = None
    tolerance_percent: Positive | None = None
    unit: str | None = Field(default=None, min_length=1, description="a unit in quotes, not empty")

    @property
    def half_width(self) -> float:
        """Return the tolerance in the unit of the parameter."""
        percent = self.tolerance_percent or 0.0
        return self.tolerance if self.tolerance is not None else abs(self.nominal) * percent / 100

    @property
    def lower(self) -> float:
        """Return the lower limit."""
        return self.nominal - self.half_width

    @property
    def upper(self) -> float:
        """Return the upper limit."""
        return self.nominal + self.half_width

    def in_unit(self, unit: str) -> Limit | None:
        """Return the limit in a unit; None where its own measures something else."""
        factor = 1.0 if self.unit is None else conversion(self.unit, unit)
        if factor is None:
            return None
        tolerance = None if self.tolerance is None else self.tolerance * factor
        changes = {"nominal": self.nominal * factor, "tolerance": tolerance, "unit": unit}
        return self.model_copy(update=changes)

    def inside(self, values: FloatArray) -> BoolArray:
        """Return which values are within the limits, without regard to uncertainty; same shape."""
        return np.abs(values - self.nominal) <= self.half_width

    def certain(self, values: FloatArray, u: FloatArray) -> BoolArray:
        """Return which verdicts hold for all values within U = 2 u (ISO 14253-1); same shape.

        None holds where u is NaN.
        """
        margin = np.abs(np.abs(values - self.nominal) - self.half_width)
        return margin >= K * u


class Specification(FileSection):
    """Limits file, checked."""

    limits: list[Limit] = Field(
        default=[], description="one or more [[limits]], in double brackets"
    )

    def limit(self, type_: str | None, parameter: str) -> Limit | None:
        """Return the limit for a parameter of a type of sensor, else that of all types, or None."""
        for sensor_type in (type_, None):
            for limit in self.limits:
                if limit.parameter == parameter and limit.type == sensor_type:
                    return limit
        return None


def read_limits(path: Path) -> Specification:
    """Read a limits file.

    Raises:
        InputError: the file cannot be read, or a key or value is not valid.
    """
    specification = validated(Specification, read_toml(path, "limits"), str(path), "limits")
    if not specification.limits:
        raise InputError(
            "The limits file holds no limit.",
            expected="one or more [[limits]] with parameter, nominal and tolerance",
            found="none",
            where=str(path),
            remedy="add one, or leave ⟦fleet.limits⟧ out",
        )
    _check(specification, str(path))
    return specification


def _check(specification: Specification, where: str) -> None:
    numbers: dict[tuple[str | None, str], int] = {}
    for number, limit in enumerate(specification.limits, start=1):
        location = f"{where}, [[limits]] entry {number}"
        if limit.parameter not in parameter_names():
            raise unknown(
                "There is no such parameter.", limit.parameter, parameter_names(), location
            )
        if (limit.tolerance is None) == (limit.tolerance_percent is None):
            raise InputError(
                "A limit has one tolerance.",
                expected=(
                    "tolerance (in the parameter's unit) or tolerance_percent (of the nominal "
                    "value)"
                ),
                found="neither" if limit.tolerance is None else "both",
                where=location,
                remedy="keep one of the two",
            )
        if limit.half_width == 0:
            raise InputError(
                "A relative tolerance needs a nominal value other than zero.",
                expected="tolerance, in the parameter's unit, where nominal is 0",
                found=f"tolerance_percent = {limit.tolerance_percent!r}",
                where=location,
                remedy="give tolerance in place of tolerance_percent",
            )
        first = numbers.setdefault((limit.type, limit.parameter), number)
        if first != number:
            raise InputError(
                "Two limits are stated for one parameter of one type.",
                expected="one limit for each type and parameter",
                found=f"{limit.parameter!r} of {limit.type or 'every type'}, as in entry {first}",
                where=location,
                remedy="remove one of the two",
            )
