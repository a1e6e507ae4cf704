"""``vibrident simulate``: a calibration with known truth, as files."""

from __future__ import annotations

from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from vibrident.app.cli import options
from vibrident.app.cli.console import print_line, show_written
from vibrident.app.cli.options import between, choice, flag, option, unreadable_error
from vibrident.app.cli.progress import ProgressBar
from vibrident.app.workflow.folder import refuse_filled_folder, written_whole
from vibrident.app.workflow.simulated import write
from vibrident.base.errors import InputError, unknown
from vibrident.base.fields import Fields

if TYPE_CHECKING:
    from vibrident.physics.simulation.optics import Optics


#: What may stand in --optics: key, what it takes, what it is.
KEYS = {
    "rate": (
        "HZ",
        "of the optical signals; without it a multiple of the response's that the motion needs",
    ),
    "carrier": ("HZ", "of a heterodyne signal; a quarter of the rate without it"),
    "noise": ("REL", "of each signal, over its amplitude"),
    "bits": ("N", "of the converter, 8 to 16; 0 for none"),
    "dropouts": ("N", "a record, 10000 at most"),
    "dropout": ("S", "length of one"),
    "drift": ("REL", "of offsets and amplitudes over a record"),
    "fading": ("REL", "of the common amplitude"),
    "cyclic1": ("RAD", "cyclic error, first harmonic"),
    "cyclic2": ("RAD", "second"),
    "cyclic4": ("RAD", "fourth"),
    "table": ("M", "rms of the optical table's motion"),
    "delay": ("S", "of the optical channel, stated in the file"),
    "hidden-delay": ("S", "the same, not stated"),
    "carrier-drift": ("HZ", "over a record"),
    "passes": ("N", "of the beam"),
    "ellipse": ("random", "offsets, amplitudes and quadrature drawn anew"),
}
#: Key → its limits, where these are not zero and up.
LIMITS = {
    "rate": options.RATES_HZ,
    "carrier": options.RATES_HZ,
    "bits": (8.0, 16.0),
    "dropouts": (0.0, 1e4),
    "passes": (1.0, 64.0),
    "delay": (-1.0, 1.0),
    "hidden-delay": (-1.0, 1.0),
    "carrier-drift": (-1e12, 1e12),
}
#: Keys whose values are counts.
COUNTS = frozenset({"bits", "dropouts", "passes"})
#: Key → field of ``Optics``, where its name is another.
_FIELDS = {
    "rate": "rate_hz",
    "dropout": "dropout_s",
    "table": "table_m",
    "delay": "delay_s",
    "carrier-drift": "carrier_drift_hz",
    "ellipse": "random",
}

#: Most samples of an optical signal in one record: some 1.6 GB of each array.
MAX_LIGHT_SAMPLES = 200_000_000

# Panels of the help.
_noise = partial(between, panel="Noise")
_WHITE = ("White, relative to the rms.", *options.RELATIVE_NOISE, 0.0)
_LIGHT = "Raw light"


