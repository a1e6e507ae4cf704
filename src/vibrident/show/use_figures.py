"""Pictures of what is done with a result: a restored acceleration, a planned calibration, a tracked sensor."""

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
from vibrident.show.numbers import pair, subject
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
    from vibrident.use.correction import Correction, Corrections
    from vibrident.use.planning import Plan

MOST = 4  # most records in a picture
MOST_POINTS = 2000  # most points of a line of a tracked sensor
USUAL = 0.9  # part of its rows whose U the axes show whole
#: Origins of uncertainty: how each is drawn and called. One that is nowhere a hundredth of the whole is left out.
_ORIGINS = {
    "noise": (Look(BLUE, width=1.1), "noise"),
    "model": (Look(VERMILION, "dashed", 1.1), "parameters"),
    "band": (Look(GREEN, "dashdot", 1.1), "removed by the low-pass"),
    "offset": (Look(PURPLE, "dotted", 1.1), "offset"),
    "ends": (Look(SKY, "dashdot", 1.1), "ends of the record"),
    "background": (Look(ORANGE, "dashed", 1.1), "disturbance seen at rest"),
}
_SHOWN = 0.01
_LEAST = 3e-3  # part of the whole below which a line ends


def correction(corrections: Corrections, sensor: Mapping[str, object]) -> Figure:
    """Restored acceleration with its band of uncertainty, and under each record the sources of the uncertainty.

    ``corrections``: with at least one record; ``sensor``: manufacturer, type and serial number, for the heading.
    """
    every = corrections.corrections
    chosen = [every[i] for i in spread(len(every), MOST)]
    share = f" ({len(chosen)} of {len(every)} records)" if len(every) > len(chosen) else ""
    title = f"{corrections.motion.capitalize()} restored from the response{share}"
    stacks = tuple(_corrected(one, corrections) for one in chosen)
    return Figure("correction", title, stacks, subject(corrections.model, sensor), choice=True)


