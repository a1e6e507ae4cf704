"""Four-parameter sine fit (IEEE Std 1057-2017) of both channels, which share the frequency."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_length
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import about_mean, hann, log_peak_shift

MAX_ITERATIONS = 12
#: Gauss–Newton converges quadratically: a last step below this phase leaves an error below 1e-9.
MAX_LAST_STEP_RAD = 3e-5


class SineFit(NamedTuple):
    """Least-squares sine of the reference and of the response at one frequency.

    Attributes:
        frequency_hz: shared by both channels.
        amplitudes: complex, of reference and response, shape (2,).
        variances: of their real parts under white noise, shape (2,).
    """

    frequency_hz: float
    amplitudes: ComplexArray
    variances: FloatArray


#: Start and fit of each record, by the stated frequency; several findings need the same fit.
_FITS: WeakKeyDictionary[Record, dict[float | None, tuple[float, SineFit]]] = WeakKeyDictionary()


def tone_frequency(record: Record, near: float | None = None) -> float:
    """Return the frequency of a sine record, Hz, by least squares on both channels.

    Args:
        record: sine record with a reference.
        near: start value in Hz, in place of the frequency stated in the record.
    """
    return sine_fit(record, near).frequency_hz


def response_sine(record: Record) -> FloatArray:
    """Return the fitted sine and the mean of the response, shape (samples,)."""
    fit = sine_fit(record)
    wave = phasors(record.samples, 2.0 * np.pi * fit.frequency_hz / record.sampling_rate_hz)
    return np.real(fit.amplitudes[1] * wave) + record.response[record.mask].mean()


def sine_fit(record: Record, near: float | None = None) -> SineFit:
    """Return the fit of a sine record, started at the spectral peak that its channels share.

    One channel alone may mislead: on a shaking table slow motion has a larger displacement than the
    sine.

    Args:
        record: sine record with a reference.
        near: frequency in Hz about which the peak is sought; None takes the stated one, if any.
    """
    near = record.frequency_hz if near is None else near
    fits = _FITS.setdefault(record, {})
    if near not in fits:
        channels = [np.asarray(record.reference), record.response]
        start_hz = spectral_peak(channels, record.mask, record.sampling_rate_hz, near)
        same_start = (fit for fit in fits.values() if fit[0] == start_hz)
        fits[near] = next(same_start, None) or (start_hz, _fit_from(record, start_hz))
    return fits[near][1]


def _fit_from(record: Record, start_hz: float) -> SineFit:
    """Return the fit that Gauss–Newton reaches from a start frequency in Hz."""
    mask = record.mask
    times = record.time_s
    span = times[-1]
    omega = 2.0 * np.pi * start_hz
    t = times - 0.5 * span
    channels = np.stack([np.asarray(record.reference), record.response])
    design = np.empty((4, record.samples))
    design[2] = 1.0
    design[3] = t / span
    interval = record.sampling_interval_s
    all_used = bool(mask.all())
    if not all_used:
        t = t[mask]
        channels = channels[:, mask]
        design = np.ascontiguousarray(design[:, mask])
    power = np.sum(channels**2, axis=1)
    for _ in range(MAX_ITERATIONS):
        wave = phasors(record.samples, omega * interval, -0.5 * omega * span)
        wave = wave if all_used else wave[mask]
        design[0] = wave.real
        design[1] = wave.imag
        normal = design @ design.T
        coefficients = np.linalg.solve(normal, design @ channels.T)  # (4, channels)
        residual = channels - coefficients.T @ design
        scale = np.sum(residual**2, axis=1) + 1e-26 * power + np.finfo(float).tiny
        slope = (coefficients[1][:, None] * design[0] - coefficients[0][:, None] * design[1]) * t
        inner = design @ slope.T
        curvature = np.sum(slope**2, axis=1) - np.sum(
            inner * np.linalg.solve(normal, inner), axis=0
        )
        gradient = np.sum(slope * residual, axis=1)  # the residual is orthogonal to the design
        step = np.sum(gradient / scale) / max(
            float(np.sum(curvature / scale)), np.finfo(float).tiny
        )
        step = float(np.clip(step, -np.pi / span, np.pi / span))
        omega += step
        if abs(step) * span < MAX_LAST_STEP_RAD:
            break
    # The phase counts from the middle of the record; amplitudes refer to its first sample.
    amplitudes = (coefficients[0] - 1j * coefficients[1]) * np.exp(-0.5j * omega * span)
    count = max(t.shape[0], 6)
    variances = 2.0 * np.sum(residual**2, axis=1) / (count - 5.0) / count
    if omega < 0:
        omega = -omega
        amplitudes = np.conj(amplitudes)
    return SineFit(float(omega) / (2.0 * np.pi), amplitudes, variances)


def spectral_peak(
    signals: Sequence[FloatArray], mask: BoolArray, rate: float, near: float | None
) -> float:
    """Return the frequency of the interpolated peak of Hann-windowed spectra, Hz.

    Args:
        signals: each of shape (samples,); of several the product of the spectra counts.
        mask: samples that are used, shape (samples,).
        rate: sampling rate, Hz.
        near: frequency in Hz within a factor 1.3 of which the peak is sought; None for any.
    """
    n = mask.size
    size = fast_length(n)
    magnitude = np.ones(size // 2 + 1)
    for signal in signals:
        lines = np.abs(fft.rfft(about_mean(signal, mask) * hann(n), size))
        if np.any(lines):  # a channel at rest has no peak
            magnitude *= lines / np.max(lines)
    bins_hz = np.arange(magnitude.shape[0]) * rate / size
    allowed = bins_hz > 0.25 * rate / n
    if near is not None:
        close = (
            allowed
            & (bins_hz > min(near / 1.3, near - 2 * rate / n))
            & (bins_hz < max(near * 1.3, near + 2 * rate / n))
        )
        allowed = close if close.any() else allowed
    peak = int(np.argmax(np.where(allowed, magnitude, -1.0)))
    shift = 0.0
    if 0 < peak < magnitude.shape[0] - 1 and magnitude[peak] > 0:
        shift = log_peak_shift(magnitude, peak, 1e-300 + 1e-12 * magnitude[peak])
    return float((peak + shift) * rate / size)


def phasors(samples: int, step_rad: float, start_rad: float = 0.0) -> ComplexArray:
    """Return e^{j(start + step k)} for k = 0 … samples − 1, as products of two tables of √samples.

    Args:
        samples: number of samples.
        step_rad: phase from sample to sample.
        start_rad: phase of the first sample.
    """
    width = max(int(np.sqrt(samples)), 1)
    steps = np.exp(1j * step_rad * np.arange(width))
    blocks = np.exp(1j * (start_rad + step_rad * width * np.arange(-(-samples // width))))
    return (blocks[:, None] * steps).ravel()[:samples]
