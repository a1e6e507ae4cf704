"""Least-squares problem of one natural frequency and damping ratio from free decays.

Initial state, offset, a straight drift and tones of the mains are nuisance parameters of each
record. The best ones are solved for at every (fn, δ), and the Jacobian is projected onto their
complement (variable projection; Kaufman 1975, Golub & Pereyra 2003). Samples are whitened by the
noise of the record, so the estimate is maximum likelihood and its covariance the Cramér-Rao bound.

The free motion of a damped oscillator, at any damping, is

    y(t) = e^{-δ ωn t} (a cosh μt + b ωn sinh(μt)/μ),   μ² = ωn² (δ² − 1)

Every output of a linear second-order sensor moves like this when nothing drives it: displacement or
velocity pickup, delayed or averaged. Both functions depend on μ² alone, so they pass smoothly from
oscillation (μ imaginary) to two real poles. The gain only scales a and b.

A channel of known response adds free motion at its own poles, e^{pt}, whose amplitudes are further
linear unknowns. Its zeros, its gain and its delay do not matter.
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

#: Poles that differ by less than this part of one are the same.
SAME_POLE = 1e-6
#: Singular values below this fraction of the largest belong to directions without information.
MIN_SINGULAR_VALUE = 1e-10


def oscillator_of(model: SensorModel) -> SensorModel:
    """Return the part of a model that free motion determines.

    It has natural frequency, damping ratio, and the quantities that follow from these alone.
    """
    core = model.core
    parameters = tuple(spec for spec in core.parameters if spec.name in NAMES)
    fixed = {spec.name: 1.0 for spec in core.parameters if spec.name not in NAMES}
    derived = tuple(filter(_without_gain, core.derived))
    response = functools.partial(core.response, **fixed)
    return SensorModel(
        model.name, replace(core, parameters=parameters, response=response, derived=derived)
    )


def _without_gain(derived: Derived) -> bool:
    """Return whether a derived quantity needs natural frequency and damping ratio alone."""
    try:
        derived.value(dict.fromkeys(NAMES, 0.1))
    except KeyError:
        return False
    return True


OSCILLATOR = oscillator_of(SensorModel("oscillator", ACCELEROMETER))


def free_motion(
    natural_frequency_hz: float, damping_ratio: float, time_s: FloatArray
) -> FloatArray:
    """Return the two functions that span the free motion, shape (samples, 2).

    Args:
        natural_frequency_hz: of the undamped oscillator.
        damping_ratio: any.
        time_s: from the beginning of the motion, shape (samples,).
    """
    angle = 2.0 * np.pi * natural_frequency_hz * time_s
    square = damping_ratio**2 - 1.0
    if square < 0.0:
        # Differences about no damping may grow.
        envelope = np.exp(np.minimum(-damping_ratio * angle, 300.0))
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
    """Return the derivatives of :func:`free_motion` by (ln fn, δ), shape (2, samples, 2).

    By central differences.
    """

    def at(log_frequency: float, damping: float) -> FloatArray:
        return free_motion(
            natural_frequency_hz * np.exp(log_frequency), damping_ratio + damping, time_s
        )

    step = 1e-5  # error and rounding are below 1e-9 of the motion
    return np.stack([at(step, 0.0) - at(-step, 0.0), at(0.0, step) - at(0.0, -step)]) / (2.0 * step)


@dataclass(frozen=True, eq=False)
class Stretch:
    """Stretch of a record in which the sensor moves freely.

    Attributes:
        name: of the record.
        first: index of the first sample in the record.
        response: shape (samples,), interpolated where not valid.
        valid: shape (samples,).
        rate_hz: sampling rate.
        noise: by which the samples are whitened.
        scale: standard deviation of the whitened noise.
        drift: whether a straight line is among the unknowns.
        further_columns: of further unknowns, shape (samples, n); None without any.
        channel_poles: of the recording channel, 1/s, those of positive imaginary part or real.
    """

    name: str
    first: int
    response: FloatArray
    valid: BoolArray
    rate_hz: float
    noise: Noise = WHITE
    scale: float = 1.0
    drift: bool = False
    further_columns: FloatArray | None = None
    channel_poles: tuple[complex, ...] = ()

    @property
    def time_s(self) -> FloatArray:
        """Return the times from the first sample of the stretch."""
        return np.arange(self.response.size) / self.rate_hz

    @property
    def rows(self) -> BoolArray:
        """Return which samples count once whitened."""
        return self.noise.rows(self.valid)

    def whitened(self, columns: FloatArray) -> FloatArray:
        """Return the rows that count of columns, shape (samples, n), in units of the noise."""
        return self.noise.applied(columns)[self.rows] / self.scale

    def nuisance_columns(self) -> FloatArray:
        """Return offset, drift, tones and further linear unknowns, shape (samples, n)."""
        time = self.time_s
        columns = [np.ones((time.size, 1))]
        if self.drift:
            columns.append((time / time[-1] - 0.5)[:, None])
        if self.channel_poles:
            columns.append(pole_columns(self.channel_poles, time))
        if self.further_columns is not None:
            columns.append(self.further_columns)
        if self.noise.tones_hz:
            columns.append(tone_columns(self.noise.tones_hz, time))
        return np.concatenate(columns, axis=1)


def pole_columns(poles: Sequence[complex], time_s: FloatArray) -> FloatArray:
    """Return the free motion of poles, real and imaginary part of each, shape (samples, n).

    Each repetition of a pole has another factor t.
    """
    columns = [np.zeros((time_s.size, 0))]
    for number, pole in enumerate(poles):
        order = sum(abs(earlier - pole) < SAME_POLE * abs(pole) for earlier in poles[:number])
        wave = (time_s / time_s[-1]) ** order * np.exp(pole * time_s)
        columns.append(wave.real[:, None])
        if pole.imag > 0.0:
            columns.append(wave.imag[:, None])
    return np.concatenate(columns, axis=1)


def basis_of(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis of columns, shape (rows, rank)."""
    left_vectors, singular_values, _ = np.linalg.svd(unit(columns), full_matrices=False)
    return left_vectors[:, singular_values > MIN_SINGULAR_VALUE * singular_values[0]]


