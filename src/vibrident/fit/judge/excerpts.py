"""Excerpts of the records and their residuals, for pictures."""

from __future__ import annotations

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.data.records.basis import span_of
from vibrident.fit.problem import Evidence
from vibrident.result import Signal

#: Samples of the excerpts of all records together; a picture is some hundreds wide.
MAX_EXCERPT_SAMPLES = 5_000


def excerpts(evidence: Evidence, predicted: tuple[FloatArray, ...]) -> tuple[Signal, ...]:
    """Return a piece of every record: some periods of a sine, the surroundings of a shock, or all.

    Together they have :data:`MAX_EXCERPT_SAMPLES` samples. Samples that took no part in the fit are
    NaN.
    """
    signals = []
    tones = evidence.tones
    max_points = int(np.clip(MAX_EXCERPT_SAMPLES // max(len(predicted), 1), 24, 600))
    hz_by_record = {} if tones is None else dict(zip(tones.record, tones.frequency_hz, strict=True))
    for index, (record, series) in enumerate(zip(evidence.records, predicted, strict=True)):
        takes_part = record.mask & np.isfinite(series)
        used = np.flatnonzero(takes_part)
        if used.size < 2:
            continue
        span_used = span_of(takes_part)
        # A view where no sample between is left out: of a long record each copy counts.
        places = span_used if used.size == span_used.stop - span_used.start else used
        response = record.response[places]
        residual = response - series[places]
        deviation = float(np.std(response))
        rmse = float(np.sqrt(np.mean(residual**2)))
        span = used.size
        if index in hz_by_record:
            span = int(np.clip(3.0 * record.sampling_rate_hz / hz_by_record[index], 16, used.size))
        start = 0
        if record.excitation == "shock":
            peak = int(np.argmax(np.abs(response - np.median(response))))
            span = min(used.size, max(64, used.size // 4))
            start = int(np.clip(peak - span // 3, 0, used.size - span))
        first = int(used[start])
        last = int(used[start + span - 1])
        step = -(-(last - first + 1) // max_points)
        piece = slice(first, last + 1, step)
        measured = np.where(takes_part[piece], record.response[piece], np.nan)
        signals.append(
            Signal(
                record.name,
                first / record.sampling_rate_hz,
                step / record.sampling_rate_hz,
                measured,
                measured - series[piece],
                evidence.calibration.response_unit,
                rmse,
                rmse / deviation if deviation > 0 else 0.0,
            )
        )
    return tuple(signals)