def _corrected(one: Correction, whole: Corrections) -> Stack:
    unit, record = pretty(whole.unit), one.record
    part = excerpt(record)
    time, clock = from_start(record.start_time_s + record.time_s[part])
    a, u = one.acceleration[part], one.standard_uncertainty[part]
    thin = slice(None, None, max(1, len(time) // 3000))
    upper = [Series(time[thin], a[thin], look=Look(BLACK, width=0.0), half=K * u[thin], band="± 2 u")]
    if record.reference is not None and one.reference is not None:
        upper.append(Series(*envelope(time, one.reference[part]), "reference, same band", Look(ORANGE, width=2.6)))
    upper.append(Series(*envelope(time, a), "restored", Look(BLACK, width=1.0)))
    typical = float(np.nanmedian(u)) if np.isfinite(u).any() else 0.0
    lower = []
    for name, (look, words) in _ORIGINS.items():
        values = one.components[name][part]
        if np.isfinite(values).any() and np.nanmax(values) > _SHOWN * typical:
            seen = np.where(values > _LEAST * typical, values, np.nan)
            lower.append(Series(time[thin], seen[thin], words, look))
    lower.append(Series(time[thin], u[thin], "together (u)", Look(BLACK)))
    scale = scaled("Hz", one.band.high_hz)
    low, high = one.band.low_hz * scale.factor, one.band.high_hz * scale.factor
    title = f"{record.name} · {low:.3g} to {high:.4g} {scale.unit}"
    if one.peak is not None:
        value, u_peak = pair(one.peak.value, one.peak.standard_uncertainty)
        title += f"\npeak {value} {unit}, u = {u_peak} {unit}"
    x = axes.linear(clock, time, most=5, margin=0.02)
    y = axes.size(f"u\nin {unit}", np.concatenate([series.y for series in lower]))
    panels = (
        Panel(x, _limits(f"{whole.motion.capitalize()}\nin {unit}", a), tuple(upper), 1.9),
        Panel(x, y, tuple(lower), 1.0),
    )
    return Stack(panels, title)


def _limits(label: str, a: FloatArray) -> Axis:
    """Limits of the axis from the acceleration, without the large uncertainty at the record's ends."""
    known = axes.usable(a)
    if known.size == 0:
        return axes.linear(label, a)
    low, high = float(np.quantile(known, 0.001)), float(np.quantile(known, 0.999))
    low = min(low, float(known.min()) * 0.2 + low * 0.8)
    return axes.linear(label, np.array([low, max(high, float(known.max()))]), margin=0.1)


def plan(planned: Plan) -> Figure:
    """The sensitivity of a planned calibration, its uncertainty over frequency, and the frequencies chosen."""
    curve = planned.response
    frequency, relative = curve.frequency_hz, curve.magnitude / curve.magnitude[0]
    u, u_phase = 100.0 * K * curve.magnitude_uncertainty / curve.magnitude, K * curve.phase_deg_uncertainty

    def height(at: FloatArray) -> FloatArray:
        return np.exp(np.interp(np.log(at), np.log(frequency), np.log(relative)))

    upper = [Series(frequency, relative, "sensitivity", Look(BLACK, width=1.2))]
    others = np.setdiff1d(planned.candidates_hz, planned.frequency_hz)
    if others.size:
        upper.append(Series(others, height(others), "not chosen", Look(GREY, marker="o"), "points"))
    chosen = np.asarray(planned.frequency_hz)
    word = "chosen" if planned.criterion is not None else "planned"
    uses = list(zip(chosen, planned.uses, strict=True))
    texts = tuple(f"{f:.5g} Hz{f', {times} times' if times > 1 else ''}" for f, times in uses)
    upper.append(Series(chosen, height(chosen), word, Look(VERMILION, marker="D"), "points", texts=texts))
    lower = (
        Series(frequency, u, "U of magnitude, %", Look(BLUE)),
        Series(frequency, u_phase, "U of phase, °", Look(GREEN, "dashed")),
    )
    x = axes.frequency(frequency)
    panels = (
        Panel(x, axes.size("Sensitivity over that\nat the lowest frequency", relative), tuple(upper), 2.0),
        Panel(x, axes.size("Uncertainty of the\ncurve, k = 2", np.concatenate([u, u_phase])), lower, 1.5),
    )
    caption = ""
    if planned.efficiency is not None:
        repeated = ", ".join(f"{f:.5g} Hz ×{times}" for f, times in uses if times > 1)
        caption = (
            f"{planned.criterion}-optimal choice of {sum(planned.uses)} out of {planned.candidates_hz.size} "
            f"frequencies{f' ({repeated})' if repeated else ''}; efficiency {100 * planned.efficiency:.0f} %."
        )
    return Figure("plan", "Planned calibration", (Stack(panels),), subject(planned.model, {}), caption)


def tracking(columns: Mapping[str, FloatArray], document: Mapping[str, Any], sensor: Mapping[str, object]) -> Figure:
    """Parameters over time.

    ``columns``: of ``track.csv`` by name, each of shape (rows,); ``document``: what ``track.json`` says; ``sensor``:
    manufacturer, type and serial number, for the heading.
    """
    thin = slice(None, None, max(1, len(columns["time_s"]) // MOST_POINTS))
    time = columns["time_s"][thin]
    panels = []
    x = axes.linear("Time in s", time, margin=0.02)
    for name, parameter in document["parameters"].items():
        values, half = columns[name][thin], K * columns[f"{name}_u"][thin]
        known = np.where(np.isfinite(half), half, 0.0)
        known = np.minimum(known, np.quantile(known, USUAL))  # a change that is not named yet would hide all else
        unit = "" if parameter["unit"] == "1" else parameter["unit"]
        word = in_words(name).capitalize() + (f"\nin {pretty(unit)}" if unit else "")
        y = axes.linear(word, np.concatenate([values - known, values + known]))
        line = Series(time, values, look=Look(BLACK, width=1.0), half=half, band="± U (k = 2)")
        panels.append(Panel(x, y, (line,), 1.5, marks=_alarms(document, name)))
    innovation = columns["innovation"][thin]
    if np.isfinite(innovation).any():  # nothing moved: there is none
        drawn = Series(time, innovation, look=Look(VERMILION, width=1.0))
        y, marks = axes.size("Innovation, rms", innovation), _alarms(document, "innovation")
        panels.append(Panel(x, y, (drawn,), 1.0, marks=marks))
    return Figure("track", "Tracked sensor", (Stack(tuple(panels)),), subject(document["model"], sensor))


def _alarms(document: Mapping[str, Any], name: str) -> tuple[tuple[float, str], ...]:
    """Time of each alarm of a parameter, and its first words."""
    return tuple((a["time_s"], re.split("[:,]", a["what"])[0]) for a in document["alarms"] if a["parameter"] == name)
