"""The records of a calibration, one after the other."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.io.reading import read_guarded
from vibrident.data.io.sampling import SAME_RATE
from vibrident.data.known import refuse_known
from vibrident.data.records import Calibration
from vibrident.data.sources.source import Chunk, Source, SourceRequest


def chunks_of(calibration: Calibration) -> Iterator[Chunk]:
    """Yield each record as a chunk of its own.

    Raises:
        InputError: a record lacks a reference, or the sampling rates differ.
    """
    remaining = {name: chain.shapes for name, chain in calibration.known_responses.items()}
    refuse_known(remaining, "Tracking", calibration.source or "calibration in memory")
    rates = {record.sampling_rate_hz for record in calibration.records}
    apart = not rates or max(rates) / min(rates) - 1.0 > SAME_RATE
    if apart or any(record.reference is None for record in calibration.records):
        raise InputError(
            "These records cannot be tracked one after the other.",
            expected="records of one sampling rate, each with a reference",
            found=f"{len(rates)} sampling rates" if rates else "a table",
            where=calibration.source or "calibration in memory",
            remedy="leave the others out, or track them by themselves",
        )
    for record in calibration.records:
        assert record.reference is not None  # checked above
        overdriven = np.abs(record.response) >= (record.response_full_scale or np.inf)
        response = np.where(record.mask & ~overdriven, record.response, np.nan)
        reference = np.where(record.reference_mask, record.reference, np.nan)
        yield Chunk(
            reference,
            response,
            record.start_time_s,
            separate=True,
            sine=record.excitation == "sine",
        )


def _open(request: SourceRequest) -> Iterator[Chunk]:
    return chunks_of(read_guarded(request.file))


CALIBRATION_RECORDS = Source("calibration-records", "the records of the calibration file", _open)
