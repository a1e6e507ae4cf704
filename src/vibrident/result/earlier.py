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
    """Return the document as this version writes it."""
    return with_even_excerpts(with_stated_quantity(document))


def with_stated_quantity(document: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a document whose curves are per the sensor's own quantity, and which says so.

    Earlier versions wrote them per the reference's quantity. Those of a model that is not installed
    stay so.
    """
    reference = document.get("reference")
    if "sensitivity_per" in document or not isinstance(reference, Mapping):
        return document
    per_reference = reference.get("quantity")
    model = installed(str(document.get("model")))
    if per_reference not in QUANTITIES or model is None:
        return {**document, "sensitivity_per": reference}
    result_quantity = model.stated_quantity(per_reference)
    if result_quantity == per_reference:
        return {**document, "sensitivity_per": reference}
    settings = document["settings"]
    if isinstance(budget := settings.get("point_budget"), Mapping):
        factor = _factor(budget["frequency_hz"], per_reference, result_quantity)
        sources = [_scaled(source, factor) for source in budget["sources"]]
        settings = {**settings, "point_budget": {**budget, "sources": sources}}
    return {
        **document,
        **{
            name: _converted(document[name], per_reference, result_quantity)
            for name in ("response", "measured")
        },
        "settings": settings,
        "sensitivity_per": {"quantity": result_quantity, "unit": REFERENCE_UNITS[result_quantity]},
    }


def _factor(frequency_hz: Any, per: Any, target: Any) -> Any:
    """Return the factor from a response per one quantity to that per another, shape (points,)."""
    return conversion(np.array(frequency_hz, dtype=float), per, target)


def _converted(curve: Mapping[str, Any], per: Any, target: Any) -> dict[str, Any]:
    """Return a curve per the quantity wanted, its phase in (−180°, 180°]."""
    factor = _factor(curve["frequency_hz"], per, target)
    turned = np.array(curve["phase_deg"], dtype=float)
    if turned.size:
        turned = 180.0 - (180.0 - turned - np.rad2deg(np.angle(factor))) % 360.0
    return {**_scaled(curve, factor), "phase_deg": turned.tolist()}


def _scaled(table: Mapping[str, Any], factor: Any) -> dict[str, Any]:
    """Return a part whose columns in the unit of the sensitivity are times the factor's size."""
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
    return {**document, "signals": [_even(signal) for signal in signals]}


def _even(signal: Any) -> Any:
    """Lay an excerpt out evenly, null where a sample is missing; another form stays as it is."""
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
    index = np.floor((time_s - start_s) / (interval_s or 1.0) + 0.5)
    usable = (index >= 0.0) & (index < MAX_EXCERPT_SAMPLES)
    at = index[usable].astype(int)
    samples = np.full((2, int(at.max(initial=-1)) + 1), np.nan)
    samples[:, at] = measured[usable], (measured - predicted)[usable]
    same = {name: value for name, value in signal.items() if name not in ("time_s", "predicted")}
    times = {"start_s": start_s, "interval_s": interval_s}
    return {**same, **times, "measured": samples[0].tolist(), "residual": samples[1].tolist()}
