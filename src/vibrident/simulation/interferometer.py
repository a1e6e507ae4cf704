"""A simulated calibration with an interferometer's raw signals as its reference: files, and the truth."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.io.toml_text import toml_entry, toml_section
from vibrident.records import Calibration
from vibrident.simulation.calibration import simulate
from vibrident.simulation.motion import Motion
from vibrident.simulation.optics import Optics, optical_signals
from vibrident.simulation.scheme import Seed, Take
from vibrident.simulation.sensors import Sensor

COLUMNS = ("u1", "u2")
LARGEST_TURN = 1.0  # largest turn of phase between samples, rad, by which the rate of the optical signals is chosen
CARRIER = 0.25  # carrier over the rate of the optical signals


def drawn(optics: Optics, seed: int) -> Optics:
    """The optics, with a random ellipse if requested."""
    if not optics.random:
        return optics
    random = np.random.default_rng([seed, 13])
    return replace(
        optics,
        offsets=tuple(random.uniform(-0.2, 0.2, 2).tolist()),
        amplitudes=tuple(random.uniform(0.75, 1.25, 2).tolist()),
        quadrature_error_rad=float(random.uniform(-0.25, 0.25)),
        random=False,
    )


def write_optical_calibration(
    folder: str | os.PathLike[str],
    sensor: str | Sensor,
    excitation: str | Motion,
    optics: Optics,
    *,
    seed: Seed = 0,
    **settings: Any,
) -> Calibration:
    """Simulate a calibration and write it with an interferometer's raw signals in place of its reference.

    A record becomes an HDF5 file with the signals (up to 16 bit as int16) and the response. Signals that are sampled
    faster than the response get their own file.

    Args:
        folder: created if it does not exist.
        sensor: as of ``simulate``.
        excitation: as of ``simulate``.
        optics: the interferometer and its faults.
        seed: of everything random.
        settings: further settings of ``simulate``.

    Returns:
        The calibration with the true displacement as its reference.
    """
    takes: list[Take] = []
    truth = simulate(sensor, excitation, quantity="displacement", seed=seed, keep_takes=takes, **settings)
    optics = _fast_enough(optics, truth)
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    entries = []
    for index, (take, record) in enumerate(zip(takes, truth.records, strict=True)):
        rate = optics.rate_hz or take.sampling_rate_hz
        samples = round(take.samples * rate / take.sampling_rate_hz)
        signals = optical_signals(take.motion, optics, rate, samples, seed, index)
        stem = f"record_{index + 1:02d}"
        apart = optics.rate_hz is not None
        channels: dict[str, np.ndarray] = dict(zip(COLUMNS, signals, strict=False))
        response = {"response": record.response}
        _write(target / f"{stem}.h5", response if apart else {**response, **channels}, optics.bits)
        if apart:
            _write(target / f"{stem}_optical.h5", channels, optics.bits)
        entries.append(
            {
                "file": f"{stem}.h5",
                "reference_file": f"{stem}_optical.h5" if apart else None,
                "name": record.name,
                "excitation": record.excitation,
                "frequency_hz": record.frequency_hz,
                "rate_hz": record.sampling_rate_hz if record.sampling_rate_hz != takes[0].sampling_rate_hz else None,
            }
        )
    (target / "calibration.toml").write_text(_toml(truth, optics, entries, takes[0]), encoding="utf-8")
    return truth


def _fast_enough(optics: Optics, truth: Calibration) -> Optics:
    """The optics with a rate at which the phase of this motion can be followed, a multiple of the response's.

    A carrier at its default part of the response's rate scales with it.
    """
    if optics.rate_hz is not None:
        return optics
    rate = truth.records[0].sampling_rate_hz
    turns = [
        float(np.max(np.abs(np.diff(record.reference)))) * record.sampling_rate_hz
        for record in truth.records
        if record.reference is not None
    ]
    times = int(np.ceil(max(turns) / optics.setting.metres_per_radian / LARGEST_TURN / rate))
    carrier = optics.setting.carrier_hz
    if carrier is not None and carrier != CARRIER * rate:
        times = max(times, int(np.ceil(carrier / CARRIER / rate)))
    elif carrier is not None:
        optics = replace(optics, setting=replace(optics.setting, carrier_hz=CARRIER * rate * max(times, 1)))
    return optics if times <= 1 else replace(optics, rate_hz=rate * times)


def _write(path: Path, channels: dict[str, np.ndarray], bits: int) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for name, values in channels.items():
            raw = name != "response" and 0 < bits <= 16
            file.create_dataset(name, data=values.astype(np.int16) if raw else values)


def _toml(truth: Calibration, optics: Optics, entries: list[dict[str, Any]], take: Take) -> str:
    setting = optics.setting
    count = 1 if setting.kind == "heterodyne" else 2
    delay = 0.0 if optics.hidden_delay else optics.delay_s
    section = {
        "kind": setting.kind,
        "columns": list(COLUMNS[:count]),
        "wavelength_m": setting.wavelength_m,
        "wavelength_relative_uncertainty": setting.wavelength_relative_uncertainty or None,
        "passes": setting.passes,
        "carrier_hz": setting.carrier_hz,
        "direction": setting.direction,
        "delay_s": delay or None,
        "delay_standard_uncertainty_s": setting.delay_standard_uncertainty_s or None,
        "rate_hz": optics.rate_hz,
    }
    parts = [
        toml_section("sensor", {**truth.sensor, "model": truth.model}),
        toml_section("interferometer", section),
        toml_section("response", {"column": "response", "scale": 1.0, "unit": truth.response_unit}),
        toml_section("sampling", {"rate_hz": float(take.sampling_rate_hz)}),
        *(toml_entry("records", entry) for entry in entries),
    ]
    return "\n".join(parts)
