"""The network, trained end to end on excitation and response in time: the paper's method, with its weak points mended.

Weights tied to the physics through the chosen discretisation, initial state and offset of every record found exactly,
each record weighted by its own noise. Trained by Levenberg–Marquardt, or by Adam as in the paper; Levenberg–Marquardt
is followed by steps that weigh every line of the residual by the noise found there, to maximum likelihood whatever the
noise (:mod:`vibrident.estimators.reweighting`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from vibrident.backend import jnp
from vibrident.discretize import method
from vibrident.errors import ModelError
from vibrident.estimators.base import Estimate
from vibrident.estimators.coloured import coloured_covariance
from vibrident.estimators.free import train_free
from vibrident.estimators.harmonic_start import with_harmonic_start
from vibrident.estimators.objectives import time_objective
from vibrident.estimators.optimise import Progress, Trace, adam, levenberg_marquardt, silent
from vibrident.estimators.reweighting import reweighted
from vibrident.estimators.start import Start, find_start
from vibrident.network.readback import Reading
from vibrident.network.sensitivity import Normal
from vibrident.problem import Coordinates, Evidence, TimeProblem
from vibrident.records import FloatArray

#: Rounds of training with refreshed noise weights and delay.
ROUNDS = 6
#: Relative change of the noise below which its weights need no further round.
NOISE_SETTLED = 1e-3
#: What the curve of a nonlinear model is.
SMALL_SIGNAL = (
    "of the linear part: what the response comes to for small signals; measured points are brought there by the network"
)


@dataclass(frozen=True)
class Ipnn:
    """Settings of the estimator ``ipnn``.

    Attributes:
        discretisation: euler | zoh | foh | tustin | bandlimited.
        optimiser: ``lm`` (Levenberg–Marquardt) or ``adam``.
        learning_rate: of Adam.
        steps: of Adam.
        weights: ``tied`` to the physics, or ``free`` and read back; see :mod:`vibrident.estimators.free`.
        reading: of free weights: ``eigenvalues``, or the paper's ``elements``.
    """

    discretisation: str = "bandlimited"
    optimiser: Literal["lm", "adam"] = "lm"
    learning_rate: float = 0.001
    steps: int = 1500
    weights: Literal["tied", "free"] = "tied"
    reading: Reading = "eigenvalues"
    name: str = "ipnn"

    def fit(self, evidence: Evidence, progress: Progress = silent) -> Estimate:
        """Train the network.

        Raises:
            ModelError: there are no records, or none with a reference.
            InputError: no record is long enough.
        """
        if not evidence.records or evidence.first_look is None:
            raise ModelError(
                "The network is trained on records with a reference.",
                expected="[[records]] with a reference channel",
                found="a table" if evidence.calibration.table is not None else "free decays only",
                where="estimator",
                remedy="use the estimator 'ml' for a table; add a record with a reference to free decays",
            )
        trained = self._trained(evidence, progress)
        if self.weights == "free":
            return self._freed(trained, progress)
        if self.optimiser == "adam" or not evidence.model.is_linear:  # a bent response has no lines of its own
            return trained.with_equal_weights()
        return trained.in_the_noise_found()

    def _trained(self, evidence: Evidence, progress: Progress) -> _Trained:
        assert evidence.first_look is not None
        begin = find_start(evidence.first_look, evidence.model)
        start = begin.values
        step = method(self.discretisation)
        problem = TimeProblem.build(evidence.records, evidence.model, step, evidence.quantity, start)
        coordinates = Coordinates.at(evidence.model, start, evidence.band_hz, problem.response_size)
        z = coordinates.first
        noise, trace = np.ones(len(evidence.records)), None
        for _ in range(ROUNDS):
            normal = time_objective(jnp.asarray(z), _args(problem, coordinates, noise))
            found = _record_noise(problem, np.asarray(normal.squares))
            if trace is not None and np.allclose(found, noise, rtol=NOISE_SETTLED, atol=0.0):
                break
            if trace is None and not evidence.model.is_linear:
                z = with_harmonic_start(problem, normal, evidence, z)
            noise = found
            trace = self._train(problem, coordinates, z, noise, progress)
            z = trace.last
            moved = problem.at_delay_of(coordinates.values(z))
            if moved is not problem:
                problem = moved
                noise = noise * (1.0 + 2.0 * NOISE_SETTLED)  # another round, with the inputs at the delay found
        assert trace is not None
        settings: dict[str, Any] = {
            "discretisation": self.discretisation,
            "optimiser": trace.optimiser,
            "inputs_per_step": problem.layout.terms,
            "noise": noise.tolist(),
        }
        if not evidence.model.is_linear:
            settings["response_curve"] = SMALL_SIGNAL
        return _Trained(problem, coordinates, z, noise, trace, begin, settings)

    def _freed(self, trained: _Trained, progress: Progress) -> Estimate:
        problem, noise = trained.problem, trained.noise
        z, covariance, trace, _ = train_free(problem, trained.coordinates, trained.z, noise, self.reading, progress)
        _, freedom = coloured_covariance(problem, trained.normal(trained.z), noise)
        more = {"weights": "free", "reading": self.reading}
        return replace(trained.estimate(z, covariance, freedom, more), trace=trace, begin=None)

    def _train(
        self, problem: TimeProblem, coordinates: Coordinates, z: FloatArray, noise: FloatArray, progress: Progress
    ) -> Trace:
        args = _args(problem, coordinates, noise)
        if self.optimiser == "adam":
            return adam(time_objective, z, args, learning_rate=self.learning_rate, steps=self.steps, progress=progress)
        return levenberg_marquardt(time_objective, z, args, tolerance=1e-6, progress=progress)


@dataclass(frozen=True, eq=False)
class _Trained:
    """The network at the optimum of equal weights for all samples of a record.

    Attributes:
        problem: the records.
        coordinates: the map from z to parameters.
        z: the optimum, shape (p,).
        noise: standard deviation by which each record is weighted, shape (records,).
        trace: of the optimiser.
        begin: the way from the grid to the start values.
        settings: what was chosen.
    """

    problem: TimeProblem
    coordinates: Coordinates
    z: FloatArray
    noise: FloatArray
    trace: Trace
    begin: Start
    settings: dict[str, Any]

    def normal(self, z: FloatArray) -> Normal:
        """The network and its normal equations at ``z``."""
        return time_objective(jnp.asarray(z), _args(self.problem, self.coordinates, self.noise))

    def estimate(
        self, z: FloatArray, covariance: FloatArray, freedom: float, more: dict[str, Any], normal: Normal | None = None
    ) -> Estimate:
        """An estimate of this training; with ``normal``, that at ``z``, it holds the predicted response."""
        return Estimate(
            "ipnn",
            self.coordinates,
            z,
            covariance,
            freedom,
            self.trace,
            self.settings | more,
            problem=self.problem,
            predicted=None if normal is None else tuple(self.problem.by_record(normal.response)),
            begin=self.begin,
            equations=float(np.sum(self.problem.degrees_of_freedom)),
        )

    def with_equal_weights(self) -> Estimate:
        """As trained."""
        normal = self.normal(self.z)
        covariance, freedom = coloured_covariance(self.problem, normal, self.noise)
        return self.estimate(self.z, covariance, freedom, {"noise_weights": "white"}, normal)

    def in_the_noise_found(self) -> Estimate:
        """The end of training: every line of the residual weighed by its own noise."""
        end = reweighted(self.normal, self.problem, self.coordinates, self.z, self.noise)
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
        found = self.estimate(end.z, end.covariance, end.degrees_of_freedom, more, end.normal)
        return replace(found, if_rejected=self.with_equal_weights)


def _args(problem: TimeProblem, coordinates: Coordinates, noise: FloatArray) -> tuple[Any, ...]:
    return coordinates, problem.layout, problem.data, jnp.asarray(problem.by_lane(noise))


def _record_noise(problem: TimeProblem, squares: FloatArray) -> FloatArray:
    """Standard deviation of each record's residual, shape (records,), from the sums of squares of the segments."""
    count = len(problem.records)
    squares = squares[: len(problem.record_of_segment)]  # segments beyond are padding
    totals = np.bincount(problem.record_of_segment, weights=squares, minlength=count)
    estimate = np.sqrt(totals / np.maximum(problem.degrees_of_freedom, 1.0))
    return np.maximum(estimate, problem.noise_floor)
