"""Many candidates brought down the same residual at once, in NumPy: cheap enough to look everywhere.

The search works on the response at a few hundred points at most, in coordinates of its own: logarithms of what is
positive (frequencies, damping ratios, durations, the gain's size), and the delay in radians at the highest frequency.
Three residuals follow one another. The logarithm of the magnitude does not know delay and sign, and hardly any
dead ends: off a sharp resonance it still says which way the resonance lies. The complex logarithm joins the phase.
Finally the weighted difference is used, which the estimators minimise.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import BoolArray, FloatArray, Quantity
from vibrident.fit.problem.coordinates import ends_of
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import median
from vibrident.physics.models import ParameterSpec, SensorModel
from vibrident.physics.models.slopes import response_and_slopes

#: Damping of Levenberg–Marquardt at the start.
DAMPING = 1e-2
#: No coordinate moves further at once.
LONGEST = 0.7
#: What is positive stays above this part of one unit.
LEAST = 1e-9

#: Residual of candidates' responses, (C, n) → (C, m), and its derivative, (C, P, n) → (C, P, m), from ∂ log H.
Residual = Callable[[ComplexArray, ComplexArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True, eq=False)
class TargetFRF:
    """The response that is sought, at n points.

    Attributes:
        frequency_hz: shape (n,).
        response: measured complex sensitivity, real and positive where the phase is not known, shape (n,).
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
        """Some of the points."""
        return replace(
            self,
            frequency_hz=self.frequency_hz[points],
            response=self.response[points],
            deviation=self.deviation[points],
            phase_deviation=self.phase_deviation[points],
        )

    def few(self, most: int) -> TargetFRF:
        """At most so many of the points, evenly through their order by frequency."""
        if self.frequency_hz.size <= most:
            return self
        order = np.argsort(self.frequency_hz, kind="stable")
        return self.at(order[np.linspace(0, order.size - 1, most).astype(int)])

    def scaled(self, factor: float) -> TargetFRF:
        """The same points with deviations so many times as large."""
        return replace(
            self, deviation=self.deviation * factor, phase_deviation=self.phase_deviation * factor
        )


@dataclass(frozen=True, eq=False)
class LogCoordinates:
    """Coordinates of the search, shape (C, P) for C candidates, and the responses there.

    Attributes:
        model: a linear model.
        quantity: what the reference is.
        frequency_hz: of the points, shape (n,).
        time_unit_s: unit of a delay.
    """

    model: SensorModel
    quantity: Quantity
    frequency_hz: FloatArray
    time_unit_s: float

    def at(self, sought: TargetFRF) -> LogCoordinates:
        """The same coordinates, at the points of a response."""
        return replace(self, frequency_hz=sought.frequency_hz)

    @functools.cached_property
    def band_hz(self) -> tuple[float, float]:
        """Lowest and highest frequency of the points."""
        return float(np.min(self.frequency_hz)), float(np.max(self.frequency_hz))

    def values(self, u: FloatArray, sign: FloatArray) -> dict[str, FloatArray]:
        """Name to physical values, each of shape (C, 1); none outside the range that a fit searches.

        Out there others would make up for it, which cannot follow when it is brought back.
        """
        values = {}
        for index, spec in enumerate(self.model.parameters):
            column = u[:, index, None]
            if spec.kind == "gain":
                value = sign[:, None] * np.exp(np.clip(column, -700.0, 700.0))
            elif spec.kind in ("log", "duration", "positive"):
                value = np.exp(np.clip(column, -300.0, 300.0))
            else:
                value = column * (self.time_unit_s if spec.kind == "time" else spec.size)
            ends = ends_of(spec, self.band_hz)
            values[spec.name] = value if ends is None else np.clip(value, *ends)
        return values

    def place(self, values: dict[str, float]) -> tuple[FloatArray, float]:
        """Coordinates of physical values, shape (P,), and the gain's sign."""
        specs = self.model.parameters
        negative = any(spec.kind == "gain" and values[spec.name] < 0.0 for spec in specs)
        return np.array(
            [float(self.coordinate(spec, values[spec.name])) for spec in specs]
        ), -1.0 if negative else 1.0

    def coordinate(self, spec: ParameterSpec, value: float | FloatArray) -> FloatArray:
        """Of values of a parameter, of their shape."""
        if spec.kind in ("gain", "log", "duration", "positive"):
            is_open = spec.kind == "gain" or spec.bounds is not None
            return np.log(np.maximum(np.abs(value), np.finfo(float).tiny if is_open else LEAST))
        return np.divide(value, self.time_unit_s if spec.kind == "time" else spec.size)

    def named(self, u: FloatArray, sign: FloatArray, row: int) -> dict[str, float]:
        """Physical values of one candidate, as plain floats."""
        found = self.values(u[row : row + 1], sign[row : row + 1])
        return {name: float(value[0, 0]) for name, value in found.items()}

    def response(self, u: FloatArray, sign: FloatArray) -> ComplexArray:
        """Responses of the candidates, shape (C, n)."""
        with np.errstate(all="ignore"):  # a candidate far outside is left behind by its cost
            found = self.model.frequency_response(
                self.values(u, sign), self.frequency_hz, self.quantity
            )
        return np.broadcast_to(found, (u.shape[0], self.frequency_hz.size))

    def response_and_slopes(
        self, u: FloatArray, sign: FloatArray
    ) -> tuple[ComplexArray, ComplexArray]:
        """Responses of the candidates, shape (C, n), and ∂ log H by the coordinates, shape (C, P, n)."""
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
            elif (ends := ends_of(spec, self.band_hz)) is not None:
                low, high = ends
                step = spec.size if spec.kind == "ratio" else value
                logarithmic[:, index] *= np.where((low < value) & (value < high), step, 0.0)
            elif spec.kind in ("positive", "time"):
                logarithmic[:, index] *= value if spec.kind == "positive" else self.time_unit_s
        return response, logarithmic


