"""MDF files (ASAM), version 4 and before: channels of all groups, with the rate of their group's time stamps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.io.channels import Channel, ChannelFile, real_numbers
from vibrident.io.clocks import clock_from_times
from vibrident.io.columns import Clock, unreadable
from vibrident.io.extra import let_go, library
from vibrident.records import FloatArray

_EXPECTED = "an MDF file of measured signals, written to its end"


class MdfFile(ChannelFile):
    """An MDF file; values are converted as the file says, and samples that it declares invalid are no numbers."""

    def __init__(self, path: Path) -> None:
        """List the channels.

        Raises:
            InputError: asammdf is not installed, or the file is no MDF file.
        """
        self._mdf = library("asammdf", "mdf", path).MDF
        self._clocks: dict[int, Clock | None] = {}
        channels: list[Channel] = []
        refused: dict[str, str] = {}
        try:
            with path.open("rb") as stream, self._mdf(stream) as file:
                for group, index, name in _listed(file):
                    if reason := _reason_against(file, group, index):
                        refused[name] = reason
                    else:
                        channels.append(Channel(name, (group, index)))
        except Exception as error:  # damaged files raise anything, from struct.error to MdfException
            let_go(error)
            raise unreadable(str(path), error, _EXPECTED) from error
        super().__init__(path, channels, refused)

    def clock(self, position: int) -> Clock | None:
        """Return the rate by regression over the time stamps of the channel's group.

        Raises:
            InputError: the time stamps have a gap, or the file is damaged.
        """
        group, _ = self._channels[position].handle
        if group not in self._clocks:
            try:
                with self._path.open("rb") as stream, self._mdf(stream) as file:
                    times_s = real_numbers(file.get_master(group))
            except Exception as error:
                let_go(error)
                raise unreadable(self.file, error, _EXPECTED) from error
            self._clocks[group] = clock_from_times(times_s, lambda row: f"time stamp of {self.locate(position, row)}")
        return self._clocks[group]

    def load(self, positions: Sequence[int]) -> tuple[FloatArray, ...]:
        """Read these channels; each has shape (samples,).

        Raises:
            InputError: the file is damaged.
        """
        try:
            with self._path.open("rb") as stream, self._mdf(stream) as file:
                return tuple(_signal(file, *self._channels[position].handle) for position in positions)
        except Exception as error:
            let_go(error)
            raise unreadable(self.file, error, _EXPECTED) from error


def _listed(file: Any) -> list[tuple[int, int, str]]:
    """Group, index and name of every channel but the time stamps."""
    return [
        (group, index, channel.name)
        for group, content in enumerate(file.groups)
        for index, channel in enumerate(content.channels)
        if index != file.masters_db.get(group)
    ]


def _reason_against(file: Any, group: int, index: int) -> str:
    if file.groups[group].channel_group.cycles_nr == 0:
        return "empty"
    first = file.get(group=group, index=index, record_count=1).samples
    if first.ndim != 1 or first.dtype.names:
        return "an array or a structure at each instant"
    if first.dtype.kind in "iufb":
        return ""
    return {"c": "complex", "S": "text", "U": "text", "O": "text"}.get(first.dtype.kind, str(first.dtype))


def _signal(file: Any, group: int, index: int) -> FloatArray:
    """Samples that the file declares invalid become no numbers; asammdf would leave them out, and shift the rest."""
    signal = file.get(group=group, index=index, ignore_invalidation_bits=True)
    values = real_numbers(signal.samples)
    stated = file.groups[group].channel_group.cycles_nr
    if values.size != stated:
        raise ValueError(f"{values.size} of {stated} samples")
    valid = file.get(group=group, index=index)
    if valid.samples.size != stated:
        values[~np.isin(signal.timestamps, valid.timestamps)] = np.nan
    return values
