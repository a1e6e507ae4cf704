"""Score tests of a change, run forward: the latest 2^j blocks against all that was known before them.

With I, b information and right-hand side before and within a segment, and Δ a change of the parameters at its start,

    v = b_w − I_wφ (I_0 + I_w)⁻¹ (b_0 + b_w),   V = I_w − I_wφ (I_0 + I_w)⁻¹ I_φw,   T = vᵀ V⁻¹ v,

the score (Lagrange-multiplier) test of Δ = 0 (Rao 1948); the segments of all lengths together are a generalised
likelihood ratio over the time of change (Willsky & Jones 1976). A segment's own noise is tested against the noise
before it by the ratio of variances. Every length has the same share of the stated rate of false alarms, so a
threshold follows from that rate and the length alone. Within a block the segments of 1, 2, 4, … samples are the digits
of a binary counter; one is tested where the score of a single parameter, or its power, is beyond the threshold.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.use.tracking import information
from vibrident.use.tracking.information import WITHIN

SECONDS_A_DAY = 86400.0
#: Chance below which a further parameter has changed as well, once a change is certain.
FURTHER = 0.01
#: Kurtosis of normal noise; a smaller one is taken for it.
NORMAL = 3.0


@dataclass(frozen=True, eq=False)
class Thresholds:
    """From a rate of false alarms: of T by its degrees of freedom, and of the deviate of a ratio of variances."""

    # of segments of 1, 2, 4, … samples, then blocks; shape (parts + levels, P), of 1 … P degrees of freedom
    change: FloatArray
    noise: FloatArray  # shape (parts + levels,)
    # sum of squares that a segment within a block has at least to be louder, in units of the variance; shape (parts,)
    louder: FloatArray
    # of T, with 1 … P degrees of freedom, of what is left beside the parameters already named; shape (P,)
    further: FloatArray

    @classmethod
    def of(cls, per_day: float, sample_s: float, parts: int, levels: int, parameters: int) -> Thresholds:
        """``per_day``: false alarms a day that are expected; ``sample_s``: time of a sample, s."""
        from scipy.stats import chi2, norm

        length = 2.0 ** np.arange(parts + levels)
        chance = -np.expm1(-per_day * sample_s * length / SECONDS_A_DAY / (2 * len(length)))  # of one or more
        freedom = np.arange(1, parameters + 1)
        change, noise = chi2.isf(chance[:, None], freedom[None, :]), np.asarray(norm.isf(chance))
        a = 2.0 / 9.0 / length
        louder = (length * (1.0 - a + noise * np.sqrt(a)) ** 3)[:parts]  # by Wilson & Hilferty, of normal noise
        return cls(change, noise, louder, np.asarray(chi2.isf(FURTHER, freedom)))


@dataclass(frozen=True, eq=False)
class Change:
    """A tested change."""

    order: list[int]  # parameters in the order in which they explain most
    increments: list[float]  # of T, what each explains
    table: FloatArray  # information about the changes and their score, shape (P, P + 1)
    # coordinates before, relative to the point of linearisation, and what a change takes from them, shape (P, P + 1)
    before: FloatArray

    @property
    def statistic(self) -> float:
        """T, with a degree of freedom for each parameter of the order."""
        return sum(self.increments)

    def least(self, further: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Coordinates before, and the change of the fewest parameters that explain it, shape (P,) each."""
        amount = amounts(self.table, fewest(self.order, self.increments, further))
        return self.before[:, 0] - self.before[:, 1:] @ amount, amount


