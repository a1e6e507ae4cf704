"""The release: where in a record the free motion begins, and a first fit of it.

A record may begin inside the motion, or long before it: at rest, held aside, or under the knock
that starts it. No free motion fits a window that includes samples before the release.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_length
from vibrident.base.tails import chi2_tail
from vibrident.data.records import FloatArray, Record
from vibrident.fit.decay.motion import (
    DecayFit,
    Stretch,
    fit,
    free_motion,
    pole_columns,
    shortened,
)
from vibrident.fit.decay.noise import tone_columns

#: The last sample whose deviation is at least this fraction of the largest is after the release.
FREE_FRACTION = 0.7
#: Damping ratios that are tried at every frequency.
DAMPING_GRID = (3e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0, 1.5, 2.5, 4.0, 8.0)
#: Most samples of a trial.
MAX_POINTS = 3000
#: A window is no free motion if its residual exceeds that after the release by this factor.
MAX_MISFIT_RATIO = 3.0
#: The amplitude of a motion that goes on falls by less than this, in logarithm, over a record.
MIN_FALL = 0.5
#: Fewest samples of a window.
MIN_SAMPLES = 16
#: A release is abrupt: a residual below this fraction of the motion may be a nonlinearity.
MIN_RELEASE_MISFIT = 0.08
#: One or two first samples are left out below this probability, as they cost little information …
FOREIGN_PROBABILITY = 0.01
#: … and more of them below this one.
FOREIGN_PROBABILITY_OF_MORE = 5e-4


def free_stretch(record: Record, channel_poles: tuple[complex, ...] = ()) -> DecayFit:
    """Return the fit, with equal weights, of the free part of a record.

    Args:
        record: screened, with a response that changes.
        channel_poles: of the recording channel, 1/s.
    """
    valid = record.mask
    index = np.arange(record.samples)
    response = np.interp(index, index[valid], record.response[valid])
    complete = Stretch(
        record.name,
        0,
        response,
        np.array(valid),
        record.sampling_rate_hz,
        drift=True,
        channel_poles=channel_poles,
    )
    tail = float(np.median(response[-max(8, response.size // 10) :]))
    deviation = np.abs(response - tail)
    safe = int(np.flatnonzero(deviation >= FREE_FRACTION * np.max(deviation))[-1])
    safe = min(safe, response.size - min(response.size, 4 * MIN_SAMPLES))
    decay = _beside_hum(started(shortened(complete, safe)))
    (stretch,) = decay.stretches
    complete = replace(complete, scale=stretch.scale, noise=stretch.noise)
    extended = decay.refitted(shortened(complete, _extended(complete, decay, safe)))
    first = extended.stretches[0].first
    for earlier in sorted({0, _onset(response)}):
        if earlier < first:
            trial = started(shortened(complete, earlier), complete.scale)
            if _as_good(trial, extended):
                return trial
    if channel_poles:  # their free motion imitates the samples right before the release
        return extended.refitted(shortened(extended.stretches[0], _window(extended) // 4))
    return extended


def _beside_hum(decay: DecayFit) -> DecayFit:
    """Return the fit of what dies away beside a motion that goes on, or the fit of that motion."""
    (stretch,) = decay.stretches
    if _fall(decay) > MIN_FALL:
        return decay
    tones = replace(stretch.noise, tones_hz=(*stretch.noise.tones_hz, decay.values[0]))
    trial = started(replace(stretch, noise=tones), stretch.scale)
    dies_away = _fall(trial) > MIN_FALL and trial.cost < 0.5 * decay.cost
    return trial if dies_away else decay


def _fall(decay: DecayFit) -> float:
    """Return by how much the logarithm of the amplitude falls over the stretch."""
    natural, damping = decay.values
    return float(2.0 * np.pi * natural * damping * decay.stretches[0].time_s[-1])


def _onset(response: FloatArray) -> int:
    """Return the first sample that differs significantly from the initial level of the record."""
    block = max(8, response.size // 50)
    level = float(np.median(response[:block]))
    spread = float(np.ptp(response[:block]))
    return int(np.argmax(np.abs(response - level) > 1.5 * spread))


def _as_good(earlier: DecayFit, later: DecayFit) -> bool:
    """Return whether a fit explains the motion before a later beginning as well as the remainder.

    That motion may hold a fast pole.
    """
    ahead = later.stretches[0].first - earlier.stretches[0].first
    residual = earlier.residual
    level = _rms(later.residual)
    if _rms(residual[ahead:]) > 1.1 * level:
        return False
    width = max(MIN_SAMPLES, ahead // 8)
    pieces = (residual[k : k + width] for k in range(0, max(ahead, 1), width))
    return max(map(_rms, pieces)) < 2.0 * level


def started(stretch: Stretch, scale: float | None = None) -> DecayFit:
    """Return the best fit from a grid of starts.

    Args:
        stretch: of free motion.
        scale: of equal weights; None for the residual of the best start.
    """
    costs = []
    points = _points(stretch.response.size)
    time = points / stretch.rate_hz
    further = stretch.nuisance_columns()[points]
    values = stretch.response[points]
    total = float(np.sum((values - values.mean()) ** 2)) or 1.0
    for frequency in _frequencies(stretch):
        for damping in DAMPING_GRID:
            natural = frequency / np.sqrt(1.0 - damping**2) if damping < 0.9 else frequency
            columns = np.concatenate([free_motion(natural, damping, time), further], axis=1)
            columns /= np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
            matrix = columns.T @ columns + 1e-12 * np.eye(columns.shape[1])
            explained = columns.T @ values
            misfit = float(values @ values - explained @ np.linalg.solve(matrix, explained))
            costs.append((misfit / total, natural, damping))
    costs.sort()
    best: list[tuple[float, float]] = []
    for _, natural, damping in costs:
        if all(
            abs(np.log(natural / best_natural)) > 0.1 or abs(np.log(damping / best_damping)) > 1.5
            for best_natural, best_damping in best
        ):
            best.append((natural, damping))
        if len(best) == 3:
            break
    residual_rms = np.sqrt(max(costs[0][0], np.finfo(float).eps) * total / time.size)
    weighted = replace(stretch, scale=scale or float(residual_rms))
    return min(
        (fit([weighted], natural, damping) for natural, damping in best),
        key=lambda decay: decay.cost,
    )


def _points(samples: int) -> np.ndarray:
    """Return samples for the grid: all at the beginning, where the motion is, fewer later."""
    if samples <= MAX_POINTS:
        return np.arange(samples)
    near = np.arange(MAX_POINTS // 3)
    return np.unique(
        np.concatenate([near, np.linspace(0, samples - 1, 2 * MAX_POINTS // 3).astype(int)])
    )


def _frequencies(stretch: Stretch) -> FloatArray:
    """Return the highest peaks of the spectrum, and a grid over all frequencies."""
    values = stretch.response - stretch.response[-max(8, stretch.response.size // 10) :].mean()
    size = fast_length(4 * values.size)
    power = np.abs(fft.rfft(values, size))
    tops = np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])) + 1
    tops = tops[np.argsort(power[tops])[::-1][:5]]
    low = 0.2 * stretch.rate_hz / values.size
    high = 0.48 * stretch.rate_hz
    return np.concatenate([tops * stretch.rate_hz / size, np.geomspace(low, high, 40)])


def _extended(complete: Stretch, decay: DecayFit, safe: int) -> int:
    """Return the first sample of the motion, searched backwards from a sample inside it."""
    length = _window(decay)
    place = (np.arange(complete.response.size) - safe) / (complete.response.size - 1 - safe)
    linear = decay.parts[0].linear
    hum = tone_columns(complete.noise.tones_hz, complete.time_s - complete.time_s[safe])
    time_s = np.arange(length) / complete.rate_hz
    motion = np.hstack(
        [free_motion(*decay.values, time_s), pole_columns(complete.channel_poles, time_s)]
    )
    basis = np.linalg.qr(motion / np.maximum(np.linalg.norm(motion, axis=0), 1e-300))[0]
    values = complete.response - linear[2] - linear[3] * (place - 0.5)
    values -= hum @ linear[linear.size - hum.shape[1] :]

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
        if misfit(trial) > max(
            MAX_MISFIT_RATIO * scale, MIN_RELEASE_MISFIT * _rms(values[trial : trial + length])
        ):
            return first
        first = trial
    return 0


def trimmed(decay: DecayFit) -> DecayFit:
    """Return the fit without the samples at the beginning that do not belong to the motion.

    If the first samples belong to it, the costs with and without them differ by a χ² of as many
    degrees of freedom as samples were left out. The noise must be known.
    """
    limit = _window(decay) // 2 + 2
    removed = 0
    while removed < limit and decay.stretches[0].response.size - limit >= 4 * MIN_SAMPLES:
        shorter = _without_foreign(decay, limit)
        if shorter is None:
            break
        removed += shorter.stretches[0].first - decay.stretches[0].first
        decay = shorter
    return decay


def without_first(decay: DecayFit) -> DecayFit:
    """Return the fit without the first sample, within which the release may lie."""
    if decay.stretches[0].response.size < 4 * MIN_SAMPLES:
        return decay
    return decay.refitted(shortened(decay.stretches[0], 1))


def _without_foreign(decay: DecayFit, limit: int) -> DecayFit | None:
    """Return the fit without the fewest first samples that do not belong, None if all belong."""
    for count in np.unique(np.geomspace(1, limit, 8).astype(int)):
        trial = decay.refitted(shortened(decay.stretches[0], int(count)))
        rows = len(decay.residual) - len(trial.residual)
        probability = FOREIGN_PROBABILITY if count <= 2 else FOREIGN_PROBABILITY_OF_MORE
        if rows > 0 and chi2_tail(rows, max(decay.cost - trial.cost, 0.0)) < probability:
            return trial
    return None


def _window(decay: DecayFit) -> int:
    """Return the number of samples of a period, or of a heavily damped sensor's slow decay."""
    stretch = decay.stretches[0]
    natural, damping = decay.values
    length = stretch.rate_hz / natural * max(1.0, 1.5 * damping)
    return int(np.clip(round(length), MIN_SAMPLES, max(MIN_SAMPLES, stretch.response.size // 3)))


def _rms(values: FloatArray) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))
