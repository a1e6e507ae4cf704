"""Multi-channel sine fit: one frequency for both channels, harmonics, offset, trend, and the noise beside the tone.

Least squares in time (IEEE Std 1057-2017, four-parameter fit, extended to two channels that share the frequency),
so that a record need not hold whole periods and samples may be missing. The slow remains of a transient can be
fitted along where the sensor's poles are known.
"""

from __future__ import annotations

from collections.abc import Sequence
from weakref import WeakKeyDictionary

import numpy as np
from numpy import fft
from numpy.typing import NDArray

from vibrident.information import inverse_where_shown
from vibrident.measure.lines import about_mean, fast_length, hann, waves
from vibrident.measure.response import ComplexArray, MeasuredResponse
from vibrident.measure.rounding import returning_errors
from vibrident.records import FloatArray, Record

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
#: Terms are told apart where their scaled normal matrix has eigenvalues above this.
TOLD_APART = 1e-10


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
    frequencies_hz = [tone_frequency(record) for record in records] if frequencies_hz is None else frequencies_hz
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
        start = spectral_peak(np.asarray(record.reference), record.mask, record.sampling_rate_hz, near)
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
        curvature = np.sum(slope**2, axis=1) - np.sum(inner * np.linalg.solve(normal, inner), axis=0)
        drift = np.sum(slope * residual, axis=1)  # the residual is orthogonal to the design
        step = np.sum(drift / scale) / max(float(np.sum(curvature / scale)), np.finfo(float).tiny)
        step = float(np.clip(step, -np.pi / span, np.pi / span))
        omega += step
        if abs(step) * span < FREQUENCY_TOLERANCE:
            break
    amplitude = (found[0] - 1j * found[1]) * np.exp(-0.5j * omega * span)  # from the record's middle to its start
    count = max(t.shape[0], 6)
    variance = 2.0 * np.sum(residual**2, axis=1) / (count - 5.0) / count
    if omega < 0:
        omega, amplitude = -omega, np.conj(amplitude)
    return float(omega) / (2.0 * np.pi), amplitude, variance


def own_sine(record: Record) -> FloatArray:
    """The response's sine and mean alone, shape (samples,)."""
    frequency, amplitude, _ = _sine_fit(record)
    wave = turning(record.samples, 2.0 * np.pi * frequency / record.sampling_rate_hz)
    return np.asarray(np.real(amplitude[1] * wave) + record.response[record.mask].mean(), dtype=float)


def spectral_peak(signal: FloatArray, mask: NDArray[np.bool_], rate: float, near: float | None) -> float:
    """Peak of the Hann-windowed spectrum, interpolated; within a factor 1.3 of ``near`` where that is given."""
    n, size = signal.shape[0], fast_length(signal.shape[0])
    power = np.abs(np.asarray(fft.rfft(about_mean(signal, mask) * hann(n), size)))
    bins = np.arange(power.shape[0]) * rate / size
    inside = bins > 0.25 * rate / n
    if near is not None:
        close = inside & (bins > min(near / 1.3, near - 2 * rate / n)) & (bins < max(near * 1.3, near + 2 * rate / n))
        inside = close if close.any() else inside
    peak, shift = int(np.argmax(np.where(inside, power, -1.0))), 0.0
    if 0 < peak < power.shape[0] - 1 and power[peak] > 0:
        left, top, right = np.log(np.maximum(power[peak - 1 : peak + 2], 1e-300 + 1e-12 * power[peak]))
        curvature = left - 2 * top + right
        shift = 0.5 * (left - right) / curvature if curvature < 0 else 0.0
    return float((peak + np.clip(shift, -0.5, 0.5)) * rate / size)


