"""Multi-channel sine fit: one frequency for both channels, harmonics, offset, trend, and the noise beside the tone.

Least squares in time (IEEE Std 1057-2017, four-parameter fit, extended to two channels that share the frequency),
so that a record need not hold whole periods and samples may be missing. The slow remains of a transient can be
fitted along where the sensor's poles are known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy import fft
from numpy.typing import NDArray

from vibrident.base.fft_lengths import fast_length
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.data.records.basis import span_of
from vibrident.fit.information import inverse_where_shown
from vibrident.fit.response.response import ComplexArray, MeasuredResponse
from vibrident.fit.response.rounding import returning_error
from vibrident.fit.response.terms import TOLD_APART, Exponentials, Terms, WrittenOut, fitted
from vibrident.fit.response.transform import about_mean, hann, waves

HARMONICS = 5
_SineFit = tuple[float, ComplexArray, FloatArray]
#: Noise lines: from this many Hann main-lobe bins off the tone, over this factor in frequency, within these numbers.
GUARD_BINS = 3
#: … but no more than this part of the distance between harmonics.
CLOSE = 0.4
#: Correlation of neighbouring lines of a Hann-windowed spectrum, Σ ρ²: K lines are worth K/1.94.
HANN_CORRELATION = 1.0 + 2.0 * (4.0 / 9.0 + 1.0 / 36.0)
#: The frequency's Gauss–Newton steps: quadratic, so a step below this phase over the record leaves an error below 1e-9.
FREQUENCY_ITERATIONS, FREQUENCY_TOLERANCE = 12, 3e-5
BAND_FACTOR = 1.5
#: Where samples are left out, harmonics are fitted along while they cost the tone no more than this factor in variance,
#: or where they take more from the residual than so many times what as many numbers take from noise.
MOST_COST, HEARD = 1.3, 10.0
FEWEST_LINES, MOST_LINES = 48, 400
#: Hum is fitted at least this part of a line from the tone.
NEAREST_HUM = 0.05
#: In records of at most so many samples a line that keeps less than this part of its noise beside the fit says nothing.
SHORT, KEPT = 4096, 0.5


def measure_tones(
    records: Sequence[Record],
    frequencies_hz: Sequence[float] | None = None,
    poles: ComplexArray | None = None,
    measured: Sequence[Record] | None = None,
) -> MeasuredResponse:
    """Fit every sine record.

    Args:
        records: sine records with a reference.
        frequencies_hz: tone frequencies found before; None estimates them.
        poles: poles of the sensor, 1/s; their free response is then fitted along in the response channel.
        measured: the records as they were measured, where something was subtracted from the response.
    """
    frequencies_hz = (
        [tone_frequency(record) for record in records] if frequencies_hz is None else frequencies_hz
    )
    every = enumerate(zip(records, frequencies_hz, measured or records, strict=True))
    parts = [_fit(index, record, f, poles, raw) for index, (record, f, raw) in every]
    return MeasuredResponse.join(parts)


def find_tones(records: Sequence[Record]) -> MeasuredResponse:
    """Frequency and amplitudes of every sine record, quickly: no harmonics, and noise taken for white.

    Good for start values; :func:`measure_tones` is the careful measurement.
    """
    parts = []
    for index, record in enumerate(records):
        frequency, amplitude, variance = _sine_fit(record)
        # Two lines stand for the noise, one of each channel, twice the variance each: their mean is the variance.
        lines = np.diag(np.sqrt(2.0 * variance)).astype(complex)
        parts.append(
            MeasuredResponse(
                np.array([frequency]),
                amplitude[:1],
                amplitude[1:],
                np.full((1, 2), frequency),
                lines[:1],
                lines[1:],
                np.ones((1, 2)),
                np.array([float(record.mask.sum())]),
                np.array([index]),
                np.zeros((1, 2)),
            )
        )
    return MeasuredResponse.join(parts)


def tone_frequency(record: Record, near: float | None = None) -> float:
    """Frequency of a sine record, Hz: the spectrum's peak, refined by least squares on both channels.

    ``near`` replaces the record's own start value.
    """
    return _sine_fit(record, near)[0]


#: The fits of each record by what was stated, and where each began: several findings need them.
_FITTED: WeakKeyDictionary[Record, dict[float | None, tuple[float, _SineFit]]] = WeakKeyDictionary()


def _sine_fit(record: Record, near: float | None = None) -> _SineFit:
    """Frequency, amplitudes of both channels, and the variance of their real parts for white noise."""
    near = record.frequency_hz if near is None else near
    known = _FITTED.setdefault(record, {})
    if near not in known:
        start = spectral_peak(
            np.asarray(record.reference), record.mask, record.sampling_rate_hz, near
        )
        same = (one for one in known.values() if one[0] == start)
        known[near] = next(same, None) or (start, _sine_fit_from(record, start))
    return known[near][1]


def _sine_fit_from(record: Record, start: float) -> _SineFit:
    reference, response, mask = np.asarray(record.reference), record.response, record.mask
    times = record.time_s
    span = times[-1]
    omega = 2.0 * np.pi * start
    t = times - 0.5 * span
    channels = np.stack([reference, response])
    design = np.empty((4, record.samples))
    design[2], design[3] = 1.0, t / span
    interval, whole = record.sampling_interval_s, bool(mask.all())
    if not whole:
        t, channels, design = t[mask], channels[:, mask], np.ascontiguousarray(design[:, mask])
    power = np.sum(channels**2, axis=1)
    for _ in range(FREQUENCY_ITERATIONS):
        wave = turning(record.samples, omega * interval, -0.5 * omega * span)
        wave = wave if whole else wave[mask]
        design[0], design[1] = wave.real, wave.imag
        normal = design @ design.T
        found = np.linalg.solve(normal, design @ channels.T)  # (4, channels)
        residual = channels - found.T @ design
        scale = np.sum(residual**2, axis=1) + 1e-26 * power + np.finfo(float).tiny
        slope = (found[1][:, None] * design[0] - found[0][:, None] * design[1]) * t
        inner = design @ slope.T
        curvature = np.sum(slope**2, axis=1) - np.sum(
            inner * np.linalg.solve(normal, inner), axis=0
        )
        drift = np.sum(slope * residual, axis=1)  # the residual is orthogonal to the design
        step = np.sum(drift / scale) / max(float(np.sum(curvature / scale)), np.finfo(float).tiny)
        step = float(np.clip(step, -np.pi / span, np.pi / span))
        omega += step
        if abs(step) * span < FREQUENCY_TOLERANCE:
            break
    amplitude = (found[0] - 1j * found[1]) * np.exp(
        -0.5j * omega * span
    )  # from the record's middle to its start
    count = max(t.shape[0], 6)
    variance = 2.0 * np.sum(residual**2, axis=1) / (count - 5.0) / count
    if omega < 0:
        omega, amplitude = -omega, np.conj(amplitude)
    return float(omega) / (2.0 * np.pi), amplitude, variance


def own_sine(record: Record) -> FloatArray:
    """The response's sine and mean alone, shape (samples,)."""
    frequency, amplitude, _ = _sine_fit(record)
    wave = turning(record.samples, 2.0 * np.pi * frequency / record.sampling_rate_hz)
    return np.asarray(
        np.real(amplitude[1] * wave) + record.response[record.mask].mean(), dtype=float
    )


