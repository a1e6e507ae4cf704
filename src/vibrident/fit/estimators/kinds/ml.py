"""The estimator ``ml``: maximum likelihood on the complex responses, with noise on both channels.

Records: every sine's amplitudes in both channels come from a multi-channel sine fit; the variance
of Y − H X is taken from the spectral lines beside the tone with H at each line's own frequency, so
vibration noise (in both channels) cancels and noise of either channel counts (Pintelon & Schoukens
2012, ch. 9). Weights and the sensor's decaying start transient depend on the parameters and are
refreshed between fits. Tables: weighted least squares in magnitude and phase.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from vibrident.base.errors import ModelError
from vibrident.data.records import FloatArray
from vibrident.fit.estimators.base import Estimate, Estimator
from vibrident.fit.estimators.findings import Findings
from vibrident.fit.estimators.residual_tones import network_problem, residual_tones, roughly_cleaned
from vibrident.fit.information import inverse_normal
from vibrident.fit.optimise import Progress, Trace, levenberg_marquardt, silent
from vibrident.fit.problem import Coordinates, Evidence, FrequencyProblem
from vibrident.fit.response import MeasuredResponse
from vibrident.fit.response.verdict import REJECTION, as_chi2, chance_of
from vibrident.fit.start.start import find_start


@dataclass(frozen=True)
class MaximumLikelihood(Estimator):
    """Settings of the estimator ``ml``.

    Attributes:
        model_error: whether a relative error of the model joins the noise (Mandel & Paule 1970)
            where the deviations of sine records exceed what noise and the stated systematic effects
            explain. It is the same at all frequencies and as large as the deviations demand. Points
            of very little noise then no longer dominate, and the uncertainty covers the misfit. It
            is reported, and never applied to the stated uncertainties of a table.

    Examples:
        >>> import vibrident
        >>> hz = [100, 300, 650, 1000]
        >>> calibration = vibrident.simulate(frequencies_hz=hz, samples=2000, response_noise=1e-3)
        >>> noise_alone = vibrident.MaximumLikelihood(model_error=False)
        >>> vibrident.identify(calibration, estimator=noise_alone).estimator
        'ml'
    """

    name: ClassVar[str] = "ml"
    title: ClassVar[str] = "maximum likelihood"
    rank: ClassVar[int] = 1

    model_error: bool = True

    def suits(self, evidence: Evidence) -> str:
        """Return the reason to choose this estimator: tables, and sine records of linear models."""
        if evidence.calibration.table is not None:
            return (
                "a table of responses with their uncertainties: weighted fit in magnitude and phase"
            )
        if evidence.model.is_linear and evidence.only_sines:
            return (
                "sine records: each tone is estimated in both channels, "
                "so noise on the reference does no harm"
            )
        return ""

    def for_noise_alone(self) -> MaximumLikelihood:
        """Return the estimator without a model error."""
        return replace(self, model_error=False)

    def fit(self, evidence: Evidence, progress: Progress = silent) -> Estimate:
        """Fit the model to the complex responses.

        Raises:
            ModelError: a record is not a sine, or the model is nonlinear; such motion needs the
                network.
        """
        first_look = responses(self.name, evidence)
        model = evidence.model
        start = find_start(first_look, model)
        coordinates = Coordinates.at(model, start.values, first_look.band_hz)
        network = None
        tones = evidence.tones
        z = coordinates.first
        if tones is None:
            problem = first_look
            trace = _descend(coordinates, z, first_look, progress)
        else:
            network = network_problem(evidence, start.values)
            first_problem = roughly_cleaned(evidence, network, coordinates, z)
            if first_problem is not None:
                z = _descend(coordinates, z, first_problem, progress).last
            # After a change of so many standard deviations a further round would change the
            # coordinates by a hundredth of it; those of two modes, which trade against each other,
            # by a tenth.
            max_change = 0.3 if model.shares else 3.0
            for _ in range(4):
                if not model.has_network:
                    # Its average acts as at the parameters from which the network was built.
                    network = network_problem(evidence, coordinates.values(z))
                tones = residual_tones(evidence, network, coordinates, z)
                problem = weighted_problem(tones, coordinates, z, evidence)
                trace = _descend(coordinates, z, problem, progress)
                change = np.abs(trace.last - z)
                z = trace.last
                variance = np.diag(_covariance(problem, coordinates, z))
                if np.all(change < max_change * np.sqrt(np.maximum(variance, 0.0))):
                    break
            problem = weighted_problem(tones, coordinates, z, evidence)
        covariance = _covariance(problem, coordinates, trace.last)
        freedom = np.inf
        if tones is not None:
            # Weights that are estimated from ν degrees of freedom each raise the variance by a
            # factor 1 + 4/ν.
            covariance = covariance * float(np.mean(1.0 + 4.0 / tones.degrees_of_freedom))
            freedom = float(np.sum(tones.degrees_of_freedom))
        return Estimate(
            self.name,
            coordinates,
            trace.last,
            covariance,
            freedom,
            trace,
            tones=tones,
            problem=network,
            begin=start,
            equations=problem.equations,
            criterion="likelihood",
        )

    def where_rejected(
        self, evidence: Evidence, estimate: Estimate, progress: Progress = silent
    ) -> Estimate | None:
        """Return the estimate with a relative model error beside the noise, as large as needed.

        None if the deviations demand none, or the settings allow none.
        """
        tones = estimate.tones
        if tones is None or not self.model_error:
            return None
        coordinates = estimate.coordinates
        z = estimate.z
        problem = solved_problem(estimate, evidence)
        degrees = problem.equations - len(z)
        squares = np.sum(np.square(problem.residual(z, coordinates).reshape(2, -1)), axis=0)
        if not chance_of(as_chi2(squares, tones.degrees_of_freedom), degrees) < REJECTION:
            return None
        low = np.log(1e-9)
        high = 0.0
        for _ in range(20):  # to a relative step of 2e-5
            middle = 0.5 * (low + high)
            widened = problem.with_random_effect(float(np.exp(middle)))
            if _descend(coordinates, z, widened, progress).costs[-1] > degrees:
                low = middle
            else:
                high = middle
        error = float(np.exp(0.5 * (low + high)))
        widened = problem.with_random_effect(error)
        trace = _descend(coordinates, z, widened, progress)
        return replace(
            estimate,
            z=trace.last,
            covariance=_covariance(widened, coordinates, trace.last),
            degrees_of_freedom=float(degrees),
            trace=trace,
            findings=Findings(model_error=error),
        )


ML = MaximumLikelihood()


def responses(name: str, evidence: Evidence) -> FrequencyProblem:
    """Return the problem of the complex responses, as the estimator ``name`` needs it.

    Raises:
        ModelError: a record is not a sine, or the model is nonlinear.
    """
    if not evidence.model.is_linear:
        raise ModelError(
            f"The estimator {name!r} works in frequency, and this model has no transfer function.",
            expected="the estimator 'auto' with [[records]], which hold the motion in time",
            found=f"estimator {name!r} with {evidence.model.name!r}",
            where="⟦identify.estimator⟧",
            remedy="use the estimator 'auto' with records, or a linear model",
        )
    problem = evidence.first_look
    if problem is None or any(record.excitation != "sine" for record in evidence.records):
        raise ModelError(
            f"The estimator {name!r} needs complex responses: sine records, or a table.",
            expected="excitation = 'sine' in every record, or [table]",
            found=", ".join(sorted({record.excitation for record in evidence.records})),
            where="⟦identify.estimator⟧",
            remedy="use the estimator 'auto'",
        )
    return problem


def weighted_problem(
    tones: MeasuredResponse, coordinates: Coordinates, z: FloatArray, evidence: Evidence
) -> FrequencyProblem:
    """Return the residual of tones with deviations that hold at ``z``."""
    model = evidence.model
    values = coordinates.values(z)
    quantity = evidence.quantity
    deviation = tones.error_deviation(lambda hz: model.frequency_response(values, hz, quantity))
    return FrequencyProblem.of_measured(tones, deviation, model, quantity)


def solved_problem(estimate: Estimate, evidence: Evidence) -> FrequencyProblem:
    """Return the residual in frequency that an estimate minimised."""
    if estimate.tones is None:
        assert evidence.first_look is not None
        return evidence.first_look
    problem = weighted_problem(estimate.tones, estimate.coordinates, estimate.z, evidence)
    error = estimate.findings.model_error
    return problem if error is None else problem.with_random_effect(error)


def _descend(
    coordinates: Coordinates, z: FloatArray, problem: FrequencyProblem, progress: Progress
) -> Trace:
    """Return the descent of a residual by Levenberg and Marquardt, from z."""
    return levenberg_marquardt(problem.normal, z, coordinates, progress=progress)


def _covariance(problem: FrequencyProblem, coordinates: Coordinates, z: FloatArray) -> FloatArray:
    """Return the covariance of z by the residual's normal equations, shape (p, p)."""
    return inverse_normal(problem.normal(z, coordinates).matrix)
