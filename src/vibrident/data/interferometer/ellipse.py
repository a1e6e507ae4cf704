"""Fit the ellipse that two signals in quadrature draw, with noise in both of them.

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

PRIOR_DEVIATION = 0.25  # standard deviation of the prior of log(B/A) and of ε (rad)
# smallest noise-free share of a direction's apparent information that is used in a step
MIN_NOISE_FREE_SHARE = 0.02
# an ellipse is not determined if this share is smaller in any direction
MIN_DETERMINED_SHARE = 0.08
TOLERANCE = 1e-9  # the iteration ends at a step of this length, relative to the amplitudes
MAX_STEP = 0.3  # longest step, relative to the amplitudes
MAX_AREA_RATIO = 10.0  # beyond this change of the area the samples do not determine the ellipse
MIN_BLOCKS = 20  # fewest blocks from which the scatter beyond white noise is estimated
_EXCESS = np.array([-1.0, 0.0, 0.0, 1.0, 0.0, 1.0])  # |v|² − 1 in the six functions
_SLOPES = np.eye(6)[[1, 2, 3, 5, 4]]  # c, s, c², s², s c in the six functions
#: From (p, q, a, b, e) to the shape, which changes the phase: p, q, b − a, e; and back.
_SHAPE = np.array([[1.0, 0, 0, 0, 0], [0, 1.0, 0, 0, 0], [0, 0, -1.0, 1.0, 0], [0, 0, 0, 0, 1.0]])
_BACK = _SHAPE.T / np.array([1.0, 1.0, 2.0, 1.0])


@dataclass(frozen=True, eq=False)
class Ellipse:
    """Ellipse with the covariance of p, q, a, b, e, relative to its amplitudes."""

    centre: FloatArray  # of the ellipse, shape (2,), in units of the signals
    matrix: FloatArray  # M, shape (2, 2), lower triangular
    covariance: FloatArray  # of (p, q, a, b, e), shape (5, 5)
    noise: FloatArray  # variances of the noise of a sample of both signals, shape (2,)

    @property
    def amplitudes(self) -> tuple[float, float]:
        """Return the amplitudes A and B, in units of the signals."""
        return float(self.matrix[0, 0]), float(np.hypot(*self.matrix[1]))

    @property
    def quadrature_error_rad(self) -> float:
        """Return the quadrature error ε: the second signal is B sin(φ + ε)."""
        return float(np.arctan2(self.matrix[1, 0], self.matrix[1, 1]))

    @functools.cached_property
    def inverse(self) -> FloatArray:
        """Return the inverse of M, shape (2, 2)."""
        return np.asarray(np.linalg.inv(self.matrix), dtype=float)

    @functools.cached_property
    def radial_noise(self) -> float:
        """Return the standard deviation of the noise over the amplitude, a mean over the circle."""
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
        anisotropy = float(noise[0, 0] - noise[1, 1])
        return self.changed(
            np.array([0.0, 0.0, -0.5 * anisotropy, 0.5 * anisotropy, -2.0 * float(noise[0, 1])])
        )

    def to_unit_circle(self, u: FloatArray) -> FloatArray:
        """Return the signals in coordinates in which the ellipse is the unit circle.

        ``u``: signals, shape (2, n). The result, of the same shape and precision, is cos φ and sin
        φ with their noise.
        """
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

    def difference(self, ellipse: Ellipse) -> FloatArray:
        """Return (p, q, a, b, e) of another ellipse in the coordinates of this one, shape (5,)."""
        inverse = self.inverse
        shift = inverse @ (ellipse.centre - self.centre)
        change = inverse @ ellipse.matrix - np.eye(2)
        return np.array([*shift, change[0, 0], change[1, 1], change[1, 0]])

    def shape_of(self, ellipse: Ellipse) -> FloatArray:
        """Return the shape (p, q, b − a, e) of another ellipse in the coordinates of this one.

        Shape (4,).
        """
        return _SHAPE @ self.difference(ellipse)

    @property
    def shape_covariance(self) -> FloatArray:
        """Return the covariance of the shape (p, q, b − a, e), shape (4, 4)."""
        return _SHAPE @ self.covariance @ _SHAPE.T

    def with_shape_covariance(self, covariance: FloatArray) -> Ellipse:
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


def fit_circle(u: FloatArray) -> Ellipse:
    """Fit a circle to samples, shape (2, n), by the algebraic fit without second-order bias.

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
    root = int(np.argmin(np.where(real > -1e-12, real, np.inf)))
    curvature, p, q, constant = np.real(vectors[:, root])
    curvature = curvature if abs(curvature) > 1e-9 else 1e-9
    centre = -0.5 * np.array([p, q]) / curvature
    radius = float(np.sqrt(max(centre @ centre - constant / curvature, 1e-6)))
    noise = max(float(real[root]), 1e-12 * radius**2) if np.isfinite(real[root]) else 1e-6
    return Ellipse(
        middle + size * centre, size * radius * np.eye(2), np.eye(5), np.full(2, noise * size**2)
    )