def spectral_peak(signal: FloatArray, mask: BoolArray, rate: float, near: float | None) -> float:
    """Peak of the Hann-windowed spectrum, interpolated; within a factor 1.3 of ``near`` where that is given."""
    n, size = signal.shape[0], fast_length(signal.shape[0])
    power = np.abs(np.asarray(fft.rfft(about_mean(signal, mask) * hann(n), size)))
    bins = np.arange(power.shape[0]) * rate / size
    inside = bins > 0.25 * rate / n
    if near is not None:
        close = (
            inside
            & (bins > min(near / 1.3, near - 2 * rate / n))
            & (bins < max(near * 1.3, near + 2 * rate / n))
        )
        inside = close if close.any() else inside
    peak, shift = int(np.argmax(np.where(inside, power, -1.0))), 0.0
    if 0 < peak < power.shape[0] - 1 and power[peak] > 0:
        left, top, right = np.log(
            np.maximum(power[peak - 1 : peak + 2], 1e-300 + 1e-12 * power[peak])
        )
        curvature = left - 2 * top + right
        shift = 0.5 * (left - right) / curvature if curvature < 0 else 0.0
    return float((peak + np.clip(shift, -0.5, 0.5)) * rate / size)


def _fit(
    index: int, record: Record, frequency: float, poles: ComplexArray | None, raw: Record
) -> MeasuredResponse:
    mask, rate = record.mask, record.sampling_rate_hz
    terms, number = _terms(record, frequency, poles)
    if not mask.all():
        kept = _told_apart(number, terms, record, float(mask.sum()))
        terms = terms.only(np.concatenate([kept, np.arange(number, len(terms.gram))]))
        number = len(kept)
    own, place = terms.only(np.arange(number)), span_of(mask)
    harmonics, count = (number - 2) // 2, float(mask.sum())
    left = [_noise_left(one, mask) for one in (own, terms)]
    chosen = _noise_lines(mask.size, frequency, rate, harmonics, left)
    response = _Fit.of(terms, "response", record, raw, frequency, chosen)
    # The reference's fit stays, however often something is subtracted from the response.
    stays = isinstance(own, Exponentials) and record.reference is raw.reference
    known, key = (
        _REFERENCES.setdefault(raw, {}) if stays else {},
        (frequency, place.start, place.stop, number),
    )
    if key not in known:
        known[key] = _Fit.of(own, "reference", record, raw, frequency, chosen)
    fits = known[key], response
    # White noise of variance σ²: E|line|² = σ² Σw², and the amplitude's real part has variance 2 σ²/N.
    scale = np.sqrt(2.0 / (np.sum(_window(mask) ** 2) * max(count, 1.0)) * _cost(terms.gram, count))
    lines = [
        scale * fit.lines / np.sqrt(part[chosen]) for fit, part in zip(fits, left, strict=True)
    ]
    amplitude = [fit.amplitudes[:harmonics] for fit in fits]
    overtones = [
        np.sqrt(np.sum(np.abs(a[1:]) ** 2)) / max(float(np.abs(a[0])), 1e-300) for a in amplitude
    ]
    free = max(count - len(terms.gram), 1.0)
    return MeasuredResponse(
        np.array([frequency]),
        amplitude[0][:1],
        amplitude[1][:1],
        (chosen * rate / mask.size)[None, :],
        lines[0][None, :],
        lines[1][None, :],
        np.ones((1, chosen.size)),
        np.array([min(2.0 * chosen.size / HANN_CORRELATION, free)]),
        np.array([index]),
        np.array([overtones]),
        np.array([[fit.rounding for fit in fits]]),
    )


