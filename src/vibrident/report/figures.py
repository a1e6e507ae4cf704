"""The interactive charts of the HTML report as plotly figures: plain mappings, so that plotly itself is not loaded."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vibrident.escaping import plotly
from vibrident.naming import scaled
from vibrident.plots.choose import record_frequencies, spread
from vibrident.plots.curves import continuous, nearest_turn
from vibrident.plots.deviation import bars_of_deviation, fitted
from vibrident.plots.style import BLUE, ORANGE, VERMILION, K, numbers, shortened
from vibrident.plots.units import frequency_text
from vibrident.records import FloatArray
from vibrident.report import tables
from vibrident.report.certificate import sensitivity_scale
from vibrident.report.chart import log_ticks
from vibrident.result import Curve, MeasuredCurve, Result, Signal

Figure = dict[str, Any]
#: Measured points drawn; more are thinned evenly, and the caption says so.
MOST_POINTS = 800
#: Points beyond which they have no bars.
CROWD = 150
#: Samples of all records together that are drawn, and periods of a sine; what is left out is said.
MOST_SAMPLES, PERIODS = 12_000, 6.0
#: Records that can be chosen from; of more, these many spread over frequency.
MOST_RECORDS = 60
_BAND = "rgba(86, 180, 233, 0.40)"


def listed(values: FloatArray, digits: int = 9) -> list[float | None]:
    """Numbers for JSON: so many digits, None where there is none."""
    return [float(f"{value:.{digits}g}") if np.isfinite(value) else None for value in np.asarray(values, dtype=float)]


def figure(data: list[Any], height: int, **layout: Any) -> Figure:
    """A figure in the common look."""
    look = {
        "height": height,
        "margin": {"l": 70, "r": 16, "t": 36, "b": 48},
        "font": {"family": "system-ui, sans-serif", "size": 13, "color": "#1a1a1a"},
        "paper_bgcolor": "#ffffff",
        "plot_bgcolor": "#ffffff",
        "hovermode": "closest",
        "legend": {"orientation": "h", "x": 0, "y": 1.0, "yanchor": "bottom", "bgcolor": "rgba(0,0,0,0)"},
    }
    return {"data": data, "layout": {**look, **layout}}


def axis(title: str, **more: Any) -> dict[str, Any]:
    """An axis with grid and frame."""
    look = {"gridcolor": "#dddddd", "linecolor": "#444444", "mirror": True, "ticks": "outside", "zeroline": False}
    return {"title": {"text": title}, "automargin": True, "exponentformat": "power", **look, **more}


def frequency_axis(frequency: FloatArray, **more: Any) -> dict[str, Any]:
    """Frequency in Hz, logarithmic, framed in every panel."""
    return axis("frequency in Hz", type="log", **log_marks(frequency), **{"mirror": "all", **more})


def whole_numbers(title: str, count: int) -> dict[str, Any]:
    """An axis that counts: its ticks are whole numbers, about eight of them."""
    return axis(title, tick0=0, dtick=max(1, round(count / 8)))


def log_marks(values: FloatArray) -> dict[str, Any]:
    """Whole numbers at the ticks of a logarithmic axis, where plotly would write powers and single digits."""
    usable = values[np.isfinite(values) & (values > 0)]
    if usable.size == 0 or usable.max() < 6 * usable.min():
        return {}
    ticks = log_ticks(float(usable.min()) / 2, float(usable.max()) * 2)
    return {"tickmode": "array", "tickvals": [value for value, _ in ticks], "ticktext": [name for _, name in ticks]}


def thinned(result: Result) -> list[int]:
    """Indices of the measured points that are drawn."""
    return spread(len(result.measured.frequency_hz), MOST_POINTS)


def _band(x: FloatArray, low: FloatArray, high: FloatArray, **place: Any) -> list[Any]:
    """A band around a line, as two lines that are not drawn and what lies between."""
    hidden = {"x": listed(x), "mode": "lines", "line": {"width": 0}, "hoverinfo": "skip", **place}
    upper = {**hidden, "y": listed(high), "showlegend": False}
    return [upper, {**hidden, "y": listed(low), "fill": "tonexty", "fillcolor": _BAND}]


def bars(half: FloatArray) -> dict[str, Any]:
    """Bars of these half lengths; not drawn for a crowd of points, where they would hide everything else."""
    return {"type": "data", "array": listed(half), "thickness": 1.2, "width": 3, "visible": 0 < half.size <= CROWD}


def _limits(x: FloatArray, half: FloatArray, place: str) -> list[Any]:
    """Lines at ±U, which take the place of a crowd's bars."""
    if x.size <= CROWD or not np.isfinite(half).any():
        return []
    order = np.argsort(x)
    look = {"mode": "lines", "line": {"color": "#000000", "width": 1.2, "dash": "dash"}, "hoverinfo": "skip"}
    line = {"x": listed(x[order]), "name": "measured, U (k = 2)", "yaxis": place, **look}
    upper = {**line, "y": listed(half[order]), "showlegend": place == "y"}
    return [upper, {**line, "y": listed(-half[order]), "showlegend": False}]