def change(known: FloatArray, segment: FloatArray, nuisances: int) -> Change:
    """Test of a change at the start of a segment.

    ``known``: square-root information before it, shape (m, m + 1); ``segment``: products of its whitened rows, shape
    (m + 1, m + 1); ``nuisances``: columns before the parameters.
    """
    m = known.shape[0]
    prior = known.T @ known
    both = prior[:m, :m] + segment[:m, :m]
    size = np.sqrt(np.maximum(both.diagonal(), np.finfo(float).tiny))
    wanted = segment[:m, nuisances - 1 : m].copy()
    wanted[:, 0] = prior[:m, m] + segment[:m, m]
    solved = np.linalg.solve(both / (size * size[:, None]), wanted / size[:, None]) / size[:, None]
    across = segment[nuisances:m, :m] @ solved
    p = m - nuisances
    table = np.empty((p, p + 1))
    table[:, :p] = segment[nuisances:m, nuisances:m] - across[:, 1:]
    table[:, p] = segment[nuisances:m, m] - across[:, 0]
    return Change(*swept(table, segment.diagonal()[nuisances:m]), table, solved[nuisances:])


def swept(table: FloatArray, size: FloatArray) -> tuple[list[int], list[float]]:
    """Parameters in the order in which they explain most, and what each explains.

    ``table``: information about the changes and score, shape (P, P + 1); ``size``: of its diagonal before anything
    was projected out, shape (P,).
    """
    p = len(size)
    left, least = table.copy(), WITHIN * size
    order: list[int] = []
    increments: list[float] = []
    for _ in range(p):
        best, most = -1, -1.0
        for k in range(p):
            if k not in order and left[k, k] > least[k] and left[k, p] ** 2 > most * left[k, k]:
                best, most = k, float(left[k, p] ** 2 / left[k, k])
        if best < 0:
            break
        order.append(best)
        increments.append(most)
        left -= left[:, best, None] * (left[best] / left[best, best])
    return order, increments


def fewest(order: list[int], increments: list[float], further: FloatArray) -> list[int]:
    """The first of an order of parameters that explain a change.

    ``further``: T from which one more has changed, by the degrees of freedom that are left, shape (P,).
    """
    left, count = sum(increments), 0
    while count < len(order) and left > further[len(order) - count - 1]:
        left -= increments[count]
        count += 1
    return order[:count]


def amounts(table: FloatArray, order: list[int]) -> FloatArray:
    """Changes of these parameters, where they alone have changed; zero for the others, shape (P,)."""
    found = np.zeros(len(table))
    found[order] = np.linalg.solve(table[np.ix_(order, order)], table[order, -1])
    return found


def named(
    before: FloatArray, after: FloatArray, covariance: FloatArray, further: FloatArray
) -> list[tuple[int, float, float]]:
    """Which coordinates differ: place, change and its standard uncertainty, the most certain first.

    ``before``, ``after``: shape (P,); ``covariance``: of their difference, shape (P, P); ``further``: as of
    :func:`fewest`.
    """
    inverse: FloatArray = np.asarray(np.linalg.inv(covariance), dtype=float)
    table = np.column_stack([inverse, inverse @ (after - before)])
    chosen = fewest(*swept(table, inverse.diagonal()), further)
    if not chosen:
        return []
    u = np.sqrt(np.linalg.inv(inverse[np.ix_(chosen, chosen)]).diagonal())
    changed = amounts(table, chosen)
    return [(place, float(changed[place]), float(each)) for place, each in zip(chosen, u, strict=True)]


def likelihood_ratio(statistic: float, freedom: float) -> float:
    """T where the noise is known by ``freedom`` degrees of freedom, to be held against χ² (exact for two columns)."""
    return float(freedom * np.log1p(statistic / freedom))


def variance_deviate(ratio: float, above: float, below: float) -> float:
    """Normal deviate of a ratio of variances with these degrees of freedom (Wilson & Hilferty 1931)."""
    root, a, b = float(np.cbrt(ratio)), 2.0 / (9.0 * above), 2.0 / (9.0 * below)
    return ((1.0 - b) * root - (1.0 - a)) / float(np.sqrt(b * root**2 + a))


def stretch(part: FloatArray, count: int, rows: FloatArray, first: int, end: int) -> FloatArray:
    """Products of rows ``first`` … ``end`` of a block.

    ``part``: those of its segments that make its first ``count`` rows, at the binary digits of that number; ``rows``:
    those that follow, shape (…, m + 1).
    """
    new = rows[max(0, first - count) : end - count]
    found = new.T @ new
    for level in range(count.bit_length()):
        if count >> level & 1 and (count >> (level + 1)) << (level + 1) >= first:
            found += part[level]
    return found


