"""``vibrident simulate``: a calibration with known truth, as files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from vibrident.cli import options
from vibrident.cli.console import out, wrote
from vibrident.cli.optics import INTERFEROMETERS, KEYS, optics_of, write_optical
from vibrident.cli.options import choice, flag, option
from vibrident.workflow.folder import refuse_used, written_whole
from vibrident.workflow.simulated import write

# Panels of the help.
_NOISE = "Noise"
_LIGHT = "Raw light"


def simulate(
    folder: Path = option("--out", "DIR", "Folder for the files.", ..., False),
    sensor: str = option("--sensor", "NAME", f"Of {', '.join(options.SENSORS)}.", "paper"),
    excitation: str = choice(
        "--excitation",
        options.EXCITATIONS,
        f"{', '.join(options.EXCITATIONS)}; sine makes a record for every frequency.",
        "sine",
        "NAME",
    ),
    rate: float | None = option("--rate", "HZ", "Sampling rate.", default="the sensor's usual"),
    samples: int = option("--samples", "N", "Samples of every record.", 16000),
    frequencies: str | None = option(
        "--frequencies", "LOW:HIGH|A,B", "Hz: one-third octaves in a range, or a list.", default="the sensor's band"
    ),
    quantity: str = choice(
        "--quantity", options.QUANTITIES, f"Of the reference: {', '.join(options.QUANTITIES)}.", "acceleration", "NAME"
    ),
    start: str = choice(
        "--start", options.STARTS, "State at the first sample: rest as in the paper, steady as in a laboratory.", "rest"
    ),
    method: str = choice(
        "--method", options.METHODS, "How the response is computed: exact, or the paper's Runge-Kutta.", "exact"
    ),
    excitation_snr: float | None = option(
        "--excitation-snr", "DB", "Excitation over noise motion of the base.", panel=_NOISE
    ),
    reference_noise: float = option("--reference-noise", "REL", "White, relative to the rms.", 0.0, panel=_NOISE),
    response_noise: float = option("--response-noise", "REL", "White, relative to the rms.", 0.0, panel=_NOISE),
    interferometer: str | None = choice(
        "--interferometer",
        INTERFEROMETERS,
        "Write an interferometer's raw signals in place of the reference.",
        panel=_LIGHT,
    ),
    optics: str | None = option(
        "--optics", "KEY=VALUE,…", f"Its faults: {', '.join(KEYS)}.", default=False, panel=_LIGHT
    ),
    seed: int = option("--seed", "N", "Of everything random.", 0, panel=_NOISE, min=0),
    force: bool = flag("--force", help="Write into a folder that is not empty."),
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
    from vibrident.present.views import count

    with written_whole(folder) as output, Busy("Simulating"):
        if interferometer is None:
            write(output.path, sensor, excitation, **settings)
        else:
            _write_light(output.path, sensor, excitation, interferometer, optics, settings)
    records = [file for file in output.files if file.suffix in (".csv", ".h5") and "_optical" not in file.name]
    others = [file for file in output.files if file.suffix not in (".csv", ".h5")]
    out().print(f"Simulated: sensor {sensor}, {excitation}, {count(len(records), 'record')}, seed {seed}.")
    wrote([*others, folder / ("*.csv" if interferometer is None else "*.h5")])


def _write_light(
    folder: Path, sensor: str, excitation: str, kind: str, optics: str | None, settings: dict[str, Any]
) -> None:
    from vibrident.simulation import sensor_named

    rate = settings["sampling_rate_hz"] or sensor_named(sensor).sampling_rate_hz
    write_optical(folder, sensor, excitation, optics_of(kind, optics, rate, settings["seed"]), **settings)
