"""Store one user's files: a private folder, names made safe, limits on sizes and numbers."""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import secrets
import shutil
from collections.abc import AsyncIterator, Callable
from pathlib import Path, PurePosixPath
from typing import Any

from vibrident.base.errors import InputError
from vibrident.base.fields import Fields
from vibrident.data.io.reader import by_ending, unknown_format
from vibrident.data.io.record_files import natural_sort_key

CALIBRATION = "calibration.toml"  # name of the calibration file that the page writes
RESULT = "result.json"  # name of a result when it is downloaded
MEGABYTE = 1_000_000
MAX_FILES = 500
MAX_RESULTS = 20  # most results of one page; the oldest are evicted
ACCEPTED_ENDINGS = (*by_ending(), ".toml", ".json")  # endings of accepted files
#: Endings of responses of instruments, which no reader of records takes.
RESPONSE_ENDINGS = (".xml", ".resp", ".pz", ".sacpz")
_MAX_NAME_LENGTH = 120
_MAX_DOWNLOADS = 4
_UNSAFE = re.compile(r"[^\w.+ -]+")
_RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)


class PageSession:
    """Files of one user, in a private folder below ``parent``.

    The folder is made with the first file; ``name``: of a kept one. ``limit_mb``: most megabytes of
    the data, and of the results. ``room`` is called with the bytes to come and refuses those that
    the server has no room for.
    """

    def __init__(
        self,
        parent: Path,
        limit_mb: float,
        room: Callable[[int], None] = lambda size: None,
        name: str = "",
    ) -> None:
        self.limit_mb = limit_mb
        self.folder = parent / (name or secrets.token_hex(16))
        self.data = self.folder / "data"
        self.results = self.folder / "results"
        self._room = room
        self._sizes: dict[str, int] = {}
        self._result_sizes: dict[Path, int] = {}
        self._files_made = 0
        self._written = False
        self._response_files: set[str] = set()

    def open(self) -> None:
        """Make the folders unless they exist."""
        for folder in (self.data, self.results):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)

    def close(self) -> None:
        """Remove every file."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self._sizes = {}
        self._result_sizes = {}
        self._response_files = set()
        self._written = False

    def laboratory_file(self, kind: str) -> Path | None:
        """Return the path of the laboratory's ``logo`` or ``template``; None if there is none."""
        path = self.folder / f"own-{kind}"
        return path if path.exists() else None

    def keep_laboratory_file(self, kind: str, content: bytes) -> None:
        """Replace the laboratory's own ``logo`` or ``template``; no content removes it."""
        self.open()
        path = self.folder / f"own-{kind}"
        if content:
            path.write_bytes(content)
        else:
            path.unlink(missing_ok=True)

    def clear(self) -> None:
        """Remove the data, keep their results."""
        shutil.rmtree(self.data, ignore_errors=True)
        self._sizes = {}
        self._response_files = set()
        self._written = False

    @property
    def names(self) -> list[str]:
        """Return the names of all files, in natural_sort_key order."""
        page_files = {CALIBRATION} if self._written else set()
        return sorted(set(self._sizes) - page_files, key=natural_sort_key)

    @property
    def files(self) -> list[str]:
        """Return the names of the data files, in natural order."""
        readers = by_ending()
        names = [name for name in self.names if name not in self._response_files]
        return [name for name in names if Path(name).suffix.lower() in readers]

    @property
    def known_files(self) -> list[str]:
        """Return the names of the files that state known responses, in natural order."""
        return [name for name in self.names if name in self._response_files]

    @property
    def used_bytes(self) -> int:
        """Return the size of all files, including the results."""
        return sum(self._sizes.values()) + sum(self._result_sizes.values())

    @property
    def calibration(self) -> str | None:
        """Return the name of the uploaded calibration file; None if there is none.

        InputError if there are several and none has the usual name.
        """
        names = [name for name in self.names if Path(name).suffix.lower() == ".toml"]
        if len(names) > 1 and CALIBRATION not in names:
            raise InputError(
                "More than one calibration file came with the data.",
                expected=f"one, or one that is named {CALIBRATION}",
                found=", ".join(names),
                where="upload",
                remedy="remove the others, or use them all under “More with these data”",
            )
        return None if not names else CALIBRATION if CALIBRATION in names else names[0]

    def write_calibration(self, text: str) -> None:
        """Write the confirmed calibration file, for the identification."""
        self.open()
        (self.data / CALIBRATION).unlink(missing_ok=True)  # a hard link to it may be in use
        (self.data / CALIBRATION).write_text(text, encoding="utf-8")
        self._sizes[CALIBRATION] = (self.data / CALIBRATION).stat().st_size
        self._written = True

    def forget_calibration(self) -> None:
        """Remove the page's calibration file: it does not hold for other data."""
        if self._written:
            self.remove(CALIBRATION)

    def reserve_path(self, name: str, size: int, *, is_response: bool = False) -> Path:
        """Return the path for a file of this name and size.

        A calibration file replaces one of its name; ``is_response``: it states a known response.
        """
        safe = safe_name(name)
        endings = (*by_ending(), ".json", *RESPONSE_ENDINGS) if is_response else ACCEPTED_ENDINGS
        if Path(safe).suffix.lower() not in endings:
            raise unknown_format(Path(safe).suffix, safe)
        if safe.lower() == CALIBRATION:
            self.forget_calibration()
        existing = {used.lower(): used for used in self._sizes}.get(safe.lower())
        if existing is not None and Path(safe).suffix.lower() != ".toml":
            raise InputError(
                "A file of that name already exists.",
                expected="a unique name for each file",
                found=repr(safe),
                where="upload",
                remedy="remove the existing one, or rename one of the two",
            )
        data_bytes = sum(self._sizes.values())
        if data_bytes + size > self.limit_mb * MEGABYTE or len(self._sizes) >= MAX_FILES:
            raise too_large_error(self.limit_mb, safe)
        self._room(size)
        self.open()
        if existing is not None:
            self.remove(existing)
        self._sizes[safe] = size
        if is_response:
            self._response_files.add(safe)
        return self.data / safe

    async def save_upload(self, file: Any, *, is_response: bool = False) -> Path:
        """Save an uploaded file and return its path, as of :meth:`reserve_path`."""
        path = self.reserve_path(file.name, file.size(), is_response=is_response)
        try:
            await file.save(path)
        except BaseException:
            self.remove(path.name)
            raise
        return path

    def remove(self, name: str) -> None:
        """Remove one file."""
        if self._sizes.pop(name, None) is not None:
            (self.data / name).unlink(missing_ok=True)
            self._response_files.discard(name)
            self._written = self._written and name != CALIBRATION

    @property
    def state(self) -> Fields:
        """Return what the folders do not tell: sizes, and whether the page wrote a file."""
        response_files = sorted(self._response_files)
        return {"sizes": dict(self._sizes), "written": self._written, "known": response_files}

    def restore(self, state: Fields) -> None:
        """Take up a folder that was kept; a file that had not arrived whole is removed."""
        for path in self.folder.iterdir():
            if path.is_dir() and path not in (self.data, self.results):
                shutil.rmtree(path, ignore_errors=True)
        self.open()
        for path in list(self.data.iterdir()):
            if state["sizes"].get(path.name) != path.stat().st_size:
                path.unlink()
        self.rescan()
        self._written = state["written"] and CALIBRATION in self._sizes
        self._response_files = {*state.get("known", ())} & {*self._sizes}
        result_files = sorted(self.results.glob("*.json"), key=lambda path: int(path.stem))
        for path in result_files:
            both = (path, path.with_suffix(".toml"))
            self._result_sizes[path] = sum(file.stat().st_size for file in both if file.exists())
        self._files_made = max((int(path.stem) for path in result_files), default=0)

    def rescan(self) -> None:
        """Update the list of files after another process has written."""
        self._sizes = {path.name: path.stat().st_size for path in self.data.iterdir()}

    @contextlib.asynccontextmanager
    async def new_folder(self, name: str) -> AsyncIterator[Path]:
        """Yield a folder that exists for the time of the block."""
        self.open()
        self._files_made += 1
        folder = self.folder / f"{name}-{self._files_made}"
        folder.mkdir(mode=0o700)
        try:
            yield folder
        finally:
            await asyncio.to_thread(shutil.rmtree, folder, True)

    def copy_to(self, copy: Path) -> None:
        """Copy the data, so that later changes do not affect an identification."""
        for name in self._sizes:
            try:
                os.link(self.data / name, copy / name)
            except OSError:  # a file system without links
                shutil.copyfile(self.data / name, copy / name)

    def keep_result(self, source: Path, calibration: Path | None = None) -> tuple[Path, list[Path]]:
        """Move a result and its calibration file here; return its path and the evicted results."""
        moved = [source, calibration] if calibration else [source]
        size = sum(path.stat().st_size for path in moved)
        self._room(size)
        self.open()
        self._files_made += 1
        target = self.results / f"{self._files_made}.json"
        for path in moved:
            path.replace(target.with_suffix(".json" if path is source else ".toml"))
        self._result_sizes[target] = size
        evicted = []
        while len(self._result_sizes) > MAX_RESULTS or (
            len(self._result_sizes) > 1
            and sum(self._result_sizes.values()) > self.limit_mb * MEGABYTE
        ):
            oldest = next(iter(self._result_sizes))
            del self._result_sizes[oldest]
            oldest.unlink(missing_ok=True)
            oldest.with_suffix(".toml").unlink(missing_ok=True)
            evicted.append(oldest)
        return target, evicted

    def download(self, content: bytes | Path) -> Path:
        """Return a file for the browser, of bytes or a moved file; only the last few are kept."""
        self.open()
        folder = self.folder / "downloads"
        folder.mkdir(mode=0o700, exist_ok=True)
        for old in sorted(folder.iterdir(), key=lambda path: int(path.name))[: 1 - _MAX_DOWNLOADS]:
            old.unlink(missing_ok=True)
        self._files_made += 1
        target = folder / f"{self._files_made}"
        if isinstance(content, bytes):
            target.write_bytes(content)
        else:
            content.replace(target)
        return target

    def with_local_paths(self, error: InputError) -> InputError:
        """Return the error with paths relative to the folder of the data."""
        fields = dict(vars(error))
        for folder in (self.data, self.results, self.folder):
            fields = {key: value.replace(f"{folder}{os.sep}", "") for key, value in fields.items()}
        return type(error)(**fields)


