"""C99 header and source for firmware: the sensor's model, its correction filter and the network's cell.

Their errors are computed from the coefficients as written, and stated in the comment. Of the text around the numbers
``@N@`` is the name, ``@S@`` the suffix of the precision, ``@T@`` its type; the rest are numbers.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vibrident.base.escaping import c_comment
from vibrident.data.records import FloatArray
from vibrident.export.discrete import HoldCell, SecondOrderSections
from vibrident.export.filters import BELOW, Filter, checked_rate, correction_filter, model_filter
from vibrident.export.form import Format, Options
from vibrident.export.poles_zeros import poles_zeros
from vibrident.export.sensor import ExportedSensor, identity

HEADER = """/*
@ABOUT@
 */
#ifndef @GUARD@_H
#define @GUARD@_H

#ifdef __cplusplus
extern "C" {
#endif

/* Samples per second that all coefficients belong to. */
#define @GUARD@_RATE_HZ @RATE@
/* Samples by which the outputs are late. */
#define @GUARD@_MODEL_LATENCY @MODEL_LATENCY@
#define @GUARD@_CORRECTION_LATENCY @CORRECTION_LATENCY@
/* Second-order sections, taps before them, samples kept. */
#define @GUARD@_MODEL_SECTIONS @MODEL_SECTIONS@
#define @GUARD@_MODEL_TAPS @MODEL_TAPS@
#define @GUARD@_CORRECTION_SECTIONS @CORRECTION_SECTIONS@
#define @GUARD@_CORRECTION_TAPS @CORRECTION_TAPS@
#define @GUARD@_SECTIONS @SECTIONS@
#define @GUARD@_LINE @LINE@
/* States of the cell. */
#define @GUARD@_STATES @STATES@
@BODY@
#ifdef __cplusplus
}
#endif

#endif
"""

DECLARATIONS = """
/* ---- @PRECISION@ ---- */

/* A filter: y = sections(taps(x)). Rows of sections: b0 b1 b2 a1 a2 of
 * (b0 d^2 + b1 d + b2)/(d^2 + a1 d + a2), d = z - 1. */
typedef struct {
    int lead, taps, sections;
    const @T@ *tap;
    const @T@ *section;
} @N@_coefficients@S@;

typedef struct {
    const @N@_coefficients@S@ *coefficients;
    int next;
    @T@ line[@GUARD@_LINE];
    @T@ state[2 * @GUARD@_SECTIONS];
} @N@_filter@S@;

/* The network's cell by first-order hold. */
typedef struct {
    @T@ before;
    @T@ x[@GUARD@_STATES];
} @N@_cell@S@;

extern const @N@_coefficients@S@ @N@_model@S@, @N@_correction@S@;
/* CMSIS-DSP order, {b0, b1, b2, -a1, -a2} a section in z: for arm_biquad_cascade_df2T_@ARM@ and _df1_@ARM@.
 * The taps come before them, first tap first (arm_fir_@ARM@ wants them reversed), after the lead of whole samples. */
extern const @T@ @N@_model_sos@S@[5 * @GUARD@_MODEL_SECTIONS];
extern const @T@ @N@_model_fir@S@[@GUARD@_MODEL_TAPS];
extern const @T@ @N@_correction_sos@S@[5 * @GUARD@_CORRECTION_SECTIONS];
extern const @T@ @N@_correction_fir@S@[@GUARD@_CORRECTION_TAPS];

/* Start a filter at rest: @N@_filter_init@S@(&f, &@N@_model@S@) or (&f, &@N@_correction@S@). */
void @N@_filter_init@S@(@N@_filter@S@ *filter, const @N@_coefficients@S@ *coefficients);
/* One sample: @INPUT@ in, @OUTPUT@ out (model); the other way round (correction). */
@T@ @N@_filter_step@S@(@N@_filter@S@ *filter, @T@ sample);

/* Start the cell at rest. */
void @N@_cell_init@S@(@N@_cell@S@ *cell);
/* One sample through the cell, without latency: @INPUT@ in, @OUTPUT@ out. */
@T@ @N@_cell_step@S@(@N@_cell@S@ *cell, @T@ sample);
"""

SOURCE = """/*
@ABOUT@
 */
#include "@N@.h"
@BODY@"""

DEFINITIONS = """
/* ---- @PRECISION@ ---- */

const @T@ @N@_model_sos@S@[] = {@MODEL_SOS@};
const @T@ @N@_model_fir@S@[] = {@MODEL_FIR@};
const @T@ @N@_correction_sos@S@[] = {@CORRECTION_SOS@};
const @T@ @N@_correction_fir@S@[] = {@CORRECTION_FIR@};

static const @T@ model_section@S@[] = {@MODEL_DELTA@};
static const @T@ correction_section@S@[] = {@CORRECTION_DELTA@};

const @N@_coefficients@S@ @N@_model@S@ = {
    @MODEL_LEAD@, @GUARD@_MODEL_TAPS, @GUARD@_MODEL_SECTIONS, @N@_model_fir@S@, model_section@S@};
