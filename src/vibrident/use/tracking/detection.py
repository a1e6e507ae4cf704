"""Score tests of a change, run forward: the latest 2^j blocks against all that precedes them.

With I, b information and right-hand side before and within a segment, and Δ a change of the
parameters at its start,

    v = b_w − I_wφ (I_0 + I_w)⁻¹ (b_0 + b_w),   V = I_w − I_wφ (I_0 + I_w)⁻¹ I_φw,   T = vᵀ V⁻¹ v,

the score (Lagrange-multiplier) test of Δ = 0 (Rao 1948); the segments of all lengths together are a
generalised likelihood ratio over the time of change (Willsky & Jones 1976). A segment's own noise
is tested against the noise before it by the ratio of variances. Every length has the same share of
the stated rate of false alarms, so a threshold follows from that rate and the length alone. Within
a block the segments of 1, 2, 4, … samples are the digits of a binary counter; one is tested where
the score of a single parameter, or its power, is beyond the threshold.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.use.tracking import information
from vibrident.use.tracking.information import MIN_INDEPENDENT_PART

SECONDS_A_DAY = 86400.0
#: Chance below which a further parameter has changed as well, once one change is certain.
FURTHER_CHANGE_CHANCE = 0.01
#: Kurtosis of normal noise; a smaller kurtosis is taken as this.
NORMAL_KURTOSIS = 3.0


@dataclass(frozen=True, eq=False)
class Thresholds:
    """Thresholds of the tests, from a rate of false alarms.

    They are those of T by its degrees of freedom, and of the normal deviate of a ratio of
    variances.
    """

    # T of segments of 1, 2, 4, … samples, then blocks, with 1 … P degrees of freedom; shape
    # (parts + levels, P)
    change: FloatArray
    noise: FloatArray  # deviate of each segment's noise, shape (parts + levels,)
    # smallest sum of squares of a segment within a block that is louder than the noise, in units of
    # the variance; shape (parts,)
    louder: FloatArray
    # T, with 1 … P degrees of freedom, that the parameters named so far leave where a further one
    # has changed; shape (P,)
    further: FloatArray

    @classmethod
    def from_alarm_rate(
        cls, per_day: float, sample_s: float, short_lengths: int, levels: int, parameters: int
    ) -> Thresholds:
        """Return the thresholds of an expected rate of false alarms.

        Args:
            per_day: false alarms a day.
            sample_s: sampling interval, s.
            short_lengths: number of lengths within a block.
            levels: number of lengths of whole blocks.
            parameters: number of parameters P.
        """
        from scipy.stats import chi2, norm

        length = 2.0 ** np.arange(short_lengths + levels)
        # of one false alarm or more
        chance = -np.expm1(-per_day * sample_s * length / SECONDS_A_DAY / (2 * len(length)))
        freedom = np.arange(1, parameters + 1)
        change = chi2.isf(chance[:, None], freedom[None, :])
        noise = np.asarray(norm.isf(chance))
        a = 2.0 / 9.0 / length
        # by Wilson & Hilferty, of normal noise
        louder = (length * (1.0 - a + noise * np.sqrt(a)) ** 3)[:short_lengths]
        return cls(change, noise, louder, np.asarray(chi2.isf(FURTHER_CHANGE_CHANCE, freedom)))


@dataclass(frozen=True, eq=False)
class ChangeTest:
    """Outcome of a score test of a change."""

    order: list[int]  # parameters in the order in which they explain most
    increments: list[float]  # part of T that each explains
    table: FloatArray  # information about the changes and their score, shape (P, P + 1)
    # coordinates before the change, relative to the point of linearisation, and their slopes by
    # the changes; shape (P, P + 1)
    before: FloatArray

    @property
    def statistic(self) -> float:
        """Return T, which has one degree of freedom for each parameter of the order."""
        return sum(self.increments)

    def smallest(self, further: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the coordinates before, and the change of the fewest parameters that explain it.

        Both have shape (P,); ``further`` is as of :func:`fewest_changes`.
        """
        amount = solve_changes(self.table, fewest_changes(self.order, self.increments, further))
        return self.before[:, 0] - self.before[:, 1:] @ amount, amount


