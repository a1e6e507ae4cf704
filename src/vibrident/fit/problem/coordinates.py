r"""Physical parameters ↔ the numbers an optimiser moves: all near one, bounds built in.

| kind | physical value of coordinate z | why |
|---|---|---|
| gain | z · start | linear; any sign |
| log | start · e^z | positive, and scale-free |
| positive | \|sinh z\| | reflected at zero: δ = 0 is reachable; scale-free where large |
| duration | start · e^z | positive, and scale-free |
| time | z · unit | linear, any sign |
| ratio | z · size | linear, any sign; the size is one, or the larger of its bounds |
| inverse | z / response_size | linear, any sign |
| inverse_square | z / response_size² | linear, any sign; a cubic term's share of the force |
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.physics.models import ParameterSpec, SensorModel
from vibrident.physics.models.base import array_library

#: A natural frequency is searched at most this factor outside the band of the data …
BAND_MARGIN = 300.0
#: … and further below it: a first-order high-pass acts as f0/f.
MARGIN_BELOW = 1e6
#: Largest damping ratio that is searched: beyond it the slow pole is lost in the rounding of the
#: fast one, 4 δ² times as fast.
MAX_DAMPING = float(1.0 / np.sqrt(np.finfo(float).eps))
#: Largest exponent of a trial step, or of the growth of a network in a run: e to it is finite, and
#: beyond every search.
MAX_EXPONENT = 300.0


def searched(band_hz: Any) -> dict[str, tuple[Any, Any]]:
    """Return the lowest and highest value that a fit searches, by kind of parameter."""
    low = band_hz[0] / MARGIN_BELOW
    high = band_hz[1] * BAND_MARGIN
    return {"log": (low, high), "duration": (1.0 / (BAND_MARGIN * high), 1.0 / low)}


def ends_of(spec: ParameterSpec, band_hz: Any) -> tuple[Any, Any] | None:
    """Return the lowest and highest value of a parameter that a fit searches; None where open."""
    if spec.bounds is None and spec.kind == "positive" and spec.unit == "1":
        return 0.0, MAX_DAMPING
    return searched(band_hz).get(spec.kind or "") if spec.bounds is None else spec.bounds


@dataclass(frozen=True)
class Coordinates:
    """Map between coordinates z, shape (parameters,), and a model's parameters; a pytree to JAX.

    Attributes:
        model: whose parameters.
        start: start values in the model's order, physical units, shape (parameters,).
        band_hz: lowest and highest frequency of the data, shape (2,).
        response_size: largest response of the data, response unit.
    """

    model: SensorModel
    start: Any
    band_hz: Any
    response_size: Any = 1.0

    @classmethod
    def at(
        cls,
        model: SensorModel,
        start: Mapping[str, float],
        band_hz: Any,
        response_size: float = 1.0,
    ) -> Coordinates:
        """Return the coordinates around start values given by name."""
        values = np.array([float(start[name]) for name in model.parameter_names])
        # Arrays, as a plain number would be part of the compiled functions, which every data set
        # would compile anew.
        return cls(model, values, np.array(band_hz), np.array(float(response_size)))

    @property
    def time_unit_s(self) -> Any:
        """Return the unit of coordinates of kind ``time``: a radian at the highest frequency."""
        return 1.0 / (2.0 * np.pi * self.band_hz[1])

    @functools.cached_property
    def _units(self) -> list[Any]:
        """Return the physical value of each linear coordinate at one; None for the other kinds."""
        size = self.response_size
        units = {"time": self.time_unit_s, "inverse": 1.0 / size, "inverse_square": 1.0 / size**2}
        by_parameter = []
        for index, spec in enumerate(self.model.parameters):
            unit = {"gain": self.start[index], "ratio": spec.size}.get(spec.kind or "")
            by_parameter.append(units.get(spec.kind or "") if unit is None else unit)
        return by_parameter

    @property
    def first(self) -> FloatArray:
        """Return the coordinates of the start values, shape (parameters,)."""
        return self.place(
            dict(zip(self.model.parameter_names, np.asarray(self.start).tolist(), strict=True))
        )

    @functools.cached_property
    def edges(self) -> tuple[FloatArray, FloatArray]:
        """Return the lowest and highest coordinate that is searched, each of shape (parameters,).

        Infinite where open.
        """
        band_hz = [float(f) for f in self.band_hz]
        low = np.full(len(self.start), -np.inf)
        high = np.full(len(self.start), np.inf)
        for index, spec in enumerate(self.model.parameters):
            if (ends := ends_of(spec, band_hz)) is None:
                continue
            if spec.kind == "positive":  # mirrored at zero
                low[index], high[index] = np.arcsinh(ends[1]) * np.array([-1.0, 1.0])
            elif spec.kind == "ratio":
                low[index], high[index] = np.array(ends) / spec.size
            else:
                low[index], high[index] = np.log(np.array(ends) / self.start[index])
        return low, high

    def physical(self, z: Any) -> dict[str, Any]:
        """Return the physical values by name; ``z`` may be traced."""
        values = {}
        xp = array_library(z)
        units = self._units
        for index, spec in enumerate(self.model.parameters):
            if (unit := units[index]) is not None:
                value = z[index] * unit
            elif spec.kind == "positive":
                value = xp.abs(
                    xp.sinh(xp.minimum(xp.maximum(z[index], -MAX_EXPONENT), MAX_EXPONENT))
                )
            else:
                value = self.start[index] * xp.exp(xp.minimum(z[index], MAX_EXPONENT))
            if (ends := ends_of(spec, self.band_hz)) is not None:
                value = xp.minimum(xp.maximum(value, ends[0]), ends[1])
            values[spec.name] = value
        return values

    def values(self, z: Any) -> dict[str, float]:
        """Return the physical values by name, as plain floats."""
        return {
            name: float(value) for name, value in self.physical(np.asarray(z, dtype=float)).items()
        }

    def place(self, values: Mapping[str, float]) -> FloatArray:
        """Return the coordinates of physical values, shape (parameters,)."""
        coordinates = []
        for spec, start, unit in zip(
            self.model.parameters, np.asarray(self.start), self._units, strict=True
        ):
            value = float(values[spec.name])
            if spec.kind == "positive":
                coordinates.append(np.arcsinh(value))
            elif spec.kind == "gain" and value == start:
                coordinates.append(1.0)  # also of a gain of zero
            elif unit is not None:
                coordinates.append(value / unit)
            else:
                coordinates.append(np.log(max(value / start, np.finfo(float).tiny)))
        return np.array(coordinates)

    def moved(self, z: FloatArray, step: FloatArray) -> FloatArray:
        """Return the coordinates behind a step along which values change by factors.

        Far from a resonance the data determine products of powers of gain, natural frequency and
        damping far better than these: those stay along such a step, and would not along a line.
        A value that would lose its sign, or more than double, moves along a line.

        Args:
            z: shape (P,).
            step: its slope at z, shape (P,).
        """
        end = z + step
        for index, spec in enumerate(self.model.parameters):
            if spec.kind not in ("gain", "positive"):
                continue
            positive = spec.kind == "positive"
            if positive and abs(z[index]) >= MAX_EXPONENT:
                continue  # where the value does not change
            value = float(np.sinh(z[index]) if positive else z[index])
            change = float(step[index] * (np.cosh(z[index]) if positive else 1.0))
            if abs(change) < abs(value):
                value *= np.exp(change / value)
                end[index] = np.arcsinh(value) if positive else value
        return end

    def slopes(self, z: FloatArray) -> FloatArray:
        """Return the derivative of each physical value by its coordinate, shape (parameters,).

        Zero at the ends of the range searched, beyond which nothing changes.
        """
        values = self.values(z)
        low, high = self.edges
        slopes = []
        for spec, coordinate, unit in zip(self.model.parameters, z, self._units, strict=True):
            value = values[spec.name]
            if spec.kind == "positive":
                value = float(np.copysign(np.hypot(1.0, value), coordinate))  # cosh z
            slopes.append(value if unit is None else unit)
        return np.where((low < z) & (z < high), np.array(slopes), 0.0)
