"""The uncertainty budget of the measured points, frequency by frequency: noise, and each systematic effect."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vibrident.data.records import SystematicEffect
from vibrident.fit.uncertainty.budget import patterns
from vibrident.fit.uncertainty.linearised import Linearised
from vibrident.result import MeasuredCurve

MOST_POINTS = 200  # points whose budget is kept; of more it is kept at as many, evenly spread


def point_budget(
    measured: MeasuredCurve, effects: Sequence[SystematicEffect], linear: Linearised
) -> dict[str, Any] | None:
    """Standard uncertainties by source at each point; None without effects, where all of it is noise.

    Returns:
        ``frequency_hz`` and, by source, ``magnitude`` (in the unit of the magnitude) and ``phase_deg`` of ``sources``,
        whose root sum of squares is the uncertainty of the point before any floor.
    """
    if not effects or not len(measured.frequency_hz):
        return None
    total = len(measured.frequency_hz)
    chosen = np.unique(np.linspace(0, total - 1, min(total, MOST_POINTS)).astype(int))
    f, size = measured.frequency_hz[chosen], np.abs(measured.magnitude[chosen])
    shape = patterns(effects, linear, f)
    noise = {
        "magnitude": measured.magnitude_noise[chosen].tolist(),
        "phase_deg": measured.phase_deg_noise[chosen].tolist(),
    }
    sources = [{"source": "noise", "type": "A", **noise}]
    for name in dict.fromkeys(effect.source for effect in effects):
        own = shape[:, [effect.source == name for effect in effects]]
        gain, turn = (np.sqrt(np.sum(part**2, axis=1)) for part in (np.real(own), np.imag(own)))
        both = {"magnitude": (size * gain).tolist(), "phase_deg": np.rad2deg(turn).tolist()}
        sources.append({"source": name, "type": "B", **both})
    return {"frequency_hz": f.tolist(), "sources": sources}
