"""Joint descent of many candidates on one residual, in NumPy: cheap enough to search everywhere.

The search works on the response at a few hundred points at most, in coordinates of its own:
logarithms of what is positive (frequencies, damping ratios, durations, the gain's size), and the
delay in radians at the highest frequency. Three residuals follow one another. The logarithm of the
magnitude does not depend on delay and sign, and has hardly any dead ends: off a sharp resonance it
still points towards the resonance. The complex logarithm adds the phase. Finally the weighted
difference is used, which the estimators minimise.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import BoolArray, FloatArray, Quantity
from vibrident.fit.problem.coordinates import MAX_EXPONENT, ends_of
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import median
from vibrident.physics.models import ParameterSpec, SensorModel
from vibrident.physics.models.slopes import response_and_slopes

#: Initial damping of Levenberg–Marquardt.
DAMPING = 1e-2
#: Largest change of a coordinate in a step.
MAX_STEP = 0.7
#: Lower limit of positive parameters, in their unit.
MIN_POSITIVE = 1e-9

#: Residual of the responses of candidates, (C, n) → (C, m), and its derivative, (C, P, n) → (C, P,
#: m), given ∂ log H.
Residual = Callable[[ComplexArray, ComplexArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True, eq=False)
class TargetFRF:
    """Response to be fitted, at n points.

    Attributes:
        frequency_hz: shape (n,).
        response: measured complex sensitivity, real and positive where the phase is not known,
            shape (n,).
        deviation: relative standard deviation of the magnitude, shape (n,).
        phase_deviation: of the phase, rad, shape (n,).
        has_phase: whether the phase is known.
        polar: whether the deviations belong to magnitude and phase, not to real and imaginary part.
    """

    frequency_hz: FloatArray
    response: ComplexArray
    deviation: FloatArray
    phase_deviation: FloatArray
    has_phase: bool
    polar: bool

    def at(self, points: np.ndarray) -> TargetFRF:
        """Return the points at these indices."""
        return replace(
            self,
            frequency_hz=self.frequency_hz[points],
            response=self.response[points],
            deviation=self.deviation[points],
            phase_deviation=self.phase_deviation[points],
        )

    def few(self, most: int) -> TargetFRF:
        """Return at most so many of the points, evenly through their order by frequency."""
        if self.frequency_hz.size <= most:
            return self
        order = np.argsort(self.frequency_hz, kind="stable")
        return self.at(order[np.linspace(0, order.size - 1, most).astype(int)])

    def scaled(self, factor: float) -> TargetFRF:
        """Return the same points with deviations so many times as large."""
        return replace(
            self, deviation=self.deviation * factor, phase_deviation=self.phase_deviation * factor
        )


@dataclass(frozen=True, eq=False)
class LogCoordinates:
    """Coordinates of the search, shape (C, P) for C candidates, and the responses there.

    Attributes:
        model: a linear model.
        quantity: of the reference.
        frequency_hz: of the points, shape (n,).
        time_unit_s: unit of a delay.
    """

    model: SensorModel
    quantity: Quantity
    frequency_hz: FloatArray
    time_unit_s: float

    def at(self, sought: TargetFRF) -> LogCoordinates:
        """Return the same coordinates at the points of a response."""
        return replace(self, frequency_hz=sought.frequency_hz)

    @functools.cached_property
    def band_hz(self) -> tuple[float, float]:
        """Return the lowest and highest frequency of the points."""
        return float(np.min(self.frequency_hz)), float(np.max(self.frequency_hz))

    @functools.cached_property
    def ends(self) -> list[tuple[float, float] | None]:
        """Return the lowest and highest value of each parameter that is searched; None: open."""
        return [ends_of(spec, self.band_hz) for spec in self.model.parameters]

    def values(self, u: FloatArray, sign: FloatArray) -> dict[str, FloatArray]:
        """Return the physical values by name, each of shape (C, 1), within the range searched.

        Outside, other parameters would compensate for one that is later brought back, and could not
        follow.
        """
        values = {}
        exponentials = np.exp(np.minimum(np.maximum(u, -MAX_EXPONENT), MAX_EXPONENT))
        for index, spec in enumerate(self.model.parameters):
            if spec.kind == "gain":
                value = sign[:, None] * exponentials[:, index, None]
            elif spec.kind in ("log", "duration", "positive"):
                value = exponentials[:, index, None]
            else:
                unit = self.time_unit_s if spec.kind == "time" else spec.size
                value = u[:, index, None] * unit
            ends = self.ends[index]
            values[spec.name] = (
                value if ends is None else np.minimum(np.maximum(value, ends[0]), ends[1])
            )
        return values

    def place(self, values: dict[str, float]) -> tuple[FloatArray, float]:
        """Return the coordinates of physical values, shape (P,), and the sign of the gain."""
        specs = self.model.parameters
        negative = any(spec.kind == "gain" and values[spec.name] < 0.0 for spec in specs)
        return np.array(
            [float(self.coordinate(spec, values[spec.name])) for spec in specs]
        ), -1.0 if negative else 1.0

    def coordinate(self, spec: ParameterSpec, value: float | FloatArray) -> FloatArray:
        """Return the coordinates of values of a parameter, in their shape."""
        if spec.kind in ("gain", "log", "duration", "positive"):
            is_open = spec.kind == "gain" or spec.bounds is not None
            return np.log(
                np.maximum(np.abs(value), np.finfo(float).tiny if is_open else MIN_POSITIVE)
            )
        return np.divide(value, self.time_unit_s if spec.kind == "time" else spec.size)

    def named(self, u: FloatArray, sign: FloatArray, row: int) -> dict[str, float]:
        """Return the physical values of one candidate, as plain floats."""
        values = self.values(u[row : row + 1], sign[row : row + 1])
        return {name: float(value[0, 0]) for name, value in values.items()}

    def response(self, u: FloatArray, sign: FloatArray) -> ComplexArray:
        """Return the responses of the candidates, shape (C, n)."""
        with np.errstate(all="ignore"):  # a candidate far outside loses by its cost
            response = self.model.frequency_response(
                self.values(u, sign), self.frequency_hz, self.quantity
            )
        return np.broadcast_to(response, (u.shape[0], self.frequency_hz.size))

    def response_and_slopes(
        self, u: FloatArray, sign: FloatArray
    ) -> tuple[ComplexArray, ComplexArray]:
        """Return the responses of the candidates and ∂ log H by the coordinates.

        Returns:
            Shapes (C, n) and (C, P, n).
        """
        values = self.values(u, sign)
        with np.errstate(all="ignore"):
            response, slopes = response_and_slopes(
                self.model, values, self.frequency_hz, self.quantity
            )
            logarithmic = np.moveaxis(slopes, 0, 1) / response[:, None]
        for index, spec in enumerate(self.model.parameters):
            value = values[spec.name]
            if spec.kind == "gain":
                logarithmic[:, index] = 1.0
            elif (ends := self.ends[index]) is not None:
                low, high = ends
                step = spec.size if spec.kind == "ratio" else value
                logarithmic[:, index] *= np.where((low < value) & (value < high), step, 0.0)
            elif spec.kind in ("positive", "time"):
                logarithmic[:, index] *= value if spec.kind == "positive" else self.time_unit_s
        return response, logarithmic


def magnitudes(sought: TargetFRF, min_deviation: float) -> Residual:
    """Return the residual of log magnitudes; relative deviations are at least ``min_deviation``."""
    target = np.log(np.abs(sought.response))
    weight = 1.0 / np.maximum(sought.deviation, min_deviation)

    def residual(h: ComplexArray, slopes: ComplexArray) -> tuple[FloatArray, FloatArray]:
        return (np.log(np.abs(h)) - target) * weight, slopes.real * weight

    return residual


def logarithms(sought: TargetFRF, min_deviation: float) -> Residual:
    """Return the residual of complex logarithms, with phases within half a turn.

    Deviations are at least ``min_deviation``.
    """
    magnitude_weight, phase_weight = (
        1.0 / np.maximum(d, min_deviation) for d in (sought.deviation, sought.phase_deviation)
    )

    def residual(h: ComplexArray, slopes: ComplexArray) -> tuple[FloatArray, FloatArray]:
        ratio = h / sought.response
        return (
            np.concatenate(
                [np.log(np.abs(ratio)) * magnitude_weight, np.angle(ratio) * phase_weight], axis=1
            ),
            np.concatenate([slopes.real * magnitude_weight, slopes.imag * phase_weight], axis=2),
        )

    return residual


def differences(sought: TargetFRF) -> Residual:
    """Return the weighted residual that the estimators minimise."""
    size = np.abs(sought.response)
    scale = 1.0 / (size * sought.deviation)
    phase_weight = 1.0 / sought.phase_deviation

    def complex_residual(h: ComplexArray, slopes: ComplexArray) -> tuple[FloatArray, FloatArray]:
        residual = (h - sought.response) * scale
        derivative = slopes * (h * scale)[:, None]
        return (
            np.concatenate([residual.real, residual.imag], axis=1),
            np.concatenate([derivative.real, derivative.imag], axis=2),
        )

    def polar_residual(h: ComplexArray, slopes: ComplexArray) -> tuple[FloatArray, FloatArray]:
        radial = (np.abs(h) - size) * scale
        radial_slopes = slopes.real * (np.abs(h) * scale)[:, None]
        if not sought.has_phase:
            return radial, radial_slopes
        angular = np.angle(h / sought.response) * phase_weight
        return (
            np.concatenate([radial, angular], axis=1),
            np.concatenate([radial_slopes, slopes.imag * phase_weight], axis=2),
        )

    return polar_residual if sought.polar else complex_residual


@dataclass(frozen=True, eq=False)
class Population:
    """Candidates of the descent, and their iterates.

    Attributes:
        u: coordinates, shape (C, P).
        sign: of the gain, shape (C,).
        cost: sums of squares, shape (C,).
        path: coordinates and costs of each candidate after every step, shapes (steps, C, P) and
            (steps, C).
    """

    u: FloatArray
    sign: FloatArray
    cost: FloatArray
    path: tuple[FloatArray, FloatArray]

    def best(self, count: int, apart: float = 0.0) -> np.ndarray:
        """Return the rows of least cost, no two nearer than ``apart`` in every coordinate."""
        chosen: list[int] = []
        for row in np.argsort(self.cost, kind="stable").tolist():
            if not np.isfinite(self.cost[row]):
                break
            near = any(
                self.sign[row] == self.sign[c] and np.max(np.abs(self.u[row] - self.u[c])) < apart
                for c in chosen
            )
            if not near:
                chosen.append(row)
            if len(chosen) == count:
                break
        return np.array(chosen, dtype=int)


def descend(
    chart: LogCoordinates,
    u: FloatArray,
    sign: FloatArray,
    residual: Residual,
    rounds: int,
    held: BoolArray | None = None,
) -> Population:
    """Return the candidates after Levenberg–Marquardt steps on all of them side by side.

    Args:
        chart: coordinates and responses.
        u: start of the candidates, shape (C, P).
        sign: of their gains, shape (C,).
        residual: to be minimised.
        rounds: steps tried.
        held: coordinates that stay as they are, shape (C, P); None for none.
    """
    u = u.copy()
    damping = np.full(len(u), DAMPING)
    free = np.ones((len(u), 1, 1)) if held is None else np.where(held, 0.0, 1.0)[:, :, None]
    places = []
    costs = []
    # The limit of outliers is refreshed half-way, where they stand out better.
    for count in (rounds - rounds // 2, rounds // 2):
        residuals, slopes = _evaluated(chart, u, sign, residual)
        limit = _limit(residuals)
        residuals, slopes = _bounded(residuals, slopes, limit)
        cost = np.sum(residuals**2, axis=1)
        places.append(u.copy())
        costs.append(cost.copy())
        moving = np.flatnonzero(np.isfinite(cost))
        for _ in range(count):
            if not moving.size:
                break
            step = _steps(residuals[moving], slopes[moving] * free[moving], damping[moving])
            trial = u[moving] - step
            before = cost[moving]
            new_residuals, new_slopes = _bounded(
                *_evaluated(chart, trial, sign[moving], residual), limit[moving]
            )
            after = np.sum(new_residuals**2, axis=1)
            change = np.max(np.abs(step), axis=1)
            better = after < before
            gained = np.where(better, before - after, 0.0)
            # A step of hardly any damping gains less than a thousandth of a variance of the
            # residuals.
            negligible = 1e-3 * np.maximum(np.minimum(1.0, before), before / residuals.shape[1])
            settled = better | (change < 1e-9)
            arrived = (damping[moving] < 1.0) & settled & (gained < negligible)
            improved = moving[better]
            u[improved] = trial[better]
            residuals[improved] = new_residuals[better]
            slopes[improved] = new_slopes[better]
            cost[improved] = after[better]
            damping[moving] *= np.where(better, 0.2, 5.0)
            places.append(u.copy())
            costs.append(cost.copy())
            moving = moving[~arrived & (damping[moving] < 1e8)]  # more damped, a step leads nowhere
        damping = np.minimum(damping, DAMPING)
    return Population(u, sign, cost, (np.array(places), np.array(costs)))


def information_at(
    chart: LogCoordinates, u: FloatArray, sign: FloatArray, residual: Residual
) -> FloatArray:
    """Return JᵀJ of the residual at each candidate, by the coordinates, shape (C, P, P)."""
    _, slopes = _evaluated(chart, u, sign, residual)
    return slopes @ slopes.swapaxes(1, 2)


def _limit(residuals: FloatArray) -> FloatArray:
    """Return eight times the common size of the residuals, at least eight, shape (C, 1)."""
    common = median(np.abs(np.where(np.isfinite(residuals), residuals, 0.0)))
    return 8.0 * np.maximum(1.0, common)[:, None]


def _bounded(
    residuals: FloatArray, slopes: FloatArray, limit: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return residuals that grow like a root beyond the limit (soft L1), and their slopes.

    Bins into which motion leaks then pull less.
    """
    with np.errstate(all="ignore"):
        root = np.sqrt(1.0 + (residuals / limit) ** 2)
        shrunk = np.sqrt(2.0 / (root + 1.0))
        return residuals * shrunk, slopes * (1.0 / (shrunk * root))[:, None]


