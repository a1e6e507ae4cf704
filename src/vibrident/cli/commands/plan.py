"""``vibrident plan``: the expected uncertainty of a planned calibration, and its best frequencies."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vibrident.cli import options
from vibrident.cli.console import note, out, wrote
from vibrident.cli.options import choice
from vibrident.errors import InputError
from vibrident.workflow.folder import written_whole
from vibrident.workflow.results import load_result

if TYPE_CHECKING:
    from vibrident.planning import Plan, Recording
    from vibrident.result import Result

_SENSOR, _POINTS, _CHOICE = "Sensor", "Points", "Choice of frequencies"
#: Options for one parameter each; --parameter NAME=VALUE sets any.
_NAMED = ("natural_frequency", "damping_ratio", "sensitivity", "generator_constant")


def _number(name: str, metavar: str, help: str, panel: str, **more: Any) -> Any:
    return typer.Option(name, metavar=metavar, help=help, rich_help_panel=panel, **more)


_Source = Annotated[
    Path | None,
    _number("--from", "RESULT", "result.json: sensor, frequencies and points as good as its calibration's.", _SENSOR),
]
_Parameter = Annotated[list[str] | None, _number("--parameter", "NAME=VALUE", "Any other; may be repeated.", _SENSOR)]
_Quantity = Annotated[
    str | None,
    choice(
        "--quantity",
        options.QUANTITIES,
        f"Of the reference: {', '.join(options.QUANTITIES)}.",
        "NAME",
        rich_help_panel=_SENSOR,
        show_default="acceleration",
    ),
]
_Frequencies = Annotated[
    str | None,
    _number(
        "--frequencies",
        "LOW:HIGH|A,B",
        "Hz: one-third octaves in a range, or a list.",
        _POINTS,
        show_default="those of the result",
    ),
]
_Amplitude = Annotated[
    float | None, _number("--amplitude", "A", "Peak acceleration, m/s².", _POINTS, show_default="9.80665")
]
_ResponseNoise = Annotated[float, _number("--response-noise", "REL", "White, relative to the response's rms.", _POINTS)]
_ResponseRms = Annotated[float, _number("--response-noise-rms", "RMS", "White, in the response's unit.", _POINTS)]
_ReferenceNoise = Annotated[
    float, _number("--reference-noise", "REL", "White, relative to the reference's rms.", _POINTS)
]
_ReferenceRms = Annotated[float, _number("--reference-noise-rms", "RMS", "White, in the reference's unit.", _POINTS)]
_Magnitude = Annotated[
    float | None, _number("--magnitude-uncertainty", "REL", "Of a table's magnitudes, k = 1.", _POINTS)
]
_Phase = Annotated[float | None, _number("--phase-uncertainty", "DEG", "Of a table's phases, k = 1.", _POINTS)]
_Longer = Annotated[float, _number("--times-as-long", "X", "With --from alone: records X times as long.", _POINTS)]
_Systematic = Annotated[
    float, _number("--reference-uncertainty", "REL", "Systematic, of the reference, k = 1.", _POINTS)
]
_Best = Annotated[int | None, _number("--best", "N", "Choose N of the frequencies.", _CHOICE, show_default="all")]
_Criterion = Annotated[
    str,
    choice(
        "--criterion",
        ("D", "A"),
        "D: smallest ellipsoid of all parameters; A: smallest sum of squared relative uncertainties.",
        rich_help_panel=_CHOICE,
    ),
]
_Repeats = Annotated[
    bool, typer.Option("--repeats", help="A frequency may be chosen several times.", rich_help_panel=_CHOICE)
]
_Folder = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="Folder for plan.json and a picture.", show_default="none")
]


def plan(
    model: Annotated[str | None, _number("--model", "MODEL", "Such as accelerometer+delay.", _SENSOR)] = None,
    source: _Source = None,
    natural_frequency: Annotated[float | None, _number("--natural-frequency", "HZ", "In Hz.", _SENSOR)] = None,
    damping: Annotated[float | None, _number("--damping", "RATIO", "Damping ratio.", _SENSOR)] = None,
    sensitivity: Annotated[float | None, _number("--sensitivity", "S", "Accelerometer: V/(m/s²).", _SENSOR)] = None,
    constant: Annotated[float | None, _number("--generator-constant", "G", "Pickup: V/(m/s).", _SENSOR)] = None,
    parameter: _Parameter = None,
    quantity: _Quantity = None,
    frequencies: _Frequencies = None,
    amplitude: _Amplitude = None,
    rate: Annotated[float | None, _number("--rate", "HZ", "Sampling rate.", _POINTS)] = None,
    samples: Annotated[int | None, _number("--samples", "N", "Samples of every record.", _POINTS)] = None,
    response_noise: _ResponseNoise = 0.0,
    response_noise_rms: _ResponseRms = 0.0,
    reference_noise: _ReferenceNoise = 0.0,
    reference_noise_rms: _ReferenceRms = 0.0,
    magnitude_uncertainty: _Magnitude = None,
    phase_uncertainty: _Phase = None,
    longer: _Longer = 1.0,
    reference_uncertainty: _Systematic = 0.0,
    best: _Best = None,
    criterion: _Criterion = "D",
    repeats: _Repeats = False,
    folder: _Folder = None,
) -> None:
    """Predict the uncertainty of a calibration with sines, and choose its best frequencies."""
    named = dict(zip(_NAMED, (natural_frequency, damping, sensitivity, constant), strict=True))
    values = {name: value for name, value in named.items() if value is not None} | _parameters(parameter or [])
    settings: dict[str, Any] = {
        "frequencies_hz": options.frequencies(frequencies),
        "recording": _recording(
            rate, samples, response_noise, response_noise_rms, reference_noise, reference_noise_rms
        ),
        "magnitude_uncertainty": magnitude_uncertainty,
        "phase_uncertainty_rad": None if phase_uncertainty is None else math.radians(phase_uncertainty),
        "times_as_long": longer,
        "quantity": quantity,
        "reference_uncertainty": reference_uncertainty,
        "best": best,
        "criterion": criterion,
        "repeats": repeats,
        **({} if amplitude is None else {"amplitude": amplitude}),
    }
    sensor = _sensor(model, source, values)
    from vibrident.cli.progress import Busy

    with Busy("Planning"):
        from vibrident.planning import plan as run

        planned = run(sensor, values or None, **settings)
    _show(planned)
    if folder is not None:
        _write(planned, folder)


def _sensor(model: str | None, source: Path | None, values: dict[str, float]) -> str | Result:
    if (source is None) == (model is None) or (source is not None and values):
        raise InputError(
            "No sensor, or more than one, is given to plan for.",
            expected="--model with its parameters, or --from RESULT",
            found="neither" if source is None else "both",
            where="--model, --from",
            remedy="give one of the two",
        )
    return load_result(source) if source is not None else str(model)


def _parameters(given: list[str]) -> dict[str, float]:
    values = {}
    for text in given:
        name, separator, number = text.partition("=")
        try:
            values[name.strip()] = float(number)
        except ValueError:
            separator = ""
        if not separator:
            raise InputError(
                "A parameter cannot be read.",
                expected="NAME=VALUE, such as delay=1e-5",
                found=repr(text),
                where="--parameter",
                remedy="write the value as a number in SI units, frequencies in Hz",
            )
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
    from vibrident.planning import Recording

    return Recording(rate, samples, *noise)


def _show(planned: Plan) -> None:
    from vibrident.present import methods
    from vibrident.present.terminal import shown

    console = out()
    console.print(shown(methods.planned(planned)))
    pairs = zip(planned.frequency_hz, planned.uses, strict=True)
    listed = ", ".join(f"{f:.5g}" + (f" (×{n})" if n > 1 else "") for f, n in pairs)
    console.print(f"Frequencies in Hz: {listed}", soft_wrap=True)
    if planned.efficiency is not None:
        console.print(
            f"{planned.criterion}-optimal choice of {sum(planned.uses)} out of {planned.candidates_hz.size}; "
            f"efficiency {100 * planned.efficiency:.0f} % of the best possible in the same measuring time.",
            soft_wrap=True,
        )
    for warning in planned.warnings:
        note(f"Warning: {warning}")


def _write(planned: Plan, folder: Path) -> None:
    from vibrident import plots
    from vibrident.planning import summary

    with written_whole(folder) as output:
        text = json.dumps(summary(planned), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
        (output.path / "plan.json").write_text(text, encoding="utf-8")
        plots.save(plots.plan(planned), output.path / "plan.png")
    wrote(output.files)
