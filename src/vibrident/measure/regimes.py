"""Test for a change of the sensor within a record, or between records.

The residual of a record is compared, block by block, with the prediction and its slope: θ = (gain, time shift) of
the block. Without a change the θ of all blocks agree but for noise, whose own scatter from block to block is the
measure, so that its colour does not matter: the F test of one step among the blocks, its place sought (Chow 1960;
Andrews 1993), or of an even change over all of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy import fft

from vibrident.measure.alignment import prediction_error
from vibrident.measure.nonlinearity import heard_motion, median_level
from vibrident.measure.odd_records import OddRecord
from vibrident.measure.quality import STEADY, Finding
from vibrident.measure.response import LEAST_DEVIATION
from vibrident.measure.tones import turning
from vibrident.records import BoolArray, FloatArray, Record
from vibrident.tails import f_tail

#: Probability of a finding in a calibration without a change.
CHANCE = 1e-4
#: Number of independent places of a step.
PLACES = 8.0
#: Chance by the robust test, which has fewer degrees of freedom.
ROBUST = 1e-4
#: Largest number of blocks of a record.
MOST_BLOCKS = 32
#: Smallest number of blocks of a record.
FEWEST_BLOCKS = 8
#: Fewest samples of a block.
FEWEST_SAMPLES = 24
#: Fewest blocks on either side of a step.
BESIDE = 2
#: Part of the motion that must lie on either side of a step: at rest the gain is not defined.
MOVING = 0.02
#: Noise of the reference stands at each line in prediction and residual alike: so many times the latter is none of it.
OWN = 2.0
#: Lines averaged on either side for the residual's spectrum.
SMOOTHED = 4
#: Lower limit of this spectrum, relative to its mean.
LEAST_LEVEL = 1e-9
#: A change is nearly all of the residual where this part of its power is left.
REST = 0.15
KERNEL = np.full(2 * SMOOTHED + 1, 1.0 / (2 * SMOOTHED + 1))
#: Number of neighbours with which a block may be correlated.
LAGS = 4
#: Mains frequencies.
MAINS_HZ = (50.0, 60.0)
#: Harmonics of them that are looked for.
HARMONICS = 5
#: Samples that are worked on at once.
AT_ONCE = 1 << 16
#: Hum is significant at this power over that of white noise.
HEARD = 12.0
#: Largest number of changes that are listed one by one.
MOST_NAMED = 3


@dataclass(frozen=True)
class Change:
    """A change within a record.

    Attributes:
        record: its name.
        time_s: when, from the record's first sample, to about a block.
        gain: relative change of the response's size.
        later_s: by how much the response comes later than before.
        slow: it changed evenly over the record, by so much from its beginning to its end.
    """

    record: str
    time_s: float
    gain: float
    later_s: float
    slow: bool = False


def changes(
    records: Sequence[Record], predicted: Sequence[FloatArray], frequency_hz: Sequence[float | None]
) -> list[Change]:
    """Significant changes within records.

    Args:
        records: the records.
        predicted: response that a model predicts for each, shape (samples,), NaN where it is not defined.
        frequency_hz: of a sine; None for other motion.
    """
    found = []
    for record, series, frequency in zip(records, predicted, frequency_hz, strict=True):
        # Under other motion a misfit over frequency looks like one over time.
        if record.excitation in STEADY and record.reference is not None:
            change = _change(record, series, frequency, CHANCE / PLACES / len(records))
            found += [] if change is None else [change]
    return found


def _change(record: Record, series: FloatArray, frequency: float | None, chance: float) -> Change | None:
    used = record.mask & np.isfinite(series)
    count = min(MOST_BLOCKS, int(used.sum()) // FEWEST_SAMPLES)
    if frequency is not None:
        count = min(count, int(used.sum() * frequency / record.sampling_rate_hz))  # a period each
    if count < FEWEST_BLOCKS or np.ptp(series[used]) == 0.0:
        return None
    residual = np.where(used, record.response - series, 0.0)
    residual = np.where(used, residual - np.mean(residual[used]), 0.0)
    if record.excitation == "random":
        series, residual, used = _without_memory(series, residual, used)
    lines = np.asarray(fft.rfft(residual), dtype=complex)
    power = np.abs(lines) ** 2
    # Noise of the reference is in prediction and residual alike: lines that hold nothing else are no motion.
    motion = heard_motion(series, used, np.maximum(median_level(power), OWN * power))
    if not np.any(motion):
        return None
    parts = np.array_split(np.flatnonzero(used), count)
    rough = _best(_Blocks.of(motion, residual, parts, record.sampling_rate_hz))
    noise = residual - rough.signal(motion, parts, record.sampling_rate_hz)
    # Noise through a sharp resonance is alike over many blocks, which would look like a change: both are filtered so
    # that the noise is white. A change that is nearly all of the residual is not taken for noise.
    nearly_all = float(noise @ noise) < REST * float(residual @ residual)
    white = _whitening(
        np.abs(np.asarray(fft.rfft(noise))) ** 2 if nearly_all else power, tones=record.excitation != "random"
    )
    moved, left = (np.asarray(fft.irfft(white * v, used.size)) for v in (np.asarray(fft.rfft(motion)), lines))
    found = _best(_Blocks.of(moved, left, parts, record.sampling_rate_hz))
    if not _beyond_doubt(found.blocks.products, found.blocks.powers, found.shape, (found.squares, found.fit), chance):
        return None
    if np.max(np.abs(found.fit[2:])) < LEAST_DEVIATION * found.blocks.scale[0]:
        return None  # interpolation between samples is no better than that
    change = found.fit[2:] / found.blocks.scale
    time_s = float(parts[found.place][0]) / record.sampling_rate_hz
    return Change(record.name, time_s, float(change[0]), float(-change[1]), slow=found.slow)


def _without_memory(
    series: FloatArray, residual: FloatArray, used: BoolArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Prediction and residual through the filter that predicts the residual from its past, and where both are known.

    Noise of the reference rings on in a sharp resonance, in both alike, for longer than the record: blocks would differ
    by what happened before. The filter takes the ringing out, which no spectrum at the record's lines resolves.
    """
    coefficients = prediction_error(residual)
    filtered = [np.convolve(np.where(used, v, 0.0), coefficients)[: used.size] for v in (series, residual)]
    known = np.convolve(~used, np.ones(coefficients.size))[: used.size] < 0.5
    known[: coefficients.size - 1] = False
    return np.where(known, filtered[0], np.nan), np.where(known, filtered[1], 0.0), known