@dataclass(frozen=True, eq=False)
class _Fit:
    """A channel of a record, fitted.

    Attributes:
        amplitudes: of the harmonics first, complex, shape (terms // 2,).
        lines: of what is left, windowed, at the lines beside the tone, shape (K,).
        rounding: variance of the tone's real part by a converter's errors that return each period.
    """

    amplitudes: ComplexArray
    lines: ComplexArray
    rounding: float

    @classmethod
    def of(
        cls,
        terms: Terms,
        channel: str,
        record: Record,
        raw: Record,
        frequency: float,
        chosen: NDArray[np.int_],
    ) -> _Fit:
        """By these terms, with the lines ``chosen``; ``raw``: the record as it was measured."""
        mask = record.mask
        place, values = span_of(mask), np.asarray(getattr(record, channel))
        found, rest = fitted(terms, values[place] * mask[place])
        residual = np.zeros(mask.size)
        residual[place] = rest
        # a cos ωt + b sin ωt = Re[(a − j b) e^{jωt}]
        pairs = len(found) // 2
        amplitudes = found[0 : 2 * pairs : 2] - 1j * found[1 : 2 * pairs : 2]
        turns = frequency / record.sampling_rate_hz
        rounding = returning_error(
            np.asarray(getattr(raw, channel)), raw.mask, turns, residual[raw.mask]
        )
        return cls(amplitudes, np.asarray(fft.rfft(residual * _window(mask)))[chosen], rounding)


#: Fits of the references of records as they were measured, by frequency, span and number of terms.
_REFERENCES: WeakKeyDictionary[Record, dict[tuple[float, int, int, int], _Fit]] = (
    WeakKeyDictionary()
)


