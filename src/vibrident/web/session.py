"""One user's files: a private folder, names made safe, a limit on the size, and nothing left when the page closes."""

from __future__ import annotations

import re
import shutil
import tempfile
from pathlib import Path, PurePosixPath
from typing import TypeVar

from vibrident.errors import InputError, VibridentError
from vibrident.io.readers import READERS

CALIBRATION, RESULT = "calibration.toml", "result.json"
MEGABYTE = 1_000_000
MOST_FILES = 500
_LONGEST_NAME = 120
_UNSAFE = re.compile(r"[^\w.+ -]+")
_RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)
_T = TypeVar("_T", bound=VibridentError)


class Session:
    """Files of one open page, in a folder that nobody else may read.

    Args:
        limit_mb: most megabytes of all files together.
    """

    def __init__(self, limit_mb: float) -> None:
        self.limit_mb = limit_mb
        self.folder = Path(tempfile.mkdtemp(prefix="vibrident-"))
        self.data = self.folder / "data"
        self.data.mkdir()
        self._written = False

    def close(self) -> None:
        """Remove every file."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def clear(self) -> None:
        """Forget the data, keep the results that were made of them."""
        self._written = False
        shutil.rmtree(self.data, ignore_errors=True)
        self.data.mkdir(parents=True, exist_ok=True)

    @property
    def files(self) -> list[str]:
        """Names of the data files, in natural order."""
        names = [path.name for path in self.data.iterdir() if path.suffix.lower() in READERS]
        return sorted(names, key=lambda name: [int(p) if p.isdigit() else p for p in re.split(r"(\d+)", name)])

    @property
    def used_bytes(self) -> int:
        """Size of all data files."""
        return sum(path.stat().st_size for path in self.data.iterdir())

    @property
    def calibration(self) -> str | None:
        """Name of the calibration file that came with the data; the page's own is none.

        Raises:
            InputError: several came, and none of them has the usual name.
        """
        names = sorted(path.name for path in self.data.iterdir() if path.suffix.lower() == ".toml")
        if self._written:
            names.remove(CALIBRATION)
        if len(names) > 1 and CALIBRATION not in names:
            raise InputError(
                "More than one calibration file came with the data.",
                expected=f"one, or one that is named {CALIBRATION}",
                found=", ".join(names),
                where="upload",
                remedy="start anew with one of them",
            )
        return None if not names else CALIBRATION if CALIBRATION in names else names[0]

    def write_calibration(self, text: str) -> None:
        """Write what was confirmed on the page, for the identification to read."""
        (self.data / CALIBRATION).write_text(text, encoding="utf-8")
        self._written = True

    def forget_calibration(self) -> None:
        """Remove what the page wrote: with other data, it no longer holds."""
        if self._written:
            (self.data / CALIBRATION).unlink(missing_ok=True)
            self._written = False

    def place_for(self, name: str, size: int) -> Path:
        """Where to put a file of this name and size. A calibration file takes the place of one of the same name.

        Raises:
            InputError: the format is not read here, a file of that name is there, or there is no room for it.
        """
        safe = safe_name(name)
        if Path(safe).suffix.lower() not in {*READERS, ".toml", ".json"}:
            raise InputError(
                "The file's format is not known.",
                expected="a file ending in " + ", ".join(READERS),
                found=repr(Path(safe).suffix) if Path(safe).suffix else "no ending",
                where=safe,
                remedy="rename the file, or export it as CSV or HDF5",
            )
        place = self.data / safe
        if place.exists() and place.suffix.lower() != ".toml":
            raise InputError(
                "A file of that name is here already.",
                expected="a name of its own for each file",
                found=repr(safe),
                where="upload",
                remedy="rename one of the two, or start anew",
            )
        if self.used_bytes + size > self.limit_mb * MEGABYTE or len(list(self.data.iterdir())) >= MOST_FILES:
            raise too_large(self.limit_mb, safe)
        if safe.lower() == CALIBRATION:
            self.forget_calibration()
        return place

    def local(self, error: _T) -> _T | InputError:
        """The error as the command line words it in the folder of the data: without the path of this machine."""
        if not isinstance(error, InputError):
            return error
        here = f"{self.data}/"
        fields = {key: value.replace(here, "") for key, value in vars(error).items()}
        return type(error)(**fields)


def safe_name(name: str) -> str:
    """A file name that stays in its folder, on any system: no path, no control character, no reserved word."""
    last = PurePosixPath(name.replace("\\", "/")).name
    plain = _UNSAFE.sub("_", last).strip(" .") or "file"
    if _RESERVED.fullmatch(plain) or plain.startswith("-"):
        plain = f"_{plain}"
    if len(plain) <= _LONGEST_NAME:
        return plain
    room = _LONGEST_NAME - len(Path(plain).suffix)
    return plain[:room] + Path(plain).suffix if room > 0 else plain[:_LONGEST_NAME]


def too_large(limit_mb: float, where: str = "upload") -> InputError:
    """The error of an upload beyond the limit."""
    return InputError(
        "The files are too large for the page.",
        expected=f"at most {limit_mb:g} MB and {MOST_FILES} files in all",
        found="more",
        where=where,
        remedy="start with vibrident serve --limit-mb N, or use vibrident identify in a shell",
    )


def refuse_outside(file: Path) -> None:
    """Refuse a calibration file that names files beyond its own folder: on a server they would be somebody else's.

    Raises:
        InputError: a path is absolute or leads upwards, or the file cannot be read.
    """
    from vibrident.io.calibration_file import read_calibration_file

    document = read_calibration_file(file)
    named = [document.table.file] if document.table else []
    for entry in document.records:
        named += [entry.file, *([entry.reference_file] if entry.reference_file else [])]
    for name in named:
        parts = re.split(r"[/\\]", name)
        if parts[0] in ("", "~") or ".." in parts or ":" in parts[0]:
            raise InputError(
                "The page reads files beside the calibration file only.",
                expected="the name of an uploaded file, or a glob",
                found=repr(name),
                where=f"{file}, file",
                remedy="upload that file and write its name alone",
            )
