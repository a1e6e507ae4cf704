"""The interactive charts of several results: drift over time, and curves side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from vibrident.escaping import plotly
from vibrident.nominal import Nominal
from vibrident.plots.style import GREY, LINES, VERMILION, numbers
from vibrident.report.certificate import sensitivity_scale
from vibrident.report.drawings import changes
from vibrident.report.figures import Figure, axis, bars, figure, frequency_axis, listed, log_marks
from vibrident.report.history import History
from vibrident.report.points import sensitivity_at
from vibrident.result import Result


def drift(history: History) -> Figure:
    """Change of each quantity from the first date, with U (k = 2)."""
    count = len(history.quantities)
    dates = [date.isoformat() for date in history.dates]
    data: list[Any] = []
    layout: dict[str, Any] = {
        "xaxis": axis("date", type="date", anchor=f"y{count}" if count > 1 else "y", mirror="all")
    }
    for i, quantity in enumerate(history.quantities):
        change, half, unit = changes(quantity)
        place = f"y{i + 1}" if i else "y"
        top = 1.0 - i / count
        zero = {"zeroline": True, "zerolinecolor": "#444444"}
        layout[f"yaxis{i + 1}" if i else "yaxis"] = axis(
            f"{plotly(quantity.label)}<br>in {plotly(unit)}", domain=[max(0.0, top - 0.88 / count), top], **zero
        )
        data.append(
            {
                "x": dates,
                "y": listed(change),
                "error_y": bars(half),
                "text": [plotly(label) for label in history.labels],
                "hovertemplate": f"%{{text}}: %{{y:+.3g}} {plotly(unit)}<extra>{plotly(quantity.label)}</extra>",
                "mode": "lines+markers",
                "line": {"color": GREY, "width": 1, "dash": "dot"},
                "marker": {"color": VERMILION, "size": 8},
                "name": plotly(quantity.label),
                "yaxis": place,
            }
        )
    layout["margin"] = {"l": 90, "r": 16, "t": 16, "b": 48}
    return figure(data, 90 + 150 * count, showlegend=False, **layout)


def beside(results: Sequence[Result], names: Sequence[str]) -> Figure | None:
    """Curves of several results in one chart, and their difference from the first in percent."""
    first = results[0]
    alike = [
        (result, name)
        for result, name in zip(results, names, strict=True)
        if len(result.response.frequency_hz) > 1
        and (result.response_unit, result.reference) == (first.response_unit, first.reference)
    ]
    if len(alike) < 2:
        return None
    scale = sensitivity_scale(first)
    data: list[Any] = []
    for i, (result, name) in enumerate(alike):
        x, y = numbers(result.response.frequency_hz), numbers(result.response.magnitude)
        look = {"color": LINES[i % len(LINES)][0], "width": 2, "dash": ("solid", "dash", "dot", "dashdot")[i % 4]}
        line = {"x": listed(x), "mode": "lines", "line": look, "name": plotly(name), "legendgroup": plotly(name)}
        data.append({**line, "y": listed(y * scale.factor), "hovertemplate": "%{x:.5g} Hz: %{y:.6g}"})
        base = [sensitivity_at(first, Nominal(f, f)) for f in result.response.frequency_hz]
        percent = 100.0 * (y / numbers([None if point is None else point.magnitude for point in base]) - 1.0)
        data.append({**line, "y": listed(percent), "yaxis": "y2", "showlegend": False})
    every = numbers([f for result, _ in alike for f in result.response.frequency_hz])
    sizes = numbers([m for result, _ in alike for m in result.response.magnitude]) * scale.factor
    zero = {"zeroline": True, "zerolinecolor": "#444444"}
    layout = {
        "xaxis": frequency_axis(every, anchor="y2"),
        "yaxis": axis(f"|S| in {plotly(scale.unit)}", type="log", domain=[0.42, 1.0], **log_marks(sizes)),
        "yaxis2": axis(f"difference from {plotly(names[0])} in %", domain=[0.0, 0.36], **zero),
    }
    return figure(data, 560, **layout)
