"""Read results; write files all together or not at all.

They are written into a hidden folder in or beside the target, then moved.
"""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibrident.app.workflow.interruption import tidied_up
from vibrident.base.errors import InputError
from vibrident.base.files import unwritable

if TYPE_CHECKING:
    from vibrident.data.records import Record
    from vibrident.result import Result

_LAST = "result.json"  # moved last, so that its presence implies the others


def load_result(path: Path) -> Result:
    """Read a result; an error names the file."""
    from vibrident.result.loading import as_result

    return as_result(path)


@dataclass
class Folder:
    """A folder being written."""

    path: Path  # the temporary folder to write to
    # final paths, once all are written; in the order of the names, the result first
    files: list[Path] = field(default_factory=list)


def inputs_of(calibration: Path) -> list[Path]:
    """Return a calibration file and the data files that it names."""
    from vibrident.data.io.calibration_file import read_calibration_file
    from vibrident.data.io.known_files import known_files
    from vibrident.data.io.record_files import data_files

    document = read_calibration_file(calibration)
    folder = calibration.parent
    names = [*data_files(document, folder, str(calibration)), *known_files(document)]
    return [calibration, *(folder / name for name in names)]


def refuse_to_replace(inputs: Sequence[Path], outputs: Iterable[Path]) -> None:
    """Refuse outputs of which one would replace an input.

    Raises:
        InputError: names the file.
    """
    read = {path.resolve() for path in inputs}
    for output in outputs:
        if output.resolve() in read:
            raise InputError(
                "An output would replace a file that it is made from.",
                expected="a folder without the input files",
                found=output.name,
                where=str(output.parent),
                remedy="give another ⟦export.folder⟧",
            )


@contextlib.contextmanager
def written_whole(target: Path, inputs: Sequence[Path] = ()) -> Iterator[Folder]:
    """Collect files for ``target``, and move them there at the end; leave nothing on failure.

    Files of the same names are replaced, others stay.

    Args:
        target: the folder.
        inputs: files that no output may replace.
    """
    if target.exists() and not target.is_dir():
        raise InputError(
            "The output folder is a file.",
            expected="a folder, or a name that is free",
            found="a file",
            where=str(target),
            remedy="give another ⟦export.folder⟧",
        )
    missing = [folder for folder in (target, *target.parents) if not folder.exists()]
    # Inside an existing folder: the one above may belong to another user or file system.
    partial = (target if target.is_dir() else target.parent) / f".vibrident.{os.getpid()}.part"
    folder = Folder(partial)

    def discard() -> None:
        shutil.rmtree(partial, ignore_errors=True)
        for new_files in missing:  # empty where nothing was written
            with contextlib.suppress(OSError):
                new_files.rmdir()

    try:
        with tidied_up(discard):
            partial.mkdir(parents=True)
            yield folder
            new_files = [path for path in partial.rglob("*") if path.is_file()]
            new_files.sort(key=lambda file: (file.name == _LAST, file))
            destinations = [target / file.relative_to(partial) for file in new_files]
            refuse_to_replace(inputs, destinations)
            for file, destination in zip(new_files, destinations, strict=True):
                destination.parent.mkdir(parents=True, exist_ok=True)
                folder.files.append(file.replace(destination))
    except BrokenPipeError:
        raise
    except OSError as error:
        raise unwritable(error, target) from error
    finally:
        discard()
    folder.files.sort(key=lambda file: (file.name != _LAST, file))


def write_json(path: Path, document: Any) -> None:
    """Write a document as JSON."""
    from vibrident.result.document import json_text

    path.write_text(json_text(document), encoding="utf-8")


def refuse_filled_folder(target: Path, *, force: bool) -> None:
    """Refuse a folder that is not empty, unless forced."""
    if force or not target.is_dir() or not any(target.iterdir()):
        return
    raise InputError(
        "The output folder is not empty.",
        expected="a new or empty folder",
        found=f"{sum(1 for _ in target.iterdir())} files or folders",
        where=str(target),
        remedy="give another ⟦simulate.folder⟧, or ⟦simulate.force⟧ to replace files of the same "
        "names",
    )


def write_samples(path: Path, record: Record, **columns: Any) -> None:
    """Write a row a sample: ``time_s``, on the file's clock, and the columns; blank for NaN."""
    times = (record.start_time_s + record.time_s).tolist()
    rows = zip(times, *(values.tolist() for values in columns.values()), strict=True)
    with path.open("w", encoding="ascii", newline="\n") as stream:
        stream.write(",".join(("time_s", *columns)) + "\n")
        stream.writelines(",".join(["" if v != v else repr(v) for v in row]) + "\n" for row in rows)