def _whitening(power: FloatArray, *, tones: bool) -> FloatArray:
    """Gain at each line that makes noise of this power white, shape (lines,); ``tones``: the motion is of tones.

    Beside a tone a change appears in a few lines, which do not give the noise.
    """
    power = power + np.finfo(float).tiny + LEAST_LEVEL * float(np.mean(power))
    logarithm = np.log(median_level(power) if tones else power)
    logarithm = np.convolve(np.pad(logarithm, SMOOTHED, mode="edge"), KERNEL, mode="valid")
    return np.exp(0.5 * (np.mean(logarithm) - logarithm))


@dataclass(frozen=True, eq=False)
class _Blocks:
    """What the blocks of a record say of gain and time shift, by products with the motion and its slope.

    Attributes:
        products: of motion and slope with the residual, shape (blocks, 2).
        powers: of motion and slope, shape (blocks, 2, 2).
        scale: of motion and slope, shape (2,).
    """

    products: FloatArray
    powers: FloatArray
    scale: FloatArray

    @classmethod
    def of(cls, motion: FloatArray, residual: FloatArray, parts: Sequence[np.ndarray], rate: float) -> _Blocks:
        """Of a motion and what is left beside it; offset, drift and hum of a block are no change."""
        slope = np.gradient(motion, 1.0 / rate)
        every = np.concatenate(parts)
        scale = np.maximum([np.std(motion[every]), np.std(slope[every])], np.finfo(float).tiny)
        products, powers = np.zeros((len(parts), 2)), np.zeros((len(parts), 2, 2))
        hum = _hum(residual, every, rate)
        del every  # of a long record each copy counts
        for which in _side_by_side(parts):
            places = np.stack([parts[index] for index in which])
            size = places.shape[1]
            trend = np.stack([np.ones(size), np.linspace(-1.0, 1.0, size)], axis=1)[None]
            if hum.size:
                angle = 2.0 * np.pi / rate * places[..., None] * hum
                trend = np.repeat(trend, len(which), axis=0)
                trend = np.concatenate([trend, np.cos(angle), np.sin(angle)], axis=2)
            basis, _ = np.linalg.qr(trend)
            columns = np.stack([motion[places] / scale[0], slope[places] / scale[1], residual[places]], axis=1)
            columns -= (columns @ basis) @ np.swapaxes(basis, 1, 2)
            both = columns[:, :2] @ np.swapaxes(columns, 1, 2)
            products[which], powers[which] = both[..., 2], both[..., :2]
        return cls(products, powers, scale)


