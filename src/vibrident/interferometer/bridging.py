"""Number of turns of the phase over a gap, from the motion on both sides."""

from __future__ import annotations

import numpy as np

from vibrident.interferometer.ellipse import Ellipse
from vibrident.interferometer.phase import TURN, Gap
from vibrident.interferometer.setting import FloatArray, Signals

#: Samples on either side, in lengths of the gap, tried in turn.
LENGTHS = (1, 4)
#: Fewest samples on either side.
FEWEST = 24
#: Most samples on either side.
MOST = 1 << 14
#: Degrees of the polynomial through both sides.
DEGREES = (3, 5, 7, 9)
#: Largest distance of the step from a whole number of turns, turns.
WHOLE = 0.12
#: Largest uncertainty of the step, turns.
KNOWN = 0.08
#: Largest rms of the residual over the noise.
NOISE = 2.0


def turns(signals: Signals, ellipse: Ellipse, gap: Gap) -> int | None:
    """Turns to add behind a gap to the phase that continues from the nearest turn; None if they cannot be determined.

    A polynomial of time and a step behind the gap are fitted to the phase on both sides. The step of the right
    polynomial is a whole number of turns, which is the check.
    """
    length = gap.stop - gap.start
    for times in LENGTHS:
        width = int(np.clip(times * length, FEWEST, MOST))
        left, right = max(gap.start - width, 0), min(gap.stop + width, signals.samples)
        if gap.start - left < FEWEST // 2 or right - gap.stop < FEWEST // 2:
            return None
        before, after = _phase(signals, ellipse, left, gap.start), _phase(signals, ellipse, gap.stop, right)
        nearest = TURN * np.rint((after[0] - before[-1]) / TURN)
        found = _step(before, after - nearest, left, gap.stop, ellipse.radial_noise)
        if found is not None:
            return found
    return None


def _phase(signals: Signals, ellipse: Ellipse, start: int, stop: int) -> FloatArray:
    v = ellipse.round(signals.block(start, stop))
    return np.unwrap(np.arctan2(v[1], v[0]))


def _step(before: FloatArray, after: FloatArray, left: int, right: int, noise: float) -> int | None:
    time = np.concatenate([left + np.arange(before.size), right + np.arange(after.size)]).astype(float)
    time = 2.0 * (time - time[0]) / (time[-1] - time[0]) - 1.0
    behind = np.concatenate([np.zeros(before.size), np.ones(after.size)])
    phase = np.concatenate([before, after])
    for degree in DEGREES:
        if time.size < 3 * degree:
            return None
        design = np.column_stack([np.polynomial.legendre.legvander(time, degree), behind])
        q, r = np.linalg.qr(design)
        found = np.linalg.solve(r, q.T @ phase)
        rest = float(np.sqrt(np.sum((phase - design @ found) ** 2) / (time.size - degree - 2)))
        u = max(rest, noise, 1e-9) / abs(float(r[-1, -1])) / TURN
        step = float(found[-1]) / TURN
        if rest < NOISE * max(noise, 1e-4) and u < KNOWN and abs(step - round(step)) < WHOLE:
            return -round(step)
    return None
