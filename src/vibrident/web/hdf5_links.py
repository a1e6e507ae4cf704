"""An uploaded HDF5 file (MATLAB 7.3 files are such) must stand alone: HDF5 itself follows links into other files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from vibrident.errors import InputError
from vibrident.io.columns import unreadable


def refuse_other_files(path: Path) -> None:
    """Refuse an HDF5 file that refers to another file: on a server that would be somebody else's.

    Looked for are external links, external storage and virtual datasets; none of the files named is opened. A file
    that is not HDF5, whatever its name, passes.

    Raises:
        InputError: it refers to another file, or is damaged.
    """
    import h5py

    if not h5py.is_hdf5(path):
        return
    found: list[str] = []

    def look_at_link(name: str, link: Any) -> None:
        if isinstance(link, h5py.ExternalLink):
            found.append(f"{name!r} is a link to {link.filename!r}")

    def look_at_object(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            found.extend(f"{name!r} is stored in {other!r}" for other in _others(item))

    try:
        with h5py.File(path, "r") as file:
            file.visititems_links(look_at_link)
            file.visititems(look_at_object)
    except (OSError, RuntimeError, KeyError, TypeError, ValueError) as error:
        raise unreadable(str(path), error, "an HDF5 file that stands alone") from error
    if found:
        raise InputError(
            "The page reads HDF5 files that stand alone.",
            expected="a file that holds its data itself",
            found="; ".join(found[:3]),
            where=str(path),
            remedy="copy the data into the file, or use vibrident identify in a shell",
        )


def _others(dataset: Any) -> list[str]:
    """Names of the files, other than its own, that hold the numbers of a dataset."""
    external = [name for name, *_ in dataset.external or ()]
    virtual = [source.file_name for source in dataset.virtual_sources()] if dataset.is_virtual else []
    return external + [name for name in virtual if name != "."]
