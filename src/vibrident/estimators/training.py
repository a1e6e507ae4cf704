"""The network, trained end to end on excitation and response in time: the paper's method, with improvements.

Weights tied to the physics through the chosen discretisation, initial state and offset of every record found exactly,
each record weighted by its own noise. Trained by Levenberg–Marquardt, or by Adam as in the paper; Levenberg–Marquardt
is followed by steps that weigh every line of the residual by the noise found there, to maximum likelihood for any
noise (:mod:`vibrident.estimators.reweighting`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibrident.discretize import method
from vibrident.errors import ModelError
from vibrident.estimators.base import Estimate
from vibrident.estimators.coloured import coloured_covariance
from vibrident.estimators.network_settings import NetworkSettings
from vibrident.estimators.optimise import Bent, Progress, Trace, levenberg_marquardt
from vibrident.estimators.reweighting import reweighted
from vibrident.estimators.start import Start, find_start
from vibrident.estimators.valley import ValleySteps
from vibrident.lines import RecordLines
from vibrident.measure.hum import hum_tones
from vibrident.problem import Coordinates, Evidence, LineProblem, NetworkProblem, network_objective, network_of
from vibrident.problem.framing import response_size
from vibrident.records import FloatArray

#: Rounds of training with refreshed noise weights and delay.
ROUNDS = 6
#: Relative change of the noise below which its weights need no further round.
NOISE_SETTLED = 1e-3
#: What the curve of a nonlinear model is.
SMALL_SIGNAL = (
    "of the linear part: what the response comes to for small signals; measured points are brought there by the network"
)


def fit(network: NetworkSettings, evidence: Evidence, progress: Progress) -> Estimate:
    """Train the network.

    Raises:
        ModelError: there are no records, or no record has a reference.
        InputError: no record is long enough.
    """
    if not evidence.records or evidence.first_look is None:
        raise ModelError(
            "The network is trained on records with a reference.",
            expected="[[records]] with a reference channel",
            found="a table" if evidence.calibration.table is not None else "free decays only",
            where="estimator",
            remedy="use the estimator 'auto' for a table; add a record with a reference to free decays",
        )
    trained = _trained(network, evidence, progress)
    if network.weights == "free":
        return _freed(network, trained, progress)
    return trained.in_the_noise_found()


def _trained(network: NetworkSettings, evidence: Evidence, progress: Progress) -> _Trained:
    assert evidence.first_look is not None
    begin = find_start(evidence.first_look, evidence.model)
    start = begin.values
    problem = _problem(network, evidence, start)
    coordinates = Coordinates.at(evidence.model, start, evidence.band_hz, response_size(evidence.records))
    z = coordinates.first
    problem = _beside_hum(problem, coordinates)
    noise, trace = np.ones(len(evidence.records)), None
    for _ in range(ROUNDS):
        normal = problem.normal(z, coordinates, noise)
        found = problem.record_noise(normal, noise)
        if trace is not None and np.allclose(found, noise, rtol=NOISE_SETTLED, atol=0.0):
            break
        if trace is None and not evidence.model.is_linear:
            z = _with_harmonic_start(problem, normal, evidence, z)
        noise = found
        trace = _train(
            network, problem, coordinates, z, noise, ValleySteps.of_records(evidence, coordinates, noise), progress
        )
        z = trace.last
        moved = problem.at_delay_of(coordinates.values(z))
        if moved is not problem:
            problem = moved
            noise = noise * (1.0 + 2.0 * NOISE_SETTLED)  # another round, with the inputs at the delay found
    assert trace is not None
    settings: dict[str, Any] = {
        "discretisation": network.discretisation,
        "optimiser": trace.optimiser,
        "inputs_per_step": problem.frame.terms,
        "noise": noise.tolist(),
    }
    if any(record.hum_hz for record in problem.records):
        settings["hum_hz"] = [list(record.hum_hz) for record in problem.records]
    if not evidence.model.is_linear:
        settings["response_curve"] = SMALL_SIGNAL
    return _Trained(evidence, problem, coordinates, z, noise, trace, begin, settings)


def _problem(network: NetworkSettings, evidence: Evidence, start: dict[str, float]) -> NetworkProblem:
    """Adam runs the network in time, as the paper does."""
    at = (evidence.records, evidence.model, method(network.discretisation), evidence.quantity, start)
    if network.optimiser == "lm":
        return network_of(*at)
    from vibrident.problem.time_domain import TimeProblem

    return TimeProblem.build(*at)


def _beside_hum(problem: NetworkProblem, coordinates: Coordinates) -> NetworkProblem:
    """The problem with the hum that the start values leave as unknowns.

    A free response without damping imitates hum, and a resonance above half the sampling rate has one at any frequency:
    from a start near the truth, training would leave it for that.
    """
    if not isinstance(problem, LineProblem) or any(record.hum_hz for record in problem.records):
        return problem
    tones = hum_tones(problem.records, problem.predict(coordinates, coordinates.first))
    return problem.with_hum(tones) if any(tones) else problem


def _freed(network: NetworkSettings, trained: _Trained, progress: Progress) -> Estimate:
    from vibrident.estimators.free import train_free
    from vibrident.problem.time_domain import TimeProblem

    evidence, values = trained.evidence, trained.coordinates.values(trained.z)
    in_time = TimeProblem.build(
        evidence.records, evidence.model, method(network.discretisation), evidence.quantity, values
    )
    z, covariance, trace, _ = train_free(
        in_time, trained.coordinates, trained.z, trained.noise, network.reading, progress
    )
    _, freedom = coloured_covariance(trained.lines(), trained.problem.degrees_of_freedom)
    return replace(
        trained.estimate(z, covariance, freedom, {"weights": "free", "reading": network.reading}),
        trace=trace,
        begin=None,
    )


def _train(
    network: NetworkSettings,
    problem: NetworkProblem,
    coordinates: Coordinates,
    z: FloatArray,
    noise: FloatArray,
    bent: Bent | None,
    progress: Progress,
) -> Trace:
    args = (coordinates, problem, noise)
    if network.optimiser == "lm":
        return levenberg_marquardt(network_objective, z, args, tolerance=1e-6, progress=progress, bent=bent)
    from vibrident.estimators.adam import adam

    return adam(network_objective, z, args, learning_rate=network.learning_rate, steps=network.steps, progress=progress)


@dataclass(frozen=True, eq=False)
class _Trained:
    """The network at the optimum of equal weights for all samples of a record.

    Attributes:
        evidence: what it was trained on.
        problem: the records.
        coordinates: the map from z to parameters.
        z: the optimum, shape (p,).
        noise: standard deviation by which each record is weighted, shape (records,).
        trace: of the optimiser.
        begin: the way from the grid to the start values.
        settings: what was chosen.
    """

    evidence: Evidence
    problem: NetworkProblem
    coordinates: Coordinates
    z: FloatArray
    noise: FloatArray
    trace: Trace
    begin: Start
    settings: dict[str, Any]

    def lines(self) -> list[RecordLines]:
        """The records at the lines of their transforms, at the optimum."""
        return self.problem.lines(self.z, self.coordinates, self.noise)

    def estimate(self, z: FloatArray, covariance: FloatArray, freedom: float, more: dict[str, Any]) -> Estimate:
        """An estimate of this training."""
        return Estimate(
            NetworkSettings.name,
            self.coordinates,
            z,
            covariance,
            freedom,
            self.trace,
            self.settings | more,
            problem=self.problem,
            begin=self.begin,
            equations=float(np.sum(self.problem.degrees_of_freedom)),
            criterion="samples",
        )

    def with_equal_weights(self) -> Estimate:
        """As trained."""
        covariance, freedom = coloured_covariance(self.lines(), self.problem.degrees_of_freedom)
        return self._with_response(self.estimate(self.z, covariance, freedom, {"noise_weights": "white"}))

    def _with_response(self, found: Estimate) -> Estimate:
        return replace(found, predicted=tuple(self.problem.predict(self.coordinates, found.z)))

    def in_the_noise_found(self) -> Estimate:
        """The last step of training: every line of the residual weighted by its own noise, for linear models."""
        if not isinstance(self.problem, LineProblem):  # a nonlinear model has no residual line by line
            return self.with_equal_weights()
        at = (self.problem, self.coordinates, self.z, self.noise)
        two_modes = bool(self.coordinates.model.shares)  # they trade against each other along a curved valley
        bent = ValleySteps.of_records(self.evidence, self.coordinates, self.noise) if two_modes else None
        end = reweighted(*at, bent=bent)
        if end is None and two_modes:
            end = reweighted(*at, start=self.coordinates.place(self.begin.values), bent=bent)
        if end is None:
            return self.with_equal_weights()
        names = self.coordinates.model.parameter_names
        more: dict[str, Any] = {
            "noise_weights": "spectrum",
            "reference_noise_doubt": dict(zip(names, end.doubt.tolist(), strict=True)),
        }
        if np.any(end.reference_noise > 0):
            more["reference_noise"] = end.reference_noise.tolist()
        if any(end.hum_hz):
            more["hum_hz"] = [list(tones) for tones in end.hum_hz]
        found = self.estimate(end.z, end.covariance, end.degrees_of_freedom, more)
        return replace(self._with_response(found), if_rejected=self.with_equal_weights)


def _with_harmonic_start(problem: NetworkProblem, normal: Any, evidence: Evidence, z: FloatArray) -> FloatArray:
    from vibrident.estimators.harmonic_start import with_harmonic_start
    from vibrident.problem.time_domain import TimeProblem

    assert isinstance(problem, TimeProblem)
    return with_harmonic_start(problem, normal, evidence, z)
