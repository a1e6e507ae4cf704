"""Ordered columns of numbers, and places of values in them, common to all file formats.

A file of a few kilobytes can declare more numbers than any machine holds: the number is checked
before memory is allocated.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrident.base import extras, memory
from vibrident.base.brief import first_names
from vibrident.base.errors import InputError, did_you_mean
from vibrident.data.io.units import split_brackets
from vibrident.data.records import FloatArray

MAX_COLUMNS = 10_000  # of a file
MAX_LINE_LENGTH = 1 << 18  # characters of a line of text
_MAX_NAMES_IN_MESSAGE = 12  # further names are counted only
_MAX_NAME_LENGTH = 100  # characters; longer names are cut
_NUMBER_BYTES = 8

#: What the system says of a file → reason and remedy.
_REASONS: dict[type[BaseException], tuple[str, str]] = {
    FileNotFoundError: (
        "no file of that name",
        "check the path; paths in a calibration file start at its folder",
    ),
    IsADirectoryError: (
        "a folder",
        "name a file in it; a calibration file may name data files by a glob, file = 'x/*.csv'",
    ),
    PermissionError: ("a file that may not be read", "ask for the right to read it"),
}
#: Places of columns in ``names`` of a file, from 0.
Positions = Sequence[int]
IntArray = NDArray[np.int64]
#: Description of a row's place, for messages.
Locate = Callable[[int], str]


def require_room(path: Path, numbers: int, number_bytes: int = _NUMBER_BYTES) -> None:
    """Refuse to read more numbers, as declared, than a file of this size may hold."""
    file_bytes = path.stat().st_size
    allowed = memory_for(file_bytes)
    needed = max(numbers, 0) * max(number_bytes, _NUMBER_BYTES)
    if needed > allowed:
        raise InputError(
            "The file declares more numbers than it may hold.",
            expected=f"at most {allowed / 1e6:.0f} MB of numbers from a file of {file_bytes} bytes",
            found=f"{numbers} numbers, or {needed / 1e6:.0f} MB",
            where=str(path),
            remedy="check that the file is whole; if so, set "
            f"⟦environment.{memory.VARIABLE}⟧ to more megabytes",
        )


def memory_for(file_bytes: int) -> float:
    """Return the largest number of bytes that the numbers of files of this size may take.

    Raises:
        InputError: the limit in the environment is not a number.
    """
    try:
        return memory.max_bytes(file_bytes)
    except ValueError as error:
        raise InputError(
            "The limit of memory is not a number.",
            expected=f"⟦environment.{memory.VARIABLE}⟧ to be a number of megabytes above 0",
            found=str(error),
            where="environment",
            remedy=f"correct or unset ⟦environment.{memory.VARIABLE}⟧",
        ) from error


def require_few(path: Path, columns: Sequence[object], what: str = "columns") -> None:
    """Refuse a file with more than ``MAX_COLUMNS`` columns."""
    if len(columns) > MAX_COLUMNS:
        raise InputError(
            f"The file has too many {what}.",
            expected=f"at most {MAX_COLUMNS}",
            found=str(len(columns)),
            where=str(path),
            remedy="export only the needed ones",
        )


@dataclass(frozen=True)
class StartTime:
    """Time of a first sample; comparable only if both or neither are of the epoch."""

    ns: int
    epoch: bool  # since 1970-01-01 UTC; else since the file's own zero, such as its trigger

    @classmethod
    def on_own_clock(cls, seconds: float) -> StartTime:
        """Return a start in seconds from the file's own zero."""
        return cls(round(seconds * 1e9), epoch=False)

    @classmethod
    def on_date(cls, date: np.datetime64, later_s: float = 0.0) -> StartTime:
        """Return a start at a date in UTC, or some seconds later."""
        ns = int(date.astype("datetime64[ns]").astype(np.int64))
        return cls(ns + round(later_s * 1e9), epoch=True)


@dataclass(frozen=True)
class Clock:
    """Sampling of a column as a file states it."""

    rate_hz: float  # samples per second
    rate_rounding: float = 1e-9  # relative; most that the file's rounding changes the true rate
    start: StartTime | None = None  # of the first sample; None if the file states none


