"""Base of the formats with named channels: a name, a clock and a handle for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vibrident import extras
from vibrident.errors import InputError
from vibrident.io.allowance import require_few
from vibrident.io.columns import Clock, ColumnFile
from vibrident.records import FloatArray


@dataclass(frozen=True)
class Channel:
    """One channel of real numbers.

    Attributes:
        name: as the calibration file uses it.
        handle: by which the format's library finds it.
        clock: the file's statement of its sampling; None if absent.
        in_seconds: True for a time type, loaded in seconds.
    """

    name: str
    handle: Any
    clock: Clock | None = None
    in_seconds: bool = False


class ChannelFile(ColumnFile):
    """A file of channels; subclasses read them. Numbers count the channels of real numbers.

    Attributes:
        word: what the format calls a channel.
    """

    word = "channel"

    def __init__(self, path: Path, channels: Sequence[Channel], refused: dict[str, str]) -> None:
        """Take the usable channels, and the refused ones: name → reason.

        Raises:
            InputError: no channel is usable.
        """
        self._path = path
        self._channels = tuple(channels)
        self._refused = refused
        require_few(path, self._channels, f"{self.word}s")
        if not self._channels:
            reasons = "; ".join(f"{name!r} is {reason}" for name, reason in list(refused.items())[:5])
            raise InputError(
                f"The file holds no {self.word} of numbers.",
                expected=f"one {self.word} of real numbers or more",
                found=reasons or f"no {self.word}s",
                where=str(path),
                remedy="check that the file is whole and holds time signals as plain numbers",
            )

    @property
    def file(self) -> str:
        """Name of the file in messages."""
        return str(self._path)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each channel; repeats are possible."""
        return tuple(channel.name for channel in self._channels)

    @property
    def numbered(self) -> tuple[int, ...]:
        """All usable channels, in the order of the file."""
        return tuple(range(len(self._channels)))

    def clock(self, position: int) -> Clock | None:
        """Return the file's statement of this channel's sampling."""
        return self._channels[position].clock

    def in_seconds(self, position: int) -> bool:
        """Whether this channel is of a time type."""
        return self._channels[position].in_seconds

    def position_of(self, column: int | str, key: str) -> int:
        """Return the position of a channel; see ColumnFile. The error states why one was refused."""
        name = self._plain_name(str(column))
        if name in self._refused and name not in self.names:
            raise InputError(
                f"The {self.word} {column!r} cannot be used.",
                expected=f"a {self.word} of real numbers over time",
                found=self._refused[name],
                where=f"{self.file}, asked for by {key}",
                remedy=f"choose another {self.word}, or store the signal as plain numbers",
            )
        return super().position_of(column, key)

    def locate(self, position: int, row: int) -> str:
        """File, channel and sample of a value."""
        return f"{self.file}, {self.word} {self.names[position]!r}, sample {row + 1}"


def real_numbers(values: Any) -> FloatArray:
    """Return values as float64 of shape (samples,), timestamps as seconds since the first.

    Raises:
        ValueError: they are not one real number a sample.
    """
    array = np.asarray(values)
    if array.dtype.kind == "M":
        array = (array - array[:1]) / np.timedelta64(1, "s")  # subtracted first, to keep the digits of the seconds
    elif array.dtype.kind == "m":
        array = array / np.timedelta64(1, "s")
    if array.dtype.kind not in "iufb" or array.ndim != 1:
        raise ValueError(f"values of type {array.dtype} and shape {array.shape}")
    return np.array(array, dtype=np.float64)


def library(name: str, extra: str, path: Path) -> Any:
    """Import a format's library, ``name``, which the extra ``extra`` of this package installs.

    Raises:
        InputError: it is not installed; ``path`` needs it.
    """
    return extras.library(name, extra, "This file format needs a library that is not installed.", str(path))
