"""Estimator of free decays alone, and the messages about them.

Nothing measures the motion that moved the mass, so the result has no sensitivity (or generator
constant), no delay and no response over frequency.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from vibrident.base.errors import InputError, ModelError
from vibrident.data.known import KnownResponse, Tabulated
from vibrident.data.records import Calibration, FloatArray
from vibrident.fit.decay.examine import Decays, drifts, examine, misfits_of, verdict
from vibrident.fit.decay.motion import DecayFit, oscillator_of
from vibrident.fit.estimators import Estimate, Estimator
from vibrident.fit.estimators.findings import Findings
from vibrident.fit.optimise import Progress, silent
from vibrident.fit.problem import Evidence
from vibrident.physics.models import CORES, SensorModel
from vibrident.physics.models.base import OSCILLATOR as NAMES
from vibrident.result import ResultWarning

METHOD = (
    "free decays: maximum likelihood of the free motion, each record with its own initial state, "
    "offset and noise; nothing measures the excitation, so there is no gain"
)


@dataclass(frozen=True)
class FreeDecays(Estimator):
    """Maximum-likelihood estimator of the free motion."""

    name: ClassVar[str] = "ml"
    title: ClassVar[str] = "maximum likelihood of free decays"

    def fit(self, evidence: Evidence, progress: Progress = silent) -> Estimate:
        """Return the estimate of natural frequency and damping ratio."""
        poles = channel_poles(evidence.calibration.response_known_response)
        decays = examine(evidence.records, progress, poles)
        fit = decays.fit
        assert fit.trace is not None
        return Estimate(
            self.name,
            replace(fit.problem.coordinates, model=evidence.model),
            fit.z,
            fit.covariance,
            decays.freedom,
            fit.trace,
            equations=float(len(fit.residual)),
            findings=Findings(decays=decays),
        )


def gathered(calibration: Calibration, model: SensorModel) -> Evidence:
    """Return the evidence of a calibration of free decays alone.

    Of the stated systematic effects only that of the clock applies: all frequencies scale with it.

    Raises:
        InputError: no record can be used, a decay does not determine all parameters of the model,
            or the response of the channel is known as a table.
    """
    _require_one_oscillator(model)
    known = calibration.response_known_response
    channel_poles(known)
    effects = tuple(effect for effect in calibration.effects if effect.kind == "clock")
    adapted = replace(
        calibration,
        effects=effects,
        reference_standard_uncertainty=0.0,
        reference_known_response=None,
        response_known_response=known and replace(known, effects=()),
        mounting=None,
    )
    return Evidence.gather(adapted, oscillator_of(model))


def channel_poles(known: KnownResponse | None) -> tuple[complex, ...]:
    """Return the poles of a channel, 1/s, with imaginary parts of zero and above.

    Raises:
        InputError: its response is a table, which has no poles.
    """
    poles: list[complex] = []
    for shape in () if known is None else known.shapes:
        if isinstance(shape, Tabulated):
            raise InputError(
                "A table of the channel's response does not tell how a free decay passes it.",
                expected="poles and zeros, corners or filter coefficients of [response]",
                found=f"a table, {known.source if known else ''}",
                where="known_response of [response]",
                remedy="state the response in one of these ways, or add records with a reference",
            )
        poles += shape.time_poles
    return tuple(pole for pole in poles if pole.imag >= 0.0)


def decays_at(estimate: Estimate) -> tuple[Decays, DecayFit]:
    """Return the decays as they were fitted, and their fit at the values of an estimate.

    In the latter, too, each decay has its best initial state.
    """
    decays = estimate.findings.decays
    assert isinstance(decays, Decays)
    return decays, replace(decays.fit, z=estimate.z)


def predicted(evidence: Evidence, estimate: Estimate) -> tuple[FloatArray, ...]:
    """Return the response of each record, shape (samples,); NaN before it moves freely."""
    _, fit = decays_at(estimate)
    responses = []
    for index, (record, stretch) in enumerate(zip(evidence.records, fit.stretches, strict=True)):
        series = np.full(record.samples, np.nan)
        series[stretch.first : stretch.first + stretch.response.size] = fit.predicted(index)
        responses.append(series)
    return tuple(responses)


def lack_of_fit(estimate: Estimate) -> tuple[tuple[float | None, int, bool], str]:
    """Return the judgement of an estimate and a message of its lack of fit.

    Returns:
        χ² for each degree of freedom, the degrees, and whether the fit is adequate; and the
            message.
    """
    decays, fit = decays_at(estimate)
    chi2, degrees, adequate = verdict(misfits_of(fit))
    ratio = chi2 / max(degrees, 1)
    text = (
        "One linear oscillator does not explain the free decays: the motion in stretches of time "
        f"is {np.sqrt(ratio):.3g} times as far off as the noise explains (χ²/dof = {ratio:.4g}, "
        f"{degrees} degrees of freedom)."
    )
    text = " ".join([text, *(second_mode.words for second_mode in decays.second_modes)])
    return (ratio if degrees > 0 else None, degrees, adequate and not decays.changes), text


def decay_warnings(estimate: Estimate) -> list[ResultWarning]:
    """Return warnings of drift, and of changes with the amplitude."""
    decays, fit = decays_at(estimate)
    drifting = [s for index, s in enumerate(fit.stretches) if s.drift and drifts(fit, index)]
    text = "the response drifts; a straight line was fitted along with the decay."
    warnings = [ResultWarning("drift", f"{s.name}: {text}") for s in drifting]
    return warnings + [ResultWarning("nonlinear", change.words) for change in decays.changes]


def require_plain(estimator: object, *, sampled: bool = False) -> None:
    """Refuse requests that free decays alone cannot serve.

    Args:
        estimator: as requested.
        sampled: whether the posterior was requested.

    Raises:
        ModelError: an estimator of networks, or a posterior, is requested.
    """
    if sampled or estimator not in ("auto", FreeDecays.name):
        raise ModelError(
            "The networks are trained on records with a reference; free decays alone have an "
            "estimate of their own.",
            expected="the estimator 'auto' (or 'ml'), without posterior",
            found=f"free decays only, {'a posterior' if sampled else f'estimator {estimator!r}'}",
            where="⟦identify.estimator⟧",
            remedy="use the estimator 'auto'",
        )


def _require_one_oscillator(model: SensorModel) -> None:
    """Refuse a model with parameters that decays alone do not determine.

    Raises:
        InputError: it has such parameters.
    """
    add_ons = [
        addon for addon in model.add_ons if addon.rational is not None or addon.force is not None
    ]
    undetermined = [spec.name for addon in add_ons for spec in addon.parameters]
    if undetermined or model.core.oscillator != NAMES:
        suitable = [core.name for core in CORES.values() if core.oscillator == NAMES]
        raise InputError(
            "Free decays alone tell one natural frequency and one damping ratio.",
            expected=f"the model {' or '.join(suitable)}",
            found=f"{model.name!r} with {', '.join(undetermined)}"
            if undetermined
            else repr(model.name),
            where="⟦identify.model⟧",
            remedy=f"identify with {model.core.name!r}, or add records with a reference",
        )