@dataclass(frozen=True)
class Channel:
    """Column of real numbers.

    A complex array NAME has the channels NAME.real and NAME.imag; a frequency response whose file
    states its axis also has NAME.frequency, in Hz.

    Attributes:
        name: as the calibration file uses it; "" for a column without a name.
        handle: by which the format's library finds it.
        clock: sampling that the file states; None if it states none.
        in_seconds: True for a time type, loaded in seconds since the first.
        unit: stated beside the name; "" if none.
        over_frequency: True for values over frequency, which no record is.
        start: time of the first sample, if it is stated without a rate.
        samples: number that the file declares; 0 where it declares none.
    """

    name: str
    handle: Any = None
    clock: Clock | None = None
    in_seconds: bool = False
    unit: str = ""
    over_frequency: bool = False
    start: StartTime | None = None
    samples: int = 0


class ColumnFile:
    """A file of columns, opened but not yet converted; a subclass for each format reads them.

    A position is a column's place in ``names``, from 0. What the user writes in the calibration
    file (a number from 1, or a name) becomes a position through ``position_of``.
    """

    expected = "a file of columns"  # what a sound file is, for messages
    names_are_paths = False  # True for a unit in the last part only
    word = "channel"  # what the format calls a column

    def __init__(self, path: Path, channels: Sequence[Channel], refused: Mapping[str, str]) -> None:
        """Take the usable columns, and the refused ones: name → reason.

        Raises:
            InputError: there is no usable column, or too many.
        """
        self._path = path
        self._channels = tuple(channels)
        self._refused = refused
        self._loaded: dict[int, FloatArray] = {}  # columns that were read to give a part of them
        require_few(path, self._channels, f"{self.word}s")
        if not self._channels:
            reasons = "; ".join(
                f"{name!r} is {reason}" for name, reason in list(refused.items())[:5]
            )
            raise InputError(
                f"The file holds no {self.word} of numbers.",
                expected=f"one {self.word} of real numbers or more",
                found=reasons or f"no {self.word}s",
                where=str(path),
                remedy="check that the file is whole and holds time signals as plain numbers",
            )

    @property
    def file(self) -> str:
        """Return the name of the file for messages."""
        return str(self._path)

    @property
    def names(self) -> tuple[str, ...]:
        """Return the name of each column; repeats are possible."""
        return tuple(channel.name for channel in self._channels)

    @property
    def numbered(self) -> tuple[int, ...]:
        """Return the positions of column numbers 1, 2, …; empty if numbers are ambiguous."""
        return tuple(range(len(self._channels)))

    def clock(self, position: int) -> Clock | None:
        """Return the file's statement of this column's sampling."""
        return self._channels[position].clock

    def stamps(self, position: int) -> FloatArray | None:
        """Return the time of each sample in seconds, where the format gives a channel its own."""
        return None

    def start(self, position: int) -> StartTime | None:
        """Return the time of a column's first sample: by its clock, or by its first date."""
        if self.in_seconds(position):
            return self._first_date(position)
        clock = self.clock(position)
        by_clock = None if clock is None else clock.start
        return by_clock or self._channels[position].start

    def _first_date(self, position: int) -> StartTime | None:
        """Return the first date of a column of a time type; None if it has none."""
        return self._channels[position].start

    def stated_unit(self, position: int) -> str:
        """Return the unit of a column that the file states beside its name; "" if none."""
        return self._channels[position].unit

    def in_seconds(self, position: int) -> bool:
        """Return whether this column is of a time type."""
        return self._channels[position].in_seconds

    def may_rise(self, position: int) -> bool:
        """Return False where a few values of a column show that it does not rise."""
        return True

    def load(self, positions: Positions) -> tuple[FloatArray, ...]:
        """Convert the columns at these positions; each has shape (samples,) and may hold NaN.

        Raises:
            InputError: a column cannot be read as real numbers.
        """
        channels = [self._channels[position] for position in positions]
        with reading(self._path, self.expected):
            require_room(self._path, sum(channel.samples for channel in channels))
            columns = tuple(self._read([channel.handle for channel in channels]))
            for channel, values in zip(channels, columns, strict=True):
                if channel.samples and values.size != channel.samples:
                    sizes = f"{values.size} values where it states {channel.samples}"
                    raise ValueError(f"{channel.name!r} has {sizes}")
            return columns

    def _read(self, handles: Sequence[Any]) -> Iterable[FloatArray]:
        """Read the columns of these handles; any exception means a damaged file."""
        raise NotImplementedError

    def length(self, position: int) -> int:
        """Return the number of samples of a column."""
        return self._channels[position].samples or self._loaded_columns([position])[0].size

    def block(self, positions: Positions, start: int, stop: int) -> FloatArray:
        """Return samples of columns from ``start`` up to ``stop``; errors as ``load``.

        The shape is (columns, stop − start). Formats that cannot read a part of a file keep all of
        it in memory.
        """
        return np.stack([values[start:stop] for values in self._loaded_columns(positions)])

    def reads_parts(self, position: int) -> bool:
        """Return whether ``block`` reads a part of a column alone, whose clock needs no stamps."""
        return False

    def _loaded_columns(self, positions: Positions) -> list[FloatArray]:
        missing = [position for position in positions if position not in self._loaded]
        self._loaded.update(zip(missing, self.load(missing) if missing else (), strict=True))
        return [self._loaded[position] for position in positions]

    def locate(self, position: int, row: int) -> str:
        """Return the place of a value for messages; ``row`` counts samples from 0."""
        return f"{self.file}, {self.word} {self.names[position]!r}, sample {row + 1}"

    def require_finite(
        self, position: int, values: FloatArray, first_row: int, remedy: str
    ) -> None:
        """Refuse a value that is missing, NaN or infinite, with its place.

        ``values``: of the column, shape (samples,); ``first_row``: row of the first, from 0.
        """
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            value = values[bad[0]]
            raise InputError(
                "A value that is needed is not a number.",
                expected="finite numbers",
                found=f"{'an empty cell, NaN or an overflow' if np.isnan(value) else value}; "
                f"{bad.size} such in this column",
                where=self.locate(position, first_row + int(bad[0])),
                remedy=remedy,
            )

    def require_over_time(self, position: int, key: str) -> None:
        """Refuse a column over frequency where a signal over time is needed."""
        if self._channels[position].over_frequency:
            raise InputError(
                f"The {self.word} {self.names[position]!r} cannot be used.",
                expected=f"a {self.word} of real numbers over time",
                found="values over frequency",
                where=f"{self.file}, asked for by {key}",
                remedy="name a signal over time, or describe a response under [table]",
            )

    def position_of(self, column: int | str, key: str) -> int:
        """Return the position of a column that is named by number from 1, or by name.

        A name may leave out the unit in brackets. ``key``: the key that names it, such as
        "[response] column", for the message. InputError where the column does not exist or was
        refused, or the name is not unique.
        """
        where = f"{self.file}, asked for by {key}"
        column_name = self._plain_name(str(column))
        if column_name in self._refused and column_name not in self.names:
            raise InputError(
                f"The {self.word} {column!r} cannot be used.",
                expected=f"a {self.word} of real numbers over time",
                found=self._refused[column_name],
                where=where,
                remedy=f"choose another {self.word}, or store the signal as plain numbers",
            )
        if isinstance(column, int):
            return self._position_of_number(column, where)
        plain = [split_brackets(name)[0] for name in self.names]  # "S" for "S [mV/g]"
        for names in (self.names, plain):
            matches = [position for position, name in enumerate(names) if name == column_name]
            if len(matches) == 1:
                return matches[0]
            if matches:
                numbers = [self.numbered.index(p) + 1 for p in matches if p in self.numbered]
                raise InputError(
                    f"The column name {column!r} is not unique.",
                    expected="a name that occurs once in the header, or a column number",
                    found=f"{len(matches)} columns of that name",
                    where=where,
                    remedy=f"use a column number instead: {' or '.join(map(str, numbers))}",
                )
        raise InputError(
            f"There is no column named {column!r}.",
            expected=self._offer(),
            found=repr(column),
            where=where,
            remedy=did_you_mean(
                column_name,
                filter(None, self.names),
                "give one of these names, or a column number from 1",
                likeness=0.4,
            ),
        )

    def _plain_name(self, name: str) -> str:
        """Return the name in the form that ``names`` uses."""
        return name.strip()

    def _position_of_number(self, number: int, where: str) -> int:
        if 1 <= number <= len(self.numbered):
            return self.numbered[number - 1]
        if not self.numbered:
            raise InputError(
                "A column number is ambiguous in this file.",
                expected=self._offer(),
                found=f"column {number}",
                where=where,
                remedy="give the name",
            )
        raise InputError(
            "There is no column of that number.",
            expected=f"a number from 1 to {len(self.numbered)}",
            found=f"column {number}",
            where=where,
            remedy="columns are counted from 1; " + self._offer(),
        )

    def _offer(self) -> str:
        named = [name for name in self.names if name]
        if not named:
            return f"a column number from 1 to {len(self.names)} (the file has no header)"
        quoted = [repr(name[:_MAX_NAME_LENGTH]) for name in named]
        return f"one of {first_names(quoted, _MAX_NAMES_IN_MESSAGE)}"


