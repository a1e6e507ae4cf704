"""One natural frequency and damping ratio from free decays: the least-squares problem without a reference.

Initial state, offset, a straight drift and tones of the mains are nuisance parameters of each record; the best ones are
solved for at every (fn, δ), and the Jacobian is projected onto what they leave (variable projection; Kaufman 1975,
Golub & Pereyra 2003). Samples are whitened by the record's own noise, so the estimate is maximum likelihood and its
covariance the Cramér-Rao bound.

The free motion of a damped oscillator, at any damping, is

    y(t) = e^{-δ ωn t} (a cosh μt + b ωn sinh(μt)/μ),   μ² = ωn² (δ² − 1)

Every output of a linear second-order sensor moves like this when nothing drives it: displacement or velocity pickup,
delayed or averaged. Both functions depend on μ² alone, so they pass smoothly from oscillation (μ imaginary) to two real
poles. The gain only scales a and b.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.decay.noise import WHITE, Noise, tone_columns
from vibrident.fit.information import inverse_normal
from vibrident.fit.optimise import Progress, Trace, levenberg_marquardt, silent
from vibrident.fit.problem import Coordinates, Local
from vibrident.physics.models import SensorModel
from vibrident.physics.models.base import OSCILLATOR as NAMES
from vibrident.physics.models.base import Derived
from vibrident.physics.models.cores.accelerometer import ACCELEROMETER

RANK = 1e-10  # singular values below this part of the largest belong to directions that the samples do not show


def oscillator_of(model: SensorModel) -> SensorModel:
    """What of a model free motion tells: natural frequency, damping ratio, and what follows from these alone."""
    core = model.core
    known = tuple(spec for spec in core.parameters if spec.name in NAMES)
    others = {spec.name: 1.0 for spec in core.parameters if spec.name not in NAMES}
    derived = tuple(filter(_without_gain, core.derived))
    response = functools.partial(core.response, **others)
    return SensorModel(
        model.name, replace(core, parameters=known, response=response, derived=derived)
    )


def _without_gain(derived: Derived) -> bool:
    try:
        derived.value(dict.fromkeys(NAMES, 0.1))
    except KeyError:
        return False
    return True


OSCILLATOR = oscillator_of(SensorModel("oscillator", ACCELEROMETER))


def free_motion(
    natural_frequency_hz: float, damping_ratio: float, time_s: FloatArray
) -> FloatArray:
    """The two functions that span the free motion, shape (samples, 2).

    ``natural_frequency_hz``: of the undamped oscillator; ``damping_ratio``: any; ``time_s``: from the beginning of the
    motion, shape (samples,).
    """
    angle = 2.0 * np.pi * natural_frequency_hz * np.asarray(time_s, dtype=float)
    square = damping_ratio**2 - 1.0
    if square < 0.0:
        envelope = np.exp(
            np.minimum(-damping_ratio * angle, 300.0)
        )  # a difference about no damping may grow
        turned = np.sqrt(-square) * angle
        return np.stack(
            [envelope * np.cos(turned), envelope * angle * np.sinc(turned / np.pi)], axis=1
        )
    slow = np.exp(-angle / (damping_ratio + np.sqrt(square)))  # δ − √(δ² − 1) loses its digits
    twice = 2.0 * np.sqrt(square) * angle
    ratio = np.where(twice > 0, -np.expm1(-twice) / np.where(twice > 0, twice, 1.0), 1.0)
    return np.stack([0.5 * slow * (1.0 + np.exp(-twice)), slow * angle * ratio], axis=1)


def motion_slopes(
    natural_frequency_hz: float, damping_ratio: float, time_s: FloatArray
) -> FloatArray:
    """Derivatives of :func:`free_motion` by (ln fn, δ), shape (2, samples, 2), by central differences."""

    def at(log_frequency: float, damping: float) -> FloatArray:
        return free_motion(
            natural_frequency_hz * np.exp(log_frequency), damping_ratio + damping, time_s
        )

    step = 1e-5  # error and rounding are below 1e-9 of the motion
    return np.stack([at(step, 0.0) - at(-step, 0.0), at(0.0, step) - at(0.0, -step)]) / (2.0 * step)


@dataclass(frozen=True, eq=False)
class Stretch:
    """The part of a record in which the sensor moves freely."""

    name: str  # of the record
    first: int  # index of the stretch's first sample in the record
    response: FloatArray  # shape (samples,), filled where not valid
    valid: BoolArray  # shape (samples,)
    rate_hz: float  # samples per second
    noise: Noise = WHITE  # what whitens it
    scale: float = 1.0  # standard deviation of the whitened noise
    drift: bool = False  # whether a straight line is among the unknowns
    more: FloatArray | None = (
        None  # further unknowns' columns, shape (samples, n); None for no further unknowns
    )

    @property
    def time_s(self) -> FloatArray:
        """From the stretch's first sample."""
        return np.arange(self.response.size) / self.rate_hz

    @property
    def rows(self) -> BoolArray:
        """Samples that count once whitened."""
        return self.noise.rows(self.valid)

    def whitened(self, columns: FloatArray) -> FloatArray:
        """Columns, shape (samples, n), in units of the noise: the rows that count."""
        return self.noise.applied(columns)[self.rows] / self.scale

    def beside(self) -> FloatArray:
        """Offset, drift, tones and further linear unknowns, shape (samples, n)."""
        time = self.time_s
        parts = [np.ones((time.size, 1))]
        if self.drift:
            parts.append((time / time[-1] - 0.5)[:, None])
        if self.more is not None:
            parts.append(self.more)
        if self.noise.tones_hz:
            parts.append(tone_columns(self.noise.tones_hz, time))
        return np.concatenate(parts, axis=1)


