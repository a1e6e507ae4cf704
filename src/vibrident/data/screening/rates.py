"""Sampling rates of records that differ by rounding alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from vibrident.data.records import Record

#: Samples by which the last sample may move where records take one rate: a rate that was read from
#: rounded time stamps is not known any better.
MAX_SHIFT_SAMPLES = 1e-6


def with_common_rates(records: Sequence[Record]) -> tuple[Record, ...]:
    """Return the records, with one sampling rate where rates differ by less than their rounding.

    Rates read from the time stamps of each file differ in their last digits. Records of one length
    and rate are fitted side by side.
    """
    longest = max((record.samples for record in records), default=0)
    common: dict[float, float] = {}
    rate_hz = 0.0
    for next_hz in sorted({record.sampling_rate_hz for record in records}):
        if (next_hz - rate_hz) * longest > MAX_SHIFT_SAMPLES * next_hz:
            rate_hz = next_hz
        common[next_hz] = rate_hz
    return tuple(
        replace(record, sampling_rate_hz=common[record.sampling_rate_hz])
        if common[record.sampling_rate_hz] != record.sampling_rate_hz
        else record
        for record in records
    )
