"""Hold and keep the state of a user's page: form, confirmed calibration, results.

The state is also written to disk, so that the next server continues where one stopped.
"""

from __future__ import annotations

import contextlib
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vibrident.app.web.column_guess import ColumnGuess
from vibrident.app.web.form.description import Description
from vibrident.app.web.tasks import TaskRequest
from vibrident.base import parcel
from vibrident.base.fields import Fields
from vibrident.data.io.certificate import CertificateData

_MAX_STATE_BYTES = 20_000_000  # most bytes of what is kept of a user


@dataclass
class NamedResult:
    """A result with its name, its request if made here, and the statements of its certificate."""

    name: str
    path: Path
    request: TaskRequest | None = None
    stated: CertificateData | None = None

    @property
    def calibration(self) -> Path:
        """Return the path of the calibration file of a result that was made here."""
        return self.path.with_suffix(".toml")


@dataclass
class Form:
    """The form about the columns, and the user's input."""

    guess: ColumnGuess  # the choices, and the possible meaning of the columns
    description: Description
    # fields set by the user; a guess does not change them
    touched: set[str] = field(default_factory=set)

    def get(self, path: str) -> Any:
        """Return the value of a field."""
        return self.description.get(path)

    def set(self, path: str, value: Any) -> None:
        """Set a field to the user's value."""
        self.touched.add(path)
        self.description.set(path, value)


@dataclass
class ConfirmedCalibration:
    """The calibration file that identifications use: the uploaded one, or the form's."""

    name: str
    from_form: bool


def write_state(folder: Path, state: Fields) -> None:
    """Replace the kept state of a user; do nothing if the folder is gone."""
    with contextlib.suppress(FileNotFoundError):
        partial = folder / "state.part"
        with os.fdopen(
            os.open(partial, os.O_CREAT | os.O_WRONLY | os.O_TRUNC, 0o600), "wb"
        ) as file:
            parcel.send(file, state)
        partial.replace(folder / "state")


def read_state(folder: Path) -> Fields | None:
    """Return the kept state; None if there is none, or another version wrote it."""
    try:
        with (folder / "state").open("rb") as file:
            state = parcel.receive(file, _MAX_STATE_BYTES)
    except (
        OSError,
        EOFError,
        parcel.TooLong,
        ValueError,
        TypeError,
        KeyError,
        RecursionError,
        ImportError,
    ):
        return None
    return state if isinstance(state, dict) else None