def fit_ellipse(blocks: Sequence[FloatArray], start: Ellipse) -> Ellipse | None:
    """Fit an ellipse to sums of powers; None if the samples do not determine it.

    Args:
        blocks: sums of pieces of the signals, each of shape (5, 5), in the signals' units.
        start: ellipse to start from; the ratio of its noise variances is kept.
    """
    total = np.sum(blocks, axis=0)
    ellipse = replace(start, noise=_noise_variances(total, start))
    converged = False
    for _ in range(100):
        try:
            step, *_ = _gauss_newton_step(total, ellipse)
        except linalg.LinAlgError:  # the samples lie on a line, or nearly
            return None
        length = float(np.max(np.abs(step)))
        ellipse = ellipse.changed(step * min(1.0, MAX_STEP / max(length, 1e-300)))
        ellipse = replace(ellipse, noise=_noise_variances(total, ellipse))
        size = float(np.prod(np.diag(ellipse.matrix)) / np.prod(np.diag(start.matrix)))
        if not np.isfinite(size) or not 1.0 / MAX_AREA_RATIO < size < MAX_AREA_RATIO:
            break
        if length < TOLERANCE:
            converged = True
            break
    _, information, noise_free_share = _gauss_newton_step(total, ellipse)
    if not converged or noise_free_share < MIN_DETERMINED_SHARE:
        return None
    covariance = np.linalg.inv(information)
    return replace(ellipse, covariance=covariance * _inflation(blocks, total, ellipse))


def fit_short_arc(u: FloatArray, samples: float) -> Ellipse:
    """Fit a circle to a short arc, with the uncertainty that the prior of the ellipse leaves.

    Args:
        u: some of the samples, shape (2, n).
        samples: number of all samples.
    """
    circle = fit_circle(u)
    c, s = circle.to_unit_circle(u) / np.hypot(*circle.to_unit_circle(u))
    slopes = np.stack([c, s, np.ones_like(c), 0.5 * (s * s - c * c), s * c])
    products = slopes @ slopes.T / u.shape[1]
    inner = np.linalg.inv(products[:3, :3] + 1e-12 * np.eye(3))
    response = -inner @ products[:3, 3:]  # response of the circle to these errors
    noise = inner * circle.radial_noise**2 / samples
    covariance = np.block([[noise, np.zeros((3, 2))], [np.zeros((2, 5))]])
    both = np.concatenate([response, np.eye(2)])
    change = np.array(
        [[1, 0, 0, 0, 0], [0, 1, 0, 0, 0], [0, 0, 1, -0.5, 0], [0, 0, 1, 0.5, 0], [0, 0, 0, 0, 1.0]]
    )
    return replace(
        circle, covariance=change @ (covariance + PRIOR_DEVIATION**2 * both @ both.T) @ change.T
    )


def weighted_mean(
    values: Sequence[FloatArray], covariances: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray, float]:
    """Return the mean of vectors weighted by their covariances, its covariance, and χ²."""
    weights = [np.linalg.inv(covariance) for covariance in covariances]
    covariance = np.linalg.inv(np.sum(weights, axis=0))
    mean = covariance @ np.sum([w @ v for w, v in zip(weights, values, strict=True)], axis=0)
    off = [value - mean for value in values]
    return mean, covariance, sum(float(d @ w @ d) for d, w in zip(off, weights, strict=True))


