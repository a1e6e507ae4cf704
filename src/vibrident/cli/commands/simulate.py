"""``vibrident simulate``: a calibration with known truth, as files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from vibrident.cli import options
from vibrident.cli.console import out, wrote
from vibrident.cli.optics import INTERFEROMETERS, KEYS, optics_of, write_optical
from vibrident.cli.options import choice
from vibrident.workflow.folder import refuse_used, written_whole
from vibrident.workflow.simulated import write

_NOISE, _LIGHT = "Noise", "Raw light"

_ExcitationSnr = Annotated[
    float | None,
    typer.Option(
        "--excitation-snr", metavar="DB", help="Excitation over noise motion of the base.", rich_help_panel=_NOISE
    ),
]
_ReferenceNoise = Annotated[
    float, typer.Option("--reference-noise", metavar="REL", help="White, relative to the rms.", rich_help_panel=_NOISE)
]
_ResponseNoise = Annotated[
    float, typer.Option("--response-noise", metavar="REL", help="White, relative to the rms.", rich_help_panel=_NOISE)
]
_Interferometer = Annotated[
    str | None,
    choice(
        "--interferometer",
        INTERFEROMETERS,
        "Write an interferometer's raw signals in place of the reference.",
        rich_help_panel=_LIGHT,
    ),
]
_Optics = Annotated[
    str | None,
    typer.Option(
        "--optics",
        metavar="KEY=VALUE,…",
        help=f"Its faults: {', '.join(KEYS)}.",
        show_default=False,
        rich_help_panel=_LIGHT,
    ),
]


def simulate(
    folder: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the files.", show_default=False)],
    sensor: Annotated[
        str, typer.Option("--sensor", metavar="NAME", help=f"Of {', '.join(options.SENSORS)}.")
    ] = "paper",
    excitation: Annotated[
        str,
        choice(
            "--excitation",
            options.EXCITATIONS,
            f"{', '.join(options.EXCITATIONS)}; sine makes a record for every frequency.",
            "NAME",
        ),
    ] = "sine",
    rate: Annotated[
        float | None, typer.Option("--rate", metavar="HZ", help="Sampling rate.", show_default="the sensor's usual")
    ] = None,
    samples: Annotated[int, typer.Option("--samples", metavar="N", help="Samples of every record.")] = 16000,
    frequencies: Annotated[
        str | None,
        typer.Option(
            "--frequencies",
            metavar="LOW:HIGH|A,B",
            help="Hz: one-third octaves in a range, or a list.",
            show_default="the sensor's band",
        ),
    ] = None,
    quantity: Annotated[
        str, choice("--quantity", options.QUANTITIES, f"Of the reference: {', '.join(options.QUANTITIES)}.", "NAME")
    ] = "acceleration",
    start: Annotated[
        str,
        choice(
            "--start", options.STARTS, "State at the first sample: rest as in the paper, steady as in a laboratory."
        ),
    ] = "rest",
    method: Annotated[
        str, choice("--method", options.METHODS, "How the response is computed: exact, or the paper's Runge-Kutta.")
    ] = "exact",
    excitation_snr: _ExcitationSnr = None,
    reference_noise: _ReferenceNoise = 0.0,
    response_noise: _ResponseNoise = 0.0,
    interferometer: _Interferometer = None,
    optics: _Optics = None,
    seed: Annotated[
        int, typer.Option("--seed", metavar="N", min=0, help="Of everything random.", rich_help_panel=_NOISE)
    ] = 0,
    force: Annotated[bool, typer.Option("--force", help="Write into a folder that is not empty.")] = False,
) -> None:
    """Simulate a calibration: records, calibration.toml for identify, and truth.json."""
    refuse_used(folder, force=force)
    settings: dict[str, Any] = {
        "sampling_rate_hz": rate,
        "samples": samples,
        "frequencies_hz": options.frequencies(frequencies),
        "quantity": quantity,
        "start": start,
        "method": method,
        "excitation_snr_db": excitation_snr,
        "reference_noise": reference_noise,
        "response_noise": response_noise,
        "seed": seed,
    }
    from vibrident.cli.progress import Busy

    with written_whole(folder) as output, Busy("Simulating"):
        if interferometer is None:
            write(output.path, sensor, excitation, **settings)
        else:
            _write_light(output.path, sensor, excitation, interferometer, optics, settings)
    records = [file for file in output.files if file.suffix in (".csv", ".h5") and "_optical" not in file.name]
    others = [file for file in output.files if file.suffix not in (".csv", ".h5")]
    out().print(
        f"Simulated: sensor {sensor}, {excitation}, {len(records)} record{'s' * (len(records) != 1)}, seed {seed}."
    )
    wrote([*others, folder / ("*.csv" if interferometer is None else "*.h5")])


def _write_light(
    folder: Path, sensor: str, excitation: str, kind: str, optics: str | None, settings: dict[str, Any]
) -> None:
    from vibrident.simulation import sensor_named

    rate = settings["sampling_rate_hz"] or sensor_named(sensor).sampling_rate_hz
    write_optical(folder, sensor, excitation, optics_of(kind, optics, rate, settings["seed"]), **settings)