def safe_name(name: str) -> str:
    """Return a file name that stays in its folder on any system.

    It has no path, no control character and no reserved word.
    """
    last = PurePosixPath(name.replace("\\", "/")).name
    plain = _UNSAFE.sub("_", last).strip(" .") or "file"
    if _RESERVED.fullmatch(plain) or plain.startswith("-"):
        plain = f"_{plain}"
    if len(plain) <= _MAX_NAME_LENGTH:
        return plain
    room = _MAX_NAME_LENGTH - len(Path(plain).suffix)
    return plain[:room] + Path(plain).suffix if room > 0 else plain[:_MAX_NAME_LENGTH]


def too_large_error(limit_mb: float, where: str = "upload") -> InputError:
    """Return the error of an upload beyond the limit."""
    return InputError(
        "The files are too large for the page.",
        expected=f"at most {limit_mb:g} MB and {MAX_FILES} files in all",
        found="more",
        where=where,
        remedy="leave files out, or ask whoever runs the server for a higher limit",
    )


def refuse_outside(file: Path) -> None:
    """Refuse a calibration file that names files outside its folder.

    These are paths that are absolute or lead upwards.
    """
    from vibrident.data.io.calibration_file import read_calibration_file
    from vibrident.data.io.known_files import known_files

    document = read_calibration_file(file)
    named = [document.table.file] if document.table else []
    for entry in document.records:
        named += [entry.file, *([entry.reference_file] if entry.reference_file else [])]
    named += known_files(document)
    for name in named:
        steps = re.split(r"[/\\]", name)
        if steps[0] in ("", "~") or ".." in steps or ":" in steps[0]:
            raise InputError(
                "The page reads files beside the calibration file only.",
                expected="the name of an uploaded file, or a glob",
                found=repr(name),
                where=f"{file}, file",
                remedy="upload that file and write its name alone",
            )