def score_test(root: FloatArray, segment: FloatArray, nuisances: int) -> ChangeTest:
    """Test a change at the start of a segment.

    Args:
        root: square-root information before it, shape (m, m + 1).
        segment: products of its whitened rows, shape (m + 1, m + 1).
        nuisances: number of columns before the parameters.
    """
    m = root.shape[0]
    prior = root.T @ root
    total = prior[:m, :m] + segment[:m, :m]
    size = np.sqrt(np.maximum(total.diagonal(), np.finfo(float).tiny))
    right_sides = segment[:m, nuisances - 1 : m].copy()
    right_sides[:, 0] = prior[:m, m] + segment[:m, m]
    responses = (
        np.linalg.solve(total / (size * size[:, None]), right_sides / size[:, None]) / size[:, None]
    )
    projected = segment[nuisances:m, :m] @ responses
    p = m - nuisances
    table = np.empty((p, p + 1))
    table[:, :p] = segment[nuisances:m, nuisances:m] - projected[:, 1:]
    table[:, p] = segment[nuisances:m, m] - projected[:, 0]
    return ChangeTest(
        *order_by_score(table, segment.diagonal()[nuisances:m]), table, responses[nuisances:]
    )


def order_by_score(table: FloatArray, size: FloatArray) -> tuple[list[int], list[float]]:
    """Return the parameters in the order in which they explain most, and what each explains.

    Args:
        table: information about the changes and their score, shape (P, P + 1).
        size: diagonal of the information before anything was projected out, shape (P,).
    """
    p = len(size)
    remaining = table.copy()
    smallest = MIN_INDEPENDENT_PART * size
    order: list[int] = []
    increments: list[float] = []
    for _ in range(p):
        best = -1
        largest = -1.0
        for k in range(p):
            if (
                k not in order
                and remaining[k, k] > smallest[k]
                and remaining[k, p] ** 2 > largest * remaining[k, k]
            ):
                best = k
                largest = float(remaining[k, p] ** 2 / remaining[k, k])
        if best < 0:
            break
        order.append(best)
        increments.append(largest)
        remaining -= remaining[:, best, None] * (remaining[best] / remaining[best, best])
    return order, increments


def fewest_changes(order: list[int], increments: list[float], further: FloatArray) -> list[int]:
    """Return the first parameters of an order, as many as are needed to explain a change.

    ``further``: T from which a further parameter has changed, by the degrees of freedom that
    remain, shape (P,).
    """
    unexplained = sum(increments)
    count = 0
    while count < len(order) and unexplained > further[len(order) - count - 1]:
        unexplained -= increments[count]
        count += 1
    return order[:count]


def solve_changes(table: FloatArray, order: list[int]) -> FloatArray:
    """Return the changes of the parameters where only those of ``order`` changed, shape (P,).

    The other parameters' changes are zero.
    """
    changes = np.zeros(len(table))
    changes[order] = np.linalg.solve(table[np.ix_(order, order)], table[order, -1])
    return changes


def changed_coordinates(
    before: FloatArray, after: FloatArray, covariance: FloatArray, further: FloatArray
) -> list[tuple[int, float, float]]:
    """Return the coordinates that differ: index, change and standard uncertainty of each.

    The most certain comes first.

    Args:
        before: coordinates before, shape (P,).
        after: coordinates after, shape (P,).
        covariance: of their difference, shape (P, P).
        further: as of :func:`fewest_changes`.
    """
    inverse: FloatArray = np.asarray(np.linalg.inv(covariance), dtype=float)
    table = np.column_stack([inverse, inverse @ (after - before)])
    indices = fewest_changes(*order_by_score(table, inverse.diagonal()), further)
    if not indices:
        return []
    u = np.sqrt(np.linalg.inv(inverse[np.ix_(indices, indices)]).diagonal())
    changed = solve_changes(table, indices)
    return [
        (index, float(changed[index]), float(uncertainty))
        for index, uncertainty in zip(indices, u, strict=True)
    ]


def likelihood_ratio(statistic: float, freedom: float) -> float:
    """Return T for noise that is known by ``freedom`` degrees of freedom.

    It is to be held against χ², which is exact for two columns.
    """
    return float(freedom * np.log1p(statistic / freedom))


def variance_deviate(ratio: float, above: float, below: float) -> float:
    """Return the normal deviate of a ratio of variances (Wilson & Hilferty 1931).

    ``above`` and ``below`` are the degrees of freedom of the two variances.
    """
    root = float(np.cbrt(ratio))
    a = 2.0 / (9.0 * above)
    b = 2.0 / (9.0 * below)
    return ((1.0 - b) * root - (1.0 - a)) / float(np.sqrt(b * root**2 + a))


def segment_products(
    stored: FloatArray, count: int, rows: FloatArray, first: int, end: int
) -> FloatArray:
    """Return the products of rows ``first`` … ``end`` of a block, shape (m + 1, m + 1).

    Args:
        stored: products of the segments that make up its first ``count`` rows, at the binary digits
            of that number.
        count: number of rows in the segments.
        rows: rows that follow, shape (…, m + 1).
        first: first row.
        end: row after the last.
    """
    new = rows[max(0, first - count) : end - count]
    products = new.T @ new
    for level in range(count.bit_length()):
        if count >> level & 1 and (count >> (level + 1)) << (level + 1) >= first:
            products += stored[level]
    return products


