"""Records made ready for bands: both channels through one filter that makes the response white, and moved together.

The ratio of the channels stays, whatever the filter. A response is whitened by the error of its prediction from its own
last samples. Free motion of a linear sensor is predicted exactly, as it obeys the same recursion, and so drops out of
a filter that has learnt the sensor's poles; what is left is as strong at high frequencies as at low ones and leaks
little (prewhitening; Jenkins & Watts, Spectral Analysis, 1968, sec. 8.2.2).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_below
from vibrident.data.records import FloatArray, Record
from vibrident.fit.response.response import LEAST_DEVIATION
from vibrident.fit.response.transform import about_mean, power_of, transforms

#: Samples that predict the next: two for each mode of a sensor with two, one for a high-pass, the rest for the motion.
ORDER = 8
#: Fewer samples for each coefficient do not tell the filter.
FEWEST_FOR_EACH = 20
#: A response that comes so many samples late turns its phase within a band, and is moved back.
LATE = 4
#: Frequencies below this part of the largest power hardly count in the impulse response.
WHITENED = 1e-3
#: Of its peaks of at least this part of the highest the nearest is taken: a motion that repeats has several.
FIRST_PEAK = 0.9
#: A longer record is looked at in parts: no response comes so many samples late.
LONGEST = 1 << 18
#: A record that is filtered or moved loses at most this part at its end, for a length that transforms fast.
MOST_CUT = 0.01
TINY = float(np.finfo(float).tiny)


def whitened(record: Record) -> Record | None:
    """The record with both channels filtered, shorter by the filter; None where too few samples are valid."""
    assert record.reference is not None
    used = record.mask & record.reference_mask
    if used.sum() < FEWEST_FOR_EACH * ORDER:
        return None
    response, reference = about_mean(record.response, used), about_mean(record.reference, used)
    coefficients = prediction_error(response)
    known = np.convolve(~used, np.ones(ORDER + 1))[ORDER : record.samples] < 0.5
    if known.sum() < FEWEST_FOR_EACH * ORDER:
        return None
    kept = slice(0, fast_below(known.size, MOST_CUT))
    reference, response = (
        np.convolve(v, coefficients, mode="valid")[kept] for v in (reference, response)
    )
    return replace(
        record, reference=reference, response=response, valid=known[kept], reference_valid=None
    )


def prediction_error(values: FloatArray) -> FloatArray:
    """The filter of least error in the next sample, the first coefficient one, shape (ORDER + 1,).

    Args:
        values: of zero mean, zero where they are not known, shape (samples,).
    """
    n = values.size
    moments, last = np.empty((ORDER + 1, ORDER + 1)), values[ORDER:]
    moments[0] = [float(last @ values[ORDER - lag : n - lag]) for lag in range(ORDER + 1)]
    moments[:, 0] = moments[0]
    for lag in range(ORDER):  # one sample earlier: one more at the beginning, one less at the end
        first, end = values[ORDER - 1 :: -1], values[: n - ORDER - 1 : -1]
        moments[lag + 1, 1:] = moments[lag, :-1] + first[lag] * first - end[lag] * end
    least = LEAST_DEVIATION**2 * max(float(moments[0, 0]), TINY)
    return np.concatenate(
        [[1.0], -np.linalg.solve(moments[1:, 1:] + least * np.eye(ORDER), moments[1:, 0])]
    )


def bulk_delay(records: Iterable[Record | None], samples: int) -> int:
    """Samples by which responses come later than the motion: the peak of the impulse response of all records together.

    Zero where it is too small to matter: the phase then hardly turns within a band.

    Args:
        records: of one sampling rate, with a reference that is level as an acceleration is; None is passed over.
        samples: at least as many as the longest record has.
    """
    size = 1 << (2 * min(samples, LONGEST) - 1).bit_length()
    cross, power = np.zeros(size // 2 + 1, complex), np.zeros(size // 2 + 1)
    for record in records:
        if record is None or not record.mask.any() or not record.reference_mask.any():
            continue
        assert record.reference is not None
        channels = (record.reference, record.reference_mask), (record.response, record.mask)
        series = [about_mean(*channel) for channel in channels]
        # Each over its size, so that one large record does not decide.
        scale = [1.0 / max(float(np.std(v)), TINY) for v in series]
        for begin in range(0, record.samples, LONGEST):
            part = slice(begin, begin + LONGEST)
            padded = np.zeros((2, size))
            for row, values, factor in zip(padded, series, scale, strict=True):
                np.multiply(values[part], factor, out=row[: values[part].size])
            x, y = transforms(padded)
            power += power_of(x)
            np.conj(x, out=x)
            x *= y
            cross += x
    impulse = np.abs(np.asarray(fft.irfft(cross / (power + WHITENED * np.max(power) + TINY), size)))
    lags = np.arange(size)
    lags = np.where(lags < size // 2, lags, lags - size)
    high = (impulse >= FIRST_PEAK * np.max(impulse)) & (np.abs(lags) <= samples // 2)
    lag = int(lags[high][np.argmin(np.abs(lags[high]))]) if np.any(high) else 0
    return lag if abs(lag) >= LATE else 0


def aligned(record: Record, late: int) -> Record:
    """The record with its response moved back by so many samples; samples without a counterpart are cut off."""
    if late == 0:
        return record
    assert record.reference is not None
    n = fast_below(record.samples - abs(late), MOST_CUT)
    first, second = slice(max(-late, 0), max(-late, 0) + n), slice(max(late, 0), max(late, 0) + n)
    return replace(
        record,
        reference=record.reference[first],
        response=record.response[second],
        valid=record.mask[second] & record.reference_mask[first],
        reference_valid=None,
    )
