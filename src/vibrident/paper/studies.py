"""Three studies that the paper lacks: error against sampling rate, error against noise with its lower bound, and a
learned part beside the physics (its discussion, II), trained on sensors of known truth: with a
second mode, with a hardening spring, and without any further effect.

The bound is the Cramér–Rao bound of a simulated calibration: no unbiased estimator has a smaller
variance. Fisher information Σ JᵀJ/σ², J from central differences of the exact response to the true
motion, with the unknown initial state and offset of each record projected out. It is independent of
the estimators and their uncertainties.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.base.errors import NotConverged
from vibrident.data.records import Calibration, FloatArray, Record
from vibrident.fit.descent.settle import Objective
from vibrident.fit.estimators import Estimator, Ipnn, MaximumLikelihood
from vibrident.fit.estimators.residual_network import ResidualIpnn
from vibrident.fit.optimise import Progress, levenberg_marquardt, silent
from vibrident.fit.problem import BinProblem, Coordinates
from vibrident.paper.dataset import SENSOR, Dataset
from vibrident.paper.estimators.lsm import LeastSquares
from vibrident.paper.least_squares import from_sine_fits
from vibrident.paper.metrics import CURVE_POINTS, curve_deviation, resonance_hz
from vibrident.paper.unrolled import START
from vibrident.physics.discretisation import method
from vibrident.physics.models import SensorModel, parse
from vibrident.physics.simulation import (
    SENSORS,
    Motion,
    Sensor,
    exact_response,
    simulate,
    with_noise,
)
from vibrident.use.identification import identify
from vibrident.use.prediction import predict

BAND_HZ = (10.0, 1000.0)
#: Motions of the study of rates: the same at every rate, so the excitation's noise ends below half
#: the lowest rate.
RATE_FREQUENCIES_HZ = (10.0, 31.6227766, 100.0, 251.188643, 501.187234, 630.957344, 1000.0)
RATE_DURATION_S = 0.16
RATE_NOISE_HZ = 4000.0  # highest frequency of the excitation's noise
PARAMETERS = ("sensitivity", "natural_frequency", "damping_ratio")
#: Start of the search for the optimum.
NEAR = {name: SENSOR.parameters[name] * START[name] for name in PARAMETERS}


@dataclass(frozen=True)
class RatePoint:
    """One discretisation at one sampling rate; the values are None if the network is unstable."""

    discretisation: str  # its name
    rate_hz: float  # sampling rate
    # Relative error by parameter, the resonance frequency among them.
    errors: Mapping[str, float] | None
    mean_percent: float | None  # mean deviation of the curve
    peak_percent: float | None  # its signed deviation at the true resonance


def error_by_rate(
    rates_hz: Sequence[float],
    discretisations: Sequence[str],
    *,
    seed: int,
    progress: Progress = silent,
) -> list[RatePoint]:
    """Optimum of the plain mean squared error for each discretisation, on the same exact motion at every rate."""
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
        found = optimum(calibration, name, NEAR)
    except NotConverged:
        return RatePoint(name, rate, None, None, None)
    deviation = curve_deviation(parse(SENSOR.model), found, SENSOR.parameters, BAND_HZ)
    return RatePoint(name, rate, relative_errors(found), deviation.mean, deviation.at_peak)


def optimum(
    calibration: Calibration, discretisation: str, near: Mapping[str, float]
) -> dict[str, float]:
    """Return the parameters of least plain mean squared error for any discretisation, sought from ``near``.

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


def relative_errors(found: Mapping[str, float]) -> dict[str, float]:
    """Relative error of the estimated parameters and of the resonance frequency, if there is one."""
    errors = {name: float(found[name] / SENSOR.parameters[name] - 1.0) for name in PARAMETERS}
    peak, true_peak = (
        resonance_hz(parse(SENSOR.model), values) for values in (found, SENSOR.parameters)
    )
    if peak is not None and true_peak is not None:
        errors["resonance_frequency"] = peak / true_peak - 1.0
    return errors


def _by(estimator: Estimator) -> Callable[[Calibration], dict[str, float]]:
    def found(calibration: Calibration) -> dict[str, float]:
        result = identify(calibration, SENSOR.model, estimator, uncertainty="noise")
        return {name: float(result.parameters[name].value) for name in PARAMETERS}

    return found


