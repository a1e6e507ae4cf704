"""How far the model is from each measured point: magnitude in percent, phase in degrees."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vibrident.plots import curves, style
from vibrident.plots.style import FloatArray, K
from vibrident.result import Curve, MeasuredCurve, Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def figure(result: Result) -> Figure:
    """Draw model − measured at each excited frequency with U (k = 2), and around zero the model's own U."""
    measured = result.measured
    frequency = style.numbers(measured.frequency_hz)
    relative = fitted(style.numbers(measured.deviation_percent), frequency)
    relative_bars, phase_bars = bars_of_deviation(measured)
    phase = (fitted(style.numbers(measured.deviation_phase_deg), frequency) + 180.0) % 360.0 - 180.0
    has_phase = bool(np.isfinite(phase).any())

    with style.styled():
        picture = style.new_figure(6.7, 4.8 if has_phase else 3.2)
        upper = picture.add_subplot(2 if has_phase else 1, 1, 1)
        upper.set_ylabel("Magnitude deviation\nin %")
        own = style.numbers(result.response.magnitude_uncertainty) / style.numbers(result.response.magnitude)
        _panel(upper, result.response, frequency, relative, relative_bars, K * 100 * own, 1e-6)
        if has_phase:
            lower = picture.add_subplot(2, 1, 2, sharex=upper)
            lower.set_ylabel("Phase deviation\nin °")
            own = style.numbers(result.response.phase_deg_uncertainty)
            _panel(lower, result.response, frequency, phase, phase_bars, K * own, 1e-6)
            upper.tick_params(labelbottom=False)
            style.frequency_axis(lower, frequency)
        style.frequency_axis(upper, frequency, label=not has_phase)
        if np.isfinite(relative).any():
            upper.legend(
                loc="lower right",
                bbox_to_anchor=(1.0, 1.0),  # above the panel, where no bar ends
                frameon=False,
                ncols=3,
                markerscale=4 if len(frequency) > style.CROWD else 1,
            )
        style.head(picture, "Deviation of the model from the measurement", result)
        style.note(
            picture,
            "Deviation = model − measured, magnitude relative to measured. Expanded uncertainty U, k = 2: "
            f"{'dashed lines' if len(frequency) > style.CROWD else 'bars'} deviation, band model.",
        )
        return picture


def _panel(
    axes: Axes, model: Curve, x: FloatArray, y: FloatArray, bars: FloatArray, band: FloatArray, floor: float
) -> None:
    if not np.isfinite(y).any():
        style.empty(axes, "no measured points to compare with")
        return
    own_x = style.numbers(model.frequency_hz)
    if band.shape == own_x.shape and np.isfinite(band).any():
        order = np.argsort(own_x)
        axes.fill_between(
            own_x[order], -band[order], band[order], color=style.SKY, alpha=0.45, lw=0, label="model, U (k = 2)"
        )
    axes.axhline(0.0, color=style.BLACK, lw=0.9, zorder=4 if len(x) > style.CROWD else 2)
    curves.points(axes, x, y, bars, "deviation")
    if len(x) > style.CROWD and np.isfinite(bars).any():
        order = np.argsort(x)
        for sign, label in ((1, "measured, U (k = 2)"), (-1, None)):
            axes.plot(x[order], sign * bars[order], color=style.VERMILION, ls="--", lw=0.9, zorder=4, label=label)
    style.balanced_axis(axes, y, bars, floor)


def bars_of_deviation(measured: MeasuredCurve) -> tuple[FloatArray, FloatArray]:
    """U (k = 2) of the deviations, percent and degrees: their own where the result has it, else that of the points."""
    frequency = style.numbers(measured.frequency_hz)
    percent = fitted(style.numbers(measured.deviation_uncertainty_percent), frequency)
    degrees = fitted(style.numbers(measured.deviation_phase_uncertainty_deg), frequency)
    if not np.isfinite(percent).any():
        magnitude = style.numbers(measured.magnitude)
        percent = 100.0 * fitted(style.numbers(measured.magnitude_uncertainty), frequency) / magnitude
        degrees = fitted(style.numbers(measured.phase_deg_uncertainty), frequency)
    return K * percent, K * degrees


def fitted(values: FloatArray, like: FloatArray) -> FloatArray:
    """The values where they are one to each point, NaN otherwise."""
    return values if values.shape == like.shape else np.full(like.shape, np.nan)
