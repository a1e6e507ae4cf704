"""Restored acceleration with its band of uncertainty, and under each record where the uncertainty comes from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from vibrident.naming import pretty, scaled
from vibrident.plots import style
from vibrident.plots.choose import envelope, excerpt, grid, spread
from vibrident.plots.style import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.gridspec import SubplotSpec

    from vibrident.correction import Correction, Corrections, Peak

#: Most records in the picture.
MOST = 4
#: Origins of uncertainty: how each is drawn and called. One that is nowhere a hundredth of the whole is left out.
_ORIGINS = {
    "noise": (style.BLUE, "-", "noise"),
    "model": (style.VERMILION, "--", "parameters"),
    "band": (style.GREEN, "-.", "removed by the low-pass"),
    "offset": (style.PURPLE, ":", "offset"),
    "ends": (style.SKY, (0, (3, 1, 1, 1)), "ends of the record"),
}
_SHOWN = 0.01
#: Part of the whole below which a line ends.
_LEAST = 3e-3


def figure(corrections: Corrections, sensor: Mapping[str, object]) -> Figure:
    """Draw at most four records.

    Args:
        corrections: with at least one record.
        sensor: manufacturer, type and serial number, for the heading.
    """
    every = corrections.corrections
    chosen = [every[i] for i in spread(len(every), MOST)]
    with style.styled():
        rows, columns = grid(len(chosen))
        picture = style.new_figure(6.7 if columns == 1 else 8.6, 1.2 + (3.8 if rows == 1 else 3.2) * rows)
        cells = picture.add_gridspec(rows, columns)
        for i, correction in enumerate(chosen):
            _panel(picture, cells[divmod(i, columns)], correction, corrections, named=i % columns == 0)
        handles: dict[str, Any] = {}
        for axes in picture.axes:
            for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
                handles.setdefault(label, handle)
        picture.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=4)
        share = f" ({len(chosen)} of {len(every)} records)" if len(every) > len(chosen) else ""
        subject = f"{corrections.motion.capitalize()} restored from the response{share}"
        style.title(picture, subject, corrections.model, sensor)
        return picture


def _panel(picture: Figure, cell: SubplotSpec, correction: Correction, whole: Corrections, *, named: bool) -> None:
    unit = style.printable(pretty(whole.unit))
    rows = cell.subgridspec(2, 1, height_ratios=(2, 1), hspace=0.0)
    upper = picture.add_subplot(rows[0])
    lower = picture.add_subplot(rows[1], sharex=upper)
    record = correction.record
    part = excerpt(record)
    time_scale = scaled("s", float(np.ptp(record.time_s[part])))
    time = (record.start_time_s + record.time_s[part]) * time_scale.factor
    a, u = correction.acceleration[part], correction.standard_uncertainty[part]
    upper.fill_between(
        *_thinned(time, a - style.K * u, a + style.K * u), color=style.SKY, alpha=0.5, lw=0, label="± 2 u"
    )
    if record.reference is not None and correction.reference is not None:
        upper.plot(
            *envelope(time, correction.reference[part]), color=style.ORANGE, lw=2.6, label="reference, same band"
        )
    upper.plot(*envelope(time, a), color=style.BLACK, lw=1.0, label="restored")
    _limits(upper, a)
    band = correction.band
    heading = f"{style.shortened(record.name, 28)} · {_range(band.low_hz, band.high_hz)}"
    if correction.peak is not None:
        heading += f"\npeak {_peak(correction.peak, unit)}"
    upper.set_title(heading, fontsize=8)
    typical = float(np.nanmedian(u)) if np.isfinite(u).any() else 0.0
    shown = [u]
    for name, (color, dash, words) in _ORIGINS.items():
        series = correction.components[name][part]
        if np.isfinite(series).any() and np.nanmax(series) > _SHOWN * typical:
            seen = np.where(series > _LEAST * typical, series, np.nan)
            lower.plot(*_thinned_one(time, seen), color=color, ls=dash, lw=1.1, label=words)
            shown.append(seen)
    lower.plot(*_thinned_one(time, u), color=style.BLACK, lw=1.4, label="together (u)")
    style.size_axis(lower, np.concatenate(shown))
    lower.set_xlabel(f"Time in {time_scale.unit}")
    if named:
        upper.set_ylabel(f"{whole.motion.capitalize()}\nin {unit}")
        lower.set_ylabel(f"u, standard\nuncertainty\nin {unit}")
    upper.tick_params(labelbottom=False)


def _peak(peak: Peak, unit: str) -> str:
    """Value and u, both to the second digit of u."""
    value, u = peak.value, peak.standard_uncertainty
    decimals = max(0, 1 - int(np.floor(np.log10(u)))) if np.isfinite(u) and u > 0 else 4
    return f"{value:.{decimals}f} {unit}, u = {u:.{decimals}f} {unit}"


def _range(low_hz: float, high_hz: float) -> str:
    scale = scaled("Hz", high_hz)
    return f"{low_hz * scale.factor:.3g} to {high_hz * scale.factor:.4g} {scale.unit}"


def _limits(axes: object, a: FloatArray) -> None:
    """The acceleration in view, whatever the uncertainty at the record's ends."""
    known = a[np.isfinite(a)]
    if known.size:
        low, high = float(np.quantile(known, 0.001)), float(np.quantile(known, 0.999))
        low, high = min(low, float(known.min()) * 0.2 + low * 0.8), max(high, float(known.max()))
        margin = 0.1 * (high - low) or 1.0
        axes.set_ylim(low - margin, high + margin)  # type: ignore[attr-defined]


def _thinned(time: FloatArray, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    step = max(1, len(time) // 3000)
    return time[::step], low[::step], high[::step]


def _thinned_one(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    step = max(1, len(time) // 3000)
    return time[::step], values[::step]
