"""Intervals from the profile likelihood: of parameters at a bound, or where χ² is flat or skew.

One coordinate is held away from the estimate while the others follow; the interval ends where χ²
has risen by k² (Venzon & Moolgavkar 1988). A covariance knows the direction of such a valley at the
estimate alone. At a damping of zero it does not show that the natural frequency trades against the
damping, because the square of the damping counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Protocol

import numpy as np

from vibrident.base.amounts import pretty
from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.information import inverse_normal
from vibrident.fit.problem import Coordinates
from vibrident.fit.problem.frequency_domain import FrequencyProblem, Local
from vibrident.fit.uncertainty.parameters import (
    WEAK_TRADED_UNCERTAINTY,
    WEAK_UNCERTAINTY,
    at_end,
    deviations,
    sizes_of,
)
from vibrident.physics.naming import in_words
from vibrident.result import Parameter

#: Steps of a descent with one coordinate held.
MAX_STEPS = 12
#: Optima on the way outward until χ² has risen enough, and in the search for the end between two.
MAX_OUTWARD = 14
MAX_INWARD = 8
#: Factor from one step outward to the next.
STEP_GROWTH = 1.6
#: Error of χ² at an end, over its rise.
RISE_TOLERANCE = 0.1
#: A descent stops where a step would gain less than this part of the rise.
GAIN_TOLERANCE = 1e-3
#: Points stand for the data where the data's standard uncertainties are at most this many times
#: larger.
MAX_LOSS = 1.2
#: Rounds of searches for ends; those after the first are for ends that another search passed.
MAX_PASSES = 2
#: A ratio does not move from zero, as its square counts: it starts from here, too.
NONZERO_START = 0.3
#: The profile's interval is taken where it is wider than that of the covariance by this factor.
MIN_WIDENING = 1.1
#: A parameter within so many standard deviations of its bound is near it.
MAX_BOUND_DISTANCE = 3.0


@dataclass(frozen=True, eq=False)
class Profile:
    """The coordinates where χ² has risen to the end of the interval.

    Attributes:
        z: the estimate, shape (p,).
        ends: coordinates at the lower and the upper end of each held one, shape (p, 2, p); NaN
            where it has no end.
    """

    z: FloatArray
    ends: FloatArray

    @property
    def points(self) -> FloatArray:
        """Return all ends that are not open, shape (n, p)."""
        flat = self.ends.reshape(-1, self.ends.shape[-1])
        return flat[np.all(np.isfinite(flat), axis=1)]


def needs_profile(coordinates: Coordinates, z: FloatArray, covariance: FloatArray) -> bool:
    """Return whether a parameter is near its bound or hardly determined: χ² is no parabola."""
    deviation = deviations(covariance)
    positive = _positive(coordinates)
    weak = deviation > WEAK_UNCERTAINTY * sizes_of(coordinates.model, z)
    return bool(
        np.any(weak | (positive & (np.abs(z) < MAX_BOUND_DISTANCE * deviation)))
        or at_end(coordinates, z)
    )


def points_suffice(
    problem: FrequencyProblem, coordinates: Coordinates, z: FloatArray, covariance: FloatArray
) -> bool:
    """Return whether the covariance by the measured points is nearly that by the data.

    It is smaller where the data must also separate free motion from the response.
    """
    by_points = deviations(inverse_normal(problem.normal(z, coordinates).matrix))
    return bool(np.all(deviations(covariance) < MAX_LOSS * by_points))


def profile_of(
    problem: ChiSquared,
    coordinates: Coordinates,
    z: FloatArray,
    covariance: FloatArray,
    rise: float,
) -> Profile:
    """Return the ends of the intervals of all parameters.

    Where the variance exceeds that by the curvature of χ², as beside noise of the reference, χ² is
    divided by their ratio (Rotnitzky & Jewell 1990).

    Args:
        problem: the fit of the data, in units of their noise.
        coordinates: the map from z to parameters.
        z: the estimate, shape (p,).
        covariance: of z, shape (p, p); of the first step outward.
        rise: of χ² at the ends.
    """
    z = np.where(_positive(coordinates), np.abs(z), z)  # reflected at zero
    local = problem.normal(z, coordinates)
    estimate = _Optimum(z, 0.0, local.matrix)
    by_curvature = np.diag(inverse_normal(estimate.matrix))
    variance = np.maximum(np.diag(covariance), np.finfo(float).tiny)
    shares = np.clip(np.nan_to_num(by_curvature / variance, nan=1.0), np.finfo(float).eps, 1.0)
    search = _EndSearch(problem, coordinates, estimate, float(local.cost), shares, rise)
    deviation = np.clip(deviations(covariance), 1e-12, 0.5)
    return Profile(z, search.ends(np.sqrt(rise) * deviation))


def _positive(coordinates: Coordinates) -> BoolArray:
    """Return which coordinates are reflected at zero, shape (p,)."""
    return np.array([spec.kind == "positive" for spec in coordinates.model.parameters])


def with_profile(
    table: Mapping[str, Parameter],
    profile: Profile,
    coordinates: Coordinates,
    systematic_covariance: FloatArray,
    coverage: float,
) -> tuple[dict[str, Parameter], dict[str, str]]:
    """Return the parameters with the profile's intervals where wider, and sentences on weak ones.

    Args:
        table: of the parameters, by the covariance.
        profile: of the estimate.
        coordinates: the map from z to parameters.
        systematic_covariance: of z by systematic effects, beside the data, shape (p, p).
        coverage: factor k of the intervals.
    """
    model = coordinates.model
    parameters = dict(table)
    sentences = dict[str, str]()
    corners = [coordinates.values(point) for point in profile.points]
    slopes = np.abs(coordinates.slopes(profile.z))
    weak_u = WEAK_TRADED_UNCERTAINTY * slopes * sizes_of(model, profile.z)
    for index, spec in enumerate(model.parameters):
        stated = table[spec.name]
        ends = [
            coordinates.values(end)[spec.name] if np.all(np.isfinite(end)) else None
            for end in profile.ends[index]
        ]
        if ends[0] is not None and ends[1] is not None and ends[0] > ends[1]:  # of a negative gain
            ends.reverse()
        systematic_half_width = coverage * float(
            slopes[index] * np.sqrt(max(systematic_covariance[index, index], 0.0))
        )
        parameters[spec.name] = widened = _widen(stated, ends, systematic_half_width, coverage)
        u = widened.standard_uncertainty
        if widened is not stated and (u is None or u > weak_u[index]):
            sentences[spec.name] = _describe_interval(spec.name, widened)
    for quantity in model.derived(coordinates.values(profile.z)):
        values = [complex(quantity.value(corner)).real for corner in corners]  # no resonance: zero
        ends = [min(values, default=None), max(values, default=None)]
        determined = all(
            parameters[name].standard_uncertainty is not None for name in quantity.needs
        )
        parameters[quantity.name] = _widen(
            table[quantity.name], ends if determined else [None, None], 0.0, coverage
        )
    return parameters, sentences


def _widen(
    stated: Parameter, ends: Sequence[float | None], systematic_half_width: float, coverage: float
) -> Parameter:
    """Return the parameter with an interval to these ends, or as stated unless that is wider."""
    value = stated.value
    if ends[0] is None or ends[1] is None:
        if stated.standard_uncertainty is None:
            return stated
        return replace(
            stated, standard_uncertainty=None, interval_95=tuple(ends), identifiable=False
        )
    below, above = (
        float(np.hypot(max(distance, 0.0), systematic_half_width))
        for distance in (value - ends[0], ends[1] - value)
    )
    u = max(below, above) / coverage
    if stated.standard_uncertainty is not None and u < MIN_WIDENING * stated.standard_uncertainty:
        return stated
    return replace(stated, standard_uncertainty=u, interval_95=(value - below, value + above))


def _describe_interval(name: str, parameter: Parameter) -> str:
    """Return the sentence on a parameter with an interval of the profile."""
    low, high = (None if end is None else f"{end:.4g}" for end in parameter.interval_95)
    span = {
        (True, True): f"{low} to {high}",
        (False, True): f"below {high}",
        (True, False): f"above {low}",
    }
    within = span.get((low is not None, high is not None))
    if within is None:
        return (
            f"The data do not determine the {in_words(name)}: the profile likelihood excludes no "
            "value (95 %)."
        )
    unit = "" if parameter.unit == "1" else f" {pretty(parameter.unit)}"
    return (
        f"The data hardly determine the {in_words(name)}: it is {within}{unit} (95 %), "
        "from the profile likelihood, as χ² is flat or skew there."
    )


class ChiSquared(Protocol):
    """χ² of the data at any coordinates, with gradient and information."""

    def normal(self, z: FloatArray, coordinates: Coordinates) -> Local:
        """Return the equations of the fit at z, shape (p,)."""
        ...


class _Optimum(NamedTuple):
    """The optimum of the other coordinates with one held.

    Attributes:
        z: coordinates, shape (p,).
        rise: of χ² over that of the estimate, multiplied by the share of the held coordinate.
        matrix: information, shape (p, p).
    """

    z: FloatArray
    rise: float
    matrix: FloatArray


@dataclass(frozen=True, eq=False)
class _EndSearch:
    """The search for the ends of intervals around an estimate.

    Attributes:
        problem: the likelihood.
        coordinates: the map from z to parameters.
        estimate: the optimum of all coordinates.
        least_cost: χ² there.
        shares: factor on χ² beside each held coordinate, shape (p,).
        rise: of χ² at an end.
        places: optima that the searches have met; they grow.
    """

    problem: ChiSquared
    coordinates: Coordinates
    estimate: _Optimum
    least_cost: float
    shares: FloatArray
    rise: float
    places: list[_Optimum] = field(default_factory=list)

    def ends(self, deviation: FloatArray) -> FloatArray:
        """Return the coordinates at both ends of each, shape (p, 2, p), NaN where there is none.

        As a valley is curved, the search for an end may meet places inside that lie beyond an end
        found before. All intervals include them: the search for that end continues from there.

        Args:
            deviation: length of the first step along each coordinate, shape (p,).
        """
        count = len(deviation)
        ends: dict[tuple[int, int], FloatArray] = {}
        sides = [(k, sign) for k in range(count) for sign in (-1, 1)]
        for _ in range(MAX_PASSES):
            outdated = [side for side in sides if self._is_outdated(*side, ends)]
            for k, sign in outdated:
                ends[k, sign] = self._end(k, sign * deviation[k], self._furthest_inside(k, sign))
            if not outdated:
                break
        return np.reshape([ends[side] for side in sides], (count, 2, count))

    def _furthest_inside(self, k: int, sign: int) -> _Optimum:
        """Return the place inside that lies furthest on one side of a coordinate."""
        inside = [place for place in self.places if place.rise < self.rise]
        return max([self.estimate, *inside], key=lambda place: sign * place.z[k])

    def _is_outdated(self, k: int, sign: int, ends: Mapping[tuple[int, int], FloatArray]) -> bool:
        """Return whether an end is not sought yet, or a place inside lies clearly beyond it.

        No place lies beyond an open end.
        """
        if (k, sign) not in ends:
            return True
        end = ends[k, sign]
        width = abs(float(end[k] - self.estimate.z[k]))
        beyond = sign * float(self._furthest_inside(k, sign).z[k] - end[k])
        return beyond > RISE_TOLERANCE * width

    def _end(self, k: int, step: float, inner: _Optimum) -> FloatArray:
        """Return the coordinates where χ² has risen enough, NaN if it has not within the range.

        A positive coordinate ends at zero.
        """
        open_end = np.full(len(inner.z), np.nan)
        low, high = (float(edge[k]) for edge in self.coordinates.edges)
        low = 0.0 if _positive(self.coordinates)[k] else low
        for _ in range(MAX_OUTWARD):
            target = float(np.clip(inner.z[k] + step, low, high))
            if target == inner.z[k]:
                return inner.z if low == 0.0 and target == 0.0 else open_end
            outer = self._optimum_beside(k, target, inner)
            if outer.rise >= self.rise:
                return self._end_between(k, inner, outer)
            inner = outer
            step = STEP_GROWTH * step
        return open_end

    def _end_between(self, k: int, inner: _Optimum, outer: _Optimum) -> FloatArray:
        """Return the end between two places.

        The search is by the root of the rise, which is straight where χ² is a parabola.
        """
        for trial in range(MAX_INWARD):
            root_rises = [np.sqrt(max(optimum.rise, 0.0)) for optimum in (inner, outer)]
            share = (np.sqrt(self.rise) - root_rises[0]) / max(
                root_rises[1] - root_rises[0], 1e-300
            )
            share = 0.5 if trial % 3 == 2 else float(np.clip(share, 0.05, 0.95))
            target = inner.z[k] + share * (outer.z[k] - inner.z[k])
            middle = self._optimum_beside(k, float(target), inner)
            if abs(middle.rise - self.rise) < RISE_TOLERANCE * self.rise:
                return middle.z
            inner, outer = (middle, outer) if middle.rise < self.rise else (inner, middle)
        return outer.z

    def _optimum_beside(self, k: int, target: float, inner: _Optimum) -> _Optimum:
        """Return the optimum of the other coordinates with one held, from an optimum nearby."""
        free = np.arange(len(inner.z)) != k
        begins = [self._along_valley(k, target, inner, free)]
        positive = _positive(self.coordinates)
        if np.any(positive & free & (np.abs(inner.z) < NONZERO_START)):
            nonzero = np.maximum(np.abs(inner.z), NONZERO_START)
            begins.append(np.where(positive & free, nonzero, np.where(free, inner.z, target)))
        optimum = min(
            (self._descend(begin, k) for begin in begins), key=lambda optimum: optimum.rise
        )
        self.places.append(optimum)
        return optimum

    def _along_valley(self, k: int, target: float, inner: _Optimum, free: BoolArray) -> FloatArray:
        """Return where the other coordinates follow a held one to, along the valley's tangent."""
        step = target - inner.z[k]
        inverse = inverse_normal(inner.matrix[free][:, free])
        z = np.array(inner.z)
        z[free] -= np.clip(inverse @ inner.matrix[free, k] * step, -1.0, 1.0)
        z[k] = target
        return np.clip(z, *self.coordinates.edges)

    def _descend(self, z: FloatArray, k: int) -> _Optimum:
        """Return the optimum of the coordinates but one, by Levenberg and Marquardt."""
        free = np.arange(len(z)) != k
        share = float(self.shares[k])
        small_gain = GAIN_TOLERANCE * self.rise / share
        damping = 1e-3
        low, high = self.coordinates.edges
        current = self.problem.normal(z, self.coordinates)
        for _ in range(MAX_STEPS):
            matrix = current.matrix[free][:, free]
            gradient = current.gradient[free]
            diagonal = np.diag(matrix)
            scale = np.maximum(diagonal, 1e-12 * max(float(np.max(diagonal)), 1e-300))
            # Directions that are lost in rounding stay.
            inverse = inverse_normal(matrix + damping * np.diag(scale))
            free_step = np.clip(inverse @ gradient, -1.0, 1.0)
            if free_step @ (2.0 * gradient - matrix @ free_step) < small_gain:
                break
            step = np.zeros(len(z))
            step[free] = free_step
            trial = np.clip(z + step, low, high)
            proposed = self.problem.normal(trial, self.coordinates)
            if np.isfinite(proposed.cost) and proposed.cost <= current.cost:
                settled = current.cost - proposed.cost < small_gain
                z = trial
                current = proposed
                damping = 0.1 * damping
                if settled:
                    break
            else:
                damping *= 10.0
        rise = share * (float(current.cost) - self.least_cost)
        return _Optimum(z, rise, current.matrix)
