"""C99 header and source for firmware: the model, its correction filter and the cell.

Their errors are computed from the coefficients as written, and stated in the comment. Of the text
around the numbers (templates/sensor*) ``@N@`` is the name, ``@S@`` the suffix of the precision,
``@T@`` its type; all others are numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vibrident.base.escaping import c_comment
from vibrident.data.records import FloatArray
from vibrident.export.discrete import HoldCell, SecondOrderSections
from vibrident.export.filters import (
    HIGH_PASS_OVER_BAND,
    Filter,
    checked_rate,
    correction_filter,
    model_filter,
)
from vibrident.export.form import Format, Options, fill_template, write_c_comment
from vibrident.export.poles_zeros import poles_zeros
from vibrident.export.sensor import ExportedSensor, identity

MAX_STOPPED_GAIN = 0.1  # gain that counts as stopped, relative to the largest gain in the band


@dataclass(frozen=True, eq=False)
class Firmware:
    """Content of the C code."""

    sensor: ExportedSensor
    model: Filter
    correction: Filter
    cell: HoldCell
    rate_hz: float


def firmware(sensor: ExportedSensor, rate_hz: float | None) -> Firmware:
    """Design all filters for one sampling rate."""
    rate = checked_rate(sensor, rate_hz)
    model, cell = model_filter(sensor, rate)
    return Firmware(sensor, model, correction_filter(sensor, rate), cell, rate)


def write(sensor: ExportedSensor, folder: Path, options: Options) -> list[Path]:
    """Write ``NAME.h`` and ``NAME.c``."""
    if options.online:
        from vibrident.export.online import write as write_tracker

        return write_tracker(sensor, folder, options)
    code = firmware(sensor, options.rate_hz)
    common = _common_values(code, options.name, write_c_comment(description(code)))
    paths = []
    for suffix in ("h", "c"):
        body = "".join(
            fill_template(f"sensor_part.{suffix}", {**common, **_coefficients(code, single)})
            for single in (False, True)
        )
        path = folder / f"{options.name}.{suffix}"
        text = fill_template(f"sensor.{suffix}", {**common, "BODY": body})
        path.write_text(text, encoding="utf-8")
        paths.append(path)
    return paths


#: Last lines of the description.
_NOTES = (
    "",
    (
        "the code holds no uncertainties: those of the parameters are above, those of a "
        "corrected signal do not"
    ),
    "follow from them alone; see `vibrident correct`.",
    "Do not compile with -ffast-math or -funsafe-math-optimizations.",
)


def description(code: Firmware) -> list[str]:
    """Return identity, and each part with its errors, one line each."""
    sensor = code.sensor
    model = code.model
    correction = code.correction
    f = sensor.band
    exact = sensor.response(f)
    rational = np.asarray(poles_zeros(sensor).response(f))
    without = ""
    if sensor.apart:
        without = f" (without {' and '.join(sensor.apart)}, which it does not hold)"
    low, high = sensor.band_hz
    ms = 1e3 / code.rate_hz
    inverse = correction.late(f) / exact
    upper_hz = f[f >= np.sqrt(low * high)]
    above_hz = np.linspace(high, 0.5 * code.rate_hz, 1000)
    passed = np.abs(correction.response(above_hz)) / np.max(np.abs(inverse))
    loudest = int(np.argmax(passed))
    passing = np.flatnonzero(passed > MAX_STOPPED_GAIN)
    blocked_from_hz = above_hz[passing[-1] if len(passing) else 0]
    lines = [
        *identity(sensor),
        "",
        f"sampling rate: {code.rate_hz!r} Hz; all coefficients are valid for it only",
        (
            "errors below: largest relative deviation of the complex response over the band, from "
            "the coefficients as"
        ),
        "written; rounding in operation is not included",
        "",
        (
            "model: taps, then second-order sections with the sensor's poles and zeros mapped by "
            "e^(sT)"
        ),
        (
            f"  latency {model.latency} samples ({model.latency * ms:.6g} ms), the sensor's own "
            "delay not counted"
        ),
        f"  error {_error(model.response(f), exact * model.late(f))} (double), "
        f"{_error(model.in_single_precision().response(f), exact * model.late(f))} (float)",
        (
            "  sections alone, without latency: error "
            f"{_error(model.sections.response(f), rational)}{without}"
        ),
        (
            "  sections in CMSIS-DSP order, float: error "
            f"{_error(_single_cmsis(model.sections, f), rational)}{without}"
        ),
        "cell: one step of the network by first-order hold, without latency",
        f"  error {_error(code.cell.response(f), rational)}{without}",
        "correction: from the response back to the input, with the latency stated here",
        f"  latency {correction.latency} samples ({correction.latency * ms:.6g} ms)",
        (
            f"  error {_error(correction.response(f), inverse)} (double), "
            f"{_error(correction.in_single_precision().response(f), inverse)} (float), "
            f"over {low:.10g} Hz to {high:.10g} Hz"
        ),
    ]
    if len(upper_hz):
        late = correction.late(upper_hz) / sensor.response(upper_hz)
        lines.append(
            f"  error from {upper_hz[0]:.4g} Hz on: {_error(correction.response(upper_hz), late)}"
        )
    if np.any(poles_zeros(sensor).zeros == 0):
        lines.append(
            f"  below the band a high-pass at {HIGH_PASS_OVER_BAND * low:.4g} Hz replaces the "
            "integrator and settles slowly"
        )
    lines += [
        (
            f"  above the band it passes up to {passed[loudest]:.2g} of its largest gain in it (at "
            f"{above_hz[loudest]:.4g} Hz), and less than {MAX_STOPPED_GAIN:g} from "
            f"{blocked_from_hz:.4g} Hz on"
        ),
        (
            f"  largest pole {correction.sections.largest_pole:.9f}: stable; white noise of 1 "
            f"{sensor.output_unit} becomes {correction.noise_gain:.3g} {sensor.input_unit}"
        ),
        *_NOTES,
    ]
    return lines


def _error(values: np.ndarray, exact: np.ndarray) -> str:
    return f"{float(np.max(np.abs(values / exact - 1.0))):.2e}"


def _single_cmsis(sections: SecondOrderSections, f: FloatArray) -> np.ndarray:
    """Return the response of the sections in z with coefficients as a float holds them."""
    z = np.exp(-2j * np.pi * f * sections.interval_s)
    value = np.ones(z.shape, complex)
    for b0, b1, b2, a1, a2 in sections.cmsis().astype(np.float32).astype(float):
        value = value * (b0 + b1 * z + b2 * z * z) / (1.0 - a1 * z - a2 * z * z)
    return value


def _common_values(code: Firmware, name: str, about: str) -> dict[str, str]:
    filters = {"MODEL": code.model, "CORRECTION": code.correction}
    common = {
        "N": name,
        "GUARD": name.upper(),
        "ABOUT": about,
        "RATE": repr(code.rate_hz),
        "SECTIONS": str(max(len(f.sections.rows) for f in filters.values())),
        "LINE": str(max(f.taps.lead + len(f.taps.taps) for f in filters.values())),
        "STATES": str(len(code.cell.now)),
        "INPUT": c_comment(code.sensor.input_unit),
        "OUTPUT": c_comment(code.sensor.output_unit),
    }
    for kind, f in filters.items():
        common |= {
            f"{kind}_LATENCY": str(f.latency),
            f"{kind}_SECTIONS": str(len(f.sections.rows)),
        }
        common |= {f"{kind}_TAPS": str(len(f.taps.taps)), f"{kind}_LEAD": str(f.taps.lead)}
    return common


def _coefficients(code: Firmware, single: bool) -> dict[str, str]:
    """Return coefficients as text of one precision, and that precision's names."""

    def text(values: np.ndarray | float) -> str:
        flat = np.ravel(values)
        numerals = [_single(v) if single else repr(float(v)) for v in flat]
        wide = [", ".join(numerals[k : k + 5]) for k in range(0, len(numerals), 5)]
        return wide[0] if len(wide) == 1 else "\n    " + ",\n    ".join(wide)

    cell = code.cell
    numbers = {
        "T": "float" if single else "double",
        "S": "_f32" if single else "",
        "ARM": "f32" if single else "f64",
        "PRECISION": "single precision" if single else "double precision",
        "GROWTH": ",\n    ".join("{" + text(row) + "}" for row in cell.growth),
        "BEFORE": text(cell.before),
        "NOW": text(cell.now),
        "OUTPUTS": text(cell.output),
        "DIRECT": text(cell.feedthrough),
    }
    for kind, f in (("MODEL", code.model), ("CORRECTION", code.correction)):
        numbers |= {f"{kind}_SOS": text(f.sections.cmsis()), f"{kind}_FIR": text(f.taps.taps)}
        numbers[f"{kind}_DELTA"] = text(f.sections.rows)
    return numbers


def _single(value: float) -> str:
    """Return a float literal that reads back to the nearest float."""
    text = f"{float(np.float32(value)):.9g}"
    return (text if any(c in text for c in ".e") else text + ".0") + "f"


C = Format(
    name="c",
    title="C99 for firmware",
    write=write,
    contents="model, correction, network cell, in `double` and `float`",
    cannot_hold="uncertainty (comment only)",
    options=("rate_hz", "online"),
)
