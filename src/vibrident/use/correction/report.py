"""Document of a correction: the plain values of ``correction.json``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from vibrident.base.fields import Fields
from vibrident.use.correction.acceleration import ORIGINS, Correction, Corrections


def correction_document(corrections: Corrections, files: Sequence[str]) -> Fields:
    """Return the plain values of ``correction.json``.

    ``corrections``: of :func:`correct`; ``files``: name of each correction's file.
    """
    return {
        "model": corrections.model,
        "unit": corrections.unit,
        "records": [_row(c, file) for c, file in zip(corrections.corrections, files, strict=True)],
        "uncertainty_covers": list(ORIGINS),
        "findings": [{"code": f.code, "message": f.message} for f in corrections.findings],
    }


def _row(correction: Correction, file: str) -> Fields:
    baseline = correction.baseline
    peak = correction.peak
    finite = np.isfinite(correction.acceleration)
    typical = {
        name: float(np.median(series[finite])) if finite.any() else None
        for name, series in correction.components.items()
    }
    return {
        "name": correction.record.name,
        "file": file,
        "samples": correction.record.samples,
        "samples_unknown": int(np.sum(~finite)),
        "band": {
            "low_hz": correction.band.low_hz,
            "high_hz": correction.band.high_hz,
            "zero_from_hz": correction.band.stop_hz,
            "chosen": correction.band.reason,
            "integrated_from_rest": correction.integrated_from_rest,
            "largest_removed": correction.bound,
        },
        "noise": {
            "assumption": baseline.noise_from,
            "standard_deviation": baseline.noise_deviation,
            "offset": baseline.offset,
            "offset_standard_uncertainty": baseline.offset_uncertainty,
            "offset_from": baseline.offset_from,
            "samples_at_rest": baseline.rest_samples,
        },
        "median_standard_uncertainty": typical,
        "peak": None
        if peak is None
        else {
            **asdict(peak),
            "time_s": correction.record.start_time_s + peak.time_s,
            "interval_95": list(peak.interval_95),
            "components": dict(peak.components),
        },
        "reference": None if correction.agreement is None else asdict(correction.agreement),
    }