def basis_of(columns: FloatArray) -> FloatArray:
    """Orthonormal basis of columns, shape (rows, rank)."""
    left, size, _ = np.linalg.svd(unit(columns), full_matrices=False)
    return left[:, size > RANK * size[0]]


def unit(columns: FloatArray) -> FloatArray:
    """Columns of unit length; those of zeros stay."""
    return columns / _sizes(columns)


def _sizes(columns: FloatArray) -> FloatArray:
    sizes = np.linalg.norm(columns, axis=0)
    return np.where(sizes > 0.0, sizes, 1.0)


@dataclass(frozen=True, eq=False)
class Projected:
    """A stretch at one (fn, δ), with the nuisance parameters at their best."""

    residual: FloatArray  # whitened, shape (rows,)
    jacobian: FloatArray  # of it by (ln fn, δ), projected, shape (rows, 2)
    spanned: FloatArray  # orthonormal basis of the nuisance columns, shape (rows, n)
    linear: FloatArray  # the nuisance parameters: the two of the motion first


def projected(stretch: Stretch, natural_frequency_hz: float, damping_ratio: float) -> Projected:
    """Solve for everything linear at given (fn, δ)."""
    time = stretch.time_s
    motion = free_motion(natural_frequency_hz, damping_ratio, time)
    columns = np.concatenate([motion, stretch.beside()], axis=1)
    seen = stretch.whitened(columns)
    sizes = _sizes(seen)
    u, s, vt = np.linalg.svd(seen / sizes, full_matrices=False)
    kept = s > RANK * s[0]
    spanned = u[:, kept]
    target = stretch.whitened(stretch.response[:, None])[:, 0]
    linear = (vt[kept].T @ ((spanned.T @ target) / s[kept])) / sizes
    slopes = motion_slopes(natural_frequency_hz, damping_ratio, time) @ linear[:2]
    turned = stretch.whitened(slopes.T)
    turned = turned - spanned @ (spanned.T @ turned)
    return Projected(target - spanned @ (spanned.T @ target), -turned, spanned, linear)


