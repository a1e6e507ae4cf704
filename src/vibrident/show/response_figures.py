"""Pictures of the sensitivity: model and measurement over frequency, and how far they are apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vibrident.base.amounts import UnitScale
from vibrident.result import Curve, MeasuredCurve, Result
from vibrident.show import axes
from vibrident.show.curves import (
    bars_of_deviation,
    column,
    continuous,
    expanded,
    nearest_turn,
    principal,
    spread,
)
from vibrident.show.formulas import Words
from vibrident.show.language import ENGLISH
from vibrident.show.numbers import (
    NONE,
    rounded,
    sensitivity_scale,
    shortened,
    subject,
    uncertainty,
    with_sign,
    with_u,
)
from vibrident.show.views import (
    BLACK,
    BLUE,
    MAX_POINTS_WITH_BARS,
    MEASURED,
    ORANGE,
    PURPLE,
    Figure,
    FloatArray,
    K,
    Look,
    Panel,
    Series,
    Stack,
)

#: What a response is called that is per no motion.
_NOT_MOTIONS = {"drive": "Response per drive", "force": "Response per force"}


def sensitivity(result: Result) -> Figure | None:
    """Draw magnitude and phase of the model and of the measured points, both with U (k = 2)."""
    if not result.has_gain and not result.measured.frequency_hz.size:
        return None
    panels = response_panels(
        result.response, result.measured, sensitivity_scale(result), result.quantity, "measured"
    )
    codes = ", ".join(code.replace("_", " ") for code in result.warning_codes)
    return Figure(
        "sensitivity",
        "Sensitivity",
        (Stack(panels),),
        subject(result.model, result.sensor),
        Words(" ".join(_small_print(result))),
        f"Warnings: {codes}." if codes else "",
    )


def _small_print(result: Result) -> list[str]:
    drawn = []
    if len(result.measured.frequency_hz) <= MAX_POINTS_WITH_BARS and _has_finite(
        result.measured.magnitude_uncertainty
    ):
        drawn.append("bars")
    if _has_finite(result.response.magnitude_uncertainty):
        drawn.append("band")
    sentences = (
        [f"{' and '.join(drawn).capitalize()}: expanded uncertainty U, k = 2."] if drawn else []
    )
    if _has_finite(result.response.phase_deg) or _has_finite(result.measured.phase_deg):
        sentences.append(ENGLISH("text", "phase"))
    return sentences


def _has_finite(values: FloatArray) -> bool:
    return bool(np.isfinite(values).any())


def response_panels(
    model: Curve | None, measured: Curve, scale: UnitScale, quantity: str, label: str
) -> tuple[Panel, ...]:
    """Return the panels of the magnitude and, where there is one, of the phase.

    ``model``: drawn as a line with its band; ``measured``: drawn as points with bars, called
    ``label``; ``scale``: of the magnitudes; ``quantity``: what they are per.
    """
    curves = [curve for curve in (model, measured) if curve is not None]
    x = axes.frequency(np.concatenate([curve.frequency_hz for curve in curves]))
    word = f"Sensitivity to {quantity}" if quantity else "Sensitivity"
    word = _NOT_MOTIONS.get(quantity, word)
    name = f"{word}\nin {scale.unit}"
    series = _quantity(model, measured, "magnitude", scale.factor, scale.unit, label)
    values = np.concatenate([np.zeros(0), *(line.y for line in series)])
    bars = [(line.y, line.half) for line in series if line.half is not None]
    ends = [
        np.concatenate([np.zeros(0), *(y + sign * half for y, half in bars)]) for sign in (-1, 1)
    ]
    empty = "" if (values > 0).any() else "no points"
    panels = [
        Panel(x, replace(axes.size(name, values, *ends), levels=True), series, 2.45, empty=empty)
    ]
    if any(_has_finite(curve.phase_deg) for curve in curves):
        series = _quantity(model, measured, "phase_deg", 1.0, "°", label)
        extents = [line.y for line in series]
        for line in series:
            if line.half is not None and line.kind == "points":
                extents += [line.y + sign * np.minimum(line.half, 90.0) for sign in (-1, 1)]
        panels.append(
            Panel(x, axes.angle("Phase (lag negative)\nin °", np.concatenate(extents)), series, 1.5)
        )
    return tuple(panels)


def _quantity(
    model: Curve | None, measured: Curve, quantity: str, factor: float, unit: str, label: str
) -> tuple[Series, ...]:
    """Return line and points of a magnitude or a phase, ordered by frequency."""
    lines = []
    line = None
    phase = quantity == "phase_deg"
    if model is not None and _has_finite(getattr(model, quantity)):
        x, y, half, texts = _sorted_points(model, quantity, factor, unit)
        finite = np.isfinite(y)
        x = x[finite]
        y = continuous(y[finite]) if phase else y[finite]
        half = half[finite]
        line = x, y
        look = Look(BLUE, marker="s" if x.size == 1 else "")
        band = half if _has_finite(half) else None
        texts = tuple(filter(None, texts))
        lines.append(Series(x, y, "model", look, half=band, band="model, U (k = 2)", texts=texts))
    if _has_finite(getattr(measured, quantity)):
        x, y, half, texts = _sorted_points(measured, quantity, factor, unit)
        if phase:
            y = continuous(y) if line is None else nearest_turn(y, np.interp(x, *line))
        lines.append(_points(measured, x, y, half, label, texts))
    return tuple(lines)


def _points(
    measured: Curve,
    x: FloatArray,
    y: FloatArray,
    half: FloatArray,
    label: str,
    texts: tuple[str, ...],
) -> Series:
    """Return marks with bars, in the order of frequency; many are a cloud without bars."""
    crowd = len(x) > MAX_POINTS_WITH_BARS
    bars = None if crowd or not _has_finite(half) else half
    look = Look(ORANGE, marker=".") if crowd else MEASURED
    named = label if bars is None else f"{label}, U (k = 2)"
    records: tuple[str, ...] = getattr(measured, "record", ())
    order = np.argsort(measured.frequency_hz, kind="stable")
    names = tuple(shortened(records[i], 40) for i in order) if records else ()
    return Series(x, y, named, look, "points", bars, texts=texts, names=names)


def _sorted_points(
    curve: Curve, quantity: str, factor: float, unit: str
) -> tuple[FloatArray, FloatArray, FloatArray, tuple[str, ...]]:
    x = curve.frequency_hz
    y = factor * column(curve, quantity)
    half = factor * expanded(curve, quantity)
    order = np.argsort(x, kind="stable")
    texts = tuple(_point_text(float(x[i]), float(y[i]), float(half[i]), unit) for i in order)
    return x[order], y[order], half[order], texts


def _point_text(frequency: float, value: float, half: float, unit: str) -> str:
    """Return frequency, value and U as text, rounded as in the tables."""
    if not np.isfinite(value):
        return ""
    text, bar = with_u(value, half / K if np.isfinite(half) else None, 1.0)
    return f"{frequency:.6g} Hz: {text}{f' ± {bar}' if np.isfinite(half) else ''} {unit}"


def _span(values: FloatArray) -> str:
    low, high = (uncertainty(float(end)) for end in (np.nanmin(values), np.nanmax(values)))
    return low if low == high else f"{low} to {high}"


def _deviation_text(value: float, half: float) -> str:
    if not np.isfinite(value):
        return NONE
    return with_sign(rounded(value, half)[0] if half > 0 else f"{value:.3g}")


def deviation(result: Result) -> Figure | None:
    """Draw model − measured at each frequency with U (k = 2), and the model's U around zero.

    Where most of U is common to all points, as that of a reference is, the model follows it and no
    deviation shows it: around zero is then the noise of the points, and the common part is said
    above the panel.
    """
    measured = result.measured
    model = result.response
    frequency = measured.frequency_hz
    percent = column(measured, "deviation_percent")
    phase = principal(column(measured, "deviation_phase_deg"))
    if frequency.size == 0:
        return None
    bars = bars_of_deviation(measured)
    model_expanded = 100.0 * expanded(model, "magnitude") / column(model, "magnitude")
    size = 100.0 / column(measured, "magnitude")
    panels_data = [
        (
            "Magnitude deviation",
            "%",
            percent,
            bars[0],
            model_expanded,
            *_split_u(measured, "magnitude", size),
        )
    ]
    if _has_finite(phase):
        of_phase = _split_u(measured, "phase_deg", np.ones(frequency.size))
        panels_data.append(
            ("Phase deviation", "°", phase, bars[1], expanded(model, "phase_deg"), *of_phase)
        )
    panels = [_deviation(result, *panel_data) for panel_data in panels_data]
    bars_are = "dashed lines" if frequency.size > MAX_POINTS_WITH_BARS else "bars"
    caption = (
        "Deviation = model − measured, magnitude relative to measured. Expanded uncertainty U, k = "
        f"2: {bars_are} deviation, band as named."
    )
    title = "Deviation of the model from the measurement"
    return Figure(
        "deviation", title, (Stack(tuple(panels)),), subject(result.model, result.sensor), caption
    )


def _split_u(
    measured: MeasuredCurve, quantity: str, factor: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return U (k = 2) of the points by their noise, and by what is common to them all."""
    noise = K * column(measured, f"{quantity}_noise") * factor
    measured_expanded = expanded(measured, quantity) * factor
    return noise, np.sqrt(np.maximum(measured_expanded**2 - noise**2, 0.0))


