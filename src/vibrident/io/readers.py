"""Which reader belongs to which file ending. A new format is one module and one line here."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from vibrident.errors import InputError
from vibrident.io.columns import ColumnFile
from vibrident.io.csv_file import CsvFile
from vibrident.io.hdf5_file import Hdf5File
from vibrident.io.matlab_file import open_matlab_file
from vibrident.io.mdf_file import MdfFile
from vibrident.io.parquet_file import ParquetFile
from vibrident.io.seismic_file import MiniSeedFile, SacFile
from vibrident.io.tdms_file import TdmsFile
from vibrident.io.uff_file import UffFile
from vibrident.io.wav_file import WavFile

READERS: Mapping[str, Callable[[Path], ColumnFile]] = MappingProxyType(
    {
        ".csv": CsvFile,
        ".txt": CsvFile,
        ".dat": CsvFile,
        ".asc": CsvFile,
        ".tsv": CsvFile,
        ".h5": Hdf5File,
        ".hdf5": Hdf5File,
        ".hdf": Hdf5File,
        ".mat": open_matlab_file,
        ".wav": WavFile,
        ".tdms": TdmsFile,
        ".uff": UffFile,
        ".unv": UffFile,
        ".mseed": MiniSeedFile,
        ".miniseed": MiniSeedFile,
        ".sac": SacFile,
        ".mf4": MdfFile,
        ".mdf": MdfFile,
        ".parquet": ParquetFile,
        ".pq": ParquetFile,
    }
)


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
    return reader(path)


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
