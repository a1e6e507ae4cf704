"""Multi-channel sine fit: one frequency for both channels, harmonics, offset, trend, and the noise beside the tone.

Least squares in time (IEEE Std 1057-2017, four-parameter fit, extended to two channels that share the frequency), so that
a record need not hold whole periods and samples may be missing. The slow remains of a transient can be fitted along
where the sensor's poles are known.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from vibrident.measure.bands import HANN_CORRELATION
from vibrident.measure.response import ComplexArray, MeasuredResponse
from vibrident.records import FloatArray, Record

HARMONICS = 5
#: Noise lines: from this many Hann main-lobe bins off the tone, over this factor in frequency, within these numbers.
GUARD_BINS = 3
BAND_FACTOR = 1.5
FEWEST_LINES, MOST_LINES = 48, 400


def measure_tones(
    records: Sequence[Record],
    frequencies_hz: Sequence[float] | None = None,
    poles: ComplexArray | None = None,
) -> MeasuredResponse:
    """Fit every sine record.

    Args:
        records: sine records with a reference.
        frequencies_hz: tone frequencies found before; None estimates them.
        poles: poles of the sensor, 1/s; their free response is then fitted along in the response channel.
    """
    if frequencies_hz is None:
        frequencies_hz = [tone_frequency(record) for record in records]
    parts = [_fit(index, r, f, poles) for index, (r, f) in enumerate(zip(records, frequencies_hz, strict=True))]
    return MeasuredResponse.join(parts)


def tone_frequency(record: Record) -> float:
    """Frequency of a sine record, Hz: the spectrum's peak, refined by least squares on both channels."""
    reference, response, mask = np.asarray(record.reference), record.response, record.mask
    times = record.time_s
    start = _spectral_peak(reference, mask, record.sampling_rate_hz, record.frequency_hz)
    span = times[-1]
    centred = times - 0.5 * span
    omega = 2.0 * np.pi * start
    channels = np.stack([reference, response], axis=1)[mask]
    t = centred[mask]
    for _ in range(8):
        angle = omega * t
        cosine, sine = np.cos(angle), np.sin(angle)
        design = np.stack([cosine, sine, np.ones_like(t), t / span], axis=1)
        normal = design.T @ design
        found = np.linalg.solve(normal, design.T @ channels)
        residual = channels - design @ found
        scale = np.sum(residual**2, axis=0) + 1e-26 * np.sum(channels**2, axis=0) + np.finfo(float).tiny
        slope = t[:, None] * (found[1] * cosine[:, None] - found[0] * sine[:, None])
        projected = slope - design @ np.linalg.solve(normal, design.T @ slope)
        curvature = np.sum(projected**2, axis=0) / scale
        step = np.sum(np.sum(projected * residual, axis=0) / scale) / max(np.sum(curvature), np.finfo(float).tiny)
        step = float(np.clip(step, -np.pi / span, np.pi / span))
        omega += step
        if abs(step) * span < 1e-9:
            break
    return abs(float(omega)) / (2.0 * np.pi)


def _spectral_peak(signal: FloatArray, mask: NDArray[np.bool_], rate: float, near: float | None) -> float:
    """Peak of the Hann-windowed spectrum, interpolated; within a factor 1.3 of ``near`` where that is given."""
    n = signal.shape[0]
    centred = np.where(mask, signal - signal[mask].mean(), 0.0)
    size = fft.next_fast_len(2 * n, real=True)
    power = np.abs(fft.rfft(centred * np.hanning(n), size))
    bins = np.arange(power.shape[0]) * rate / size
    inside = bins > 0.25 * rate / n
    if near is not None:
        close = inside & (bins > min(near / 1.3, near - 2 * rate / n)) & (bins < max(near * 1.3, near + 2 * rate / n))
        inside = close if close.any() else inside
    peak = int(np.argmax(np.where(inside, power, -1.0)))
    if 0 < peak < power.shape[0] - 1 and power[peak] > 0:
        left, top, right = np.log(np.maximum(power[peak - 1 : peak + 2], 1e-300 + 1e-12 * power[peak]))
        curvature = left - 2 * top + right
        shift = 0.5 * (left - right) / curvature if curvature < 0 else 0.0
    else:
        shift = 0.0
    return float((peak + np.clip(shift, -0.5, 0.5)) * rate / size)


