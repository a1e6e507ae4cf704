"""Free decays: natural frequency and damping ratio without a reference, by NumPy and SciPy alone.

The folder's modules are loaded only where there are decays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from vibrident.data.records import Calibration, Record

if TYPE_CHECKING:
    from vibrident.fit.decay.deviations import DecayDeviation
    from vibrident.fit.problem import Evidence
    from vibrident.physics.models import SensorModel


def decays_alone(calibration: Calibration) -> bool:
    """Return whether a calibration holds nothing but free decays."""
    return bool(calibration.records) and all(r.excitation == "decay" for r in calibration.records)


def with_free_decays(evidence: Evidence) -> Evidence:
    """Return the evidence with each decay cut to its free motion, and findings of its changes."""
    if not any(r.excitation == "decay" for r in evidence.records):
        return evidence
    from vibrident.fit.decay import deviations

    records, changes = deviations.free_parts(evidence.records)
    return replace(evidence, records=records, findings=(*evidence.findings, *changes))


def decay_deviations(
    records: Sequence[Record], model: SensorModel, values: Mapping[str, float]
) -> tuple[DecayDeviation, ...]:
    """Return how far each decay is from the model with these parameters.

    Empty for a nonlinear model.
    """
    if not any(r.excitation == "decay" for r in records):
        return ()
    from vibrident.fit.decay import deviations

    return deviations.decay_deviations(records, model, values)
