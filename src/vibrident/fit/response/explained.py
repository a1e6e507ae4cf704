"""How much of a response the model explains, beside how much of it the motion makes.

The verdict by bands takes what the model leaves for noise, and a model that explains nothing leaves everything. So what
it leaves is compared with what has nothing in common with the reference, (1 − γ²) Σ|Y|² of a band (γ² the coherence;
Bendat & Piersol 2010, sec. 6.1). That needs no model. It is never less than the noise: a response that changes within a
band, free motion and noise of the reference add to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.tails import f_tail
from vibrident.data.records import FloatArray, Record
from vibrident.fit.response.alignment import aligned, bulk_delay, whitened
from vibrident.fit.response.bands import FEWEST_LINES, INDEPENDENT, LEAST_POWER, band_edges, windowed_spectra
from vibrident.fit.response.transform import hann, power_of

#: A band shows the response to the motion where at least this part of it is coherent with the reference.
COHERENT = 0.5
#: … and one without any motion would be so with a chance below this.
BY_CHANCE = 1e-4
#: A fit that leaves more than this part of the responses' power says nothing in favour of its model.
MOST_LEFT = 0.5
#: A model that leaves less than this part of the response's power explains it as far as this test tells …
LEAST_LEFT = 0.01
#: … or less than so many times what is not coherent …
TIMES = 4.0
#: … or what chance leaves with more than this probability.
CHANCE = 1e-6


@dataclass(frozen=True)
class Unexplained:
    """What a model leaves of the responses, in the bands that the motion shows in.

    Attributes:
        left: part of the responses' power that the model leaves.
        incoherent: part of it that has nothing in common with the reference.
    """

    left: float
    incoherent: float


def unexplained(records: Sequence[Record], predicted: Sequence[FloatArray]) -> Unexplained | None:
    """What the model leaves of the responses that noise cannot be; None where it leaves no more than that.

    Args:
        records: with a reference, no sines.
        predicted: response that the model predicts for each, shape (samples,), NaN where it is not defined.
    """
    parts = []
    for record, series in zip(records, predicted, strict=True):
        assert record.reference is not None
        used = record.mask & record.reference_mask & np.isfinite(series)
        if used.sum() >= 8:
            left = np.where(used, record.response - series, 0.0)
            parts.append((replace(record, valid=used, reference_valid=None), left))
    if part_left(records, predicted) < LEAST_LEFT:
        return None
    white = [found for part in parts if (found := _whitened(*part)) is not None]
    looks = (_compared(look) for look in (parts, white) if look)
    return next((found for found in looks if found is not None), None)


def part_left(records: Sequence[Record], predicted: Sequence[FloatArray]) -> float:
    """Mean square of the responses' deviations from the prediction, each over its response's; zero without records."""
    parts = []
    for record, series in zip(records, predicted, strict=True):
        used = record.mask & np.isfinite(series)
        response = record.response[used]
        if used.any():
            parts.append(float(np.var(response - series[used]) / max(float(np.var(response)), np.finfo(float).tiny)))
    return float(np.mean(parts or [0.0]))


def _compared(parts: Sequence[tuple[Record, FloatArray]]) -> Unexplained | None:
    left, incoherent, whole, freedom = np.concatenate([_bands(record, left) for record, left in parts], axis=1)
    total, noise, power = (float(np.sum(one)) for one in (left, incoherent, whole))
    if total <= max(LEAST_LEFT * power, TIMES * noise):
        return None
    # Sums of a few strong bands have few degrees of freedom (Satterthwaite 1946).
    own = noise**2 / max(float(np.sum(incoherent**2 / freedom)), np.finfo(float).tiny)
    own = max(own, float(np.min(freedom)))
    if f_tail(own, own, total / max(noise, np.finfo(float).eps * total)) > CHANCE:
        return None
    return Unexplained(total / power, noise / power)


def _whitened(record: Record, left: FloatArray) -> tuple[Record, FloatArray] | None:
    """Record and what is left of its response, through the filter that whitens the response."""
    white, rest = whitened(record), whitened(replace(record, reference=left))
    return None if white is None or rest is None or rest.reference is None else (white, rest.reference)


def _bands(record: Record, left: FloatArray) -> FloatArray:
    """By coherent band: power left, incoherent power, both over the record's; the latter; degrees of freedom.

    Shape (4, bands).
    """
    late = bulk_delay([record], record.samples)
    moved, rest = aligned(record, late), aligned(replace(record, response=left), late)
    assert moved.reference is not None
    mask = moved.mask
    window = mask * (np.ones(moved.samples) if record.excitation == "shock" else hann(moved.samples))
    x, y, e = windowed_spectra((moved.reference, moved.response, rest.response), mask, window)
    edges = band_edges(moved.samples, moved.sampling_rate_hz).astype(int)
    lines = np.diff(edges)
    xx, yy, ee = (np.add.reduceat(power_of(v[: edges[-1]]), edges[:-1]) for v in (x, y, e))
    cross = power_of(np.add.reduceat((y * np.conj(x))[: edges[-1]], edges[:-1]))
    share = np.divide(cross, xx * yy, out=np.zeros_like(xx), where=xx * yy > 0.0)
    freedom = np.maximum(INDEPENDENT * lines - 1.0, 1.0)
    least = np.maximum(COHERENT, 1.0 - BY_CHANCE ** (1.0 / freedom))
    shown = (share > least) & (xx > LEAST_POWER * np.max(xx / lines) * lines) & (lines >= FEWEST_LINES)
    whole = max(float(np.sum(yy)), np.finfo(float).tiny)
    incoherent = (1.0 - share) * yy * lines / np.maximum(lines - 1.0, 1.0)
    # A prediction from noise of the reference leaves more than the response was: it counts as all of it.
    return np.stack([np.minimum(ee, yy) / whole, incoherent / whole, yy / whole, 2.0 * freedom])[:, shown]
