"""Magnitude and phase of measured points and of a model, as two panels over frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from vibrident.naming import scaled
from vibrident.plots import style
from vibrident.plots.style import FloatArray, K
from vibrident.result import Curve

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_NAMES = {"drive": "Response per drive"}


def panels(
    figure: Figure, model: Curve | None, measured: Curve, *, unit: str, quantity: str, measured_label: str
) -> None:
    """Draw magnitude and, where there is any, phase.

    Args:
        figure: an empty figure, in the shared style.
        model: drawn as a line with its band; None leaves it out.
        measured: drawn as points with bars.
        unit: unit of the magnitudes.
        quantity: quantity of the reference.
        measured_label: what the points are called in the legend.
    """
    curves = [curve for curve in (model, measured) if curve is not None]
    has_phase = any(np.isfinite(style.numbers(curve.phase_deg)).any() for curve in curves)
    rows = 2 if has_phase else 1
    grid = figure.add_gridspec(rows, 1, height_ratios=(1.6, 1)[:rows])
    upper = figure.add_subplot(grid[0])
    axes = [upper, figure.add_subplot(grid[1], sharex=upper)] if has_phase else [upper]
    frequency = np.concatenate([style.numbers(curve.frequency_hz) for curve in curves])

    _magnitudes(upper, model, measured, unit, quantity, measured_label)
    if has_phase:
        _phases(axes[1], model, measured)
        upper.tick_params(labelbottom=False)
    for row in axes:
        style.frequency_axis(row, frequency, label=row is axes[-1])


def _magnitudes(axes: Axes, model: Curve | None, measured: Curve, unit: str, quantity: str, label: str) -> None:
    curves = [curve for curve in (model, measured) if curve is not None]
    raw = np.concatenate([style.numbers(curve.magnitude) for curve in curves])
    spread = np.concatenate([style.numbers(curve.magnitude_uncertainty) for curve in curves])
    usable = raw[np.isfinite(raw) & (raw > 0)]
    scale = scaled(unit, float(np.exp(np.median(np.log(usable)))) if usable.size else 0.0)
    word = _NAMES.get(quantity, f"Sensitivity to {quantity}" if quantity else "Sensitivity")
    axes.set_ylabel(f"{style.printable(word)}\nin {style.printable(scale.unit)}")
    if usable.size == 0:
        style.empty(axes, "no points")
        return
    if len(spread) != len(raw):
        spread = np.full_like(raw, np.nan)
    low, high = (raw - K * spread) * scale.factor, (raw + K * spread) * scale.factor

    if model is not None and model.frequency_hz:
        frequency, magnitude, u = _sorted(model.frequency_hz, model.magnitude, model.magnitude_uncertainty)
        magnitude, u = magnitude * scale.factor, u * scale.factor
        if np.isfinite(u).any():
            band = np.maximum(magnitude - K * u, 1e-3 * magnitude), magnitude + K * u
            axes.fill_between(frequency, *band, color=style.SKY, alpha=0.45, lw=0, label="model, U (k = 2)")
        axes.plot(frequency, magnitude, color=style.BLUE, label="model", **_alone(frequency, measured))
    if measured.frequency_hz:
        frequency, magnitude, u = _sorted(measured.frequency_hz, measured.magnitude, measured.magnitude_uncertainty)
        magnitude, u = magnitude * scale.factor, u * scale.factor
        bars = np.stack([np.minimum(K * u, 0.999 * magnitude), K * u])
        points(axes, frequency, magnitude, bars, label)
    style.size_axis(axes, raw * scale.factor, low, high)
    axes.legend(loc="best", markerscale=4 if len(measured.frequency_hz) > style.CROWD else 1)


def _phases(axes: Axes, model: Curve | None, measured: Curve) -> None:
    from matplotlib.ticker import MaxNLocator

    axes.set_ylabel("Phase (lag negative)\nin °")
    shown: list[FloatArray] = []
    line = None
    if model is not None and model.frequency_hz:
        frequency, phase, u = _sorted(model.frequency_hz, model.phase_deg, model.phase_deg_uncertainty)
        usable = np.isfinite(phase)
        frequency, phase, u = frequency[usable], continuous(phase[usable]), u[usable]
        if frequency.size:
            line = frequency, phase
            shown.append(phase)
            if np.isfinite(u).any():
                axes.fill_between(frequency, phase - K * u, phase + K * u, color=style.SKY, alpha=0.45, lw=0)
            axes.plot(frequency, phase, color=style.BLUE, **_alone(frequency, measured))
    frequency, phase, u = _sorted(measured.frequency_hz, measured.phase_deg, measured.phase_deg_uncertainty)
    if np.isfinite(phase).any():
        phase = continuous(phase) if line is None else nearest_turn(phase, np.interp(frequency, *line))
        points(axes, frequency, phase, K * u, None)
        shown.append(phase)
        if np.isfinite(u).any():
            shown.extend([phase - np.minimum(K * u, 90.0), phase + np.minimum(K * u, 90.0)])
    values = np.concatenate(shown)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    margin = 0.07 * max(high - low, 1.0)
    axes.set_ylim(low - margin, high + margin)
    steps = [1, 1.5, 3, 4.5, 6, 9, 10] if high - low > 40 else [1, 2, 2.5, 5, 10]
    axes.yaxis.set_major_locator(MaxNLocator(nbins=6, steps=steps))


def points(axes: Axes, x: FloatArray, y: FloatArray, bars: FloatArray, label: str | None) -> None:
    """Draw measured points; bars (half lengths at k = 2, shape (points,) or (2, points)) where they are known.

    A crowd of points has no bars: they would hide everything else.
    """
    known = np.isfinite(np.atleast_2d(bars)).all(axis=0) & np.isfinite(y)
    looks = style.marks(len(x))
    mark = {key: value for key, value in looks.items() if key not in ("elinewidth", "capsize")}
    crowd = len(x) > style.CROWD
    common = {"color": style.ORANGE if crowd else style.VERMILION, "linestyle": "none", "zorder": 3}
    if crowd:
        axes.plot(x, y, label=label, **common, **mark)
        return
    name = label
    if known.any():
        text = None if label is None else f"{label}, U (k = 2)"
        axes.errorbar(x[known], y[known], bars[..., known], label=text, **common, **looks)
        name = None if label is None else f"{label}, without uncertainty"
    if (~known & np.isfinite(y)).any():
        axes.plot(x[~known], y[~known], label=name, **common, **mark)


def continuous(phase_deg: FloatArray) -> FloatArray:
    """Phase without jumps of a whole turn, starting in (−180°, 180°]; NaN stays."""
    out = phase_deg.copy()
    usable = np.isfinite(out)
    if usable.any():
        unwrapped = np.unwrap(out[usable], period=360.0)
        out[usable] = unwrapped - 360.0 * np.ceil((unwrapped[0] - 180.0) / 360.0)
    return out


def nearest_turn(phase_deg: FloatArray, near_deg: FloatArray) -> FloatArray:
    """Phase in degrees, moved by whole turns to where it is nearest to another."""
    return phase_deg + 360.0 * np.round((near_deg - phase_deg) / 360.0)


def _sorted(frequency, values, uncertainty) -> tuple[FloatArray, FloatArray, FloatArray]:
    x = style.numbers(frequency)
    order = np.argsort(x, kind="stable")
    u = style.numbers(uncertainty) if len(uncertainty) == len(x) else np.full_like(x, np.nan)
    return x[order], style.numbers(values)[order], u[order]


def _alone(frequency: FloatArray, measured: Curve) -> dict[str, Any]:
    """A mark for a line of one point, and a place above the measured points where they are a crowd."""
    place = {"zorder": 4} if len(measured.frequency_hz) > style.CROWD else {}
    return {"marker": "_", "markersize": 14, **place} if len(frequency) == 1 else place
