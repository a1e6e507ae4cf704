"""The value of the reference at rest: its offset, separated from the motion.

The offset of a recorder is not an acceleration. It has no effect with a linear sensor; with a
nonlinear spring it would act as a static load and shift the operating point. What cannot be
separated from the offset of a recorder is not taken for acceleration: the sensor at rest, as it is
mounted, is the middle of its spring.
"""

from __future__ import annotations

import numpy as np

from vibrident.data.records import Record
from vibrident.fit.response.sine_fit import tone_frequency


def offset_of_reference(record: Record) -> float:
    """Return the offset of the reference, in its unit.

    Of a sine it is the constant of a least-squares fit, whatever part of a period the record ends
    with; of a shock the median, as it mostly rests; of other motion the mean.
    """
    assert record.reference is not None
    mask = record.reference_mask
    if not mask.any():
        return 0.0
    values = record.reference[mask]
    if record.excitation == "shock":
        return float(np.median(values))
    if record.excitation != "sine":
        return float(np.mean(values))
    angle = 2.0 * np.pi * tone_frequency(record) * record.time_s[mask]
    design = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1)
    scale = float(np.max(np.abs(values))) or 1.0
    return float(np.linalg.lstsq(design, values / scale, rcond=None)[0][0]) * scale