def excess(block: FloatArray, ellipse: Ellipse) -> float:
    """Return the mean of |v|² − 1 of a block without its noise.

    That is twice the relative deviation of its amplitude.
    """
    clean = _clean_products(block, ellipse)
    return float(_EXCESS @ clean[:, 0] / clean[0, 0])


def _products_on_circle(sums: FloatArray, ellipse: Ellipse) -> FloatArray:
    """Return the matrix of products of the six functions of v, shape (6, 6)."""
    change = moments.change_of_coordinates(ellipse.centre, ellipse.inverse)
    return change @ moments.matrix(sums) @ change.T


def _clean_products(sums: FloatArray, ellipse: Ellipse) -> FloatArray:
    """Return these products as they are expected without the noise of the signals."""
    return _products_on_circle(moments.without_noise(sums, ellipse.noise), ellipse)


def _noise_variances(total: FloatArray, ellipse: Ellipse) -> FloatArray:
    """Return the variances of the noise, shape (2,), from the residual |v|² − 1.

    Its mean square is 4 nᵀNn + 2 tr N² + (tr N)².
    """
    count = total[0, 0]
    inverse = ellipse.inverse
    shape = inverse @ np.diag(ellipse.noise) @ inverse.T
    products = _products_on_circle(total, ellipse)
    square = max(float(_EXCESS @ products @ _EXCESS) / count, 1e-24)
    squares = products[1:3, 1:3] / count
    first = 4.0 * float(np.sum(shape * squares))
    second = 2.0 * float(np.sum(shape**2)) + float(np.trace(shape)) ** 2
    second -= 4.0 * float(np.sum(shape * shape))  # the samples' own noise in ``squares``
    times = square / max(first, 1e-300)
    for _ in range(20):
        times = square / (first + second * times) if first + second * times > 0 else times
    return ellipse.noise * max(times, 1e-18)


def _gauss_newton_step(total: FloatArray, ellipse: Ellipse) -> tuple[FloatArray, FloatArray, float]:
    """Return a Gauss–Newton step of (p, q, a, b, e), its information, and a noise-free share.

    The share is that of the information in the direction with most noise. In a direction dominated
    by noise, a minimum share of the apparent information is used.
    """
    clean = _clean_products(total, ellipse)
    products = _products_on_circle(total, ellipse)
    variance = ellipse.radial_noise**2
    gradient = 0.5 * _SLOPES @ clean @ _EXCESS / variance
    prior_information = np.zeros((5, 5))
    a, b = ellipse.amplitudes
    for direction, value in zip(
        _SHAPE[2:], (float(np.log(b / a)), ellipse.quadrature_error_rad), strict=True
    ):
        prior_information += np.outer(direction, direction) / PRIOR_DEVIATION**2
        gradient = gradient - direction * value / PRIOR_DEVIATION**2
    apparent = _SLOPES @ products @ _SLOPES.T / variance
    # vectorsᵀ apparent vectors = 1
    noise_free_share, vectors = linalg.eigh(_SLOPES @ clean @ _SLOPES.T / variance, apparent)
    axes = apparent @ vectors
    information = (
        axes * np.maximum(noise_free_share, MIN_NOISE_FREE_SHARE)
    ) @ axes.T + prior_information
    return np.linalg.solve(information, gradient), information, float(noise_free_share[0])


def _inflation(blocks: Sequence[FloatArray], total: FloatArray, ellipse: Ellipse) -> float:
    """Return the ratio of the variance to that of white noise, from the scatter of the blocks."""
    if len(blocks) < MIN_BLOCKS:
        return 1.0
    variance = ellipse.radial_noise**2
    scores = [
        0.5 * _SLOPES @ _clean_products(block, ellipse) @ _EXCESS / variance for block in blocks
    ]
    scatter = np.var(np.array(scores), axis=0, ddof=1) * len(blocks)
    expected = np.diag(_SLOPES @ _products_on_circle(total, ellipse) @ _SLOPES.T) / variance
    return max(float(np.mean(scatter / np.maximum(expected, 1e-300))), 1.0)
