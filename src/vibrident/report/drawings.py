"""The charts of the PDF: sensitivity over frequency, and drift over the years."""

from __future__ import annotations

import datetime

import numpy as np

from vibrident.plots.curves import continuous, nearest_turn
from vibrident.plots.style import FloatArray, K, numbers
from vibrident.report.certificate import sensitivity_scale
from vibrident.report.chart import Panel, Series, svg
from vibrident.report.history import History
from vibrident.report.side_by_side import Quantity
from vibrident.result import Curve, Result


def sensitivity_svg(result: Result) -> str | None:
    """Magnitude and phase of model and measurement with U (k = 2); None where the result has no curve."""
    model, measured = result.response, result.measured
    magnitude = numbers(model.magnitude)
    if magnitude.size < 2 or not np.any(np.isfinite(magnitude) & (magnitude > 0)):
        return None
    scale = sensitivity_scale(result)
    x, x_measured = numbers(model.frequency_hz), numbers(measured.frequency_hz)
    series = [
        Series(x, magnitude * scale.factor, _half(model, "magnitude", scale.factor), "model, U (k = 2)", line=True)
    ]
    if x_measured.size:
        values = numbers(measured.magnitude) * scale.factor
        series.append(Series(x_measured, values, _half(measured, "magnitude", scale.factor), "measured, U (k = 2)"))
    panels = [Panel(f"magnitude in {scale.unit}", tuple(series), 150.0, log=True)]
    phase = numbers(model.phase_deg)
    if phase.shape == x.shape and np.isfinite(phase).all():
        phase = continuous(phase)
        series = [Series(x, phase, _half(model, "phase_deg", 1.0), line=True)]
        points = numbers(measured.phase_deg)
        if np.isfinite(points).any():
            points = nearest_turn(points, np.interp(x_measured, x, phase))
            series.append(Series(x_measured, points, _half(measured, "phase_deg", 1.0)))
        panels.append(Panel("phase in °", tuple(series), 95.0))
    return svg(panels, "frequency in Hz")


def _half(curve: Curve, quantity: str, factor: float) -> FloatArray | None:
    u = numbers(getattr(curve, f"{quantity}_uncertainty"))
    return K * u * factor if u.shape == (len(curve.frequency_hz),) and np.isfinite(u).any() else None


def drift_svg(history: History) -> str:
    """Change of each quantity from the first date, in percent where it can be, with U (k = 2)."""
    days = np.array([float(date.toordinal()) for date in history.dates])
    panels = []
    for quantity in history.quantities:
        change, half, unit = changes(quantity)
        known = np.isfinite(change)
        bars = half[known] if np.isfinite(half[known]).any() else None
        label = f"{quantity.label}, {unit}"
        panels.append(Panel(label, (Series(days[known], change[known], bars),), 92.0, zero=True))
    ticks = [(float(date.toordinal()), date.isoformat()) for date in spaced(history.dates)]
    return svg(panels, "date; bars: U (k = 2)", ticks, log_x=False)


def changes(quantity: Quantity) -> tuple[FloatArray, FloatArray, str]:
    """Change from the first value and U of each value, and the unit of both: % where the quantity allows it."""
    value = numbers([None if v is None else v.value for v in quantity.values])
    expanded = numbers([None if v is None else v.expanded for v in quantity.values])
    if quantity.relative and value[0]:
        return 100.0 * (value / value[0] - 1.0), 100.0 * expanded / abs(value[0]), "%"
    return (value - value[0]) * quantity.scale.factor, expanded * quantity.scale.factor, quantity.scale.unit


def spaced(dates: tuple[datetime.date, ...], most: int = 7) -> list[datetime.date]:
    """Dates far enough from each other to be written side by side, the first among them."""
    span = (dates[-1] - dates[0]).days or 1
    kept = [dates[0]]
    for date in dates[1:]:
        if (date - kept[-1]).days >= span / most:
            kept.append(date)
    return kept
