"""SAC files, one channel a file."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.data.io.columns import (
    Channel,
    ColumnFile,
    StartTime,
    library,
    reading,
    real_numbers,
)
from vibrident.data.io.reader import Reader
from vibrident.data.io.sampling import plainest_clock
from vibrident.data.records import FloatArray

#: By the kind of dependent variable, IDEP; the SAC manual, "SAC Data File Format".
_UNITS = {"idisp": "nm", "ivel": "nm/s", "iacc": "nm/s^2", "ivolts": "V"}


class SacFile(ColumnFile):
    """A SAC file.

    The rate is made from the header's own interval: obspy's is rounded to a microsecond.
    """

    expected = "a SAC file with an evenly sampled time series"

    def __init__(self, path: Path) -> None:
        self._sac = library("obspy.io.sac", "seismic", path).SACTrace
        with reading(path, self.expected):
            header = self._trace(path, headonly=True)
            if not 0 < 4 * int(header.npts) < path.stat().st_size:
                raise ValueError(f"{header.npts} samples in a file of {path.stat().st_size} bytes")
            if not header.leven or header.iftype != "itime":
                raise ValueError(f"leven {header.leven}, type {header.iftype}")
            delta = np.float32(header.delta)  # a four-byte number in the file
            stamps = (
                header.nzyear,
                header.nzjday,
                header.nzhour,
                header.nzmin,
                header.nzsec,
                header.nzmsec,
            )
            dated = all(stamp is not None for stamp in stamps)
            start_ns = (header.reftime.ns if dated else 0) + round(float(header.b) * 1e9)
            start = StartTime(start_ns, epoch=dated)
            name = ".".join(
                str(code or "")
                for code in (header.knetwk, header.kstnm, header.khole, header.kcmpnm)
            )
            clock = plainest_clock(float(delta), float(np.spacing(delta)) / 2, start)
            unit = _UNITS.get(str(header.idep), "")
            name = name if name.strip(".") else "channel 1"
            channel = Channel(name, clock=clock, unit=unit, samples=int(header.npts))
        super().__init__(path, [channel], {})

    def _read(self, handles: Sequence[None]) -> Iterator[FloatArray]:
        values = real_numbers(self._trace(self._path, headonly=False).data)
        yield from (values.copy() for _ in handles)

    def _trace(self, path: Path, *, headonly: bool) -> Any:
        with path.open("rb") as stream, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return self._sac.read(stream, headonly=headonly)


SAC = Reader(name="sac", title="SAC", endings=(".sac",), open=SacFile, extra="seismic")