def unit(columns: FloatArray) -> FloatArray:
    """Return columns scaled to unit length; columns of zeros stay."""
    return columns / _sizes(columns)


def _sizes(columns: FloatArray) -> FloatArray:
    """Return the length of each column, one for a column of zeros."""
    sizes = np.linalg.norm(columns, axis=0)
    return np.where(sizes > 0.0, sizes, 1.0)


@dataclass(frozen=True, eq=False)
class Projected:
    """Stretch at one (fn, δ), with the nuisance parameters at their best.

    Attributes:
        residual: whitened, shape (rows,).
        jacobian: of the residual by (ln fn, δ), projected, shape (rows, 2).
        spanned: orthonormal basis of the nuisance columns, shape (rows, n).
        linear: the nuisance parameters, the two of the motion first.
    """

    residual: FloatArray
    jacobian: FloatArray
    spanned: FloatArray
    linear: FloatArray


def projected(stretch: Stretch, natural_frequency_hz: float, damping_ratio: float) -> Projected:
    """Return a stretch at (fn, δ), solved for everything linear."""
    time = stretch.time_s
    motion = free_motion(natural_frequency_hz, damping_ratio, time)
    columns = np.concatenate([motion, stretch.nuisance_columns()], axis=1)
    whitened = stretch.whitened(columns)
    sizes = _sizes(whitened)
    u, s, vt = np.linalg.svd(whitened / sizes, full_matrices=False)
    independent = s > MIN_SINGULAR_VALUE * s[0]
    spanned = u[:, independent]
    target = stretch.whitened(stretch.response[:, None])[:, 0]
    linear = (vt[independent].T @ ((spanned.T @ target) / s[independent])) / sizes
    slopes = motion_slopes(natural_frequency_hz, damping_ratio, time) @ linear[:2]
    jacobian = stretch.whitened(slopes.T)
    jacobian = jacobian - spanned @ (spanned.T @ jacobian)
    return Projected(target - spanned @ (spanned.T @ target), -jacobian, spanned, linear)


