"""Is the sensor nonlinear? A score test of the residual against what nonlinear sensors add, for any motion.

To first order a bent characteristic adds its shape of the linear response v to the record: v² (square), v³ (compression
where negative), the sign of v (a dead band), or the same behind the spring (v³ through the sensor once more). What of a
shape is coherent with the motion, the linear parameters take (Bussgang 1952): in every narrow band any complex factor
with a slope over frequency is therefore taken out of residual and shape alike. What is left of the shape is looked for
in what is left of the residual, line by line in the noise found around it:

    a = Σ W* E/S / Σ |W|²/S,    T = |Σ W* E/S|² / Σ |W|²/S.

For noise alone T is distributed as an exponential of mean one, whatever the delay of the shape. Noise of the response
is in the residual, noise of the reference also in the prediction, with opposite signs; each would draw a shape that is
made of the noisy signal. So the shape is made of both, prediction and measured response, and the lesser counts.

Score tests: Rao 1948; Volterra's kernels: Schetzen 1980.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_below
from vibrident.data.records import FloatArray, Record
from vibrident.data.records.basis import distinct
from vibrident.fit.measure.bands import band_edges
from vibrident.fit.measure.lines import about_mean, hann, line_frequencies, median_level, power_of, transforms
from vibrident.fit.measure.overtones import OWN
from vibrident.fit.measure.response import LEAST_DEVIATION, ComplexArray
from vibrident.fit.measure.rounding import step_in_response

#: Longer records are looked at in parts, of which each holds so many periods of a tone.
LONGEST, MANY_PERIODS = 1 << 16, 50.0
#: T that noise alone exceeds less often than once in 10⁵ times, for a shape and a record; the noise of a line is read
#: from a few tens of others, so it is more than ln 10⁵ = 11.5.
CERTAIN = 20.0
#: The same for a spring's rest point beside its middle, which is one question to a fit with a bent spring.
CERTAIN_OF_REST = 14.0
MEAN_LINES = 4  # lines on either side of one that tell its noise
#: What is left of a shape in a band must be this part of it, or the parameters can imitate it.
LEFT = 1e-4
#: Lines of the residual with this ratio to those around, at one frequency in several records, are not harmonics.
STANDS_OUT = 15.0
#: A line this near to a harmonic, in lines, is the harmonic; a residual with more lines that stand out has no hum.
NEAR, MOST_LOUD = 4.0, 60
#: A kind is named in place of one before it where it stands out so many times as far.
PREFERRED = 1.1
#: A line of the motion counts beyond so many times the noise power there.
HEARD = 2.0
#: Fewest samples of a record, and periods of a sine.
SHORTEST, FEWEST_PERIODS = 256, 6.0
#: A distortion below so many steps of a digitiser is its own, but of random motion, whose rounding is noise.
STEPS = 2.0
TINY = float(np.finfo(float).tiny)
#: The first lines of a transform hold drift and what a record's ends leave.
LOWEST = 8

SQUARE, CUBE, DEAD, SPRING, LEANING = "square", "cube", "dead band", "spring", "leaning spring"
BEHIND = {SPRING: CUBE, LEANING: SQUARE}


@dataclass(frozen=True)
class Distortion:
    """A nonlinearity found.

    Attributes:
        kind: ``square``, ``cube``, ``dead band``, ``spring`` or ``leaning spring``.
        record: name of the record that tells its size most.
        peak: what it adds at the largest response, over that response; negative: the response is compressed; without
            sign for springs.
        gain: what it adds to a linear gain fitted to that record, relative.
        sigma: its size in standard deviations.
    """

    kind: str
    record: str
    peak: float
    gain: float
    sigma: float

    def sentence(self, gain: str) -> str:
        """The finding for a person; ``gain`` is the gain's name."""
        bent = "compresses" if self.peak < 0 else "expands"
        seen = {
            SQUARE: "The response holds a square of the motion: one direction answers stronger than the other",
            CUBE: f"The response {bent} with the size of the motion",
            DEAD: "The response has a dead band, or a step, around its zero",
            SPRING: "The response is bent as by a spring that is not linear",
            LEANING: "The response is bent as by a spring that is stiffer on one side of its rest point",
        }[self.kind]
        return (
            f"{seen}, {100 * abs(self.peak):.2g} % at the peak of {self.record} (about {100 * abs(self.gain):.2g} % in "
            f"the {gain}); it stands out of the residual by {self.sigma:.1f} standard deviations."
        )


