"""Drawn files that state units, rates and starts somewhere: right within 4 u, or refused.

    python -m bench.files --runs 2000 --first 0

A draw is a sensor, its calibration in a drawn format, and a calibration file that states the same,
something else, or nothing. The parameters are compared with the sensor's.
"""

from __future__ import annotations

import argparse
import datetime
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import vibrident
from vibrident.base.errors import VibridentError
from vibrident.data.io.units import parse_unit

REFERENCES = {
    "acceleration": {"m/s^2": 1.0, "g": 9.80665, "mg": 9.80665e-3, "mm/s²": 1e-3, "Gal": 1e-2},
    "velocity": {"m/s": 1.0, "mm/s": 1e-3, "in/s": 0.0254, "µm/s": 1e-6},
    "displacement": {"m": 1.0, "mm": 1e-3, "µm": 1e-6, "nm": 1e-9},
}
RESPONSES = {"V": 1.0, "mV": 1e-3, "µV": 1e-6, "Volt": 1.0, "pC": 1e-12, "nA": 1e-9}
TONES = 60
TOLERANCE_U = 4.0


@dataclass
class Draw:
    """A sensor, its channels, and what file and calibration file state.

    Attributes:
        claimed: rate_hz of the calibration file: "", "right" or "wrong".
        scaled: [reference] scale: "", "conversion" or "gain".
        later: the reference begins so many samples after the response.
        sizes: of both channels in SI, rms.
    """

    rng: np.random.Generator
    form: str
    quantity: str
    reference_unit: str
    response_unit: str
    rate_hz: float
    samples: int
    is_unit_stated: bool
    is_rate_stated: bool
    claimed: str
    scaled: str
    later: float = 0.0
    truth: dict[str, float] = field(default_factory=dict)
    sizes: np.ndarray = field(default_factory=lambda: np.ones(2))

    def channels(self) -> tuple[np.ndarray, np.ndarray]:
        """Return reference and response as the file holds them."""
        fn, damping, sensitivity = self.truth.values()
        frequency = self.rng.uniform(0.01, 0.35, TONES) * self.rate_hz
        phase = self.rng.uniform(0, 2 * np.pi, TONES)
        omega = 2 * np.pi * frequency
        order = {"acceleration": 0, "velocity": 1, "displacement": 2}[self.quantity]
        amplitude = omega**order / np.sqrt(np.mean(omega ** (2 * order)))
        motion = amplitude / (1j * omega) ** order
        ratio = frequency / fn
        answer = amplitude * sensitivity / (1 - ratio**2 + 2j * damping * ratio)
        time = np.arange(self.samples) / self.rate_hz

        def values(parts: np.ndarray, start: float) -> np.ndarray:
            turns = np.exp(1j * (np.outer(time + start / self.rate_hz, omega) + phase))
            return (turns @ parts).real

        response = values(answer, 0.0)
        response += 1e-3 * np.std(response) * self.rng.normal(size=self.samples)
        reference = values(motion, self.later)
        gain = 2.5 if self.scaled == "gain" else 1.0
        self.sizes = np.array([np.std(reference), np.std(response)])
        factor = REFERENCES[self.quantity][self.reference_unit]
        return reference / factor / gain, response / RESPONSES[self.response_unit]


def drawn(seed: int, forms: tuple[str, ...]) -> Draw:
    """Return the draw of a seed."""
    rng = np.random.default_rng([2_026, seed])
    quantity = str(rng.choice(list(REFERENCES)))
    rate_hz = float(rng.choice([1000.0, 2048.0, 10_240.0, 44_100.0, 51_200.0]))
    form = forms[seed % len(forms)]
    two_files = form in ("csv", "hdf5", "parquet", "tdms", "uff", "mdf")
    later = float(rng.choice([0.0, 0.0, 12.0, -7.0, 0.37])) if two_files else 0.0
    is_rate_stated = bool(rng.random() < 0.7) or form in ("wav", "uff", "mdf") or later != 0.0
    claimed = str(rng.choice(["", "right", "wrong"], p=[0.5, 0.25, 0.25]))
    return Draw(
        rng,
        form,
        quantity,
        str(rng.choice(list(REFERENCES[quantity]))),
        str(rng.choice(list(RESPONSES))),
        rate_hz,
        2400,
        is_unit_stated=bool(rng.random() < 0.8) and form != "wav",
        is_rate_stated=is_rate_stated,
        claimed=claimed if is_rate_stated else "right",  # a wrong rate alone nothing contradicts
        scaled=str(rng.choice(["", "conversion", "gain"], p=[0.5, 0.25, 0.25])),
        later=later,
        truth={
            "natural_frequency": float(rng.uniform(0.1, 0.2) * rate_hz),
            "damping_ratio": float(rng.uniform(0.05, 0.3)),
            "sensitivity": float(10 ** rng.uniform(-4, -1)),
        },
    )