def _fit(index: int, record: Record, frequency: float, poles: ComplexArray | None) -> MeasuredResponse:
    mask, times = record.mask, record.time_s
    channels = np.stack([np.asarray(record.reference), record.response], axis=1)
    design = _design(times, frequency, record.sampling_rate_hz)
    extra = _free_response(times, poles, record.sampling_rate_hz)
    found, residual = _least_squares(design, channels, mask)
    if extra is not None:
        wide = np.concatenate([design, extra], axis=1)
        found_response, residual_response = _least_squares(wide, channels[:, 1:], mask)
        found = np.stack([found[:, 0], found_response[: design.shape[1], 0]], axis=1)
        residual = np.stack([residual[:, 0], residual_response[:, 0]], axis=1)
    harmonics = (design.shape[1] - 2) // 2
    # a cos ωt + b sin ωt = Re[(a − j b) e^{jωt}]
    amplitude = found[0 : 2 * harmonics : 2] - 1j * found[1 : 2 * harmonics : 2]
    lines_hz, lines = _noise_lines(residual, mask, frequency, record.sampling_rate_hz, harmonics)
    overtones = np.sqrt(np.sum(np.abs(amplitude[1:]) ** 2, axis=0)) / np.maximum(np.abs(amplitude[0]), 1e-300)
    count = lines_hz.shape[0]
    return MeasuredResponse(
        np.array([frequency]),
        amplitude[0, :1],
        amplitude[0, 1:],
        lines_hz[None, :],
        lines[None, :, 0],
        lines[None, :, 1],
        np.ones((1, count)),
        np.array([2.0 * count / HANN_CORRELATION]),
        np.array([index]),
        overtones[None, :],
    )


def _design(times: FloatArray, frequency: float, rate: float) -> FloatArray:
    """Columns cos hωt, sin hωt for the harmonics below 0.45 of the sampling rate, 1, t."""
    angle = 2.0 * np.pi * frequency * times
    columns = [np.cos(angle), np.sin(angle)]
    highest = max(1, min(HARMONICS, int(0.45 * rate / frequency), int(times[-1] * rate / 16)))
    for h in range(2, highest + 1):
        columns += [np.cos(h * angle), np.sin(h * angle)]
    columns.append(np.ones_like(times))
    # A trend looks like part of a sine that is seen for a period or two only.
    columns.append((times / times[-1] - 0.5) if frequency * times[-1] >= 3.0 else np.zeros_like(times))
    return np.stack(columns, axis=1)


def _free_response(times: FloatArray, poles: ComplexArray | None, rate: float) -> FloatArray | None:
    """Real basis of the free response of stable poles that last longer than a few samples; None where none do."""
    if poles is None:
        return None
    columns = []
    for pole in poles[np.imag(poles) >= 0]:
        if np.real(pole) >= 0 or -np.real(pole) > rate:
            continue
        wave = np.exp(pole * times)
        columns += [np.real(wave), np.imag(wave)] if np.imag(pole) > 1e-9 * abs(pole) else [np.real(wave)]
    return np.stack(columns, axis=1) if columns else None


def _least_squares(design: FloatArray, channels: FloatArray, mask: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    used = design if mask.all() else design * mask[:, None]
    norm = np.sqrt(np.sum(used**2, axis=0))
    norm[norm == 0] = 1.0
    scaled = used / norm
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    kept = np.where(values > 1e-10, 1.0 / np.maximum(values, 1e-10), 0.0)
    inverse = (vectors * kept) @ vectors.T
    first = inverse @ (scaled.T @ channels)
    residual = (channels - design @ (first / norm[:, None])) * mask[:, None]
    second = inverse @ (scaled.T @ residual)  # one step of refinement: normal equations lose half the digits
    found = (first + second) / norm[:, None]
    return found, (channels - design @ found) * mask[:, None]


def _noise_lines(
    residual: FloatArray, mask: NDArray[np.bool_], frequency: float, rate: float, harmonics: int
) -> tuple[FloatArray, ComplexArray]:
    """Spectral lines of the residual beside the tone, scaled as :class:`MeasuredResponse` says."""
    n = residual.shape[0]
    window = np.hanning(n) * mask
    spectrum = fft.rfft(residual * window[:, None], axis=0)
    bins = np.arange(spectrum.shape[0])
    centre = frequency * n / rate
    allowed = (bins >= 1) & (bins < spectrum.shape[0] - 1)
    for h in range(1, harmonics + 1):
        allowed &= np.abs(bins - h * centre) >= GUARD_BINS
    distance = np.abs(np.log(np.maximum(bins, 0.5) / max(centre, 0.5)))
    candidates = np.flatnonzero(allowed)
    if candidates.size == 0:
        candidates = np.arange(1, max(2, spectrum.shape[0] - 1))
    order = candidates[np.argsort(distance[candidates], kind="stable")]
    count = int(np.sum(distance[order] <= np.log(BAND_FACTOR)))
    chosen = np.sort(order[: int(np.clip(count, FEWEST_LINES, MOST_LINES))])
    # White noise of variance σ²: E|line|² = σ² Σw², and the amplitude's real part has variance 2 σ²/N.
    scale = np.sqrt(2.0 / (np.sum(window**2) * max(int(mask.sum()), 1)))
    return chosen * rate / n, scale * spectrum[chosen]