def extend_segments(products: FloatArray, count: int, rows: FloatArray) -> None:
    """Add rows to the segments of a block of ``count`` rows, in place."""
    total = count + len(rows)
    for level in range(len(products) - 1, -1, -1):
        first = (total >> (level + 1)) << (level + 1)
        if not total >> level & 1:
            products[level] = 0.0
        elif first + (1 << level) > count:
            products[level] = segment_products(products, count, rows, first, first + (1 << level))


def suspect_segments(
    products: FloatArray,
    count: int,
    rows: FloatArray,
    nuisances: int,
    limit: FloatArray,
    louder: FloatArray,
) -> list[tuple[int, int]]:
    """Return end and level of each segment to be tested that ends in these rows, in time order.

    Args:
        products: as of :func:`segment_products`.
        count: as of :func:`segment_products`.
        rows: as of :func:`segment_products`.
        nuisances: number of columns before the parameters.
        limit: of the squared score of a parameter over its information, shape (parts,).
        louder: of the sum of squares, shape (parts,).
    """
    e = rows[:, -1:]
    slopes = rows[:, nuisances:-1]
    p = rows.shape[1] - 1 - nuisances
    sums = np.concatenate([slopes * e, slopes**2, e**2], axis=1).T
    segments: list[tuple[int, int]] = []
    for level in range(len(limit)):
        tested = sums[-1] > min(limit[level], louder[level])  # no score is larger
        if tested.any():
            tested &= (sums[-1] > louder[level]) | (sums[:p] ** 2 > limit[level] * sums[p:-1]).any(
                axis=0
            )
            segments += [
                (int(count + index + 1) << level, level) for index in np.flatnonzero(tested)
            ]
        if count & 1:  # the first half of the first segment is in the block so far
            gram = products[level, nuisances:, nuisances:]
            head = np.concatenate([gram[:p, p], gram.diagonal()])
            sums = np.concatenate([head[:, None], sums], axis=1)
            count = count - 1
        paired = sums.shape[1] // 2 * 2
        if not paired:
            break
        sums = sums[:, :paired:2] + sums[:, 1:paired:2]
        count = count >> 1
    return sorted(segments)


@dataclass(eq=False)
class Ladder:
    """Segments under way, one of each length."""

    # square-root information at the start of each segment, shape (levels, m, m + 1)
    root: FloatArray
    gram: FloatArray  # products of the rows of each segment, shape (levels, m + 1, m + 1)
    # of each segment: blocks, squares and degrees of freedom of its noise; variance of the noise
    # before it, its degrees of freedom and its spread; time of its start, s; shape (levels, 7)
    meta: FloatArray

    @classmethod
    def empty(cls, levels: int, columns: int) -> Ladder:
        """Return a ladder without a segment under way."""
        root = np.zeros((levels, columns, columns + 1))
        gram = np.zeros((levels, columns + 1, columns + 1))
        return cls(root, gram, np.zeros((levels, 7)))

    def add(
        self,
        root: FloatArray,
        gram: FloatArray,
        noise: tuple[float, ...],
        time_s: float,
        blocks: int,
    ) -> None:
        """Add a block to every segment, and begin those whose length has come round.

        Args:
            root: square-root information before the block, shape (m, m + 1).
            gram: products of its rows, shape (m + 1, m + 1).
            noise: squares and degrees of freedom of the block; variance, degrees of freedom and
                spread of the noise before it.
            time_s: time of its start, s.
            blocks: number of blocks before it.
        """
        starting = blocks % (1 << np.arange(len(self.meta))) == 0
        self.root[starting] = root
        self.gram[starting] = 0.0
        self.meta[starting] = (0.0, 0.0, 0.0, *noise[2:], time_s)
        self.gram += gram
        self.meta[:, :3] += (1.0, noise[0], noise[1])

    def shift(self, move: FloatArray) -> None:
        """Count the unknowns from a point that has moved by ``move``, shape (m,)."""
        self.root[:, :, -1] -= self.root[:, :, :-1] @ move
        self.gram[:] = information.shifted(self.gram, move)

    def drop(self, nuisances: int) -> None:
        """Forget the nuisances, where another run begins."""
        self.root[:, :nuisances] = 0.0
        for level in range(len(self.gram)):
            if self.meta[level, 0] > 0.0:
                self.gram[level] = information.without_nuisances(self.gram[level], nuisances)