def simulate(
    folder: Path = option("--out", "DIR", "Folder for the files.", ..., False),
    sensor: str = choice(
        "--sensor", options.SENSORS, f"Of {', '.join(options.SENSORS)}.", "paper", "NAME"
    ),
    excitation: str = choice(
        "--excitation",
        options.EXCITATIONS,
        f"{', '.join(options.EXCITATIONS)}; sine makes a record for every frequency.",
        "sine",
        "NAME",
    ),
    rate: float | None = options.rate("--rate", "Sampling rate.", "the sensor's usual"),
    samples: int = between("--samples", "N", "Samples of every record.", 8, 1e8, 16000),
    frequencies: str | None = option(
        "--frequencies",
        "LOW:HIGH|A,B",
        "Hz: one-third octaves in a range, or a list.",
        default="the sensor's band",
    ),
    quantity: str = choice(
        "--quantity",
        options.QUANTITIES,
        f"Of the reference: {', '.join(options.QUANTITIES)}.",
        "acceleration",
        "NAME",
    ),
    start: str = choice(
        "--start",
        ("rest", "steady"),
        "State at the first sample: rest as in the paper, steady as in a laboratory.",
        "rest",
    ),
    method: str = choice(
        "--method",
        ("exact", "rk4"),
        "How the response is computed: exact, or the paper's Runge-Kutta.",
        "exact",
    ),
    excitation_snr: float | None = _noise(
        "--excitation-snr", "DB", "Excitation over noise motion of the base.", -300.0, 300.0
    ),
    reference_noise: float = _noise("--reference-noise", "REL", *_WHITE),
    response_noise: float = _noise("--response-noise", "REL", *_WHITE),
    interferometer: str | None = choice(
        "--interferometer",
        ("quadrature", "heterodyne"),
        "Write an interferometer's raw signals in place of the reference.",
        panel=_LIGHT,
    ),
    optics: str | None = option(
        "--optics", "KEY=VALUE,…", f"Its faults: {', '.join(KEYS)}.", default=False, panel=_LIGHT
    ),
    seed: int = option("--seed", "N", "Seed of all random numbers.", 0, panel="Noise", min=0),
    force: bool = flag("--force", help="Write into a folder that is not empty."),
) -> None:
    """Simulate a calibration: records, calibration.toml for identify, and truth.json."""
    if interferometer is None:
        options.refuse_unused({"--optics": optics is not None}, "--interferometer")
    refuse_filled_folder(folder, force=force)
    settings: Fields = {
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
    with written_whole(folder) as output, ProgressBar("Simulating"):
        if interferometer is None:
            write(output.path, sensor, excitation, **settings)
        else:
            _write_light(output.path, sensor, excitation, interferometer, optics, settings)
    from vibrident.show.views import count

    records = [
        file
        for file in output.files
        if file.suffix in (".csv", ".h5") and "_optical" not in file.name
    ]
    other_files = [file for file in output.files if file.suffix not in (".csv", ".h5")]
    print_line(
        f"Simulated: sensor {sensor}, {excitation}, {count(len(records), 'record')}, seed {seed}."
    )
    show_written([*other_files, folder / ("*.csv" if interferometer is None else "*.h5")])


def _write_light(
    folder: Path,
    sensor: str,
    excitation: str,
    kind: str,
    optics: str | None,
    settings: Fields,
) -> None:
    """Write a simulated calibration with an interferometer's raw signals, and its truth."""
    from vibrident.app.workflow.simulated import write_truth
    from vibrident.physics.simulation import sensor_named
    from vibrident.physics.simulation.optics import write_optical_calibration

    true_sensor = sensor_named(sensor)
    seed = settings["seed"]
    rate_hz = settings["sampling_rate_hz"] or true_sensor.sampling_rate_hz
    light = _optics(kind, optics, rate_hz, seed)
    _require_length(light, settings["samples"] / rate_hz)
    del settings["quantity"]
    calibration = write_optical_calibration(folder, true_sensor, excitation, light, **settings)
    write_truth(folder / "truth.json", true_sensor, calibration, seed, interferometer=asdict(light))


def _optics(kind: str, text: str | None, rate_hz: float, seed: int) -> Optics:
    """Return the interferometer of --interferometer and --optics.

    ``text``: KEY=VALUE joined by commas; ``rate_hz``: sampling rate of the response.
    """
    from vibrident.data.interferometer.setting import Interferometer
    from vibrident.physics.simulation.optics import CARRIER_RATIO, Optics, drawn

    faults = _read_faults(text)
    if faults.get("rate", rate_hz) < rate_hz:
        raise InputError(
            "The light would be sampled more slowly than the response.",
            expected=f"at least {rate_hz:g} Hz, the rate of the response",
            found=f"{faults['rate']:g} Hz",
            where="--optics rate",
            remedy="give a larger rate, or leave it out",
        )
    passes = int(faults.pop("passes", 1))
    setting = Interferometer("quadrature", 632.991e-9, passes=passes, direction=1)
    if kind == "heterodyne":
        carrier = faults.pop("carrier", CARRIER_RATIO * faults.get("rate", rate_hz))
        setting = replace(setting, kind="heterodyne", carrier_hz=carrier)
    cyclic = tuple(faults.pop(f"cyclic{order}", 0.0) for order in (1, 2, 4))
    if (hidden := faults.pop("hidden-delay", None)) is not None:
        faults |= {"delay": hidden, "hidden_delay": True}
    values: Fields = {_FIELDS.get(key, key): value for key, value in faults.items()}
    for key in COUNTS & values.keys():
        values[key] = int(values[key])
    return drawn(replace(Optics(setting), cyclic_rad=cyclic, **values), seed)


def _require_length(light: Optics, duration_s: float) -> None:
    """Refuse light that no memory holds."""
    if light.rate_hz is None or light.rate_hz * duration_s <= MAX_LIGHT_SAMPLES:
        return
    raise InputError(
        "The light would have too many samples.",
        expected=f"at most {MAX_LIGHT_SAMPLES / duration_s:g} Hz, for records of {duration_s:g} s",
        found=f"{light.rate_hz:g} Hz",
        where="--optics rate",
        remedy="give a smaller rate, or fewer samples",
    )


def _read_faults(text: str | None) -> Fields:
    faults: Fields = {}
    for item in (text or "").split(","):
        if not item.strip():
            continue
        key, _, value = (piece.strip() for piece in item.partition("="))
        if key not in KEYS:
            raise unknown(f"{key!r} is not a key of --optics.", key, KEYS, "--optics")
        try:
            faults[key] = (key, value) == ("ellipse", "random") or _fault_size(key, value)
        except ValueError:
            expected = f"{key}={KEYS[key][0]}, {KEYS[key][1]}"
            raise unreadable_error(
                f"--optics {key}", value, expected, "write a number with a point, without a unit"
            ) from None
    return faults


def _fault_size(key: str, value: str) -> float:
    """Return the size of a fault; ValueError where none is of that size."""
    low, high = LIMITS.get(key, (0.0, 1e12))
    size = float(value)
    is_without_converter = key == "bits" and size == 0.0
    if not (low <= size <= high or is_without_converter):
        raise ValueError(f"{size:g}")
    if key in COUNTS and not size.is_integer():
        raise ValueError(f"{size:g}")
    return size