def _deviation(
    result: Result,
    word: str,
    unit: str,
    values: FloatArray,
    half: FloatArray,
    band: FloatArray,
    noise: FloatArray,
    common: FloatArray,
) -> Panel:
    measured = result.measured
    x_model = result.response.frequency_hz
    named = "model, U (k = 2)"
    title = ""
    colour = BLUE
    if (common > noise).sum() * 2 > len(common):
        title = f"U common to all points (k = 2): {_span(common)} {unit}"
        x_model = measured.frequency_hz
        band = noise
        named = "noise of the points, U (k = 2)"
        colour = PURPLE
    frequency = measured.frequency_hz
    order = np.argsort(frequency, kind="stable")
    x = frequency[order]
    y = values[order]
    bars = half[order]
    y_axis = axes.about_zero(f"{word}\nin {unit}", y, bars)
    series = []
    inside = band[(x_model >= x[0]) & (x_model <= x[-1]) & np.isfinite(band)]
    if inside.size and float(np.median(inside)) > y_axis.high:  # it would fill the panel
        title = title or f"U of the model (k = 2): {_span(inside)} {unit}"
    elif _has_finite(band):
        order = np.argsort(x_model, kind="stable")
        unseen = Look(colour, width=0.0)
        series.append(
            Series(x_model[order], 0.0 * x_model, "", unseen, half=band[order], band=named)
        )
    texts = tuple(
        f"{f:.6g} Hz: {_deviation_text(value, bar)} {unit}"
        for f, value, bar in zip(x, y, bars, strict=True)
    )
    series.append(_points(measured, x, y, bars, "model − measured", texts))
    if len(x) > MAX_POINTS_WITH_BARS and _has_finite(bars):
        few = spread(len(x), 4 * MAX_POINTS_WITH_BARS)
        look = Look(BLACK, "dashed", 1.1)
        series += [
            Series(x[few], sign * bars[few], "measured, U (k = 2)", look) for sign in (1, -1)
        ]
    empty = "" if _has_finite(y) else "no measured points to compare with"
    return Panel(
        axes.frequency(frequency), y_axis, tuple(series), 1.6, title, rules=(0.0,), empty=empty
    )