@dataclass(frozen=True, eq=False)
class DecayProblem:
    """Stretches of free motion of one oscillator, each with its own nuisance parameters and noise.

    Attributes:
        stretches: the stretches.
        coordinates: of natural frequency and damping ratio.
    """

    stretches: tuple[Stretch, ...]
    coordinates: Coordinates

    @classmethod
    def about(
        cls, stretches: Sequence[Stretch], natural_frequency_hz: float, damping_ratio: float
    ) -> DecayProblem:
        """Return the problem with coordinates that begin at these values."""
        lowest = 1.0 / max(s.response.size / s.rate_hz for s in stretches)
        band = lowest, 0.5 * max(s.rate_hz for s in stretches)
        start = dict[str, float](zip(NAMES, (natural_frequency_hz, damping_ratio), strict=True))
        return cls(tuple(stretches), Coordinates.at(OSCILLATOR, start, band))

    def at(self, z: FloatArray) -> tuple[Projected, ...]:
        """Return every stretch at coordinates ``z``, shape (2,)."""
        values = self.coordinates.values(z)
        return tuple(
            projected(stretch, *(values[name] for name in NAMES)) for stretch in self.stretches
        )

    def normal(self, z: FloatArray, _: Any = None) -> Local:
        """Return cost, gradient and normal matrix at ``z``, shape (2,)."""
        stretches = self.at(z)
        slopes = self.coordinates.slopes(z)
        scale = slopes / [self.coordinates.values(z)[NAMES[0]], 1.0]
        residual, jacobian = (
            np.concatenate([getattr(stretch, name) for stretch in stretches])
            for name in ("residual", "jacobian")
        )
        return Local.of(residual, jacobian * scale)


@dataclass(frozen=True, eq=False)
class DecayFit:
    """Decay problem at its optimum or another point.

    Attributes:
        problem: the problem.
        z: coordinates, shape (2,).
        trace: of the descent, if any.
    """

    problem: DecayProblem
    z: FloatArray
    trace: Trace | None = None

    @functools.cached_property
    def values(self) -> tuple[float, float]:
        """Return natural frequency, Hz, and damping ratio."""
        values = self.problem.coordinates.values(self.z)
        return values[NAMES[0]], values[NAMES[1]]

    @property
    def stretches(self) -> tuple[Stretch, ...]:
        """Return the stretches with their noise."""
        return self.problem.stretches

    @functools.cached_property
    def parts(self) -> tuple[Projected, ...]:
        """Return the stretches at the point of the fit."""
        return self.problem.at(self.z)

    @property
    def residual(self) -> FloatArray:
        """Return the whitened residual of all stretches, shape (rows,)."""
        return np.concatenate([stretch.residual for stretch in self.parts])

    @property
    def cost(self) -> float:
        """Return the sum of squares of the whitened residual."""
        return float(self.residual @ self.residual)

    @property
    def covariance(self) -> FloatArray:
        """Return the covariance of the coordinates in unit noise, shape (2, 2)."""
        return inverse_normal(self.problem.normal(self.z).matrix)

    def free(self, index: int = 0) -> FloatArray:
        """Return the motion of a stretch, without offset, drift and tones, shape (samples,)."""
        return (
            free_motion(*self.values, self.stretches[index].time_s) @ self.parts[index].linear[:2]
        )

    def predicted(self, index: int) -> FloatArray:
        """Return the motion of a stretch with its nuisances, shape (samples,)."""
        return (
            self.free(index)
            + self.stretches[index].nuisance_columns() @ self.parts[index].linear[2:]
        )

    def refitted(self, *stretches: Stretch) -> DecayFit:
        """Return the fit of other stretches, started from this one."""
        return fit(stretches, *self.values)


def fit(
    stretches: Sequence[Stretch],
    natural_frequency_hz: float,
    damping_ratio: float,
    progress: Progress = silent,
) -> DecayFit:
    """Return the optimum from a start value.

    A start of no or negative damping is moved off zero, where the coordinate is reflected.
    """
    problem = DecayProblem.about(stretches, natural_frequency_hz, max(damping_ratio, 1e-6))
    trace = levenberg_marquardt(problem.normal, problem.coordinates.first, None, progress=progress)
    return DecayFit(problem, trace.last, trace)


def shortened(stretch: Stretch, first: int, last: int | None = None) -> Stretch:
    """Return the samples of a stretch from ``first`` to ``last`` as a stretch."""
    return replace(
        stretch,
        first=stretch.first + first,
        response=stretch.response[first:last],
        valid=stretch.valid[first:last],
    )
