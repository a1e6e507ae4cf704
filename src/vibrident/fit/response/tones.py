"""Tones of sine records in both channels, with harmonics, offset, trend and the noise beside them.

Least squares in time at the frequency of the four-parameter fit (IEEE Std 1057-2017, extended to
two channels that share the frequency), so that a record need not hold whole periods and samples may
be missing. The slow remains of a transient can be fitted too where the sensor's poles are known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy import fft
from numpy.typing import NDArray

from vibrident.data.records import FloatArray, Record
from vibrident.data.records.basis import span_of
from vibrident.fit.information import inverse_where_shown
from vibrident.fit.response.noise_lines import MAX_SHORT_SAMPLES, noise_fraction, noise_lines
from vibrident.fit.response.response import ComplexArray, MeasuredResponse
from vibrident.fit.response.rounding import returning_error
from vibrident.fit.response.sine_fit import phasors, sine_fit, tone_frequency
from vibrident.fit.response.terms import (
    MIN_SCALED_EIGENVALUE,
    Exponentials,
    Terms,
    TermTable,
    fitted,
)
from vibrident.fit.response.transform import waves

HARMONICS = 5
#: Where samples are left out, harmonics are fitted if they raise the variance of the tone by at
#: most this factor …
MAX_VARIANCE_FACTOR = 1.3
#: … or if they take from the residual more than this many times what they take from noise.
MIN_HARMONIC_POWER = 10.0
#: Hum is fitted at least this fraction of a line from the tone.
MIN_HUM_DISTANCE_BINS = 0.05


def measure_tones(
    records: Sequence[Record],
    frequencies_hz: Sequence[float] | None = None,
    poles: ComplexArray | None = None,
    measured: Sequence[Record] | None = None,
) -> MeasuredResponse:
    """Return the tones of sine records, with harmonics and the noise beside them.

    Args:
        records: sine records with a reference.
        frequencies_hz: tone frequencies; None estimates them.
        poles: poles of the sensor, 1/s; their free response is then fitted too, in the response
            channel.
        measured: the records as they were measured, where something was subtracted from the
            response.
    """
    frequencies_hz = (
        [tone_frequency(record) for record in records] if frequencies_hz is None else frequencies_hz
    )
    tones = enumerate(zip(records, frequencies_hz, measured or records, strict=True))
    return MeasuredResponse.join(
        [_fit(index, record, f, poles, raw) for index, (record, f, raw) in tones]
    )


def find_tones(records: Sequence[Record]) -> MeasuredResponse:
    """Return frequency and amplitudes of sine records, without harmonics and under white noise.

    They are good for start values; :func:`measure_tones` is the careful measurement.
    """
    tones = []
    for index, record in enumerate(records):
        frequency, amplitude, variance = sine_fit(record)
        # Two noise lines, one of each channel, of twice the variance: their mean is the variance.
        lines = np.diag(np.sqrt(2.0 * variance)).astype(complex)
        tones.append(
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
    return MeasuredResponse.join(tones)


def _fit(
    index: int, record: Record, frequency: float, poles: ComplexArray | None, raw: Record
) -> MeasuredResponse:
    """Return the measured tone of one record.

    Args:
        index: of the record.
        record: as it is fitted.
        frequency: of its tone, Hz.
        poles: poles of the sensor, 1/s; None fits no free response.
        raw: the record as it was measured.
    """
    mask = record.mask
    rate = record.sampling_rate_hz
    terms, number = _terms(record, frequency, poles)
    if not mask.all():
        separable = _separable_terms(number, terms, record, float(mask.sum()))
        terms = terms.only(np.concatenate([separable, np.arange(number, len(terms.gram))]))
        number = len(separable)
    tone_terms = terms.only(np.arange(number))
    span = span_of(mask)
    harmonics = (number - 2) // 2
    count = float(mask.sum())
    fractions = [noise_fraction(channel_terms, mask) for channel_terms in (tone_terms, terms)]
    line_numbers = noise_lines(mask.size, frequency, rate, harmonics, fractions)
    response = _Fit.of(terms, "response", record, raw, frequency, line_numbers)
    # The fit of the reference stays the same, whatever is subtracted from the response.
    reusable = isinstance(tone_terms, Exponentials) and record.reference is raw.reference
    reference_fits = _REFERENCE_FITS.setdefault(raw, {}) if reusable else {}
    key = (frequency, span.start, span.stop, number)
    if key not in reference_fits:
        reference_fits[key] = _Fit.of(tone_terms, "reference", record, raw, frequency, line_numbers)
    fits = reference_fits[key], response
    # White noise of variance σ² has E|line|² = N σ² and gives the real part of the amplitude the
    # variance 2 σ²/N.
    scale = np.sqrt(2.0 * _variance_factor(terms.gram, count)) / max(count, 1.0)
    lines = [
        scale * fit.lines / np.sqrt(fraction[line_numbers])
        for fit, fraction in zip(fits, fractions, strict=True)
    ]
    amplitudes = [fit.amplitudes[:harmonics] for fit in fits]
    distortion = [
        np.sqrt(np.sum(np.abs(a[1:]) ** 2)) / max(float(np.abs(a[0])), 1e-300) for a in amplitudes
    ]
    freedom = max(count - len(terms.gram), 1.0)
    return MeasuredResponse(
        np.array([frequency]),
        amplitudes[0][:1],
        amplitudes[1][:1],
        (line_numbers * rate / mask.size)[None, :],
        lines[0][None, :],
        lines[1][None, :],
        np.ones((1, line_numbers.size)),
        np.array([min(2.0 * line_numbers.size, freedom)]),
        np.array([index]),
        np.array([distortion]),
        np.array([[fit.rounding for fit in fits]]),
    )


@dataclass(frozen=True, eq=False)
class _Fit:
    """Least-squares fit of one channel of a record.

    Attributes:
        amplitudes: complex, those of the harmonics first, shape (terms // 2,).
        lines: of the residual, at the noise lines beside the tone, shape (K,). No window reduces
            what leaks into them from the ends of the record: as much leaks into the tone.
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
        line_numbers: NDArray[np.int_],
    ) -> _Fit:
        """Return the fit of a channel by these terms.

        Args:
            terms: over the span that is used.
            channel: ``"reference"`` or ``"response"``.
            record: as it is fitted.
            raw: the record as it was measured.
            frequency: of the tone, Hz.
            line_numbers: of the noise lines, shape (K,).
        """
        mask = record.mask
        span = span_of(mask)
        values = np.asarray(getattr(record, channel))
        coefficients, residual_in_span = fitted(terms, values[span] * mask[span])
        residual = np.zeros(mask.size)
        residual[span] = residual_in_span
        # a cos ωt + b sin ωt = Re[(a − j b) e^{jωt}]
        pairs = len(coefficients) // 2
        amplitudes = coefficients[0 : 2 * pairs : 2] - 1j * coefficients[1 : 2 * pairs : 2]
        turns = frequency / record.sampling_rate_hz
        rounding = returning_error(
            np.asarray(getattr(raw, channel)), raw.mask, turns, residual[raw.mask]
        )
        return cls(amplitudes, fft.rfft(residual)[line_numbers], rounding)


