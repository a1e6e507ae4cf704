"""Bring both channels of a record to one even raster, by the clocks that their files state.

A whole number of samples between two clocks is cut; a fraction, another rate and uneven stamps are
resampled, band-limited. The record's history states the resulting limits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.io.clocks import ChannelClock, is_same_rate
from vibrident.data.io.columns import Clock, ColumnFile
from vibrident.data.io.sampling import cut
from vibrident.data.records import BoolArray, FloatArray
from vibrident.data.records.basis import runs_of_true

REPAIR = "repair the file, or leave that part out with start_s / stop_s"
MIN_SAMPLES = 8  # of a record
_START_ROUNDING_S = 2e-9  # of the difference of two starts, in whole nanoseconds each
_MAX_OFF_RASTER_SAMPLES = 1e-6  # in samples; limit of the arithmetic


@dataclass(frozen=True, eq=False)
class ClockedChannel:
    """Column as in its file, and its clock; None where its file states none."""

    source: ColumnFile
    position: int
    values: FloatArray
    clock: ChannelClock | None = None
    first: int = 0  # sample of the column that ``values`` begin with

    def require_finite(self, rows: slice) -> None:
        """Refuse a value of these rows that is missing, NaN or infinite, with its place."""
        first = self.first + rows.start
        self.source.require_finite(self.position, self.values[rows], first, REPAIR)


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


@dataclass(frozen=True, eq=False)
class _Raster:
    """A channel's values on its even raster; NaN where a sample is missing."""

    channel: ClockedChannel
    values: FloatArray
    clock: Clock
    notes: tuple[str, ...] = ()


def align(
    response: ClockedChannel,
    reference: ClockedChannel | None,
    start_s: float | None,
    stop_s: float | None,
    where: str,
) -> AlignedChannels:
    """Bring both channels to one raster, and cut them to a part of the record.

    Args:
        response: with a clock.
        reference: of the same record, or None.
        start_s: begin of the part, from the response's first sample; None: all.
        stop_s: end of the part, likewise.
        where: entry of the calibration file, for messages.

    Raises:
        InputError: the channels do not overlap, differ in length without clocks, or hold values
            that are not finite.
    """
    assert response.clock is not None
    rate_hz = response.clock.clock.rate_hz
    if _is_plain(response) and (reference is None or _share_raster(response, reference)):
        if reference is not None and reference.values.size != response.values.size:
            raise _length_error(response, reference)
        rows = cut(response.values.size, rate_hz, start_s, stop_s, where)
        for channel in filter(None, (response, reference)):
            channel.require_finite(rows)
        notes = [response.clock.note]
        size = response.values.size
        if rows != slice(0, size):
            notes.append(f"cut: samples {rows.start + 1} to {rows.stop} of {size}")
        return AlignedChannels(
            _slice_rows(response.values, rows),
            None if reference is None else _slice_rows(reference.values, rows),
            None,
            rate_hz,
            response.clock.begins_s + rows.start / rate_hz,
            tuple(filter(None, notes)),
        )
    duration = response.values.size
    window = cut(duration, rate_hz, start_s, stop_s, where)
    begin_s = window.start / rate_hz
    end_s = math.inf if window.stop == duration else window.stop / rate_hz
    _require_finite_within(response, begin_s, end_s)
    raster = _put_on_raster(response)
    if reference is None:
        return _cut_to(raster, begin_s, end_s)
    apart_s, timing_u_s = _time_between(response, reference)
    _require_finite_within(reference, begin_s - apart_s, end_s - apart_s)
    return _resample_to_slower(
        raster, _put_on_raster(reference), begin_s, end_s, (apart_s, timing_u_s)
    )


def _slice_rows(values: FloatArray, rows: slice) -> FloatArray:
    """Return some of the values; all of them as the array that was loaded."""
    return values if rows == slice(0, values.size) else values[rows]


