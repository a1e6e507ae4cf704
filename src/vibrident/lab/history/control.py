"""Control charts of a stable sensor: EWMA and CUSUM, with limits from their rate of false alarms.

Both watch the recursive residuals of a constant value (Brown, Durbin & Evans 1975): each
calibration against what those before it say, divided by the standard deviation of that difference.
With the covariance that the calibrations state, they are independent and standard normal as long as
the sensor does not change. Shared errors do not alter this. The limits are computed: over ``LIFE``
comparisons a chart of a stable sensor gives a false alarm with the probability ``FALSE_ALARM``. The
average run length to a false alarm (ARL) follows from the same integral equation (Page 1954; Brook
& Evans 1972).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import brentq
from scipy.special import ndtr

from vibrident.data.records import BoolArray, FloatArray

FALSE_ALARM = 0.01
LIFE = 20  # comparisons over which that holds: a sensor's life, calibrated every year or two
EWMA_WEIGHT = 0.25  # of the newest residual: for a change of about one standard deviation
CUSUM_ALLOWANCE = 0.5  # half of the change, in standard deviations, that the CUSUM is designed for
_NODES = 80


@dataclass(frozen=True)
class ControlChart:
    """Control chart, in standard deviations."""

    name: str  # ``EWMA`` or ``CUSUM``
    # statistic on the upper side at each residual; of the EWMA the statistic itself
    upper: tuple[float, ...]
    lower: tuple[float, ...]  # on the lower side, zero or negative; the EWMA itself
    limit: tuple[float, ...]  # upper limit at each residual; the lower one is its negative
    alarm: tuple[int, ...]  # index of each residual with an alarm
    average_run_length: float  # of a stable sensor to a false alarm


def recursive_residuals(value: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the difference of each value from those before it, shape (n − 1,).

    It is in standard deviations of the difference. ``value``: shape (n,), in the order of time;
    ``covariance``: of the values about a constant, shape (n, n).
    """
    # differences from the first value: the constant cancels
    change = np.column_stack([-np.ones(value.size - 1), np.eye(value.size - 1)])
    spread = change @ covariance @ change.T
    root = np.linalg.cholesky(spread + 1e-13 * np.trace(covariance) * np.eye(value.size - 1))
    return solve_triangular(root, change @ value, lower=True)


def charts(residuals: FloatArray, restart: BoolArray) -> tuple[ControlChart, ControlChart]:
    """Return EWMA and CUSUM of residuals.

    Where ``restart`` is true, a new series begins, and both start again.
    """
    return _ewma(residuals, restart), _cusum(residuals, restart)


def _ewma(residuals: FloatArray, restart: BoolArray) -> ControlChart:
    factor = ewma_factor()
    level = 0.0
    count = 0
    levels = []
    limits = []
    for residual, new in zip(residuals, restart, strict=True):
        level, count = (0.0, 0) if new else (level, count)
        level = EWMA_WEIGHT * residual + (1 - EWMA_WEIGHT) * level
        count = count + 1
        levels.append(float(level))
        limits.append(factor * float(_ewma_deviation(count)))
    return _chart("EWMA", levels, levels, limits, ewma_run_length(factor))


def _cusum(residuals: FloatArray, restart: BoolArray) -> ControlChart:
    limit = cusum_limit()
    high = 0.0
    low = 0.0
    upper = []
    lower = []
    for residual, new in zip(residuals, restart, strict=True):
        high, low = (0.0, 0.0) if new else (high, low)
        high = max(0.0, high + residual - CUSUM_ALLOWANCE)
        low = min(0.0, low + residual + CUSUM_ALLOWANCE)
        upper.append(float(high))
        lower.append(float(low))
    return _chart("CUSUM", upper, lower, [limit] * len(upper), cusum_run_length(limit) / 2)


def _chart(
    name: str, upper: list[float], lower: list[float], limit: list[float], run_length: float
) -> ControlChart:
    sides = zip(upper, lower, limit, strict=True)
    alarm = tuple(i for i, (high, low, most) in enumerate(sides) if max(high, -low) > most)
    return ControlChart(name, tuple(upper), tuple(lower), tuple(limit), alarm, run_length)


