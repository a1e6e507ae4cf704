"""Test for a change of the sensor within a record.

The residual of a record is compared, block by block, with what changes would add to the prediction: θ = (gain, time
shift, natural frequency, damping ratio) of the block. Without a change the θ of all blocks agree but for noise, whose
own scatter from block to block is the measure, so that its colour does not matter: the F test of one step among the
blocks, its place sought (Chow 1960; Andrews 1993), or of an even change over all of them.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy import fft

from vibrident.base.amounts import amount, plain
from vibrident.base.fft_lengths import fast_length
from vibrident.base.tails import chi2_tail
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.fit.measure.alignment import prediction_error
from vibrident.fit.measure.blocks import Blocks, Fit, best, least_left, sums_of
from vibrident.fit.measure.lines import (
    MOST_KEPT,
    about_mean,
    in_blocks,
    line_frequencies,
    median_level,
    power_of,
    transforms,
)
from vibrident.fit.measure.nonlinearity import heard_motion
from vibrident.fit.measure.odd_records import OddRecord
from vibrident.fit.measure.quality import STEADY, Finding
from vibrident.fit.measure.response import LEAST_DEVIATION, ComplexArray
from vibrident.fit.measure.rounding import converter_step, step_of_response

#: Largest change of a natural frequency, relative to it, that its slope describes.
FARTHEST = 1.0
#: A delayed motion differs from the motion by (e^{−jφ} − 1): at most twice its size against it, and
#: once its size across it. What a step adds beyond these is no change of the channel.
MOST_AGAINST = 2.1
MOST_ACROSS = 1.1
#: Probability of a finding in a calibration without a change.
CHANCE = 1e-4
#: Probability that all records together show one, by chances that are known to a few times …
TOGETHER = 1e-6
#: … of which none counts as less than this.
LEAST_CHANCE = 1e-12
#: Where they do, those are named that show one with a chance below this.
NAMED = 1e-2
#: Largest number of blocks of a record.
MOST_BLOCKS = 32
#: Smallest number of blocks of a record.
FEWEST_BLOCKS = 8
#: Fewest samples of a block.
FEWEST_SAMPLES = 24
#: Noise of so many steps of a converter hides them …
COARSE = 2.0
#: … and below it less than so many steps are no change.
STEPS = 3.0
#: Noise of the reference stands at each line in prediction and residual alike: so many times the latter is none of it.
OWN = 2.0
#: Lines averaged on either side for the residual's spectrum.
SMOOTHED = 4
#: Lower limit of this spectrum, relative to its mean.
LEAST_LEVEL = 1e-9
#: A change is nearly all of the residual where this part of its power is left.
REST = 0.15
#: What rings at the record's end does not return at its beginning within so many samples.
LONGEST_RINGING = 1 << 16
KERNEL = np.full(2 * SMOOTHED + 1, 1.0 / (2 * SMOOTHED + 1))
#: Largest number of changes that are listed one by one.
MOST_NAMED = 3

SensorSlopes = Callable[[FloatArray], ComplexArray]
_AtLines = Callable[[int, float, slice], ComplexArray]


@dataclass(frozen=True)
class Change:
    """A change within a record, of the channel or of the sensor.

    Attributes:
        record: its name.
        time_s: when, from the record's first sample, to about a block.
        gain: relative change of the response's size.
        later_s: by how much the response comes later than before.
        natural_frequency: its relative change.
        damping_ratio: its change.
        slow: it changed evenly over the record, by so much from its beginning to its end.
        steady: the motion is stationary.
        chance: how often noise alone would show as much in a record.
    """

    record: str
    time_s: float
    gain: float = 0.0
    later_s: float = 0.0
    natural_frequency: float = 0.0
    damping_ratio: float = 0.0
    slow: bool = False
    steady: bool = True
    chance: float = 0.0


def changes(
    records: Sequence[Record],
    predicted: Sequence[FloatArray],
    frequency_hz: Sequence[float | None],
    sensor: SensorSlopes | None = None,
) -> list[Change]:
    """Significant changes within records.

    Args:
        records: the records.
        predicted: response that a model predicts for each, shape (samples,), NaN where it is not defined.
        frequency_hz: of a sine; None for other motion.
        sensor: (∂ ln H/∂ ln f_n, ∂ ln H/∂δ) at frequencies in Hz, shape (2, lines); None: only the channel is tested.
    """
    at_lines = None if sensor is None else _on_grids(sensor)
    tested = [i for i, record in enumerate(records) if record.excitation != "decay" and record.reference is not None]
    made = [_change(records[i], predicted[i], frequency_hz[i], at_lines) for i in tested]
    found = [one for one in made if one is not None]
    # Each alone; of stationary motion, whose records are independent, also all together (Fisher 1925).
    steady = [one for one in found if one.steady]
    together = chi2_tail(2.0 * len(steady), -2.0 * sum(np.log(max(one.chance, LEAST_CHANCE)) for one in steady))
    alone, together = CHANCE / max(len(tested), 1), NAMED if steady and together < TOGETHER else 0.0
    return [one for one in found if one.chance < (max(alone, together) if one.steady else alone)]


def _on_grids(sensor: SensorSlopes) -> _AtLines:
    """The slopes at some lines of so many samples of a rate; short records alike share them."""

    @functools.lru_cache(maxsize=2)
    def kept(samples: int, rate_hz: float) -> ComplexArray:
        return sensor(line_frequencies(samples, rate_hz))

    def at(samples: int, rate_hz: float, part: slice) -> ComplexArray:
        if samples > 2 * MOST_KEPT:
            return sensor(line_frequencies(samples, rate_hz, part))
        return kept(samples, rate_hz)[:, part]

    return at


def _change(record: Record, series: FloatArray, frequency: float | None, sensor: _AtLines | None) -> Change | None:
    """The change that the residual of a record shows most, however small; None without one that could be told."""
    used, rate = record.mask & np.isfinite(series), record.sampling_rate_hz
    count = min(MOST_BLOCKS, int(used.sum()) // FEWEST_SAMPLES)
    if frequency is not None:
        count = min(count, int(used.sum() * frequency / rate))  # a period each
    if count < FEWEST_BLOCKS or np.ptp(series[used]) == 0.0:
        return None
    residual = about_mean(record.response - series, used)
    if record.excitation in ("random", "shock"):
        series, residual, used = _without_memory(series, residual, used)
    least = _least(record, series[used], residual[used])
    lines = np.asarray(fft.rfft(residual), dtype=complex)
    power = power_of(lines)
    # Noise of the reference is in prediction and residual alike: lines that hold nothing else are no motion.
    level = median_level(power)
    motion = heard_motion(series, used, np.maximum(level, OWN * power))
    del series  # of a long record each copy counts
    if not np.any(motion):
        return None
    parts = np.array_split(np.flatnonzero(used), count)
    steady = record.excitation in STEADY
    columns = _columns(motion, rate, sensor if frequency is None else None)
    del motion
    steep = float(np.std(columns[1]) / np.std(columns[0]))
    sums = sums_of(columns, residual, parts)
    # Noise through a sharp resonance is alike over many blocks, which would look like a change: both are filtered so
    # that the noise is white. A change that is nearly all of the residual is not taken for noise.
    if least_left(sums, parts) < REST * float(residual @ residual):
        noise = _power_of_noise(columns, residual, parts, rate)
        power, level = (power, level) if noise is None else (noise, median_level(noise))
    del residual
    # Beside a tone a change appears in a few lines, which do not give the noise.
    white = _whitening(power if record.excitation == "random" else level, float(np.mean(power)))
    del power, level
    together = len(columns) if used.size <= MOST_KEPT else 1  # of a long record each copy counts
    for begin in range(0, len(columns), together):
        some = columns[begin : begin + together]
        some[:] = fft.irfft(white * transforms(some), used.size)
    lines *= white
    del white
    # The filter meets the record's cut ends as steps: half a block is left out there.
    inner = [parts[0][parts[0].size // 2 :], *parts[1:-1], parts[-1][: (parts[-1].size + 1) // 2]]
    found = best(Blocks.of(columns, np.asarray(fft.irfft(lines, used.size)), inner, rate))
    del lines, columns
    change = found.step / found.blocks.scale[found.pair]
    if found.size_beside(sums[:, :-1, :-1]) < least:
        return None
    time_s = float(parts[found.place][0]) / rate
    if not steady and (found.slow or not found.explains):
        return None  # under other motion a misfit over frequency looks like one over time
    if not _of_a_channel(found, steep):
        return None
    first, second = change.tolist()
    if found.pair.start and abs(first) > FARTHEST:
        return None  # no natural frequency changes so: one far beyond the band, in noise of the reference
    amounts = (0.0, 0.0, first, second) if found.pair.start else (first, -second, 0.0, 0.0)
    return Change(record.name, time_s, *amounts, found.slow, steady, found.chance())


def _of_a_channel(found: Fit, steep: float) -> bool:
    """Whether any gain and delay of the channel add what was found: initial states that follow a misfit add more.

    ``steep``: deviation of the motion's slope over that of the motion.
    """
    amounts = (found.amounts / found.blocks.scale)[found.blocks.moving, :2]
    across = np.abs(amounts[:, 1]) * steep
    return bool(np.min(amounts[:, 0]) > -MOST_AGAINST and np.max(across) < MOST_ACROSS)


def _power_of_noise(
    columns: FloatArray, residual: FloatArray, parts: Sequence[np.ndarray], rate: float
) -> FloatArray | None:
    """Power, at its lines, of what a change leaves of the residual; None where the change is not nearly all of it."""
    left = residual - best(Blocks.of(columns, residual, parts, rate)).signal(columns, parts)
    if float(left @ left) >= REST * float(residual @ residual):
        return None
    return power_of(np.asarray(fft.rfft(left)))


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


def _least(record: Record, series: FloatArray, residual: FloatArray) -> float:
    """Largest deviation that interpolation may make, or the converters' steps where noise is no larger."""
    assert record.reference is not None
    size, motion = float(np.std(series)), float(np.std(record.reference[record.reference_mask]))
    of_reference = converter_step(record.reference, record.reference_mask) * size / max(motion, np.finfo(float).tiny)
    step = max(step_of_response(record), of_reference)
    if float(np.std(residual)) < COARSE * step and record.excitation != "random":
        # What rounding leaves of a swing that dies away follows the swing.
        return STEPS * step if record.excitation in STEADY else np.inf
    return LEAST_DEVIATION * size


