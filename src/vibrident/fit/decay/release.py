"""Where in a record the free motion begins, and about which one it is.

A record may begin inside the motion, or long before it: at rest, held aside, or under the knock that starts it. What
lies before the release is not free motion, so a window that includes it cannot be fitted by one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_length
from vibrident.base.tails import chi2_tail
from vibrident.data.records import FloatArray, Record
from vibrident.fit.decay.motion import DecayFit, Stretch, fit, free_motion, shortened

SURELY_FREE = (
    0.7  # the last sample of at least this part of the largest deviation lies after the release
)
#: Damping ratios tried at every frequency.
DAMPING_GRID = (3e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0, 1.5, 2.5, 4.0, 8.0)
MOST_POINTS = 3000  # most samples of a trial
LARGER = 3.0  # a window is no free motion where its residual exceeds that of the windows after the release by so much
FEWEST = 16  # fewest samples of a window
ABRUPT = 0.08  # a release is abrupt: a residual below this part of the motion may be the sensor's own bend
ALIEN = 0.01  # one or two first samples are not of the motion below this probability: leaving them out costs little
ALIEN_LATER = 5e-4  # the probability where more are left out


def free_stretch(record: Record) -> DecayFit:
    """The free part of a record, fitted with equal weights.

    ``record``: screened, with a response that changes.
    """
    valid = record.mask
    index = np.arange(record.samples)
    response = np.interp(index, index[valid], record.response[valid])
    whole = Stretch(record.name, 0, response, np.array(valid), record.sampling_rate_hz)
    tail = float(np.median(response[-max(8, response.size // 10) :]))
    away = np.abs(response - tail)
    safe = int(np.flatnonzero(away >= SURELY_FREE * np.max(away))[-1])
    safe = min(safe, response.size - min(response.size, 4 * FEWEST))
    found = started(shortened(whole, safe))
    whole = replace(whole, scale=found.stretches[0].scale)
    extended = found.again(shortened(whole, _extended(whole, found, safe)))
    first = extended.stretches[0].first
    for sooner in sorted({0, _onset(response)}):
        if sooner < first and _as_good(
            trial := started(shortened(whole, sooner), whole.scale), extended
        ):
            return trial
    return extended


def _onset(response: FloatArray) -> int:
    """First sample that differs significantly from the initial level of the record."""
    block = max(8, response.size // 50)
    level = float(np.median(response[:block]))
    spread = float(np.ptp(response[:block]))
    return int(np.argmax(np.abs(response - level) > 1.5 * spread))


def _as_good(sooner: DecayFit, later: DecayFit) -> bool:
    """Whether the motion before a later beginning is explained as well as the remainder: it may hold a fast pole."""
    ahead = later.stretches[0].first - sooner.stretches[0].first
    residual, level = sooner.residual, _swing(later.residual)
    if _swing(residual[ahead:]) > 1.1 * level:
        return False
    width = max(FEWEST, ahead // 8)
    pieces = (residual[k : k + width] for k in range(0, max(ahead, 1), width))
    return max(map(_swing, pieces)) < 2.0 * level


def started(stretch: Stretch, scale: float | None = None) -> DecayFit:
    """The best fit from a grid of starts; ``scale``: of equal weights, None for what the best start leaves."""
    costs = []
    points = _points(stretch.response.size)
    time, values = points / stretch.rate_hz, stretch.response[points]
    total = float(np.sum((values - values.mean()) ** 2)) or 1.0
    for frequency in _frequencies(stretch):
        for damping in DAMPING_GRID:
            natural = frequency / np.sqrt(1.0 - damping**2) if damping < 0.9 else frequency
            columns = np.concatenate(
                [free_motion(natural, damping, time), np.ones((time.size, 1))], axis=1
            )
            columns /= np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
            matrix = columns.T @ columns + 1e-12 * np.eye(3)
            explained = columns.T @ values
            misfit = float(values @ values - explained @ np.linalg.solve(matrix, explained))
            costs.append((misfit / total, natural, damping))
    costs.sort()
    best: list[tuple[float, float, float]] = []
    for candidate in costs:
        if all(
            abs(np.log(candidate[1] / b[1])) > 0.1 or abs(np.log(candidate[2] / b[2])) > 1.5
            for b in best
        ):
            best.append(candidate)
        if len(best) == 3:
            break
    left = np.sqrt(max(costs[0][0], np.finfo(float).eps) * total / time.size)
    weighed = replace(stretch, scale=scale or float(left))
    return min(
        (fit([weighed], natural, damping) for _, natural, damping in best), key=lambda one: one.cost
    )


def _points(samples: int) -> np.ndarray:
    """Samples for the grid: every one at the beginning, where the motion is, fewer later."""
    if samples <= MOST_POINTS:
        return np.arange(samples)
    near = np.arange(MOST_POINTS // 3)
    return np.unique(
        np.concatenate([near, np.linspace(0, samples - 1, 2 * MOST_POINTS // 3).astype(int)])
    )


def _frequencies(stretch: Stretch) -> FloatArray:
    """The highest peaks of the spectrum, and a grid over all frequencies."""
    values = stretch.response - stretch.response[-max(8, stretch.response.size // 10) :].mean()
    size = fast_length(4 * values.size)
    power = np.abs(np.asarray(fft.rfft(values, size)))
    tops = np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])) + 1
    tops = tops[np.argsort(power[tops])[::-1][:5]]
    low, high = 0.2 * stretch.rate_hz / values.size, 0.48 * stretch.rate_hz
    return np.concatenate([tops * stretch.rate_hz / size, np.geomspace(low, high, 40)])


def _extended(whole: Stretch, found: DecayFit, safe: int) -> int:
    """First sample of the motion, looked for backwards from one that surely belongs to it."""
    length = _window(found)
    offset = float(found.parts[0].linear[2])
    motion = free_motion(*found.values, np.arange(length) / whole.rate_hz)
    basis = np.linalg.qr(motion / np.maximum(np.linalg.norm(motion, axis=0), 1e-300))[0]
    values = whole.response - offset

    def misfit(first: int) -> float:
        window = values[first : first + length]
        return float(np.sqrt(np.mean((window - basis @ (basis.T @ window)) ** 2)))

    step = max(1, length // 8)
    after = [misfit(k) for k in range(safe, min(safe + 4 * length, values.size - length) + 1, step)]
    if not after:
        return safe
    scale = float(np.median(after))
    first = safe
    while first > 0:
        trial = max(0, first - step)
        if misfit(trial) > max(LARGER * scale, ABRUPT * _swing(values[trial : trial + length])):
            return first
        first = trial
    return 0


def trimmed(found: DecayFit) -> DecayFit:
    """Without the samples at the beginning that the motion does not reach.

    Nested fits, with and without the first samples, differ in cost by a χ² of as many degrees of freedom as samples
    were left out, if those belong to the motion. The noise must be known.
    """
    most, gone = _window(found) // 2 + 2, 0
    while gone < most and found.stretches[0].response.size - most >= 4 * FEWEST:
        shorter = _without_alien(found, most)
        if shorter is None:
            break
        gone += shorter.stretches[0].first - found.stretches[0].first
        found = shorter
    return found


def without_first(found: DecayFit) -> DecayFit:
    """Without the first sample, within which the release may lie."""
    if found.stretches[0].response.size < 4 * FEWEST:
        return found
    return found.again(shortened(found.stretches[0], 1))


def _without_alien(found: DecayFit, most: int) -> DecayFit | None:
    """The fit without the fewest first samples that do not belong to it; None where all do."""
    for count in np.unique(np.geomspace(1, most, 8).astype(int)):
        trial = found.again(shortened(found.stretches[0], int(count)))
        rows = len(found.residual) - len(trial.residual)
        rare = ALIEN if count <= 2 else ALIEN_LATER
        if rows > 0 and chi2_tail(rows, max(found.cost - trial.cost, 0.0)) < rare:
            return trial
    return None


def _window(found: DecayFit) -> int:
    """Samples over which the motion changes: a period, or the slow time constant of a heavily damped sensor."""
    stretch = found.stretches[0]
    natural, damping = found.values
    length = stretch.rate_hz / natural * max(1.0, 1.5 * damping)
    return int(np.clip(round(length), FEWEST, max(FEWEST, stretch.response.size // 3)))


def _swing(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
