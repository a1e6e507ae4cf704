"""miniSEED and SAC files, as seismological recorders write them. SAC has one channel a file."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.errors import InputError
from vibrident.io.allowance import require_room
from vibrident.io.channels import Channel, ChannelFile, real_numbers, require_readable
from vibrident.io.clocks import plainest_clock
from vibrident.io.columns import Clock, unreadable
from vibrident.io.extra import library
from vibrident.records import FloatArray

_MINISEED = "a miniSEED file of channels without gaps"
_SAC = "a SAC file with an evenly sampled time series"
#: A record may begin this far from where the one before it ends, in sampling intervals.
_SEAM = 0.5


class MiniSeedFile(ChannelFile):
    """A miniSEED file; channels are named "NET.STA.LOC.CHA"."""

    def __init__(self, path: Path) -> None:
        """List the channels.

        Raises:
            InputError: obspy is not installed, or the file is no miniSEED.
        """
        self._obspy = library("obspy", "seismic", path)
        traces: dict[str, list[Any]] = {}
        try:
            require_readable(path)
            for trace in self._traces(path, headonly=True):
                traces.setdefault(trace.id, []).append(trace)
            refused = {name: reason for name, parts in traces.items() if (reason := _gap(parts))}
            channels = [
                Channel(name, name, Clock(float(parts[0].stats.sampling_rate), start_ns=parts[0].stats.starttime.ns))
                for name, parts in traces.items()
                if name not in refused
            ]
        except Exception as error:  # libmseed's wrapper raises anything
            raise unreadable(str(path), error, _MINISEED) from error
        super().__init__(path, channels, refused)

    def load(self, positions: Sequence[int]) -> tuple[FloatArray, ...]:
        """Read these channels; each has shape (samples,).

        Raises:
            InputError: the file is damaged.
        """
        try:
            stated = sum(int(trace.stats.npts) for trace in self._traces(self._path, headonly=True))
            require_room(self._path, stated)
            traces = self._traces(self._path, headonly=False)
            wanted = [self._channels[position].handle for position in positions]
            return tuple(
                np.concatenate([real_numbers(trace.data) for trace in traces if trace.id == name]) for name in wanted
            )
        except InputError:
            raise
        except Exception as error:
            raise unreadable(self.file, error, _MINISEED) from error

    def _traces(self, path: Path, *, headonly: bool) -> list[Any]:
        """Traces in the order of the file; what obspy warns of is damage."""
        with path.open("rb") as stream, warnings.catch_warnings():  # a name would be globbed, fetched or unpacked
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", DeprecationWarning)
            return [*self._obspy.read(stream, format="MSEED", headonly=headonly)]


def _gap(parts: Sequence[Any]) -> str:
    """Return why the parts of a channel make no record; "" where each goes on where the one before it ends."""
    rate_hz = parts[0].stats.sampling_rate
    if rate_hz <= 0:
        return "without a sampling rate"
    for before, after in itertools.pairwise(parts):
        if after.stats.sampling_rate != rate_hz:
            return f"at {rate_hz:g} Hz first and at {after.stats.sampling_rate:g} Hz later"
        samples_ns = before.stats.npts / rate_hz * 1e9
        missing = (after.stats.starttime.ns - before.stats.starttime.ns - samples_ns) * 1e-9 * rate_hz
        if abs(missing) > _SEAM:
            kind = "a gap" if missing > 0 else "an overlap"
            return f"interrupted: {kind} of {abs(missing):.3g} samples at {before.stats.endtime}"
    return ""


class SacFile(ChannelFile):
    """A SAC file. The rate is made from the header's own interval: obspy's is rounded to a microsecond."""

    def __init__(self, path: Path) -> None:
        """Read the header.

        Raises:
            InputError: obspy is not installed, or the file is no SAC file of an evenly sampled time series.
        """
        self._sac = library("obspy.io.sac", "seismic", path).SACTrace
        try:
            header = self._trace(path, headonly=True)
            if not 0 < 4 * int(header.npts) < path.stat().st_size:
                raise ValueError(f"{header.npts} samples in a file of {path.stat().st_size} bytes")
            if not header.leven or header.iftype != "itime":
                raise ValueError(f"leven {header.leven}, type {header.iftype}")
            delta = np.float32(header.delta)  # a four-byte number in the file
            stamps = (header.nzyear, header.nzjday, header.nzhour, header.nzmin, header.nzsec, header.nzmsec)
            start = None if any(stamp is None for stamp in stamps) else header.reftime.ns + round(float(header.b) * 1e9)
            name = ".".join(str(code or "") for code in (header.knetwk, header.kstnm, header.khole, header.kcmpnm))
            clock = plainest_clock(float(delta), float(np.spacing(delta)) / 2, start)
            channel = Channel(name if name.strip(".") else "channel 1", int(header.npts), clock)
        except Exception as error:  # obspy raises anything on damaged headers
            raise unreadable(str(path), error, _SAC) from error
        super().__init__(path, [channel], {})

    def load(self, positions: Sequence[int]) -> tuple[FloatArray, ...]:
        """Read these channels; each has shape (samples,).

        Raises:
            InputError: the file is damaged.
        """
        try:
            require_room(self._path, self._channels[0].handle * len(positions))
            values = real_numbers(self._trace(self._path, headonly=False).data)
            if values.size != self._channels[0].handle:
                raise ValueError(f"{values.size} samples of {self._channels[0].handle}")
            return tuple(values.copy() for _ in positions)
        except InputError:
            raise
        except Exception as error:
            raise unreadable(self.file, error, _SAC) from error

    def _trace(self, path: Path, *, headonly: bool) -> Any:
        with path.open("rb") as stream, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return self._sac.read(stream, headonly=headonly)
