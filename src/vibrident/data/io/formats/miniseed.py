"""miniSEED files, as seismological recorders write them."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.data.io.columns import (
    Channel,
    Clock,
    ColumnFile,
    Positions,
    StartTime,
    library,
    reading,
    real_numbers,
    require_room,
)
from vibrident.data.io.reader import Reader
from vibrident.data.records import FloatArray

#: Samples read beyond either end of a part, whose times are rounded.
_MARGIN = 1


class MiniSeedFile(ColumnFile):
    """A miniSEED file; channels are named "NET.STA.LOC.CHA" and count a converter's steps."""

    expected = "a miniSEED file of channels without gaps"

    def __init__(self, path: Path) -> None:
        self._obspy = library("obspy", "seismic", path)
        traces: dict[str, list[Any]] = {}
        with reading(path, self.expected):
            for trace in self._traces(path, headonly=True):
                traces.setdefault(trace.id, []).append(trace)
            self._samples = sum(
                int(trace.stats.npts) for trace in itertools.chain(*traces.values())
            )
            self._starts = {name: segments[0].stats.starttime for name, segments in traces.items()}
            refused = {
                name: reason for name, segments in traces.items() if (reason := _gap(segments))
            }
            channels = [
                Channel(
                    name,
                    name,
                    _clock(segments[0].stats),
                    unit="counts",
                    samples=sum(int(trace.stats.npts) for trace in segments),
                )
                for name, segments in traces.items()
                if name not in refused
            ]
        super().__init__(path, channels, refused)

    def _read(self, handles: Sequence[str]) -> Iterator[FloatArray]:
        require_room(self._path, self._samples)
        traces = self._traces(self._path, headonly=False)
        for name in handles:
            yield np.concatenate([real_numbers(t.data) for t in traces if t.id == name])

    def reads_parts(self, position: int) -> bool:
        """Return True: the headers of a file's blocks tell their times."""
        return True

    def block(self, positions: Positions, start: int, stop: int) -> FloatArray:
        """Return samples of channels from ``start`` up to ``stop``; only these are unpacked.

        See ColumnFile.
        """
        values = np.empty((len(positions), stop - start))
        for row, position in zip(values, positions, strict=True):
            channel = self._channels[position]
            assert channel.clock is not None
            interval_s = 1.0 / channel.clock.rate_hz
            begin = self._starts[channel.handle] + (start - _MARGIN) * interval_s
            end = self._starts[channel.handle] + (stop - 1 + _MARGIN) * interval_s
            with reading(self._path, self.expected):
                segments = [
                    trace
                    for trace in self._traces(
                        self._path, headonly=False, starttime=begin, endtime=end
                    )
                    if trace.id == channel.handle
                ]
                samples = np.concatenate([real_numbers(trace.data) for trace in segments])
                first = (segments[0].stats.starttime - self._starts[channel.handle]) / interval_s
                skipped = start - round(first)
                row[:] = samples[skipped : skipped + stop - start]
        return values

    def _traces(self, path: Path, *, headonly: bool, **span: Any) -> list[Any]:
        """Return the traces in the order of the file; obspy's warnings mean damage.

        ``span``: ``starttime`` and ``endtime`` of a part of the file.
        """
        # a name would be globbed, fetched or unpacked
        with (
            path.open("rb") as stream,
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", DeprecationWarning)
            return [*self._obspy.read(stream, format="MSEED", headonly=headonly, **span)]


def _clock(stats: Any) -> Clock:
    return Clock(float(stats.sampling_rate), start=StartTime(stats.starttime.ns, epoch=True))


def _gap(segments: Sequence[Any]) -> str:
    """Return why the parts of a channel are not one record; "" if they are contiguous."""
    rate_hz = segments[0].stats.sampling_rate
    if rate_hz <= 0:
        return "without a sampling rate"
    for before, after in itertools.pairwise(segments):
        if after.stats.sampling_rate != rate_hz:
            return f"at {rate_hz:g} Hz first and at {after.stats.sampling_rate:g} Hz later"
        samples_ns = before.stats.npts / rate_hz * 1e9
        missing = (
            (after.stats.starttime.ns - before.stats.starttime.ns - samples_ns) * 1e-9 * rate_hz
        )
        if abs(missing) > 0.5:
            kind = "a gap" if missing > 0 else "an overlap"
            return f"interrupted: {kind} of {abs(missing):.3g} samples at {before.stats.endtime}"
    return ""


MINISEED = Reader(
    name="miniseed",
    title="miniSEED",
    endings=(".mseed", ".miniseed"),
    open=MiniSeedFile,
    extra="seismic",
)