#: The methods that give parameters, the paper's and the package's.
NOISE_METHODS: Mapping[str, Callable[[Calibration], dict[str, float]]] = {
    "IPNN, Euler (as published)": lambda calibration: optimum(calibration, "euler", NEAR),
    "IPNN, exact weights": _by(Ipnn()),
    "LSM, plain": from_sine_fits,
    "LSM, weighted": _by(LeastSquares()),
    "ML in frequency": _by(MaximumLikelihood()),
}


@dataclass(frozen=True)
class NoisePoint:
    """One method at one level of white response noise: errors over the draws."""

    method: str  # its name
    level: float  # noise as a fraction of each record's rms
    rms_error: Mapping[str, float]  # root mean square of the relative error by parameter
    mean_percent: float  # mean over band and draws of the curve's absolute deviation
    largest_percent: float  # mean over the draws of its largest absolute deviation


@dataclass(frozen=True, eq=False)
class NoiseStudy:
    """All methods at all levels, and the bound."""

    points: tuple[NoisePoint, ...]  # errors
    bound: Bound  # of the training records
    # Mean over the band of the least standard deviation of the curve at level 1, %.
    bound_mean_percent: float
    draws: int  # realisations at each level

    def over_bound(self, method: str, level: float) -> dict[str, float]:
        """RMS error over the bound's standard deviation, by parameter."""
        point = next(p for p in self.points if p.method == method and p.level == level)
        least = self.bound.deviations(level)
        return {name: point.rms_error[name] / least[name] for name in PARAMETERS}


def error_by_noise(
    dataset: Dataset, levels: Sequence[float], draws: int, *, seed: int, progress: Progress = silent
) -> NoiseStudy:
    """Return every method on the training records with white noise on the response, ``draws`` times at every level."""
    truth = dataset.training_calibration
    motions = [dataset.motions[i] for i in dataset.training]
    bound = cramer_rao(SENSOR, truth.records, motions)
    model = parse(SENSOR.model)
    points = []
    for number, level in enumerate(levels):
        noisy = [
            with_noise(
                truth, response_noise=level, seed=np.random.SeedSequence([seed, number, draw])
            )
            for draw in range(draws)
        ]
        for name, found_by in NOISE_METHODS.items():
            found = [found_by(calibration) for calibration in noisy]
            errors = [relative_errors(values) for values in found]
            curves = [
                curve_deviation(model, values, SENSOR.parameters, BAND_HZ) for values in found
            ]
            rms = {
                p: float(np.sqrt(np.mean([error[p] ** 2 for error in errors]))) for p in PARAMETERS
            }
            points.append(
                NoisePoint(
                    name,
                    level,
                    rms,
                    float(np.mean([curve.mean for curve in curves])),
                    float(np.mean([curve.largest for curve in curves])),
                )
            )
            progress(len(points), len(levels) * len(NOISE_METHODS), points[-1].mean_percent)
    # A normal deviate's absolute value has the mean √(2/π) of its standard deviation.
    mean = float(
        np.sqrt(2.0 / np.pi) * np.mean(bound.curve_percent(model, dict(SENSOR.parameters), BAND_HZ))
    )
    return NoiseStudy(tuple(points), bound, mean, draws)


RESIDUAL_RATE_HZ = 12800.0
RESIDUAL_SAMPLES = 800
RESIDUAL_NOISE = 1e-3  # of the responses that are trained on, over their rms
#: Frequencies trained on, and others that are predicted.
TRAINED_HZ = (60.0, 125.0, 250.0, 315.0, 400.0, 500.0, 630.0, 800.0, 1000.0)
OTHER_HZ = (80.0, 200.0, 280.0, 450.0, 560.0, 700.0, 900.0, 100.0, 160.0)
RESIDUAL_SENSORS = ("two-mode", "cubic", "paper")


@dataclass(frozen=True)
class Residual:
    """One sensor, without and with the learned part."""

    sensor: str  # its name among the simulated sensors
    alone: float  # RMSE on records not trained on, noise-free, by the physics alone, response unit
    together: float  # the same with the learned part
    share: float  # of the learned part in the output, in the training records
    errors_alone: dict[str, float]  # relative error by parameter, physics alone
    errors: dict[str, float]  # relative error by parameter, with the learned part
    moved: float  # largest relative difference of a parameter between the two


def learned_residuals(*, seed: int, progress: Progress = silent) -> list[Residual]:
    """Return every sensor of ``RESIDUAL_SENSORS``, 0.1 % noise on the responses trained on."""
    found = []
    for number, name in enumerate(RESIDUAL_SENSORS, start=1):
        found.append(_of(name, seed))
        progress(number, len(RESIDUAL_SENSORS), found[-1].together)
    return found


