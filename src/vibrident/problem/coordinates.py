"""Physical parameters ↔ the numbers an optimiser moves: all near one, bounds built in.

| kind | physical value of coordinate z | why |
|---|---|---|
| gain | z · start | linear; keeps its sign free |
| log | start · e^z | positive, and scale-free |
| positive | \\|z\\| | reflected at zero: δ = 0 is reachable |
| time | z · unit | linear, any sign |
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibrident.backend import jax, jnp
from vibrident.models import SensorModel
from vibrident.records import FloatArray

#: A natural frequency is looked for at most this far outside the band of the data.
BAND_MARGIN = 300.0


@dataclass(frozen=True)
class Coordinates:
    """The map between coordinates z, shape (parameters,), and a model's parameters.

    Attributes:
        model: whose parameters.
        start: name to start value, physical units.
        band_hz: lowest and highest frequency of the data.
    """

    model: SensorModel
    start: Mapping[str, float]
    band_hz: tuple[float, float]

    @property
    def time_unit_s(self) -> float:
        """Unit of the coordinates of kind ``time``: one radian at the highest frequency."""
        return 1.0 / (2.0 * np.pi * self.band_hz[1])

    @property
    def first(self) -> FloatArray:
        """Coordinates of the start values."""
        values = []
        for spec in self.model.parameters:
            start = self.start[spec.name]
            values.append({"gain": 1.0, "log": 0.0, "positive": start, "time": start / self.time_unit_s}[spec.kind])
        return np.array(values)

    @property
    def limits_hz(self) -> tuple[float, float]:
        """Range in which frequencies are looked for."""
        return self.band_hz[0] / BAND_MARGIN, self.band_hz[1] * BAND_MARGIN

    def physical(self, z: Any) -> dict[str, Any]:
        """Name to physical value; ``z`` may be traced."""
        values = {}
        low, high = self.limits_hz
        for index, spec in enumerate(self.model.parameters):
            start = self.start[spec.name]
            if spec.kind == "gain":
                values[spec.name] = z[index] * start
            elif spec.kind == "log":
                inside = jnp.clip(z[index], np.log(low / start), np.log(high / start))
                values[spec.name] = start * jnp.exp(inside)
            elif spec.kind == "positive":
                values[spec.name] = jnp.abs(z[index])
            else:
                values[spec.name] = z[index] * self.time_unit_s
        return values

    def vector(self, z: Any) -> Any:
        """Physical values in the model's order, shape (parameters,)."""
        return jnp.stack([jnp.asarray(value) for value in self.physical(z).values()])

    def slopes(self, z: Any) -> FloatArray:
        """dp/dz of every parameter at ``z``, shape (parameters,)."""
        return np.asarray(jnp.diagonal(jax.jacfwd(self.vector)(jnp.asarray(z, dtype=float))))
