"""The network, trained end to end on excitation and response in time: the paper's method, with its weak points mended.

Weights tied to the physics through the chosen discretisation, initial state and offset of every record found exactly,
each record weighted by its own noise. Trained by Levenberg–Marquardt, or by Adam as in the paper; Levenberg–Marquardt
is followed by steps that weigh every line of the residual by the noise found there, to maximum likelihood whatever the
noise (:mod:`vibrident.estimators.reweighting`).
"""

from __future__ import annotations

from dataclasses import dataclass
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
from vibrident.estimators.reweighting import Reweighted, reweighted
from vibrident.estimators.start import find_start
from vibrident.network.readback import Reading
from vibrident.network.sensitivity import Normal
from vibrident.problem import Coordinates, Evidence, TimeProblem
from vibrident.records import FloatArray

#: Rounds of training with refreshed noise weights and delay.
ROUNDS = 6
#: Noise below this part of a record's response is not believed: rounding and interpolation lie there.
LEAST_NOISE = 1e-7
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
        begin = find_start(evidence.first_look, evidence.model)
        start = begin.values
        step = method(self.discretisation)
        problem = TimeProblem.build(evidence.records, evidence.model, step, evidence.quantity, start)
        coordinates = Coordinates.at(evidence.model, start, evidence.band_hz, problem.response_size)
        z = coordinates.first
        noise, trace = np.ones(len(evidence.records)), None
        for _ in range(ROUNDS):
            normal = time_objective(jnp.asarray(z), self._args(problem, coordinates, noise))
            found = _record_noise(problem, np.asarray(normal.squares))
            if trace is not None and np.allclose(found, noise, rtol=NOISE_SETTLED):
                break
            if trace is None and not evidence.model.is_linear:
                z = with_harmonic_start(problem, normal, evidence, z)
            noise = found
            trace = self._train(problem, coordinates, z, noise, progress)
            z = trace.last
            values = coordinates.values(z)
            if _delay_moved(problem, values):
                problem = TimeProblem.build(evidence.records, evidence.model, step, evidence.quantity, values)
                noise = noise * (1.0 + 2.0 * NOISE_SETTLED)  # another round, with the inputs at the delay found
        else:
            normal = time_objective(jnp.asarray(z), self._args(problem, coordinates, noise))
        assert trace is not None
        settings = {
            "discretisation": self.discretisation,
            "optimiser": trace.optimiser,
            "inputs_per_step": problem.layout.terms,
            "noise": noise.tolist(),
        }
        if not evidence.model.is_linear:
            settings["response_curve"] = SMALL_SIGNAL
        equations = float(np.sum(problem.degrees_of_freedom))
        if self.weights == "free":
            z, covariance, trace, _ = train_free(problem, coordinates, z, noise, self.reading, progress)
            freedom = coloured_covariance(problem, normal, noise, noise_floor(problem))[1]
            settings |= {"weights": "free", "reading": self.reading}
            return Estimate(
                "ipnn", coordinates, z, covariance, freedom, trace, settings, problem=problem, equations=equations
            )
        end = self._in_the_noise_found(problem, coordinates, z, noise)
        settings["noise_weights"] = "white" if end is None else "spectrum"
        if end is None:
            covariance, freedom = coloured_covariance(problem, normal, noise, noise_floor(problem))
        else:
            z, covariance, freedom, normal = end.z, end.covariance, end.degrees_of_freedom, end.normal
            doubt = end.doubt / np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
            settings["reference_noise_doubt"] = dict(zip(evidence.model.parameter_names, doubt.tolist(), strict=True))
            if np.any(end.reference_noise > 0):
                settings["reference_noise"] = end.reference_noise.tolist()
            if any(end.hum_hz):
                settings["hum_hz"] = [list(tones) for tones in end.hum_hz]
        return Estimate(
            "ipnn",
            coordinates,
            z,
            covariance,
            freedom,
            trace,
            settings,
            problem=problem,
            predicted=tuple(problem.by_record(normal.response)),
            begin=begin,
            equations=equations,
        )

    def _in_the_noise_found(
        self, problem: TimeProblem, coordinates: Coordinates, z: FloatArray, noise: FloatArray
    ) -> Reweighted | None:
        """The end of training; None for a nonlinear model, whose response has no lines of its own, and for Adam."""
        if self.optimiser == "adam" or not problem.layout.model.is_linear:
            return None

        def evaluate(z: FloatArray) -> Normal:
            return time_objective(jnp.asarray(z), self._args(problem, coordinates, noise))

        return reweighted(evaluate, problem, coordinates, z, noise, noise_floor(problem))

    def _args(self, problem: TimeProblem, coordinates: Coordinates, noise: FloatArray) -> tuple[Any, ...]:
        return coordinates, problem.layout, problem.data, jnp.asarray(problem.by_lane(noise))

    def _train(
        self, problem: TimeProblem, coordinates: Coordinates, z: FloatArray, noise: FloatArray, progress: Progress
    ) -> Trace:
        args = self._args(problem, coordinates, noise)
        if self.optimiser == "adam":
            return adam(time_objective, z, args, learning_rate=self.learning_rate, steps=self.steps, progress=progress)
        return levenberg_marquardt(time_objective, z, args, tolerance=1e-6, progress=progress)


def _record_noise(problem: TimeProblem, squares: FloatArray) -> FloatArray:
    """Standard deviation of each record's residual, shape (records,), from the sums of squares of the segments."""
    count = len(problem.records)
    squares = squares[: len(problem.record_of_segment)]  # segments beyond are padding
    totals = np.bincount(problem.record_of_segment, weights=squares, minlength=count)
    estimate = np.sqrt(totals / np.maximum(problem.degrees_of_freedom, 1.0))
    return np.maximum(estimate, noise_floor(problem))


def noise_floor(problem: TimeProblem) -> FloatArray:
    """Least noise believed of each record, shape (records,)."""
    floor = np.array([LEAST_NOISE * float(np.std(r.response[r.mask])) for r in problem.records])
    return np.maximum(floor, np.finfo(float).tiny)


def _delay_moved(problem: TimeProblem, values: dict[str, float]) -> bool:
    """Whether the inputs were interpolated at another delay than is now estimated, by more than 1e-3 of a sample."""
    moved = abs(values.get("delay", 0.0) - problem.delay_s)
    return bool(moved > 1e-3 * np.min(problem.intervals_s))