def extend(part: FloatArray, count: int, rows: FloatArray) -> None:
    """The segments of a block of ``count`` rows with further ones."""
    total = count + len(rows)
    for level in range(len(part) - 1, -1, -1):
        first = (total >> (level + 1)) << (level + 1)
        if not total >> level & 1:
            part[level] = 0.0
        elif first + (1 << level) > count:
            part[level] = stretch(part, count, rows, first, first + (1 << level))


def suspects(
    part: FloatArray, count: int, rows: FloatArray, nuisances: int, limit: FloatArray, louder: FloatArray
) -> list[tuple[int, int]]:
    """End and level of each segment that ends in these rows and is to be tested, in the order of time.

    ``part``, ``count``, ``rows``: as of :func:`stretch`; ``nuisances``: columns before the parameters; ``limit``: of
    the squared score of a parameter over its information, shape (parts,); ``louder``: of the sum of squares, likewise.
    """
    e, slopes, p = rows[:, -1:], rows[:, nuisances:-1], rows.shape[1] - 1 - nuisances
    sums = np.concatenate([slopes * e, slopes**2, e**2], axis=1).T
    found: list[tuple[int, int]] = []
    for level in range(len(limit)):
        tested = sums[-1] > min(limit[level], louder[level])  # no score is larger
        if tested.any():
            tested &= (sums[-1] > louder[level]) | (sums[:p] ** 2 > limit[level] * sums[p:-1]).any(axis=0)
            found += [(int(count + place + 1) << level, level) for place in np.flatnonzero(tested)]
        if count & 1:  # the first of these segments has its other half in the block so far
            gram = part[level, nuisances:, nuisances:]
            head = np.concatenate([gram[:p, p], gram.diagonal()])
            sums, count = np.concatenate([head[:, None], sums], axis=1), count - 1
        whole = sums.shape[1] // 2 * 2
        if not whole:
            break
        sums, count = sums[:, :whole:2] + sums[:, 1:whole:2], count >> 1
    return sorted(found)


@dataclass(eq=False)
class Ladder:
    """The segments under way, one of each length."""

    known: FloatArray  # what was known at each one's start, shape (levels, m, m + 1)
    gram: FloatArray  # products of its rows, shape (levels, m + 1, m + 1)
    # of each, shape (levels, 7): blocks, squares and degrees of freedom of its noise; variance of the noise before it,
    # its degrees of freedom and its spread; time of its start, s
    meta: FloatArray

    @classmethod
    def empty(cls, levels: int, columns: int) -> Ladder:
        """Nothing under way."""
        known, gram = np.zeros((levels, columns, columns + 1)), np.zeros((levels, columns + 1, columns + 1))
        return cls(known, gram, np.zeros((levels, 7)))

    def add(self, known: FloatArray, gram: FloatArray, noise: tuple[float, ...], time_s: float, blocks: int) -> None:
        """A block that began at ``time_s`` after ``blocks`` others; ``known``, ``noise``: as they were before it.

        ``noise``: squares and degrees of freedom of the block; of the noise before it variance, degrees, spread.
        """
        starting = blocks % (1 << np.arange(len(self.meta))) == 0
        self.known[starting] = known
        self.gram[starting] = 0.0
        self.meta[starting] = (0.0, 0.0, 0.0, *noise[2:], time_s)
        self.gram += gram
        self.meta[:, :3] += (1.0, noise[0], noise[1])

    def shift(self, move: FloatArray) -> None:
        """The unknowns are counted from a point moved by this, shape (m,)."""
        self.known[:, :, -1] -= self.known[:, :, :-1] @ move
        self.gram[:] = information.shifted(self.gram, move)

    def drop(self, nuisances: int) -> None:
        """The nuisances are those of another run."""
        self.known[:, :nuisances] = 0.0
        for level in range(len(self.gram)):
            if self.meta[level, 0] > 0.0:
                self.gram[level] = information.without_nuisances(self.gram[level], nuisances)