def write(draw: Draw, folder: Path) -> Path:
    """Write the files of a draw; return its calibration file."""
    reference, response = draw.channels()
    ending = {
        "csv": "csv",
        "lvm": "lvm",
        "hdf5": "h5",
        "matlab": "mat",
        "excel": "xlsx",
        "mdf": "mf4",
    }
    suffix = ending.get(draw.form, draw.form)
    starts = {"v": 0.0, "a": draw.later / draw.rate_hz}
    names = {"v": "v", "a": "a"}
    parts = {"x": {"a": reference, "v": response}}
    if draw.later:
        parts = {"x": {"v": response}, "r": {"a": reference}}
    for stem, channels in parts.items():
        names |= WRITERS[draw.form](draw, folder / f"{stem}.{suffix}", channels, starts)
    (folder / "c.toml").write_text(_calibration_text(draw, names, f"x.{suffix}", f"r.{suffix}"))
    return folder / "c.toml"


def _calibration_text(draw: Draw, names: dict[str, str], main: str, second: str) -> str:
    factor = REFERENCES[draw.quantity][draw.reference_unit]
    gain = 2.5 if draw.scaled == "gain" else 1.0
    scale = gain
    if not draw.is_unit_stated:
        scale *= factor
    elif draw.scaled == "conversion":
        scale = factor
    rate = {"": None, "right": draw.rate_hz, "wrong": draw.rate_hz * 1.003}[draw.claimed]
    lines = ["[reference]", f'column = "{names["a"]}"', f'quantity = "{draw.quantity}"']
    lines += [f"scale = {scale!r}"] if scale != 1.0 else []
    lines += ["[response]", f'column = "{names["v"]}"']
    if not draw.is_unit_stated:
        lines += [f"scale = {RESPONSES[draw.response_unit]!r}", 'unit = "V"']
    lines += ["[sampling]"] + ([f"rate_hz = {rate!r}"] if rate is not None else [])
    lines += ["[[records]]", f'file = "{main}"', 'excitation = "random"']
    lines += [f'reference_file = "{second}"'] if draw.later else []
    return "\n".join(lines) + "\n"


Columns = dict[str, np.ndarray]


def _units(draw: Draw) -> dict[str, str]:
    stated = {"a": draw.reference_unit, "v": draw.response_unit}
    return stated if draw.is_unit_stated else {"a": "", "v": ""}


def _csv(draw: Draw, path: Path, channels: Columns, starts: dict[str, float]) -> dict[str, str]:
    units = _units(draw)
    in_row = bool(draw.rng.random() < 0.5)
    names = {key: key if in_row or not units[key] else f"{key} [{units[key]}]" for key in channels}
    table = {}
    if draw.is_rate_stated:
        start = starts[next(iter(channels))]
        milli = bool(draw.rng.random() < 0.3)
        time = start + np.arange(draw.samples) / draw.rate_hz
        table["t [ms]" if milli else "t [s]"] = time * (1e3 if milli else 1.0)
    table |= {names[key]: values for key, values in channels.items()}
    head = ",".join(table) + "\n"
    if in_row and draw.is_unit_stated:
        plain = [name.partition(" ")[0] for name in table]
        row = [name.partition(" ")[2].strip("[]") or units.get(name, "") for name in table]
        head = ",".join(plain) + "\n" + ",".join(row) + "\n"
    rows = (",".join(f"{value:.15g}" for value in row) for row in zip(*table.values(), strict=True))
    path.write_text(head + "\n".join(rows) + "\n")
    return names


def _lvm(draw: Draw, path: Path, channels: Columns, starts: dict[str, float]) -> dict[str, str]:
    units = _units(draw)
    rows = zip(*channels.values(), strict=True)
    interval = (
        f"Delta_X\t{1 / draw.rate_hz!r}\t{1 / draw.rate_hz!r}\n" if draw.is_rate_stated else ""
    )
    text = (
        "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\nX_Columns\tNo\n"
        "***End_of_Header***\t\n\t\nChannels\t2\t\t\n"
        f"Samples\t{draw.samples}\t{draw.samples}\t\n"
        + (f"Y_Unit_Label\t{units['a']}\t{units['v']}\t\n" if draw.is_unit_stated else "")
        + "X_Dimension\tTime\tTime\t\nX0\t0.0\t0.0\t\n"
        + interval
        + "***End_of_Header***\t\t\t\nX_Value\ta\tv\tComment\n"
    )
    path.write_text(text + "".join(f"\t{a:.12g}\t{v:.12g}\n" for a, v in rows))
    return {}