def _of(name: str, seed: int) -> Residual:
    common = {"sampling_rate_hz": RESIDUAL_RATE_HZ, "samples": RESIDUAL_SAMPLES, "seed": seed}
    trained = simulate(name, frequencies_hz=TRAINED_HZ, response_noise=RESIDUAL_NOISE, **common)
    others = simulate(name, frequencies_hz=OTHER_HZ, **common)
    plain, whole = (
        identify(trained, "accelerometer", estimator, uncertainty="noise")
        for estimator in (Ipnn(), ResidualIpnn())
    )
    truth = SENSORS[name].parameters
    values = [
        {p: float(result.parameters[p].value) for p in PARAMETERS} for result in (plain, whole)
    ]
    errors = [{p: found[p] / truth[p] - 1.0 for p in PARAMETERS} for found in values]
    return Residual(
        name,
        float(predict(plain, others).rmse or 0.0),
        float(predict(whole, others).rmse or 0.0),
        float(whole.settings["residual_network"]["share"]),
        errors[0],
        errors[1],
        max(abs(values[1][p] / values[0][p] - 1.0) for p in PARAMETERS),
    )


_STEP = 1e-5  # relative step of the differences


@dataclass(frozen=True, eq=False)
class Bound:
    """Least covariance of the parameters, relative to their values, at white response noise of a relative level."""

    names: tuple[str, ...]  # of the parameters
    # Shape (parameters, parameters), relative, at noise of the response's own rms (level 1).
    covariance: FloatArray

    def deviations(self, level: float) -> dict[str, float]:
        """Least relative standard deviation of each parameter at noise of ``level`` times each record's rms."""
        return dict(
            zip(self.names, (level * np.sqrt(np.diag(self.covariance))).tolist(), strict=True)
        )

    def curve_percent(
        self, model: SensorModel, truth: dict[str, float], band_hz: tuple[float, float]
    ) -> FloatArray:
        """Least standard deviation of the curve's magnitude at level 1, %, at the points of a curve over the band."""
        frequency = np.geomspace(*band_hz, CURVE_POINTS)

        def size(name: str, factor: float) -> FloatArray:
            return np.log(
                np.abs(model.frequency_response({**truth, name: truth[name] * factor}, frequency))
            )

        slopes = [
            (size(name, 1.0 + _STEP) - size(name, 1.0 - _STEP)) / (2.0 * _STEP)
            for name in self.names
        ]
        slope = np.stack(slopes, axis=1)
        return 100.0 * np.sqrt(np.einsum("pi,ij,pj->p", slope, self.covariance, slope))


def cramer_rao(sensor: Sensor, records: Sequence[Record], motions: Sequence[Motion]) -> Bound:
    """Return the bound for records of an underdamped second-order sensor that start from rest."""
    names = tuple(spec.name for spec in parse(sensor.model).parameters)
    information = np.zeros((len(names), len(names)))
    for record, motion in zip(records, motions, strict=True):
        columns = np.stack([_slope(sensor, name, record, motion) for name in names], axis=1)
        free = _imitable(sensor, record)
        columns -= free @ (free.T @ columns)
        information += columns.T @ columns / np.mean(np.square(record.response))
    scale = np.sqrt(np.diag(information))
    covariance = np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)
    return Bound(names, covariance)


def _slope(sensor: Sensor, name: str, record: Record, motion: Motion) -> FloatArray:
    """Change of the response per relative change of a parameter, shape (samples,)."""
    up, down = (
        exact_response(
            parse(sensor.model),
            {**sensor.parameters, name: sensor.parameters[name] * factor},
            motion,
            sampling_rate_hz=record.sampling_rate_hz,
            samples=record.samples,
        )
        for factor in (1.0 + _STEP, 1.0 - _STEP)
    )
    return (up - down) / (2.0 * _STEP)


def _imitable(sensor: Sensor, record: Record) -> FloatArray:
    """Orthonormal columns of the responses to initial state and offset, shape (samples, 3)."""
    natural = 2.0 * np.pi * sensor.parameters["natural_frequency"]
    damping = sensor.parameters["damping_ratio"]
    pole = natural * (-damping + 1j * np.sqrt(1.0 - damping**2))
    free = np.exp(pole * record.time_s)
    return np.linalg.qr(np.stack([free.real, free.imag, np.ones(record.samples)], axis=1))[0]
