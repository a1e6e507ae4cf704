"""Results of earlier versions: excerpts with a time for each sample, curves per the reference."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vibrident.data.records import QUANTITIES, REFERENCE_UNITS
from vibrident.physics.models import installed
from vibrident.physics.models.quantities import conversion

#: Longest excerpt laid out evenly; earlier versions wrote 600 samples at most.
MAX_EXCERPT_SAMPLES = 100_000
#: Columns in the unit of the sensitivity.
_SENSITIVITY_COLUMNS = ("magnitude", "magnitude_uncertainty", "magnitude_noise")


def in_current_form(document: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the document in the form of this version."""
    return with_even_excerpts(with_stated_quantity(document))


def with_stated_quantity(document: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a document whose curves are per the sensor's own quantity, and which states it.

    Earlier versions wrote curves per the quantity of the reference. Those of a model that is not
    installed remain so.
    """
    reference = document.get("reference")
    if "sensitivity_per" in document or not isinstance(reference, Mapping):
        return document
    per: Any = reference.get("quantity")
    model = installed(str(document.get("model")))
    target = per if per not in QUANTITIES or model is None else model.stated_quantity(per)
    if target == per:
        return {**document, "sensitivity_per": reference}
    settings = document["settings"]
    budget = settings.get("point_budget")
    if isinstance(budget, Mapping):
        factor = _factor(budget["frequency_hz"], per, target)
        sources = [_scaled(source, factor) for source in budget["sources"]]
        settings = {**settings, "point_budget": {**budget, "sources": sources}}
    return {
        **document,
        "response": _converted(document["response"], per, target),
        "measured": _converted(document["measured"], per, target),
        "settings": settings,
        "sensitivity_per": {"quantity": target, "unit": REFERENCE_UNITS[target]},
    }


def _factor(frequency_hz: Any, per: Any, target: Any) -> Any:
    """Return the factor from a response per one quantity to that per another, shape (points,)."""
    return conversion(np.array(frequency_hz, dtype=float), per, target)


def _converted(curve: Mapping[str, Any], per: Any, target: Any) -> dict[str, Any]:
    """Return a curve per the quantity ``target``, its phase in (−180°, 180°]."""
    factor = _factor(curve["frequency_hz"], per, target)
    phase_deg = np.array(curve["phase_deg"], dtype=float)
    if phase_deg.size:
        phase_deg = 180.0 - (180.0 - phase_deg - np.rad2deg(np.angle(factor))) % 360.0
    return {**_scaled(curve, factor), "phase_deg": phase_deg.tolist()}


def _scaled(table: Mapping[str, Any], factor: Any) -> dict[str, Any]:
    """Return a table with its columns of sensitivities multiplied by the factor's magnitude."""
    size = np.abs(factor)
    scaled = {
        name: (np.array(table[name], dtype=float) * size).tolist()
        for name in _SENSITIVITY_COLUMNS
        if table.get(name)
    }
    return {**table, **scaled}


def with_even_excerpts(document: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a document whose excerpts have start, interval and values in place of times."""
    signals = document.get("signals")
    if not isinstance(signals, list | tuple):
        return document
    return {**document, "signals": [_with_even_excerpt(signal) for signal in signals]}


def _with_even_excerpt(signal: Any) -> Any:
    """Return a signal with evenly spaced samples, NaN where one is missing.

    A signal in another form is returned as it is.
    """
    if not isinstance(signal, Mapping) or "time_s" not in signal or "start_s" in signal:
        return signal
    columns = [signal["time_s"], signal["measured"], signal["predicted"]]
    if len(set(map(len, columns))) != 1:
        raise ValueError(f"the parts of the signal {signal['record']!r} differ in length")
    time_s, measured, predicted = (np.array(column, dtype=float) for column in columns)
    steps = np.diff(time_s)
    steps = steps[np.isfinite(steps) & (steps > 0.0)]
    interval_s = float(np.median(steps)) if steps.size else 0.0
    start_s = float(time_s[0]) if time_s.size else 0.0
    position = np.floor((time_s - start_s) / (interval_s or 1.0) + 0.5)
    usable = (position >= 0.0) & (position < MAX_EXCERPT_SAMPLES)
    index = position[usable].astype(int)
    samples = np.full((2, int(index.max(initial=-1)) + 1), np.nan)
    samples[:, index] = measured[usable], (measured - predicted)[usable]
    unchanged = {name: signal[name] for name in signal if name not in ("time_s", "predicted")}
    return {
        **unchanged,
        "start_s": start_s,
        "interval_s": interval_s,
        "measured": samples[0].tolist(),
        "residual": samples[1].tolist(),
    }
