"""A change between the blocks of a record: the step, or the even change, that explains most, and how sure it is.

In every block the residual is what p columns add, in amounts that noise makes differ from block to block; a change is a
step of two of them. Its test is by the blocks' own scatter (Chow 1960; Andrews 1993).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.base.tails import f_tail
from vibrident.data.records import FloatArray
from vibrident.data.records.basis import distinct
from vibrident.fit.measure.terms import products

#: Number of independent places of a step.
PLACES = 8.0
#: A change explains why blocks differ where it leaves, beyond noise, less than this part of what it explains …
UNEXPLAINED = 0.2
#: … or what chance would leave with a probability above this.
CONSISTENT = 1e-3
#: It begins somewhere in a block, and filters carry it into the next: so many on either side may differ.
AWAY = 2.0
#: Fewest blocks on either side of a step.
BESIDE = 2
#: A block moves where it has this part of the mean power of the motion …
MOVING = 0.02
#: … or so many times the power of what is left.
STANDS_OUT = 300.0
#: Number of neighbours with which a block may be correlated.
LAGS = 4
#: Eigenvalues of a matrix of powers below this part of the largest are zero.
RANK = 1e-10
#: Mains frequencies.
MAINS_HZ = (50.0, 60.0)
#: Harmonics of them that are looked for.
HARMONICS = 5
#: Samples that are worked on at once.
AT_ONCE = 1 << 16
#: Hum is significant at this power over that of white noise.
HEARD = 12.0
#: What changes together: gain and time shift of the channel; natural frequency and damping ratio of the sensor.
PAIRS = (slice(0, 2), slice(2, 4))


@dataclass(frozen=True, eq=False)
class Blocks:
    """What the blocks of a record say of p changes, by products with what each adds.

    Attributes:
        products: of these columns with the residual, shape (blocks, p).
        powers: of the columns, shape (blocks, p, p).
        scale: of the columns, shape (p,).
        squares: of the residual, shape (blocks,).
        free: degrees of freedom of these, shape (blocks,).
        moving: blocks with motion; the others' products are zero, shape (blocks,).
    """

    products: FloatArray
    powers: FloatArray
    scale: FloatArray
    squares: FloatArray
    free: FloatArray
    moving: np.ndarray

    @classmethod
    def of(cls, columns: FloatArray, residual: FloatArray, parts: Sequence[np.ndarray], rate: float) -> Blocks:
        """Of columns, shape (p, samples), and what is left beside them; offset, drift and hum of a block are none."""
        p, scale = len(columns), np.maximum(_deviations(columns, parts), np.finfo(float).tiny)
        products, powers, squares = np.zeros((len(parts), p)), np.zeros((len(parts), p, p)), np.zeros(len(parts))
        hum = _hum(residual, parts, rate)
        for which in _of_one_size(parts):
            size = parts[which[0]].size
            trend = np.stack([np.ones(size), np.linspace(-1.0, 1.0, size)], axis=1)[None]
            if hum.size:
                angle = 2.0 * np.pi / rate * np.stack([parts[index] for index in which])[..., None] * hum
                trend = np.repeat(trend, len(which), axis=0)
                trend = np.concatenate([trend, np.cos(angle), np.sin(angle)], axis=2)
            basis, _ = np.linalg.qr(trend)
            rows = _side_by_side(columns, residual, [parts[index] for index in which])
            rows[:, :-1] /= scale[:, None]
            rows -= (rows @ basis) @ np.swapaxes(basis, 1, 2)
            both = rows @ np.swapaxes(rows, 1, 2)
            products[which], powers[which], squares[which] = both[:, :p, p], both[:, :p, :p], both[:, p, p]
        # At rest the gain is not defined.
        motion = powers[:, 0, 0]
        moving = (motion > MOVING * np.mean(motion)) | (
            motion * scale[0] ** 2 > STANDS_OUT * np.maximum(squares, np.mean(squares))
        )
        for sums in (products, powers, squares):
            sums[~moving] = 0.0
        free = np.where(moving, np.array([part.size for part in parts]) - 2.0 - 2.0 * hum.size, 0.0)
        return cls(products, powers, scale, squares, free, moving)


@dataclass(frozen=True, eq=False)
class Fit:
    """The change that explains most.

    Attributes:
        blocks: what it was fitted to.
        pair: the columns that change.
        shape: of the change over the blocks, shape (blocks,).
        squares: left by it, less a constant.
        fit: all columns' amounts before, and the change of the pair, in ``blocks.scale``, shape (p + 2,).
        place: the block that it begins at.
        slow: it is even over the record.
    """

    blocks: Blocks
    pair: slice
    shape: FloatArray
    squares: float
    fit: FloatArray
    place: int
    slow: bool

    @property
    def step(self) -> FloatArray:
        """The change, shape (2,)."""
        return self.fit[-2:]

    @property
    def amounts(self) -> FloatArray:
        """Of every column in each block, shape (blocks, p)."""
        found = np.tile(self.fit[:-2], (self.shape.size, 1))
        found[:, self.pair] += np.outer(self.shape, self.step)
        return found

    def signal(self, columns: FloatArray, parts: Sequence[np.ndarray]) -> FloatArray:
        """What the change adds to the response, shape (samples,)."""
        found = np.zeros(columns.shape[1])
        for part, amounts in zip(parts, self.amounts / self.blocks.scale, strict=True):
            found[part] = amounts @ columns[:, part]
        return found

    @property
    def gained(self) -> float:
        """Squares that are left without the change, less those left by it."""
        whole = self.blocks.products.sum(axis=0)
        return -float(whole @ _inverse(self.blocks.powers.sum(axis=0)) @ whole) - self.squares

    def size_beside(self, powers: FloatArray) -> float:
        """Amplitude of what the change adds, on that side of it where it is smaller.

        Args:
            powers: mean products of the columns with each other in each block, shape (blocks, p, p).
        """
        change = self.step / self.blocks.scale[self.pair]
        squares = np.einsum("i,bij,j->b", change, powers[:, self.pair, self.pair], change)[self.blocks.moving]
        after = self.shape[self.blocks.moving] > 0.0
        sides = [float(np.mean(squares[side])) for side in (after, ~after) if side.any()]
        return float(np.sqrt(2.0 * min(sides, default=0.0)))

    def _left(self, kept: slice | np.ndarray = slice(None)) -> tuple[FloatArray, float, float]:
        """What the change leaves of the products, shape (blocks, p); its squares and their degrees of freedom."""
        powers = self.blocks.powers[kept]
        left = self.blocks.products[kept] - np.einsum("bij,bj->bi", powers, self.amounts[kept])
        squares = float(np.einsum("bi,bij,bj->", left, _inverse(powers), left))
        return left, squares, _rank(powers) - float(self.fit.size)

    @property
    def explains(self) -> bool:
        """Whether the blocks away from the change agree, as noise within them allows."""
        away = np.abs(np.arange(self.shape.size) - self.place + 0.5) > AWAY
        _, squares, freedom = self._left(away)
        products, powers = self.blocks.products[away], self.blocks.powers[away]
        own = float(np.sum(self.blocks.squares[away]) - np.einsum("bi,bij,bj->", products, _inverse(powers), products))
        free = float(np.sum(self.blocks.free[away])) - _rank(powers)
        if min(free, own, freedom) <= 0.0:
            return False
        noise = own / free
        if squares - freedom * noise < UNEXPLAINED * self.gained:
            return True
        return bool(f_tail(freedom, free, squares / freedom / noise) > CONSISTENT)

    def chance(self) -> float:
        """How often noise would show as much: by the scatter of the blocks, and by each side's own.

        Noise that grows makes some blocks scatter more (the covariance of White 1980), and a hum beside a tone makes
        neighbours alike, which leaves fewer that are independent.
        """
        blocks, powers = float(np.sum(self.blocks.moving)), self.blocks.powers
        left, rest, freedom = self._left()
        after = self.shape[self.blocks.moving] > 0.0
        fewer = float(min(np.sum(after), np.sum(~after)))
        if fewer < BESIDE or freedom <= 0.0:
            return 1.0
        independent = max(freedom / _fewer(left, powers), 1.0)
        scatter = f_tail(2.0, independent, self.gained / 2.0 / max(rest, np.finfo(float).tiny) * independent)
        scores = np.concatenate([left, self.shape[:, None] * left[:, self.pair]], axis=1)
        bread = _inverse(_normal(powers, self.shape, self.pair))
        robust = (bread @ (scores.T @ scores) @ bread * blocks / (blocks - 2.0))[-2:, -2:]
        wald = float(self.step @ np.linalg.pinv(robust, hermitian=True) @ self.step) / 2.0
        tried = PLACES * self.blocks.scale.size / 2.0
        return min(1.0, max(tried * scatter, float(f_tail(2.0, 2.0 * (fewer - 1.0), wald))))


def sums_of(columns: FloatArray, residual: FloatArray, parts: Sequence[np.ndarray]) -> FloatArray:
    """Mean products, over each block, of the columns and the residual with each other, shape (blocks, p + 1, p + 1)."""
    found = np.empty((len(parts), len(columns) + 1, len(columns) + 1))
    for which in _of_one_size(parts):
        rows = _side_by_side(columns, residual, [parts[index] for index in which])
        found[which] = rows @ np.swapaxes(rows, 1, 2) / rows.shape[2]
    return found


def _side_by_side(columns: FloatArray, residual: FloatArray, parts: Sequence[np.ndarray]) -> FloatArray:
    """Columns and residual in parts of one size, shape (parts, p + 1, samples of a part)."""
    found = np.empty((len(parts), len(columns) + 1, parts[0].size))
    first, last = int(parts[0][0]), int(parts[-1][-1])
    together = last - first + 1 == len(parts) * parts[0].size  # without a gap
    places = slice(first, last + 1) if together else np.concatenate(parts)
    for number, row in enumerate((*columns, residual)):
        found[:, number] = row[places].reshape(len(parts), -1)
    return found


def least_left(sums: FloatArray, parts: Sequence[np.ndarray]) -> float:
    """Squares of a residual that stay at least, whatever amounts of the columns are taken out of each block."""
    products, powers = sums[:, :-1, -1], sums[:, :-1, :-1]
    left = sums[:, -1, -1] - np.einsum("bi,bij,bj->b", products, _inverse(powers), products)
    return float(left @ [part.size for part in parts])


def best(blocks: Blocks) -> Fit:
    """The even change, or the step before a block, that explains most."""
    count = len(blocks.products)
    moving = np.cumsum(blocks.moving)
    places = [p for p in range(1, count) if BESIDE <= moving[p - 1] <= moving[-1] - BESIDE and blocks.moving[p]]
    steps = [np.where(np.arange(count) < place, 0.0, 1.0) for place in places]
    shapes = np.stack([np.linspace(-0.5, 0.5, count), *steps])
    places = [count // 2, *places]
    found = []
    for pair in PAIRS[: blocks.scale.size // 2]:
        squares, fits = _fitted(blocks, shapes, pair)
        best = int(np.argmin(squares))
        found.append(Fit(blocks, pair, shapes[best], float(squares[best]), fits[best], places[best], best == 0))
    return min(found, key=lambda fit: fit.squares)


def _of_one_size(parts: Sequence[np.ndarray]) -> Iterator[list[int]]:
    """Numbers of parts of one size, of at most AT_ONCE samples together."""
    for size in sorted({part.size for part in parts}):
        which, width = [i for i, part in enumerate(parts) if part.size == size], max(1, AT_ONCE // size)
        yield from (which[i : i + width] for i in range(0, len(which), width))


def _joined(parts: Sequence[np.ndarray]) -> Iterator[slice | np.ndarray]:
    """Consecutive parts together, of at most AT_ONCE samples: of a long record each copy counts."""
    width = max(1, AT_ONCE // max(part.size for part in parts))
    for i in range(0, len(parts), width):
        some = parts[i : i + width]
        first, last = int(some[0][0]), int(some[-1][-1])
        gaps = last - first + 1 > sum(part.size for part in some)
        yield np.concatenate(some) if gaps else slice(first, last + 1)


def _deviations(columns: FloatArray, parts: Sequence[np.ndarray]) -> FloatArray:
    """Standard deviation of each column over all parts, shape (p,)."""
    count = float(sum(part.size for part in parts))
    sums, squares = np.zeros(len(columns)), np.zeros(len(columns))
    for some in _joined(parts):
        sums += [column[some].sum() for column in columns]
    for some in _joined(parts):
        squares += [np.sum((column[some] - mean) ** 2) for column, mean in zip(columns, sums / count, strict=True)]
    return np.sqrt(squares / count)


def _hum(residual: FloatArray, parts: Sequence[np.ndarray], rate: float) -> FloatArray:
    """Mains frequencies and their harmonics that are significant in a residual; beside a tone they beat with it."""
    hz, power = np.outer(MAINS_HZ, np.arange(1, HARMONICS + 1)), 0.0
    sums = np.zeros(hz.size, complex)
    for part in _joined(parts):
        own, first = residual[part], part.start if isinstance(part, slice) else int(part[0])
        power += float(own @ own)
        if not isinstance(part, slice):
            own = np.zeros(int(part[-1]) - first + 1)
            own[part - first] = residual[part]
        sums += products(own, np.asarray(2j * np.pi / rate * hz.ravel(), dtype=complex), first)
    found = hz[np.abs(sums.reshape(hz.shape)) ** 2 > HEARD * power]
    return distinct(found[found < 0.5 * rate]).astype(float)


def _fitted(blocks: Blocks, shapes: FloatArray, pair: slice) -> tuple[FloatArray, FloatArray]:
    """Squares left by θ = α + β shape, less a constant, shape (m,), and (α, β), shape (m, p + 2), for m shapes."""
    whole = np.broadcast_to(blocks.products.sum(axis=0), (len(shapes), blocks.scale.size))
    product = np.concatenate([whole, shapes @ blocks.products[:, pair]], axis=1)
    fits = np.einsum("mij,mj->mi", _inverse(_normal(blocks.powers, shapes, pair)), product)
    return -np.sum(product * fits, axis=1), fits


def _normal(powers: FloatArray, shapes: FloatArray, pair: slice) -> FloatArray:
    """Normal matrix of (α, β) for each shape, shape (…, p + 2, p + 2)."""
    one, two, three = (np.einsum("...b,bij->...ij", shapes**k, powers) for k in range(3))
    rows = (
        np.concatenate([one, two[..., pair]], axis=-1),
        np.concatenate([two[..., pair, :], three[..., pair, pair]], axis=-1),
    )
    return np.concatenate(rows, axis=-2)


def _inverse(matrices: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eigh(matrices)
    size = np.abs(values)
    shown = size > RANK * np.max(size, axis=-1, keepdims=True)
    kept = np.where(shown, 1.0 / np.where(shown, values, 1.0), 0.0)
    return np.asarray((vectors * kept[..., None, :]) @ np.swapaxes(vectors, -1, -2), dtype=float)


def _rank(matrices: FloatArray) -> float:
    """Sum of their ranks; changes of one tone have two, however many are sought."""
    values = np.linalg.eigvalsh(matrices)
    return float(np.sum(values > RANK * values[:, -1:]))


def _fewer(left: FloatArray, powers: FloatArray) -> float:
    """Number of blocks that hold the information of one independent block (Newey & West 1987), at least one.

    Noise beside a tone, or through a sharp resonance, is alike from block to block.
    """
    size = np.sqrt(np.maximum(np.einsum("bii->bi", powers), np.finfo(float).tiny))
    scores = left / size
    total = max(float(np.sum(scores**2)), np.finfo(float).tiny)
    found = 1.0
    for lag in range(1, LAGS + 1):
        # A fit leaves small differences between them.
        alike = float(np.sum(scores[lag:] * scores[:-lag])) / total + 1.0 / len(left)
        found += 2.0 * (1.0 - lag / (LAGS + 1.0)) * alike
    return float(np.clip(found, 1.0, 50.0))
