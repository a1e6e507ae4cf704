"""Bring both channels of a record to one even raster, by the clocks that their files state.

A whole number of samples between two clocks is cut; a fraction, another rate and uneven stamps are
resampled, band-limited. The record's history states the resulting limits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.io.clocks import ChannelClock, is_same_rate
from vibrident.data.io.columns import StartTime
from vibrident.data.io.header_units import SourceColumn
from vibrident.data.io.sampling import ROUNDING_SAMPLES, cut, first_sample_at
from vibrident.data.io.timeline import Timeline
from vibrident.data.records import BoolArray, FloatArray
from vibrident.data.records.basis import runs_of_true
from vibrident.data.records.record import MIN_SAMPLES

REPAIR = "repair the file, or leave that part out with start_s / stop_s"
_START_ROUNDING_S = 2e-9  # of the difference of two starts, in whole nanoseconds each


@dataclass(frozen=True, eq=False)
class ClockedChannel:
    """Column of a file and its clock.

    Attributes:
        column: of the file.
        values: shape (samples,), as in the file.
        clock: of the samples.
        first: sample of the column that ``values`` begin with.
    """

    column: SourceColumn
    values: FloatArray
    clock: ChannelClock
    first: int = 0

    @property
    def rate_hz(self) -> float:
        """Return the samples per second."""
        return self.clock.clock.rate_hz

    def require_finite(self, rows: slice) -> None:
        """Refuse a value of these rows that is missing, NaN or infinite, with its place."""
        first = self.first + rows.start
        source = self.column.source
        source.require_finite(self.column.position, self.values[rows], first, REPAIR)


@dataclass(frozen=True, eq=False)
class AlignedChannels:
    """Both channels over the same instants.

    Attributes:
        response: shape (n,), as in the file, finite.
        reference: shape (n,), as in its file, finite; None for no reference.
        valid: shape (n,), False where a sample is missing; None where none is.
        rate_hz: samples per second.
        start_s: time of the first sample on the clock of the response's file.
        notes: what was done, for the history.
        timing_u_s: standard uncertainty of the time between the channels, by the rounding of their
            stamps; 0 for channels with one clock.
    """

    response: FloatArray
    reference: FloatArray | None
    valid: BoolArray | None
    rate_hz: float
    start_s: float
    notes: tuple[str, ...] = ()
    timing_u_s: float = 0.0


def align(
    response: ClockedChannel,
    reference: ClockedChannel | None,
    start_s: float | None,
    stop_s: float | None,
    where: str,
) -> AlignedChannels:
    """Bring both channels to one raster, and cut them to the stated part of the record.

    Args:
        response: of the record.
        reference: of the same record, or None.
        start_s: begin of the part, from the response's first sample; None: the begin.
        stop_s: end of the part, from the response's first sample; None: the end.
        where: entry of the calibration file, for messages.

    Raises:
        InputError: the channels do not overlap, differ in length without clocks, or hold values
            that are not finite.
    """
    size = response.values.size
    rows = cut(size, response.rate_hz, start_s, stop_s, where)
    begin_s = rows.start / response.rate_hz
    end_s = math.inf if rows.stop == size else rows.stop / response.rate_hz
    _require_finite_within(response, begin_s, end_s)
    raster, notes = _put_on_raster(response)
    if response.clock.is_even and rows != slice(0, size):
        notes = (*notes, f"cut: samples {rows.start + 1} to {rows.stop} of {size}")
    if reference is None:
        part = _rows_between(begin_s, end_s, response.rate_hz, 0, raster.values.size)
        values = _slice_rows(raster.values, part)
        first_s = part.start / response.rate_hz
        aligned = AlignedChannels(values, None, None, response.rate_hz, first_s, notes)
    else:
        delay_s, timing_u_s = _delay_of_reference(response, reference)
        _require_finite_within(reference, begin_s - delay_s, end_s - delay_s)
        reference_raster, reference_notes = _put_on_raster(reference)
        aligned = _resample_to_slower(raster, reference_raster, begin_s, end_s, delay_s)
        notes = (*dict.fromkeys((*notes, *reference_notes)), *aligned.notes)
        aligned = replace(aligned, notes=notes, timing_u_s=timing_u_s)
    return _without_holes(aligned, response)


def _slice_rows(values: FloatArray, rows: slice) -> FloatArray:
    """Return some of the values; all of them as the array that was loaded."""
    return values if rows == slice(0, values.size) else values[rows]


def _rows_between(begin_s: float, end_s: float, rate_hz: float, first: int, last: int) -> slice:
    """Return the samples between two times, of those from ``first`` up to ``last``."""
    low = max(first, first_sample_at(begin_s, rate_hz))
    high = last if math.isinf(end_s) else min(last, first_sample_at(end_s, rate_hz))
    return slice(low, max(low, high))


def _require_finite_within(channel: ClockedChannel, begin_s: float, end_s: float) -> None:
    """Refuse a value that is not a number in a part of a channel, from its first sample."""
    timeline = channel.clock.timeline
    bad = np.flatnonzero(~np.isfinite(channel.values))
    if not bad.size:
        return
    raster_index = bad
    if timeline is not None:  # of the row whose time a doubled row repeats
        raster_index = timeline.raster_index[np.searchsorted(timeline.rows, bad, side="right") - 1]
    time_s = raster_index / channel.rate_hz
    rows = bad[(time_s >= begin_s) & (time_s < end_s)]
    if rows.size:
        channel.require_finite(slice(int(rows[0]), int(rows[-1]) + 1))


def _put_on_raster(channel: ClockedChannel) -> tuple[ClockedChannel, tuple[str, ...]]:
    """Return a channel on its even raster, and what was done.

    Doubled rows are out, holes are NaN, and uneven stamps are evened.
    """
    timeline = channel.clock.timeline
    notes = [channel.clock.note] if channel.clock.note else []
    if timeline is None or channel.clock.is_even:
        return channel, tuple(notes)
    if timeline.doubled:
        _require_repeats(channel, timeline)
        notes.append(f"{timeline.doubled} rows repeat a time and its value: left out")
    raster = np.full(int(timeline.raster_index[-1]) + 1, np.nan)
    raster[timeline.raster_index] = channel.values[timeline.rows]
    if timeline.lost:
        notes.append(f"{timeline.lost} samples are missing by the times: left out")
    if timeline.is_uneven:
        _even_out(raster, timeline, channel.column.source.file)
        jitter = float(np.sqrt(np.mean(timeline.offsets**2)))
        notes.append(
            f"evened: times deviate from an even raster by {100 * jitter:.3g} % of an interval "
            f"(rms); stamps rounded to {timeline.rounding_s:.3g} s; {_limit_note(channel.rate_hz)}"
        )
    return replace(channel, values=raster), tuple(notes)


def _even_out(raster: FloatArray, timeline: Timeline, file: str) -> None:
    """Resample values at uneven times to the even raster, in place.

    Samples near a hole or an end become NaN, as nothing is known beyond.

    Raises:
        InputError: no sample is far enough from all holes.
    """
    from vibrident.data.resampling import DOUBTFUL_SAMPLES, evenly_resampled

    offsets = np.zeros(raster.size)
    offsets[timeline.raster_index] = timeline.offsets
    for first, last in zip(*runs_of_true(np.isfinite(raster)), strict=True):
        run = raster[first:last]
        if run.size > 2 * DOUBTFUL_SAMPLES:
            run[:] = evenly_resampled(run, np.arange(run.size) + offsets[first:last])
        run[:DOUBTFUL_SAMPLES] = np.nan
        run[-DOUBTFUL_SAMPLES:] = np.nan
    if not np.any(np.isfinite(raster)):
        raise InputError(
            "Too few samples lie between the gaps of an uneven record.",
            expected=f"more than {2 * DOUBTFUL_SAMPLES} samples in a row",
            found=f"{timeline.rows.size} samples",
            where=file,
            remedy="record for longer, or at an even rate",
        )


def _limit_note(rate_hz: float) -> str:
    """Return the limit of a resampled channel, for the history."""
    from vibrident.data.resampling import PASS_BAND

    return f"nothing above {PASS_BAND * rate_hz:.6g} Hz is kept"


def _require_repeats(channel: ClockedChannel, timeline: Timeline) -> None:
    """Refuse two different values at one time."""
    rows = timeline.rows
    values = channel.values
    first_of_time = rows[np.searchsorted(rows, np.arange(values.size), side="right") - 1]
    differs = np.flatnonzero((values != values[first_of_time]) & np.isfinite(values))
    if differs.size:
        row = int(differs[0])
        raise InputError(
            "Two different values have the same time.",
            expected="one value a time",
            found=f"{float(values[row])!r} after {float(values[first_of_time[row]])!r}",
            where=channel.column.source.locate(channel.column.position, row),
            remedy="write the times with more digits, or give rate_hz where they are rounded",
        )


def _resample_to_slower(
    response: ClockedChannel,
    reference: ClockedChannel,
    begin_s: float,
    end_s: float,
    delay_s: float,
) -> AlignedChannels:
    """Return both channels at the instants of the slower one, within the part asked for.

    Both are on even rasters; the start is from the response's first sample. ``delay_s``: how much
    later the reference begins.
    """
    is_same_clock = is_same_rate(response.clock.clock, reference.clock.clock)
    response_is_slower = is_same_clock or response.rate_hz <= reference.rate_hz
    slower, faster = (response, reference) if response_is_slower else (reference, response)
    rate_hz = slower.rate_hz
    ratio = 1.0 if is_same_clock else faster.rate_hz / rate_hz
    # How much later the faster one begins, in its own samples.
    shift = (delay_s if response_is_slower else -delay_s) * faster.rate_hz
    whole_shift = round(shift)
    allowed = ROUNDING_SAMPLES + _START_ROUNDING_S * rate_hz
    is_whole = is_same_clock and abs(shift - whole_shift) <= allowed
    if is_whole:
        first = max(whole_shift, 0)
        last = min(slower.values.size, faster.values.size + whole_shift)
    else:
        from vibrident.data.resampling import margin_samples, resampled

        margin = margin_samples(ratio)
        slower_margin = margin_samples(1.0)
        first = max(math.ceil((margin + shift) / ratio), slower_margin)
        end = math.floor((faster.values.size - 1 - margin + shift) / ratio) + 1
        last = min(end, slower.values.size - slower_margin)
    # of the slower raster, from the response's first sample
    begins_s = 0.0 if response_is_slower else delay_s
    rows = _rows_between(begin_s - begins_s, end_s - begins_s, rate_hz, first, last)
    notes: tuple[str, ...] = ()
    if delay_s or not is_same_clock:
        _require_overlap(rows, response, reference, delay_s)
    if is_whole:
        faster_rows = slice(rows.start - whole_shift, rows.stop - whole_shift)
        pair = [_slice_rows(slower.values, rows), _slice_rows(faster.values, faster_rows)]
        if whole_shift:
            notes = (f"reference begins {whole_shift:+d} samples after the response: cut",)
    else:
        index = np.arange(rows.start, rows.stop, dtype=np.float64)
        pair = [
            resampled(slower.values, index, 1.0),  # through the same filter
            resampled(faster.values, index * ratio - shift, ratio),
        ]
        rates = f"from {faster.rate_hz:.9g} Hz to {rate_hz:.9g} Hz, "
        notes = (
            f"reference begins {delay_s * rate_hz:+.4g} samples after the response: resampled "
            f"{'' if is_same_clock else rates}band-limited; {_limit_note(rate_hz)}",
        )
    values, motion = pair if response_is_slower else pair[::-1]
    return AlignedChannels(values, motion, None, rate_hz, begins_s + rows.start / rate_hz, notes)


def _delay_of_reference(response: ClockedChannel, reference: ClockedChannel) -> tuple[float, float]:
    """Return how much later the reference begins, s, and its standard uncertainty.

    Both are 0 where the channels are sampled together, or nothing else is known.
    """
    clocks = (response.clock, reference.clock)
    if response.column.source is not reference.column.source:
        for channel in (response, reference):
            if channel.clock.has_unread_times:
                raise _unread_times(channel)
    is_same = all(clock.is_even for clock in clocks)
    is_same = is_same and is_same_rate(*(clock.clock for clock in clocks))
    has_length = reference.values.size == response.values.size
    stamps = [clock.timeline for clock in clocks]
    is_one_clock = stamps[0] is stamps[1] and stamps[0] is not None
    start, reference_start = (clock.clock.start for clock in clocks)
    if (
        None not in stamps
        and start is not None
        and reference_start is not None
        and start.epoch != reference_start.epoch
    ):
        raise InputError(
            "The times of the channels cannot be compared.",
            expected="dates in both time columns, or seconds from one zero in both",
            found="dates in the one, seconds from an unknown zero in the other",
            where=f"{reference.column.source.file}, beside {response.column.source.file}",
            remedy="write both on one clock; or take the times out of one file, if both channels "
            "begin together",
        )
    if (
        is_one_clock
        or start is None
        or reference_start is None
        or start.epoch != reference_start.epoch
    ):
        if is_same and not has_length:
            raise _length_error(response, reference)
        return 0.0, 0.0
    delay_s = (reference_start.ns - start.ns) * 1e-9
    allowed = ROUNDING_SAMPLES + _START_ROUNDING_S * response.rate_hz
    if is_same and has_length and abs(delay_s * response.rate_hz) <= allowed:
        return 0.0, 0.0
    slower_hz = min(response.rate_hz, reference.rate_hz)
    digits_s = _digits_of_starts((start, reference_start), delay_s * slower_hz)
    rounding_s = [digits_s if line is None else line.rounding_s for line in stamps]
    return delay_s, math.sqrt(sum(width_s**2 for width_s in rounding_s) / 12.0)


def _digits_of_starts(starts: Sequence[StartTime], apart_samples: float) -> float:
    """Return the width of the last decimal in which two starts are stated, s.

    It is 0 where they are a whole number of samples apart, as those of one clock are: no rounding
    makes that.
    """
    if abs(apart_samples - round(apart_samples)) <= ROUNDING_SAMPLES:
        return 0.0
    texts = [str(start.ns) for start in starts if start.ns != 0]
    zeros = min(len(text) - len(text.rstrip("0")) for text in texts)
    return 10.0**zeros * 1e-9


def _unread_times(channel: ClockedChannel) -> InputError:
    return InputError(
        "When the channels of two files began is not known.",
        expected="times that can be read in both files, or no times in both",
        found="times that are text, missing, rounded to more than a sample, or go back",
        where=channel.column.source.file,
        remedy="repair the times; or remove them from both files, if both channels begin together",
    )


def _length_error(response: ClockedChannel, reference: ClockedChannel) -> InputError:
    file = response.column.source.file
    return InputError(
        "The reference channel and the response differ in length.",
        expected=f"{response.values.size} samples, as the response has in {file}",
        found=f"{reference.values.size} samples",
        where=reference.column.source.locate(reference.column.position, 0),
        remedy="give both channels over the same samples, or their times in each file",
    )


def _require_overlap(
    rows: slice, response: ClockedChannel, reference: ClockedChannel, delay_s: float
) -> None:
    if rows.stop - rows.start >= MIN_SAMPLES:
        return
    spans = [channel.values.size / channel.rate_hz for channel in (response, reference)]
    raise InputError(
        "The channels were not recorded at the same time.",
        expected=f"a reference within the response's {spans[0]:.6g} s, by their clocks",
        found=f"a reference of {spans[1]:.6g} s that begins {delay_s:+.9g} s from the response",
        where=reference.column.source.file,
        remedy="name the files that belong together, or correct start_s, stop_s or their times",
    )


def _without_holes(aligned: AlignedChannels, response: ClockedChannel) -> AlignedChannels:
    """Return the channels from the first to the last complete sample, with a mask of the holes.

    Their start is then that of the clock. ``response``: as in its file.
    """
    complete = np.isfinite(aligned.response)
    if aligned.reference is not None:
        complete &= np.isfinite(aligned.reference)
    count = int(np.count_nonzero(complete))
    if count < MIN_SAMPLES:
        response.require_finite(slice(0, response.values.size))
        raise InputError(
            "The record is too short.",
            expected=f"at least {MIN_SAMPLES} samples of both channels",
            found=f"{count} samples",
            where=response.column.source.file,
            remedy="check the file and start_s / stop_s",
        )
    rows = slice(int(np.argmax(complete)), complete.size - int(np.argmax(complete[::-1])))
    valid = complete[rows]
    return replace(
        aligned,
        response=_fill_holes(_slice_rows(aligned.response, rows), valid),
        reference=None
        if aligned.reference is None
        else _fill_holes(_slice_rows(aligned.reference, rows), valid),
        valid=None if valid.all() else valid,
        start_s=response.clock.begins_s + aligned.start_s + rows.start / aligned.rate_hz,
    )


def _fill_holes(values: FloatArray, valid: BoolArray) -> FloatArray:
    """Return the values with straight lines across the holes, which are not used."""
    if valid.all():
        return values
    index = np.arange(values.size)
    return np.interp(index, index[valid], values[valid])