def _hdf5(draw: Draw, path: Path, channels: Columns, starts: dict[str, float]) -> dict[str, str]:
    import h5py

    with h5py.File(path, "w") as file:
        for key, values in channels.items():
            data = file.create_dataset(key, data=values)
            if draw.is_unit_stated:
                data.attrs[str(draw.rng.choice(["unit", "units"]))] = _units(draw)[key]
            if draw.is_rate_stated:
                data.attrs["sample_rate"] = draw.rate_hz
        if draw.later:
            time = starts[next(iter(channels))] + np.arange(draw.samples) / draw.rate_hz
            file.create_dataset("time", data=time).attrs["units"] = "s"
    return {}


def _parquet(draw: Draw, path: Path, channels: Columns, starts: dict[str, float]) -> dict[str, str]:
    import pyarrow
    import pyarrow.parquet

    fields = []
    columns = []
    if draw.later:
        time = starts[next(iter(channels))] + np.arange(draw.samples) / draw.rate_hz
        fields.append(pyarrow.field("t [s]", pyarrow.float64()))
        columns.append(time)
    for key, values in channels.items():
        metadata = {"unit": _units(draw)[key]} if draw.is_unit_stated else {}
        if draw.is_rate_stated:
            metadata["sampling_rate_hz"] = repr(draw.rate_hz)
        fields.append(pyarrow.field(key, pyarrow.float64(), metadata=metadata))
        columns.append(values)
    table = pyarrow.table(columns, schema=pyarrow.schema(fields))
    pyarrow.parquet.write_table(table, path)
    return {}


def _tdms(draw: Draw, path: Path, channels: Columns, starts: dict[str, float]) -> dict[str, str]:
    from nptdms import ChannelObject, TdmsWriter

    objects = []
    for key, values in channels.items():
        properties = {}
        if draw.is_rate_stated:
            properties |= {"wf_increment": 1 / draw.rate_hz, "wf_start_offset": starts[key]}
            properties["wf_start_time"] = np.datetime64("2026-01-01T00:00:00", "us")
        if draw.is_unit_stated:
            properties["unit_string"] = _units(draw)[key]
        objects.append(ChannelObject("g", key, values, properties))
    with TdmsWriter(path) as writer:
        writer.write_segment(objects)
    return {key: f"g/{key}" for key in channels}


def _uff(draw: Draw, path: Path, channels: Columns, starts: dict[str, float]) -> dict[str, str]:
    from tests.support.file_formats import uff

    uff(path, {}, draw.rate_hz)
    for number, (key, values) in enumerate(channels.items()):
        target = path if number == 0 else path.with_name(f"{key}{path.suffix}")
        units = {"ordinate_axis_units_lab": _units(draw)[key] or "NONE"}
        start = {"x": starts[key] + np.arange(draw.samples) / draw.rate_hz}
        uff(target, {key: values}, draw.rate_hz, **units, **start, abscissa_min=starts[key])
        if target != path:
            path.write_bytes(path.read_bytes() + target.read_bytes())
            target.unlink()
    return {}


def _mdf(draw: Draw, path: Path, channels: Columns, starts: dict[str, float]) -> dict[str, str]:
    from asammdf import MDF, Signal

    time = np.arange(draw.samples) / draw.rate_hz
    with MDF(version="4.10") as file:
        file.header.start_time = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)
        for key, values in channels.items():
            stamps = 1.0 + starts[key] + time
            file.append([Signal(values, stamps, name=key, unit=_units(draw)[key])])
        file.save(path, overwrite=True)
    return {}


def _wav(draw: Draw, path: Path, channels: Columns, starts: dict[str, float]) -> dict[str, str]:
    import soundfile

    columns = np.column_stack([*channels.values()])
    soundfile.write(path, columns, round(draw.rate_hz), subtype="DOUBLE")
    return {"a": "channel 1", "v": "channel 2"}


