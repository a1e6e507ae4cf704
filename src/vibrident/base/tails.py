"""Tails and quantiles of the distributions that verdicts need: χ², F and Student's t.

By the continued fractions and series of the incomplete gamma and beta functions (DLMF 8.9.2,
8.11.4, 8.17.22). They agree with SciPy's to about 1e-12, and spare a linear sensor its loading,
which takes longer than reading 21 records.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

ROUNDING = 1e-16  # terms smaller than this, relative to the sum, no longer count
SETTLED = 1e-10  # a Newton step below this part leaves its square as an error, which is rounding
TINY = 1e-300  # in place of a zero in a continued fraction
MOST = 100_000  # terms at most; a million degrees of freedom need some thousands
LARGE = 16.0  # from here on the logarithm of the gamma function is its asymptotic series


def gamma_tail(shape: float, value: float) -> float:
    """Return Q(a, x): chance that a gamma variate of this shape and scale one exceeds the value."""
    if not value > 0.0 or math.isinf(value):
        return value if math.isnan(value) else float(value <= 0.0)
    if value < shape + 1.0:
        term = total = 1.0
        for k in range(1, MOST):
            term *= value / (shape + k)
            total += term
            if term < ROUNDING * total:
                break
        return 1.0 - _gamma_density(shape, value) * total
    steps = ((k * (shape - k), value + 2.0 * k + 1.0 - shape) for k in range(1, MOST))
    below = _continued(value + 1.0 - shape, steps)
    return _gamma_density(shape, value) * shape / below


def chi2_tail(degrees: float, value: float) -> float:
    """Return the chance that a χ² of so many degrees of freedom exceeds the value."""
    return gamma_tail(0.5 * degrees, 0.5 * value)


def f_tail(above: float, below: float, value: float) -> float:
    """Return the chance that an F exceeds the value; degrees of freedom of its numerator and of its denominator."""
    if not value > 0.0 or not (above > 0.0 and below > 0.0):
        return 1.0 if value <= 0.0 else math.nan
    if math.isinf(below):
        return chi2_tail(above, above * value)
    ratio = below / (above * value)
    return _beta_below(0.5 * below, 0.5 * above, ratio / (1.0 + ratio), 1.0 / (1.0 + ratio))


def student_quantile(degrees: float, chance: float) -> float:
    """Return the value that Student's t of so many degrees of freedom stays below with a chance of one half or more."""
    if not degrees > 0.0:
        return math.nan
    outside = 2.0 * (1.0 - chance)
    t = 1.0
    # Newton's steps on a function that is convex here: from below, never too far
    for _ in range(100):
        density = math.exp(
            _log_gamma_ratio(0.5 * degrees) - 0.5 * (degrees + 1.0) * math.log1p(t * t / degrees)
        ) / math.sqrt(math.pi * degrees)
        step = (f_tail(1.0, degrees, t * t) - outside) / (2.0 * density)
        t += step
        if abs(step) < SETTLED * t:
            break
    return t


def _beta_below(a: float, b: float, x: float, rest: float) -> float:
    """Return I_x(a, b): chance that a beta variate stays below x; ``rest`` is 1 − x, which x near one does not hold."""
    if x <= 0.0 or rest <= 0.0:
        return float(rest <= 0.0)
    if x > (a + 1.0) / (a + b + 2.0):
        return 1.0 - _beta_below(b, a, rest, x)
    off = a * rest - b * x
    first = a * (off + 1.0) / (a + 1.0)
    return _beta_density(a, b, x, rest) / _continued(first, _beta_steps(a, b, x, off))


def _beta_steps(a: float, b: float, x: float, off: float) -> Iterator[tuple[float, float]]:
    """Yield the numerators and denominators of Didonato & Morris' fraction (1992, eq. 9)."""
    for m in range(1, MOST):
        before = a + 2 * m - 1.0
        behind = a + 2 * m + 1.0
        above = m * (a + m - 1.0) / before * ((a + b + m - 1.0) / before) * (b - m) * x * x
        yield above, m + m * (b - m) * x / before + (a + m) * (off + 1.0 + m * (2.0 - x)) / behind


def _continued(first: float, steps: Iterator[tuple[float, float]]) -> float:
    """Return b0 + a1/(b1 + a2/(b2 + …)) by Lentz's method."""
    value = c = first or TINY
    d = 0.0
    for a, b in steps:
        d = 1.0 / (b + a * d or TINY)
        c = b + a / c or TINY
        value *= c * d
        if abs(c * d - 1.0) < 4.0 * ROUNDING:
            break
    return value


def _gamma_density(a: float, x: float) -> float:
    """Return x^a e^(−x) / Γ(a + 1), without a difference of large numbers."""
    off = (x - a) / a
    return math.exp(a * (_log_of(x / a, off) - off) - _stirling_rest(a)) / math.sqrt(
        2.0 * math.pi * a
    )


def _beta_density(a: float, b: float, x: float, y: float) -> float:
    """Return x^a y^b / B(a, b) with y = 1 − x, without a difference of large numbers."""
    n = a + b
    off = b * x - a * y
    rest = _stirling_rest(n) - _stirling_rest(a) - _stirling_rest(b)
    power = a * _log_of(x * n / a, off / a) + b * _log_of(y * n / b, -off / b)
    return math.exp(power + rest) * math.sqrt(a * b / (2.0 * math.pi * n))


def _log_of(ratio: float, off: float) -> float:
    """Return the logarithm of a ratio, which is one and ``off``."""
    return math.log(ratio) if ratio < 0.5 else math.log1p(off)


def _stirling_rest(a: float) -> float:
    """Return the log Γ(a) less (a − 1/2) log a − a + log(2π)/2 (DLMF 5.11.1)."""
    if a < LARGE:
        return math.lgamma(a) - (a - 0.5) * math.log(a) + a - 0.5 * math.log(2.0 * math.pi)
    s = 1.0 / a**2
    return (1.0 / 12.0 - s * (1.0 / 360.0 - s * (1.0 / 1260.0 - s / 1680.0))) / a


def _log_gamma_ratio(a: float) -> float:
    """Return the log Γ(a + 1/2) − log Γ(a)."""
    half = a + 0.5
    return (
        a * math.log1p(0.5 / a) + 0.5 * math.log(a) - 0.5 + _stirling_rest(half) - _stirling_rest(a)
    )