#: Fits of the reference of records as they were measured, by frequency, span and number of terms.
_REFERENCE_FITS: WeakKeyDictionary[Record, dict[tuple[float, int, int, int], _Fit]] = (
    WeakKeyDictionary()
)


def _hum_places(record: Record, frequency: float) -> FloatArray:
    """Return the places of hum in lines, a little off the tone.

    Hum at the frequency of the tone then makes its amplitude uncertain, instead of halving it.
    """
    places = np.array(record.hum_hz) * record.duration_s
    tone = frequency * record.duration_s
    at_tone = np.abs(places - tone) < MIN_HUM_DISTANCE_BINS
    return np.where(at_tone, tone + MIN_HUM_DISTANCE_BINS, places)


def _terms(record: Record, frequency: float, poles: ComplexArray | None) -> tuple[Terms, int]:
    """Return the terms over the span that is used, and how many belong to the tone.

    The tone has cos hωt and sin hωt for the harmonics below 0.45 of the sampling rate, one and t.
    Terms of the free response and of hum follow.
    """
    mask = record.mask
    rate = record.sampling_rate_hz
    span = span_of(mask)
    last = record.samples - 1
    highest = max(1, min(HARMONICS, int(0.45 * rate / frequency), int(last / 16)))
    lasting = free_exponents(poles, rate)
    tone = 2j * np.pi * frequency / rate * np.arange(1, highest + 1)
    exponents = np.concatenate([tone, lasting]).astype(complex)
    count = len(exponents)
    # A trend resembles part of a sine of only one or two periods.
    trend = np.arange(span.start, span.stop) / last - 0.5
    trend = trend if frequency * last / rate >= 3.0 else np.zeros_like(trend)
    pairs = np.stack([np.arange(count), count + np.arange(count)], axis=1)
    oscillates = np.ravel(
        [[True, exponent.imag > 1e-9 * abs(exponent)] for exponent in lasting]
    ).astype(bool)
    free = pairs[highest:].ravel()[oscillates]
    order = np.concatenate([pairs[:highest].ravel(), [2 * count, 2 * count + 1], free])
    # The geometric sums of slower exponentials cancel.
    fast = bool(np.all(np.abs(exponents) * trend.size > 1.0))
    if record.samples > MAX_SHORT_SAMPLES and fast and not record.hum_hz and mask[span].all():
        return Exponentials.of(exponents, span.start, trend, order), 2 * highest + 2
    exponentials = np.array(
        [phasors(record.samples, e.imag) for e in exponents[:highest]]
        + [np.exp(e * np.arange(record.samples)) for e in lasting]
    )[:, span]
    rows = np.concatenate(
        [exponentials.real, exponentials.imag, np.ones((1, trend.size)), trend[None]]
    )[order]
    if record.hum_hz:
        hum = waves(_hum_places(record, frequency), record.samples)
        rows = np.concatenate([rows, hum[:, span]])
    return TermTable.of(rows * mask[span]), 2 * highest + 2