def _matlab(draw: Draw, path: Path, channels: Columns, starts: dict[str, float]) -> dict[str, str]:
    import scipy.io

    units = _units(draw)
    if draw.is_unit_stated:
        content = {key: {"data": values, "unit": units[key]} for key, values in channels.items()}
        names = {key: f"{key}.data" for key in channels}
    else:
        content = dict(channels)
        names = {}
    if draw.is_rate_stated:
        content["Fs" if draw.rng.random() < 0.5 else "fs"] = draw.rate_hz
    scipy.io.savemat(path, content)
    return names


def _excel(draw: Draw, path: Path, channels: Columns, starts: dict[str, float]) -> dict[str, str]:
    import openpyxl

    book = openpyxl.Workbook(write_only=True)
    sheet = book.create_sheet()
    table = dict(channels)
    if draw.is_rate_stated:
        table = {"time (s)": np.arange(draw.samples) / draw.rate_hz} | table
    sheet.append(list(table))
    if draw.is_unit_stated:
        sheet.append([_units(draw).get(name, "s") for name in table])
    for row in zip(*table.values(), strict=True):
        sheet.append([float(value) for value in row])
    book.save(path)
    return {}


Writer = Callable[[Draw, Path, Columns, dict[str, float]], dict[str, str]]
WRITERS: dict[str, Writer] = {
    "csv": _csv, "lvm": _lvm, "hdf5": _hdf5, "parquet": _parquet, "tdms": _tdms, "uff": _uff,
    "mdf": _mdf, "wav": _wav, "matlab": _matlab, "excel": _excel,
}  # fmt: skip


def outcome(draw: Draw, path: Path) -> tuple[str, str]:
    """Return "right", "refused", "said", "silent" or, of channels read rightly, "fit"; and why."""
    try:
        calibration = vibrident.read(path)
        result = vibrident.identify(calibration, model="accelerometer")
    except VibridentError as error:
        return "refused", str(error).splitlines()[0]
    except RuntimeWarning as warning:
        return "fit", str(warning)
    worst = 0.0
    name = ""
    for parameter, truth in draw.truth.items():
        stated = result.parameters[parameter]
        value = stated.value
        u = stated.standard_uncertainty
        if u is None:
            continue  # said to be not identifiable
        if parameter == "sensitivity":
            unit = parse_unit(stated.unit)
            assert unit is not None
            truth /= unit.factor
        apart = abs(value - truth) / u
        if apart > worst:
            worst = apart
            name = parameter
    if worst <= TOLERANCE_U:
        return "right", ""
    codes = ", ".join(result.warning_codes)
    kind = "fit" if _is_read_rightly(draw, calibration) else "said" if codes else "silent"
    return kind, f"{name} {worst:.3g} u {codes}"


def _is_read_rightly(draw: Draw, calibration: vibrident.Calibration) -> bool:
    """Tell whether sizes of both channels, rate and alignment are those of the sensor's motion."""
    (record,) = calibration.records
    unit = parse_unit(calibration.response_unit)
    assert unit is not None
    assert record.reference is not None
    sizes = [float(np.std(record.reference)), float(np.std(record.response)) * unit.factor]
    is_sized = np.allclose(np.array(sizes) / draw.sizes, 1.0, atol=0.1)
    return bool(is_sized) and abs(record.sampling_rate_hz / draw.rate_hz - 1.0) < 1e-6


def main() -> None:
    """Draw, and print what came out."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--forms", default=",".join(WRITERS))
    options = parser.parse_args()
    forms = tuple(options.forms.split(","))
    counts: Counter[tuple[str, str]] = Counter()
    reasons: Counter[str] = Counter()
    for seed in range(options.first, options.first + options.runs):
        draw = drawn(seed, forms)
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.simplefilter("error", RuntimeWarning)
            kind, why = outcome(draw, write(draw, Path(folder)))
        counts[draw.form, kind] += 1
        must_be_right = draw.claimed != "wrong" and not (
            draw.is_unit_stated and draw.scaled == "conversion"
        )
        if kind in ("silent", "said", "fit") or (kind == "refused" and must_be_right):
            reasons[f"{draw.form} {kind}: {why[:70]}"] += 1
            print(seed, draw.form, kind, why, draw.later, draw.claimed, draw.scaled, flush=True)
    for form in forms:
        print(
            form,
            {kind: counts[form, kind] for kind in ("right", "refused", "fit", "said", "silent")},
        )
    for reason, count in reasons.most_common(30):
        print(count, reason)


if __name__ == "__main__":
    main()