const @N@_coefficients@S@ @N@_correction@S@ = {
    @CORRECTION_LEAD@, @GUARD@_CORRECTION_TAPS, @GUARD@_CORRECTION_SECTIONS, @N@_correction_fir@S@,
    correction_section@S@};

/* The cell: x += growth x + before a[k-1] + now a[k];  y = output x + direct a[k].
 * growth = W3 - 1, (before, now) = W1, output = W2, (0, direct) = W4. */
static const @T@ growth@S@[@GUARD@_STATES][@GUARD@_STATES] = {
    @GROWTH@};
static const @T@ before@S@[@GUARD@_STATES] = {@BEFORE@};
static const @T@ now@S@[@GUARD@_STATES] = {@NOW@};
static const @T@ output@S@[@GUARD@_STATES] = {@OUTPUTS@};
static const @T@ direct@S@ = @DIRECT@;

void @N@_filter_init@S@(@N@_filter@S@ *filter, const @N@_coefficients@S@ *coefficients)
{
    int i;
    filter->coefficients = coefficients;
    filter->next = 0;
    for (i = 0; i < @GUARD@_LINE; i++)
        filter->line[i] = 0;
    for (i = 0; i < 2 * @GUARD@_SECTIONS; i++)
        filter->state[i] = 0;
}

@T@ @N@_filter_step@S@(@N@_filter@S@ *filter, @T@ sample)
{
    const @N@_coefficients@S@ *c = filter->coefficients;
    @T@ value = 0;
    int i, at = filter->next - c->lead;
    filter->line[filter->next] = sample;
    filter->next = filter->next + 1 < @GUARD@_LINE ? filter->next + 1 : 0;
    if (at < 0)
        at += @GUARD@_LINE;
    for (i = 0; i < c->taps; i++) {
        value += c->tap[i] * filter->line[at];
        at = at > 0 ? at - 1 : @GUARD@_LINE - 1;
    }
    for (i = 0; i < c->sections; i++) {
        const @T@ *k = c->section + 5 * i;
        @T@ *s = filter->state + 2 * i;
        @T@ in = value;
        value = k[0] * in + s[0];
        s[0] += k[1] * in - k[3] * value + s[1];
        s[1] += k[2] * in - k[4] * value;
    }
    return value;
}

void @N@_cell_init@S@(@N@_cell@S@ *cell)
{
    int i;
    cell->before = 0;
    for (i = 0; i < @GUARD@_STATES; i++)
        cell->x[i] = 0;
}

