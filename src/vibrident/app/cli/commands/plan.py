"""``vibrident plan``: predict the uncertainty of a calibration, and choose its frequencies."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from vibrident.app.cli import options
from vibrident.app.cli.console import show_output, show_written
from vibrident.app.cli.options import (
    RATES_HZ,
    RELATIVE,
    RELATIVE_NOISE,
    SIZES,
    between,
    choice,
    flag,
    option,
)
from vibrident.app.cli.progress import ProgressBar
from vibrident.app.workflow.folder import load_result, written_whole
from vibrident.base.errors import InputError
from vibrident.base.fields import Fields, NamedNumbers

if TYPE_CHECKING:
    from vibrident.app.workflow.task_output import TaskOutput
    from vibrident.result import Result
    from vibrident.use.planning import Recording

# Panels of the help.
_SENSOR = "Sensor"
_points = partial(between, panel="Points")
_CHOICE = "Choice of frequencies"
_mounting = partial(between, panel="Another mounting, with --from")
_RMS = (0.0, SIZES[1], 0.0)
_TIMES = (1e-6, 1e6)
_PARAMETER = (
    "A parameter of the model in SI units, such as natural_frequency=1000 (Hz); repeat for each."
)
_QUANTITY = choice(
    "--quantity",
    options.QUANTITIES,
    f"Of the reference: {', '.join(options.QUANTITIES)}.",
    metavar="NAME",
    panel=_SENSOR,
    default="acceleration",
)
_CRITERION = choice(
    "--criterion",
    ("D", "A"),
    "D: smallest ellipsoid of all parameters; A: smallest sum of squared relative uncertainties.",
    "D",
    panel=_CHOICE,
)


def plan(
    model: str | None = option("--model", "MODEL", "Such as accelerometer+delay.", panel=_SENSOR),
    source: Path | None = option(
        "--from",
        "RESULT",
        "result.json: sensor, frequencies and points as good as its calibration's.",
        panel=_SENSOR,
    ),
    parameter: list[str] | None = option("--parameter", "NAME=VALUE", _PARAMETER, panel=_SENSOR),
    quantity: str | None = _QUANTITY,
    frequencies: str | None = option(
        "--frequencies",
        "LOW:HIGH|A,B",
        "Hz: one-third octaves in a range, or a list.",
        default="those of the result",
        panel="Points",
    ),
    amplitude: float | None = _points(
        "--amplitude", "A", "Peak acceleration, m/s².", *SIZES, default="9.80665"
    ),
    rate: float | None = options.rate("--rate", "Sampling rate.", panel="Points"),
    samples: int | None = _points("--samples", "N", "Samples of every record.", 16, 1e9),
    response_noise: float = _points(
        "--response-noise", "REL", "White, relative to the response's rms.", *RELATIVE_NOISE, 0.0
    ),
    response_noise_rms: float = _points(
        "--response-noise-rms", "RMS", "White, in the response's unit.", *_RMS
    ),
    reference_noise: float = _points(
        "--reference-noise", "REL", "White, relative to the reference's rms.", *RELATIVE_NOISE, 0.0
    ),
    reference_noise_rms: float = _points(
        "--reference-noise-rms", "RMS", "White, in the reference's unit.", *_RMS
    ),
    magnitude_u: float | None = _points(
        "--magnitude-uncertainty", "REL", "Of a table's magnitudes, k = 1.", *RELATIVE
    ),
    phase_u: float | None = _points(
        "--phase-uncertainty", "DEG", "Of a table's phases, k = 1.", 1e-12, 360.0
    ),
    longer: float = _points(
        "--times-as-long", "X", "With --from alone: records X times as long.", 1e-6, 1e6, 1.0
    ),
    reference_uncertainty: float | None = _points(
        "--reference-uncertainty",
        "REL",
        "Systematic, of the reference, k = 1.",
        0.0,
        RELATIVE[1],
        default="the result's",
    ),
    best: int | None = between(
        "--best", "N", "Choose N of the frequencies.", 1, 1e6, panel=_CHOICE, default="all"
    ),
    criterion: str = _CRITERION,
    repeats: bool = flag(
        "--repeats", help="A frequency may be chosen several times.", panel=_CHOICE
    ),
    stiffness: float | None = _mounting(
        "--mounting-stiffness",
        "X",
        "Predict the sensitivity: X times the coupling's stiffness.",
        *_TIMES,
    ),
    mass: float | None = _mounting(
        "--mounting-mass", "X", "Predict the sensitivity: X times the mass of the sensor.", *_TIMES
    ),
    frequency_hz: float | None = _mounting(
        "--mounting-frequency",
        "HZ",
        "Mounting frequency √(k/m)/2π.",
        *RATES_HZ,
        default="that of the result",
    ),
    standard_uncertainty: float | None = _mounting(
        "--mounting-uncertainty", "REL", "Of that frequency.", 0.0, RELATIVE[1]
    ),
    damping: float | None = _mounting(
        "--mounting-damping",
        "X",
        "Damping ratio of the mounting.",
        1e-9,
        1e3,
        default="that of the result",
    ),
    folder: Path | None = option(
        "--out", "DIR", "Folder for plan.json or mounting.csv and a picture.", default="none"
    ),
) -> None:
    """Predict the uncertainty of a calibration with sines, and choose its best frequencies.

    With another mounting it predicts the sensitivity instead.
    """
    mounting = {
        "stiffness": stiffness,
        "mass": mass,
        "frequency_hz": frequency_hz,
        "standard_uncertainty": standard_uncertainty,
        "damping": damping,
    }
    mounting_inputs = {name: value for name, value in mounting.items() if value is not None}
    if mounting_inputs:
        _predict_mounted(source, mounting_inputs, frequencies, folder)
        return
    values = _parameters(parameter or [])
    settings: Fields = {
        "frequencies_hz": options.frequencies(frequencies),
        "recording": _recording(
            rate, samples, response_noise, response_noise_rms, reference_noise, reference_noise_rms
        ),
        "magnitude_uncertainty": magnitude_u,
        "phase_uncertainty_rad": None if phase_u is None else math.radians(phase_u),
        "times_as_long": longer,
        "quantity": quantity,
        "reference_uncertainty": reference_uncertainty,
        "best": best,
        "criterion": criterion,
        "repeats": repeats,
        **({} if amplitude is None else {"amplitude": amplitude}),
    }
    sensor = _planned_for(model, source, values)
    with ProgressBar("Planning"):
        from vibrident.use.planning import plan as run

        planned = run(sensor, values or None, **settings)
    from vibrident.app.workflow.uses import describe_plan as describe
    from vibrident.app.workflow.uses import write_plan

    prediction = describe(planned)
    _show(prediction, partial(write_plan, planned), folder, "plan.png")


def _show(
    prediction: TaskOutput, write: Callable[[Path], None], folder: Path | None, picture: str
) -> None:
    """Show a prediction; write it, and its picture, where a folder is given."""
    show_output(prediction)
    if folder is not None:
        from vibrident.show import plots

        with written_whole(folder) as output:
            write(output.path)
            plots.save(prediction.figures[0], output.path / picture)
        show_written(output.files)


def _predict_mounted(
    source: Path | None, mounting: NamedNumbers, frequencies: str | None, folder: Path | None
) -> None:
    """Show the sensitivity on another mounting, and write it where a folder is given."""
    if source is None:
        raise InputError(
            "No sensor is given to mount.",
            expected="--from RESULT",
            found="nothing",
            where="--from",
            remedy="give the result.json of the sensor",
        )
    from vibrident.app.workflow.uses import describe_mounted, write_mounted
    from vibrident.use.planning import predict_mounted

    result = load_result(source)
    at_hz = options.frequencies(frequencies)
    mounted = predict_mounted(result, frequencies_hz=at_hz, **mounting)
    prediction = describe_mounted(result, mounted)
    _show(prediction, partial(write_mounted, mounted), folder, "mounting.png")


def _planned_for(model: str | None, source: Path | None, values: NamedNumbers) -> str | Result:
    if (source is None) == (model is None) or (source is not None and values):
        raise InputError(
            "No sensor, or more than one, is given to plan for.",
            expected="--model with its parameters, or --from RESULT",
            found="neither" if source is None else "both",
            where="--model, --from",
            remedy="give either --model and its parameters, or --from alone",
        )
    return load_result(source) if source is not None else str(model)


def _parameters(texts: list[str]) -> NamedNumbers:
    values = {}
    for name, number in options.pairs("--parameter", texts, "delay=1e-5").items():
        try:
            values[name] = float(number)
        except ValueError:
            remedy = "write the value as a number in SI units, frequencies in Hz"
            text = f"{name}={number}"
            raise options.unreadable_error(
                "--parameter", text, "NAME=VALUE, such as delay=1e-5", remedy
            ) from None
    return values


def _recording(rate: float | None, samples: int | None, *noise: float) -> Recording | None:
    if rate is None and samples is None and not any(noise):
        return None
    if rate is None or samples is None:
        raise InputError(
            "The recording of the sines is incomplete.",
            expected="--rate and --samples with the noise",
            found="one without the other",
            where="--rate, --samples",
            remedy="give both",
        )
    from vibrident.use.planning import Recording

    return Recording(rate, samples, *noise)
