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
        source: the file.
        position: of the column in it.
        values: shape (samples,), as in the file.
        clock: None where the file states none.
        first: sample of the column that ``values`` begin with.
    """

    source: ColumnFile
    position: int
    values: FloatArray
    clock: ChannelClock | None = None
    first: int = 0

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
    """Bring both channels to one raster, and cut them to the stated part of the record.

    Args:
        response: with a clock.
        reference: of the same record, or None.
        start_s: begin of the part, from the response's first sample; None: the begin.
        stop_s: end of the part, from the response's first sample; None: the end.
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
    delay_s, timing_u_s = _delay_of_reference(response, reference)
    _require_finite_within(reference, begin_s - delay_s, end_s - delay_s)
    return _resample_to_slower(
        raster, _put_on_raster(reference), begin_s, end_s, (delay_s, timing_u_s)
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
    if timeline is not None:  # of the row whose time a doubled row repeats
        raster_index = timeline.raster_index[np.searchsorted(timeline.rows, bad, side="right") - 1]
    time_s = raster_index / channel.clock.clock.rate_hz
    rows = bad[(time_s >= begin_s) & (time_s < end_s)]
    if rows.size:
        channel.require_finite(slice(int(rows[0]), int(rows[-1]) + 1))


def _is_plain(channel: ClockedChannel) -> bool:
    """Return whether every row is a sample of an even raster."""
    timeline = None if channel.clock is None else channel.clock.timeline
    return timeline is None or not (timeline.is_uneven or timeline.doubled or timeline.lost)


def _share_raster(first: ClockedChannel, second: ClockedChannel) -> bool:
    """Return whether two channels are known to be sampled together, or nothing else is known."""
    first_clock = first.clock
    second_clock = second.clock
    assert first_clock is not None
    if second_clock is None:
        return True
    if first_clock.timeline is second_clock.timeline and first_clock.timeline is not None:
        return True
    if not _is_plain(second) or not is_same_rate(first_clock.clock, second_clock.clock):
        return False
    first_start = first_clock.clock.start
    second_start = second_clock.clock.start
    if first_start is None or second_start is None or first_start.epoch != second_start.epoch:
        return True
    rate_hz = first_clock.clock.rate_hz
    delay = (second_start.ns - first_start.ns) * 1e-9 * rate_hz
    is_together = abs(delay) <= ROUNDING_SAMPLES + _START_ROUNDING_S * rate_hz
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
    notes = [channel.clock.note] if channel.clock.note else []
    if timeline is None or _is_plain(channel):
        return _Raster(channel, channel.values, clock, tuple(notes))
    if timeline.doubled:
        _require_repeats(channel)
        notes.append(f"{timeline.doubled} rows repeat a time and its value: left out")
    raster = np.full(int(timeline.raster_index[-1]) + 1, np.nan)
    raster[timeline.raster_index] = channel.values[timeline.rows]
    if timeline.lost:
        notes.append(f"{timeline.lost} samples are missing by the times: left out")
    if timeline.is_uneven:
        _even_out(raster, timeline, channel.source.file)
        jitter = float(np.sqrt(np.mean(timeline.offsets**2)))
        notes.append(
            f"evened: times deviate from an even raster by {100 * jitter:.3g} % of an interval "
            f"(rms); stamps rounded to {timeline.rounding_s:.3g} s; {_limit_note(clock.rate_hz)}"
        )
    return _Raster(channel, raster, clock, tuple(notes))


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


def _require_repeats(channel: ClockedChannel) -> None:
    """Refuse two different values at one time."""
    assert channel.clock is not None
    assert channel.clock.timeline is not None
    rows = channel.clock.timeline.rows
    values = channel.values
    first_of_time = rows[np.searchsorted(rows, np.arange(values.size), side="right") - 1]
    differs = np.flatnonzero((values != values[first_of_time]) & np.isfinite(values))
    if differs.size:
        row = int(differs[0])
        raise InputError(
            "Two different values have the same time.",
            expected="one value a time",
            found=f"{values[row]!r} after {values[first_of_time[row]]!r}",
            where=channel.source.locate(channel.position, row),
            remedy="write the times with more digits, or give rate_hz and remove the times",
        )


def _cut_to(raster: _Raster, begin_s: float, end_s: float) -> AlignedChannels:
    """Return a channel without reference, within the part asked for."""
    rate_hz = raster.clock.rate_hz
    first = first_sample_at(begin_s, rate_hz)
    last = raster.values.size
    if math.isfinite(end_s):
        last = min(last, first_sample_at(end_s, rate_hz))
    assert raster.channel.clock is not None
    start_s = raster.channel.clock.begins_s + first / rate_hz
    values = raster.values[first:last]
    return _mask_holes(values, None, rate_hz, start_s, raster.notes, 0.0, raster)


def _resample_to_slower(
    response: _Raster,
    reference: _Raster,
    begin_s: float,
    end_s: float,
    delay: tuple[float, float],
) -> AlignedChannels:
    """Return both channels at the instants of the slower one, within the part asked for.

    ``delay``: how much later the reference begins, s, and its standard uncertainty.
    """
    delay_s, timing_u_s = delay
    is_same_clock = is_same_rate(response.clock, reference.clock)
    response_is_slower = is_same_clock or response.clock.rate_hz <= reference.clock.rate_hz
    slower, faster = (response, reference) if response_is_slower else (reference, response)
    rate_hz = slower.clock.rate_hz
    ratio = 1.0 if is_same_clock else faster.clock.rate_hz / rate_hz
    # How much later the faster one begins, in its own samples.
    shift = (delay_s if response_is_slower else -delay_s) * faster.clock.rate_hz
    whole_shift = round(shift)
    notes = [*dict.fromkeys((*response.notes, *reference.notes))]
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
    low = max(first, first_sample_at(begin_s - begins_s, rate_hz))
    high = last
    if math.isfinite(end_s):
        high = min(last, first_sample_at(end_s - begins_s, rate_hz))
    _require_overlap(low, high, response, reference, delay_s)
    if is_whole:
        pair = [slower.values[low:high], faster.values[low - whole_shift : high - whole_shift]]
        if whole_shift:
            notes.append(f"reference begins {whole_shift:+d} samples after the response: cut")
    else:
        index = np.arange(low, high, dtype=np.float64)
        pair = [
            resampled(slower.values, index, 1.0),  # through the same filter
            resampled(faster.values, index * ratio - shift, ratio),
        ]
        rates = f"from {faster.clock.rate_hz:.9g} Hz to {rate_hz:.9g} Hz, "
        notes.append(
            f"reference begins {delay_s * rate_hz:+.4g} samples after the response: resampled "
            f"{'' if is_same_clock else rates}band-limited; {_limit_note(rate_hz)}"
        )
    values, motion = pair if response_is_slower else pair[::-1]
    assert response.channel.clock is not None
    start_s = response.channel.clock.begins_s + begins_s + low / rate_hz
    return _mask_holes(values, motion, rate_hz, start_s, tuple(notes), timing_u_s, response)


def _delay_of_reference(response: ClockedChannel, reference: ClockedChannel) -> tuple[float, float]:
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
    first: int, last: int, response: _Raster, reference: _Raster, delay_s: float
) -> None:
    if last - first >= MIN_SAMPLES:
        return
    spans = [raster.values.size / raster.clock.rate_hz for raster in (response, reference)]
    raise InputError(
        "The channels were not recorded at the same time.",
        expected=f"a reference within the response's {spans[0]:.6g} s, by their clocks",
        found=f"a reference of {spans[1]:.6g} s that begins {delay_s:+.9g} s from the response",
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
