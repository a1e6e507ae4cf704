"""Draw uses of a result: a restored acceleration, a planned calibration, a tracked sensor."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from vibrident.base.amounts import pretty, scaled
from vibrident.physics.naming import in_words
from vibrident.show import axes
from vibrident.show.curves import envelope, from_start, spread
from vibrident.show.data_figures import excerpt
from vibrident.show.numbers import pair, sensitivity_scale, subject
from vibrident.show.views import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    Axis,
    Figure,
    FloatArray,
    K,
    Look,
    Panel,
    Series,
    Stack,
)

if TYPE_CHECKING:
    from vibrident.result import Result
    from vibrident.use.correction import Correction, Corrections
    from vibrident.use.planning import MountedSensor, Plan

MAX_RECORDS = 4  # most records in a picture
MAX_POINTS_PER_LINE = 2000  # most points of a line of a tracked sensor
SHARE_SHOWN_WHOLE = 0.9  # part of its rows whose U the axes show whole
#: Origins of uncertainty: how each is drawn and called. One that is nowhere a hundredth of the
#: whole is left out.
_ORIGINS = {
    "noise": (Look(BLUE, width=1.1), "noise"),
    "model": (Look(VERMILION, "dashed", 1.1), "parameters"),
    "band": (Look(GREEN, "dashdot", 1.1), "removed by the low-pass"),
    "offset": (Look(PURPLE, "dotted", 1.1), "offset"),
    "ends": (Look(SKY, "dashdot", 1.1), "ends of the record"),
    "background": (Look(ORANGE, "dashed", 1.1), "disturbance seen at rest"),
}
_MIN_SHARE = 0.01
_MIN_LINE_SHARE = 3e-3  # part of the whole below which a line ends


def correction(corrections: Corrections, sensor: Mapping[str, object]) -> Figure:
    """Draw the restored acceleration with its uncertainty band, and the sources of that.

    ``corrections``: with at least one record; ``sensor``: manufacturer, type and serial number, for
    the heading.
    """
    every = corrections.corrections
    drawn = [every[i] for i in spread(len(every), MAX_RECORDS)]
    share = f" ({len(drawn)} of {len(every)} records)" if len(every) > len(drawn) else ""
    title = f"{corrections.motion.capitalize()} restored from the response{share}"
    stacks = tuple(_corrected(record_correction, corrections) for record_correction in drawn)
    return Figure("correction", title, stacks, subject(corrections.model, sensor), choice=True)


def _corrected(correction: Correction, corrections: Corrections) -> Stack:
    unit = pretty(corrections.unit)
    record = correction.record
    span = excerpt(record)
    time, clock = from_start(record.start_time_s + record.time_s[span])
    a = correction.acceleration[span]
    u = correction.standard_uncertainty[span]
    thin = slice(None, None, max(1, len(time) // 3000))
    upper = [
        Series(time[thin], a[thin], look=Look(BLACK, width=0.0), half=K * u[thin], band="± 2 u")
    ]
    if record.reference is not None and correction.reference is not None:
        upper.append(
            Series(
                *envelope(time, correction.reference[span]),
                "reference, same band",
                Look(ORANGE, width=2.6),
            )
        )
    upper.append(Series(*envelope(time, a), "restored", Look(BLACK, width=1.0)))
    typical = float(np.nanmedian(u)) if np.isfinite(u).any() else 0.0
    lower = []
    for name, (look, words) in _ORIGINS.items():
        values = correction.components[name][span]
        if np.isfinite(values).any() and np.nanmax(values) > _MIN_SHARE * typical:
            visible = np.where(values > _MIN_LINE_SHARE * typical, values, np.nan)
            lower.append(Series(time[thin], visible[thin], words, look))
    lower.append(Series(time[thin], u[thin], "together (u)", Look(BLACK)))
    scale = scaled("Hz", correction.band.high_hz)
    low = correction.band.low_hz * scale.factor
    high = correction.band.high_hz * scale.factor
    title = f"{record.name} · {low:.3g} to {high:.4g} {scale.unit}"
    if correction.peak is not None:
        value, u_peak = pair(correction.peak.value, correction.peak.standard_uncertainty)
        title += f"\npeak {value} {unit}, u = {u_peak} {unit}"
    x = axes.linear(clock, time, most=5, margin=0.02)
    y = axes.size(f"u\nin {unit}", np.concatenate([series.y for series in lower]))
    panels = (
        Panel(x, _limits(f"{corrections.motion.capitalize()}\nin {unit}", a), tuple(upper), 1.9),
        Panel(x, y, tuple(lower), 1.0),
    )
    return Stack(panels, title)


def _limits(label: str, a: FloatArray) -> Axis:
    """Return the limits of the axis, without the large uncertainty at the record's ends."""
    finite = axes.usable(a)
    if finite.size == 0:
        return axes.linear(label, a)
    low = float(np.quantile(finite, 0.001))
    high = float(np.quantile(finite, 0.999))
    low = min(low, float(finite.min()) * 0.2 + low * 0.8)
    return axes.linear(label, np.array([low, max(high, float(finite.max()))]), margin=0.1)


