"""Drift of a sensor between calibrations: none, a line, a random walk, or both; and its prediction.

A value that was measured n times is y_i = a + b t_i + W(t_i) + e_i. The errors e have the
covariance V that the calibrations state: noise of each, and what they share (a rank-one part a
source). b t is a steady drift, W a random walk. a is free; b is normal with variance β², W has the
variance q a year. V is known; β² and q are not, and few calibrations determine them poorly. So they
are not estimated and fixed, but averaged over, by the likelihood of the contrasts (REML,
Patterson & Thompson 1971), under four hypotheses: line (q = 0), random walk (b = 0), both, and
still (neither). Each set of variances gives a generalised least-squares estimate, and their mixture
is the prediction. It has long tails if few calibrations exist.

Beforehand, the variance v of the drift over the whole history, in units of the noise of one
calibration, has a density ∝ 1/(1 + v): flat below the noise, and beyond it that of Jeffreys for a
scale (Box & Tiao 1973, sec. 5.2). So where a random walk is large against the noise, its mixture is
Student's t with n − 1 degrees of freedom for n calibrations.

A repaired sensor, or one that jumped, has a new a, b and W; β² and q stay the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from vibrident.base.fields import NamedNumbers
from vibrident.data.records import BoolArray, FloatArray

#: Bisections of the interval that holds a quantile; they resolve 10⁻¹² of it.
_QUANTILE_BISECTIONS = 45


@dataclass(frozen=True, eq=False)
class Mixture:
    """Normal distributions with weights."""

    weight: FloatArray  # shape (m,), their sum is one
    mean: FloatArray  # shape (m,)
    deviation: FloatArray  # standard deviations, all above zero, shape (m,)

    def below(self, value: float) -> float:
        """Return the probability of a value below ``value``."""
        return float(self.weight @ ndtr((value - self.mean) / self.deviation))

    def quantile(self, probability: float) -> float:
        """Return the value that is exceeded with 1 − ``probability``."""
        weighty = self.weight > 1e-12
        reach = 40.0 * self.deviation[weighty]  # beyond it ndtr is 0 or 1 in float64
        low = float(np.min(self.mean[weighty] - reach))
        high = float(np.max(self.mean[weighty] + reach))
        for _ in range(_QUANTILE_BISECTIONS):
            middle = (low + high) / 2
            low, high = (middle, high) if self.below(middle) < probability else (low, middle)
        return (low + high) / 2

    @cached_property
    def interval_95(self) -> tuple[float, float]:
        """Return the probabilistically symmetric 95 % coverage interval."""
        return self.quantile(0.025), self.quantile(0.975)

    @property
    def value(self) -> float:
        """Return the median: with few data the tails are so long that they have no mean."""
        return self.quantile(0.5)

    @property
    def u(self) -> float:
        """Return the standard uncertainty: a quarter of the 95 % interval.

        U = 2 u then covers 95 % even with long tails.
        """
        low, high = self.interval_95
        return (high - low) / 4


#: Number of variances of the grid, evenly spaced in their logarithm, in units of the noise …
GRID_NODES = 13
#: … and the logarithms of the smallest and the largest.
_LOG_RANGE = (-6.0, 14.0)
#: Weight below which a node adds nothing to a probability that is printed.
_MIN_NODE_WEIGHT = 1e-9
HYPOTHESES = ("line", "random walk", "line and random walk", "still")
#: Prior probabilities of the hypotheses, times 11: with these, 95 % intervals contain about 95 % in
#: each distinguishable kind of life. Without ``still``, the intervals of a stable sensor are too
#: wide; with a line as probable as a walk, three or four points of a walk are taken for a line.
PRIOR_WEIGHTS = (1.0, 4.0, 4.0, 2.0)


@dataclass(frozen=True, eq=False)
class _Solved:
    """Solution at each of m nodes, with covariance Σ and design X of shape (n, p).

    Attributes:
        gain: G = Σ⁻¹X(XᵀΣ⁻¹X)⁻¹, shape (m, n, p); Gᵀy estimates the free coefficients.
        coefficient_covariance: of that estimate, shape (m, p, p).
        projector: Σ⁻¹ − G XᵀΣ⁻¹, shape (m, n, n).
        likelihood: logarithm of the REML likelihood, less a constant, shape (m,).
    """

    gain: FloatArray
    coefficient_covariance: FloatArray
    projector: FloatArray
    likelihood: FloatArray


@dataclass(frozen=True, eq=False)
class SensorDrift:
    """Drift of a sensor from its calibrations; times in years, all else in one unit."""

    time: FloatArray  # of each calibration, shape (n,), ascending
    value: FloatArray  # shape (n,)
    covariance: FloatArray  # of the errors, shape (n, n)
    # number of the series of each calibration, shape (n,); the last is the present one
    group: NDArray[np.int_]

    @property
    def determined(self) -> bool:
        """Return whether a series has calibrations at two times, as a drift needs."""
        return any(np.ptp(self.time[self.group == g]) > 0 for g in np.unique(self.group))

    @cached_property
    def noise(self) -> float:
        """Return the variance of the noise of one calibration, from differences within a series."""
        levels = self._levels
        projector = np.eye(self.time.size) - levels @ np.linalg.pinv(levels)
        freedom = max(self.time.size - levels.shape[1], 1)
        size = float(np.mean(np.diag(self.covariance)))
        return max(float(np.trace(projector @ self.covariance)) / freedom, 1e-13 * size, 1e-300)

    @cached_property
    def _levels(self) -> FloatArray:
        """Return indicators of the series, shape (n, series)."""
        return (self.group[:, None] == np.unique(self.group)).astype(float)

    @cached_property
    def _span(self) -> float:
        return float(np.ptp(self.time)) or 1.0

    @cached_property
    def _variances(self) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.int_]]:
        """Return β² and q of each node, its prior weight and hypothesis, each of shape (m,)."""
        logarithm = np.linspace(*_LOG_RANGE, GRID_NODES)
        v = np.exp(logarithm)
        prior = v / (1 + v)  # of log v
        prior = prior / prior.sum()
        none = np.zeros(GRID_NODES)
        line = (
            np.concatenate([v, none, np.repeat(v, GRID_NODES), [0.0]]) * self.noise / self._span**2
        )
        walk = np.concatenate([none, v, np.tile(v, GRID_NODES), [0.0]]) * self.noise / self._span
        kind = np.repeat([0, 1, 2, 3], [GRID_NODES, GRID_NODES, GRID_NODES**2, 1])
        within = np.concatenate([prior, prior, np.outer(prior, prior).ravel(), [1.0]])
        return line, walk, within * np.array(PRIOR_WEIGHTS)[kind] / sum(PRIOR_WEIGHTS), kind

    def _process(self, rows: FloatArray, columns: FloatArray, same: BoolArray) -> FloatArray:
        """Return the covariance of the drift between two sets of times.

        Its shape is (m, len(rows), len(columns)).
        """
        line, walk, _, _ = self._variances
        start = self.time[0]
        straight = np.where(same, np.outer(rows - start, columns - start), 0.0)
        wandering = np.where(same, np.minimum.outer(rows, columns) - start, 0.0)
        return line[:, None, None] * straight + walk[:, None, None] * wandering

    @cached_property
    def _solved(self) -> _Solved:
        return self._solve(self._levels)

    def _solve(self, design: FloatArray) -> _Solved:
        """Solve generalised least squares at each node.

        ``design``: of the free coefficients, shape (n, p).
        """
        same = self.group[:, None] == self.group
        sigma = self._process(self.time, self.time, same) + self.covariance
        sigma = sigma + 1e-12 * self.noise * np.eye(self.time.size)
        # By contrasts, in which the free constant and the shared errors cancel: Σ itself may be
        # almost singular.
        contrasts = np.linalg.svd(design)[0][:, design.shape[1] :]
        spread = np.asarray(contrasts.T @ sigma @ contrasts, dtype=float)
        projector = np.asarray(contrasts @ np.linalg.inv(spread) @ contrasts.T, dtype=float)
        plain = np.linalg.pinv(design).T
        gain = plain - projector @ (sigma @ plain)
        covariance = np.asarray(np.swapaxes(gain, 1, 2) @ sigma @ gain, dtype=float)
        misfit = projector @ self.value @ self.value
        likelihood = -0.5 * (misfit + np.linalg.slogdet(spread)[1])
        return _Solved(gain, covariance, projector, likelihood)

    @cached_property
    def weight(self) -> FloatArray:
        """Return the probability of each node, shape (m,)."""
        return self._weighed(self._solved)

    def _weighed(self, solved: _Solved) -> FloatArray:
        logarithm = solved.likelihood + np.log(self._variances[2])
        weight = np.exp(logarithm - logarithm.max())
        return weight / weight.sum()

    @property
    def probability(self) -> NamedNumbers:
        """Return the probability of each hypothesis."""
        kind = self._variances[3]
        return {name: float(self.weight[kind == i].sum()) for i, name in enumerate(HYPOTHESES)}

    def sensitivity(self, time: float) -> Mixture:
        """Return the value of the sensor itself at a time, in its present series."""
        return self._mixture(time, np.zeros(self.time.size), 0.0)

    def reading(self, time: float, shared: FloatArray, u: float) -> Mixture:
        """Return the prediction for a calibration at a time.

        Args:
            time: in years.
            shared: covariance of its error with those of the earlier calibrations, shape (n,).
            u: its standard uncertainty.
        """
        return self._mixture(time, shared, u**2)

    def outside(self, time: FloatArray, low: float, high: float) -> FloatArray:
        """Return the probability that the sensor is outside limits at the times.

        Its shape is (len(time),).
        """
        mean, deviation = self._predicted(time, np.zeros(self.time.size), 0.0)
        beyond = ndtr((low - mean) / deviation) + ndtr((mean - high) / deviation)
        return self.weight[self._weighty] @ beyond

    def _mixture(self, time: float, shared: FloatArray, variance: float) -> Mixture:
        mean, deviation = self._predicted(np.array([time]), shared, variance)
        weight = self.weight[self._weighty]
        return Mixture(weight / weight.sum(), mean[:, 0], deviation[:, 0])

    @cached_property
    def _weighty(self) -> NDArray[np.int_]:
        """Return the nodes with a weight that is not negligible."""
        return np.flatnonzero(self.weight > _MIN_NODE_WEIGHT)

    def _predicted(
        self, time: FloatArray, shared: FloatArray, variance: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation at each node and time.

        Each has the shape (nodes that are not negligible, len(time)).
        """
        solved = self._solved
        weighty = self._weighty
        line, walk = (kind[weighty, None] for kind in self._variances[:2])
        gain = solved.gain[weighty]
        coefficient_covariance = solved.coefficient_covariance[weighty]
        projector = solved.projector[weighty]
        present = self.group == self.group[-1]
        k = self._process(self.time, time, present[:, None])[weighty] + shared[:, None]
        elapsed = time - self.time[0]
        variances = line * elapsed**2 + walk * elapsed + variance
        level = self._levels[-1]  # of the present series
        explained = projector @ k
        carried = (gain @ level)[:, None, :]
        mean = self.value @ explained + carried @ self.value
        spread = (
            variances
            - np.sum(k * explained, axis=1)
            + (coefficient_covariance @ level @ level)[:, None]
            - 2 * (carried @ k)[:, 0]
        )
        return mean, np.sqrt(np.maximum(spread, _MIN_NODE_WEIGHT * self.noise))

    def rate(self) -> Mixture:
        """Return the steady drift b a year of the present series, by the hypotheses with a line."""
        line = self._variances[0]
        present = (self.group == self.group[-1]).astype(float)
        k = line[:, None] * present * (self.time - self.time[0])
        projector = self._solved.projector
        mean = np.einsum("mi,mij,j->m", k, projector, self.value)
        spread = line - np.einsum("mi,mij,mj->m", k, projector, k)
        steady = line > 0.0
        weight = self.weight[steady] / self.weight[steady].sum()
        smallest = _MIN_NODE_WEIGHT * self.noise / self._span**2
        return Mixture(weight, mean[steady], np.sqrt(np.maximum(spread[steady], smallest)))

    def wandering(self) -> float:
        """Return the square root of q, the change to expect in a year.

        It has the largest likelihood of the random walk alone.
        """
        _, walk, _, kind = self._variances
        alone = np.where(kind == HYPOTHESES.index("random walk"), self._solved.likelihood, -np.inf)
        best = int(np.argmax(alone))
        return 0.0 if best == GRID_NODES else float(np.sqrt(walk[best]))

    def step(self, after: int) -> Mixture:
        """Return the step from calibration ``after`` − 1 to ``after``, in excess of the drift.

        Both are of one series.
        """
        step = (np.arange(self.time.size) >= after).astype(float)
        design = np.column_stack([self._levels, step])
        solved = self._solve(design)
        spread = np.sqrt(
            np.maximum(solved.coefficient_covariance[:, -1, -1], _MIN_NODE_WEIGHT * self.noise)
        )
        return Mixture(self._weighed(solved), solved.gain[:, :, -1] @ self.value, spread)