@dataclass(frozen=True, eq=False)
class _Fit:
    """The change that explains most.

    Attributes:
        blocks: what it was fitted to.
        shape: of the change over the blocks, shape (blocks,).
        squares: left by it, less a constant.
        fit: gain and shift before, and their change, in ``blocks.scale``, shape (4,).
        place: the block that it begins at.
        slow: it is even over the record.
    """

    blocks: _Blocks
    shape: FloatArray
    squares: float
    fit: FloatArray
    place: int
    slow: bool

    def signal(self, motion: FloatArray, parts: Sequence[np.ndarray], rate: float) -> FloatArray:
        """What the change adds to the response, shape (samples,)."""
        slope, found = np.gradient(motion) * rate, np.zeros(motion.size)
        for part, size in zip(parts, self.shape.tolist(), strict=True):
            gain, shift = (self.fit[:2] + size * self.fit[2:]) / self.blocks.scale
            found[part] = gain * motion[part] + shift * slope[part]
        return found


def _best(blocks: _Blocks) -> _Fit:
    """The even change, or the step before a block, that explains most."""
    count = len(blocks.products)
    before = np.cumsum(blocks.powers[:, 0, 0]) / max(float(np.sum(blocks.powers[:, 0, 0])), np.finfo(float).tiny)
    places = [p for p in range(BESIDE, count - BESIDE + 1) if MOVING < before[p - 1] < 1.0 - MOVING]
    steps = [np.where(np.arange(count) < place, 0.0, 1.0) for place in places]
    shapes = np.stack([np.linspace(-0.5, 0.5, count), *steps])
    squares, gains = _fitted(blocks.products, blocks.powers, shapes)
    best = int(np.argmin(squares))
    place = count // 2 if best == 0 else places[best - 1]
    return _Fit(blocks, shapes[best], float(squares[best]), gains[best], place, best == 0)


