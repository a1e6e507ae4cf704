"""Figures as plotly draws them, as plain mappings: plotly itself is not loaded."""

from __future__ import annotations

import datetime
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vibrident.base.escaping import plotly
from vibrident.show.axes import linear_ticks, log_ticks
from vibrident.show.curves import spread
from vibrident.show.formulas import in_a_line
from vibrident.show.views import (
    BLUE,
    SKY,
    Axis,
    Figure,
    FloatArray,
    Look,
    Panel,
    Series,
    Stack,
    band_colour,
)

Chart = dict[str, Any]
# measured points drawn of a series; more are thinned evenly, and the caption says so
MAX_POINTS = 800
MAX_SAMPLES = 12_000  # samples of all records together that are drawn where one of them is chosen
_PX_PER_INCH = 125.0  # pixels of an inch of a panel
_PANEL_GAP_PX = 16.0  # pixels between panels
_TOP_MARGIN_PX = 40.0  # pixels above all panels
_BOTTOM_MARGIN_PX = 56.0  # pixels below all panels
#: Pixels of plotly's buttons, which appear at the upper right, where the choice of the axis stands
#: below them.
_BUTTONS_PX = 20.0
_BAND_OPACITY = 0.40  # of bands
_DASHES = {"solid": "solid", "dashed": "dash", "dotted": "dot", "dashdot": "dashdot"}
_MARKERS = {
    "o": "circle",
    "s": "square",
    "^": "triangle-up",
    "D": "diamond",
    "v": "triangle-down",
    "x": "x-thin-open",
}


