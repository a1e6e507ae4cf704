"""Files of a response, and the file of the optical signals of each: told by a part of their names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from vibrident.base.errors import InputError


def mark(files: Sequence[str]) -> str:
    """The part of a name that optical files have beyond the response's, such as ``_optical``; empty for no pairs.

    Half of the files must have it, and each of them a partner without it.
    """
    if len(files) < 2 or len(files) % 2:
        return ""
    stems = [Path(file).stem for file in files]
    first = stems[0]
    for other in stems[1:]:
        short, long = sorted((first, other), key=len)
        part = _added(short, long)
        if part and _partners(files, part) is not None:
            return part
    return ""


def paired(files: Sequence[str], part: str) -> list[tuple[str, str | None]]:
    """Each file of a response with the file of its optical signals; without a part of names, all are in one.

    Raises:
        InputError: a file has no partner.
    """
    if not part:
        return [(file, None) for file in files]
    found = _partners(files, part)
    if found is None:
        optical = [file for file in files if part in Path(file).stem]
        raise InputError(
            "The files with optical signals do not match those with responses.",
            expected=f"for each file a second one, with {part!r} more in its name",
            found=f"{len(files) - len(optical)} files without {part!r}, {len(optical)} with it",
            where="columns and units",
            remedy="add or rename files, or correct that part of the names; leave it empty for signals in one file",
        )
    return list(found)


def _partners(files: Sequence[str], part: str) -> list[tuple[str, str | None]] | None:
    """Pairs in the order of the responses; None if a file is left over."""
    optical = {Path(file).stem.replace(part, "", 1): file for file in files if part in Path(file).stem}
    others = [file for file in files if part not in Path(file).stem]
    if len(optical) != len(others) or len(files) != 2 * len(others) or not others:
        return None
    pairs = [(file, optical.get(Path(file).stem)) for file in others]
    return pairs if all(partner is not None for _, partner in pairs) else None


def _added(short: str, long: str) -> str:
    """What a name has beyond another, in one place; empty if they differ otherwise."""
    same = next((i for i, (a, b) in enumerate(zip(short, long, strict=False)) if a != b), len(short))
    more = len(long) - len(short)
    for start in range(same, -1, -1):
        if more and long[:start] + long[start + more :] == short:
            return long[start : start + more]
    return ""
