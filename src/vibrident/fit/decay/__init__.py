"""Free decays: natural frequency and damping ratio without a reference, by NumPy and SciPy alone.

The folder's modules are loaded only where there are decays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from vibrident.data.records import Calibration, Record

if TYPE_CHECKING:
    from vibrident.fit.decay.beside import DecayDeviation
    from vibrident.fit.problem import Evidence
    from vibrident.physics.models import SensorModel


def decays_alone(calibration: Calibration) -> bool:
    """Whether a calibration holds nothing but free decays."""
    return bool(calibration.records) and all(r.excitation == "decay" for r in calibration.records)


def with_free_decays(evidence: Evidence) -> Evidence:
    """The evidence with each decay cut to where it moves freely, and what changes with a decay's amplitude."""
    if not any(r.excitation == "decay" for r in evidence.records):
        return evidence
    from vibrident.fit.decay import beside

    records, changing = beside.free_parts(evidence.records)
    return replace(evidence, records=records, findings=(*evidence.findings, *changing))


def decay_deviations(
    records: Sequence[Record], model: SensorModel, values: Mapping[str, float]
) -> tuple[DecayDeviation, ...]:
    """What each decay says of the model with these parameters; nothing of a nonlinear one."""
    if not any(r.excitation == "decay" for r in records):
        return ()
    from vibrident.fit.decay import beside

    return beside.decay_deviations(records, model, values)
