"""A trend of the response that no motion explains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import fft

from vibrident.measure.quality import Finding
from vibrident.records import FloatArray, Record

#: Slow lines that tell how far noise alone may wander.
LINES = 8
#: A drift counts beyond this many standard deviations of what those lines allow, and above this part of the
#: response's standard deviation.
SIGNIFICANT, LEAST = 8.0, 0.02
#: Samples of the shortest record that is looked at.
FEWEST = 64


def without_drift(
    records: Sequence[Record], predicted: Sequence[FloatArray]
) -> tuple[tuple[Record, ...], tuple[Finding, ...]]:
    """The records with the drift of their response taken out, and which ones had any.

    Args:
        records: the records.
        predicted: response that a model predicts for each, shape (samples,), NaN where there is none.
    """
    kept, findings = [], []
    for record, series in zip(records, predicted, strict=True):
        used = record.mask & np.isfinite(series)
        if used.sum() < FEWEST:
            kept.append(record)
            continue
        residual = (record.response - series)[used]
        size = float(np.std(record.response[used]))
        rise, deviation = _trend(residual, record.time_s[used])
        duration = float(np.ptp(record.time_s[used]))
        if abs(rise) * duration <= max(SIGNIFICANT * deviation * duration, LEAST * size):
            kept.append(record)
            continue
        drift = rise * (record.time_s - np.mean(record.time_s[used]))
        kept.append(record.with_response(record.response - drift, f"drift of {rise * duration:.6g} removed"))
        text = (
            f"{record.name}: the response drifts by {rise * duration:.3g} over the record, "
            f"{100 * abs(rise) * duration / size:.2g} % of its rms, which the motion does not explain; a straight line "
            "was taken out."
        )
        findings.append(Finding("drift", text))
    return tuple(kept), tuple(findings)


def _trend(residual: FloatArray, times: FloatArray) -> tuple[float, float]:
    """Slope by least squares, 1/s, and its standard deviation for noise as strong as the slowest lines."""
    n = residual.shape[0]
    t = times - times.mean()
    slope = float(residual @ t / (t @ t))
    left = residual - residual.mean() - slope * t
    window = np.hanning(n)
    lines = np.asarray(fft.rfft(left * window))[2 : 2 + LINES]
    level = float(np.mean(np.abs(lines) ** 2) / np.sum(window**2))
    return slope, float(np.sqrt(level / (t @ t)))