def _u(curve: Curve, quantity: str) -> FloatArray:
    """U (k = 2) of a curve; NaN where it is not known."""
    return K * fitted(numbers(getattr(curve, f"{quantity}_uncertainty")), numbers(curve.frequency_hz))


def _stated(frequency: Sequence[float], values: Sequence[float | None], u: FloatArray, factor: float, unit: str) -> Any:
    """What a point says when it is touched: frequency, value and U, rounded as in the tables."""
    texts = []
    for f, value, expanded in zip(frequency, values, u, strict=True):
        text, bar = tables.with_u(value, expanded / K if np.isfinite(expanded) else None, factor)
        texts.append(plotly(f"{f:.6g} Hz: {text}{f' ± {bar}' if np.isfinite(expanded) else ''} {unit}"))
    return texts


def _records(measured: MeasuredCurve, chosen: list[int]) -> list[str]:
    """Name of the record of each point, for its label."""
    return [plotly(shortened(tables.at(measured.record, i) or "", 40)) for i in chosen]


def sensitivity(result: Result) -> Figure | None:
    """Magnitude and phase of model and measurement with U (k = 2); None where there is nothing to draw."""
    model, measured, chosen = result.response, result.measured, thinned(result)
    if not model.frequency_hz and not chosen:
        return None
    scale = sensitivity_scale(result)
    data = _panel(model, measured, chosen, "magnitude", scale.factor, scale.unit, "y")
    has_phase = any(p is not None for p in (*model.phase_deg, *measured.phase_deg))
    if has_phase:
        data += _panel(model, measured, chosen, "phase_deg", 1.0, "°", "y2")
    sizes = numbers([*model.magnitude, *measured.magnitude])
    sizes = sizes[np.isfinite(sizes) & (sizes > 0)]
    kind = "log" if sizes.size and sizes.max() > 3 * sizes.min() else "linear"
    kinds = ("log", "linear") if kind == "log" else ("linear", "log")
    marks = {"log": log_marks(sizes * scale.factor), "linear": {}}
    choose = [
        {
            "label": name,
            "method": "relayout",
            "args": [
                {"yaxis.type": name, "yaxis.autorange": True, "yaxis.tickmode": "array" if marks[name] else "auto"}
            ],
        }
        for name in kinds
    ]
    menus = [{"buttons": choose, "x": 1.0, "xanchor": "right", "y": 1.0, "yanchor": "bottom", "pad": {"b": 4}}]
    domain = [0.42, 1.0] if has_phase else [0.0, 1.0]
    upper = axis(f"|S| in {plotly(scale.unit)}", type=kind, domain=domain, **marks["log"])
    upper["tickmode"] = "array" if kind == "log" and marks["log"] else "auto"
    frequency = numbers([*model.frequency_hz, *measured.frequency_hz])
    below = frequency_axis(frequency, anchor="y2" if has_phase else "y")
    layout = {"xaxis": below, "yaxis": upper, "updatemenus": menus}
    if has_phase:
        layout["yaxis2"] = axis("phase in ° (lag negative)", domain=[0.0, 0.36])
    return figure(data, 620 if has_phase else 420, **layout)


