"""Uncertainty of a compensated acceleration by origin, and the samples that cannot be restored.

The uncertainty has these origins, each a series over the samples:

- noise: of the response, with its spectrum, through the filter;
- model: the covariance of the parameters through ∂â/∂θ, with their correlation; the stated
  uncertainty of the known response of the channel; and, of a model
  that its calibration rejected, a relative error as large as its deviations from the measured
  points;
- band: what the low-pass removes: at each instant the highest octave kept, scaled by the ratio of
  the spectrum beyond the band to that octave's (an envelope where noise hides the spectrum);
- offset: of the response, from a rest before the motion, and of its integral after samples that
  were left out;
- ends: error of the record's continuation beyond its ends;
- background: acceleration at rest beyond these (hum, drift, a shifted zero).
"""

from __future__ import annotations

import numpy as np

from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.use.correction.band import LOBE_OCTAVES, AccelerationSpectrum, top_octave
from vibrident.use.correction.compensation import Compensation
from vibrident.use.correction.quiet import gap_sum_deviation

#: Window over which the highest octave's power is averaged, in periods of the band's upper edge.
LOCAL_PERIODS = 2.0
MIN_POWER_OVER_NOISE = 6.0  # of a removed part that counts, in mean square


def uncertainty_components(
    values: FloatArray,
    mask: BoolArray,
    spectrum: np.ndarray,
    compensation: Compensation,
    content: AccelerationSpectrum,
) -> dict[str, FloatArray]:
    """Return the standard uncertainty of every sample by origin."""
    slopes = compensation.restored(spectrum, compensation.slopes)
    baseline = compensation.baseline
    variance = np.einsum(
        "ik,ij,jk->k", slopes, compensation.chain.covariance, slopes, optimize=True
    )
    if baseline.offset_uncertainty > 0:
        constant = compensation.restored(compensation.spectrum(np.ones_like(values)))
        offset = np.abs(constant) * baseline.offset_uncertainty
    else:
        offset = np.zeros(values.size)
    if compensation.integrations == 1 and not mask.all():
        later = np.abs(compensation.after_integration[0]) / compensation.rate
        offset = np.hypot(offset, later * gap_sum_deviation(values, mask))
    return {
        "noise": compensation.noise_deviation,
        "model": np.hypot(
            np.sqrt(np.maximum(variance, 0.0)), _misfit_deviation(spectrum, compensation)
        ),
        "band": removed_deviation(spectrum, compensation, content),
        "offset": offset,
        "ends": compensation.end_deviation(values),
    }


def _misfit_deviation(spectrum: np.ndarray, compensation: Compensation) -> FloatArray:
    """Return the standard uncertainty by the misfit of a rejected model, shape (samples,).

    It is that part of the motion nearby.
    """
    values = compensation.restored(spectrum)
    width = max(1, round(LOCAL_PERIODS * compensation.rate / compensation.band.high_hz))
    nearby = np.sqrt(np.maximum(_running_mean(values**2, width), 0.0))
    return compensation.chain.sensor.misfit * np.maximum(np.abs(values), nearby)


def removed_deviation(
    spectrum: np.ndarray, compensation: Compensation, content: AccelerationSpectrum
) -> FloatArray:
    """Return the standard uncertainty by what the band's edges removed, shape (samples,)."""
    band = compensation.band
    baseline = compensation.baseline
    gain = top_octave(compensation.frequency_hz, band)
    ratio = np.where(
        compensation.lowpass > 0,
        gain / np.where(compensation.lowpass > 0, compensation.lowpass, 1.0),
        0,
    )
    octave = compensation.restored(spectrum, compensation.after_integration * ratio)
    width = max(1, round(LOCAL_PERIODS * compensation.rate / band.high_hz))
    noise = compensation.line_mean(
        np.abs(compensation.total * ratio) ** 2 * baseline.noise(compensation.frequency_hz)
    )
    nearby = _running_mean(octave**2, width) - noise
    if baseline.rest_samples > 0:  # at the corners of a pulse it is larger than nearby
        turned = compensation.restored(spectrum, -1j * compensation.after_integration * ratio)
        nearby = np.maximum(nearby, 0.5 * (octave**2 + turned**2) - noise)
    local = content.ratio(band) ** 2 * np.maximum(nearby, 0.0)
    lowest = 0.5 * band.low_hz
    highest = content.frequency_hz[-1]
    if content.has_motion.any():
        # A removed part may stand above the noise: the end of a sweep.
        highest = min(highest, 2.0**LOBE_OCTAVES * content.frequency_hz[content.has_motion][-1])
        local = np.maximum(
            local, _removed_power(spectrum, compensation, (band.high_hz, highest), width)
        )
    if lowest > 0:
        period = max(1, round(compensation.rate / band.low_hz))
        local = local + _removed_power(spectrum, compensation, (lowest, band.low_hz), period)
    below = content.frequency_hz < band.low_hz
    lost = (
        (1.0 - band.passed(content.frequency_hz[below])) ** 2
        * content.acceleration[below]
        * content.lines[below]
    )
    return np.sqrt(local + np.sum(lost) / content.event)


def _removed_power(
    spectrum: np.ndarray, compensation: Compensation, edges: tuple[float, float], width: int
) -> FloatArray:
    """Return the mean square nearby of what is removed between two frequencies, shape (samples,).

    It is zero where it does not exceed the noise.
    """
    frequency = compensation.frequency_hz
    inside = (frequency > edges[0]) & (frequency <= edges[1])
    gain = np.zeros(frequency.shape, dtype=complex)
    gain[inside] = (1.0 - compensation.lowpass[inside]) / compensation.chain.frequency_response(
        frequency[inside]
    )
    noise = compensation.line_mean(np.abs(gain) ** 2 * compensation.baseline.noise(frequency))
    power = _running_mean(compensation.restored(spectrum, gain * compensation.rule) ** 2, width)
    return np.where(power > MIN_POWER_OVER_NOISE * noise, power, 0.0)


def _running_mean(values: FloatArray, width: int) -> FloatArray:
    """Return the mean of ``width`` values about each, the end values repeated."""
    total = np.cumsum(np.pad(values, (width // 2 + 1, width - 1 - width // 2), "edge"))
    return (total[width:] - total[:-width]) / width


def unknown_samples(record: Record, compensation: Compensation) -> BoolArray:
    """Return the samples that cannot be restored.

    Invalid samples lie within the filter's reach of them. All later ones are unknown too if the
    response is integrated twice, or over a gap that is not short.
    """
    bad = ~record.mask
    if not bad.any():
        return bad
    reach = max(1, compensation.reach)
    count = np.cumsum(np.pad(bad, (reach + 1, reach)))
    unknown = count[2 * reach + 1 :] > count[: -2 * reach - 1]
    if compensation.integrations:
        lost = (
            bad
            if compensation.integrations > 1
            else ~np.isfinite(gap_sum_deviation(record.response, record.mask))
        )
        unknown |= np.cumsum(lost) > 0
    return np.asarray(unknown, dtype=bool)