def _require_finite_within(channel: ClockedChannel, begin_s: float, end_s: float) -> None:
    """Refuse a value that is not a number in a part of a channel, from its first sample."""
    assert channel.clock is not None
    timeline = channel.clock.timeline
    bad = np.flatnonzero(~np.isfinite(channel.values))
    if not bad.size:
        return
    raster_index = bad
    if timeline is not None:
        raster_index = timeline.raster_index[np.searchsorted(timeline.rows, bad, side="right") - 1]
    time_s = raster_index / channel.clock.clock.rate_hz
    inside = bad[(time_s >= begin_s) & (time_s < end_s)]
    if inside.size:
        channel.require_finite(slice(int(inside[0]), int(inside[-1]) + 1))


def _is_plain(channel: ClockedChannel) -> bool:
    """Tell whether every row is a sample of an even raster."""
    timeline = None if channel.clock is None else channel.clock.timeline
    return timeline is None or not (timeline.is_uneven or timeline.doubled or timeline.lost)


def _share_raster(first: ClockedChannel, second: ClockedChannel) -> bool:
    """Tell whether two channels are known to be sampled together, or nothing else is known."""
    first_clock = first.clock
    second_clock = second.clock
    assert first_clock is not None
    if second_clock is None or (
        first_clock.timeline is second_clock.timeline and first_clock.timeline is not None
    ):
        return True
    if not _is_plain(second) or not is_same_rate(first_clock.clock, second_clock.clock):
        return False
    first_start = first_clock.clock.start
    second_start = second_clock.clock.start
    if first_start is None or second_start is None or first_start.epoch != second_start.epoch:
        return True
    apart = (second_start.ns - first_start.ns) * 1e-9 * first_clock.clock.rate_hz
    is_together = (
        abs(apart) <= _MAX_OFF_RASTER_SAMPLES + _START_ROUNDING_S * first_clock.clock.rate_hz
    )
    return is_together and first.values.size == second.values.size


def _length_error(response: ClockedChannel, reference: ClockedChannel) -> InputError:
    return InputError(
        "The reference channel and the response differ in length.",
        expected=f"{response.values.size} samples, as the response has in {response.source.file}",
        found=f"{reference.values.size} samples",
        where=reference.source.locate(reference.position, 0),
        remedy="give both channels over the same samples, or their times in each file",
    )


def _put_on_raster(channel: ClockedChannel) -> _Raster:
    """Return a channel on its even raster: doubled rows out, holes as NaN, uneven stamps evened."""
    assert channel.clock is not None
    timeline = channel.clock.timeline
    clock = channel.clock.clock
    notes = [channel.clock.note]
    if timeline is None or _is_plain(channel):
        return _Raster(channel, channel.values, clock, tuple(filter(None, notes)))
    values = channel.values[timeline.rows]
    if timeline.doubled:
        _require_repeats(channel)
        notes.append(f"{timeline.doubled} rows repeat a time and its value: left out")
    raster = np.full(int(timeline.raster_index[-1]) + 1, np.nan)
    raster[timeline.raster_index] = values
    if timeline.lost:
        notes.append(f"{timeline.lost} samples are missing by the times: left out")
    if timeline.is_uneven:
        from vibrident.data.resampling import DOUBTFUL_SAMPLES, PASS_BAND, evenly_resampled

        offsets = np.zeros(raster.size)
        offsets[timeline.raster_index] = timeline.offsets
        for first, last in zip(*runs_of_true(np.isfinite(raster)), strict=True):
            inner = slice(first + DOUBTFUL_SAMPLES, last - DOUBTFUL_SAMPLES)
            if last - first > 2 * DOUBTFUL_SAMPLES:
                steps = np.arange(last - first) + offsets[first:last]
                even = evenly_resampled(raster[first:last], steps)
                raster[inner] = even[DOUBTFUL_SAMPLES : last - first - DOUBTFUL_SAMPLES]
            raster[first : min(first + DOUBTFUL_SAMPLES, last)] = np.nan
            raster[max(last - DOUBTFUL_SAMPLES, first) : last] = np.nan
        jitter = float(np.sqrt(np.mean(timeline.offsets**2)))
        top = PASS_BAND * clock.rate_hz
        notes.append(
            f"evened: times deviate from an even raster by {100 * jitter:.3g} % of an interval "
            f"(rms); stamps rounded to {timeline.rounding_s:.3g} s; "
            f"nothing above {top:.6g} Hz is kept"
        )
        if not np.any(np.isfinite(raster)):
            raise InputError(
                "Too few samples lie between the gaps of an uneven record.",
                expected=f"more than {2 * DOUBTFUL_SAMPLES} samples in a row",
                found=f"{values.size} samples",
                where=channel.source.file,
                remedy="record for longer, or at an even rate",
            )
    return _Raster(channel, raster, clock, tuple(filter(None, notes)))