def _window(mask: BoolArray) -> FloatArray:
    """Hann's window where samples are used, shape (samples,)."""
    return hann(mask.size) if mask.all() else hann(mask.size) * mask


def _beside(record: Record, frequency: float) -> FloatArray:
    """Places of hum in lines, a little off the tone: what is at the same frequency is then uncertain, not halved."""
    places, own = np.array(record.hum_hz) * record.duration_s, frequency * record.duration_s
    return np.where(np.abs(places - own) < NEAREST_HUM, own + NEAREST_HUM, places)


def _terms(record: Record, frequency: float, poles: ComplexArray | None) -> tuple[Terms, int]:
    """Terms over the span that is used, and how many are the tone's own.

    cos hωt, sin hωt for the harmonics below 0.45 of the sampling rate, one, t; free response; hum.
    """
    mask, rate, place = record.mask, record.sampling_rate_hz, span_of(record.mask)
    last = record.samples - 1
    highest = max(1, min(HARMONICS, int(0.45 * rate / frequency), int(last / 16)))
    lasting = free_exponents(poles, rate)
    tone = 2j * np.pi * frequency / rate * np.arange(1, highest + 1)
    exponents = np.concatenate([tone, lasting]).astype(complex)
    count = len(exponents)
    # A trend resembles part of a sine of only one or two periods.
    trend = np.arange(place.start, place.stop) / last - 0.5
    trend = trend if frequency * last / rate >= 3.0 else np.zeros_like(trend)
    pairs = np.stack([np.arange(count), count + np.arange(count)], axis=1)
    swings = np.ravel(
        [[True, exponent.imag > 1e-9 * abs(exponent)] for exponent in lasting]
    ).astype(bool)
    free = pairs[highest:].ravel()[swings]
    order = np.concatenate([pairs[:highest].ravel(), [2 * count, 2 * count + 1], free])
    swift = bool(np.all(np.abs(exponents) * trend.size > 1.0))  # of slower ones the products cancel
    if record.samples > SHORT and swift and not record.hum_hz and mask[place].all():
        return Exponentials.of(exponents, place.start, trend, order), 2 * highest + 2
    waves_of = np.array(
        [turning(record.samples, e.imag) for e in exponents[:highest]]
        + [np.exp(e * np.arange(record.samples)) for e in lasting]
    )[:, place]
    rows = np.concatenate([waves_of.real, waves_of.imag, np.ones((1, trend.size)), trend[None]])[
        order
    ]
    if record.hum_hz:
        rows = np.concatenate([rows, waves(_beside(record, frequency), record.samples)[:, place]])
    return WrittenOut.of(rows * mask[place]), 2 * highest + 2


def free_exponents(poles: ComplexArray | None, rate_hz: float) -> ComplexArray:
    """Exponents of the free response from sample to sample: of stable poles, 1/s, one of each pair, shape (q,).

    A pole that is gone by the second sample may be as large as the tone in the first. Those that rounding ends before
    the second sample are left out.
    """
    found: ComplexArray = (
        np.zeros(0, dtype=complex) if poles is None else np.asarray(poles / rate_hz, dtype=complex)
    )
    lasts = (found.imag >= 0.0) & (found.real < 0.0) & (found.real > np.log(np.finfo(float).eps))
    return np.asarray(found[lasts], dtype=complex)


