"""Hold and keep the state of a user's page: form, choices, running identification, results.

The state is also written to disk, so that the next server continues where one stopped.
"""

from __future__ import annotations

import contextlib
import os
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from vibrident.app.web.column_guess import ColumnGuess
from vibrident.app.web.form.description import Description
from vibrident.app.web.language import Language, phrase
from vibrident.app.workflow.estimators import AUTO, estimators_with
from vibrident.base import parcel
from vibrident.data.io.certificate import CertificateData

_MAX_STATE_BYTES = 20_000_000  # most bytes of what is kept of a user


@dataclass(frozen=True)
class Choices:
    """Choices of one identification, also as a command for a shell."""

    calibration: str  # name of the calibration file, in the folder of the data
    estimator: str = AUTO
    discretisation: str = "bandlimited"  # of an estimator that has one; ignored for others
    uncertainty: str = "auto"

    @property
    def options(self) -> dict[str, str]:
        """Return every applicable option, including those at their default."""
        discretisation = (
            {"discretisation": self.discretisation}
            if self.estimator in estimators_with("discretisation")
            else {}
        )
        return {"estimator": self.estimator, **discretisation, "uncertainty": self.uncertainty}

    @property
    def command(self) -> str:
        """Return the command for a shell in the folder of the data, with file names quoted."""
        file = f'"{self.calibration}"' if " " in self.calibration else self.calibration
        return " ".join(
            (
                "vibrident identify",
                file,
                *(f"--{key} {value}" for key, value in self.options.items()),
            )
        )


@dataclass
class NamedResult:
    """A result with its name, the choices if made here, and the statements of its certificate."""

    name: str
    path: Path
    choices: Choices | None = None
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


@dataclass
class Job:
    """A running identification: its status, the cost of each start, and how it ended."""

    BEGINNING: ClassVar[str] = phrase("Reading the data, loading the libraries …")
    DONE: ClassVar[str] = phrase("Identified.")

    words: str = BEGINNING
    starts: list[list[float]] = field(default_factory=list)
    over: bool = False
    error: Exception | None = None
    began: float = field(default_factory=time.monotonic)
    share: float | None = None
    most_left_s: float | None = None
    choices: Choices | None = None  # what was asked for

    def status(self, language: Language) -> str:
        """Return the status, with the elapsed seconds, and those that this start can still take."""
        words = language(self.words)
        if self.over:
            return words
        lasted = f"{time.monotonic() - self.began:.0f}"
        if self.most_left_s is None:
            return f"{words} ({lasted} s)"
        more = language(
            phrase("this start: at most {seconds} s more"), seconds=f"{self.most_left_s:.0f}"
        )
        return f"{words} ({lasted} s; {more})"

    def add(self, iteration: int, most: int, cost: float) -> None:
        """Record an iteration; if the count does not increase, another start has begun."""
        if not self.starts or iteration <= len(self.starts[-1]):
            self.starts.append([])
            self._started = time.monotonic()
        self.starts[-1].append(cost)
        self.share = iteration / most if most else None
        done = len(self.starts[-1]) - 1
        self.most_left_s = (
            (time.monotonic() - self._started) / done * (most - iteration) if done else None
        )
        facts = {"iteration": iteration, "most": most, "cost": f"{cost:.4g}"}
        if len(self.starts) > 1:
            start = "Start {start}, iteration {iteration} of at most {most}, cost {cost}"
            self.words = phrase(start, start=len(self.starts), **facts)
        else:
            self.words = phrase("Iteration {iteration} of at most {most}, cost {cost}", **facts)


def write_state(folder: Path, state: dict[str, Any]) -> None:
    """Replace the kept state of a user; do nothing if the folder is gone."""
    with contextlib.suppress(FileNotFoundError):
        partial = folder / "state.part"
        with os.fdopen(
            os.open(partial, os.O_CREAT | os.O_WRONLY | os.O_TRUNC, 0o600), "wb"
        ) as file:
            parcel.send(file, state)
        partial.replace(folder / "state")


def read_state(folder: Path) -> dict[str, Any] | None:
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
