r"""Physical parameters ↔ the numbers an optimiser moves: all near one, bounds built in.

| kind | physical value of coordinate z | why |
|---|---|---|
| gain | z · start | linear; any sign |
| log | start · e^z | positive, and scale-free |
| positive | \|sinh z\| | reflected at zero: δ = 0 is reachable; scale-free where large |
| duration | start · e^z | positive, and scale-free |
| time | z · unit | linear, any sign |
| ratio | z | linear, any sign |
| inverse | z / response_size | linear, any sign |
| inverse_square | z / response_size² | linear, any sign; a cubic term's share of the force |
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.physics.models import SensorModel
from vibrident.physics.models.base import array_library

#: A natural frequency is looked for at most this far outside the band of the data.
BAND_MARGIN = 300.0
#: … and below it further: a first-order high-pass acts as f0/f.
MARGIN_BELOW = 1e6
#: Largest exponent of a trial step: e to it is finite, and beyond every end of the search.
FARTHEST = 300.0


def searched(band_hz: Any) -> dict[str, tuple[Any, Any]]:
    """Kind of a parameter to its lowest and highest value that a fit searches, for data of this band."""
    low, high = band_hz[0] / MARGIN_BELOW, band_hz[1] * BAND_MARGIN
    return {"log": (low, high), "duration": (1.0 / (BAND_MARGIN * high), 1.0 / low)}


@dataclass(frozen=True)
class Coordinates:
    """The map between coordinates z, shape (parameters,), and a model's parameters. To JAX, a pytree.

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
        band_hz: tuple[float, float],
        response_size: float = 1.0,
    ) -> Coordinates:
        """Coordinates around start values given by name."""
        values = np.array([float(start[name]) for name in model.parameter_names])
        # Arrays: a plain number would be part of the compiled functions, which every new data set would compile anew.
        return cls(model, values, np.array(band_hz), np.array(float(response_size)))

    @property
    def time_unit_s(self) -> Any:
        """Unit of the coordinates of kind ``time``: one radian at the highest frequency."""
        return 1.0 / (2.0 * np.pi * self.band_hz[1])

    @property
    def first(self) -> FloatArray:
        """Coordinates of the start values, shape (parameters,)."""
        return self.place(dict(zip(self.model.parameter_names, np.asarray(self.start).tolist(), strict=True)))

    @property
    def edges(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest coordinate of the range searched, each of shape (parameters,); infinite where open."""
        ends = searched([float(f) for f in self.band_hz])
        rows = [
            np.log(np.array(ends[spec.kind]) / float(start)) if spec.kind in ends else np.array([-np.inf, np.inf])
            for spec, start in zip(self.model.parameters, np.asarray(self.start), strict=True)
        ]
        return np.array([row[0] for row in rows]), np.array([row[1] for row in rows])

    def physical(self, z: Any) -> dict[str, Any]:
        """Name to physical value; ``z`` may be traced."""
        values, xp = {}, array_library(z)
        ends = searched(self.band_hz)
        for index, spec in enumerate(self.model.parameters):
            start = self.start[index]
            if spec.kind == "gain":
                values[spec.name] = z[index] * start
            elif spec.kind in ends:
                values[spec.name] = xp.clip(start * xp.exp(xp.minimum(z[index], FARTHEST)), *ends[spec.kind])
            elif spec.kind == "ratio":
                values[spec.name] = z[index]
            elif spec.kind == "inverse":
                values[spec.name] = z[index] / self.response_size
            elif spec.kind == "inverse_square":
                values[spec.name] = z[index] / self.response_size**2
            elif spec.kind == "positive":
                values[spec.name] = xp.abs(xp.sinh(xp.clip(z[index], -FARTHEST, FARTHEST)))
            else:
                values[spec.name] = z[index] * self.time_unit_s
        return values

    def values(self, z: Any) -> dict[str, float]:
        """Name to physical value, as plain floats."""
        return {name: float(value) for name, value in self.physical(np.asarray(z, dtype=float)).items()}

    def place(self, values: Mapping[str, float]) -> FloatArray:
        """Coordinates of physical values, shape (parameters,)."""
        size, unit = float(self.response_size), float(self.time_unit_s)
        scale = {"time": 1.0 / unit, "inverse": size, "inverse_square": size**2}
        found = []
        for spec, start in zip(self.model.parameters, np.asarray(self.start), strict=True):
            value = float(values[spec.name])
            if spec.kind in ("log", "duration"):
                found.append(np.log(max(value / start, np.finfo(float).tiny)))
            elif spec.kind == "positive":
                found.append(np.arcsinh(value))
            elif spec.kind == "gain":
                found.append(1.0 if value == start else value / start)
            else:
                found.append(value * scale.get(spec.kind, 1.0))
        return np.array(found)

    def slopes(self, z: FloatArray) -> FloatArray:
        """Derivative of every physical value by its coordinate at ``z``, shape (parameters,).

        Zero at the ends of the range searched, beyond which nothing changes.
        """
        values, (low, high) = self.values(z), self.edges
        size, unit = float(self.response_size), float(self.time_unit_s)
        scale = {"time": unit, "inverse": 1.0 / size, "inverse_square": 1.0 / size**2}
        found = []
        for index, (spec, start) in enumerate(zip(self.model.parameters, np.asarray(self.start), strict=True)):
            own = {"gain": start, "log": values[spec.name], "duration": values[spec.name]}
            own["positive"] = float(np.copysign(np.hypot(1.0, values[spec.name]), z[index]))  # cosh z
            found.append(own.get(spec.kind, scale.get(spec.kind, 1.0)))
        return np.where((low < z) & (z < high), np.array(found, dtype=float), 0.0)