def magnitudes(sought: TargetFRF, least: float) -> Residual:
    """Logarithms of the magnitudes; relative deviations are at least ``least``."""
    goal, weight = np.log(np.abs(sought.response)), 1.0 / np.maximum(sought.deviation, least)

    def residual(h: ComplexArray, slopes: ComplexArray) -> tuple[FloatArray, FloatArray]:
        return (np.log(np.abs(h)) - goal) * weight, slopes.real * weight

    return residual


def logarithms(sought: TargetFRF, least: float) -> Residual:
    """Complex logarithms, phases within half a turn; deviations are at least ``least``."""
    radial, turning = (
        1.0 / np.maximum(d, least) for d in (sought.deviation, sought.phase_deviation)
    )

    def residual(h: ComplexArray, slopes: ComplexArray) -> tuple[FloatArray, FloatArray]:
        ratio = h / sought.response
        return (
            np.concatenate([np.log(np.abs(ratio)) * radial, np.angle(ratio) * turning], axis=1),
            np.concatenate([slopes.real * radial, slopes.imag * turning], axis=2),
        )

    return residual


def differences(sought: TargetFRF) -> Residual:
    """The weighted residual that the estimators minimise."""
    size = np.abs(sought.response)
    scale, turning = 1.0 / (size * sought.deviation), 1.0 / sought.phase_deviation

    def complex_residual(h: ComplexArray, slopes: ComplexArray) -> tuple[FloatArray, FloatArray]:
        off, turn = (h - sought.response) * scale, slopes * (h * scale)[:, None]
        return np.concatenate([off.real, off.imag], axis=1), np.concatenate(
            [turn.real, turn.imag], axis=2
        )

    def polar_residual(h: ComplexArray, slopes: ComplexArray) -> tuple[FloatArray, FloatArray]:
        radial = (np.abs(h) - size) * scale
        outward = slopes.real * (np.abs(h) * scale)[:, None]
        if not sought.has_phase:
            return radial, outward
        turn = np.angle(h / sought.response) * turning
        return np.concatenate([radial, turn], axis=1), np.concatenate(
            [outward, slopes.imag * turning], axis=2
        )

    return polar_residual if sought.polar else complex_residual


