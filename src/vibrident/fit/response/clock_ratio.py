"""The ratio of the clocks of two devices, where it is so far from one that no model fits.

The response is read at instants t(1 + ε). At the clock of the reference a rational transfer
function explains it (Sanathanan & Koerner 1963), of an order that suffices for any sensor and a
short delay; at another clock it is almost uncorrelated with the reference. So ε is where that
function, fitted to the windowed bins of all records together, leaves the smallest residual. This
valley is as wide as the inverse of the periods in a record: the search begins in the first samples,
where it is wide, and follows it as their number doubles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vibrident.data.records import Record
from vibrident.data.resampling import margin_samples, resampled
from vibrident.fit.response.clock_search import (
    FIRST_ORDER,
    LAST_SAMPLES,
    MAX_OFFSET,
    MAX_ORDER,
    ClockSearch,
)

DELAY_ORDER = 2  # of a rational function for what remains of a delay (Padé)
MAX_PERIODS = 8  # by which a transfer function may stand in for two clocks
MAX_CANDIDATES = 256  # of valleys that look alike, as in the first of several shocks
# Unexplained fraction above which no step of a search is in a valley: half a width from a bottom a
# seventh is lost, and a bottom that counts leaves a quarter at most (MIN_GAIN).
MAX_IN_VALLEY = 0.6
MIN_SAMPLES = 8  # of a response at another clock; with fewer the record keeps its clock


def clock_offset(records: Sequence[Record]) -> float:
    """Return ε, by which intervals of the response exceed those of the reference.

    It is 0 where another clock explains little more.
    """
    search = ClockSearch.from_records(records, MAX_ORDER, MAX_ORDER, delayed=True)
    if not search.driven or search.unexplained(0.0, LAST_SAMPLES, FIRST_ORDER) < FIRST_ORDER:
        return 0.0
    longest = max(channels.samples for channels in search.driven)
    samples = search.begin()
    if search.valley(max(longest, samples)) > MAX_OFFSET:  # too few periods to tell the ratio by
        return 0.0
    candidates = np.zeros(1)
    is_near = search.unexplained(0.0, samples) < FIRST_ORDER
    reach = search.valley(samples) if is_near else MAX_OFFSET
    while True:
        width = search.valley(samples)
        steps = np.arange(-np.ceil(reach / width), np.ceil(reach / width) + 1) * width
        offsets = np.unique(np.round((candidates[:, None] + steps) / width)) * width
        offsets = np.unique(np.clip(offsets, -MAX_OFFSET, MAX_OFFSET))
        unexplained = np.array([search.unexplained(offset, samples) for offset in offsets])
        order = np.argsort(unexplained)[:MAX_CANDIDATES]
        least = unexplained[order[0]]
        if least > MAX_IN_VALLEY:
            return 0.0
        candidates = offsets[order[unexplained[order] < max(2.0 * least, 0.5)]]
        if samples >= min(longest, LAST_SAMPLES):
            return search.bottom(float(offsets[order[0]]), width, samples)
        reach = width
        samples *= 2


def nearby_offset(records: Sequence[Record], poles: int, zeros: int, *, delayed: bool) -> float:
    """Return ε near zero by a transfer function of a model's order; 0 where it explains little.

    In a sweep a higher order imitates a ratio of the clocks, up to some periods. A delay is as much
    as half of ε on average: it is 0, too, where one clock and a delay explain more.

    Args:
        records: with a reference.
        poles: of the model.
        zeros: likewise.
        delayed: whether the model has a delay.
    """
    search_of_delayed = ClockSearch.from_records(
        records, poles + DELAY_ORDER, zeros + DELAY_ORDER, delayed=True
    )
    search = search_of_delayed
    if not delayed:
        search = ClockSearch.from_records(records, poles, zeros, delayed=False)
    if not search.driven:
        return 0.0
    width = min(
        0.5 * search.valley(LAST_SAMPLES), MAX_OFFSET
    )  # a wide valley of few periods is cut
    offsets = width * np.arange(-2 * MAX_PERIODS, 2 * MAX_PERIODS + 1)
    offsets = offsets[np.abs(offsets) <= MAX_OFFSET]
    unexplained = [search.unexplained(offset, LAST_SAMPLES) for offset in offsets]
    offset = search.bottom(float(offsets[int(np.argmin(unexplained))]), width, LAST_SAMPLES)
    if offset == 0.0 or delayed:
        return offset
    by_offset = search.unexplained(offset, LAST_SAMPLES)
    return offset if by_offset < search_of_delayed.unexplained(0.0, LAST_SAMPLES) else 0.0


def at_reference_clock(record: Record, offset: float) -> Record:
    """Return a record with its response brought to the clock of the reference.

    Args:
        record: its response is read at intervals 1 + ``offset`` times those of the reference.
        offset: ε.

    Returns:
        The record; unchanged where it would keep fewer than ``MIN_SAMPLES`` samples.
    """
    if record.reference is None or offset == 0.0:
        return record
    reach = margin_samples(1.0)
    n = record.samples
    first = int(np.ceil(reach * (1.0 + offset)))
    last = min(n, int(np.floor((n - 1 - reach) * (1.0 + offset))) + 1)
    positions = np.arange(first, last) / (1.0 + offset)
    invalid_count = np.concatenate([[0], np.cumsum(~record.mask)])
    near = np.floor(positions).astype(int)
    valid = (
        invalid_count[np.minimum(near + reach + 1, n)] == invalid_count[np.maximum(near - reach, 0)]
    )
    if np.count_nonzero(valid) < MIN_SAMPLES:
        return record
    reference_valid = None
    if record.reference_valid is not None or not record.mask.all():
        reference_valid = record.reference_mask[first:last]
    note = f"response brought to the clock of the reference, by {offset:.6g}"
    return replace(
        record,
        reference=record.reference[first:last],
        response=resampled(record.response, positions, 1.0),
        valid=valid,
        reference_valid=reference_valid,
        start_time_s=record.start_time_s + first / record.sampling_rate_hz,
        provenance=record.provenance.then(note),
    )
