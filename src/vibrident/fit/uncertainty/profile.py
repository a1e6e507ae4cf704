"""Intervals from the profile likelihood, for parameters at a bound or along which χ² is flat or skew.

One coordinate is held away from the estimate and the others follow; the interval ends where χ² has risen by k²
(Venzon & Moolgavkar 1988). A covariance knows the direction of such a valley at the estimate alone: at a damping of
zero it says nothing of how the natural frequency trades against the damping, whose square counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.problem import Coordinates
from vibrident.fit.problem.frequency_domain import FrequencyProblem
from vibrident.fit.uncertainty.parameters import WEAK, at_end, deviations, sizes_of
from vibrident.physics.naming import in_words
from vibrident.result import Parameter

#: Steps of a descent beside the held coordinate; evaluations on the way to an end, and of the search for it.
MAX_STEPS = 30
MAX_OUTWARD = 14
MAX_INWARD = 8
#: Each step outward is longer by this.
LONGER = 1.6
#: χ² at an end is right within this part of its rise.
CLOSE = 0.02
#: From zero a ratio does not move, as its square counts: it is tried from here, too.
NUDGE = 0.3
#: An interval is taken from the profile where it is wider than the covariance has it by this.
WIDER = 1.1
#: A parameter within so many standard deviations of its bound is near it.
NEAR = 3.0


@dataclass(frozen=True, eq=False)
class Profile:
    """Where χ² has risen to the end of the interval.

    Attributes:
        z: the estimate, shape (p,).
        ends: coordinates at the lower and the upper end of each held one, shape (p, 2, p); NaN where it has no end.
    """

    z: FloatArray
    ends: FloatArray

    @property
    def points(self) -> FloatArray:
        """All ends, shape (n, p), without those that are open."""
        flat = self.ends.reshape(-1, self.ends.shape[-1])
        return flat[np.all(np.isfinite(flat), axis=1)]


def needs_profile(coordinates: Coordinates, z: FloatArray, covariance: FloatArray) -> bool:
    """Return whether a parameter is near its bound, or hardly determined: there χ² is no parabola."""
    spread = deviations(covariance)
    positive = _positive(coordinates)
    weak = spread > WEAK * sizes_of(coordinates.model, z)
    return bool(np.any(weak | (positive & (np.abs(z) < NEAR * spread))) or at_end(coordinates, z))


def profile_of(
    problem: FrequencyProblem,
    coordinates: Coordinates,
    z: FloatArray,
    covariance: FloatArray,
    rise: float,
) -> Profile:
    """Return the ends of all parameters.

    Args:
        problem: the response that is fitted, in units of its noise.
        coordinates: the map from z to parameters.
        z: the estimate, shape (p,).
        covariance: of z, shape (p, p); of the first step outward.
        rise: of χ² at the ends.
    """
    z = np.where(_positive(coordinates), np.abs(z), z)  # reflected at zero
    search = _Search(problem, coordinates, z, rise)
    p = len(z)
    ends = np.full((p, 2, p), np.nan)
    spread = np.clip(deviations(covariance), 1e-12, 0.5)
    for k in range(p):
        for side, sign in enumerate((-1.0, 1.0)):
            found = search.end(k, sign * spread[k] * np.sqrt(rise))
            if found is not None:
                ends[k, side] = found
    return Profile(z, ends)


def _positive(coordinates: Coordinates) -> BoolArray:
    """Return which coordinates are reflected at zero, shape (p,)."""
    return np.array([spec.kind == "positive" for spec in coordinates.model.parameters])


def with_profile(
    table: Mapping[str, Parameter],
    profile: Profile,
    coordinates: Coordinates,
    more: FloatArray,
    coverage: float,
) -> tuple[dict[str, Parameter], dict[str, str]]:
    """Return the parameters with the intervals of the profile where these are wider, and what to say of each.

    Args:
        table: of the parameters, by the covariance.
        profile: of the estimate.
        coordinates: the map from z to parameters.
        more: covariance of z by systematic effects, beside the data, shape (p, p).
        coverage: factor k of the intervals.
    """
    model = coordinates.model
    found = dict(table)
    said = dict[str, str]()
    corners = [coordinates.values(point) for point in profile.points]
    for index, spec in enumerate(model.parameters):
        stated = table[spec.name]
        ends = [
            coordinates.values(end)[spec.name] if np.all(np.isfinite(end)) else None
            for end in profile.ends[index]
        ]
        if ends[0] is not None and ends[1] is not None and ends[0] > ends[1]:  # of a negative gain
            ends.reverse()
        beside = coverage * float(
            np.abs(coordinates.slopes(profile.z)[index]) * np.sqrt(max(more[index, index], 0.0))
        )
        found[spec.name] = wider = _widened(stated, ends, beside, coverage)
        if wider is not stated:
            said[spec.name] = _said(spec.name, wider)
    for quantity in model.derived(coordinates.values(profile.z)):
        values = [complex(quantity.value(corner)).real for corner in corners]  # no resonance: zero
        ends = [min(values, default=None), max(values, default=None)]
        known = all(found[name].standard_uncertainty is not None for name in quantity.needs)
        found[quantity.name] = _widened(
            table[quantity.name], ends if known else [None, None], 0.0, coverage
        )
    return found, said


def _widened(
    stated: Parameter, ends: Sequence[float | None], beside: float, coverage: float
) -> Parameter:
    """Return the parameter with an interval to these ends, itself where it is hardly narrower."""
    value = stated.value
    if ends[0] is None or ends[1] is None:
        if stated.standard_uncertainty is None:
            return stated
        return replace(
            stated, standard_uncertainty=None, interval_95=tuple(ends), identifiable=False
        )
    below, above = (
        float(np.hypot(max(far, 0.0), beside)) for far in (value - ends[0], ends[1] - value)
    )
    u = max(below, above) / coverage
    if stated.standard_uncertainty is not None and u < WIDER * stated.standard_uncertainty:
        return stated
    return replace(stated, standard_uncertainty=u, interval_95=(value - below, value + above))


def _said(name: str, parameter: Parameter) -> str:
    """Return what is said of a parameter with an interval of the profile."""
    low, high = (None if end is None else f"{end:.4g}" for end in parameter.interval_95)
    span = {
        (True, True): f"{low} to {high}",
        (False, True): f"below {high}",
        (True, False): f"above {low}",
    }
    within = span.get((low is not None, high is not None), "anything")
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    return (
        f"The data hardly determine the {in_words(name)}: it is {within}{unit} (95 %), from the profile likelihood, as "
        "χ² is flat or skew there."
    )


@dataclass(frozen=True, eq=False)
class _Search:
    """The search for ends around an estimate."""

    problem: FrequencyProblem
    coordinates: Coordinates
    z: FloatArray
    rise: float

    def end(self, k: int, step: float) -> FloatArray | None:
        """Return the coordinates where χ² has risen, None where it does not up to the end of what is searched."""
        low, high = (float(edge[k]) for edge in self.coordinates.edges)
        low = 0.0 if _positive(self.coordinates)[k] else low
        least = self._cost(self.z)
        inner = self.z
        cost = 0.0
        for _ in range(MAX_OUTWARD):
            target = float(np.clip(inner[k] + step, low, high))
            if target == inner[k]:
                return inner if low == 0.0 and target == 0.0 else None
            outer, risen = self._held(k, target, inner)
            if risen - least >= self.rise:
                return self._between(k, least, (inner, cost), (outer, risen - least))
            inner = outer
            cost = max(risen - least, 0.0)
            step = LONGER * step
        return None

    def _between(
        self, k: int, least: float, inner: tuple[FloatArray, float], outer: tuple[FloatArray, float]
    ) -> FloatArray:
        """Return the end between two places, by the root of the rise, which is straight where χ² is a parabola."""
        for number in range(MAX_INWARD):
            roots = [np.sqrt(max(each[1], 0.0)) for each in (inner, outer)]
            share = (np.sqrt(self.rise) - roots[0]) / max(roots[1] - roots[0], 1e-300)
            share = 0.5 if number % 3 == 2 else float(np.clip(share, 0.05, 0.95))
            target = inner[0][k] + share * (outer[0][k] - inner[0][k])
            there, cost = self._held(k, float(target), inner[0])
            found = there, cost - least
            if abs(found[1] - self.rise) < CLOSE * self.rise:
                return there
            inner, outer = (found, outer) if found[1] < self.rise else (inner, found)
        return outer[0]

    def _held(self, k: int, target: float, start: FloatArray) -> tuple[FloatArray, float]:
        """Return the optimum of the others, and its χ²."""
        free = np.arange(len(start)) != k
        begins = [np.where(free, start, target)]
        kinds = _positive(self.coordinates)
        if np.any(kinds & free & (np.abs(start) < NUDGE)):
            begins.append(np.where(kinds & free, np.maximum(np.abs(start), NUDGE), begins[0]))
        return min((self._down(begin, free) for begin in begins), key=lambda found: found[1])

    def _down(self, z: FloatArray, free: BoolArray) -> tuple[FloatArray, float]:
        """Descend by Levenberg and Marquardt in the free coordinates."""
        damping, (low, high) = 1e-3, self.coordinates.edges
        little = 1e-3 * CLOSE * self.rise
        here = self.problem.normal(z, self.coordinates)
        for _ in range(MAX_STEPS):
            matrix = here.matrix[free][:, free]
            gradient = here.gradient[free]
            power = np.diag(matrix)
            size = np.maximum(power, 1e-12 * max(float(np.max(power)), 1e-300))
            own = np.clip(np.linalg.solve(matrix + damping * np.diag(size), gradient), -1.0, 1.0)
            if own @ (2.0 * gradient - matrix @ own) < little:
                break
            step = np.zeros(len(z))
            step[free] = own
            trial = np.clip(z + step, low, high)
            there = self.problem.normal(trial, self.coordinates)
            if np.isfinite(there.cost) and there.cost <= here.cost:
                settled = here.cost - there.cost < little
                z = trial
                here = there
                damping = 0.1 * damping
                if settled:
                    break
            elif damping > 1e8:
                break
            else:
                damping *= 10.0
        return z, here.cost

    def _cost(self, z: FloatArray) -> float:
        residual = self.problem.residual(z, self.coordinates)
        return float(residual @ residual)
