"""The compensated acceleration against a reference's, in the same band."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import FloatArray, Quantity, Record
from vibrident.physics.models.base import DERIVATIVES
from vibrident.use.correction.compensation import Compensation
from vibrident.use.correction.quiet import bridged


@dataclass(frozen=True)
class Agreement:
    """The compensated acceleration against the reference's, away from the record's ends."""

    rmse: float  # against the reference in the same band, m/s²
    nrmse: float | None  # that over the reference's standard deviation
    rmse_unfiltered: float | None  # against the reference as it is; None if the reference is no acceleration
    reference_peak: float  # the reference's sample of largest magnitude, filtered to the band, m/s²
    within_95_percent: float  # part of these samples whose deviation lies within k = 1.96 of its uncertainty


def reference_in_band(record: Record, quantity: Quantity, compensation: Compensation) -> FloatArray | None:
    """The reference as acceleration in the band, shape (samples,)."""
    if record.reference is None or not record.reference_mask.any():
        return None
    values, around = bridged(record.reference, record.reference_mask), compensation.around
    if around.rest_samples:
        values -= np.mean(values[: around.rest_samples])
    else:
        values -= np.average(values, weights=np.hanning(values.size))
    order = DERIVATIVES[quantity]
    rests = replace(around, rests_at_end=around.rests_at_end and order == 0)
    plain = replace(compensation, integrations=0, around=rests)
    gain = plain.lowpass * (2j * np.pi * plain.frequency_hz) ** order
    return plain.restored(plain.spectrum(values), gain)


def agreement_with(
    record: Record,
    quantity: Quantity,
    acceleration: FloatArray,
    components: Mapping[str, FloatArray],
    reference: FloatArray,
) -> Agreement | None:
    """Compare where both are known; None if they never are.

    ``acceleration``: compensated, shape (samples,), NaN where it is not known; ``components``: its standard uncertainty
    by origin; ``reference``: as acceleration in the same band, shape (samples,).
    """
    known = np.isfinite(acceleration) & record.mask & record.reference_mask
    if not known.any():
        return None
    u = np.sqrt(sum(series**2 for series in components.values()))
    inner = known & (components["ends"] <= np.sqrt(np.maximum(u**2 - components["ends"] ** 2, 0.0)))
    known = inner if inner.any() else known  # near its ends the filtered reference is as uncertain
    off = (acceleration - reference)[known]
    deviation = float(np.std(reference[known]))
    rmse = float(np.sqrt(np.mean(off**2)))
    unfiltered = None
    if quantity in ("acceleration", "drive") and record.reference is not None:
        raw = np.asarray(record.reference)[known]
        raw = raw - np.mean(raw - reference[known])
        unfiltered = float(np.sqrt(np.mean((acceleration[known] - raw) ** 2)))
    top = float(reference[known][np.argmax(np.abs(reference[known]))])
    inside = float(np.mean(np.abs(off) <= 1.96 * u[known]))
    return Agreement(rmse, rmse / deviation if deviation > 0 else None, unfiltered, top, inside)