def _side_by_side(parts: Sequence[np.ndarray]) -> Iterator[list[int]]:
    """Numbers of parts of one size, of at most AT_ONCE samples together."""
    for size in sorted({part.size for part in parts}):
        which, width = [i for i, part in enumerate(parts) if part.size == size], max(1, AT_ONCE // size)
        yield from (which[i : i + width] for i in range(0, len(which), width))


def _hum(residual: FloatArray, places: np.ndarray, rate: float) -> FloatArray:
    """Mains frequencies and their harmonics that are significant in a residual; beside a tone they beat with it."""
    sums, power = np.zeros((len(MAINS_HZ), HARMONICS), complex), 0.0
    for begin in range(0, places.size, AT_ONCE):
        part = places[begin : begin + AT_ONCE]
        own, first, last = residual[part], int(part[0]), int(part[-1])
        power += float(own @ own)
        for row, mains in enumerate(MAINS_HZ):
            angle = -2.0 * np.pi * mains / rate
            turn = turning(last - first + 1, angle, angle * first)
            turn = turn if turn.size == part.size else turn[part - first]
            wave = own.astype(complex)
            for order in range(HARMONICS):
                wave *= turn
                sums[row, order] += wave.sum()
    found = np.outer(MAINS_HZ, np.arange(1, HARMONICS + 1))[np.abs(sums) ** 2 > HEARD * power]
    return np.unique(found[found < 0.5 * rate]).astype(float)


def _fitted(products: FloatArray, powers: FloatArray, shapes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Squares left by θ = α + β shape, less a constant, shape (m,), and (α, β), shape (m, 4), for m shapes."""
    whole = np.broadcast_to(products.sum(axis=0), (len(shapes), 2))
    product = np.concatenate([whole, shapes @ products], axis=1)
    gains = np.einsum("mij,mj->mi", np.linalg.pinv(_normal(powers, shapes), hermitian=True), product)
    return -np.sum(product * gains, axis=1), gains


def _normal(powers: FloatArray, shapes: FloatArray) -> FloatArray:
    """Normal matrix of (α, β) for each shape, shape (…, 4, 4)."""
    one, two, three = (np.einsum("...b,bij->...ij", shapes**k, powers) for k in range(3))
    rows = np.concatenate([one, two], axis=-1), np.concatenate([two, three], axis=-1)
    return np.concatenate(rows, axis=-2)


def _beyond_doubt(
    products: FloatArray, powers: FloatArray, shape: FloatArray, fit: tuple[float, FloatArray], chance: float
) -> bool:
    """Whether a change of this shape is beyond chance: by the scatter of the blocks, by each side's own, by its order.

    Noise that grows makes some blocks scatter more (the covariance of White 1980), and a hum beside a tone makes
    neighbours alike, which leaves fewer that are independent.
    """
    blocks = shape.size
    thetas = fit[1][:2] + shape[:, None] * fit[1][2:]
    left = products - np.einsum("bij,bj->bi", powers, thetas)
    inverse = np.linalg.pinv(powers, hermitian=True)
    each = np.linalg.pinv(powers.sum(axis=0), hermitian=True) @ products.sum(axis=0)
    constant = -float(products.sum(axis=0) @ each)
    rest = float(np.einsum("bi,bij,bj->", left, inverse, left))
    if rest <= 0.0:
        return constant > fit[0]
    freedom = 2.0 * (blocks - 2.0)
    independent = max(freedom / _fewer(left, powers), 1.0)
    statistic = (constant - fit[0]) / 2.0 / (rest / freedom) * (independent / freedom)
    if f_tail(2.0, independent, statistic) >= chance:
        return False
    scores = np.concatenate([left, shape[:, None] * left], axis=1)
    bread = np.linalg.pinv(_normal(powers, shape), hermitian=True)
    robust = (bread @ (scores.T @ scores) @ bread * blocks / (blocks - 2.0))[2:, 2:]
    wald = float(fit[1][2:] @ np.linalg.pinv(robust, hermitian=True) @ fit[1][2:]) / 2.0
    fewer = min(np.sum(shape > 0.0), np.sum(shape <= 0.0))
    return bool(f_tail(2.0, 2.0 * (fewer - 1.0), wald) < ROBUST)


def _fewer(left: FloatArray, powers: FloatArray) -> float:
    """Number of blocks that hold the information of one independent block (Newey & West 1987), at least one.

    Noise beside a tone, or through a sharp resonance, is alike from block to block.
    """
    size = np.sqrt(np.maximum(np.einsum("bii->bi", powers), np.finfo(float).tiny))
    scores = left / size
    total = max(float(np.sum(scores**2)), np.finfo(float).tiny)
    found = 1.0
    for lag in range(1, LAGS + 1):
        alike = float(np.sum(scores[lag:] * scores[:-lag])) / total + 1.0 / len(
            left
        )  # a fit leaves small differences between them
        found += 2.0 * (1.0 - lag / (LAGS + 1.0)) * alike
    return float(np.clip(found, 1.0, 50.0))


def findings(within: Sequence[Change], odd: OddRecord | None) -> list[Finding]:
    """The messages on changes within records, the largest first, and on a record of another sensor."""
    found = []
    for change in sorted(within, key=lambda one: -abs(one.gain))[:MOST_NAMED]:
        later = "later" if change.later_s > 0.0 else "earlier"
        at = f"changed at about {change.time_s:.4g} s: after it"
        text = (
            f"{change.record}: the sensor {'changes over the record: at its end' if change.slow else at} the response "
            f"is {abs(100.0 * change.gain):.2g} % {'larger' if change.gain > 0.0 else 'smaller'} than before and comes "
            f"{abs(change.later_s):.2g} s {later}. The parameters are of neither part, and their uncertainties do not "
            "cover the change: identify parts by themselves (start_s, stop_s)."
        )
        found.append(Finding("regimes", text))
    if len(within) > MOST_NAMED:
        found.append(Finding("regimes", f"The sensor changed within {len(within) - MOST_NAMED} more records."))
    if odd is not None:
        text = (
            f"{odd.record} does not belong to the other records: its response is {100.0 * odd.gain:.2g} % off what "
            f"they predict, and without it the model explains the data (χ²/dof {odd.without:.3g} in place of "
            f"{odd.chi2_reduced:.3g}). Was it taken with another sensor, range or wiring? Leave it out."
        )
        found.append(Finding("regimes", text))
    return found
