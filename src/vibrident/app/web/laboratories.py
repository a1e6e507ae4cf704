"""Keep profiles of laboratories on the server for all who use it: a file each, with its logo."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from vibrident.base.errors import InputError
from vibrident.base.fields import Fields, GivenFields
from vibrident.base.files import atomic_write
from vibrident.data.io.laboratory import checked_laboratory, laboratory_text, read_laboratory

#: A laboratory's own files beside its profile.
LABORATORY_FILES = ("logo", "template")
MAX_LABORATORY_FILE_BYTES = 200_000
_MAX_BYTES = 500_000
_MAX_PROFILES = 200
_NAME = re.compile(r"\w[\w .,&()+-]{0,79}")


class Laboratories:
    """Profiles below a folder, which is made with the first; changes are atomic."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @property
    def names(self) -> list[str]:
        """Return the names of the profiles, sorted."""
        return sorted(path.stem for path in self.folder.glob("*.toml"))

    def read(self, name: str) -> Fields:
        """Return the document of a profile; an empty one if there is no profile of this name.

        InputError where somebody has spoiled the file by hand.
        """
        path = self.folder / f"{name}.toml"
        return (
            read_laboratory(path) if name and name in self.names else checked_laboratory({}, name)
        )

    def file_content(self, name: str, kind: str) -> bytes:
        """Return the laboratory's own ``logo`` or ``template``; nothing where it has none."""
        path = self.folder / f"{name}.{kind}"
        return path.read_bytes() if name in self.names and path.is_file() else b""

    def write(self, name: str, document: GivenFields, files: Mapping[str, bytes]) -> str:
        """Write a profile in place of an earlier one, and return its name.

        ``files``: the content of its files by kind, nothing for none. InputError for a name or a
        value that is not allowed; the profile then stays as it was.
        """
        name = " ".join(name.split())
        if not _NAME.fullmatch(name) or name.endswith("."):
            raise InputError(
                "The name of the profile cannot be used.",
                expected="1 to 80 letters, digits, blanks and . , & ( ) + -",
                found=repr(name[:100]),
                where="laboratory",
                remedy="choose another name",
            )
        text = laboratory_text(checked_laboratory(document, "laboratory"))
        if len(text) > _MAX_BYTES or len({name, *self.names}) > _MAX_PROFILES:
            raise InputError(
                "There is no room for the profile.",
                expected=f"at most {_MAX_BYTES} characters, and {_MAX_PROFILES} profiles",
                found=f"{len(text)} characters, {len(self.names)} profiles",
                where="laboratory",
                remedy="shorten it, or remove a profile",
            )
        self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        for kind in LABORATORY_FILES:
            path = self.folder / f"{name}.{kind}"
            if content := files.get(kind):
                with atomic_write(path) as partial:
                    partial.write_bytes(content)
            else:
                path.unlink(missing_ok=True)
        with atomic_write(self.folder / f"{name}.toml") as partial:
            partial.write_text(text, encoding="utf-8")
        return name

    def remove(self, name: str) -> None:
        """Remove a profile and its files."""
        if name in self.names:
            for ending in ("toml", *LABORATORY_FILES):
                (self.folder / f"{name}.{ending}").unlink(missing_ok=True)
