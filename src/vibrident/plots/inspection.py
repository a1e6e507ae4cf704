"""What is in a calibration before anything is identified: records in physical units, or the tabulated response."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vibrident.naming import scaled
from vibrident.plots import curves, style
from vibrident.plots.choose import PANELS, envelope, excerpt, grid, sine_frequency, spread
from vibrident.plots.sensitivity import CONVENTION
from vibrident.plots.style import FloatArray
from vibrident.plots.units import frequency_text, sensitivity_unit
from vibrident.records import Calibration, Record, ResponseTable
from vibrident.result import Curve

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.gridspec import SubplotSpec


def figure(calibration: Calibration) -> Figure:
    """Draw excerpts of at most six records with the samples that are left out, or the table with U (k = 2)."""
    with style.styled():
        if calibration.table is not None:
            picture = _table(calibration, calibration.table)
        else:
            picture = _records(calibration)
        style.title(picture, "Calibration data", calibration.model, calibration.sensor)
        return picture


def _table(calibration: Calibration, table: ResponseTable) -> Figure:
    picture = style.new_figure(6.7, 5.0 if table.phase_rad is not None else 3.6)
    points = Curve(
        frequency_hz=tuple(table.frequency_hz),
        magnitude=tuple(table.magnitude),
        phase_deg=_degrees(table.phase_rad, table.points),
        magnitude_uncertainty=_optional(table.magnitude_uncertainty, table.points),
        phase_deg_uncertainty=_degrees(table.phase_uncertainty_rad, table.points),
    )
    curves.panels(
        picture,
        None,
        points,
        unit=sensitivity_unit(calibration.response_unit, calibration.reference_unit),
        quantity=calibration.quantity,
        measured_label="table",
    )
    bars = "Bars: expanded uncertainty U, k = 2. " if table.magnitude_uncertainty is not None else ""
    style.note(picture, f"{bars}{CONVENTION if table.phase_rad is not None else ''}")
    return picture


def _optional(values: FloatArray | None, points: int) -> tuple[float | None, ...]:
    return (None,) * points if values is None else tuple(values.tolist())


def _degrees(values: FloatArray | None, points: int) -> tuple[float | None, ...]:
    return _optional(None if values is None else np.rad2deg(values), points)


def _records(calibration: Calibration) -> Figure:
    records = sorted(calibration.records, key=lambda record: sine_frequency(record) or 0.0)
    faulty = [record for record in records if not record.mask.all()]
    sound = [record for record in records if record.mask.all()]
    keep = [faulty[i] for i in spread(len(faulty), 3 if sound else PANELS)]  # what needs a look comes first
    keep += [sound[i] for i in spread(len(sound), PANELS - len(keep))]
    chosen = sorted(keep, key=records.index)

    rows, columns = grid(len(chosen))
    picture = style.new_figure(6.7 if columns < 3 else 9.0, 1.0 + 2.6 * rows)
    cells = picture.add_gridspec(rows, columns)
    for i, record in enumerate(chosen):
        _panel(picture, cells[divmod(i, columns)], record, calibration, named=i % columns == 0)
    shown = f"{len(chosen)} of {len(records)} records shown. " if len(chosen) < len(records) else ""
    left_out = f"× left out of every fit ({len(faulty)} records affected)." if faulty else ""
    style.note(
        picture,
        f"{shown}Upper panel: reference ({calibration.quantity}); lower panel: response. "
        f"Sines, shocks and decays: an excerpt. {left_out}",
    )
    return picture


def _panel(picture: Figure, cell: SubplotSpec, record: Record, calibration: Calibration, *, named: bool) -> None:
    rows = 1 if record.reference is None else 2
    grid = cell.subgridspec(rows, 1, hspace=0.0)
    lower = picture.add_subplot(grid[rows - 1])
    part = excerpt(record)
    time = record.time_s[part] + record.start_time_s
    scale = scaled("s", float(np.abs(time).max()))
    top = lower
    if record.reference is not None:
        top = picture.add_subplot(grid[0], sharex=lower)
        top.tick_params(labelbottom=False)
        unit = _line(top, time * scale.factor, record.reference[part], record.mask[part], calibration.reference_unit, 0)
        top.set_ylabel(f"Reference\nin {unit}" if named else f"in {unit}")
    unit = _line(lower, time * scale.factor, record.response[part], record.mask[part], calibration.response_unit, 1)
    lower.set_ylabel(f"Response\nin {unit}" if named or record.reference is None else f"in {unit}")
    lower.set_xlabel(f"Time in {scale.unit}")
    name = style.shortened(record.name, 24)
    kind = frequency_text(record.frequency_hz) if record.frequency_hz else record.excitation
    rate = scaled("Hz", record.sampling_rate_hz)
    length = scaled("s", record.duration_s)
    heading = " · ".join(dict.fromkeys((kind, name)))
    size = f"{record.samples} samples, {record.sampling_rate_hz * rate.factor:.6g} {rate.unit}, "
    top.set_title(f"{heading}\n{size}{record.duration_s * length.factor:.3g} {length.unit}", fontsize=8)


def _line(axes: Axes, time: FloatArray, values: FloatArray, mask: np.ndarray, unit: str, kind: int) -> str:
    scale = scaled(unit, float(np.abs(values).max()))
    color = style.LINES[kind][0]
    axes.plot(*envelope(time, values * scale.factor), color=color, ls="-", lw=1.0)
    bad = ~mask
    if bad.any():
        axes.plot(
            time[bad],
            values[bad] * scale.factor,
            linestyle="none",
            marker="x",
            markersize=2.6,
            markeredgewidth=0.6,
            color=style.BLACK,
            zorder=3,
            rasterized=bool(bad.sum() > 500),
        )
    axes.locator_params(axis="y", nbins=4)
    return style.printable(scale.unit)
