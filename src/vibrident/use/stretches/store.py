"""Fits of stretches in a folder, so that an interrupted identification continues.

Each is one file; its name holds the hash of the data and of what was asked for, and a rename is the
only commit. A file that cannot be read is computed again.
"""

from __future__ import annotations

from pathlib import Path

from vibrident.base import parcel
from vibrident.base.cluster import versions
from vibrident.base.files import atomic_write, unwritable
from vibrident.use.stretches.stretch import FitOrder, Stretch, StretchOutcome

_MAX_BYTES = 1 << 26  # of a file


class EstimateStore:
    """Folder of fits of stretches.

    Args:
        folder: of any number of identifications.
        digest: SHA-256 of the data.
        order: what is fitted.
        stretches: of the records.

    Raises:
        InputError: the folder cannot be written.
    """

    def __init__(
        self, folder: Path, digest: str, order: FitOrder, stretches: list[Stretch]
    ) -> None:
        identification = {
            "data": digest,
            "versions": versions(),
            "order": order,
            "stretches": stretches,
        }
        self._folder = folder / parcel.sha256(identification)[:32]
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise unwritable(error, folder, "give another ⟦identify.work⟧, or make room") from error

    def load(self, number: int) -> StretchOutcome | None:
        """Return the fit of a stretch, or None where there is none that can be read."""
        try:
            with self._file(number).open("rb") as stream:
                fitted = parcel.receive(stream, _MAX_BYTES)
        except (OSError, EOFError, parcel.TooLong, ValueError, TypeError, KeyError):
            return None
        return fitted if isinstance(fitted, StretchOutcome) else None

    def save(self, number: int, fitted: StretchOutcome) -> None:
        """Keep the fit of a stretch.

        Raises:
            InputError: the folder cannot be written.
        """
        try:
            with atomic_write(self._file(number)) as partial, partial.open("wb") as stream:
                parcel.send(stream, fitted)
        except OSError as error:
            raise unwritable(
                error, self._folder, "give another ⟦identify.work⟧, or make room"
            ) from error

    def _file(self, number: int) -> Path:
        return self._folder / f"{number:06d}.fit"
