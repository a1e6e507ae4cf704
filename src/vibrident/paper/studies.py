"""Run three studies that the paper lacks: errors by sampling rate and noise, learned residuals.

The learned part beside the physics (the paper's discussion, II) is trained on sensors of known
truth: with a second mode, with a hardening spring, and without any further effect.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.base.errors import NotConverged
from vibrident.data.records import Calibration
from vibrident.fit.descent.settle import Objective
from vibrident.fit.estimators import Estimator, Ipnn, MaximumLikelihood
from vibrident.fit.estimators.residual_network import ResidualIpnn
from vibrident.fit.optimise import Progress, levenberg_marquardt, silent
from vibrident.fit.problem import BinProblem, Coordinates
from vibrident.paper.bound import Bound, cramer_rao
from vibrident.paper.dataset import SENSOR, Dataset
from vibrident.paper.estimators.lsm import LeastSquares
from vibrident.paper.least_squares import from_sine_fits
from vibrident.paper.metrics import curve_deviation, resonance_hz
from vibrident.paper.unrolled import START
from vibrident.physics.discretisation import method
from vibrident.physics.models import parse
from vibrident.physics.simulation import SENSORS, simulate, with_noise
from vibrident.use.identification import identify
from vibrident.use.prediction import predict

BAND_HZ = (10.0, 1000.0)
#: Motions of the study of rates: the same at every rate, so the excitation's noise ends below half
#: the lowest rate.
RATE_FREQUENCIES_HZ = (10.0, 31.6227766, 100.0, 251.188643, 501.187234, 630.957344, 1000.0)
RATE_DURATION_S = 0.16
#: Highest frequency of the excitation's noise.
RATE_NOISE_HZ = 4000.0
PARAMETERS = ("sensitivity", "natural_frequency", "damping_ratio")
#: Start of the search for the optimum.
NEAR = {name: SENSOR.parameters[name] * START[name] for name in PARAMETERS}


@dataclass(frozen=True)
class RatePoint:
    """Errors of a discretisation at a sampling rate; None where the network is unstable.

    Attributes:
        discretisation: its name.
        rate_hz: sampling rate.
        errors: relative error by parameter, the resonance frequency among them.
        mean_percent: mean deviation of the curve.
        peak_percent: its signed deviation at the true resonance.
    """

    discretisation: str
    rate_hz: float
    errors: Mapping[str, float] | None
    mean_percent: float | None
    peak_percent: float | None


def error_by_rate(
    rates_hz: Sequence[float],
    discretisations: Sequence[str],
    *,
    seed: int,
    progress: Progress = silent,
) -> list[RatePoint]:
    """Return the errors at the optimum of the mean squared error, for each discretisation and rate.

    The exact motion is the same at every rate.
    """
    points = []
    for rate in rates_hz:
        calibration = simulate(
            SENSOR,
            "sine",
            frequencies_hz=RATE_FREQUENCIES_HZ,
            sampling_rate_hz=rate,
            samples=round(RATE_DURATION_S * rate),
            excitation_snr_db=20.0,
            excitation_noise_band_hz=(0.0, RATE_NOISE_HZ),
            seed=seed,
        )
        for name in discretisations:
            points.append(_at_rate(calibration, name, rate))
            progress(
                len(points), len(rates_hz) * len(discretisations), points[-1].mean_percent or np.nan
            )
    return points


def _at_rate(calibration: Calibration, name: str, rate: float) -> RatePoint:
    try:
        parameters = optimum(calibration, name, NEAR)
    except NotConverged:
        return RatePoint(name, rate, None, None, None)
    deviation = curve_deviation(parse(SENSOR.model), parameters, SENSOR.parameters, BAND_HZ)
    return RatePoint(name, rate, relative_errors(parameters), deviation.mean, deviation.at_peak)


def optimum(
    calibration: Calibration, discretisation: str, near: Mapping[str, float]
) -> dict[str, float]:
    """Return the parameters of least mean squared error under a discretisation, from ``near``.

    Adam comes near this optimum; Levenberg–Marquardt reaches it, so that the remaining error is the
    discretisation's, not the optimiser's. Initial state and offset of each record are eliminated;
    records are not weighted.

    Raises:
        NotConverged: the network is unstable there.
    """
    model = parse(calibration.model)
    frequencies = [
        record.frequency_hz or record.sampling_rate_hz / 4.0 for record in calibration.records
    ]
    coordinates = Coordinates.at(model, near, (min(frequencies), max(frequencies)))
    start = {name: float(near[name]) for name in model.parameter_names}
    problem = BinProblem.build(
        calibration.records, model, method(discretisation), calibration.quantity, start
    )
    variance = float(np.mean([np.var(record.response) for record in calibration.records]))
    objective = Objective.plain(problem, coordinates, np.full(len(problem.records), variance))
    trace = levenberg_marquardt(objective, coordinates.first, None, tolerance=1e-9)
    return coordinates.values(trace.last)


def relative_errors(estimate: Mapping[str, float]) -> dict[str, float]:
    """Return the relative errors of the parameters and of the resonance frequency, if any."""
    errors = {name: float(estimate[name] / SENSOR.parameters[name] - 1.0) for name in PARAMETERS}
    peak, true_peak = (
        resonance_hz(parse(SENSOR.model), values) for values in (estimate, SENSOR.parameters)
    )
    if peak is not None and true_peak is not None:
        errors["resonance_frequency"] = peak / true_peak - 1.0
    return errors


def _parameters_by(estimator: Estimator) -> Callable[[Calibration], dict[str, float]]:
    """Return a function from a calibration to the parameters that an estimator gives."""

    def parameters(calibration: Calibration) -> dict[str, float]:
        result = identify(calibration, SENSOR.model, estimator, uncertainty="noise")
        return {name: float(result.parameters[name].value) for name in PARAMETERS}

    return parameters


#: The methods that give parameters, the paper's and the package's.
NOISE_METHODS: Mapping[str, Callable[[Calibration], dict[str, float]]] = {
    "IPNN, Euler (as published)": lambda calibration: optimum(calibration, "euler", NEAR),
    "IPNN, exact weights": _parameters_by(Ipnn()),
    "LSM, plain": from_sine_fits,
    "LSM, weighted": _parameters_by(LeastSquares()),
    "ML in frequency": _parameters_by(MaximumLikelihood()),
}


@dataclass(frozen=True)
class NoisePoint:
    """Errors of a method at a level of white response noise, over the draws.

    Attributes:
        method: its name.
        level: noise as a fraction of each record's rms.
        rms_error: root mean square of the relative error by parameter.
        mean_percent: mean over band and draws of the curve's absolute deviation.
        largest_percent: mean over the draws of its largest absolute deviation.
    """

    method: str
    level: float
    rms_error: Mapping[str, float]
    mean_percent: float
    largest_percent: float


@dataclass(frozen=True, eq=False)
class NoiseStudy:
    """Errors of all methods at all levels, and the bound.

    Attributes:
        points: errors.
        bound: of the training records.
        bound_mean_percent: mean over the band of the least standard deviation of the curve at level
            1, %.
        draws: realisations at each level.
    """

    points: tuple[NoisePoint, ...]
    bound: Bound
    bound_mean_percent: float
    draws: int

    def over_bound(self, method: str, level: float) -> dict[str, float]:
        """Return the RMS error over the bound's standard deviation, by parameter."""
        point = next(p for p in self.points if p.method == method and p.level == level)
        least = self.bound.deviations(level)
        return {name: point.rms_error[name] / least[name] for name in PARAMETERS}


