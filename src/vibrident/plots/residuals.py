"""What the model leaves unexplained: by record or frequency, and its distribution."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from vibrident.plots import style
from vibrident.plots.choose import record_frequencies
from vibrident.plots.deviation import bars_of_deviation, fitted
from vibrident.plots.style import FloatArray
from vibrident.result import Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def figure(result: Result) -> Figure:
    """Draw the residual of each record (of each point for a table), and how residuals are distributed."""
    with style.styled():
        picture = style.new_figure(7.6, 3.4)
        left, right = picture.subplots(1, 2, width_ratios=(1.5, 1))
        if result.signals:
            _by_record(left, result)
            pooled = np.concatenate([_in_own_rmse(s.measured, s.predicted) for s in result.signals])
            _distribution(right, pooled, "Residual / rmse of its record\n(dimensionless)", "residuals")
        else:
            _by_point(left, result)
            values, label = _deviations(result)
            _distribution(right, values, label, "points")
        style.head(picture, "Residuals", result)
        return picture


def _by_record(axes: Axes, result: Result) -> None:
    frequencies = record_frequencies(result)
    percent = 100 * style.numbers([signal.nrmse for signal in result.signals])
    axes.set_ylabel("Residual rms / sd of response\nin %")
    axes.set_title("by record")
    if all(signal.record in frequencies for signal in result.signals):
        x = np.array([frequencies[signal.record] for signal in result.signals])
        style.frequency_axis(axes, x)
    else:
        x = np.arange(1.0, len(percent) + 1)
        axes.set_xlim(0.4, len(percent) + 0.6)
        if len(percent) <= 8:
            few = len(percent) <= 3
            names = [style.shortened(signal.record, 18 if few else 14) for signal in result.signals]
            turned = {} if few else {"rotation": 30, "ha": "right", "rotation_mode": "anchor"}
            axes.set_xticks(x, names, **turned)
            axes.set_xlabel("Record")
        else:
            axes.set_xlabel("Record (number in the result)")
            axes.locator_params(axis="x", integer=True)
    _stems(axes, x, percent)


def _by_point(axes: Axes, result: Result) -> None:
    frequency = style.numbers(result.measured.frequency_hz)
    relative = fitted(style.numbers(result.measured.deviation_percent), frequency) / 100
    phase = fitted(style.numbers(result.measured.deviation_phase_deg), frequency)
    percent = 100 * np.abs((1 + relative) * np.exp(1j * np.deg2rad(np.nan_to_num(phase))) - 1)
    axes.set_ylabel("|model / measured − 1|\nin %")
    axes.set_title("by frequency")
    style.frequency_axis(axes, frequency)
    _stems(axes, frequency, percent)


def _stems(axes: Axes, x: FloatArray, percent: FloatArray) -> None:
    if not np.isfinite(percent).any():
        style.empty(axes, "no residuals in the result")
        return
    looks = {k: v for k, v in style.marks(len(x)).items() if k not in ("elinewidth", "capsize")}
    positive = percent[np.isfinite(percent) & (percent > 0)]
    if positive.size and positive.max() > 30 * positive.min():
        style.size_axis(axes, percent)
    else:
        axes.set_ylim(0, 1.12 * float(positive.max()) if positive.size else 1.0)
    if len(x) <= 80:
        axes.vlines(x, axes.get_ylim()[0], percent, color=style.GREY, lw=0.8)
    axes.plot(x, percent, linestyle="none", color=style.VERMILION, zorder=3, **looks)


def _in_own_rmse(measured: tuple[float, ...], predicted: tuple[float, ...]) -> FloatArray:
    residual = style.numbers(measured) - style.numbers(predicted)
    residual = residual[np.isfinite(residual)]
    size = math.sqrt(float(np.mean(residual**2))) if residual.size else 0.0
    return residual / size if size > 0 else residual[:0]


def _deviations(result: Result) -> tuple[FloatArray, str]:
    measured = result.measured
    magnitude = style.numbers(measured.magnitude)
    percent = fitted(style.numbers(measured.deviation_percent), magnitude)
    relative_u = bars_of_deviation(measured)[0] / style.K
    known = np.isfinite(percent) & np.isfinite(relative_u) & (relative_u > 0)
    if known.any():
        return percent[known] / relative_u[known], "Magnitude deviation / its u\n(dimensionless)"
    return percent[np.isfinite(percent)], "Magnitude deviation\nin %"


def _distribution(axes: Axes, values: FloatArray, label: str, counted: str) -> None:
    axes.set_xlabel(label)
    axes.set_ylabel(f"Number of {counted}")
    axes.set_title("distribution")
    if values.size == 0:
        style.empty(axes, f"no {counted}")
        return
    normal = "dimensionless" in label
    reach = max(float(np.abs(values).max()), 1e-12)
    edges = np.linspace(-min(reach, 6.0), min(reach, 6.0), 41) if normal and values.size > 200 else None
    if edges is None:
        bins = min(25, max(7, math.ceil(math.sqrt(values.size))))
        centre = 0.0 if normal else float(np.median(values))
        reach = max(float(np.abs(values - centre).max()), 1e-9 * max(abs(centre), 1.0), 3.0 if normal else 0.0)
        edges = np.linspace(centre - reach, centre + reach, bins + 1)
    inside = np.clip(values, edges[0], edges[-1])  # the few beyond the ends are counted in the last bins
    counts, _, _ = axes.hist(inside, bins=edges.tolist(), color=style.SKY, edgecolor=style.BLUE, lw=0.5, label=counted)
    top = float(np.max(np.asarray(counts)))
    if normal:
        x = np.linspace(edges[0], edges[-1], 301)
        density = np.exp(-(x**2) / 2) / math.sqrt(2 * math.pi) * values.size * (edges[1] - edges[0])
        axes.plot(x, density, color=style.BLACK, ls="--", lw=1.1, label="normal, sd 1")
        top = max(top, float(density.max()))
        axes.legend(loc="upper right")
    axes.set_ylim(0, 1.35 * top if normal else 1.1 * top)
    axes.locator_params(axis="y", integer=True, nbins=6)
