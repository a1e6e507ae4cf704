"""Straight line through values of known uncertainty, with a test of the values against it.

Weighted least squares, where each u may itself be an estimate from few degrees of freedom: Welch's
test, for any linear hypothesis (Johansen 1980), and the covariance of Meier (1953) with the degrees
of freedom of Satterthwaite (GUM G.4.1).

S. Johansen, The Welch-James approximation to the distribution of the residual sum of squares in a
weighted linear regression, Biometrika 67 (1980) 85-92. P. Meier, Variance of a weighted mean,
Biometrics 9 (1953) 59-73.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibrident.base.tails import f_tail
from vibrident.data.records import FloatArray


@dataclass(frozen=True, eq=False)
class LinePoints:
    """Values y at x, with standard uncertainties and their degrees of freedom, shape (n,) each."""

    x: FloatArray
    y: FloatArray
    u: FloatArray
    freedom: FloatArray


@dataclass(frozen=True, eq=False)
class Line:
    """Line fitted to points.

    Attributes:
        points: that it is fitted to.
        coefficients: value at x = 0, slope, and amount of the further column, shape (k,).
        smoother: coefficients = smoother @ y, shape (k, n).
        covariance: of the coefficients, the scatter of the weights included, shape (k, k).
        chi2: sum of squares of the residuals in u.
        degrees: of freedom of the residuals, n - k.
        ratio: χ² over its mean; its root is the Birge ratio.
        probability: chance of points on a line to deviate as much; 1 without degrees of freedom.
    """

    points: LinePoints
    coefficients: FloatArray
    smoother: FloatArray
    covariance: FloatArray
    chi2: float
    degrees: int
    ratio: float
    probability: float

    def uncertainty(self, gradient: FloatArray) -> tuple[float, float]:
        """Return u of a function of the coefficients, and its degrees of freedom.

        ``gradient``: of the function, shape (k,).
        """
        shares = np.square(gradient @ self.smoother * self.points.u)
        doubt = float(np.sum(shares**2 / self.points.freedom))
        freedom = float(np.sum(shares)) ** 2 / doubt if doubt > 0.0 else np.inf
        return float(np.sqrt(gradient @ self.covariance @ gradient)), freedom


def fit_line(points: LinePoints, further: FloatArray | None = None) -> Line:
    """Fit a line, and a further column, by weighted least squares.

    Args:
        points: at least as many as there are coefficients.
        further: column of the design, shape (n,).
    """
    columns = [np.ones_like(points.x), points.x, *([] if further is None else [further])]
    design = np.stack(columns, axis=1) / points.u[:, None]
    inverse = np.linalg.pinv(design)
    smoother = inverse / points.u
    coefficients = smoother @ points.y
    # each residual's variance in units of that of its point
    free = 1.0 - np.sum(design * inverse.T, axis=1)
    covariance = (smoother * points.u**2 * (1.0 + 4.0 * free / points.freedom)) @ smoother.T
    chi2 = float(np.sum(np.square(points.y / points.u - design @ coefficients)))
    degrees = len(points.x) - len(columns)
    ratio, probability = _test_chi2(chi2, degrees, float(np.sum(free**2 / points.freedom)))
    return Line(points, coefficients, smoother, covariance, chi2, degrees, ratio, probability)


def _test_chi2(chi2: float, degrees: int, doubt: float) -> tuple[float, float]:
    """Return χ² over its mean and its probability.

    ``doubt``: Johansen's A, zero where every u is known.
    """
    if degrees <= 0:
        return 1.0, 1.0
    ratio = chi2 / (degrees + 2.0 * doubt - 6.0 * doubt / (degrees + 2.0))
    below = degrees * (degrees + 2.0) / (3.0 * doubt) if doubt > 0.0 else np.inf
    return ratio, f_tail(degrees, below, ratio)


def explanations(points: LinePoints, rejection: float) -> list[int | None]:
    """Return what brings the points back to a line: a point to leave out, or None, a parabola.

    Each is one further column, so that all are alternatives of one size; those with which the test
    passes are returned. Empty where no degree of freedom would remain to test them.
    """
    if len(points.x) < 4:
        return []
    named_columns: list[tuple[int | None, FloatArray]] = [
        *enumerate(np.eye(len(points.x))),
        (None, points.x**2),
    ]
    return [
        name for name, column in named_columns if fit_line(points, column).probability >= rejection
    ]
