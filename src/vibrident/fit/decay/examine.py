"""Fit and examination of free decays by one linear oscillator.

A sensor whose spring or damping depends on the amplitude still moves like a linear one for a while.
So the motion is compared in pieces of time, as other motion is in bands of frequency. In each piece
the residual has a component along the motion and one across it; where the sensor is linear, their
squares are χ² of two degrees of freedom.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibrident.base.tails import chi2_tail, f_tail
from vibrident.data.records import FloatArray, Record
from vibrident.data.records.basis import resolution
from vibrident.fit.decay.drift import MIN_RISE_DEVIATIONS, significant_rise
from vibrident.fit.decay.motion import (
    DecayFit,
    Stretch,
    basis_of,
    fit,
    free_motion,
    motion_slopes,
    shortened,
    unit,
)
from vibrident.fit.decay.noise import WHITE, Noise, autoregression, tones_of, without_columns
from vibrident.fit.decay.release import free_stretch, trimmed, without_first
from vibrident.fit.decay.second_mode import SecondMode, with_second_mode
from vibrident.fit.optimise import Progress, silent
from vibrident.fit.response.verdict import REJECTION

#: Most pieces of time that are compared, and fewest samples of each.
MAX_PIECES = 12
MIN_SAMPLES = 8
#: Where the motion lasts for less than this fraction of the record, the remainder is noise.
MAX_MOTION_FRACTION = 0.6
#: Fewest steps of a coarse recorder in a motion; the rounding errors of a smaller motion follow it.
MIN_STEPS = 6.0
#: Fractions of a decay at which its beginning is compared with its end.
SPLITS = (0.1, 0.25, 0.5)
#: Beginning and end of a decay differ below this probability.
CHANGE_PROBABILITY = 1e-4
#: Other columns span a column if they leave less than this fraction of its square.
MIN_INDEPENDENT = 1e-6


@dataclass(frozen=True)
class MotionMisfit:
    """Misfit of a decay along its motion.

    Attributes:
        chi2: sum of squares of the residual along the motion, in units of the noise.
        degrees: of freedom, two a piece less those of initial state, offset and drift.
        freedom: degrees of freedom of the noise.
    """

    chi2: float
    degrees: int
    freedom: float


@dataclass(frozen=True)
class OscillatorChange:
    """Change of the oscillator between the beginning and the end of a decay.

    Attributes:
        record: name of the record.
        frequency_hz: natural frequency at the beginning and at the end.
        damping: damping ratio at the beginning and at the end.
        amplitude: rms of the motion there, response unit.
    """

    record: str
    frequency_hz: tuple[float, float]
    damping: tuple[float, float]
    amplitude: tuple[float, float]

    @property
    def words(self) -> str:
        """Return the sentence on the change."""
        f0, f1 = self.frequency_hz
        d0, d1 = self.damping
        a0, a1 = self.amplitude
        return (
            f"{self.record}: the oscillation changes as it dies away: natural frequency "
            f"{f0:.6g} Hz at the beginning (rms {a0:.3g}) and {f1:.6g} Hz at the end "
            f"(rms {a1:.3g}), {100 * (f1 / f0 - 1):+.2g} %; damping ratio {d0:.4g} and {d1:.4g}. "
            "Spring or damping depends on the amplitude; one value for both is a mean."
        )


@dataclass(frozen=True, eq=False)
class Decays:
    """Free decays fitted by one oscillator.

    Attributes:
        fit: of all decays together.
        changes: of the records in which beginning and end differ.
        second_modes: of the records that two linear modes explain, and one does not.
    """

    fit: DecayFit
    changes: tuple[OscillatorChange, ...]
    second_modes: tuple[SecondMode, ...] = ()

    @property
    def freedom(self) -> float:
        """Return the degrees of freedom of the noise."""
        return float(
            len(self.fit.residual) - sum(stretch.spanned.shape[1] for stretch in self.fit.parts) - 2
        )

    def as_settings(self) -> dict[str, Any]:
        """Return an entry for each record, for a result."""
        entries = [
            {
                "record": stretch.name,
                "begins_s": stretch.first / stretch.rate_hz,
                "samples": int(stretch.response.size),
                "noise": stretch.scale,
                "noise_order": len(stretch.noise.whitening) - 1,
                "tones_hz": list(stretch.noise.tones_hz),
                "chi2": misfit.chi2,
                "degrees_of_freedom": misfit.degrees,
            }
            for stretch, misfit in zip(self.fit.stretches, misfits_of(self.fit), strict=True)
        ]
        return {"decays": entries}


def examine(
    records: Sequence[Record],
    progress: Progress = silent,
    channel_poles: tuple[complex, ...] = (),
) -> Decays:
    """Return the fit of one oscillator to free decays, and the changes within them.

    Args:
        records: screened, of excitation ``decay``.
        progress: called at every step of the last descents.
        channel_poles: of the recording channel, 1/s.
    """
    starts = [weighed(free_stretch(record, channel_poles)) for record in records]
    stretches = [start.stretches[0] for start in starts]
    fits = (fit(stretches, *start.values, progress) for start in starts)
    best = min(fits, key=lambda candidate: candidate.cost)
    second_modes = tuple(filter(None, map(second_mode_of, starts)))
    if second_modes:
        return Decays(best, (), second_modes)
    changes = tuple(filter(None, map(change_of, starts)))
    if not changes and len(starts) > 1:  # too small for one decay to show
        largest = max(starts, key=lambda start: float(np.max(np.abs(start.free()))))
        changes = tuple(filter(None, [change_of(largest, _chance_of_bend(best))]))
    return Decays(best, changes)


def verdict(misfits: Sequence[MotionMisfit]) -> tuple[float, int, bool]:
    """Return χ² of decays, its degrees of freedom, and whether one linear oscillator suffices."""
    chi2 = sum(misfit.chi2 for misfit in misfits)
    degrees = sum(misfit.degrees for misfit in misfits) - 2
    freedom = sum(misfit.freedom for misfit in misfits)
    chance = f_tail(degrees, freedom, chi2 / degrees) if degrees > 0 else 1.0
    return chi2, degrees, chance >= REJECTION


def second_mode_of(decay: DecayFit) -> SecondMode | None:
    """Return the second mode that explains what one leaves of a decay; None where none does."""
    if verdict(misfits_of(decay))[-1]:
        return None
    two_modes = with_second_mode(decay)
    if two_modes is None:
        return None
    first_mode, second_mode = two_modes
    return second_mode if verdict(misfits_of(first_mode))[-1] else None


def weighed(decay: DecayFit) -> DecayFit:
    """Return the fit of one record, weighted by its noise, with a drift if that is significant."""
    for _ in range(2):
        decay = trimmed(_with_drift(decay, _with_noise(decay)))
    return without_first(decay)


def _with_noise(decay: DecayFit) -> Stretch:
    """Return the stretch of a fit with the noise of its flexible residual."""
    stretch = decay.stretches[0]
    frequency = decay.values[0]
    residual = _flexible_residual(decay)
    live_s = _live_s(decay)
    known_hz = stretch.noise.tones_hz
    end = int(live_s * stretch.rate_hz)
    motion_hz = (max(0.0, frequency - 3.0 / live_s), frequency + 3.0 / live_s)
    fitted = 2 * len(_edges(decay)) + 1
    begin = 0  # of the samples that show the noise
    if end < MAX_MOTION_FRACTION * residual.size:
        begin = end
        motion_hz = (0.0, 0.0)  # the motion has ended: any line is a tone
        fitted = 1
    tones = tones_of(residual[begin:], stretch.rate_hz, motion_hz, known_hz)
    white = replace(WHITE, tones_hz=tones)
    nuisances = replace(stretch, noise=white, drift=False).nuisance_columns()
    residual = without_columns(residual, nuisances)
    coarse = resolution(stretch.response[stretch.valid]) / np.sqrt(12.0)
    if np.std(residual[begin:]) < 1.5 * coarse:
        # At rest a coarse recorder shows a constant, not its noise.
        moving = _while_larger(decay, MIN_STEPS * np.sqrt(12.0) * coarse)
        spread = float(np.sqrt(np.mean(residual[: moving.response.size][moving.valid] ** 2)))
        return replace(moving, noise=white, scale=max(coarse, spread))
    noise = Noise(autoregression(residual[begin:]), tones)
    with_noise = replace(stretch, noise=noise, scale=1.0)
    counted = with_noise.rows[begin:]
    whitened = noise.applied(residual[:, None])[begin:][counted][:, 0]
    scale = float(np.sqrt(np.sum(whitened**2) / max(whitened.size - fitted, 1)))
    rounding = np.finfo(float).eps * float(np.max(np.abs(stretch.response)))
    return replace(with_noise, scale=max(scale, rounding, np.finfo(float).tiny))


def _while_larger(decay: DecayFit, level: float) -> Stretch:
    """Return the stretch up to the last swing of its motion beyond a level."""
    stretch = decay.stretches[0]
    larger = np.flatnonzero(np.abs(decay.free()) > level)
    last = int(larger[-1]) + 1 if larger.size else stretch.response.size
    return shortened(stretch, 0, last) if last > 4 * MIN_SAMPLES else stretch


def _with_drift(decay: DecayFit, stretch: Stretch) -> DecayFit:
    """Return the fit of a stretch, with a straight line among the unknowns if significant."""
    still, drifting = (decay.refitted(replace(stretch, drift=drift)) for drift in (False, True))
    return drifting if still.cost - drifting.cost > MIN_RISE_DEVIATIONS**2 else still


def _live_s(decay: DecayFit, index: int = 0) -> float:
    """Return the time from the beginning of a stretch to the last motion above the noise.

    Above the noise is above three tenths of its standard deviation.
    """
    stretch = decay.stretches[index]
    residual = decay.parts[index].residual
    motion = np.abs(decay.free(index))
    level = float(np.sqrt(np.mean(residual**2))) * stretch.scale * 0.3
    exceeds = np.flatnonzero(motion > max(level, 1e-6 * float(np.max(motion))))
    last = int(exceeds[-1]) if exceeds.size else stretch.response.size - 1
    return (last + 1) / stretch.rate_hz


def _edges(decay: DecayFit, index: int = 0) -> list[tuple[int, int]]:
    """Return the first sample of each piece of the motion, and the sample after the last."""
    stretch = decay.stretches[index]
    live_s = _live_s(decay, index)
    count = int(np.clip(2.0 * live_s * decay.values[0], 2, MAX_PIECES))
    samples = min(stretch.response.size, int(np.ceil(live_s * stretch.rate_hz)))
    count = max(1, min(count, samples // MIN_SAMPLES))
    ends = np.linspace(0, samples, count + 1).astype(int)
    return [(int(a), int(b)) for a, b in itertools.pairwise(ends)]


def _pieces(decay: DecayFit, index: int = 0) -> FloatArray:
    """Return the motion within each piece, zero elsewhere, shape (samples, at most 2 pieces)."""
    motion = free_motion(*decay.values, decay.stretches[index].time_s)
    edges = _edges(decay, index)
    spans = [((first, len(motion) - last), basis_of(motion[first:last])) for first, last in edges]
    return np.hstack([np.pad(piece, (rows, (0, 0))) for rows, piece in spans])


def _flexible_residual(decay: DecayFit) -> FloatArray:
    """Return the residual with separate amplitude and phase for every piece, shape (samples,).

    It shows the noise, as it holds almost no misfit of the oscillator.
    """
    stretch = decay.stretches[0]
    flexible = replace(
        stretch, noise=replace(WHITE, tones_hz=stretch.noise.tones_hz), scale=1.0, drift=True
    )
    problem = replace(decay.problem, stretches=(flexible,))
    pieces = _pieces(replace(decay, problem=problem))
    columns = np.concatenate([pieces, flexible.nuisance_columns()], axis=1)
    valid = flexible.valid
    linear = np.linalg.lstsq(columns[valid], flexible.response[valid], rcond=None)[0]
    return np.where(valid, flexible.response - columns @ linear, 0.0)


def _score(residual: FloatArray, columns: FloatArray, spanned: FloatArray) -> tuple[float, int]:
    """Return χ² of a whitened residual along columns, and its degrees of freedom.

    Source: the score test of Rao 1948.

    Args:
        residual: shape (rows,).
        columns: to be tested, of unit length, shape (rows, m).
        spanned: orthonormal basis of the nuisance columns, shape (rows, n).
    """
    free = columns - spanned @ (spanned.T @ columns)
    values, vectors = np.linalg.eigh(free.T @ free)
    independent = values > MIN_INDEPENDENT
    components = (vectors[:, independent].T @ (free.T @ residual)) / np.sqrt(values[independent])
    return float(components @ components), int(independent.sum())


def misfits_of(decay: DecayFit) -> tuple[MotionMisfit, ...]:
    """Return the misfit of each stretch along its motion, beside the best nuisance parameters."""
    misfits = []
    for index, (stretch, projected) in enumerate(zip(decay.stretches, decay.parts, strict=True)):
        pieces = basis_of(stretch.whitened(_pieces(decay, index)))
        freedom = max(len(projected.residual) - pieces.shape[1] - projected.spanned.shape[1], 1)
        misfits.append(
            MotionMisfit(*_score(projected.residual, pieces, projected.spanned), float(freedom))
        )
    return tuple(misfits)


def change_of(decay: DecayFit, together: float = 1.0) -> OscillatorChange | None:
    """Return the change of the oscillator from the beginning of a decay to its end, if significant.

    Score tests are made of a step in natural frequency and damping ratio beside a step of all
    nuisance parameters, and of the components that depend on the amplitude.

    Args:
        decay: fit of one decay by itself.
        together: probability of as much change with the amplitude in several decays with this one.
    """
    stretch = decay.stretches[0]
    projected = decay.parts[0]
    live_samples = int(_live_s(decay) * stretch.rate_hz)
    columns = np.concatenate(
        [free_motion(*decay.values, stretch.time_s), stretch.nuisance_columns()], axis=1
    )
    slopes = (motion_slopes(*decay.values, stretch.time_s) @ projected.linear[:2]).T
    tested = []
    for middle in (int(split * live_samples) for split in SPLITS):
        if middle * decay.values[0] / stretch.rate_hz < 0.75 or middle < 3 * MIN_SAMPLES:
            continue
        after_split = (np.arange(stretch.response.size) >= middle)[:, None]
        spanned = basis_of(
            np.concatenate(
                [projected.spanned, projected.jacobian, stretch.whitened(columns * after_split)],
                axis=1,
            )
        )
        chi2, degrees = _score(
            projected.residual, unit(stretch.whitened(slopes * after_split)), spanned
        )
        if degrees:
            tested.append((min(1.0, len(SPLITS) * chi2_tail(degrees, chi2)), middle))
    if not tested:
        return None
    chance, middle = min(tested)
    chance = min(chance, _chance_of_bend(decay), together)
    if chance >= CHANGE_PROBABILITY:
        return None
    halves = [
        decay.refitted(half) for half in (shortened(stretch, 0, middle), shortened(stretch, middle))
    ]
    frequencies, dampings, sizes = zip(
        *((*half.values, float(np.sqrt(np.mean(half.free() ** 2)))) for half in halves),
        strict=True,
    )
    return OscillatorChange(stretch.name, frequencies, dampings, sizes)


def _chance_of_bend(decay: DecayFit) -> float:
    """Return the probability of as much dependence on the amplitude in decays of a linear sensor.

    To first order a damping or a spring that depends on the square of the amplitude adds the
    motion, or the motion a quarter of a period later, times the square of its envelope.
    """
    natural, damping = decay.values
    decrement = 2.0 * np.pi * natural * damping
    largest = max(float(np.hypot(*projected.linear[:2])) for projected in decay.parts)
    columns = []
    free_columns = []
    for stretch, projected in zip(decay.stretches, decay.parts, strict=True):
        a, b = projected.linear[:2] / largest
        squares = (a**2 + b**2) * np.exp(-2.0 * decrement * stretch.time_s)
        bend = stretch.whitened(
            free_motion(natural, damping, stretch.time_s) @ [[a, b], [b, -a]] * squares[:, None]
        )
        columns.append(bend)
        free_columns.append(bend - projected.spanned @ (projected.spanned.T @ bend))
    tested = np.concatenate(free_columns) / np.linalg.norm(np.concatenate(columns), axis=0)
    slopes = basis_of(np.concatenate([projected.jacobian for projected in decay.parts]))
    chi2, degrees = _score(decay.residual, tested, slopes)
    return chi2_tail(degrees, chi2) if degrees == 2 else 1.0  # imitated by others: no evidence


def drifts(decay: DecayFit, index: int) -> bool:
    """Return whether a stretch rises by more than its slow noise allows.

    Its line may be a nuisance parameter all the same, as an autoregression of few terms does not
    whiten 1/f noise.
    """
    stretch = decay.stretches[index]
    residual = (stretch.response - decay.free(index))[stretch.valid]
    size = float(np.std(stretch.response[stretch.valid]))
    return significant_rise(residual, stretch.time_s[stretch.valid], size) != 0.0
