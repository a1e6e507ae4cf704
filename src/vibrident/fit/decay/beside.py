"""Free decays among records with a reference: their free part, and what they say of a model fitted to all."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import FloatArray, Record
from vibrident.data.screening import Finding
from vibrident.fit.decay.examine import Parts, change_of, parts_of, weighed
from vibrident.fit.decay.motion import DecayFit, DecayProblem, free_motion
from vibrident.fit.decay.release import free_stretch
from vibrident.physics.models import SensorModel


@dataclass(frozen=True)
class DecayDeviation:
    """A free decay against a model."""

    record: str  # its name
    parts: Parts  # χ² of its stretches of time; initial state, offset and drift are the decay's own
    natural_frequency_hz: float  # that the decay alone has
    damping_ratio: float  # the same

    @property
    def words(self) -> str:
        """What the decay says, for a message."""
        return (
            f"the free decay {self.record} alone has natural frequency {self.natural_frequency_hz:.5g} Hz and damping "
            f"ratio {self.damping_ratio:.3g}"
        )


def free_parts(records: Sequence[Record]) -> tuple[tuple[Record, ...], tuple[Finding, ...]]:
    """The records with each decay cut to where it moves freely, and what changes with a decay's amplitude."""
    kept, findings = [], []
    for record in records:
        if record.excitation != "decay":
            kept.append(record)
            continue
        own = _own(record)
        kept.append(_cut(record, own.stretches[0].first))
        change = change_of(own)
        if change is not None:
            findings.append(Finding("nonlinear", change.words))
    return tuple(kept), tuple(findings)


def _cut(record: Record, first: int) -> Record:
    if first == 0:
        return record if record.reference is None else replace(record, reference=None)
    history = record.provenance.then(f"{first} samples before the free motion left out")
    return replace(
        record,
        reference=None,
        response=record.response[first:],
        valid=record.mask[first:],
        start_time_s=record.start_time_s + first / record.sampling_rate_hz,
        provenance=history,
    )


def decay_deviations(
    records: Sequence[Record], model: SensorModel, values: Mapping[str, float]
) -> tuple[DecayDeviation, ...]:
    """How far each decay is from a linear model with these parameters; records that are no decays are passed over."""
    if not model.is_linear or model.core.oscillator is None:
        return ()
    found = []
    for record in (r for r in records if r.excitation == "decay"):
        own = _own(record)
        stretch = own.stretches[0]
        more = _other_motion(model, values, stretch.time_s)
        natural, damping = (values[name] for name in model.core.oscillator)
        problem = DecayProblem.about([replace(stretch, more=more)], natural, damping)
        (parts,) = parts_of(DecayFit(problem, problem.coordinates.first))
        found.append(DecayDeviation(record.name, parts, *own.values))
    return tuple(found)


def _other_motion(
    model: SensorModel, values: Mapping[str, float], time_s: FloatArray
) -> FloatArray | None:
    """Free motion of a model's further poles, shape (samples, n); None if it has no further poles."""
    columns = []
    for addon in reversed(model.add_ons):
        if addon.corner:
            columns.append(np.exp(-2.0 * np.pi * values[addon.corner] * time_s)[:, None])
        if addon.oscillator is not None:
            natural, damping = (values[name] for name in addon.oscillator)
            columns.append(free_motion(natural, damping, time_s))
    return np.concatenate(columns, axis=1) if columns else None


@functools.lru_cache(maxsize=32)
def _own(record: Record) -> DecayFit:
    """The separate fit of a decay, used to judge the model."""
    return weighed(free_stretch(record))