def _columns(motion: FloatArray, rate: float, sensor: _AtLines | None) -> FloatArray:
    """What small changes of gain and time, and of the sensor, add to a motion, shape (2 or 4, samples)."""
    columns = np.empty((2 if sensor is None else 4, motion.size))
    columns[0], columns[1] = motion, np.gradient(motion, 1.0 / rate)
    if sensor is None:
        return columns
    wide = fast_length(motion.size + min(motion.size, LONGEST_RINGING))
    lines = np.asarray(fft.rfft(motion, wide), dtype=complex)
    together = 2 if motion.size <= MOST_KEPT else 1  # of a long record each copy counts
    for begin in range(0, 2, together):
        through = np.empty((together, lines.size), dtype=complex)
        for part in in_blocks(lines.size):
            slopes = sensor(wide, rate, part)[begin : begin + together]
            np.multiply(slopes, lines[part], out=through[:, part])
        columns[2 + begin : 2 + begin + together] = fft.irfft(through, wide)[:, : motion.size]
    return columns


def _whitening(level: FloatArray, mean: float) -> FloatArray:
    """Gain at each line that makes noise of this level white, shape (lines,); ``mean`` power of all lines."""
    logarithm = np.log(level + (np.finfo(float).tiny + LEAST_LEVEL * mean))
    logarithm = np.convolve(np.pad(logarithm, SMOOTHED, mode="edge"), KERNEL, mode="valid")
    return np.exp(0.5 * (np.mean(logarithm) - logarithm))


def findings(within: Sequence[Change], odd: OddRecord | None) -> list[Finding]:
    """The messages on changes within records, the largest first, and on a record of another sensor."""
    found = []
    for change in sorted(within, key=lambda one: -max(abs(one.gain), abs(one.natural_frequency)))[:MOST_NAMED]:
        at = "over the record: at its end" if change.slow else f"at about {change.time_s:.4g} s: after it"
        text = (
            f"{change.record}: the sensor {'changes' if change.slow else 'changed'} {at} {_words(change)}. The "
            "parameters are of neither part, and their uncertainties do not cover the change: identify parts by "
            "themselves (start_s, stop_s)."
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


def _words(change: Change) -> str:
    if change.natural_frequency or change.damping_ratio:
        return (
            f"the natural frequency is about {100.0 * change.natural_frequency:+.2g} %, and the damping ratio "
            f"{change.damping_ratio:+.2g}, off what it was"
        )
    later = "later" if change.later_s > 0.0 else "earlier"
    larger = "larger" if change.gain > 0.0 else "smaller"
    return (
        f"the response is {plain(abs(100.0 * change.gain), 2)} % {larger} than before and comes "
        f"{amount(abs(change.later_s), 's', 2)} {later}"
    )
