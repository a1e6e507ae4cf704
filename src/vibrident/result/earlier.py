"""The excerpts of results that earlier versions wrote: a time for each sample, all digits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

MAX_SAMPLES = 100_000  # of an excerpt laid out evenly; earlier versions wrote 600 at most


def excerpts_of_today(document: Mapping[str, Any]) -> Mapping[str, Any]:
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
    places = np.floor((time_s - start_s) / (interval_s or 1.0) + 0.5)
    usable = (places >= 0.0) & (places < MAX_SAMPLES)
    at = places[usable].astype(int)
    samples = np.full((2, int(at.max(initial=-1)) + 1), np.nan)
    samples[:, at] = measured[usable], (measured - predicted)[usable]
    kept = {name: value for name, value in signal.items() if name not in ("time_s", "predicted")}
    known = {"start_s": start_s, "interval_s": interval_s}
    return {**kept, **known, "measured": samples[0].tolist(), "residual": samples[1].tolist()}