@dataclass(frozen=True, eq=False)
class DecayProblem:
    """Stretches of free motion of one oscillator, each with its own nuisance parameters and noise."""

    stretches: tuple[Stretch, ...]
    coordinates: Coordinates  # of natural frequency and damping ratio

    @classmethod
    def about(
        cls, stretches: Sequence[Stretch], natural_frequency_hz: float, damping_ratio: float
    ) -> DecayProblem:
        """With coordinates that begin at these values."""
        lowest = 1.0 / max(s.response.size / s.rate_hz for s in stretches)
        band = lowest, 0.5 * max(s.rate_hz for s in stretches)
        start = dict[str, float](zip(NAMES, (natural_frequency_hz, damping_ratio), strict=True))
        return cls(tuple(stretches), Coordinates.at(OSCILLATOR, start, band))

    def at(self, z: FloatArray) -> tuple[Projected, ...]:
        """Every stretch at coordinates ``z``, shape (2,)."""
        values = self.coordinates.values(z)
        return tuple(
            projected(stretch, *(values[name] for name in NAMES)) for stretch in self.stretches
        )

    def normal(self, z: FloatArray, _: Any = None) -> Local:
        """Cost, gradient and normal matrix at ``z``, shape (2,)."""
        found, slopes = self.at(z), self.coordinates.slopes(z)
        turn = slopes / [self.coordinates.values(z)[NAMES[0]], 1.0]
        residual, jacobian = (
            np.concatenate([getattr(one, x) for one in found]) for x in ("residual", "jacobian")
        )
        return Local.of(residual, jacobian * turn)


@dataclass(frozen=True, eq=False)
class DecayFit:
    """A decay problem at its optimum, or where it is looked at."""

    problem: DecayProblem
    z: FloatArray  # shape (2,)
    trace: Trace | None = None  # of the descent

    @functools.cached_property
    def values(self) -> tuple[float, float]:
        """Natural frequency, Hz, and damping ratio."""
        found = self.problem.coordinates.values(self.z)
        return found[NAMES[0]], found[NAMES[1]]

    @property
    def stretches(self) -> tuple[Stretch, ...]:
        """With their noise."""
        return self.problem.stretches

    @functools.cached_property
    def parts(self) -> tuple[Projected, ...]:
        """The stretches there."""
        return self.problem.at(self.z)

    @property
    def residual(self) -> FloatArray:
        """Whitened, of all stretches, shape (rows,)."""
        return np.concatenate([part.residual for part in self.parts])

    @property
    def cost(self) -> float:
        """Sum of squares of the whitened residual."""
        return float(self.residual @ self.residual)

    @property
    def covariance(self) -> FloatArray:
        """Of the coordinates, for whitened noise of variance one, shape (2, 2)."""
        return inverse_normal(np.asarray(self.problem.normal(self.z).matrix))

    def free(self, index: int = 0) -> FloatArray:
        """The motion of a stretch, without offset, drift and tones, shape (samples,)."""
        return (
            free_motion(*self.values, self.stretches[index].time_s) @ self.parts[index].linear[:2]
        )

    def predicted(self, index: int) -> FloatArray:
        """All of a stretch that is no noise, shape (samples,)."""
        return self.free(index) + self.stretches[index].beside() @ self.parts[index].linear[2:]

    def again(self, *stretches: Stretch) -> DecayFit:
        """Other stretches, fitted from here."""
        return fit(stretches, *self.values)


def fit(
    stretches: Sequence[Stretch],
    natural_frequency_hz: float,
    damping_ratio: float,
    progress: Progress = silent,
) -> DecayFit:
    """The optimum from a start, beside the reflection at no damping."""
    problem = DecayProblem.about(stretches, natural_frequency_hz, max(damping_ratio, 1e-6))
    trace = levenberg_marquardt(problem.normal, problem.coordinates.first, None, progress=progress)
    return DecayFit(problem, trace.last, trace)


def shortened(stretch: Stretch, first: int, last: int | None = None) -> Stretch:
    """The samples of a stretch from ``first`` to ``last``, as a stretch."""
    response, valid = stretch.response[first:last], stretch.valid[first:last]
    return replace(stretch, first=stretch.first + first, response=response, valid=valid)