def _fit(index: int, record: Record, frequency: float, poles: ComplexArray | None, raw: Record) -> MeasuredResponse:
    mask, rate = record.mask, record.sampling_rate_hz
    times, place = record.time_s, _span(mask)
    tone, extra = _design(times, frequency, rate), _free_response(times, poles, rate)
    if record.hum_hz:
        hum = waves(_beside(record, frequency), record.samples)
        extra = hum if extra is None else np.concatenate([extra, hum])
    channels = np.stack([np.asarray(record.reference)[place], record.response[place]])
    whole = (tone if extra is None else np.concatenate([tone, extra]))[:, place]
    if not mask[place].all():
        channels, whole = channels * mask[place], whole * mask[place]
    count, own = float(mask.sum()), np.arange(len(tone))
    gram = whole @ whole.T
    if not mask.all():
        own = _told_apart(own, whole, gram, channels, count)
    rows = np.concatenate([own, np.arange(len(tone), len(whole))])
    whole, gram = (whole, gram) if len(rows) == len(whole) else (whole[rows], gram[np.ix_(rows, rows)])
    found, rest = _least_squares(whole, gram, channels, (len(own), len(rows)))
    harmonics = (len(own) - 2) // 2
    # a cos ωt + b sin ωt = Re[(a − j b) e^{jωt}]
    amplitude = found[0 : 2 * harmonics : 2] - 1j * found[1 : 2 * harmonics : 2]
    residual, fitted = np.zeros((2, mask.size)), np.zeros((len(rows) if mask.size <= SHORT else 0, mask.size))
    residual[:, place], fitted[:, place] = rest, whole[: len(fitted)]
    left = [_noise_left(fitted[:number], number, mask) for number in (len(own), len(rows))]
    lines_hz, lines = _noise_lines(residual, mask, frequency, rate, harmonics, left)
    lines *= np.sqrt(_cost(gram, count))
    free = max(count - len(rows), 1.0)
    overtones = np.sqrt(np.sum(np.abs(amplitude[1:]) ** 2, axis=0)) / np.maximum(np.abs(amplitude[0]), 1e-300)
    number, rounding = lines_hz.shape[0], returning_errors(raw, frequency, residual)
    return MeasuredResponse(
        np.array([frequency]),
        amplitude[0, :1],
        amplitude[0, 1:],
        lines_hz[None, :],
        lines[:1],
        lines[1:],
        np.ones((1, number)),
        np.array([min(2.0 * number / HANN_CORRELATION, free)]),
        np.array([index]),
        overtones[None, :],
        rounding[None, :],
    )


def _beside(record: Record, frequency: float) -> FloatArray:
    """Places of hum in lines, a little off the tone: what is at the same frequency is then uncertain, not halved."""
    places, own = np.array(record.hum_hz) * record.duration_s, frequency * record.duration_s
    return np.where(np.abs(places - own) < NEAREST_HUM, own + NEAREST_HUM, places)


def _span(mask: NDArray[np.bool_]) -> slice:
    """From the first sample that is used to the last."""
    used = np.flatnonzero(mask)
    return slice(int(used[0]), int(used[-1]) + 1) if used.size else slice(0, 0)


def _design(times: FloatArray, frequency: float, rate: float) -> FloatArray:
    """Rows cos hωt, sin hωt for the harmonics below 0.45 of the sampling rate, 1, t."""
    highest = max(1, min(HARMONICS, int(0.45 * rate / frequency), int(times[-1] * rate / 16)))
    rows = np.empty((2 * highest + 2, times.shape[0]))
    wave = turning(times.shape[0], 2.0 * np.pi * frequency / rate)
    turned = wave.copy()
    for h in range(highest):  # e^{j(h+1)ωt} = e^{jhωt} e^{jωt}
        rows[2 * h], rows[2 * h + 1] = turned.real, turned.imag
        if h + 1 < highest:
            turned *= wave
    rows[-2] = 1.0
    # A trend resembles part of a sine of only one or two periods.
    rows[-1] = (times / times[-1] - 0.5) if frequency * times[-1] >= 3.0 else 0.0
    return rows