def error_by_noise(
    dataset: Dataset, levels: Sequence[float], draws: int, *, seed: int, progress: Progress = silent
) -> NoiseStudy:
    """Return the errors of every method on the training records with white response noise.

    ``draws``: realisations at every level.
    """
    truth = dataset.training_calibration
    motions = [dataset.motions[i] for i in dataset.training]
    bound = cramer_rao(SENSOR, truth.records, motions)
    points = []
    for number, level in enumerate(levels):
        seeds = (np.random.SeedSequence([seed, number, draw]) for draw in range(draws))
        noisy = [with_noise(truth, response_noise=level, seed=draw_seed) for draw_seed in seeds]
        for name, estimate in NOISE_METHODS.items():
            points.append(_noise_point(name, level, [estimate(draw) for draw in noisy]))
            progress(len(points), len(levels) * len(NOISE_METHODS), points[-1].mean_percent)
    curve = bound.curve_percent(parse(SENSOR.model), dict(SENSOR.parameters), BAND_HZ)
    # A normal deviate's absolute value has the mean √(2/π) of its standard deviation.
    bound_mean_percent = float(np.sqrt(2.0 / np.pi) * np.mean(curve))
    return NoiseStudy(tuple(points), bound, bound_mean_percent, draws)


def _noise_point(name: str, level: float, estimates: Sequence[Mapping[str, float]]) -> NoisePoint:
    """Return the errors of a method's estimates, one a draw."""
    model = parse(SENSOR.model)
    errors = [relative_errors(estimate) for estimate in estimates]
    curves = [
        curve_deviation(model, estimate, SENSOR.parameters, BAND_HZ) for estimate in estimates
    ]
    return NoisePoint(
        name,
        level,
        {p: float(np.sqrt(np.mean([error[p] ** 2 for error in errors]))) for p in PARAMETERS},
        float(np.mean([curve.mean for curve in curves])),
        float(np.mean([curve.largest for curve in curves])),
    )