def _told_apart(number: int, terms: Terms, record: Record, count: float) -> NDArray[np.int_]:
    """The tone's terms without harmonics that omitted samples make inseparable from the tone.

    Where tops are cut off, the tone and its harmonics look alike: the variance of the tone's amplitude is 2 σ²/N times
    a factor, which grows with the harmonics. Those that are significant in either channel always stay: without
    them the tone would be biased.
    """
    rows, place = np.arange(number), span_of(record.mask)
    offset = rows[-2:]
    most = MOST_COST * _cost(terms.only(np.concatenate([rows[:2], offset])).gram, count)
    for highest in range((number - 2) // 2, 0, -1):
        which = np.concatenate([rows[: 2 * highest], offset])
        if _cost(terms.only(which).gram, count) > most and highest > 1:
            continue
        if (dropped := number - which.size) == 0:
            return rows
        channels = [
            np.asarray(c)[place] * record.mask[place] for c in (record.reference, record.response)
        ]
        every, kept = (
            np.array([np.sum(fitted(terms.only(some), channel)[1] ** 2) for channel in channels])
            for some in (rows, which)
        )
        return rows if np.any(kept > every * (1.0 + HEARD * dropped / count)) else which
    return rows


def _cost(gram: FloatArray, count: float) -> float:
    """Variance of the tone's amplitude over what as many samples of a long record would give, at the worst phase.

    Gaps, few periods, and a free response of nearly its frequency make it hard to separate from other terms.

    Args:
        gram: products of the rows of the design over the samples used, the tone's own two first.
        count: of these samples.
    """
    own = inverse_where_shown(gram, TOLD_APART)[:2, :2]
    largest = 0.5 * (own[0, 0] + own[1, 1]) + float(
        np.hypot(0.5 * (own[0, 0] - own[1, 1]), own[0, 1])
    )
    return max(largest * count / 2.0, 1.0)


def _noise_left(terms: Terms, mask: BoolArray) -> FloatArray:
    """Part of white noise that the fit of these terms leaves of each windowed line, shape (lines,).

    Few periods: harmonics, offset and free response take nearly all of the lines beside the tone. In a long record they
    take the same of all.
    """
    count = float(mask.sum())
    if mask.size > SHORT or not isinstance(terms, WrittenOut):
        return np.broadcast_to(max(count - len(terms.gram), 1.0) / count, mask.size // 2 + 1)
    design, window = np.zeros((len(terms.gram), mask.size)), hann(mask.size) * mask
    design[:, span_of(mask)] = terms.rows
    left, size, _ = np.linalg.svd(design.T, full_matrices=False)
    basis = left[:, size > 1e-5 * size[0]].T
    taken = np.sum(np.abs(np.asarray(fft.rfft(basis * window, axis=1))) ** 2, axis=0) / np.sum(
        window**2
    )
    return np.maximum(1.0 - taken, 1e-3)


def _noise_lines(
    n: int, frequency: float, rate: float, harmonics: int, left: Sequence[FloatArray]
) -> NDArray[np.int_]:
    """Numbers of spectral lines of n samples beside the tone that tell its noise, shape (K,).

    ``left`` is the part of white noise that the fit left of each, for either channel of shape (n // 2 + 1,).
    """
    last = n // 2
    centre = frequency * n / rate
    low, high = int(centre / BAND_FACTOR), int(centre * BAND_FACTOR) + 1
    # A window wide enough for the lines wanted, on whichever side there is room.
    reach = FEWEST_LINES + (2 * GUARD_BINS + 1) * harmonics
    low, high = max(1, min(low, int(centre) - reach)), min(last, max(high, int(centre) + reach))
    bins = np.arange(low, max(high, low + 1))
    # Few periods: harmonics stand so close that lines between two of them are all there is near the tone.
    guard = min(GUARD_BINS, CLOSE * centre)
    allowed = np.ones(bins.shape, dtype=bool)
    for h in range(1, harmonics + 1):
        allowed &= np.abs(bins - h * centre) >= guard
    telling = np.minimum(*(part[bins] for part in left))
    allowed &= telling >= KEPT
    candidates = bins[allowed] if allowed.any() else bins[telling >= np.sort(telling)[-3:][0]]
    distance = np.abs(np.log(candidates / max(centre, 0.5)))
    order = np.argsort(distance, kind="stable")
    count = int(np.sum(distance <= np.log(BAND_FACTOR)))
    return np.sort(candidates[order[: int(np.clip(count, FEWEST_LINES, MOST_LINES))]])


def turning(samples: int, angle: float, first: float = 0.0) -> ComplexArray:
    """e^{j(first + angle k)} for k = 0 … samples − 1: products of two tables, which take a root of the functions."""
    width = max(int(np.sqrt(samples)), 1)
    steps = np.exp(1j * angle * np.arange(width))
    begins = np.exp(1j * (first + angle * width * np.arange(-(-samples // width))))
    return (begins[:, None] * steps).ravel()[:samples]