@dataclass(frozen=True, eq=False)
class Population:
    """Candidates on their way down.

    Attributes:
        u: coordinates, shape (C, P).
        sign: of the gain, shape (C,).
        cost: sums of squares, shape (C,).
        path: coordinates and costs of each candidate after every step, shapes (steps, C, P) and (steps, C).
    """

    u: FloatArray
    sign: FloatArray
    cost: FloatArray
    path: tuple[FloatArray, FloatArray]

    def best(self, count: int, apart: float = 0.0) -> np.ndarray:
        """Rows of the ``count`` least costs, no two nearer than ``apart`` in every coordinate."""
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
    """Levenberg–Marquardt on all candidates side by side.

    Args:
        chart: coordinates and responses.
        u: where the candidates begin, shape (C, P).
        sign: of their gains, shape (C,).
        residual: what is made small.
        rounds: steps tried.
        held: coordinates that stay as they are, shape (C, P); None: none does.
    """
    u, damping = u.copy(), np.full(len(u), DAMPING)
    free = np.ones((len(u), 1, 1)) if held is None else np.where(held, 0.0, 1.0)[:, :, None]
    places, costs = [], []
    for part in (
        rounds - rounds // 2,
        rounds // 2,
    ):  # what is out of the common is told better half-way
        off, slopes = _evaluated(chart, u, sign, residual)
        limit = _limit(off)
        off, slopes = _bounded(off, slopes, limit)
        cost = np.sum(off**2, axis=1)
        places.append(u.copy())
        costs.append(cost.copy())
        moving = np.flatnonzero(np.isfinite(cost))
        for _ in range(part):
            if not moving.size:
                break
            step = _steps(off[moving], slopes[moving] * free[moving], damping[moving])
            trial, before = u[moving] - step, cost[moving]
            new, new_slopes = _bounded(
                *_evaluated(chart, trial, sign[moving], residual), limit[moving]
            )
            after, far = np.sum(new**2, axis=1), np.max(np.abs(step), axis=1)
            better = after < before
            gained = np.where(better, before - after, 0.0)
            # A step of hardly any damping gains less than a thousandth of a variance, as the residuals scatter.
            worth = 1e-3 * np.maximum(np.minimum(1.0, before), before / off.shape[1])
            arrived = (damping[moving] < 1.0) & (better | (far < 1e-9)) & (gained < worth)
            taken = moving[better]
            u[taken], off[taken] = trial[better], new[better]
            slopes[taken], cost[taken] = new_slopes[better], after[better]
            damping[moving] *= np.where(better, 0.2, 5.0)
            places.append(u.copy())
            costs.append(cost.copy())
            moving = moving[~arrived & (damping[moving] < 1e8)]  # more damped, a step leads nowhere
        damping = np.minimum(damping, DAMPING)
    return Population(u, sign, cost, (np.array(places), np.array(costs)))


def information_at(
    chart: LogCoordinates, u: FloatArray, sign: FloatArray, residual: Residual
) -> FloatArray:
    """JᵀJ of the residual at each candidate, by the coordinates, shape (C, P, P)."""
    _, slopes = _evaluated(chart, u, sign, residual)
    return slopes @ slopes.swapaxes(1, 2)


def _limit(off: FloatArray) -> FloatArray:
    """Eight times the common size of a candidate's residuals, or eight standard deviations, shape (C, 1)."""
    common = median(np.abs(np.where(np.isfinite(off), off, 0.0)))
    return 8.0 * np.maximum(1.0, common)[:, None]


def _bounded(
    off: FloatArray, slopes: FloatArray, limit: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Residuals that grow like a root beyond the limit (soft L1), and their slopes: what leaks in draws less."""
    with np.errstate(all="ignore"):
        root = np.sqrt(1.0 + (off / limit) ** 2)
        shrunk = np.sqrt(2.0 / (root + 1.0))
        return off * shrunk, slopes * (1.0 / (shrunk * root))[:, None]


def _evaluated(
    chart: LogCoordinates, u: FloatArray, sign: FloatArray, residual: Residual
) -> tuple[FloatArray, FloatArray]:
    response, logarithmic = chart.response_and_slopes(u, sign)
    with np.errstate(all="ignore"):
        off, slopes = residual(response, logarithmic)
    return off, np.where(np.isfinite(slopes), slopes, 0.0)


def _steps(off: FloatArray, slopes: FloatArray, damping: FloatArray) -> FloatArray:
    """Damped Gauss–Newton steps, none longer than ``LONGEST`` in a coordinate; shape (C, P)."""
    off = np.where(np.isfinite(off), off, 0.0)
    matrix = slopes @ slopes.swapaxes(1, 2)
    gradient = (slopes @ off[..., None])[..., 0]
    diagonal = np.einsum("cpp->cp", matrix)
    # A coordinate of which nothing is known stays; the others are scaled to one.
    scale = np.sqrt(np.maximum(diagonal, 1e-20 * np.max(diagonal, axis=1, keepdims=True) + 1e-300))
    scaled = matrix / (scale[:, :, None] * scale[:, None, :])
    scaled += (damping[:, None, None] + 1e-14) * np.eye(scale.shape[1])
    step = np.linalg.solve(scaled, (gradient / scale)[..., None])[..., 0] / scale
    return step * np.minimum(
        1.0, LONGEST / np.maximum(np.max(np.abs(step), axis=1, keepdims=True), 1e-300)
    )
