"""The sensitivity curve of a planned calibration, its uncertainty over frequency, and the frequencies chosen."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vibrident.plots import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from vibrident.planning import Plan


def figure(planned: Plan) -> Figure:
    """Draw curve and uncertainty of a plan."""
    curve = planned.response
    frequency, magnitude = np.array(curve.frequency_hz), np.array(curve.magnitude)
    u = 100.0 * style.K * style.numbers(curve.magnitude_uncertainty) / magnitude
    u_phase = style.K * style.numbers(curve.phase_deg_uncertainty)
    at = np.exp(np.interp(np.log(planned.frequency_hz), np.log(frequency), np.log(magnitude)))
    with style.styled():
        picture = style.new_figure(6.7, 5.4)
        rows = picture.add_gridspec(2, 1, height_ratios=(1.4, 1))
        upper = picture.add_subplot(rows[0])
        lower = picture.add_subplot(rows[1], sharex=upper)
        upper.plot(frequency, magnitude / magnitude[0], color=style.BLACK, lw=1.2, label="sensitivity")
        others = np.setdiff1d(planned.candidates_hz, planned.frequency_hz)
        if others.size:
            level = np.exp(np.interp(np.log(others), np.log(frequency), np.log(magnitude))) / magnitude[0]
            upper.plot(others, level, ls="", marker="o", ms=3, mfc="white", color=style.GREY, label="not chosen")
        chosen = "chosen" if planned.criterion is not None else "planned"
        upper.plot(
            planned.frequency_hz, at / magnitude[0], ls="", marker="o", ms=6, color=style.VERMILION, label=chosen
        )
        for f, y, times in zip(planned.frequency_hz, at / magnitude[0], planned.uses, strict=True):
            if times > 1:
                upper.annotate(f"×{times}", (f, y), xytext=(6, 4), textcoords="offset points", fontsize=8)
        lower.plot(frequency, u, color=style.BLUE, label="magnitude, %")
        lower.plot(frequency, u_phase, color=style.GREEN, ls="--", label="phase, °")
        style.size_axis(upper, magnitude / magnitude[0])
        style.size_axis(lower, np.concatenate([u, u_phase]))
        style.frequency_axis(upper, frequency, label=False)
        style.frequency_axis(lower, frequency)
        upper.tick_params(labelbottom=False)
        upper.set_ylabel("Sensitivity over that\nat the lowest frequency")
        lower.set_ylabel("Uncertainty of the\ncurve, k = 2")
        upper.legend(loc="best")
        lower.legend(loc="best")
        style.title(picture, "Planned calibration", planned.model, {})
        if planned.efficiency is not None:
            style.note(
                picture,
                f"{planned.criterion}-optimal choice of {sum(planned.uses)} out of {planned.candidates_hz.size} "
                f"frequencies; efficiency {100 * planned.efficiency:.0f} %.",
            )
        return picture
