"""Lissajous figures of an interferometer's signals with their ellipses, and the displacement made of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vibrident.naming import scaled
from vibrident.plots import style
from vibrident.plots.choose import spread
from vibrident.records import Calibration, Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Most records shown, and points of an ellipse.
PANELS, ROUND = 4, 361


def figure(calibration: Calibration) -> Figure:
    """Draw the signals of at most four records over each other, with the ellipse, and a piece of the displacement."""
    records = [record for record in calibration.records if record.optical is not None]
    doubtful = [record for record in records if record.optical is not None and record.optical.findings]
    sound = [record for record in records if record not in doubtful]
    keep = [doubtful[i] for i in spread(len(doubtful), PANELS // 2 if sound else PANELS)]
    keep += [sound[i] for i in spread(len(sound), PANELS - len(keep))]
    chosen = sorted(keep, key=records.index)
    with style.styled():
        picture = style.new_figure(6.7, 1.0 + 2.2 * len(chosen))
        cells = picture.add_gridspec(len(chosen), 2, width_ratios=(1.0, 1.6))
        for row, record in enumerate(chosen):
            _lissajous(picture.add_subplot(cells[row, 0]), record)
            _displacement(picture.add_subplot(cells[row, 1]), record)
        style.title(picture, "Interferometer", calibration.model, calibration.sensor)
        shown = f"{len(chosen)} of {len(records)} records shown. " if len(chosen) < len(records) else ""
        style.note(picture, f"{shown}Left: the two signals over each other and the ellipse. Right: the displacement.")
        return picture


def _lissajous(axes: Axes, record: Record) -> None:
    optical = record.optical
    assert optical is not None
    first, second = optical.points
    axes.plot(first, second, ".", markersize=1.2, color=style.BLUE, rasterized=True)
    angle = np.linspace(0.0, 2.0 * np.pi, ROUND)
    around = optical.ellipse.centre[:, None] + optical.ellipse.matrix @ np.stack([np.cos(angle), np.sin(angle)])
    axes.plot(around[0], around[1], "-", linewidth=0.8, color=style.VERMILION)
    axes.set_aspect("equal", "datalim")
    axes.set_title(f"{style.shortened(record.name, 24)}\n{optical.fringes:.4g} fringes", fontsize=8)


def _displacement(axes: Axes, record: Record) -> None:
    optical = record.optical
    assert optical is not None
    time = scaled("s", float(np.max(np.abs(optical.excerpt_s), initial=0.0)))
    size = scaled("m", float(np.max(np.abs(optical.excerpt_m), initial=0.0)))
    axes.plot(optical.excerpt_s * time.factor, optical.excerpt_m * size.factor, "-", linewidth=0.8, color=style.BLUE)
    axes.set_xlabel(f"Time in {time.unit}")
    axes.set_ylabel(f"Displacement in {style.printable(size.unit)}")
    lost = f"{optical.gaps} gaps, {100 * optical.left_out:.2g} % left out" if optical.gaps else "nothing left out"
    axes.set_title(f"{lost}; phase noise {optical.phase_noise_rad:.2g} rad", fontsize=8)