def _told_apart(
    rows: NDArray[np.int_], whole: FloatArray, gram: FloatArray, channels: FloatArray, count: float
) -> NDArray[np.int_]:
    """The rows of the tone's design without harmonics that omitted samples make inseparable from the tone.

    Where tops are cut off, the tone and its harmonics look alike: the variance of the tone's amplitude is 2 σ²/N times
    a factor, which grows with the harmonics. Those that are significant in either channel always stay: without
    them the tone would be biased.
    """
    offset = rows[-2:]
    alone = np.concatenate([rows[:2], offset])
    most = MOST_COST * _cost(gram[np.ix_(alone, alone)], count)
    for highest in range((len(rows) - 2) // 2, 0, -1):
        which = np.concatenate([rows[: 2 * highest], offset])
        if _cost(gram[np.ix_(which, which)], count) > most and highest > 1:
            continue
        if (dropped := len(rows) - which.size) == 0:
            return rows
        every, kept = (
            np.sum(
                _least_squares(whole[some], gram[np.ix_(some, some)], channels, (len(some), len(some)))[1] ** 2, axis=1
            )
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
    largest = 0.5 * (own[0, 0] + own[1, 1]) + float(np.hypot(0.5 * (own[0, 0] - own[1, 1]), own[0, 1]))
    return max(largest * count / 2.0, 1.0)


def _free_response(times: FloatArray, poles: ComplexArray | None, rate: float) -> FloatArray | None:
    """Real basis of the free response of stable poles that last longer than a few samples; None if there is none."""
    if poles is None:
        return None
    rows = []
    for pole in poles[np.imag(poles) >= 0]:
        if np.real(pole) >= 0 or -np.real(pole) > rate:
            continue
        lasting = np.zeros((2, times.shape[0]))
        lives = times < 36.0 / -np.real(pole)  # e^{−36} is below rounding
        decay = np.exp(np.real(pole) * times[lives])
        lasting[0, lives] = decay * np.cos(np.imag(pole) * times[lives])
        lasting[1, lives] = decay * np.sin(np.imag(pole) * times[lives])
        rows += [lasting[0], lasting[1]] if np.imag(pole) > 1e-9 * abs(pole) else [lasting[0]]
    return np.stack(rows) if rows else None


def _least_squares(
    rows: FloatArray, gram: FloatArray, channels: FloatArray, numbers: tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """Coefficients (rows, channels) and residual (channels, samples).

    Args:
        rows: zero where samples are not used, shape (rows, samples).
        gram: their products.
        channels: zero where samples are not used, shape (channels, samples).
        numbers: how many of the rows each channel is fitted by; the others' coefficients are zero.
    """
    inverses = np.zeros((len(channels), *gram.shape))
    for channel, number in enumerate(numbers):
        inverses[channel, :number, :number] = inverse_where_shown(gram[:number, :number], TOLD_APART)

    def fitted(right: FloatArray) -> FloatArray:
        return np.einsum("cij,jc->ic", inverses, rows @ right.T)

    found = fitted(channels)
    found += fitted(channels - found.T @ rows)  # one step of refinement: normal equations lose half the digits
    return found, channels - found.T @ rows


def _noise_left(design: FloatArray, rows: int, mask: NDArray[np.bool_]) -> FloatArray:
    """Part of white noise that the fit of so many rows leaves of each windowed line, shape (lines,).

    Few periods: harmonics, offset and free response take nearly all of the lines beside the tone. In a long record they
    take the same of all.
    """
    count = float(mask.sum())
    if mask.size > SHORT:
        return np.broadcast_to(max(count - rows, 1.0) / count, mask.size // 2 + 1)
    window = hann(mask.size) * mask
    left, size, _ = np.linalg.svd(design.T, full_matrices=False)
    basis = left[:, size > 1e-5 * size[0]].T
    taken = np.sum(np.abs(np.asarray(fft.rfft(basis * window, axis=1))) ** 2, axis=0) / np.sum(window**2)
    return np.maximum(1.0 - taken, 1e-3)


def _noise_lines(
    residual: FloatArray,
    mask: NDArray[np.bool_],
    frequency: float,
    rate: float,
    harmonics: int,
    left: Sequence[FloatArray],
) -> tuple[FloatArray, ComplexArray]:
    """Spectral lines of the residual beside the tone, scaled as :class:`MeasuredResponse` says; (K,) and (2, K).

    ``left`` is the part of white noise that the fit left of each, for either channel of shape (samples // 2 + 1,).
    """
    n = residual.shape[1]
    window = hann(n) if mask.all() else hann(n) * mask
    spectrum = np.asarray(fft.rfft(residual * window, axis=1))
    last = spectrum.shape[1] - 1
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
    chosen = np.sort(candidates[order[: int(np.clip(count, FEWEST_LINES, MOST_LINES))]])
    # White noise of variance σ²: E|line|² = σ² Σw², and the amplitude's real part has variance 2 σ²/N.
    scale = np.sqrt(2.0 / (np.sum(window**2) * max(int(mask.sum()), 1)))
    return chosen * rate / n, scale * spectrum[:, chosen] / np.sqrt([part[chosen] for part in left])


def turning(samples: int, angle: float, first: float = 0.0) -> ComplexArray:
    """e^{j(first + angle k)} for k = 0 … samples − 1: products of two tables, which take a root of the functions."""
    width = max(int(np.sqrt(samples)), 1)
    steps = np.exp(1j * angle * np.arange(width))
    begins = np.exp(1j * (first + angle * width * np.arange(-(-samples // width))))
    return (begins[:, None] * steps).ravel()[:samples]
