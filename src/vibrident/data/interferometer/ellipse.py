"""The ellipse that two signals in quadrature draw, fitted with noise in both of them.

    u = centre + M (cos φ, sin φ)ᵀ,    M = ((A, 0), (B sin ε, B cos ε))

In the coordinates v = M⁻¹(u − centre) the ellipse is the unit circle. Errors p, q (centre), a, b
(amplitudes) and e (quadrature) of the present ellipse change |v|² by 2 (p c + q s + a c² + b s² + e
s c), which is linear: Gauss–Newton steps on noise-corrected sums of powers (:mod:`moments`), until
convergence. The noise follows from the residual |v|² − 1. All samples have the same weight, because
the distance is taken from the unit circle. The plain algebraic fit is biased low by noise; this one
is unbiased.

Ratio of the amplitudes and quadrature have a prior far wider than any set-up. It matters only if
the motion is below a fringe and the arc does not determine them; it is then most of the
uncertainty.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from vibrident.data.interferometer import moments
from vibrident.data.interferometer.setting import FloatArray

PRIOR = 0.25  # standard deviation of the prior of log(B/A) and of ε (rad)
# least part of a direction's apparent information that is taken for real, the rest being noise
LEAST_PART = 0.02
LEAST_SHOWN = 0.08  # an ellipse is not determined where this part is smaller
TOLERANCE = 1e-9  # length of a step, relative to the amplitudes, that ends them
LONGEST_STEP = 0.3  # longest step
# largest change of the area from the start; beyond it the samples do not determine the ellipse
FURTHEST = 10.0
FEWEST_BLOCKS = (
    20  # fewest blocks of samples from which the scatter beyond white noise is estimated
)
_EXCESS = np.array([-1.0, 0.0, 0.0, 1.0, 0.0, 1.0])  # |v|² − 1 in the six functions
_SLOPES = np.eye(6)[[1, 2, 3, 5, 4]]  # c, s, c², s², s c in them
#: From (p, q, a, b, e) to the shape, which changes the phase: p, q, b − a, e; and back.
_SHAPE = np.array([[1.0, 0, 0, 0, 0], [0, 1.0, 0, 0, 0], [0, 0, -1.0, 1.0, 0], [0, 0, 0, 0, 1.0]])
_BACK = _SHAPE.T / np.array([1.0, 1.0, 2.0, 1.0])


@dataclass(frozen=True, eq=False)
class Ellipse:
    """An ellipse with the covariance of p, q, a, b, e, relative to its amplitudes."""

    centre: FloatArray  # of the ellipse, shape (2,), in units of the signals
    matrix: FloatArray  # M, shape (2, 2), lower triangular
    covariance: FloatArray  # of (p, q, a, b, e), shape (5, 5)
    noise: FloatArray  # variances of the noise of a sample of both signals, shape (2,)

    @property
    def amplitudes(self) -> tuple[float, float]:
        """Return a and B."""
        return float(self.matrix[0, 0]), float(np.hypot(*self.matrix[1]))

    @property
    def quadrature_error_rad(self) -> float:
        """Return ε: the second signal is B sin(φ + ε)."""
        return float(np.arctan2(self.matrix[1, 0], self.matrix[1, 1]))

    @functools.cached_property
    def inverse(self) -> FloatArray:
        """Return M⁻¹, shape (2, 2)."""
        return np.asarray(np.linalg.inv(self.matrix), dtype=float)

    @functools.cached_property
    def radial_noise(self) -> float:
        """Return the standard deviation of the noise over the amplitude, its mean over the circle."""
        inverse = self.inverse
        return float(np.sqrt(0.5 * np.trace(inverse @ np.diag(self.noise) @ inverse.T)))

    @property
    def for_phase(self) -> Ellipse:
        """Return the ellipse that gives unbiased mean phases of noisy samples.

        Anisotropic noise biases the angle by −cov(tangential, radial): ½ (N₁₁ − N₂₂) sin 2φ − N₁₂
        cos 2φ, with N its covariance in the coordinates of the unit circle.
        """
        inverse = self.inverse
        noise = inverse @ np.diag(self.noise) @ inverse.T
        apart = float(noise[0, 0] - noise[1, 1])
        return self.changed(
            np.array([0.0, 0.0, -0.5 * apart, 0.5 * apart, -2.0 * float(noise[0, 1])])
        )

    def round(self, u: FloatArray) -> FloatArray:
        """Return the signals, shape (2, n), as v: cos φ and sin φ with their noise, in their precision, shape (2, n)."""
        (first, _), (skew, second) = self.inverse.tolist()
        v = np.empty_like(u)
        for row, (centre, scale) in enumerate(
            zip(self.centre.tolist(), (first, second), strict=True)
        ):
            np.subtract(u[row], centre, out=v[row])
            v[row] *= scale
        if skew != 0.0:
            v[1] += (skew / first) * v[0]
        return v

    def difference(self, other: Ellipse) -> FloatArray:
        """Return (p, q, a, b, e) of another ellipse seen in the coordinates of this one, shape (5,)."""
        inverse = self.inverse
        shift = inverse @ (other.centre - self.centre)
        change = inverse @ other.matrix - np.eye(2)
        return np.array([*shift, change[0, 0], change[1, 1], change[1, 0]])

    def shape_of(self, other: Ellipse) -> FloatArray:
        """Return the shape (p, q, b − a, e) of another ellipse seen in the coordinates of this one, shape (4,)."""
        return _SHAPE @ self.difference(other)

    @property
    def shape_covariance(self) -> FloatArray:
        """Return the covariance of the shape (p, q, b − a, e), shape (4, 4)."""
        return _SHAPE @ self.covariance @ _SHAPE.T

    def known_to(self, covariance: FloatArray) -> Ellipse:
        """Return the ellipse with another covariance of its shape, shape (4, 4)."""
        return replace(self, covariance=_BACK @ covariance @ _BACK.T)

    def reshaped(self, by: FloatArray) -> Ellipse:
        """Return the ellipse of the same size whose shape differs by (p, q, b − a, e)."""
        return self.changed(_BACK @ by)

    def changed(self, by: FloatArray) -> Ellipse:
        """Return the ellipse that differs from this one by (p, q, a, b, e)."""
        p, q, a, b, e = by
        change = np.array([[1.0 + a, 0.0], [e, 1.0 + b]])
        return replace(
            self, centre=self.centre + self.matrix @ np.array([p, q]), matrix=self.matrix @ change
        )


def circle(u: FloatArray) -> Ellipse:
    """Return a circle through samples, shape (2, n): the algebraic fit without second-order bias.

    Source: Al-Sharadqah & Chernov (2009), "Error analysis for circle fitting algorithms" (the fit
    they call Hyper).
    """
    middle = np.mean(u, axis=1)
    size = float(np.sqrt(np.mean((u - middle[:, None]) ** 2))) or 1.0
    x, y = (u - middle[:, None]) / size
    square = x * x + y * y
    rows = np.stack([square, x, y, np.ones_like(x)])
    mean = rows @ rows.T / x.shape[0]
    constraint = np.diag([8.0 * mean[0, 3], 1.0, 1.0, 0.0])
    constraint[0, 3] = constraint[3, 0] = 2.0
    values, vectors = np.linalg.eig(np.linalg.solve(constraint, mean))
    real = np.where(
        np.abs(np.imag(values)) < 1e-9 * np.abs(values) + 1e-15, np.real(values), np.inf
    )
    chosen = int(np.argmin(np.where(real > -1e-12, real, np.inf)))
    weight, p, q, rest = np.real(vectors[:, chosen])
    weight = weight if abs(weight) > 1e-9 else 1e-9
    centre = -0.5 * np.array([p, q]) / weight
    radius = float(np.sqrt(max(centre @ centre - rest / weight, 1e-6)))
    noise = max(float(real[chosen]), 1e-12 * radius**2) if np.isfinite(real[chosen]) else 1e-6
    return Ellipse(
        middle + size * centre, size * radius * np.eye(2), np.eye(5), np.full(2, noise * size**2)
    )


def fit(blocks: Sequence[FloatArray], start: Ellipse) -> Ellipse | None:
    """Fit an ellipse to sums of powers in the signals' own units; None if the samples do not determine it.

    ``blocks``: of pieces of the signals, each of shape (5, 5); ``start``: to begin with; the ratio
    of its noise variances is kept.
    """
    whole = np.sum(blocks, axis=0)
    ellipse = replace(start, noise=_noise(whole, start))
    found = False
    for _ in range(100):
        try:
            step, *_ = _step(whole, ellipse)
        except linalg.LinAlgError:  # the samples lie on a line, or nearly
            return None
        length = float(np.max(np.abs(step)))
        ellipse = ellipse.changed(step * min(1.0, LONGEST_STEP / max(length, 1e-300)))
        ellipse = replace(ellipse, noise=_noise(whole, ellipse))
        size = float(np.prod(np.diag(ellipse.matrix)) / np.prod(np.diag(start.matrix)))
        if not np.isfinite(size) or not 1.0 / FURTHEST < size < FURTHEST:
            break
        if length < TOLERANCE:
            found = True
            break
    _, information, part = _step(whole, ellipse)
    if not found or part < LEAST_SHOWN:
        return None
    covariance = np.linalg.inv(information)
    return replace(ellipse, covariance=covariance * _inflation(blocks, whole, ellipse))


def as_circle(u: FloatArray, samples: float) -> Ellipse:
    """Return a circle through a short arc, with the uncertainty that the prior of the ellipse leaves.

    ``u``: samples, shape (2, n); ``samples``: number of all samples.
    """
    found = circle(u)
    c, s = found.round(u) / np.hypot(*found.round(u))
    slopes = np.stack([c, s, np.ones_like(c), 0.5 * (s * s - c * c), s * c])
    products = slopes @ slopes.T / u.shape[1]
    inner = np.linalg.inv(products[:3, :3] + 1e-12 * np.eye(3))
    follows = -inner @ products[:3, 3:]  # response of the circle to these errors
    noise = inner * found.radial_noise**2 / samples
    part = np.block([[noise, np.zeros((3, 2))], [np.zeros((2, 5))]])
    both = np.concatenate([follows, np.eye(2)])
    change = np.array(
        [[1, 0, 0, 0, 0], [0, 1, 0, 0, 0], [0, 0, 1, -0.5, 0], [0, 0, 1, 0.5, 0], [0, 0, 0, 0, 1.0]]
    )
    return replace(found, covariance=change @ (part + PRIOR**2 * both @ both.T) @ change.T)


def excess(block: FloatArray, ellipse: Ellipse) -> float:
    """Return the mean of |v|² − 1 of a block without its noise: twice the relative deviation of its amplitude."""
    clean = _rounded(block, ellipse, ellipse.noise)
    return float(_EXCESS @ clean[:, 0] / clean[0, 0])


def _rounded(found: FloatArray, ellipse: Ellipse, noise: FloatArray | None) -> FloatArray:
    """Return the matrix of products of the six functions of v; noise-corrected if the noise is given."""
    change = moments.moved(ellipse.centre, ellipse.inverse)
    clean = found if noise is None else moments.without_noise(found, np.diag(noise))
    return change @ moments.matrix(clean) @ change.T


def _noise(whole: FloatArray, ellipse: Ellipse) -> FloatArray:
    """Return the variances of the noise from the residual |v|² − 1: mean square 4 nᵀNn + 2 tr N² + (tr N)²."""
    count = whole[0, 0]
    inverse = ellipse.inverse
    shape = inverse @ np.diag(ellipse.noise) @ inverse.T
    seen = _rounded(whole, ellipse, None)
    square = max(float(_EXCESS @ seen @ _EXCESS) / count, 1e-24)
    around = seen[1:3, 1:3] / count
    first = 4.0 * float(np.sum(shape * around))
    second = 2.0 * float(np.sum(shape**2)) + float(np.trace(shape)) ** 2
    second -= 4.0 * float(np.sum(shape * shape))  # the samples' own noise in ``around``
    times = square / max(first, 1e-300)
    for _ in range(20):
        times = square / (first + second * times) if first + second * times > 0 else times
    return ellipse.noise * max(times, 1e-18)


def _step(whole: FloatArray, ellipse: Ellipse) -> tuple[FloatArray, FloatArray, float]:
    """Return the Gauss–Newton step of (p, q, a, b, e), its information, and the noise-free part of its worst direction.

    In a direction dominated by noise, a least part of the apparent information is used.
    """
    clean = _rounded(whole, ellipse, ellipse.noise)
    seen = _rounded(whole, ellipse, None)
    variance = ellipse.radial_noise**2
    gradient = 0.5 * _SLOPES @ clean @ _EXCESS / variance
    known = np.zeros((5, 5))
    a, b = ellipse.amplitudes
    for direction, value in zip(
        _SHAPE[2:], (float(np.log(b / a)), ellipse.quadrature_error_rad), strict=True
    ):
        known += np.outer(direction, direction) / PRIOR**2
        gradient = gradient - direction * value / PRIOR**2
    raw = _SLOPES @ seen @ _SLOPES.T / variance
    # vectorsᵀ raw vectors = 1
    part, vectors = linalg.eigh(_SLOPES @ clean @ _SLOPES.T / variance, raw)
    back = raw @ vectors
    information = (back * np.maximum(part, LEAST_PART)) @ back.T + known
    return np.linalg.solve(information, gradient), information, float(part[0])


def _inflation(blocks: Sequence[FloatArray], whole: FloatArray, ellipse: Ellipse) -> float:
    """Return the factor of the variance over that of white noise, from the scatter of the blocks."""
    if len(blocks) < FEWEST_BLOCKS:
        return 1.0
    variance = ellipse.radial_noise**2
    scores = [
        0.5 * _SLOPES @ _rounded(block, ellipse, ellipse.noise) @ _EXCESS / variance
        for block in blocks
    ]
    scatter = np.var(np.array(scores), axis=0, ddof=1) * len(blocks)
    expected = np.diag(_SLOPES @ _rounded(whole, ellipse, None) @ _SLOPES.T) / variance
    return max(float(np.mean(scatter / np.maximum(expected, 1e-300))), 1.0)