def _evaluated(
    chart: LogCoordinates, u: FloatArray, sign: FloatArray, residual: Residual
) -> tuple[FloatArray, FloatArray]:
    """Return residuals and slopes of the candidates; slopes that are not finite become zero."""
    response, logarithmic = chart.response_and_slopes(u, sign)
    with np.errstate(all="ignore"):
        residuals, slopes = residual(response, logarithmic)
    return residuals, np.where(np.isfinite(slopes), slopes, 0.0)


def _steps(residuals: FloatArray, slopes: FloatArray, damping: FloatArray) -> FloatArray:
    """Return damped Gauss–Newton steps, at most ``MAX_STEP`` in a coordinate, shape (C, P)."""
    residuals = np.where(np.isfinite(residuals), residuals, 0.0)
    matrix = slopes @ slopes.swapaxes(1, 2)
    gradient = (slopes @ residuals[..., None])[..., 0]
    diagonal = np.einsum("cpp->cp", matrix)
    # A coordinate without information stays; the others are scaled to one.
    scale = np.sqrt(np.maximum(diagonal, 1e-20 * np.max(diagonal, axis=1, keepdims=True) + 1e-300))
    scaled = matrix / (scale[:, :, None] * scale[:, None, :])
    scaled += (damping[:, None, None] + 1e-14) * np.eye(scale.shape[1])
    step = np.linalg.solve(scaled, (gradient / scale)[..., None])[..., 0] / scale
    return step * np.minimum(
        1.0, MAX_STEP / np.maximum(np.max(np.abs(step), axis=1, keepdims=True), 1e-300)
    )
