"""Is a drive held between samples, as the stairs of a digital-to-analogue converter are?"""

from __future__ import annotations

import numpy as np

from vibrident.data.records import Calibration

#: Part of the samples that repeat the one before, exactly: each level of a held drive lasts.
MIN_REPEATED = 0.5


def is_held_drive(calibration: Calibration) -> bool:
    """Tell whether every driven record's reference is a drive in stairs.

    Only a commanded signal can be; a motion that repeats is recorded with few bits.
    """
    drives = [r.reference for r in calibration.records if r.reference is not None]
    if calibration.quantity != "drive" or not drives:
        return False
    steps = [np.diff(drive) for drive in drives]
    return all(np.any(step) and np.mean(step == 0.0) >= MIN_REPEATED for step in steps)
