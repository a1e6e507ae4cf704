"""Did the sensor change within a record, or between records?

What a fit leaves of a record is compared, block by block, with the prediction and its slope: θ = (gain, time shift) of
the block. Without a change the θ of all blocks agree but for noise, whose own scatter from block to block is the
measure, so that its colour does not matter: the F test of one step among the blocks, its place sought (Chow 1960;
Andrews 1993), or of an even change over all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from vibrident.measure.quality import STEADY, Finding
from vibrident.measure.verdict import rejected
from vibrident.records import FloatArray, Record

#: Chance of a finding in a calibration without a change; a step may be at about so many places that are independent.
CHANCE, PLACES = 1e-4, 8.0
#: Chance by the robust test, which has fewer degrees of freedom.
ROBUST = 1e-4
#: Blocks, fewest samples in one, and blocks on either side of a step.
MOST_BLOCKS, FEWEST_BLOCKS, FEWEST_SAMPLES, BESIDE = 32, 8, 24, 2
#: Part of the motion that must lie on either side of a step: a sensor at rest has no gain.
MOVING = 0.02
#: Mains, and the power over that of white noise at which it is heard.
MAINS_HZ, HEARD = (50.0, 60.0), 12.0
#: A single record is another sensor's where it holds at least this part of what χ² exceeds its degrees of freedom by.
ODD = 0.9
#: Fewest records among which one may be odd.
FEWEST_RECORDS = 4
#: Changes that are told one by one.
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
    """Changes within records, beyond doubt.

    Args:
        records: the records.
        predicted: response that a model predicts for each, shape (samples,), NaN where there is none.
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
    slope = np.gradient(series) * record.sampling_rate_hz
    used = np.flatnonzero(record.mask & np.isfinite(slope))
    blocks = min(MOST_BLOCKS, used.size // FEWEST_SAMPLES)
    if frequency is not None:
        blocks = min(blocks, int(used.size * frequency / record.sampling_rate_hz))  # a period each
    if blocks < FEWEST_BLOCKS or np.ptp(series[used]) == 0.0:
        return None
    scale = float(np.std(series[used])), float(np.std(slope[used]))
    products, powers, starts = np.zeros((blocks, 2)), np.zeros((blocks, 2, 2)), np.zeros(blocks, dtype=int)
    hum = _hum(record.response[used] - series[used], used / record.sampling_rate_hz)
    for index, part in enumerate(np.array_split(used, blocks)):
        angle = 2.0 * np.pi / record.sampling_rate_hz * np.outer(part, hum)
        trend = np.stack([np.ones(part.size), np.linspace(-1.0, 1.0, part.size)], axis=1)
        basis, _ = np.linalg.qr(np.concatenate([trend, np.cos(angle), np.sin(angle)], axis=1))
        columns = np.stack([series[part] / scale[0], slope[part] / scale[1], record.response[part] - series[part]])
        columns = columns - (columns @ basis) @ basis.T  # offset, drift and hum are no change
        products[index], powers[index] = columns[:2] @ columns[2], columns[:2] @ columns[:2].T
        starts[index] = part[0]
    slow = np.linspace(-0.5, 0.5, blocks)  # a slow change, then a step before each block
    before = np.cumsum(powers[:, 0, 0]) / np.sum(powers[:, 0, 0])
    places = [p for p in range(BESIDE, blocks - BESIDE + 1) if MOVING < before[p - 1] < 1.0 - MOVING]
    steps = [np.where(np.arange(blocks) < place, 0.0, 1.0) for place in places]
    shapes = np.stack([slow, *steps])
    squares, gains = _fitted(products, powers, shapes)
    best = int(np.argmin(squares))
    if not _beyond_doubt(products, powers, shapes[best], (float(squares[best]), gains[best]), chance):
        return None
    step = gains[best, 2:]
    place = blocks // 2 if best == 0 else places[best - 1]
    time_s = float(starts[place]) / record.sampling_rate_hz
    return Change(record.name, time_s, float(step[0] / scale[0]), float(-step[1] / scale[1]), slow=best == 0)


def _hum(residual: FloatArray, times_s: FloatArray) -> FloatArray:
    """Mains frequencies and their harmonics that stand out of a residual; beside a tone they beat with it."""
    rate = 1.0 / float(np.median(np.diff(times_s)))
    heard, least = set(), HEARD * float(residual @ residual)
    for mains in MAINS_HZ:
        turn = np.exp(-2j * np.pi * mains * times_s)
        wave = residual.astype(complex)
        for order in range(1, 6):
            wave *= turn
            if order * mains < 0.5 * rate and abs(wave.sum()) ** 2 > least:
                heard.add(order * mains)
    return np.array(sorted(heard), dtype=float)


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
    alike = float(np.einsum("bi,bij,bj->", left[1:], inverse[1:], left[:-1])) / rest
    alike = float(np.clip(alike + 1.0 / blocks, 0.0, 0.98))  # a fit leaves neighbours a little unlike
    freedom = 2.0 * (blocks - 2.0)
    independent = max(freedom * (1.0 - alike) / (1.0 + alike), 1.0)
    statistic = (constant - fit[0]) / 2.0 / (rest / freedom) * (independent / freedom)
    if fdtrc(2.0, independent, statistic) >= chance:
        return False
    scores = np.concatenate([left, shape[:, None] * left], axis=1)
    bread = np.linalg.pinv(_normal(powers, shape), hermitian=True)
    robust = (bread @ (scores.T @ scores) @ bread * blocks / (blocks - 2.0))[2:, 2:]
    wald = float(fit[1][2:] @ np.linalg.pinv(robust, hermitian=True) @ fit[1][2:]) / 2.0
    fewer = min(np.sum(shape > 0.0), np.sum(shape <= 0.0))
    return bool(fdtrc(2.0, 2.0 * (fewer - 1.0), wald) < ROBUST)


@dataclass(frozen=True)
class OddRecord:
    """A record that does not belong to the others.

    Attributes:
        record: its name.
        chi2_reduced: of all records; without this one.
        without: χ² over degrees of freedom of the others alone.
        gain: relative deviation of its response from what the others foretell, rms over its points.
    """

    record: str
    chi2_reduced: float
    without: float
    gain: float


def odd_record(
    matrix: FloatArray, rest: FloatArray, record: Sequence[str], relative_deviation: FloatArray
) -> OddRecord | None:
    """The one record without which the model explains the data that it does not explain with it.

    Args:
        matrix: slopes of the weighted deviations, real parts then imaginary parts of n points, shape (2 n, p).
        rest: weighted deviations, shape (2 n,).
        record: name of the record of each point, n of them.
        relative_deviation: of each point's real part, shape (n,).
    """
    names = list(dict.fromkeys(record))
    owner = np.tile([names.index(name) for name in record], 2)
    degrees = rest.size - matrix.shape[1]
    whole = _left(matrix, rest)
    if len(names) < FEWEST_RECORDS or degrees <= 0 or not rejected(whole, degrees):
        return None
    lefts = [_left(matrix[owner != k], rest[owner != k]) for k in range(len(names))]
    odd = int(np.argmin(lefts))
    others = owner != odd
    freedom = int(np.sum(others)) - matrix.shape[1]
    if freedom < len(names) // 2 or rejected(lefts[odd], freedom) or whole - lefts[odd] < ODD * (whole - degrees):
        return None
    if any(
        k != odd and not rejected(left, rest.size - int(np.sum(owner == k)) - matrix.shape[1])
        for k, left in enumerate(lefts)
    ):
        return None  # which one, nothing tells
    amounts, *_ = np.linalg.lstsq(matrix[others], rest[others], rcond=1e-12)
    off = (rest - matrix @ amounts) * np.tile(relative_deviation, 2)
    size = float(np.sqrt(2.0 * np.mean(off[~others] ** 2)))
    return OddRecord(names[odd], whole / degrees, lefts[odd] / freedom, size)


def _left(matrix: FloatArray, rest: FloatArray) -> float:
    basis, _ = np.linalg.qr(matrix)
    left = rest - basis @ (basis.T @ rest)
    return float(left @ left)


def findings(within: Sequence[Change], odd: OddRecord | None) -> list[Finding]:
    """What a person is told of changes within records, the largest first, and of a record of another sensor."""
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
            f"they foretell, and without it the model explains the data (χ²/dof {odd.without:.3g} in place of "
            f"{odd.chi2_reduced:.3g}). Was it taken with another sensor, range or wiring? Leave it out."
        )
        found.append(Finding("regimes", text))
    return found