@dataclass(frozen=True, eq=False)
class _Series:
    """One record, prediction and residual.

    Attributes:
        record: as measured.
        used: samples that count.
        motion: linear response by the prediction, about the mean, zero elsewhere.
        error: lines of the residual, shape (samples // 2 + 1,).
        level: noise power at each line by the median of the lines around, shape (samples // 2 + 1,).
        quiet: lines that count, shape (samples // 2 + 1,).
    """

    record: Record
    used: np.ndarray
    motion: FloatArray
    error: ComplexArray
    level: FloatArray
    quiet: np.ndarray

    @property
    def measured(self) -> FloatArray:
        """The same as measured."""
        return heard_motion(self.record.response, self.used, self.level)


def distortion(
    records: Sequence[Record],
    predicted: Sequence[FloatArray],
    tones_hz: Sequence[float | None],
    over_gain: Callable[[FloatArray], ComplexArray] | None = None,
    springs: Sequence[str] = (SPRING,),
) -> Distortion | None:
    """The strongest significant nonlinearity; None if none is significant.

    Args:
        records: with a reference.
        predicted: response of each by the linear model, NaN where there is none.
        tones_hz: frequency of each record's sine; None for other motion.
        over_gain: function from frequencies (Hz) to the sensor's response over its gain, where it has a spring.
        springs: kinds that are looked for where there is one.
    """
    series = _series(*_in_parts(records, predicted, tones_hz))
    kinds = (CUBE, SQUARE, DEAD) if over_gain is None else (CUBE, SQUARE, DEAD, *springs)
    several = CERTAIN + float(np.log(max(len(series), 1) * len(kinds)))
    through = None if over_gain is None else _on_grids(over_gain)
    predictions = [_sums(one, one.motion, kinds, through) for one in series]
    measured = functools.cache(lambda place: _sums(series[place], series[place].measured, kinds, through))
    best: Distortion | None = None
    for kind in kinds:
        # A harmonic of one sine does not distinguish a spring from another nonlinearity: that needs several.
        alone = [[place] for place in range(len(series))] if kind not in BEHIND and len(series) > 1 else []
        for places in [list(range(len(series))), *alone]:
            by_prediction = [predictions[place][kind] for place in places]
            if _strength(by_prediction) < (certain := CERTAIN_OF_REST if kind == LEANING else several):
                continue  # the measured response need not be asked
            own = [series[place] for place in places]
            found = _judged(kind, own, (by_prediction, [measured(place)[kind] for place in places]), certain)
            if found is not None and (best is None or found.sigma > PREFERRED * best.sigma):
                best = found
    return best


@dataclass(frozen=True)
class _Sum:
    """Σ W* E/S, Σ |W|²/S and W's amplitude for one shape of one record's motion."""

    product: complex
    power: float
    left: float


def _strength(sums: Sequence[_Sum]) -> float:
    """T of these records together; zero where the shape is nowhere."""
    power = sum(s.power for s in sums)
    return abs(sum(s.product for s in sums)) ** 2 / power if power > 0.0 else 0.0


def _on_grids(over_gain: Callable[[FloatArray], ComplexArray]) -> Callable[[Record], ComplexArray]:
    """The response over the gain at the lines of a record; records alike share it."""

    @functools.lru_cache(maxsize=2)
    def at(samples: int, rate_hz: float) -> ComplexArray:
        return np.asarray(over_gain(line_frequencies(samples, rate_hz)))

    return lambda record: at(record.samples, record.sampling_rate_hz)


