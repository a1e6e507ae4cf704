"""Long optical signals for the benchmark, written in blocks."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from vibrident import simulate
from vibrident.data.records import Record

RATE_HZ = 20e6
RESPONSE_HZ = 51_200.0
FREQUENCY_HZ = 160.0
AMPLITUDE = 10.0
CARRIER_HZ = 5e6
BLOCK_SAMPLES = 1 << 20  # samples written at once
CODES = 6000.0  # steps of the converter for the amplitude of a signal
NOISE = 0.02  # over the amplitude


def codes_of(record: Record) -> list[str]:
    """Codes of the findings of a record's optical signals."""
    return [] if record.optical is None else [finding.code for finding in record.optical.findings]


def write_long(folder: Path, kind: str, samples: int) -> Path:
    """Write one long sine, its optical signals as int16; return the calibration file."""
    random = np.random.default_rng(0)
    names = ["u1", "u2"] if kind == "quadrature" else ["u1"]
    with h5py.File(folder / "optical.h5", "w") as file:
        arrays = [file.create_dataset(name, (samples,), dtype="i2") for name in names]
        for start in range(0, samples, BLOCK_SAMPLES):
            time = np.arange(start, min(start + BLOCK_SAMPLES, samples)) / RATE_HZ
            moved = (
                AMPLITUDE
                / (2.0 * np.pi * FREQUENCY_HZ) ** 2
                * np.cos(2.0 * np.pi * FREQUENCY_HZ * time)
            )
            phase = 4.0 * np.pi / 632.991e-9 * moved + 0.4
            signals = [0.05 + np.cos(phase), -0.03 + 0.9 * np.sin(phase + 0.06)]
            if kind == "heterodyne":
                signals = [np.cos(2.0 * np.pi * np.mod(CARRIER_HZ * time, 1.0) + phase)]
            for array, signal in zip(arrays, signals, strict=True):
                array[start : start + time.size] = np.rint(
                    CODES * (signal + NOISE * random.standard_normal(time.size))
                )
    calibration = simulate(
        "paper",
        "sine",
        frequencies_hz=[FREQUENCY_HZ],
        sampling_rate_hz=RESPONSE_HZ,
        samples=int(samples / RATE_HZ * RESPONSE_HZ),
        amplitude=AMPLITUDE,
        start="steady",
        response_noise=1e-3,
    )
    response = calibration.records[0].response
    with h5py.File(folder / "response.h5", "w") as file:
        file["response"] = response
    carrier = f"carrier_hz = {CARRIER_HZ!r}" if kind == "heterodyne" else ""
    path = folder / "calibration.toml"
    path.write_text(
        f'[interferometer]\nkind = "{kind}"\ncolumns = {names}\nwavelength_m = 632.991e-9\n'
        f"rate_hz = {RATE_HZ!r}\ndirection = 1\n{carrier}\n"
        f'[response]\ncolumn = "response"\n[sampling]\nrate_hz = {RESPONSE_HZ!r}\n'
        '[[records]]\nfile = "response.h5"\nreference_file = "optical.h5"\nexcitation = "sine"\n',
        encoding="utf-8",
    )
    return path