def _panel(
    model: Curve, measured: MeasuredCurve, chosen: list[int], quantity: str, factor: float, unit: str, place: str
) -> list[Any]:
    data: list[Any] = []
    first = place == "y"
    x, raw = numbers(model.frequency_hz), numbers(getattr(model, quantity))
    known = raw.shape == x.shape and bool(np.isfinite(raw).any())
    y = continuous(raw) if known and not first else raw
    if known:
        u = _u(model, quantity)
        if np.isfinite(u).any():
            low = y - u if not first else np.maximum(y - u, 1e-3 * y)
            data += _band(x, low * factor, (y + u) * factor, yaxis=place, name="model, U (k = 2)", showlegend=first)
        data.append(
            {
                "x": listed(x),
                "y": listed(y * factor),
                "text": _stated(model.frequency_hz, getattr(model, quantity), u, factor, unit),
                "hovertemplate": "model, %{text}<extra></extra>",
                "mode": "lines" if x.size > 1 else "markers",
                "line": {"color": BLUE, "width": 2},
                "name": "model",
                "showlegend": first,
                "yaxis": place,
            }
        )
    x_measured, values = numbers(measured.frequency_hz), numbers(getattr(measured, quantity))
    if not chosen or values.shape != x_measured.shape or not np.isfinite(values).any():
        return data
    shown = values
    if not first:
        shown = nearest_turn(values, np.interp(x_measured, x, y)) if known else continuous(values)
    u = _u(measured, quantity)
    stated = _stated(measured.frequency_hz, getattr(measured, quantity), u, factor, unit)
    data.append(
        {
            "x": listed(x_measured[chosen]),
            "y": listed((shown * factor)[chosen]),
            "error_y": bars((u * factor)[chosen]),
            "text": [stated[i] for i in chosen],
            "customdata": _records(measured, chosen),
            "hovertemplate": "measured, %{text}<br>%{customdata}<extra></extra>",
            "mode": "markers",
            "marker": {"color": VERMILION, "size": 7 if len(chosen) <= 100 else 4},
            "name": "measured, U (k = 2)" if np.isfinite(u).any() else "measured",
            "showlegend": first,
            "yaxis": place,
        }
    )
    return data


def deviation(result: Result) -> Figure | None:
    """Model minus measurement: magnitude in percent, phase in degrees; bars and band U (k = 2)."""
    measured, model, chosen = result.measured, result.response, thinned(result)
    frequency = numbers(measured.frequency_hz)
    percent = fitted(numbers(measured.deviation_percent), frequency)
    if not np.isfinite(percent).any():
        return None
    turned = (fitted(numbers(measured.deviation_phase_deg), frequency) + 180.0) % 360.0 - 180.0
    relative, turned_bars = bars_of_deviation(measured)
    own = 100.0 * _u(model, "magnitude") / numbers(model.magnitude)
    panels = [("y", percent, relative, own, "%")]
    if np.isfinite(turned).any():
        panels.append(("y2", turned, turned_bars, _u(model, "phase_deg"), "°"))
    data: list[Any] = []
    for place, values, half, band, unit in panels:
        first = place == "y"
        if np.isfinite(band).any():
            x = numbers(model.frequency_hz)
            data += _band(x, -band, band, yaxis=place, name="model, U (k = 2)", showlegend=first)
        data.append(
            {
                "x": listed(frequency[chosen]),
                "y": listed(values[chosen]),
                "error_y": bars(half[chosen]),
                "customdata": _records(measured, chosen),
                "hovertemplate": f"%{{x:.6g}} Hz: %{{y:+.3g}} {unit}<br>%{{customdata}}<extra></extra>",
                "mode": "markers",
                "marker": {"color": VERMILION, "size": 7 if len(chosen) <= 100 else 4},
                "name": "model − measured, U (k = 2)",
                "showlegend": first,
                "yaxis": place,
            }
        )
        data += _limits(frequency[chosen], half[chosen], place)
    several = len(panels) > 1
    zero = {"zeroline": True, "zerolinecolor": "#444444"}
    layout = {
        "xaxis": frequency_axis(frequency, anchor="y2" if several else "y"),
        "yaxis": axis("magnitude in %", domain=[0.54, 1.0] if several else [0.0, 1.0], **zero),
    }
    if several:
        layout["yaxis2"] = axis("phase in °", domain=[0.0, 0.46], **zero)
    return figure(data, 520 if several else 340, **layout)