def _ewma_deviation(count: int) -> float:
    """Return the standard deviation of the EWMA after ``count`` residuals."""
    memory = 1 - EWMA_WEIGHT
    return float(np.sqrt(EWMA_WEIGHT / (2 - EWMA_WEIGHT) * (1 - memory ** (2 * count))))


@lru_cache
def ewma_factor() -> float:
    """Return the limit of the EWMA in units of its standard deviation."""
    return _root(lambda factor: 1 - _ewma_survival(factor) - FALSE_ALARM, 0.5, 9.0)


@lru_cache
def cusum_limit() -> float:
    """Return the limit of the CUSUM; half of the false alarms are on each side."""
    return _root(lambda limit: 1 - _cusum_survival(limit) - FALSE_ALARM / 2, 0.1, 30.0)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    return float(brentq(function, low, high, xtol=1e-10))  # type: ignore[arg-type]


def _rule(low: float, high: float) -> tuple[FloatArray, FloatArray]:
    node, weight = np.polynomial.legendre.leggauss(_NODES)
    return (low + high) / 2 + (high - low) / 2 * node, (high - low) / 2 * weight


def _density(difference: FloatArray) -> FloatArray:
    return np.exp(-0.5 * difference**2) / np.sqrt(2 * np.pi)


def _ewma_survival(factor: float) -> float:
    """Return the probability that the EWMA of a stable sensor stays within its limits."""
    at = np.array([0.0])
    density = np.array([1.0])
    weight = np.array([1.0])
    for count in range(1, LIFE + 1):
        limit = factor * _ewma_deviation(count)
        now, now_weight = _rule(-limit, limit)
        step = (now[:, None] - (1 - EWMA_WEIGHT) * at) / EWMA_WEIGHT
        density = _density(step) / EWMA_WEIGHT @ (weight * density)
        at = now
        weight = now_weight
    return float(weight @ density)


def _cusum_transition(limit: float) -> FloatArray:
    """Return the probability of a step of one side of the CUSUM between its nodes.

    The last node is zero.
    """
    at, weight = _rule(0.0, limit)
    points = np.append(at, 0.0)
    return np.column_stack(
        [_density(at + CUSUM_ALLOWANCE - points[:, None]) * weight, ndtr(CUSUM_ALLOWANCE - points)]
    )


def _cusum_survival(limit: float) -> float:
    """Return the probability that one side of a stable sensor's CUSUM stays below its limit.

    It starts at zero.
    """
    transition = _cusum_transition(limit)
    survival = np.ones(_NODES + 1)
    for _ in range(LIFE):
        survival = transition[:, :-1] @ survival[:-1] + transition[:, -1] * survival[-1]
    return float(survival[-1])


def _steps_to_alarm(transition: FloatArray) -> float:
    """Return the average number of steps from zero until the statistic leaves all nodes.

    Zero is the last node.
    """
    return float(np.linalg.solve(np.eye(_NODES + 1) - transition, np.ones(_NODES + 1))[-1])


@lru_cache
def cusum_run_length(limit: float) -> float:
    """Return the average run length of one side of a stable sensor's CUSUM.

    That of both together is half of it.
    """
    return _steps_to_alarm(_cusum_transition(limit))


@lru_cache
def ewma_run_length(factor: float) -> float:
    """Return the average run length of a stable sensor's EWMA in its late limits."""
    limit = factor * float(np.sqrt(EWMA_WEIGHT / (2 - EWMA_WEIGHT)))
    at, weight = _rule(-limit, limit)
    points = np.append(at, 0.0)
    step = (at - (1 - EWMA_WEIGHT) * points[:, None]) / EWMA_WEIGHT
    return _steps_to_alarm(
        np.column_stack([_density(step) / EWMA_WEIGHT * weight, np.zeros(_NODES + 1)])
    )
