"""Define the further tasks of the page: their titles, inputs and options."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from vibrident.app.web.language import phrase
from vibrident.app.workflow.estimators import AUTO, estimators_with
from vibrident.base.fields import Fields

IDENTIFY = "identify"  # the task of a step of its own

#: What a field takes: one or several names of a list, a number, a mark.
Kind = Literal["models", "model", "estimators", "shared", "number", "whole", "flag"]


@dataclass(frozen=True)
class Field:
    """An option of a task, by its name in the library."""

    label: str
    kind: Kind
    least: float = 0.0  # of a number

    @property
    def is_number(self) -> bool:
        """Return whether the value is a number."""
        return self.kind in ("number", "whole")


@dataclass(frozen=True)
class Task:
    """A task: what it works on, and its options."""

    title: str
    hint: str
    #: result: the chosen one; data: the confirmed columns; all: every uploaded calibration file
    takes: tuple[Literal["result", "data", "all"], ...]
    fields: Mapping[str, Field] = field(default_factory=dict)


TASKS: Mapping[str, Task] = {
    "compare": Task(
        phrase("Compare models and estimators"),
        phrase("Fits each to the data; of several models it recommends one, with the reason."),
        ("data",),
        {
            "models": Field(phrase("Models"), "models"),
            "estimators": Field(phrase("Estimators"), "estimators"),
            "validate": Field(phrase("Cross-validate: predict each fifth of the records"), "flag"),
        },
    ),
    "predict": Task(
        phrase("Predict"),
        phrase("The response of these records, by the chosen result."),
        ("result", "data"),
    ),
    "correct": Task(
        phrase("Correct"),
        phrase(
            "The acceleration from the response, with an uncertainty for every sample. "
            "Records without reference: decay."
        ),
        ("result", "data"),
        {
            "low_hz": Field(phrase("Band to restore: from, Hz"), "number"),
            "high_hz": Field(phrase("Band to restore: to, Hz"), "number"),
            "noise": Field(phrase("Noise of the response, rms"), "number"),
            "track": Field(phrase("Track the sensor through the records"), "flag"),
        },
    ),
    "track": Task(
        phrase("Track"),
        phrase("The parameters over the records, and when the sensor changed."),
        ("result", "data"),
        {
            "every_s": Field(phrase("Seconds between rows"), "number", 1e-6),
            "false_alarms_per_day": Field(phrase("False alarms in a day"), "number", 1e-9),
        },
    ),
    "plan": Task(
        phrase("Plan the next calibration"),
        phrase(
            "The uncertainty that other frequencies or longer records would give, for the sensor "
            "of the chosen result."
        ),
        ("result",),
        {
            "low_hz": Field(phrase("Frequencies: from, Hz"), "number"),
            "high_hz": Field(phrase("Frequencies: to, Hz"), "number"),
            "best": Field(phrase("Choose the best N of them"), "whole", 1),
            "times_as_long": Field(phrase("Records X times as long"), "number"),
        },
    ),
    "joint": Task(
        phrase("Fit several calibrations together"),
        phrase("Upload a calibration file (.toml) for each, with their data: one sensor, one fit."),
        ("all",),
        {
            "share": Field(phrase("Shared parameters"), "shared"),
            "model": Field(phrase("Model for all"), "model"),
        },
    ),
    "fleet": Task(
        phrase("Identify many sensors"),
        phrase(
            "Upload a calibration file (.toml) for each, with their data: one table, a row each."
        ),
        ("all",),
        {"model": Field(phrase("Model for all"), "model")},
    ),
}


@dataclass(frozen=True)
class TaskRequest:
    """A task as it was asked for, or an identification."""

    task: str
    options: Fields
    result: str = ""  # name of the chosen result
    files: tuple[str, ...] = ()  # calibration files, in the folder of the data
    language: str = "en"  # of the tables and charts
    content: bytes = b""  # of a single calibration file when the task began

    @property
    def command(self) -> str:
        """Return the identification as a command for a shell in the folder of the data."""
        (name,) = self.files
        file = f'"{name}"' if " " in name else name
        options = (f"--{key} {value}" for key, value in self.options.items())
        return " ".join(("vibrident identify", file, *options))


def identify_request(
    calibration: str,
    estimator: str = AUTO,
    discretisation: str = "bandlimited",
    uncertainty: str = "auto",
) -> TaskRequest:
    """Return the request of an identification, with every option that applies."""
    step = {"discretisation": discretisation}
    applicable = step if estimator in estimators_with("discretisation") else {}
    options = {"estimator": estimator, **applicable, "uncertainty": uncertainty}
    return TaskRequest(IDENTIFY, options, files=(calibration,))