def signals(result: Result) -> list[tuple[str, Figure]]:
    """Name and chart of each record: measured and predicted response, and the residual."""
    frequencies = record_frequencies(result)
    ordered = sorted(result.signals, key=lambda signal: frequencies.get(signal.record, 0.0))
    ordered = [ordered[i] for i in spread(len(ordered), MOST_RECORDS)]
    most = max(50, MOST_SAMPLES // max(len(ordered), 1))
    found = []
    for signal in ordered:
        frequency = frequencies.get(signal.record)
        called = frequency_text(frequency) if frequency else ""
        named = f"{called}, {signal.record}" if called and called != signal.record else signal.record
        found.append((named, _signal(signal, _drawn(signal, frequency, most))))
    return found


def _drawn(signal: Signal, frequency_hz: float | None, most: int) -> slice:
    """A few periods of a sine, and of what is still too long every so many samples."""
    time = numbers(signal.time_s)
    if frequency_hz and time.size > most:
        time = time[time <= time[0] + PERIODS / frequency_hz]
    return slice(0, time.size, max(1, -(-time.size // most)))


def _signal(signal: Signal, drawn: slice) -> Figure:
    time, measured, predicted = (numbers(v)[drawn] for v in (signal.time_s, signal.measured, signal.predicted))
    residual = measured - predicted
    largest = [float(np.max(np.abs(v[np.isfinite(v)]), initial=0.0)) for v in (measured, residual)]
    clock = scaled("s", float(np.ptp(time)) if time.size else 0.0)
    size, small = (scaled(signal.unit, value) for value in largest)
    common = {**_clock(time * clock.factor), "mode": "lines"}
    lines = (
        ("measured", measured * size.factor, ORANGE, "y", {"width": 3.5}),
        ("predicted", predicted * size.factor, "#000000", "y", {"width": 1.3, "dash": "dash"}),
        ("residual", residual * small.factor, BLUE, "y2", {"width": 1.2}),
    )
    data = [
        {**common, "y": listed(y, 6), "name": name, "yaxis": place, "line": {"color": colour, **line}}
        for name, y, colour, place, line in lines
    ]
    part = f" (every {drawn.step}th sample)" if drawn.step > 1 else ""
    return figure(
        data,
        440,
        xaxis=axis(f"time in {clock.unit}{part}", anchor="y2", mirror="all"),
        yaxis=axis(f"response in {plotly(size.unit)}", domain=[0.40, 1.0]),
        yaxis2=axis(f"residual in {plotly(small.unit)}", domain=[0.0, 0.33]),
    )


def _clock(time: FloatArray) -> dict[str, Any]:
    """Times of samples: by start and step where they are equally far from each other."""
    steps = np.diff(time)
    if steps.size and np.ptp(steps) < 1e-6 * abs(steps[0]):
        return {"x0": float(time[0]), "dx": float((time[-1] - time[0]) / steps.size)}
    return {"x": listed(time)}


def residuals(result: Result) -> Figure | None:
    """How residuals are distributed, beside the normal distribution of the same size."""
    if result.signals:
        parts = [_in_own_rmse(signal) for signal in result.signals]
        values, label = np.concatenate(parts), "residual / rmse of its record"
    else:
        magnitude = numbers(result.measured.magnitude)
        u = bars_of_deviation(result.measured)[0] / K
        values = fitted(numbers(result.measured.deviation_percent), magnitude) / np.where(u > 0, u, np.nan)
        values, label = values[np.isfinite(values)], "magnitude deviation / its u"
    if values.size < 8:
        return None
    reach = float(np.clip(np.max(np.abs(values)), 3.0, 6.0))
    edges = np.linspace(-reach, reach, int(np.clip(np.sqrt(values.size), 8, 40)) + 1)
    counts, _ = np.histogram(np.clip(values, -reach, reach), edges)
    centres, width = (edges[1:] + edges[:-1]) / 2, edges[1] - edges[0]
    x = np.linspace(-reach, reach, 121)
    density = np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi) * values.size * width
    columns = {
        "type": "bar",
        "x": listed(centres),
        "y": [int(count) for count in counts],
        "width": float(width),
        "marker": {"color": _BAND, "line": {"color": BLUE, "width": 1}},
        "name": "residuals",
        "hovertemplate": "%{x:.2f}: %{y}<extra></extra>",
    }
    normal = {
        "x": listed(x),
        "y": listed(density),
        "mode": "lines",
        "line": {"color": "#000000", "width": 1.5, "dash": "dash"},
        "name": "normal, sd 1",
        "hoverinfo": "skip",
    }
    return figure([columns, normal], 320, xaxis=axis(label), yaxis=axis("number"), bargap=0)


def _in_own_rmse(signal: Signal) -> FloatArray:
    residual = numbers(signal.measured) - numbers(signal.predicted)
    residual = residual[np.isfinite(residual)]
    size = float(np.sqrt(np.mean(residual**2))) if residual.size else 0.0
    return residual / size if size > 0 else residual[:0]


def training(result: Result) -> Figure | None:
    """Loss by iteration."""
    if result.training is None or len(result.training.loss) < 2:
        return None
    loss = numbers(result.training.loss)
    line = {"x": list(range(len(loss))), "y": listed(loss), "mode": "lines+markers", "marker": {"size": 4}}
    trace = {**line, "line": {"color": BLUE}, "name": "loss", "hovertemplate": "%{x}: %{y:.4g}<extra></extra>"}
    kind = "log" if np.nanmin(loss) > 0 else "linear"
    yaxis = axis("weighted mean square", type=kind, **(log_marks(loss) if kind == "log" else {}))
    return figure([trace], 300, xaxis=whole_numbers("iteration", len(loss)), yaxis=yaxis, showlegend=False)
