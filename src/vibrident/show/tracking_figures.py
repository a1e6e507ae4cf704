"""The picture of a tracked sensor: each parameter over time with its U, and the alarms."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from vibrident.base.amounts import pretty
from vibrident.physics.naming import in_words
from vibrident.show import axes
from vibrident.show.numbers import subject
from vibrident.show.views import BLACK, VERMILION, Figure, FloatArray, K, Look, Panel, Series, Stack

MOST = 2000  # most points of a line
USUAL = 0.9  # part of the rows whose U the axes show whole


def tracking(columns: Mapping[str, FloatArray], document: Mapping[str, Any], sensor: Mapping[str, object]) -> Figure:
    """Parameters over time.

    Args:
        columns: of ``track.csv`` by name, each of shape (rows,).
        document: what ``track.json`` says.
        sensor: manufacturer, type and serial number, for the heading.
    """
    thin = slice(None, None, max(1, len(columns["time_s"]) // MOST))
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
    drawn = Series(time, innovation, look=Look(VERMILION, width=1.0))
    y, marks = axes.size("Innovation, rms", innovation), _alarms(document, "innovation")
    panels.append(Panel(x, y, (drawn,), 1.0, marks=marks))
    return Figure("track", "Tracked sensor", (Stack(tuple(panels)),), subject(document["model"], sensor))


def _alarms(document: Mapping[str, Any], name: str) -> tuple[tuple[float, str], ...]:
    """Time of each alarm of a parameter, and its first words."""
    return tuple((a["time_s"], re.split("[:,]", a["what"])[0]) for a in document["alarms"] if a["parameter"] == name)
