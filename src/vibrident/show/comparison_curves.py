"""Draw the curves of several results over each other, and their differences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vibrident.base.nominal import Nominal
from vibrident.result import Result
from vibrident.show import axes
from vibrident.show.comparison import sensitivity_kind
from vibrident.show.curves import continuous, principal
from vibrident.show.formulas import Words
from vibrident.show.language import ENGLISH
from vibrident.show.numbers import (
    sensitivity_scale,
)
from vibrident.show.points import sensitivity_at
from vibrident.show.views import LINES, Figure, Panel, Series, Stack


def comparison_figure(results: Sequence[Result], names: Sequence[str]) -> Figure | None:
    """Draw magnitude and phase of results, and differences from the first; None for one result."""
    first = results[0]
    alike = [
        (result, name)
        for result, name in zip(results, names, strict=True)
        if len(result.response.frequency_hz) > 1
        and sensitivity_kind(result) == sensitivity_kind(first)
    ]
    if len(alike) < 2:
        return None
    scale = sensitivity_scale(first)
    lines_by_panel: list[list[Series]] = [[], [], [], []]
    for i, (result, name) in enumerate(alike):
        curve = result.response
        look = replace(LINES[i % len(LINES)], marker="", width=1.6)
        x = curve.frequency_hz
        magnitude = curve.magnitude
        phase = continuous(curve.phase_deg)
        base = [sensitivity_at(first, Nominal(f, f)) for f in curve.frequency_hz]
        sizes, angles = (
            np.array([getattr(point, name, None) for point in base], dtype=float)
            for name in ("magnitude", "phase_deg")
        )
        ratio = magnitude / sizes
        turned = principal(phase - angles)
        label = name if name not in [earlier for _, earlier in alike[:i]] else f"{name} ({i + 1})"
        for lines, y in zip(
            lines_by_panel,
            (magnitude * scale.factor, phase, 100.0 * (ratio - 1.0), turned),
            strict=True,
        ):
            lines.append(Series(x, y, label, look))
    x_axis = axes.frequency(np.concatenate([result.response.frequency_hz for result, _ in alike]))
    values = [np.concatenate([line.y for line in lines]) for lines in lines_by_panel]
    y_axes = (
        replace(axes.size(f"|S|\nin {scale.unit}", values[0]), levels=True),
        axes.angle("Phase\nin °", values[1]),
        axes.about_zero("Difference\nin %", values[2], floor=1e-3),
        axes.about_zero("Difference\nin °", values[3], floor=1e-3),
    )
    titles = (
        "",
        "",
        f"Magnitude, difference from {names[0]}",
        f"Phase, difference from {names[0]}",
    )
    panels = tuple(
        Panel(x_axis, y, tuple(lines), height, title, rules=(0.0,) if title else ())
        for lines, y, height, title, value in zip(
            lines_by_panel, y_axes, (2.0, 1.3, 1.2, 1.2), titles, values, strict=True
        )
        if np.isfinite(value).any()
    )
    phase = ENGLISH("text", "phase")
    caption = Words(
        f"Sensitivity of each result's model, and its difference from the first. {phase}"
    )
    return Figure("curves", "Sensitivity", (Stack(panels),), "", caption)