def real_numbers(values: Any) -> FloatArray:
    """Return values as float64 of shape (samples,), timestamps as seconds since the first.

    Raises:
        ValueError: the values are neither, or not of one dimension.
    """
    array = np.asarray(values)
    if array.dtype.kind == "M":
        # subtracted first, to keep the digits of the seconds
        array = (array - array[:1]) / np.timedelta64(1, "s")
    elif array.dtype.kind == "m":
        array = array / np.timedelta64(1, "s")
    if array.dtype.kind not in "iufb" or array.ndim != 1:
        raise ValueError(f"values of type {array.dtype} and shape {array.shape}")
    return np.array(array, dtype=np.float64)


def reason_against_type(dtype: np.dtype[Any]) -> str:
    """Return why values of a type are no real numbers; "" if they are."""
    if dtype.kind in "iufb":
        return ""
    return {"c": "complex", "O": "text", "U": "text", "S": "text"}.get(dtype.kind, str(dtype))


def library(name: str, extra: str, path: Path) -> Any:
    """Import a format's library ``name``, which ``path`` needs and ``extra`` installs."""
    return extras.library(
        name, extra, "This file format needs a library that is not installed.", str(path)
    )


def require_regular(path: Path, what: str) -> None:
    """Refuse a file that may never end; the system reports a missing file or a folder better."""
    if os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path)):
        raise InputError(
            "This is not a regular file.",
            expected=f"{what} on a disk",
            found="a device, a pipe or a socket, which may never end",
            where=str(path),
            remedy="write its data into a file first",
        )


@contextmanager
def reading(path: Path, expected: str) -> Iterator[None]:
    """Turn any exception of a format's library about a damaged file into InputError.

    The file is opened and closed first, because the system's error is clearer than a library's.
    """
    try:
        path.open("rb").close()
        yield
    except InputError:
        raise
    except Exception as error:
        raise unreadable(str(path), error, expected) from error


def unreadable(file: str, error: BaseException, expected: str) -> InputError:
    """Return the InputError for a file that the system or a format library refuses."""
    if isinstance(error, MemoryError):
        return InputError(
            "The file does not fit in memory.",
            expected="a file whose numbers fit in the free memory",
            found=f"a file that needs more: {error}".rstrip(": "),
            where=file,
            remedy="check that the file is whole; read a shorter record, or free memory",
        )
    reason, remedy = _REASONS.get(
        type(error), (f"{type(error).__name__}: {error}", "check that the file is whole")
    )
    return InputError(
        "The file cannot be read.", expected=expected, found=reason, where=file, remedy=remedy
    )