def charts(figure: Figure) -> list[tuple[str, Chart]]:
    """Return name and chart of each stack that can be chosen; one chart if there is no choice."""
    if figure.choice:
        most = max(50, MAX_SAMPLES // max(1, len(figure.stacks)))
        return [
            (stack.title.split("\n")[0], _chart([_thinned(stack, most)])) for stack in figure.stacks
        ]
    return [("", _chart(figure.stacks))]


def _thinned(stack: Stack, most: int) -> Stack:
    """Return the stack with at most so many points a line."""
    panels = []
    for panel in stack.panels:
        steps = [(line, max(1, -(-len(line.x) // most))) for line in panel.series]
        series = tuple(replace(line, x=line.x[::step], y=line.y[::step]) for line, step in steps)
        panels.append(replace(panel, series=series))
    return replace(stack, panels=tuple(panels))


def caption(figure: Figure) -> str:
    """Return what is drawn, and what is left out of the drawing."""
    every = (line for stack in figure.stacks for panel in stack.panels for line in panel.series)
    most = max((len(line.x) for line in every if line.kind == "points"), default=0)
    if most <= MAX_POINTS:
        return figure.caption
    return type(figure.caption)(
        f"{figure.caption} {MAX_POINTS} of {most} measured points are drawn."
    )


def listed(values: FloatArray, digits: int = 9) -> list[float | None]:
    """Round numbers for JSON to so many digits; None for a value that is not finite."""
    numbers = np.asarray(values, dtype=float)
    finite = np.isfinite(numbers).tolist()
    return [
        float(f"{value:.{digits}g}") if is_finite else None
        for value, is_finite in zip(numbers.tolist(), finite, strict=True)
    ]


def label(text: str) -> str:
    """Return a text of one or more lines."""
    return "<br>".join(plotly(in_a_line(line)) for line in text.split("\n", 2))


def _chart(stacks: Sequence[Stack]) -> Chart:
    data: list[Any] = []
    height = max(sum(panel.height_in for panel in stack.panels) for stack in stacks) * _PX_PER_INCH
    height += (
        _PANEL_GAP_PX * (max(len(stack.panels) for stack in stacks) - 1)
        + _TOP_MARGIN_PX
        + _BOTTOM_MARGIN_PX
    )
    layout: dict[str, Any] = {
        "height": round(height),
        "margin": {"l": 76, "r": 16, "t": _TOP_MARGIN_PX, "b": _BOTTOM_MARGIN_PX},
        "font": {"family": "system-ui, sans-serif", "size": 13, "color": "#1a1a1a"},
        "paper_bgcolor": "#ffffff",
        "plot_bgcolor": "#ffffff",
        "hovermode": "closest",
        "bargap": 0,
        "legend": {
            "orientation": "h",
            "x": 0,
            "y": 1.0,
            "yanchor": "bottom",
            "bgcolor": "rgba(0,0,0,0)",
        },
        "annotations": [],
        "shapes": [],
    }
    shares = np.cumsum([0.0, *(stack.width for stack in stacks)]) / sum(
        stack.width for stack in stacks
    )
    gap = 0.06 if len(stacks) > 1 else 0.0
    number = 0
    for i, stack in enumerate(stacks):
        across = [
            float(shares[i]) + gap * (i > 0),
            float(shares[i + 1]) - gap * (i < len(stacks) - 1),
        ]
        domains = _domains(stack)
        x = f"x{i + 1}" if i else "x"
        for panel, domain in zip(stack.panels, domains, strict=True):
            number += 1
            y = f"y{number}" if number > 1 else "y"
            square = {"scaleanchor": x, "constrain": "domain"} if panel.square else {}
            layout[f"yaxis{y[1:]}"] = {**_axis(panel.y), "domain": domain, "anchor": x, **square}
            data += [trace for line in panel.series for trace in _traces(line, panel, x, y)]
            layout["annotations"] += _annotations(panel, across, domain, x, y)
            layout["shapes"] += _shapes(panel, x, y)
        below = {"domain": across, "anchor": y, "mirror": "all"}
        if stack.panels[-1].square:
            below["constrain"] = "domain"
        layout[f"xaxis{x[1:]}"] = {**_axis(stack.panels[-1].x), **below}
    _once(data)
    if any(stack.panels[0].title for stack in stacks):  # the key stands above the titles
        layout["legend"]["y"] = 1.0 + 18.0 / (height - _TOP_MARGIN_PX - _BOTTOM_MARGIN_PX)
    first = stacks[0].panels[0].y
    if len(stacks) == 1 and (first.log or (first.levels and first.low > 0)):
        layout["updatemenus"] = [_scales(first)]
        layout["height"] = round(height + _BUTTONS_PX)
        layout["margin"]["t"] += _BUTTONS_PX
    return {"data": data, "layout": layout}


def _scales(axis: Axis) -> Chart:
    """Return a choice of logarithmic axis, linear axis and, for sizes, levels."""
    words = {"yaxis.title.text": label(axis.label)}
    ends = {"yaxis.autorange": False, "yaxis.range": listed(np.array([axis.low, axis.high]))}
    of_log = {**ends, "yaxis.type": "log", "yaxis.range": listed(np.log10([axis.low, axis.high]))}
    ticks = _ticks(axis if axis.log else replace(axis, ticks=log_ticks(axis.low, axis.high)))
    kinds = {
        "log": {**of_log, **words, **_at_axis(ticks)},
        "linear": {**ends, **words, "yaxis.type": "linear", "yaxis.tickmode": "auto"},
    }
    if axis.levels:
        # after the word for "in"
        re_unit = re.sub(r"\n(\S+) ", r"\n\1 dB re 1 ", axis.label, count=1)
        kinds["dB"] = {**of_log, "yaxis.title.text": label(re_unit), **_at_axis(_levels(axis))}
    buttons = [{"label": kind, "method": "relayout", "args": [how]} for kind, how in kinds.items()]
    position = {"x": 1.0, "xanchor": "right", "y": 1.0, "yanchor": "bottom", "pad": {"b": 4}}
    return {"buttons": buttons, "active": 0 if axis.log else 1, **position}


def _at_axis(ticks: Chart) -> Chart:
    return {f"yaxis.{name}": value for name, value in ticks.items()}


def _levels(axis: Axis) -> Chart:
    """Return ticks of 20 lg of the values, on a logarithmic axis."""
    low, high = 20.0 * np.log10([axis.low, axis.high])
    names = linear_ticks(float(low), float(high))
    return _ticks(
        replace(axis, ticks=tuple((10.0 ** (level / 20.0), name) for level, name in names))
    )


def _once(data: list[Any]) -> None:
    """Name each series once in the key."""
    names: set[str] = set()
    for trace in data:
        name = trace.get("name", "")
        trace["showlegend"] = bool(name) and name not in names and trace.get("showlegend", True)
        if trace["showlegend"]:
            names.add(name)


def _domains(stack: Stack) -> list[list[float]]:
    """Return the position of each panel, from the top."""
    heights = [_PX_PER_INCH * panel.height_in for panel in stack.panels]
    rooms = [_PANEL_GAP_PX + (14.0 if panel.title else 0.0) for panel in stack.panels[1:]]
    total = sum(heights) + sum(rooms)
    domains = []
    top = 1.0
    for height, room in zip(heights, [*rooms, 0.0], strict=True):
        domains.append([max(0.0, top - height / total), top])
        top -= (height + room) / total
    return domains


def _axis(axis: Axis) -> Chart:
    """Return grid, frame and title, with our ticks where plotly would write powers."""
    look: Chart = {"gridcolor": "#dddddd", "linecolor": "#444444", "mirror": True}
    look |= {"ticks": "outside", "zeroline": False}
    look |= {"title": {"text": label(axis.label)}, "automargin": True, "exponentformat": "power"}
    if axis.dates:
        return {**look, "type": "date", "range": [_at(axis.low, axis), _at(axis.high, axis)]}
    if axis.log:
        look |= {"type": "log", "range": listed(np.log10([axis.low, axis.high])), **_ticks(axis)}
    else:
        look |= {"range": listed(np.array([axis.low, axis.high]))}
        if any(
            not name.replace("−", "-").replace(".", "").lstrip("-").isdigit()
            for _, name in axis.ticks
        ):
            look |= _ticks(axis)
    return look


def _ticks(axis: Axis) -> Chart:
    names = [plotly(name) for _, name in axis.ticks]
    return {"tickmode": "array", "tickvals": [value for value, _ in axis.ticks], "ticktext": names}


def _annotations(
    panel: Panel, across: list[float], domain: list[float], x: str, y: str
) -> list[Any]:
    """Return the title, the words at marks, and the text in place of absent curves."""
    paper = {
        "xref": "paper",
        "yref": "paper",
        "showarrow": False,
        "font": {"size": 12, "color": "#444444"},
    }
    annotations = []
    if panel.title:
        anchor = {"x": across[0], "y": domain[1], "xanchor": "left", "yanchor": "bottom"}
        annotations.append({**paper, **anchor, "text": label(panel.title)})
    if panel.empty:
        annotations.append(
            {**paper, "x": sum(across) / 2, "y": sum(domain) / 2, "text": label(panel.empty)}
        )
    for value, words in panel.marks:
        if words:
            anchor = {
                "xref": x,
                "yref": f"{y} domain",
                "x": _at(value, panel.x),
                "y": 0.5,
                "xanchor": "right",
            }
            annotations.append({**paper, **anchor, "text": label(words)})
    return annotations


def _shapes(panel: Panel, x: str, y: str) -> list[Any]:
    """Return the horizontal and the vertical lines."""
    across = {"type": "line", "xref": f"{x} domain", "yref": y, "x0": 0, "x1": 1, "layer": "below"}
    down = {"type": "line", "xref": x, "yref": f"{y} domain", "y0": 0, "y1": 1}
    rules = [
        {**across, "y0": value, "y1": value, "line": {"color": "#444444", "width": 1}}
        for value in panel.rules
    ]
    dashed = {"color": "#767676", "width": 1, "dash": "dash"}
    positions = [value if panel.x.log else _at(value, panel.x) for value, _ in panel.marks]
    return rules + [{**down, "x0": x_value, "x1": x_value, "line": dashed} for x_value in positions]


def _at(value: float, axis: Axis) -> float | str:
    """Return where plotly puts an item at a value."""
    if axis.dates:
        return datetime.date.fromordinal(round(value)).isoformat()
    return float(np.log10(value)) if axis.log else value


def _traces(series: Series, panel: Panel, x: str, y: str) -> list[Any]:
    common = {"xaxis": x, "yaxis": y, "name": plotly(in_a_line(series.label))}
    if series.kind == "columns":
        assert series.half is not None
        look = {
            "color": _faint(SKY),
            "line": {"color": BLUE, "width": 1 if series.look.width else 0},
        }
        bars = {
            "type": "bar",
            "x": listed(series.x),
            "y": listed(series.y),
            "width": listed(2 * series.half),
        }
        return [
            {**common, **bars, "marker": look, "hovertemplate": "%{x:.2f}: %{y}<extra></extra>"}
        ]
    if series.kind == "line":
        return _line(series, panel, common)
    return _points(series, panel, common)


def _line(series: Series, panel: Panel, common: Chart) -> list[Any]:
    look = series.look
    segments = []
    if series.half is not None:
        low = series.y - series.half
        high = series.y + series.half
        low = np.maximum(low, 1e-3 * series.y) if panel.y.log else low
        hidden = {
            **_x(series.x, panel.x),
            "mode": "lines",
            "line": {"width": 0},
            "hoverinfo": "skip",
            **common,
        }
        hidden["name"] = plotly(in_a_line(series.band))
        segments.append({**hidden, "y": listed(high), "showlegend": False})
        segments.append(
            {**hidden, "y": listed(low), "fill": "tonexty", "fillcolor": _faint(band_colour(look))}
        )
    if look.width:
        mode = "lines+markers" if look.marker else "lines"
        line = {"color": look.colour, "width": 1.3 * look.width, "dash": _DASHES[look.dash]}
        marker = {"marker": _marker(look, 5)} if look.marker else {}
        drawn = {
            **_x(series.x, panel.x),
            "y": listed(series.y, 9 if panel.x.log else 6),
            "mode": mode,
            "line": line,
        }
        segments.append({**common, **drawn, **marker, **_texts(series)})
    return segments


def _faint(colour: str) -> str:
    """Return a colour of six hexadecimal digits with the opacity of a band."""
    red, green, blue = bytes.fromhex(colour[1:])
    return f"rgba({red}, {green}, {blue}, {_BAND_OPACITY:.2f})"


def _points(series: Series, panel: Panel, common: Chart) -> list[Any]:
    indices = spread(len(series.x), MAX_POINTS)
    bars = {}
    if series.half is not None:
        bars["error_y"] = {
            "type": "data",
            "array": listed(series.half[indices]),
            "thickness": 1.2,
            "width": 3,
        }
    if series.kind == "stems":
        down = {
            "type": "data",
            "symmetric": False,
            "array": [0.0] * len(indices),
            "arrayminus": listed(series.y[indices]),
        }
        bars["error_y"] = {**down, "thickness": 1.0, "width": 0, "color": "#767676"}
    marker = _marker(series.look, 7 if len(indices) <= 100 else 4)
    if not series.look.marker:  # bars alone
        bars["error_y"] |= {"thickness": series.look.width, "width": 0, "color": series.look.colour}
        marker["size"] = 1
    points = {
        **_x(series.x[indices], panel.x),
        "y": listed(series.y[indices]),
        "mode": "markers",
        "marker": marker,
    }
    return [{**common, **points, **bars, **_texts(series, indices)}]


def _marker(look: Look, size: float) -> Chart:
    return {"color": look.colour, "size": size, "symbol": _MARKERS.get(look.marker, "circle")}


def _texts(series: Series, indices: Sequence[int] | None = None) -> Chart:
    """Return the text of each point under the pointer: its own if it has one."""
    drawn_points = range(len(series.x)) if indices is None else indices
    word = plotly(in_a_line(series.label.partition(",")[0]))
    named = f"{word}: " if word else ""
    more: Chart = (
        {"customdata": [plotly(series.names[i]) for i in drawn_points]} if series.names else {}
    )
    below = "<br>%{customdata}" if series.names else ""
    if series.texts:
        more["text"] = [plotly(series.texts[i]) for i in drawn_points]
        return {**more, "hovertemplate": f"{named}%{{text}}{below}<extra></extra>"}
    return {**more, "hovertemplate": f"{named}%{{x:.6g}}, %{{y:.4g}}{below}<extra></extra>"}


def _x(values: FloatArray, axis: Axis) -> Chart:
    """Return places of points: first and step where many are equidistant; dates by name."""
    if axis.dates:
        return {"x": [_at(day, axis) for day in values]}
    steps = np.diff(values)
    if values.size > 40 and not axis.log and np.ptp(steps) < 1e-6 * abs(steps[0]):
        return {"x0": float(values[0]), "dx": float((values[-1] - values[0]) / steps.size)}
    return {"x": listed(values)}
