"""Sensitivity matrix of a sensor with several outputs, from sine records along its axes.

At each frequency V = S A: the outputs' amplitudes V, shape (outputs, records), are the matrix S,
shape (outputs, axes), times the motion A. With one reference each record has motion along one axis;
with several, A holds all of them, and the records must differ enough to tell the axes apart. S is
estimated by weighted least squares, a row an output.

The uncertainty of an element is that of the noise of both channels (from spectral lines beside the
tone), of the stated systematic effects, and, with one reference, of the exciter's motion across the
axis, which is not measured: it adds ``transverse_motion`` times |S_ii| to each part of the elements
off the diagonal (ISO 16063-31:2009, 6).

The main sensitivity of output i is S_ii. Its transverse sensitivity is the largest over directions
in the plane across the axis, √(S_ij² + S_ik²), and its misalignment the angle between the axis and
the direction of largest sensitivity, with components S_ij/S_ii, in rad, of the parts in phase with
S_ii.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vibrident.base.errors import InputError
from vibrident.base.fields import Fields, GivenFields
from vibrident.base.tails import student_quantile
from vibrident.data.io.axes_file import AxesCalibration, read_axes
from vibrident.data.known import KnownResponse
from vibrident.data.records import Calibration, FloatArray
from vibrident.fit.response import MeasuredResponse
from vibrident.fit.response.sine_fit import tone_frequency
from vibrident.fit.response.tones import measure_tones
from vibrident.fit.uncertainty.budget import effects_of, pattern
from vibrident.physics.models.slopes import ComplexArray
from vibrident.result.document import plain

SCHEMA = "vibrident.matrix/1"
MAX_FREQUENCY_DISTANCE = 1e-3  # of records at one frequency, relative
MAX_CONDITION = 1e3  # condition number of the scaled motion that tells the axes apart
USABLE_KINDS = ("gain", "timing", "phase", "mounting")  # of effects, those that need no model
SMALLEST = 1e-300  # stands for zero in a denominator


@dataclass(frozen=True, eq=False)
class Matrix:
    """Complex sensitivity matrix over frequency, per m/s² (or the reference's unit)."""

    outputs: tuple[str, ...]  # axis of each output
    axes: tuple[str, ...]  # axes of motion
    frequency_hz: FloatArray  # shape (n,)
    # complex, shape (n, outputs, axes); NaN where no record moved along that axis
    values: ComplexArray
    # standard uncertainties of real and imaginary part, shape (n, outputs, axes, 2)
    u: FloatArray
    degrees_of_freedom: FloatArray  # behind ``u``, shape (n, outputs, axes)
    unit: str  # of the sensitivities
    settings: GivenFields  # effects, transverse motion, sensor and names of the records

    def interval_95(self) -> tuple[FloatArray, FloatArray]:
        """Return the limits of the 95 % intervals of the parts, each of the shape of ``u``."""
        components = np.stack([self.values.real, self.values.imag], axis=-1)
        k = np.vectorize(lambda freedom: student_quantile(min(float(freedom), 1e9), 0.975))(
            self.degrees_of_freedom
        )
        return components - k[..., None] * self.u, components + k[..., None] * self.u

    def main(self) -> list[Fields]:
        """Return main and transverse sensitivity and misalignment of each output by frequency."""
        outputs = []
        for i, name in enumerate(self.outputs):
            if name not in self.axes:
                continue
            axis = self.axes.index(name)
            across = [j for j in range(len(self.axes)) if j != axis]
            main = self.values[:, i, axis]
            with np.errstate(invalid="ignore"):  # not known over not known
                ratio = self.values[:, i, across] / main[:, None]
            u = (
                np.hypot(*np.moveaxis(self.u[:, i, across], -1, 0))
                / np.sqrt(2.0)
                / np.abs(main)[:, None]
            )
            in_phase = np.real(ratio)
            size, angle = (
                np.sqrt(np.sum(parts**2, axis=1)) if across else np.full(len(main), np.nan)
                for parts in (np.abs(ratio), in_phase)
            )
            rows = {
                "output": name,
                "magnitude": np.abs(main),
                "magnitude_uncertainty": self.u[:, i, axis, 0],
                "phase_deg": np.rad2deg(np.angle(main)),
                "phase_deg_uncertainty": np.rad2deg(self.u[:, i, axis, 1] / np.abs(main)),
                "transverse_percent": 100.0 * size,
                "transverse_uncertainty_percent": 100.0 * _u_of_size(np.abs(ratio), u),
                "misalignment_deg": np.rad2deg(np.arctan(angle)),
                "misalignment_uncertainty_deg": np.rad2deg(_u_of_size(np.abs(in_phase), u)),
                "components_rad": {self.axes[j]: in_phase[:, n] for n, j in enumerate(across)},
                "components_uncertainty_rad": {self.axes[j]: u[:, n] for n, j in enumerate(across)},
            }
            outputs.append(plain(rows))
        return outputs

    def to_dict(self) -> Fields:
        """Return the document of schema ``vibrident.matrix/1``; null for what is not known."""
        return {
            "schema": SCHEMA,
            "outputs": list(self.outputs),
            "axes": list(self.axes),
            "unit": self.unit,
            "frequency_hz": plain(self.frequency_hz),
            "real": plain(self.values.real),
            "imaginary": plain(self.values.imag),
            "u_real": plain(self.u[..., 0]),
            "u_imaginary": plain(self.u[..., 1]),
            "degrees_of_freedom": plain(self.degrees_of_freedom),
            "main": self.main(),
            "settings": dict(self.settings),
        }

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the document as JSON."""
        target = Path(path)
        target.write_text(
            json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n", encoding="utf-8"
        )
        return target


def sensitivity_matrix(calibration: AxesCalibration | str | os.PathLike[str]) -> Matrix:
    """Return the sensitivity matrix of a calibration of several axes.

    Raises:
        InputError: the file cannot be used, or at a frequency the records do not tell the axes of
            motion apart.

    Examples:
        >>> from pathlib import Path
        >>> import numpy as np
        >>> import vibrident
        >>> motion = np.sin(2 * np.pi * 160.0 * np.arange(4096) / 8192.0)
        >>> noise = 1e-5 * np.random.default_rng(1).standard_normal((2, 2, 4096))
        >>> for axis, row, error in zip("xy", ((0.1, 0.001), (0.002, 0.11)), noise):
        ...     columns = [motion, *(gain * motion + each for gain, each in zip(row, error))]
        ...     np.savetxt(f"{axis}.csv", np.transpose(columns), delimiter=",", header="a,vx,vy")
        >>> text = '''[reference]
        ... column = "a"
        ... [sampling]
        ... rate_hz = 8192.0
        ... [[response]]
        ... column = "vx"
        ... axis = "x"
        ... [[response]]
        ... column = "vy"
        ... axis = "y"
        ... [[records]]
        ... file = "x.csv"
        ... excitation = "sine"
        ... axis = "x"
        ... [[records]]
        ... file = "y.csv"
        ... excitation = "sine"
        ... axis = "y"
        ... '''
        >>> characters = Path("axes.toml").write_text(text)
        >>> matrix = vibrident.sensitivity_matrix("axes.toml")
        >>> matrix.values[0].real.round(3).tolist()
        [[0.1, 0.002], [0.001, 0.11]]
    """
    if not isinstance(calibration, AxesCalibration):
        calibration = read_axes(calibration)
    outputs = calibration.outputs
    first = next(iter(outputs.values()))
    tones_hz = [tone_frequency(record) for record in first.records]
    moved = calibration.motions or [record.circumstances.axis for record in first.records]
    # An axis that has an output and was not moved is unknown, and not zero.
    axes = tuple(dict.fromkeys([*moved, *outputs]))
    motion = _measure_motion(calibration, first, tones_hz, axes)
    groups = _group_by_frequency(tones_hz)
    shape = len(groups), len(outputs), len(axes)
    values = np.full(shape, np.nan, complex)
    u = np.full((*shape, 2), np.nan)
    freedom = np.full(shape, np.inf)
    for i, output in enumerate(outputs.values()):
        tones = _without_known_responses(
            measure_tones(output.records, tones_hz),
            first.reference_known_response,
            output.response_known_response,
            first.source,
        )
        for n, group in enumerate(groups):
            values[n, i], u[n, i], freedom[n, i] = _estimate_row(
                tones, motion[group], group, first.source
            )
    frequency = np.array([sum(tones_hz[k] for k in group) / len(group) for group in groups])
    u, freedom = _add_effects(calibration, axes, frequency, values, u, freedom)
    settings = {
        "sensor": dict(first.sensor),
        "transverse_motion": calibration.transverse_motion,
        "effects": _effect_settings(calibration, first),
        "records": [record.name for record in first.records],
    }
    unit = f"{first.response_unit}/({first.reference_unit})"
    return Matrix(tuple(outputs), axes, frequency, values, u, freedom, unit, settings)


def _effect_settings(calibration: AxesCalibration, first: Calibration) -> list[Fields]:
    """Return the stated effects of all measuring chains, each once."""
    effects = (
        (effect.source, effect.kind, effect.standard_uncertainty)
        for output in calibration.outputs.values()
        for motion in calibration.motions.values() or (first,)
        for effect in effects_of(_chain(output, motion))
    )
    return [{"source": source, "kind": kind, "u": u} for source, kind, u in dict.fromkeys(effects)]


def _group_by_frequency(frequencies: Sequence[float]) -> list[list[int]]:
    """Return the indices of the records at each frequency, rising."""
    groups: list[list[int]] = []
    for k in np.argsort(frequencies, kind="stable").tolist():
        if groups and frequencies[k] <= frequencies[groups[-1][0]] * (1.0 + MAX_FREQUENCY_DISTANCE):
            groups[-1].append(k)
        else:
            groups.append([k])
    return groups


def _measure_motion(
    calibration: AxesCalibration, first: Calibration, tones_hz: Sequence[float], axes: Sequence[str]
) -> ComplexArray:
    """Return the motion along each axis over the first reference's, shape (records, axes)."""
    if not calibration.motions:
        moved = [record.circumstances.axis for record in first.records]
        return np.array([[float(axis == name) for axis in axes] for name in moved], dtype=complex)
    columns = []
    for motion in calibration.motions.values():
        pairs = zip(first.records, motion.records, strict=True)
        records = [replace(record, response=along.reference) for record, along in pairs]
        tones = _without_known_responses(
            measure_tones(records, tones_hz),
            first.reference_known_response,
            motion.reference_known_response,
            first.source,
        )
        columns.append(tones.response / tones.reference)
    without_motion = [np.zeros_like(columns[0])] * (len(axes) - len(columns))
    return np.stack([*columns, *without_motion], axis=1)


def _without_known_responses(
    tones: MeasuredResponse,
    reference: KnownResponse | None,
    response: KnownResponse | None,
    where: str,
) -> MeasuredResponse:
    """Divide the tones of both channels by the known responses of these channels.

    Raises:
        InputError: a tone lies outside the band in which a response is known.
    """
    for name, known in (("reference", reference), ("response", response)):
        if known is None:
            continue
        low, high = known.band_hz
        outside = (tones.frequency_hz < low) | (tones.frequency_hz > high)
        if outside.any():
            raise InputError(
                "A record's frequency is outside the band of a known response.",
                expected=f"{low:g} to {high:g} Hz, as {known.source} states",
                found=f"{tones.frequency_hz[outside][0]:.6g} Hz",
                where=where or "calibration in memory",
                remedy="leave that record out, or state the response further",
            )
        at_tones = known.value(tones.frequency_hz)
        divided = {name: getattr(tones, name) / at_tones}
        lines_name = f"line_{name}"
        divided[lines_name] = getattr(tones, lines_name) / known.value(tones.line_hz)
        if tones.rounding is not None:
            rounding = np.array(tones.rounding)
            rounding[:, int(name == "response")] /= np.abs(at_tones) ** 2
            divided["rounding"] = rounding
        tones = replace(tones, **divided)
    return tones


def _chain(output: Calibration, motion: Calibration) -> Calibration:
    """Return an output's calibration with what the one of its motion states of the reference."""
    return replace(
        output,
        reference_known_response=motion.reference_known_response,
        reference_standard_uncertainty=motion.reference_standard_uncertainty,
    )


def _estimate_row(
    tones: MeasuredResponse, motion: ComplexArray, group: Sequence[int], where: str
) -> tuple[ComplexArray, FloatArray, FloatArray]:
    """Estimate a row of the matrix at one frequency by weighted least squares.

    Args:
        tones: of an output, one a record.
        motion: of the group's records, shape (records, axes).
        group: indices of the records at the frequency.
        where: source of the records, for errors.

    Returns:
        the row, shape (axes,), u of its parts, shape (axes, 2), and degrees of freedom, shape
        (axes,); row and u are NaN for axes without motion.

    Raises:
        InputError: the records do not tell the axes of motion apart.
    """
    ratio = tones.response[group] / tones.reference[group]
    moved = np.any(motion != 0, axis=0)
    a = motion[:, moved]
    scale = np.sqrt(np.sum(np.abs(a) ** 2, axis=0))
    if a.shape[0] < a.shape[1] or np.linalg.cond(a / scale) > MAX_CONDITION:
        raise InputError(
            "The records do not tell the axes of motion apart.",
            expected="at each frequency as many records as axes, moved in different directions",
            found=(
                f"{a.shape[0]} records at {tones.frequency_hz[group[0]]:.5g} Hz for {a.shape[1]} "
                "axes"
            ),
            where=where or "calibration in memory",
            remedy="add records with other directions, or leave that frequency out",
        )
    lines = tones.line_response[group] - ratio[:, None] * tones.line_reference[group]
    weight = tones.line_weight[group]
    variance = np.sum(weight * np.abs(lines) ** 2, axis=1) / np.sum(weight, axis=1)
    if tones.rounding is not None:
        variance = (
            variance + tones.rounding[group, 1] + np.abs(ratio) ** 2 * tones.rounding[group, 0]
        )
    variance = np.maximum(variance / np.abs(tones.reference[group]) ** 2, SMALLEST)
    normal = np.linalg.inv(a.conj().T @ (a / variance[:, None]))
    row = np.full(motion.shape[1], np.nan, complex)
    row[moved] = normal @ (a.conj().T @ (ratio / variance))
    u = np.full((motion.shape[1], 2), np.nan)
    u[moved] = np.sqrt(np.real(np.diag(normal)))[:, None]
    freedom = np.full(motion.shape[1], np.inf)
    freedom[moved] = float(np.min(tones.degrees_of_freedom[group]))
    return row, u, freedom


def _add_effects(
    calibration: AxesCalibration,
    axes: Sequence[str],
    frequency: FloatArray,
    values: ComplexArray,
    u: FloatArray,
    freedom: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return u and degrees of freedom with the stated effects and the transverse motion.

    The effects act on size and angle of each element.
    """
    square = u**2
    for i, (name, output) in enumerate(calibration.outputs.items()):
        for j, axis in enumerate(axes):
            chain = _chain(output, calibration.motions.get(axis, output))
            square[:, i, j] += _effects_squared(chain, frequency, values[:, i, j])
            if axis != name and name in axes:
                main = np.abs(values[:, i, list(axes).index(name)])
                square[:, i, j] += ((calibration.transverse_motion * main) ** 2)[:, None]
    total = np.mean(square, axis=-1)
    return np.sqrt(square), freedom * (total / np.maximum(u[..., 0] ** 2, SMALLEST)) ** 2


def _effects_squared(
    calibration: Calibration, frequency: FloatArray, values: ComplexArray
) -> FloatArray:
    """Return u² of the parts of an element by the stated effects of its chain, shape (n, 2).

    Raises:
        InputError: an effect needs a model.
    """
    square = np.zeros((len(frequency), 2))
    for effect in effects_of(calibration):
        if effect.kind not in USABLE_KINDS:
            raise InputError(
                "An effect cannot be used in a calibration of several axes.",
                expected="kind gain, phase, timing or mounting",
                found=effect.kind,
                where=f"{calibration.source}, [[uncertainty]] {effect.source!r}",
                remedy="leave it out, or state it as gain or phase",
            )
        size = effect.standard_uncertainty * pattern(effect, None, frequency)
        turn = values / np.maximum(np.abs(values), SMALLEST)
        radial = np.abs(values) * np.real(size)
        tangential = np.abs(values) * np.imag(size)
        square[:, 0] += (radial * turn.real) ** 2 + (tangential * turn.imag) ** 2
        square[:, 1] += (radial * turn.imag) ** 2 + (tangential * turn.real) ** 2
    return square


def _u_of_size(components: FloatArray, u: FloatArray) -> FloatArray:
    """Return u of √(Σ parts²), each part with its u, shape (n, parts).

    Where all parts are zero it is the largest u.
    """
    size = np.sqrt(np.sum(components**2, axis=1))
    linear = np.sqrt(np.sum((components * u) ** 2, axis=1)) / np.maximum(size, SMALLEST)
    return np.where(size > 0, linear, np.max(u, axis=1, initial=0.0))
