"""TDMS files (LabVIEW): channels "group/channel", with the rate of their waveform properties."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.data.io.columns import (
    Channel,
    Clock,
    ColumnFile,
    Start,
    library,
    reading,
    real_numbers,
    require_room,
)
from vibrident.data.io.reader import Reader
from vibrident.data.records import FloatArray

_EXPECTED = "a TDMS file, written to its end"


class TdmsFile(ColumnFile):
    """A TDMS file; numbers are scaled as the file says. Text, complex numbers and empty channels are refused."""

    names_are_paths = True

    def __init__(self, path: Path) -> None:
        self._path, self._library = path, library("nptdms", "tdms", path).TdmsFile
        channels: list[Channel] = []
        refused: dict[str, str] = {}
        with self._opened() as file:
            if file.file_status.incomplete_final_segment:
                raise ValueError("the last segment is cut short")
            for found in (channel for group in file.groups() for channel in group.channels()):
                name = f"{found.group_name}/{found.name}"
                if reason := _reason_against(found):
                    refused[name] = reason
                else:
                    handle, timed = (found.group_name, found.name), found.dtype.kind == "M"
                    channels.append(Channel(name, handle, _clock(found.properties), timed))
        super().__init__(path, channels, refused)

    def load(self, positions: Sequence[int]) -> tuple[FloatArray, ...]:
        """Read these channels; each has shape (samples,)."""
        with self._opened() as file:
            handles = [self._channels[position].handle for position in positions]
            require_room(self._path, sum(len(file[group][name]) for group, name in handles))
            return tuple(real_numbers(file[group][name][:]) for group, name in handles)

    @contextmanager
    def _opened(self) -> Iterator[Any]:
        with (
            reading(self._path, _EXPECTED),
            self._path.open("rb") as stream,
            self._library.open(stream) as file,
        ):
            yield file


def _reason_against(channel: Any) -> str:
    if len(channel) == 0:
        return "empty"
    if channel.dtype.kind in "iufbM":
        return ""
    return {"c": "complex", "O": "text", "U": "text", "S": "text"}.get(
        channel.dtype.kind, str(channel.dtype)
    )


def _clock(properties: Any) -> Clock | None:
    """The rate is the reciprocal of wf_increment, a double; the start is wf_start_time and wf_start_offset."""
    increment_s = properties.get("wf_increment")
    if (
        not isinstance(increment_s, int | float)
        or not math.isfinite(increment_s)
        or increment_s <= 0
    ):
        return None
    start, offset_s = properties.get("wf_start_time"), properties.get("wf_start_offset", 0.0)
    if (
        not isinstance(start, np.datetime64)
        or not isinstance(offset_s, int | float)
        or not math.isfinite(offset_s)
    ):
        return Clock(1.0 / increment_s)
    start_ns = int(start.astype("datetime64[ns]").astype(np.int64)) + round(offset_s * 1e9)
    return Clock(1.0 / increment_s, start=Start(start_ns, epoch=True))


TDMS = Reader(name="tdms", title="TDMS (LabVIEW)", endings=(".tdms",), open=TdmsFile, extra="tdms")
