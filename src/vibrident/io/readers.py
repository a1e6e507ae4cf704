"""Which reader belongs to which file ending."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

from vibrident import registry
from vibrident.errors import InputError
from vibrident.io.columns import ColumnFile
from vibrident.io.reader import Reader


class _ByEnding(Mapping[str, Reader]):
    """Ending → reader, of the built-in ones and those of plug-ins; of two readers of one ending the built-in one."""

    def _all(self) -> dict[str, Reader]:
        found: dict[str, Reader] = {}
        for reader in registry.READERS.all().values():
            for ending in reader.endings:
                found.setdefault(ending, reader)
        return found

    def __getitem__(self, ending: str) -> Reader:
        return self._all()[ending]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())


READERS: Mapping[str, Reader] = _ByEnding()


_SPREADSHEETS = frozenset({".xlsx", ".xlsm", ".xlsb", ".xls", ".ods", ".fods", ".numbers"})


def open_columns(path: Path) -> ColumnFile:
    """Open a data file with the reader for its ending; numbers are converted only when asked for.

    Raises:
        InputError: the ending is not known, or the file is not what its ending says.
    """
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise unknown_format(path.suffix, str(path))
    if os.path.exists(path) and not (path.is_file() or path.is_dir()):  # of a folder, the system's own words are better
        raise InputError(
            "This is no file.",
            expected="a file on a disk",
            found="a device, a pipe or a socket, which may never end",
            where=str(path),
            remedy="write its data into a file first",
        )
    return reader.open(path)


def unknown_format(suffix: str, where: str) -> InputError:
    """The error of a file ending that no reader is for; a spreadsheet is told apart."""
    if suffix.lower() in _SPREADSHEETS:
        return InputError(
            "A spreadsheet is not read.",
            expected="a text file of columns, such as CSV, or one of " + ", ".join(READERS),
            found=repr(suffix),
            where=where,
            remedy='open it and save the sheet as CSV ("CSV UTF-8"), one header line above the numbers',
        )
    return InputError(
        "The file's format is not known.",
        expected="a file ending in " + ", ".join(READERS),
        found=repr(suffix) if suffix else "no ending",
        where=where,
        remedy="rename the file, or export it as CSV or HDF5",
    )
