"""TDMS files (LabVIEW): channels "group/channel", with what their properties state."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
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
    reason_against_type,
)
from vibrident.data.io.reader import Reader
from vibrident.data.io.stated import (
    clock_of,
    is_frequency,
    nearest_unit,
    statements,
)
from vibrident.data.io.units import factor_between
from vibrident.data.records import FloatArray

#: LabVIEW writes its zero, 1904-01-01, for a start without a date.
_NO_DATE = np.datetime64("1904-01-02")
#: Scales that nptdms computes; of others it would return the numbers of the converter, unsaid.
_SCALES = frozenset(
    {
        *("Polynomial", "Linear", "Table", "Add", "Subtract", "AdvancedAPI"),
        *("RTD", "Strain", "Thermistor", "Thermocouple"),
    }
)
_SCALE_TYPE = re.compile(r"NI_Scale\[(\d+)\]_Scale_Type")
_SCALE_INPUT = re.compile(r"NI_Scale\[(\d+)\]_\w+_Input_Source")
_SCALE_COUNT = "NI_Number_Of_Scales"


class TdmsFile(ColumnFile):
    """A TDMS file; numbers are scaled as the file says.

    Text, complex numbers, empty channels and scales that cannot be computed are refused.
    """

    expected = "a TDMS file, written to its end"
    names_are_paths = True

    def __init__(self, path: Path) -> None:
        self._path = path
        self._library = library("nptdms", "tdms", path).TdmsFile
        channels: list[Channel] = []
        refused: dict[str, str] = {}
        with self._opened() as file:
            if file.file_status.incomplete_final_segment:
                raise ValueError("the last segment is cut short")
            for group in file.groups():
                for channel in group.channels():
                    name = f"{group.name}/{channel.name}"
                    outer = (group.properties, file.properties)
                    if reason := _reason_against(channel, outer):
                        refused[name] = reason
                    else:
                        channels.append(_channel(name, channel, outer, str(path)))
        super().__init__(path, channels, refused)

    def _first_date(self, position: int) -> StartTime:
        group, name = self._channels[position].handle
        with self._opened() as file:
            first = _plain(file[group][name][:1])[0]
        return StartTime.on_date(first)

    def _read(self, handles: Sequence[tuple[str, str]]) -> Iterator[FloatArray]:
        with self._opened() as file:
            for group, name in handles:
                yield real_numbers(_plain(file[group][name][:]))

    @contextmanager
    def _opened(self) -> Iterator[Any]:
        """Open the file; times are read to all their digits, not to microseconds."""
        with (
            reading(self._path, self.expected),
            self._path.open("rb") as stream,
            self._library.open(stream, raw_timestamps=True) as file,
        ):
            yield file


def _channel(name: str, channel: Any, outer: Sequence[Mapping[str, Any]], where: str) -> Channel:
    """Return a channel with what its properties, its group's and the file's state."""
    properties = channel.properties
    start = _start(properties)
    levels = [statements(values) for values in (properties, *outer)]
    axis = str(properties.get("wf_xunit_string", "")).strip()
    over_frequency = is_frequency(str(properties.get("wf_xname", "")), axis)
    clock = None if over_frequency else clock_of(levels, f"{where}, channel {name!r}")
    if clock is not None:
        # wf_increment is in the unit of the x axis, which hardly anyone changes
        seconds = factor_between(axis, "s") if "wf_increment" in properties else None
        clock = replace(clock, rate_hz=clock.rate_hz / (seconds or 1.0), start=start)
    handle = (channel.group_name, channel.name)
    unit = nearest_unit(channel.name, levels[0], levels[1])
    size = len(channel)
    return Channel(name, handle, clock, _is_time(channel), unit, over_frequency, start, size)


def _start(properties: Mapping[str, Any]) -> StartTime | None:
    """Return the time of a channel's first sample: wf_start_time and wf_start_offset.

    An offset without a date is on the file's own clock.
    """
    date = _plain(properties.get("wf_start_time"))
    offset_s = properties.get("wf_start_offset")
    if not isinstance(offset_s, int | float) or not np.isfinite(offset_s):
        offset_s = None
    if isinstance(date, np.datetime64) and date >= _NO_DATE:
        return StartTime.on_date(date, offset_s or 0.0)
    return None if offset_s is None else StartTime.on_own_clock(offset_s)


def _plain(value: Any) -> Any:
    """Return nptdms's times as those of NumPy, and anything else as it is."""
    return value.as_datetime64("ns") if hasattr(value, "as_datetime64") else value


def _is_time(channel: Any) -> bool:
    return channel.data_type is not None and channel.data_type.__name__ == "TimeStamp"


def _reason_against(channel: Any, outer: Sequence[Mapping[str, Any]]) -> str:
    """Return why a channel is refused; "" if it is not."""
    if len(channel) == 0:
        return "empty"
    if reason := _reason_against_scales([channel.properties, *outer]):
        return reason
    return "" if _is_time(channel) else reason_against_type(channel.dtype)


def _reason_against_scales(levels: Sequence[Mapping[str, Any]]) -> str:
    """Return why nptdms cannot scale a channel; "" if it can, or nothing is to be scaled.

    It takes the scale of the highest number as the last one. ``levels``: properties of the channel,
    its group and the file, of which the first with scales holds.
    """
    for properties in levels:
        kinds = {
            int(match[1]): str(kind)
            for name, kind in properties.items()
            if (match := _SCALE_TYPE.fullmatch(name))
        }
        count = int(properties.get(_SCALE_COUNT, max(kinds, default=-1) + 1))
        if not count and not kinds:
            continue
        if properties.get("NI_Scaling_Status") == "scaled":
            return ""
        if unknown := sorted(set(kinds.values()) - _SCALES):
            return f"scaled in a way that is not known, {unknown[0]!r}"
        inputs = {
            int(value)
            for name, value in properties.items()
            if _SCALE_INPUT.fullmatch(name) and isinstance(value, int | np.integer)
        }
        if max(kinds, default=-1) >= count or any(n not in inputs for n in kinds if n < count - 1):
            return f"scaled in an order that is not known: of {count} scales, one leads nowhere"
        return ""
    return ""


TDMS = Reader(name="tdms", title="TDMS (LabVIEW)", endings=(".tdms",), open=TdmsFile, extra="tdms")
