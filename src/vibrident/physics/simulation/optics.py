"""Photodetector signals of an interferometer with faults, and calibrations by them."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.data.interferometer.setting import FloatArray, Interferometer
from vibrident.data.io.toml_text import toml_entry, toml_section
from vibrident.data.records import Calibration
from vibrident.physics.simulation.calibration import simulate
from vibrident.physics.simulation.motion import Motion, SampleGrid
from vibrident.physics.simulation.scheme import Seed, Take, stream
from vibrident.physics.simulation.sensors import Sensor
from vibrident.physics.simulation.truth import displacement_on

#: Orders of the cyclic error.
CYCLIC_ORDERS = (1, 2, 4)
#: Part of a converter's range that the signals use.
USED_RANGE = 0.85
#: Columns of the signals in the files.
COLUMNS = ("u1", "u2")
#: Largest turn of phase between samples, rad, by which the rate of the optical signals is chosen.
MAX_TURN_RAD = 1.0
#: Carrier over the rate of the optical signals.
CARRIER_RATIO = 0.25


@dataclass(frozen=True)
class Optics:
    """Interferometer and its faults.

    Attributes:
        setting: as the calibration file states it.
        rate_hz: of the optical signals; None: a multiple of the response's rate that suits this
            motion.
        offsets: offsets, amplitudes: of both signals (heterodyne: the first), V.
        quadrature_error_rad: the second signal is sin(phase + this).
        noise: of each signal, white, over its mean amplitude.
        bits: of the converter; 0 leaves the signals as they are.
        dropouts: number of light losses in a record, each for ``dropout_s``.
        drift: offsets and ratio of the amplitudes change by this part of the amplitude over the
            record.
        fading: the common amplitude changes by this part over the record, as by speckle.
        cyclic_rad: amplitudes of the cyclic error, first, second and fourth harmonic of the phase.
        table_m: rms of the motion of the optical table against the sensor, 0.5 to 10 Hz.
        delay_s: the optical channel comes later than the response; stated in the file unless
            ``hidden_delay``.
        hidden_delay: the file states no delay.
        carrier_drift_hz: change of the carrier over the record.
        random: draws offsets, amplitudes and quadrature error anew, one ellipse for all records.
    """

    setting: Interferometer = field(
        default_factory=lambda: Interferometer("quadrature", 632.991e-9, direction=1)
    )
    rate_hz: float | None = None
    offsets: tuple[float, float] = (0.06, -0.04)
    amplitudes: tuple[float, float] = (1.0, 0.92)
    quadrature_error_rad: float = 0.06
    noise: float = 0.01
    bits: int = 14
    dropouts: int = 0
    dropout_s: float = 2e-5
    drift: float = 0.0
    fading: float = 0.0
    cyclic_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    table_m: float = 0.0
    delay_s: float = 0.0
    hidden_delay: bool = False
    carrier_drift_hz: float = 0.0
    random: bool = False

    @property
    def full_scale(self) -> float:
        """Return the largest magnitude that the converter holds, V."""
        largest = max(abs(o) + a for o, a in zip(self.offsets, self.amplitudes, strict=True))
        mean = float(np.mean(self.amplitudes))
        return (
            largest + mean * (5.0 * self.noise + abs(self.drift) + abs(self.fading))
        ) / USED_RANGE

    @property
    def volts_per_code(self) -> float:
        """Return a step of the converter, V; 1 without a converter."""
        return self.full_scale / 2.0 ** (self.bits - 1) if self.bits else 1.0


def optical_signals(
    motion: Motion, optics: Optics, rate_hz: float, samples: int, seed: Seed, record: int
) -> FloatArray:
    """Return the signals of a record, shape (2 or 1, samples).

    They are in codes of the converter, or V without one.

    ``motion``: of the sensor's base; ``rate_hz``: of the signals; ``seed``: of the calibration;
    ``record``: index of the record.
    """
    random = stream(seed, record, "optics")
    time = np.arange(samples) / rate_hz
    moved = displacement_on(motion, SampleGrid(-optics.delay_s, rate_hz, samples))
    moved = moved + _table(optics, time, random)
    phase = moved / optics.setting.metres_per_radian + random.uniform(0.0, 2.0 * np.pi)
    for order, size in zip(CYCLIC_ORDERS, optics.cyclic_rad, strict=True):
        if size:
            phase = phase + size * np.sin(order * phase + 0.7 * order)
    light = _light(optics, time, random)
    detected = _heterodyne if optics.setting.kind == "heterodyne" else _quadrature
    signals = detected(optics, phase, light, time)
    size = optics.noise * float(np.mean(optics.amplitudes[: signals.shape[0]]))
    signals += size * random.standard_normal(signals.shape)
    if not optics.bits:
        return signals
    top = 2 ** (optics.bits - 1)
    return np.clip(np.rint(signals / optics.volts_per_code), -top, top - 1)


def _quadrature(
    optics: Optics, phase: FloatArray, light: FloatArray, time: FloatArray
) -> FloatArray:
    centred_time = time / max(float(time[-1]), 1e-300) - 0.5
    p, q = optics.offsets
    a, b = optics.amplitudes
    mean = 0.5 * (a + b)
    moved = optics.drift * centred_time
    first = p + mean * moved + a * (1.0 + 0.5 * moved) * light * np.cos(phase)
    second = (
        q
        - mean * moved
        + b * (1.0 - 0.5 * moved) * light * np.sin(phase + optics.quadrature_error_rad)
    )
    return np.stack([first, second])


def _heterodyne(
    optics: Optics, phase: FloatArray, light: FloatArray, time: FloatArray
) -> FloatArray:
    carrier = optics.setting.carrier_hz or 0.0
    turns = carrier * time + 0.5 * optics.carrier_drift_hz * time**2 / max(float(time[-1]), 1e-300)
    angle = 2.0 * np.pi * np.mod(turns, 1.0) + phase
    return (optics.offsets[0] + optics.amplitudes[0] * light * np.cos(angle))[None, :]


def _light(optics: Optics, time: FloatArray, random: np.random.Generator) -> FloatArray:
    """Return the amplitude over its nominal value: fading, and stretches without light."""
    span = max(float(time[-1]), 1e-300)
    light = 1.0 + optics.fading * 0.5 * np.sin(2.0 * np.pi * (1.3 * time / span + random.uniform()))
    for middle in random.uniform(0.1, 0.9, optics.dropouts) * span:
        light *= 1.0 - np.exp(-(((time - middle) / (0.5 * optics.dropout_s)) ** 8))
    return light


def _table(optics: Optics, time: FloatArray, random: np.random.Generator) -> FloatArray:
    if optics.table_m == 0.0:
        return np.zeros(time.shape)
    tones = random.uniform(0.5, 10.0, 8)
    angles = random.uniform(0.0, 2.0 * np.pi, 8)
    waves = sum(np.cos(2.0 * np.pi * f * time + a) for f, a in zip(tones, angles, strict=True))
    return np.asarray(optics.table_m * waves / 2.0)


def drawn(optics: Optics, seed: int) -> Optics:
    """Return the optics, with a random ellipse if requested."""
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
    """Simulate a calibration and write it with raw optical signals as its reference.

    A record becomes an HDF5 file with the signals (up to 16 bit as int16) and the response. Signals
    that are sampled faster than the response get their own file.

    ``sensor``, ``excitation`` and ``settings`` are those of ``simulate``; ``optics``: the
    interferometer and its faults; the folder is created if it does not exist.

    Returns:
        The calibration with the true displacement as its reference.
    """
    takes: list[Take] = []
    truth = simulate(
        sensor, excitation, quantity="displacement", seed=seed, keep_takes=takes, **settings
    )
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
                "rate_hz": record.sampling_rate_hz
                if record.sampling_rate_hz != takes[0].sampling_rate_hz
                else None,
            }
        )
    (target / "calibration.toml").write_text(
        _toml(truth, optics, entries, takes[0]), encoding="utf-8"
    )
    return truth


def _fast_enough(optics: Optics, truth: Calibration) -> Optics:
    """Return the optics with a rate at which the phase of a motion can be followed.

    It is a multiple of the response's. A carrier at its default part of the response's rate scales
    with it.
    """
    if optics.rate_hz is not None:
        return optics
    rate = truth.records[0].sampling_rate_hz
    turns = [
        float(np.max(np.abs(np.diff(record.reference)))) * record.sampling_rate_hz
        for record in truth.records
        if record.reference is not None
    ]
    times = int(np.ceil(max(turns) / optics.setting.metres_per_radian / MAX_TURN_RAD / rate))
    carrier = optics.setting.carrier_hz
    if carrier is not None and carrier != CARRIER_RATIO * rate:
        times = max(times, int(np.ceil(carrier / CARRIER_RATIO / rate)))
    elif carrier is not None:
        optics = replace(
            optics, setting=replace(optics.setting, carrier_hz=CARRIER_RATIO * rate * max(times, 1))
        )
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
    lines = [
        toml_section("sensor", {**truth.sensor, "model": truth.model}),
        toml_section("interferometer", section),
        toml_section("response", {"column": "response", "scale": 1.0, "unit": truth.response_unit}),
        toml_section("sampling", {"rate_hz": float(take.sampling_rate_hz)}),
        *(toml_entry("records", entry) for entry in entries),
    ]
    return "\n".join(lines)
