"""Delay of the response channel behind the reference channel.

Its factor is e^{−jωτ}, τ > 0 where the response is late.
"""

from __future__ import annotations

from vibrident.physics.models.base import AddOn, ParameterSpec

DELAY = AddOn(
    name="delay",
    title="delay between the channels",
    parameters=(ParameterSpec("delay", "s", "time", symbol="τ", describes="channel"),),
    delay=lambda parameters: parameters["delay"],
)
