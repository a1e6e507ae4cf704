"""The paper's network: one layer a sample, weights that are the physics, unrolled in time."""

from __future__ import annotations

from vibrident.network.cell import Cell, run
from vibrident.network.readback import physics_from_weights
from vibrident.network.unroll import Lanes, respond

__all__ = ["Cell", "Lanes", "physics_from_weights", "respond", "run"]