def _require_repeats(channel: ClockedChannel) -> None:
    """Refuse two different values at one time."""
    assert channel.clock is not None
    assert channel.clock.timeline is not None
    rows = channel.clock.timeline.rows
    before = rows[np.searchsorted(rows, np.arange(channel.values.size), side="right") - 1]
    differs = np.flatnonzero(channel.values != channel.values[before])
    differs = differs[np.isfinite(channel.values[differs])]
    if differs.size:
        row = int(differs[0])
        raise InputError(
            "Two different values have the same time.",
            expected="one value a time",
            found=f"{channel.values[row]!r} after {channel.values[before[row]]!r}",
            where=channel.source.locate(channel.position, row),
            remedy="write the times with more digits, or give rate_hz and remove the times",
        )


def _cut_to(raster: _Raster, begin_s: float, end_s: float) -> AlignedChannels:
    rate_hz = raster.clock.rate_hz
    first = math.ceil(begin_s * rate_hz - _MAX_OFF_RASTER_SAMPLES)
    last = raster.values.size
    if math.isfinite(end_s):
        last = min(last, math.ceil(end_s * rate_hz - _MAX_OFF_RASTER_SAMPLES))
    assert raster.channel.clock is not None
    start_s = raster.channel.clock.begins_s + first / rate_hz
    values = raster.values[first:last]
    return _mask_holes(values, None, rate_hz, start_s, raster.notes, 0.0, raster)


def _resample_to_slower(
    response: _Raster,
    reference: _Raster,
    begin_s: float,
    end_s: float,
    apart: tuple[float, float],
) -> AlignedChannels:
    """Return both channels at the instants of the slower one, within the part asked for.

    ``apart``: how much later the reference begins, s, and its standard uncertainty.
    """
    apart_s, timing_u_s = apart
    notes = [*dict.fromkeys((*response.notes, *reference.notes))]
    is_same = is_same_rate(response.clock, reference.clock)
    slower = response
    faster = reference
    faster_begins_s = apart_s
    if not is_same and reference.clock.rate_hz < response.clock.rate_hz:
        slower = reference
        faster = response
        faster_begins_s = -apart_s
    rate_hz = slower.clock.rate_hz
    ratio = 1.0 if is_same else faster.clock.rate_hz / rate_hz
    shift = faster_begins_s * faster.clock.rate_hz  # place of its first sample, in its own samples
    whole_shift = round(shift)
    allowed = _MAX_OFF_RASTER_SAMPLES + _START_ROUNDING_S * rate_hz
    if is_same and abs(shift - whole_shift) <= allowed:
        first = max(whole_shift, 0)
        last = min(slower.values.size, faster.values.size + whole_shift)
        _require_overlap(first, last, response, reference, apart_s)
        at_slower = slower.values[first:last]
        at_faster = faster.values[first - whole_shift : last - whole_shift]
        if whole_shift:
            notes.append(f"reference begins {whole_shift:+d} samples after the response: cut")
    else:
        from vibrident.data.resampling import PASS_BAND, margin_samples, resampled

        margin = margin_samples(ratio)
        slower_margin = margin_samples(1.0)
        begin = math.ceil((margin + shift) / ratio)
        end = math.floor((faster.values.size - 1 - margin + shift) / ratio) + 1
        first = max(begin, slower_margin)
        last = min(end, slower.values.size - slower_margin)
        _require_overlap(first, last, response, reference, apart_s)
        slower_index = np.arange(first, last, dtype=np.float64)
        at_slower = resampled(slower.values, slower_index, 1.0)  # through the same filter
        at_faster = resampled(faster.values, slower_index * ratio - shift, ratio)
        top = PASS_BAND * rate_hz
        moved = "" if is_same else f"from {faster.clock.rate_hz:.9g} Hz to {rate_hz:.9g} Hz, "
        notes.append(
            f"reference begins {apart_s * rate_hz:+.4g} samples after the response: resampled "
            f"{moved}band-limited; nothing above {top:.6g} Hz is kept"
        )
    # of the raster, from the response's first sample
    begins_s = 0.0 if slower is response else apart_s
    low = max(first, math.ceil((begin_s - begins_s) * rate_hz - _MAX_OFF_RASTER_SAMPLES))
    high = last
    if math.isfinite(end_s):
        high = min(last, math.ceil((end_s - begins_s) * rate_hz - _MAX_OFF_RASTER_SAMPLES))
    _require_overlap(low, high, response, reference, apart_s)
    rows = slice(low - first, high - first)
    pair = (at_slower[rows], at_faster[rows])
    values, motion = pair if slower is response else pair[::-1]
    assert response.channel.clock is not None
    start_s = response.channel.clock.begins_s + begins_s + low / rate_hz
    return _mask_holes(values, motion, rate_hz, start_s, tuple(notes), timing_u_s, response)