RESIDUAL_RATE_HZ = 12800.0
RESIDUAL_SAMPLES = 800
#: Noise of the responses that are trained on, over their rms.
RESIDUAL_NOISE = 1e-3
#: Frequencies trained on, and others that are predicted.
TRAINED_HZ = (60.0, 125.0, 250.0, 315.0, 400.0, 500.0, 630.0, 800.0, 1000.0)
OTHER_HZ = (80.0, 200.0, 280.0, 450.0, 560.0, 700.0, 900.0, 100.0, 160.0)
RESIDUAL_SENSORS = ("two-mode", "cubic", "paper")


@dataclass(frozen=True)
class Residual:
    """Errors on a sensor, without and with the learned part.

    Attributes:
        sensor: its name among the simulated sensors.
        alone: RMSE on records not trained on, noise-free, by the physics alone, response unit.
        together: the same with the learned part.
        share: of the learned part in the output, in the training records.
        errors_alone: relative error by parameter, physics alone.
        errors: relative error by parameter, with the learned part.
        moved: largest relative difference of a parameter between the two.
    """

    sensor: str
    alone: float
    together: float
    share: float
    errors_alone: dict[str, float]
    errors: dict[str, float]
    moved: float


def learned_residuals(*, seed: int, progress: Progress = silent) -> list[Residual]:
    """Return the errors on every sensor of ``RESIDUAL_SENSORS``, trained with 0.1 % noise."""
    residuals = []
    for number, name in enumerate(RESIDUAL_SENSORS, start=1):
        residuals.append(_learned_residual(name, seed))
        progress(number, len(RESIDUAL_SENSORS), residuals[-1].together)
    return residuals


def _learned_residual(name: str, seed: int) -> Residual:
    """Train with and without the learned part on a sensor, and predict other records of it."""
    common = {"sampling_rate_hz": RESIDUAL_RATE_HZ, "samples": RESIDUAL_SAMPLES, "seed": seed}
    trained = simulate(name, frequencies_hz=TRAINED_HZ, response_noise=RESIDUAL_NOISE, **common)
    untrained = simulate(name, frequencies_hz=OTHER_HZ, **common)
    plain, learned = (
        identify(trained, "accelerometer", estimator, uncertainty="noise")
        for estimator in (Ipnn(), ResidualIpnn())
    )
    truth = SENSORS[name].parameters
    values = [
        {p: float(result.parameters[p].value) for p in PARAMETERS} for result in (plain, learned)
    ]
    errors = [{p: estimate[p] / truth[p] - 1.0 for p in PARAMETERS} for estimate in values]
    return Residual(
        name,
        float(predict(plain, untrained).rmse or 0.0),
        float(predict(learned, untrained).rmse or 0.0),
        float(learned.settings["residual_network"]["share"]),
        errors[0],
        errors[1],
        max(abs(values[1][p] / values[0][p] - 1.0) for p in PARAMETERS),
    )
