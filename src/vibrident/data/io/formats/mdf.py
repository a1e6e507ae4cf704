"""MDF files (ASAM), version 4 and before: channels of all groups, at their group's time stamps.

A channel's conversion may be a formula in text, which asammdf would evaluate as code. So only
arithmetic conversions are allowed, checked before any value is read.
"""

from __future__ import annotations

import gc
import sys
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.base.errors import InputError
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
from vibrident.data.records import FloatArray

#: Conversion types by the number in the file: none, linear, rational, tables of numbers; in version
#: 3 also polynomial, exponential and logarithmic. Formulas (3; 10 in version 3) and texts are not
#: among them.
_ARITHMETIC = {4: frozenset({0, 1, 2, 4, 5, 6}), 3: frozenset({0, 1, 2, 6, 7, 8, 9, 65535})}
_FORMULA = {4: 3, 3: 10}


class MdfFile(ColumnFile):
    """MDF file; values are converted as the file says."""

    expected = "an MDF file of measured signals, written to its end"

    def __init__(self, path: Path) -> None:
        self._path = path
        self._mdf = library("asammdf", "mdf", path).MDF
        channels: list[Channel] = []
        refused: dict[str, str] = {}
        with self._opened() as file:
            for group, index, name in _listed(file):
                if reason := _reason_against(file, group, index):
                    refused[name] = reason
                else:
                    unit = _unit(file.groups[group].channels[index])
                    samples = file.groups[group].channel_group.cycles_nr
                    channels.append(Channel(name, (group, index), unit=unit, samples=samples))
            starts = {group: _start(file, group) for group, _ in (c.handle for c in channels)}
        channels = [replace(channel, start=starts[channel.handle[0]]) for channel in channels]
        super().__init__(path, channels, refused)

    def stamps(self, position: int) -> FloatArray:
        """Return the times of a channel's samples, in s after the start of the measurement."""
        group, _ = self._channels[position].handle
        with self._opened() as file:
            return real_numbers(file.get_master(group))

    def _read(self, handles: Sequence[tuple[int, int]]) -> Iterator[FloatArray]:
        with self._opened() as file:
            yield from (_signal(file, *handle) for handle in handles)

    @contextmanager
    def _opened(self) -> Iterator[Any]:
        """Open the file and check its time stamps.

        Logged bus traffic, whose databases are code, is ignored.
        """
        with reading(self._path, self.expected):
            try:
                with (
                    self._path.open("rb") as stream,
                    self._mdf(stream, process_bus_logging=False) as file,
                ):
                    _refuse_formulas_of_time(file, self.file)
                    yield file
            except Exception as error:
                _collect_failed(error)
                raise


def _collect_failed(error: BaseException) -> None:
    """Collect half-made objects of the library, whose destructors raise warnings."""
    hook = sys.unraisablehook
    sys.unraisablehook = lambda _: None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            cause: BaseException | None = error
            while cause is not None:
                traceback.clear_frames(cause.__traceback__)
                cause = cause.__context__
            gc.collect()  # some are reference cycles
    finally:
        sys.unraisablehook = hook


def _listed(file: Any) -> list[tuple[int, int, str]]:
    """Return the group, index and name of every channel but the time stamps."""
    return [
        (group, index, channel.name)
        for group, content in enumerate(file.groups)
        for index, channel in enumerate(content.channels)
        if index != file.masters_db.get(group)
    ]


def _reason_against(file: Any, group: int, index: int) -> str:
    """Return why a channel is refused; "" if it is not."""
    content = file.groups[group]
    if content.channel_group.cycles_nr == 0:
        return "empty"
    if content.channel_dependencies[index]:
        return "an array or a structure at each instant"
    if reason := _reason_against_conversion(content.channels[index].conversion, _generation(file)):
        return reason
    first = file.get(group=group, index=index, record_count=1).samples
    if first.ndim != 1 or first.dtype.names:
        return "an array or a structure at each instant"
    return reason_against_type(first.dtype)


def _unit(channel: Any) -> str:
    """Return the unit of a channel's values: of the channel, or of its conversion."""
    units = (getattr(source, "unit", "") for source in (channel, channel.conversion))
    return next((str(unit).strip(" \0\t\r\n") for unit in units if unit), "")


def _start(file: Any, group: int) -> StartTime | None:
    """Return the time of a group's first sample; None if the file does not say when it started."""
    start: datetime = file.header.start_time
    zoned = start if start.tzinfo else start.replace(tzinfo=UTC)
    since_us = (zoned - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1)
    if since_us <= 0:
        return None
    (first_s,) = real_numbers(file.get_master(group, record_count=1))
    return StartTime(since_us * 1000 + round(float(first_s) * 1e9), epoch=True)


def _generation(file: Any) -> int:
    return 4 if str(file.version) >= "4" else 3


def _reason_against_conversion(conversion: Any, generation: int) -> str:
    """Return why a channel's conversion is refused; "" if it is arithmetic or absent."""
    kind = 0 if conversion is None else int(conversion.conversion_type)
    if kind in _ARITHMETIC[generation] and not getattr(conversion, "referenced_blocks", None):
        return ""
    return "converted by a formula, which would be code" if kind == _FORMULA[generation] else "text"


def _refuse_formulas_of_time(file: Any, where: str) -> None:
    """Refuse groups whose time stamps are not arithmetic: they are read with every channel."""
    for group, index in file.masters_db.items():
        channel = file.groups[group].channels[index]
        if reason := _reason_against_conversion(channel.conversion, _generation(file)):
            raise InputError(
                "The time stamps of the file cannot be used.",
                expected="time stamps as numbers, or with a linear conversion",
                found=f"{channel.name!r} is {reason}",
                where=where,
                remedy="export the data with converted time stamps, or as CSV",
            )


def _signal(file: Any, group: int, index: int) -> FloatArray:
    """Return the samples of a channel; those that the file declares invalid are NaN.

    asammdf would leave them out and shift the others.
    """
    content = file.groups[group]
    if content.channel_dependencies[index] or _reason_against_conversion(
        content.channels[index].conversion, _generation(file)
    ):
        raise ValueError("the file has changed since it was opened")
    signal = file.get(group=group, index=index, ignore_invalidation_bits=True)
    values = real_numbers(signal.samples)
    valid = file.get(group=group, index=index)
    if valid.samples.size != values.size:
        values[~np.isin(signal.timestamps, valid.timestamps)] = np.nan
    return values


MDF = Reader(name="mdf", title="MDF (ASAM)", endings=(".mf4", ".mdf"), open=MdfFile, extra="mdf")
