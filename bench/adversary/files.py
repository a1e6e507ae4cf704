"""Recordings as files: time columns in many units, contradicting rates, gaps, doubled files."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from bench.adversary.defects import Raw
from bench.adversary.noise import Noise
from bench.adversary.recording import records, setting
from bench.adversary.trial import Cases, Trial, truth
from vibrident import Calibration, read

#: Header of a time column, and how many of its units a second has.
HEADERS = {
    "time_s": 1.0,
    "Time (ms)": 1e3,
    "t [ms]": 1e3,
    "time_us": 1e6,
    "Time [µs]": 1e6,
    "t (ns)": 1e9,
    "time [min]": 1.0 / 60.0,
    "时间（毫秒）": 1e3,
    "时间(秒)": 1.0,
}
WRONG = (
    "rate contradicts the time column",
    "rate contradicts the stated frequencies",
    "times jump",
    "time in ms, frequencies stated",
    "one file under two names",
    "a sample repeated",
)
QUIET = Noise("0.1 %", 1e-3)


def cases() -> Cases:
    """Return the names and makers."""
    for header, motion in itertools.product(HEADERS, ("sine", "random", "sweep")):
        yield (
            f"{header.replace('/', ' per ')}/{motion}",
            partial(_maker, "", motion, header, "in-light"),
        )
    for wrong, motion, sensor in itertools.product(
        WRONG, ("sine", "random"), ("in-light", "in-damped")
    ):
        if motion == "sine" or "frequencies" not in wrong:
            yield f"{wrong}/{motion}/{sensor}", partial(_maker, wrong, motion, "time_s", sensor)


def _maker(wrong: str, motion: str, header: str, sensor: str, rng: np.random.Generator) -> Trial:
    conditions = setting(sensor, rng)
    recordings = records(motion, conditions, QUIET, rng, stated="frequencies" in wrong)
    files, sampling = _written(recordings, wrong, header)
    text = _calibration_file(
        conditions.sensor.model, conditions.quantity, sampling, recordings, tuple(files)
    )
    model = conditions.sensor.model
    cause = wrong and f"file: {wrong}"

    def reading() -> Calibration:
        with tempfile.TemporaryDirectory() as folder:
            for name, content in {**files, "calibration.toml": text}.items():
                Path(folder, name).write_text(content, encoding="utf-8")
            return read(Path(folder, "calibration.toml"))

    return Trial(reading, model, truth(conditions.sensor), cause=cause)


def _written(recordings: list[Raw], wrong: str, header: str) -> tuple[dict[str, str], str]:
    """Files by name, and what the calibration file says of the sampling."""
    rate = recordings[0].rate
    sampling = f"time_column = {header!r}"
    if wrong.startswith("rate contradicts"):
        sampling = f"rate_hz = {2.0 * rate!r}"
    files = {f"{raw.name}.csv": _csv(raw, wrong, header) for raw in recordings}
    if wrong == "one file under two names":
        files["again.csv"] = files[f"{recordings[0].name}.csv"]
    return files, sampling


def _csv(raw: Raw, wrong: str, header: str) -> str:
    per_second = 1e3 if wrong.startswith("time in ms") else HEADERS[header]
    time = np.arange(raw.response.size) / raw.rate * per_second
    columns = [time, raw.reference, raw.response]
    if wrong == "times jump":
        columns = [np.delete(column, slice(400, 437)) for column in columns]
    if wrong == "a sample repeated":
        columns = [np.insert(column, 500, column[500]) for column in columns]
    name = "t" if wrong == "time in ms, frequencies stated" else header
    name = "counter" if wrong == "rate contradicts the stated frequencies" else name
    if name == "counter":
        columns[0] = np.arange(columns[0].size, dtype=float)
    rows = "\n".join(
        ",".join(f"{value:.12g}" for value in row) for row in zip(*columns, strict=True)
    )
    return f"{name},reference,response\n{rows}\n"


def _calibration_file(
    model: str, quantity: str, sampling: str, recordings: list[Raw], names: tuple[str, ...]
) -> str:
    if "time_column" in sampling and any(raw.frequency_hz for raw in recordings):
        sampling = "time_column = 't'"
    by_name: Mapping[str, Raw] = {f"{raw.name}.csv": raw for raw in recordings}
    lines = [
        f'[sensor]\nmodel = "{model}"',
        f'[reference]\ncolumn = "reference"\nquantity = "{quantity}"',
        '[response]\ncolumn = "response"\nunit = "V"',
        f"[sampling]\n{sampling}",
    ]
    for name in names:
        raw = by_name.get(name, recordings[0])
        stated = f"\nfrequency_hz = {raw.frequency_hz!r}" if raw.frequency_hz else ""
        lines.append(f'[[records]]\nfile = "{name}"\nexcitation = "{raw.excitation}"{stated}')
    return "\n".join(lines) + "\n"
