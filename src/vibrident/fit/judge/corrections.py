"""The fit of records that are corrected for the stated systematic effects.

A stated effect has the amount zero in a fit, and its uncertainty is in the budget. Where its true
amount shows above the noise, no model fits, and what the effect does is taken for noise. Its amount
is then estimated beside the parameters, with its statement as the prior, and taken out of the
records; fit and amounts follow each other to their common optimum. What is left of the effect's
uncertainty is that of its amount by the statement and the data together.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibrident.base.errors import VibridentError
from vibrident.data.records import FloatArray, SystematicEffect
from vibrident.fit.judge.attempts import MAX_SETTLED_STEP, Fitted
from vibrident.fit.judge.effects import explained_by_effects
from vibrident.fit.problem.evidence import EffectCorrection
from vibrident.fit.response.correction import LogChange
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.verdict import REJECTION
from vibrident.fit.uncertainty.budget import effects_of, patterns

#: Kinds of effects whose change of log H does not depend on the model, beside tabulated ones.
KINDS = ("timing", "phase", "mounting")
MAX_ROUNDS = 8


def with_effects_corrected(first: Fitted) -> Fitted:
    """Return the fit of records that are corrected for the stated effects, where that explains all.

    It is tried where noise alone does not explain the deviations.
    """
    effects = effects_of(first.evidence.calibration)
    may_correct = np.array([bool(effect.pattern) or effect.kind in KINDS for effect in effects])
    if first.judgement.adequacy.chance >= REJECTION or not np.any(may_correct):
        return first
    current = first
    for _ in range(MAX_ROUNDS):
        evidence = current.evidence
        explained = explained_by_effects(evidence, current.estimate, current.judgement, None)
        if explained is None:
            break
        amounts, uncertainties = (
            values[: len(effects)] for values in (explained.amounts, explained.uncertainties)
        )
        before = np.zeros(len(effects))
        for number, correction in enumerate(evidence.corrections):
            before[number] = correction.amount
        change = np.where(may_correct, amounts - before, 0.0)
        if np.all(np.abs(change) < MAX_SETTLED_STEP * uncertainties):
            break
        remaining = np.where(may_correct, uncertainties, 1.0)
        corrections = [
            EffectCorrection(*numbers)
            for numbers in zip((before + change).tolist(), remaining.tolist(), strict=True)
        ]
        frequency_hz = current.judgement.adequacy.frequency_hz
        band_hz = float(np.min(frequency_hz)), float(np.max(frequency_hz))
        try:
            corrected = evidence.corrected(_log_change(effects, change), band_hz, corrections)
            # A fit that was rejected is no start.
            current = current.anew(corrected) if current.adequate else current.once(corrected)
        except VibridentError:
            break
    return current if current.adequate else first


def _log_change(effects: Sequence[SystematicEffect], amounts: FloatArray) -> LogChange:
    """Return the change of log H by amounts of effects, as a function of the frequency in Hz.

    Effects whose amount is zero may depend on the model.
    """
    chosen = np.flatnonzero(amounts).tolist()
    changing = [effects[number] for number in chosen]

    def log_change(frequency_hz: FloatArray) -> ComplexArray:
        change = patterns(changing, None, frequency_hz) @ amounts[chosen]
        return np.asarray(change, dtype=complex)

    return log_change