def _series(
    records: Sequence[Record], predicted: Sequence[FloatArray], tones_hz: Sequence[float | None]
) -> list[_Series]:
    found: list[_Series] = []
    tones: list[float | None] = []
    loud: list[FloatArray] = []
    several = len(records) > 1 and any(tone is not None for tone in tones_hz)
    for record, series, tone in zip(records, predicted, tones_hz, strict=True):
        used = record.mask & np.isfinite(series)
        few = tone is not None and tone * used.sum() < FEWEST_PERIODS * record.sampling_rate_hz
        if used.sum() < SHORTEST or few or record.reference is None:
            continue
        residual = about_mean(record.response - series, used)
        quiet = np.ones(record.samples // 2 + 1, dtype=bool)
        quiet[:LOWEST] = False
        error = np.asarray(fft.rfft(residual), dtype=complex)
        level = median_level(power_of(error))
        if record.optical is not None:
            quiet &= _answered(record.response, residual, used)
        motion = heard_motion(series, used, level)
        if np.any(motion):
            found.append(_Series(record, used, motion, error, level, quiet))
            tones.append(tone)
            loud.append(_loud(record, residual, tone) if several else np.zeros(0))
    for index, (one, tone) in enumerate(zip(found, tones, strict=True)):
        if tone is not None:
            _leave_out(one, np.concatenate([np.zeros(0), *(hz for j, hz in enumerate(loud) if j != index)]))
    return found


def heard_motion(response: FloatArray, used: np.ndarray, level: FloatArray) -> FloatArray:
    """A response about its mean, without the lines that are noise: a cube would mix these with all others.

    By its own lines alone, so that noise of one response stays out of the other.

    Args:
        response: predicted or measured, shape (samples,).
        used: samples that count, shape (samples,).
        level: noise power at each line, shape (samples // 2 + 1,).
    """
    lines = np.asarray(fft.rfft(about_mean(response, used)), dtype=complex)
    power, noise = power_of(lines), HEARD * level
    kept = np.zeros_like(power)
    np.subtract(power, noise, out=kept, where=power > noise)
    np.divide(kept, power, out=kept, where=kept > 0.0)
    lines *= kept
    del power, noise, kept  # of a long record each copy counts
    heard = np.asarray(fft.irfft(lines, used.size))
    heard[~used] = 0.0
    return heard


def _loud(record: Record, residual: FloatArray, tone: float | None) -> FloatArray:
    """Frequencies of significant lines of a residual that are not harmonics of the record's own tone, such as hum."""
    lines = line_frequencies(record.samples, record.sampling_rate_hz)
    power = power_of(np.asarray(fft.rfft(residual * hann(residual.size))))
    loud = lines[power > STANDS_OUT * median_level(power)]
    if tone is not None:
        loud = loud[np.abs(loud - np.maximum(np.round(loud / tone), 1.0) * tone) > NEAR * lines[1]]
    return loud if loud.size <= MOST_LOUD else np.zeros(0)


def _answered(response: FloatArray, residual: FloatArray, used: np.ndarray) -> np.ndarray:
    """Lines of a residual that are in the response, shape (lines,): an interferometer's errors are not."""
    window = hann(residual.size)
    whole, rest = (power_of(np.asarray(fft.rfft(v * window))) for v in (about_mean(response, used), residual))
    return whole >= OWN**2 * rest


def _leave_out(one: _Series, frequencies_hz: FloatArray) -> None:
    """Leave out the lines next to these frequencies."""
    step = one.record.sampling_rate_hz / one.record.samples
    places = distinct(np.round(frequencies_hz / step).astype(int))
    for offset in range(-2, 3):
        beside = places + offset
        one.quiet[beside[(beside >= 0) & (beside < one.quiet.size)]] = False


def _in_parts(
    records: Sequence[Record], predicted: Sequence[FloatArray], tones_hz: Sequence[float | None]
) -> tuple[list[Record], list[FloatArray], list[float | None]]:
    """Long records in parts of at most LONGEST samples, which say as much together for less memory."""
    parts: tuple[list[Record], list[FloatArray], list[float | None]] = ([], [], [])
    for record, response, tone in zip(records, predicted, tones_hz, strict=True):
        count = -(-record.samples // LONGEST)
        if tone is not None:
            count = min(count, max(int(record.samples * tone / record.sampling_rate_hz / MANY_PERIODS), 1))
        edges = np.linspace(0, record.samples, count + 1).astype(int)
        for start, end in itertools.pairwise(edges.tolist()):
            stop = end if count == 1 else start + fast_below(end - start)
            parts[0].append(record if count == 1 else _part(record, slice(start, stop)))
            parts[1].append(response[start:stop])
            parts[2].append(tone)
    return parts


def _part(record: Record, part: slice) -> Record:
    reference = None if record.reference is None else record.reference[part]
    return replace(
        record,
        reference=reference,
        response=record.response[part],
        valid=record.mask[part],
        reference_valid=record.reference_mask[part],
    )


def _shape(kind: str, motion: FloatArray) -> FloatArray:
    if kind == SQUARE:
        return motion * motion
    if kind == DEAD:
        return -np.sign(motion)
    return motion * motion * motion


def _sums(
    one: _Series, motion: FloatArray, kinds: Sequence[str], through: Callable[[Record], ComplexArray] | None
) -> dict[str, _Sum]:
    """What one record says of each kind, made of its motion by the prediction or as measured."""
    edges = band_edges(one.record.samples, one.record.sampling_rate_hz).astype(int)
    bent = [kind for kind in kinds if through is None or kind not in BEHIND]
    own, *made = transforms([motion, *(about_mean(_shape(kind, motion), one.used) for kind in bent)])
    lines = dict(zip(bent, made, strict=True))
    for kind in kinds:
        if kind not in lines and through is not None:
            lines[kind] = lines[BEHIND[kind]] * through(one.record)
    spectra = np.stack([one.error, own, *(lines[kind] for kind in kinds)])
    return dict(zip(kinds, _fitted(spectra, edges, one), strict=True))


def _judged(
    kind: str, series: Sequence[_Series], sums: tuple[Sequence[_Sum], Sequence[_Sum]], certain: float
) -> Distortion | None:
    """The common test of these records, if it is significant by prediction and by measured response."""
    strength = [_strength(own) for own in sums]
    least = int(np.argmin(strength))
    if strength[least] < certain:
        return None
    amounts = [sum(s.product for s in own) / sum(s.power for s in own) for own in sums]
    if (amounts[0] * np.conj(amounts[1])).real <= 0.0:
        return None
    amount = amounts[least]
    one, worst = max(zip(series, sums[least], strict=True), key=lambda pair: pair[1].power)
    motion = one.motion
    size = float(np.copysign(abs(amount), amount.real))
    size_of_rest = abs(amount) * worst.left
    largest = float(np.max(np.abs(motion)))
    shape = np.where(one.used, _shape(BEHIND.get(kind, kind), motion), 0.0)
    peak = size * float(np.abs(shape[int(np.argmax(np.abs(motion)))])) / largest
    if kind in (DEAD, *BEHIND):  # beyond the resonance a spring's bend changes sign
        peak = -abs(peak) if kind == DEAD else abs(peak)
    gain = size * float(np.sum(shape * motion) / np.sum(motion**2))
    if one.record.excitation != "random" and size_of_rest < STEPS * step_in_response(one.record, motion, one.used):
        return None
    return Distortion(kind, one.record.name, peak, gain, float(np.sqrt(2.0 * strength[least])))


def _fitted(spectra: ComplexArray, edges: np.ndarray, one: _Series) -> list[_Sum]:
    """Σ W* E/S, Σ |W|²/S and the amplitude of W for every shape; rows E, motion, W … of ``spectra``."""
    wide = np.diff(edges)
    lines = slice(int(edges[0]), int(edges[-1]))

    def spread(band: np.ndarray) -> np.ndarray:
        return np.repeat(band, wide, axis=-1)

    def sums(values: np.ndarray) -> np.ndarray:
        return np.add.reduceat(values, edges[:-1] - edges[0], axis=-1)

    def without(values: ComplexArray, column: ComplexArray) -> ComplexArray:
        unit = column * spread(1.0 / np.sqrt(np.maximum(sums(power_of(column)), TINY)))
        return values - spread(sums(values * np.conj(unit))) * unit

    motion, shapes = spectra[1, lines], spectra[2:, lines]
    slope = without(np.arange(motion.size) * motion, motion)
    rest = without(without(np.concatenate([spectra[:1, lines], shapes]), motion), slope)
    least = np.maximum(one.level[lines], LEAST_DEVIATION**2 * float(np.max(power_of(motion))))
    quiet = one.quiet[1 : 1 + motion.size]
    kept = spread(sums(power_of(rest[1:])) > LEFT * sums(power_of(shapes))) & quiet
    level = np.maximum(_mean_near(power_of(rest[0])), least)
    pairs = zip(rest[1:], kept, strict=True)
    return [_summed(rest[0], left, told / level, told, least, one.record.samples) for left, told in pairs]


def _summed(
    error: ComplexArray, left: ComplexArray, weight: FloatArray, kept: np.ndarray, least: FloatArray, samples: int
) -> _Sum:
    """The sums for one shape; ``least`` is the lower limit of a line's noise power."""
    squares = power_of(left)
    power = float(weight @ squares)
    if power > 0.0:
        amount = complex(np.vdot(weight * left, error)) / power
        # The noise is what the shape does not explain.
        weight = kept / np.maximum(_mean_near(power_of(error - amount * left)), least)
        power = float(weight @ squares)
    if power <= 0.0:
        return _Sum(0j, 0.0, 0.0)
    return _Sum(complex(np.vdot(weight * left, error)), power, 2.0 * float(np.sqrt(np.sum(squares[kept]))) / samples)


def _mean_near(power: FloatArray) -> FloatArray:
    """Mean over the lines at most MEAN_LINES away, fewer at the ends; shape (lines,)."""
    total = np.zeros(power.size + 2 * MEAN_LINES + 1)
    np.cumsum(power, out=total[MEAN_LINES + 1 : MEAN_LINES + 1 + power.size])
    total[MEAN_LINES + 1 + power.size :] = total[MEAN_LINES + power.size]
    found = total[2 * MEAN_LINES + 1 :] - total[: -2 * MEAN_LINES - 1]
    np.maximum(found, 0.0, out=found)
    found /= 2.0 * MEAN_LINES + 1.0
    ends = (2.0 * MEAN_LINES + 1.0) / np.arange(MEAN_LINES + 1.0, 2.0 * MEAN_LINES + 1.0)
    found[:MEAN_LINES] *= ends
    found[::-1][:MEAN_LINES] *= ends
    return found