def free_exponents(poles: ComplexArray | None, rate_hz: float) -> ComplexArray:
    """Return the exponents of the free response per sample, one of each pair, shape (q,).

    The free response of a fast pole may be as large as the tone in the first sample. Poles whose
    response is below rounding in the second sample are left out.

    Args:
        poles: of the sensor, 1/s; those that are not stable are left out. None for none.
        rate_hz: sampling rate.
    """
    exponents: ComplexArray = (
        np.zeros(0, dtype=complex) if poles is None else np.asarray(poles / rate_hz, dtype=complex)
    )
    decay = exponents.real
    lasts = (exponents.imag >= 0.0) & (decay < 0.0) & (decay > np.log(np.finfo(float).eps))
    return exponents[lasts]


def _separable_terms(number: int, terms: Terms, record: Record, count: float) -> NDArray[np.int_]:
    """Return the tone's terms without harmonics that omitted samples make inseparable from it.

    Where tops are cut off, the tone and its harmonics look alike: the variance of the tone's
    amplitude is 2 σ²/N times a factor that grows with the harmonics. Harmonics that are significant
    in either channel always stay, as the tone would be biased without them.

    Args:
        number: of terms of the tone, the last two being offset and trend.
        terms: of the fit, those of the tone first.
        record: with samples left out.
        count: of samples that are used.

    Returns:
        Indices into the terms.
    """
    rows = np.arange(number)
    span = span_of(record.mask)
    offset = rows[-2:]
    limit = MAX_VARIANCE_FACTOR * _variance_factor(
        terms.only(np.concatenate([rows[:2], offset])).gram, count
    )
    for highest in range((number - 2) // 2, 0, -1):
        reduced = np.concatenate([rows[: 2 * highest], offset])
        if _variance_factor(terms.only(reduced).gram, count) > limit and highest > 1:
            continue
        if (dropped := number - reduced.size) == 0:
            return rows
        channels = [
            np.asarray(c)[span] * record.mask[span] for c in (record.reference, record.response)
        ]
        full_squares, reduced_squares = (
            np.array([np.sum(fitted(terms.only(indices), c)[1] ** 2) for c in channels])
            for indices in (rows, reduced)
        )
        factor = 1.0 + MIN_HARMONIC_POWER * dropped / count
        return rows if np.any(reduced_squares > full_squares * factor) else reduced
    return rows


def _variance_factor(gram: FloatArray, count: float) -> float:
    """Return the variance of the tone's amplitude over that of a long record, at the worst phase.

    Gaps, few periods, and a free response near its frequency make the tone hard to separate from
    other terms.

    Args:
        gram: products of the rows of the design over the samples used, the tone's own two first.
        count: of these samples.
    """
    covariance = inverse_where_shown(gram, MIN_SCALED_EIGENVALUE)[:2, :2]
    largest = 0.5 * (covariance[0, 0] + covariance[1, 1]) + float(
        np.hypot(0.5 * (covariance[0, 0] - covariance[1, 1]), covariance[0, 1])
    )
    return max(largest * count / 2.0, 1.0)
