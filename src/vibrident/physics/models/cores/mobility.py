"""Mobility of a structure: velocity per force, of one mode (ISO 7626-1).

It is jω times the receptance, with the same parameters. Its magnitude is largest at ωn.
"""

from __future__ import annotations

from vibrident.physics.models.base import OSCILLATOR
from vibrident.physics.models.cores.receptance import FORCED, MODAL, response
from vibrident.physics.models.model import Model

MOBILITY = Model(
    name="mobility",
    title="mobility of a structure (velocity per force, one mode)",
    parameters=FORCED,
    response=response,
    derived=MODAL,
    oscillator=OSCILLATOR,
    output="displacement",
    derivative=1,
    behind="force",
    response_unit="m/s",
)
