"""Whitening and alignment of both channels of a record, before its bands are measured.

One filter whitens the response and is applied to both channels, whose ratio stays, whatever the
filter. A response is whitened by the error of its prediction from its last samples. Free motion of
a linear sensor is predicted exactly, as it obeys the same recursion, and so drops out of a filter
that has learnt the sensor's poles; the remainder is as strong at high frequencies as at low ones
and leaks little (prewhitening; Jenkins & Watts, Spectral Analysis, 1968, sec. 8.2.2).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_below
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.fit.response.response import MIN_RELATIVE_DEVIATION
from vibrident.fit.response.transform import about_mean, power_of, transforms

#: Number of samples that predict the next: two for each mode of a sensor with two, one for a
#: high-pass, the rest for the motion.
ORDER = 8
#: Fewest samples for each coefficient of the filter.
MIN_SAMPLES_PER_COEFFICIENT = 20
#: A response at least so many samples late turns its phase within a band, and is moved back.
MIN_DELAY_SAMPLES = 4
#: Frequencies below this fraction of the largest power hardly count in the impulse response.
POWER_FLOOR = 1e-3
#: Of the peaks of at least this fraction of the highest the nearest is taken: a motion that repeats
#: has several.
MIN_RELATIVE_PEAK = 0.9
#: A longer record is analysed in blocks: no response comes so many samples late.
BLOCK_SAMPLES = 1 << 18
TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True, eq=False)
class Channels:
    """Both channels of a record, and which of their samples are used, each of shape (samples,).

    Attributes:
        reference: as measured, or filtered.
        response: likewise.
        used: samples that are used.
        reference_used: samples of the reference that are used as input.
        rate_hz: sampling rate.
        is_shock: whether the motion is a shock.
    """

    reference: FloatArray
    response: FloatArray
    used: BoolArray
    reference_used: BoolArray
    rate_hz: float
    is_shock: bool

    @classmethod
    def from_record(cls, record: Record) -> Channels:
        """Return the channels of a record with a reference."""
        assert record.reference is not None
        is_shock = record.excitation == "shock"
        masks = record.mask, record.reference_mask
        return cls(record.reference, record.response, *masks, record.sampling_rate_hz, is_shock)

    @property
    def samples(self) -> int:
        """Return the number of samples."""
        return self.used.size

    def changed(self, reference: FloatArray, response: FloatArray, used: BoolArray) -> Channels:
        """Return other samples of the same motion."""
        return replace(self, reference=reference, response=response, used=used, reference_used=used)


def whitened(channels: Channels) -> Channels | None:
    """Return both channels filtered, or None where too few samples are valid.

    The filter takes ORDER samples from their length.
    """
    used = channels.used & channels.reference_used
    if np.count_nonzero(used) < MIN_SAMPLES_PER_COEFFICIENT * ORDER:
        return None
    response = about_mean(channels.response, used)
    reference = about_mean(channels.reference, used)
    coefficients = prediction_error(response)
    valid = np.convolve(~used, np.ones(ORDER + 1))[ORDER : channels.samples] < 0.5
    if np.count_nonzero(valid) < MIN_SAMPLES_PER_COEFFICIENT * ORDER:
        return None
    selection = slice(0, fast_below(valid.size))
    reference, response = (
        np.convolve(v, coefficients, mode="valid")[selection] for v in (reference, response)
    )
    return channels.changed(reference, response, valid[selection])


def prediction_error(values: FloatArray) -> FloatArray:
    """Return the filter of least error in predicting the next sample, shape (ORDER + 1,).

    Its first coefficient is one.

    Args:
        values: of zero mean, zero where they are not known, shape (samples,).
    """
    n = values.size
    moments = np.empty((ORDER + 1, ORDER + 1))
    predicted = values[ORDER:]
    moments[0] = [float(predicted @ values[ORDER - lag : n - lag]) for lag in range(ORDER + 1)]
    moments[:, 0] = moments[0]
    for lag in range(ORDER):  # one sample earlier: one more at the beginning, one less at the end
        first = values[ORDER - 1 :: -1]
        end = values[: n - ORDER - 1 : -1]
        moments[lag + 1, 1:] = moments[lag, :-1] + first[lag] * first - end[lag] * end
    floor = MIN_RELATIVE_DEVIATION**2 * max(float(moments[0, 0]), TINY)
    return np.concatenate(
        [[1.0], -np.linalg.solve(moments[1:, 1:] + floor * np.eye(ORDER), moments[1:, 0])]
    )


def bulk_delay(records: Iterable[Channels | None], samples: int) -> int:
    """Return by how many samples the responses of all records together are late.

    It is the peak of their impulse response; 0 where it is too small to matter, as the phase then
    hardly turns within a band.

    Args:
        records: of one sampling rate, with a reference that is level as an acceleration is; None is
            left out.
        samples: at least as many as the longest record has.
    """
    size = 1 << (2 * min(samples, BLOCK_SAMPLES) - 1).bit_length()
    cross = np.zeros(size // 2 + 1, complex)
    power = np.zeros(size // 2 + 1)
    for record in records:
        if record is None or not record.used.any() or not record.reference_used.any():
            continue
        channels = (record.reference, record.reference_used), (record.response, record.used)
        series = [about_mean(*channel) for channel in channels]
        # Scaled, so that one large record does not decide.
        scale = [1.0 / max(float(np.sqrt(v @ v / v.size)), TINY) for v in series]
        for begin in range(0, record.samples, BLOCK_SAMPLES):
            block = slice(begin, begin + BLOCK_SAMPLES)
            padded = np.zeros((2, size))
            for row, values, factor in zip(padded, series, scale, strict=True):
                np.multiply(values[block], factor, out=row[: values[block].size])
            x, y = transforms(padded)
            power += power_of(x)
            np.conj(x, out=x)
            x *= y
            cross += x
    impulse = np.abs(
        np.asarray(fft.irfft(cross / (power + POWER_FLOOR * np.max(power) + TINY), size))
    )
    lags = np.arange(size)
    lags = np.where(lags < size // 2, lags, lags - size)
    high = (impulse >= MIN_RELATIVE_PEAK * np.max(impulse)) & (np.abs(lags) <= samples // 2)
    lag = int(lags[high][np.argmin(np.abs(lags[high]))]) if np.any(high) else 0
    return lag if abs(lag) >= MIN_DELAY_SAMPLES else 0


def aligned(channels: Channels, delay: int) -> Channels:
    """Return the channels with the response moved back by ``delay`` samples.

    Samples without a counterpart are cut off.
    """
    if delay == 0:
        return channels
    n = fast_below(channels.samples - abs(delay))
    in_reference = slice(max(-delay, 0), max(-delay, 0) + n)
    in_response = slice(max(delay, 0), max(delay, 0) + n)
    return channels.changed(
        channels.reference[in_reference],
        channels.response[in_response],
        channels.used[in_response] & channels.reference_used[in_reference],
    )