def plan(planned: Plan) -> Figure:
    """Draw the sensitivity of a planned calibration, its uncertainty, and the frequencies."""
    curve = planned.response
    frequency = curve.frequency_hz
    relative = curve.magnitude / curve.magnitude[0]
    u = 100.0 * K * curve.magnitude_uncertainty / curve.magnitude
    u_phase = K * curve.phase_deg_uncertainty

    def height(at: FloatArray) -> FloatArray:
        return np.exp(np.interp(np.log(at), np.log(frequency), np.log(relative)))

    upper = [Series(frequency, relative, "sensitivity", Look(BLACK, width=1.2))]
    unchosen_hz = np.setdiff1d(planned.candidates_hz, planned.frequency_hz)
    if unchosen_hz.size:
        upper.append(
            Series(unchosen_hz, height(unchosen_hz), "not chosen", Look(GREY, marker="o"), "points")
        )
    planned_hz = np.asarray(planned.frequency_hz)
    word = "chosen" if planned.criterion is not None else "planned"
    uses = list(zip(planned_hz, planned.uses, strict=True))
    texts = tuple(f"{f:.5g} Hz{f', {times} times' if times > 1 else ''}" for f, times in uses)
    upper.append(
        Series(
            planned_hz, height(planned_hz), word, Look(VERMILION, marker="D"), "points", texts=texts
        )
    )
    lower = (
        Series(frequency, u, "U of magnitude, %", Look(BLUE)),
        Series(frequency, u_phase, "U of phase, °", Look(GREEN, "dashed")),
    )
    x = axes.frequency(frequency)
    panels = (
        Panel(
            x,
            axes.size("Sensitivity over that\nat the lowest frequency", relative),
            tuple(upper),
            2.0,
        ),
        Panel(
            x,
            axes.size("Uncertainty of the\ncurve, k = 2", np.concatenate([u, u_phase])),
            lower,
            1.5,
        ),
    )
    caption = ""
    if planned.efficiency is not None:
        repeated = ", ".join(f"{f:.5g} Hz ×{times}" for f, times in uses if times > 1)
        caption = (
            f"{planned.criterion}-optimal choice of {sum(planned.uses)} out of "
            f"{planned.candidates_hz.size} frequencies{f' ({repeated})' if repeated else ''}; "
            f"efficiency {100 * planned.efficiency:.0f} %."
        )
    return Figure(
        "plan", "Planned calibration", (Stack(panels),), subject(planned.model, {}), caption
    )


def mounting(result: Result, mounted: MountedSensor) -> Figure:
    """Draw the sensitivity as identified and on another mounting, and their difference."""
    scale = sensitivity_scale(result)
    mounted = mounted.fine
    x = axes.frequency(mounted.predicted.frequency_hz)
    curves = ((mounted.identified, "as identified", Look(BLACK, "dashed")),)
    curves += ((mounted.predicted, "on the other mounting", Look(BLUE)),)
    upper = []
    for curve, name, look in curves:
        half = K * curve.magnitude_uncertainty * scale.factor
        size = curve.magnitude * scale.factor
        upper.append(Series(curve.frequency_hz, size, name, look, half=half))
    change = 100.0 * mounted.change
    lower = (Series(mounted.predicted.frequency_hz, change, "", Look(VERMILION)),)
    sizes = np.concatenate([series.y for series in upper])
    panels = (
        Panel(x, axes.size(f"Sensitivity\nin {scale.unit}", sizes), tuple(upper), 2.0),
        Panel(x, axes.linear("Change\nin %", change), lower, 1.5, rules=(0.0,)),
    )
    caption = "Bands: expanded uncertainty U, k = 2."
    return Figure(
        "mounting",
        "Sensitivity on another mounting",
        (Stack(panels),),
        subject(result.model, result.sensor),
        caption,
    )


def tracking(
    columns: Mapping[str, FloatArray], document: Mapping[str, Any], sensor: Mapping[str, object]
) -> Figure:
    """Draw the parameters over time.

    ``columns``: of ``track.csv`` by name, each of shape (rows,); ``document``: what ``track.json``
    says; ``sensor``: manufacturer, type and serial number, for the heading.
    """
    thin = slice(None, None, max(1, len(columns["time_s"]) // MAX_POINTS_PER_LINE))
    time = columns["time_s"][thin]
    panels = []
    x = axes.linear("Time in s", time, margin=0.02)
    for name, parameter in document["parameters"].items():
        values = columns[name][thin]
        half = K * columns[f"{name}_u"][thin]
        bar = np.where(np.isfinite(half), half, 0.0)
        # a change that is not named yet would hide all else
        bar = np.minimum(bar, np.quantile(bar, SHARE_SHOWN_WHOLE))
        unit = "" if parameter["unit"] == "1" else parameter["unit"]
        word = in_words(name).capitalize() + (f"\nin {pretty(unit)}" if unit else "")
        y = axes.linear(word, np.concatenate([values - bar, values + bar]))
        line = Series(time, values, look=Look(BLACK, width=1.0), half=half, band="± U (k = 2)")
        panels.append(Panel(x, y, (line,), 1.5, marks=_alarms(document, name)))
    innovation = columns["innovation"][thin]
    if np.isfinite(innovation).any():  # nothing moved: there is none
        drawn = Series(time, innovation, look=Look(VERMILION, width=1.0))
        y = axes.size("Innovation, rms", innovation)
        marks = _alarms(document, "innovation")
        panels.append(Panel(x, y, (drawn,), 1.0, marks=marks))
    return Figure(
        "track", "Tracked sensor", (Stack(tuple(panels)),), subject(document["model"], sensor)
    )


def _alarms(document: Mapping[str, Any], name: str) -> tuple[tuple[float, str], ...]:
    """Return the time of each alarm of a parameter, and its first words."""
    return tuple(
        (a["time_s"], re.split("[:,]", a["what"])[0])
        for a in document["alarms"]
        if a["parameter"] == name
    )
