"""Further tasks of the page: commands of the shell, with labels for their options."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

#: Places in a command: the chosen result, the calibration file of the page, and all that were uploaded.
RESULT, DATA, ALL = "RESULT", "DATA", "ALL"


@dataclass(frozen=True)
class Task:
    """A command, its options with their labels, and those of them that are switches."""

    title: str
    hint: str
    command: tuple[str, ...]
    fields: Mapping[str, str] = field(default_factory=dict)
    switches: Mapping[str, str] = field(default_factory=dict)


TASKS = {
    "compare": Task(
        "Compare models and estimators",
        "Fits each to the data; of several models it recommends one, with the reason.",
        ("compare", DATA),
        {"--models": "Models, joined by commas", "--estimators": "Estimators, joined by commas"},
        {"--cross-validate": "Cross-validate: predict each fifth of the records"},
    ),
    "predict": Task("Predict", "The response of these records, by the chosen result.", ("predict", RESULT, DATA)),
    "correct": Task(
        "Correct",
        "The acceleration from the response, with an uncertainty for every sample. Records without reference: decay.",
        ("correct", RESULT, DATA),
        {"--band": "Band to restore in Hz, as LOW:HIGH", "--noise": "Noise of the response, rms"},
        {"--track": "Track the sensor through the records"},
    ),
    "track": Task(
        "Track",
        "The parameters over the records, and when the sensor changed.",
        ("track", RESULT, DATA),
        {"--every": "Seconds between rows", "--false-alarms-per-day": "False alarms in a day"},
    ),
    "plan": Task(
        "Plan the next calibration",
        "The uncertainty that other frequencies or longer records would give, for the sensor of the chosen result.",
        ("plan", "--from", RESULT),
        {
            "--frequencies": "Frequencies in Hz: LOW:HIGH, or a list",
            "--best": "Choose the best N of them",
            "--times-as-long": "Records X times as long",
        },
    ),
    "joint": Task(
        "Fit several calibrations together",
        "Upload a calibration file (.toml) for each, with their data: one sensor, one fit.",
        ("identify", ALL),
        {"--share": "Shared parameters, joined by commas", "--model": "Model, or one each, by commas"},
    ),
    "fleet": Task(
        "Identify many sensors",
        "Upload a calibration file (.toml) for each, with their data: one table, a row each.",
        ("fleet", ALL),
        {"--model": "Model for all"},
    ),
}
