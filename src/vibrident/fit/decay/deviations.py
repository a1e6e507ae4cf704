"""Free decays among records with a reference: their free motion and deviation from a model."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import FloatArray, Record
from vibrident.data.screening import ScreeningFinding
from vibrident.fit.decay.examine import MotionMisfit, change_of, misfits_of, weighed
from vibrident.fit.decay.motion import DecayFit, DecayProblem, free_motion
from vibrident.fit.decay.release import free_stretch
from vibrident.physics.models import SensorModel


@dataclass(frozen=True)
class DecayDeviation:
    """Deviation of a free decay from a model.

    Attributes:
        record: name of the record.
        parts: misfit by stretches of time; initial state, offset and drift are fitted to the decay.
        natural_frequency_hz: of the decay alone.
        damping_ratio: of the decay alone.
    """

    record: str
    parts: MotionMisfit
    natural_frequency_hz: float
    damping_ratio: float

    @property
    def words(self) -> str:
        """Return the oscillator of the decay alone, for a message."""
        return (
            f"the free decay {self.record} alone has natural frequency "
            f"{self.natural_frequency_hz:.5g} Hz and damping ratio {self.damping_ratio:.3g}"
        )


def free_parts(
    records: Sequence[Record],
) -> tuple[tuple[Record, ...], tuple[ScreeningFinding, ...]]:
    """Return the records with each decay cut to its free motion, and findings of its changes."""
    cut = []
    findings = []
    for record in records:
        if record.excitation != "decay":
            cut.append(record)
            continue
        decay = _separate_fit(record)
        cut.append(_cut(record, decay.stretches[0].first))
        change = change_of(decay)
        if change is not None:
            findings.append(ScreeningFinding("nonlinear", change.words))
    return tuple(cut), tuple(findings)


def _cut(record: Record, first: int) -> Record:
    """Return a decay without the samples before its free motion, and without a reference."""
    response_only = record if record.reference is None else replace(record, reference=None)
    if first == 0:
        return response_only
    return response_only.part(
        slice(first, record.samples), f"{first} samples before the free motion left out"
    )


def decay_deviations(
    records: Sequence[Record], model: SensorModel, values: Mapping[str, float]
) -> tuple[DecayDeviation, ...]:
    """Return how far each decay is from a linear model with these parameters.

    Records that are no decays are left out; empty for a nonlinear model.
    """
    if not model.is_linear or model.core.oscillator is None:
        return ()
    deviations = []
    for record in (r for r in records if r.excitation == "decay"):
        decay = _separate_fit(record)
        stretch = decay.stretches[0]
        further = _other_motion(model, values, stretch.time_s)
        natural, damping = (values[name] for name in model.core.oscillator)
        problem = DecayProblem.about([replace(stretch, further_columns=further)], natural, damping)
        (misfit,) = misfits_of(DecayFit(problem, problem.coordinates.first))
        deviations.append(DecayDeviation(record.name, misfit, *decay.values))
    return tuple(deviations)


def _other_motion(
    model: SensorModel, values: Mapping[str, float], time_s: FloatArray
) -> FloatArray | None:
    """Return the free motion of a model's further poles, shape (samples, n); None without any."""
    columns = []
    for addon in reversed(model.add_ons):
        if addon.corner:
            columns.append(np.exp(-2.0 * np.pi * values[addon.corner] * time_s)[:, None])
        if addon.oscillator is not None:
            natural, damping = (values[name] for name in addon.oscillator)
            columns.append(free_motion(natural, damping, time_s))
    return np.concatenate(columns, axis=1) if columns else None


@functools.lru_cache(maxsize=32)
def _separate_fit(record: Record) -> DecayFit:
    """Return the separate fit of a decay, by which the model is judged."""
    return weighed(free_stretch(record))
