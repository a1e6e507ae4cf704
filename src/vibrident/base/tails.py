"""Compute tails and quantiles of the χ², F and Student's t distributions without SciPy.

Continued fractions and series of the incomplete gamma and beta functions (DLMF 8.9.2, 8.11.4,
8.17.22) agree with SciPy to about 1e-12. Loading SciPy takes longer than reading 21 records.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

MIN_TERM = 1e-16  # terms smaller than this, relative to the sum, no longer count
MAX_LAST_STEP = 1e-10  # relative; the error after a Newton step is its square, which is rounding
TINY = 1e-300  # in place of a zero in a continued fraction
MAX_TERMS = 100_000  # a million degrees of freedom need some thousands
MIN_ASYMPTOTIC = 16.0  # from this argument on log Γ is its asymptotic series


def gamma_tail(shape: float, value: float) -> float:
    """Return Q(a, x), the chance that a gamma variate of this shape and scale 1 exceeds x."""
    if math.isnan(value):
        return value
    if value <= 0.0:
        return 1.0
    if math.isinf(value):
        return 0.0
    if value < shape + 1.0:
        term = total = 1.0
        for k in range(1, MAX_TERMS):
            term *= value / (shape + k)
            total += term
            if term < MIN_TERM * total:
                break
        return 1.0 - _gamma_density(shape, value) * total
    steps = ((k * (shape - k), value + 2.0 * k + 1.0 - shape) for k in range(1, MAX_TERMS))
    fraction = _continued_fraction(value + 1.0 - shape, steps)
    return _gamma_density(shape, value) * shape / fraction


def chi2_tail(degrees: float, value: float) -> float:
    """Return the chance that χ² of ``degrees`` degrees of freedom exceeds the value."""
    return gamma_tail(0.5 * degrees, 0.5 * value)


def f_tail(numerator: float, denominator: float, value: float) -> float:
    """Return the chance that F exceeds the value.

    ``numerator`` and ``denominator``: degrees of freedom of the variances in F.
    """
    if not value > 0.0 or not (numerator > 0.0 and denominator > 0.0):
        return 1.0 if value <= 0.0 else math.nan
    if math.isinf(denominator):
        return chi2_tail(numerator, numerator * value)
    ratio = denominator / (numerator * value)
    x = ratio / (1.0 + ratio)
    return _beta_distribution(0.5 * denominator, 0.5 * numerator, x, 1.0 / (1.0 + ratio))


def student_quantile(degrees: float, chance: float) -> float:
    """Return the quantile of Student's t for a chance of one half or more."""
    if not degrees > 0.0:
        return math.nan
    two_sided = 2.0 * (1.0 - chance)
    t = 1.0
    # Newton's steps from below never go too far, as the function is convex here.
    for _ in range(100):
        density = math.exp(
            _log_gamma_ratio(0.5 * degrees) - 0.5 * (degrees + 1.0) * math.log1p(t * t / degrees)
        ) / math.sqrt(math.pi * degrees)
        step = (f_tail(1.0, degrees, t * t) - two_sided) / (2.0 * density)
        t += step
        if abs(step) < MAX_LAST_STEP * t:
            break
    return t


def _beta_distribution(a: float, b: float, x: float, y: float) -> float:
    """Return I_x(a, b), the chance that a beta variate stays below x.

    ``y``: 1 − x, which x near one does not represent accurately.
    """
    if x <= 0.0 or y <= 0.0:
        return float(y <= 0.0)
    if x > (a + 1.0) / (a + b + 2.0):
        return 1.0 - _beta_distribution(b, a, y, x)
    lam = a * y - b * x  # λ of Didonato & Morris
    first = a * (lam + 1.0) / (a + 1.0)
    return _beta_density(a, b, x, y) / _continued_fraction(first, _beta_terms(a, b, x, lam))


def _beta_terms(a: float, b: float, x: float, lam: float) -> Iterator[tuple[float, float]]:
    """Yield the numerators and denominators of Didonato & Morris' fraction (1992, eq. 9)."""
    for m in range(1, MAX_TERMS):
        low = a + 2 * m - 1.0
        high = a + 2 * m + 1.0
        alpha = m * (a + m - 1.0) / low * ((a + b + m - 1.0) / low) * (b - m) * x * x
        beta = m + m * (b - m) * x / low + (a + m) * (lam + 1.0 + m * (2.0 - x)) / high
        yield alpha, beta


def _continued_fraction(first: float, terms: Iterator[tuple[float, float]]) -> float:
    """Return b0 + a1/(b1 + a2/(b2 + …)) by Lentz's method; ``first``: b0, ``terms``: (a, b)."""
    value = c = first or TINY
    d = 0.0
    for a, b in terms:
        d = 1.0 / (b + a * d or TINY)
        c = b + a / c or TINY
        value *= c * d
        if abs(c * d - 1.0) < 4.0 * MIN_TERM:
            break
    return value


def _gamma_density(a: float, x: float) -> float:
    """Return x^a e^(−x) / Γ(a + 1), without a difference of large numbers."""
    excess = (x - a) / a
    power = a * (_log_ratio(x / a, excess) - excess) - _stirling_remainder(a)
    return math.exp(power) / math.sqrt(2.0 * math.pi * a)


def _beta_density(a: float, b: float, x: float, y: float) -> float:
    """Return x^a y^b / B(a, b) with y = 1 − x, without a difference of large numbers."""
    n = a + b
    difference = b * x - a * y
    correction = _stirling_remainder(n) - _stirling_remainder(a) - _stirling_remainder(b)
    power = a * _log_ratio(x * n / a, difference / a) + b * _log_ratio(y * n / b, -difference / b)
    return math.exp(power + correction) * math.sqrt(a * b / (2.0 * math.pi * n))


def _log_ratio(ratio: float, excess: float) -> float:
    """Return the logarithm of a ratio; ``excess``: the ratio less one, accurately."""
    return math.log(ratio) if ratio < 0.5 else math.log1p(excess)


def _stirling_remainder(a: float) -> float:
    """Return log Γ(a) less (a − 1/2) log a − a + log(2π)/2 (DLMF 5.11.1)."""
    if a < MIN_ASYMPTOTIC:
        return math.lgamma(a) - (a - 0.5) * math.log(a) + a - 0.5 * math.log(2.0 * math.pi)
    s = 1.0 / a**2
    return (1.0 / 12.0 - s * (1.0 / 360.0 - s * (1.0 / 1260.0 - s / 1680.0))) / a


def _log_gamma_ratio(a: float) -> float:
    """Return log Γ(a + 1/2) − log Γ(a)."""
    half = a + 0.5
    return (
        a * math.log1p(0.5 / a)
        + 0.5 * math.log(a)
        - 0.5
        + _stirling_remainder(half)
        - _stirling_remainder(a)
    )
