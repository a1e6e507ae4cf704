"""Intervals from the profile likelihood: of parameters at a bound, or where χ² is flat or skew.

One coordinate is held away from the estimate and the others follow; the interval ends where χ² has
risen by k² (Venzon & Moolgavkar 1988). A covariance knows the direction of such a valley at the
estimate alone: at a damping of zero it says nothing of how the natural frequency trades against the
damping, whose square counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.amounts import pretty
from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.information import inverse_normal
from vibrident.fit.problem import Coordinates
from vibrident.fit.problem.frequency_domain import FrequencyProblem
from vibrident.fit.uncertainty.parameters import (
    WEAK_TRADED_UNCERTAINTY,
    WEAK_UNCERTAINTY,
    at_end,
    deviations,
    sizes_of,
)
from vibrident.physics.naming import in_words
from vibrident.result import Parameter

#: Steps of a descent beside the held coordinate.
MAX_STEPS = 30
#: Optima on the way outward until χ² has risen enough, and of the search for the end between two.
MAX_OUTWARD = 14
MAX_INWARD = 8
#: Factor from one step outward to the next.
STEP_GROWTH = 1.6
#: χ² at an end is right within this part of its rise.
RISE_TOLERANCE = 0.02
#: From zero a ratio does not move, as its square counts: it is tried from here, too.
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
        """Return all ends, shape (n, p), without those that are open."""
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


def profile_of(
    problem: FrequencyProblem,
    coordinates: Coordinates,
    z: FloatArray,
    covariance: FloatArray,
    rise: float,
) -> Profile:
    """Return the ends of the intervals of all parameters.

    Args:
        problem: the response that is fitted, in units of its noise.
        coordinates: the map from z to parameters.
        z: the estimate, shape (p,).
        covariance: of z, shape (p, p); of the first step outward.
        rise: of χ² at the ends.
    """
    z = np.where(_positive(coordinates), np.abs(z), z)  # reflected at zero
    search = _EndSearch(problem, coordinates, z, rise)
    count = len(z)
    ends = np.full((count, 2, count), np.nan)
    deviation = np.clip(deviations(covariance), 1e-12, 0.5)
    for k in range(count):
        for column, sign in enumerate((-1.0, 1.0)):
            end = search.end(k, sign * deviation[k] * np.sqrt(rise))
            if end is not None:
                ends[k, column] = end
    return Profile(z, ends)


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
    """Return the parameter with an interval to these ends, or as stated where that is no wider."""
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


@dataclass(frozen=True, eq=False)
class _EndSearch:
    """The search for the ends of intervals around an estimate."""

    problem: FrequencyProblem
    coordinates: Coordinates
    z: FloatArray
    rise: float

    def end(self, k: int, step: float) -> FloatArray | None:
        """Return the coordinates where χ² has risen enough, or None if it has not within the range.

        A positive coordinate ends at zero.
        """
        low, high = (float(edge[k]) for edge in self.coordinates.edges)
        low = 0.0 if _positive(self.coordinates)[k] else low
        least_cost = self._cost(self.z)
        inner = self.z
        rise = 0.0
        for _ in range(MAX_OUTWARD):
            target = float(np.clip(inner[k] + step, low, high))
            if target == inner[k]:
                return inner if low == 0.0 and target == 0.0 else None
            outer, outer_cost = self._optimum_beside(k, target, inner)
            if outer_cost - least_cost >= self.rise:
                return self._end_between(
                    k, least_cost, (inner, rise), (outer, outer_cost - least_cost)
                )
            inner = outer
            rise = max(outer_cost - least_cost, 0.0)
            step = STEP_GROWTH * step
        return None

    def _end_between(
        self,
        k: int,
        least_cost: float,
        inner: tuple[FloatArray, float],
        outer: tuple[FloatArray, float],
    ) -> FloatArray:
        """Return the end between two places, each of z and its rise of χ².

        It is searched by the root of the rise, which is straight where χ² is a parabola.
        """
        for trial in range(MAX_INWARD):
            root_rises = [np.sqrt(max(place[1], 0.0)) for place in (inner, outer)]
            share = (np.sqrt(self.rise) - root_rises[0]) / max(
                root_rises[1] - root_rises[0], 1e-300
            )
            share = 0.5 if trial % 3 == 2 else float(np.clip(share, 0.05, 0.95))
            target = inner[0][k] + share * (outer[0][k] - inner[0][k])
            z, cost = self._optimum_beside(k, float(target), inner[0])
            middle = z, cost - least_cost
            if abs(middle[1] - self.rise) < RISE_TOLERANCE * self.rise:
                return z
            inner, outer = (middle, outer) if middle[1] < self.rise else (inner, middle)
        return outer[0]

    def _optimum_beside(self, k: int, target: float, start: FloatArray) -> tuple[FloatArray, float]:
        """Return the optimum of the other coordinates with one held, and its χ²."""
        free = np.arange(len(start)) != k
        begins = [np.where(free, start, target)]
        positive = _positive(self.coordinates)
        if np.any(positive & free & (np.abs(start) < NONZERO_START)):
            begins.append(
                np.where(positive & free, np.maximum(np.abs(start), NONZERO_START), begins[0])
            )
        return min((self._descend(begin, free) for begin in begins), key=lambda optimum: optimum[1])

    def _descend(self, z: FloatArray, free: BoolArray) -> tuple[FloatArray, float]:
        """Return the optimum of the free coordinates, by Levenberg and Marquardt, and its χ²."""
        damping = 1e-3
        low, high = self.coordinates.edges
        small_gain = 1e-3 * RISE_TOLERANCE * self.rise
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
            elif damping > 1e8:
                break
            else:
                damping *= 10.0
        return z, current.cost

    def _cost(self, z: FloatArray) -> float:
        """Return χ² at z."""
        residual = self.problem.residual(z, self.coordinates)
        return float(residual @ residual)