def _time_between(response: ClockedChannel, reference: ClockedChannel) -> tuple[float, float]:
    """Return how much later the reference begins, s, and its standard uncertainty."""
    assert response.clock is not None
    assert reference.clock is not None
    response_start = response.clock.clock.start
    reference_start = reference.clock.clock.start
    stamps = [response.clock.timeline, reference.clock.timeline]
    is_one_clock = stamps[0] is stamps[1] and stamps[0] is not None
    if (
        is_one_clock
        or response_start is None
        or reference_start is None
        or response_start.epoch != reference_start.epoch
    ):
        return 0.0, 0.0
    variance = sum(line.rounding_s**2 / 12.0 for line in stamps if line is not None)
    return (reference_start.ns - response_start.ns) * 1e-9, math.sqrt(variance)


def _require_overlap(
    first: int, last: int, response: _Raster, reference: _Raster, apart_s: float
) -> None:
    if last - first >= MIN_SAMPLES:
        return
    spans = [raster.values.size / raster.clock.rate_hz for raster in (response, reference)]
    raise InputError(
        "The channels were not recorded at the same time.",
        expected=f"a reference within the response's {spans[0]:.6g} s, by their clocks",
        found=f"a reference of {spans[1]:.6g} s that begins {apart_s:+.9g} s from the response",
        where=reference.channel.source.file,
        remedy="name the files that belong together, or correct start_s, stop_s or their times",
    )


def _mask_holes(
    response: FloatArray,
    reference: FloatArray | None,
    rate_hz: float,
    start_s: float,
    notes: tuple[str, ...],
    timing_u_s: float,
    raster: _Raster,
) -> AlignedChannels:
    """Return the channels from the first to the last complete sample, with a mask of the holes."""
    complete = np.isfinite(response)
    if reference is not None:
        complete &= np.isfinite(reference)
    complete_index = np.flatnonzero(complete)
    if complete_index.size < MIN_SAMPLES:
        source = raster.channel.source
        position = raster.channel.position
        source.require_finite(position, raster.channel.values, 0, REPAIR)
        raise InputError(
            "The record is too short.",
            expected=f"at least {MIN_SAMPLES} samples of both channels",
            found=f"{complete_index.size} samples",
            where=source.file,
            remedy="check the file and start_s / stop_s",
        )
    rows = slice(int(complete_index[0]), int(complete_index[-1]) + 1)
    valid = complete[rows]
    filled = [None if v is None else _fill_holes(v[rows], valid) for v in (response, reference)]
    assert filled[0] is not None
    start_s += rows.start / rate_hz
    holes = None if valid.all() else valid
    return AlignedChannels(filled[0], filled[1], holes, rate_hz, start_s, notes, timing_u_s)


def _fill_holes(values: FloatArray, valid: BoolArray) -> FloatArray:
    """Return the values with straight lines across the holes, which are not used."""
    if valid.all():
        return values
    index = np.arange(values.size)
    return np.interp(index, index[valid], values[valid])