@T@ @N@_cell_step@S@(@N@_cell@S@ *cell, @T@ sample)
{
    @T@ step[@GUARD@_STATES];
    @T@ value = direct@S@ * sample;
    int i, j;
    for (i = 0; i < @GUARD@_STATES; i++) {
        step[i] = before@S@[i] * cell->before + now@S@[i] * sample;
        for (j = 0; j < @GUARD@_STATES; j++)
            step[i] += growth@S@[i][j] * cell->x[j];
    }
    for (i = 0; i < @GUARD@_STATES; i++) {
        cell->x[i] += step[i];
        value += output@S@[i] * cell->x[i];
    }
    cell->before = sample;
    return value;
}
"""


#: Gain that counts as stopped, relative to the largest gain in the band.
PASSED = 0.1


@dataclass(frozen=True, eq=False)
class Firmware:
    """The content of the C code."""

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
    made = firmware(sensor, options.rate_hz)
    about = "\n".join(f" * {c_comment(line)}".rstrip() for line in description(made))
    common = _common(made, options.name, about)
    paths = []
    for ending, frame, part in (("h", HEADER, DECLARATIONS), ("c", SOURCE, DEFINITIONS)):
        body = "".join(_filled(part, {**common, **_numbers(made, single)}) for single in (False, True))
        path = folder / f"{options.name}.{ending}"
        path.write_text(_filled(frame, {**common, "BODY": body}), encoding="utf-8")
        paths.append(path)
    return paths


def description(made: Firmware) -> list[str]:
    """Identity, and each part with its errors, one line each."""
    sensor, model, correction = made.sensor, made.model, made.correction
    f = sensor.band
    wanted = sensor.response(f)
    rational = np.asarray(poles_zeros(sensor).response(f))
    apart = sensor.apart
    plain = f" (without {' and '.join(apart)}, which it does not hold)" if apart else ""
    low, high = sensor.band_hz
    ms = 1e3 / made.rate_hz
    back = correction.late(f) / wanted
    upper = f[f >= np.sqrt(low * high)]
    above = np.linspace(high, 0.5 * made.rate_hz, 1000)
    passed = np.abs(correction.response(above)) / np.max(np.abs(back))
    top, loud = int(np.argmax(passed)), np.flatnonzero(passed > PASSED)
    lines = [
        *identity(sensor),
        "",
        f"sampling rate: {made.rate_hz!r} Hz; all coefficients are valid for it only",
        "errors below: largest relative deviation of the complex response over the band, from the coefficients as",
        "written; rounding in operation is not included",
        "",
        "model: taps, then second-order sections with the sensor's poles and zeros mapped by e^(sT)",
        f"  latency {model.latency} samples ({model.latency * ms:.6g} ms), the sensor's own delay not counted",
        f"  error {_error(model.response(f), wanted * model.late(f))} (double), "
        f"{_error(model.in_single_precision(f), wanted * model.late(f))} (float)",
        f"  sections alone, without latency: error {_error(model.sections.response(f), rational)}{plain}",
        f"  sections in CMSIS-DSP order, float: error {_error(_single_cmsis(model.sections, f), rational)}{plain}",
        "cell: one step of the network by first-order hold, without latency",
        f"  error {_error(made.cell.response(f), rational)}{plain}",
        "correction: from the response back to the input, with the latency stated here",
        f"  latency {correction.latency} samples ({correction.latency * ms:.6g} ms)",
        f"  error {_error(correction.response(f), back)} (double), "
        f"{_error(correction.in_single_precision(f), back)} (float), over {low!r} Hz to {high!r} Hz",
    ]
    if len(upper):
        late = correction.late(upper) / sensor.response(upper)
        lines.append(f"  error from {upper[0]:.4g} Hz on: {_error(correction.response(upper), late)}")
    if np.any(poles_zeros(sensor).zeros == 0):
        lines.append(f"  below the band a high-pass at {BELOW * low:.4g} Hz replaces the integrator and settles slowly")
    lines += [
        f"  above the band it passes up to {passed[top]:.2g} of its largest gain in it (at {above[top]:.4g} Hz), "
        f"and less than {PASSED:g} from {above[loud[-1] if len(loud) else 0]:.4g} Hz on",
        f"  largest pole {correction.sections.largest_pole:.9f}: stable; white noise of 1 {sensor.output_unit} becomes "
        f"{correction.noise_gain:.3g} {sensor.input_unit}",
        "",
        "the code holds no uncertainties: those of the parameters are above, those of a corrected signal do not",
        "follow from them alone; see `vibrident correct`.",
        "Do not compile with -ffast-math or -funsafe-math-optimizations.",
    ]
    return lines


def _error(found: np.ndarray, wanted: np.ndarray) -> str:
    return f"{float(np.max(np.abs(found / wanted - 1.0))):.2e}"


def _single_cmsis(sections: SecondOrderSections, f: FloatArray) -> np.ndarray:
    """Response of the sections in z with coefficients as a float holds them."""
    z = np.exp(-2j * np.pi * f * sections.interval_s)
    value = np.ones(z.shape, complex)
    for b0, b1, b2, a1, a2 in sections.cmsis().astype(np.float32).astype(float):
        value = value * (b0 + b1 * z + b2 * z * z) / (1.0 - a1 * z - a2 * z * z)
    return value


def _common(made: Firmware, name: str, about: str) -> dict[str, str]:
    filters = {"MODEL": made.model, "CORRECTION": made.correction}
    common = {
        "N": name,
        "GUARD": name.upper(),
        "ABOUT": about,
        "RATE": repr(made.rate_hz),
        "SECTIONS": str(max(len(f.sections.rows) for f in filters.values())),
        "LINE": str(max(f.taps.lead + len(f.taps.taps) for f in filters.values())),
        "STATES": str(len(made.cell.now)),
        "INPUT": c_comment(made.sensor.input_unit),
        "OUTPUT": c_comment(made.sensor.output_unit),
    }
    for which, f in filters.items():
        common[f"{which}_LATENCY"] = str(f.latency)
        common[f"{which}_SECTIONS"] = str(len(f.sections.rows))
        common[f"{which}_TAPS"] = str(len(f.taps.taps))
        common[f"{which}_LEAD"] = str(f.taps.lead)
    return common


def _numbers(made: Firmware, single: bool) -> dict[str, str]:
    """Coefficients as text of one precision, and that precision's names."""

    def text(values: np.ndarray | float) -> str:
        flat = np.ravel(values)
        shown = [_single(v) if single else repr(float(v)) for v in flat]
        wide = [", ".join(shown[k : k + 5]) for k in range(0, len(shown), 5)]
        return wide[0] if len(wide) == 1 else "\n    " + ",\n    ".join(wide)

    cell = made.cell
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
    for which, f in (("MODEL", made.model), ("CORRECTION", made.correction)):
        numbers |= {f"{which}_SOS": text(f.sections.cmsis()), f"{which}_FIR": text(f.taps.taps)}
        numbers[f"{which}_DELTA"] = text(f.sections.rows)
    return numbers


def _single(value: float) -> str:
    """A float literal that reads back to the nearest float."""
    text = f"{float(np.float32(value)):.9g}"
    return (text if any(c in text for c in ".e") else text + ".0") + "f"


def _filled(template: str, values: Mapping[str, str]) -> str:
    """In one pass, so that inserted text is not a template."""
    return re.sub("@(\\w+)@", lambda place: values[place[1]], template)


C = Format(
    name="c",
    title="C99 for firmware",
    write=write,
    holds="model, correction, network cell, in `double` and `float`",
    cannot_hold="uncertainty (comment only)",
    options=("rate_hz", "online"),
)
