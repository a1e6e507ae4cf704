"""The options of ``vibrident simulate`` that make an interferometer's raw signals."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibrident.cli.options import not_read
from vibrident.errors import unknown

if TYPE_CHECKING:
    from vibrident.simulation.optics import Optics

INTERFEROMETERS = ("quadrature", "heterodyne")
#: What may stand in --optics: key, what it takes, what it is.
KEYS = {
    "rate": ("HZ", "of the optical signals; without it a multiple of the response's that the motion needs"),
    "carrier": ("HZ", "of a heterodyne signal; a quarter of the rate without it"),
    "noise": ("REL", "of each signal, over its amplitude"),
    "bits": ("N", "of the converter, 8 to 16; 0 for none"),
    "dropouts": ("N", "a record"),
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
#: Key → field of ``Optics``, where its name is another.
_FIELDS = {
    "rate": "rate_hz",
    "dropout": "dropout_s",
    "table": "table_m",
    "delay": "delay_s",
    "carrier-drift": "carrier_drift_hz",
    "ellipse": "random",
}


def optics_of(kind: str, text: str | None, rate_hz: float, seed: int) -> Optics:
    """The interferometer of --interferometer and --optics, KEY=VALUE joined by commas; ``rate_hz`` of the response.

    Raises:
        InputError: a key is unknown, or a value is not a number.
    """
    from vibrident.interferometer.setting import Interferometer
    from vibrident.simulation.optics import CARRIER, Optics, drawn

    given = _given(text)
    passes = int(given.pop("passes", 1))
    setting = Interferometer("quadrature", 632.991e-9, passes=passes, direction=1)
    if kind == "heterodyne":
        carrier = given.pop("carrier", CARRIER * given.get("rate", rate_hz))
        setting = replace(setting, kind="heterodyne", carrier_hz=carrier)
    cyclic = tuple(given.pop(f"cyclic{order}", 0.0) for order in (1, 2, 4))
    if (hidden := given.pop("hidden-delay", None)) is not None:
        given |= {"delay": hidden, "hidden_delay": True}
    values: dict[str, Any] = {_FIELDS.get(key, key): value for key, value in given.items()}
    for key in {"bits", "dropouts"} & values.keys():
        values[key] = int(values[key])
    return drawn(replace(Optics(setting), cyclic_rad=cyclic, **values), seed)


def _given(text: str | None) -> dict[str, Any]:
    given: dict[str, Any] = {}
    for part in (text or "").split(","):
        if not part.strip():
            continue
        key, _, value = (piece.strip() for piece in part.partition("="))
        if key not in KEYS:
            raise unknown(f"{key!r} is not a key of --optics.", key, KEYS, "--optics")
        given[key] = True if key == "ellipse" and value == "random" else _number(key, value)
    return given


def _number(key: str, value: str) -> float:
    try:
        return float(value)
    except ValueError:
        expected = f"{key}={KEYS[key][0]}, {KEYS[key][1]}"
        raise not_read(f"--optics {key}", value, expected, "write a number with a point, without a unit") from None


def write_optical(folder: Path, sensor: str, excitation: str, optics: Optics, *, seed: int, **settings: Any) -> None:
    """Write a simulated calibration with an interferometer's raw signals, and its truth."""
    from vibrident.simulation import sensor_named
    from vibrident.simulation.optics import write_optical_calibration
    from vibrident.workflow.simulated import write_truth

    chosen = sensor_named(sensor)
    settings.pop("quantity", None)
    calibration = write_optical_calibration(folder, chosen, excitation, optics, seed=seed, **settings)
    write_truth(folder / "truth.json", chosen, calibration, seed, interferometer=asdict(optics))
