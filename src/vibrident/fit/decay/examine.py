"""Free decays examined: natural frequency and damping ratio, their noise, and whether one linear oscillator does it.

A sensor whose spring or damping depends on the amplitude still moves like a linear one for a while. So the motion is
compared in stretches of time, as other motion is in bands of frequency: in each of them the residual's part along the
motion and across it (two numbers) is χ² of two degrees of freedom where the sensor is linear.
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
from vibrident.fit.decay.drift import SIGNIFICANT, significant_rise
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
from vibrident.fit.decay.noise import WHITE, Noise, autoregression, tones_of
from vibrident.fit.decay.release import free_stretch, trimmed, without_first
from vibrident.fit.optimise import Progress, silent
from vibrident.fit.response.verdict import REJECTION

#: Stretches of time that are compared: at most this many, of at least so many samples.
MOST_PARTS, FEWEST_SAMPLES = 12, 8
TAIL = 0.6  # if the motion lasts for less than this part of the record, its noise is that of the remainder
STEPS_OF_MOTION = (
    6.0  # fewest steps of a coarse recorder in a motion; the rounding of a smaller one follows it
)
SHARES = (0.1, 0.25, 0.5)  # parts of a decay where its beginning is compared with its end
DIFFER = 1e-4  # beginning and end of a decay differ below this probability
WITHIN = 1e-6  # columns of which the rest leaves less than this part, in squares, are spanned by it


@dataclass(frozen=True)
class Parts:
    """Squares of a decay's residual along the motion."""

    chi2: float  # their sum in units of the noise
    degrees: int  # of freedom: two a part less what initial state, offset and drift take
    freedom: float  # samples behind the noise


@dataclass(frozen=True)
class Change:
    """Natural frequency and damping ratio at the beginning and at the end of a decay."""

    record: str  # its name
    frequency_hz: tuple[float, float]  # at the beginning and at the end
    damping: tuple[float, float]  # the same
    amplitude: tuple[float, float]  # rms of the motion there, response unit

    @property
    def words(self) -> str:
        """What changes with the amplitude, for a person."""
        (f0, f1), (d0, d1), (a0, a1) = self.frequency_hz, self.damping, self.amplitude
        return (
            f"{self.record}: the oscillation changes as it dies away: natural frequency {f0:.6g} Hz at the beginning "
            f"(rms {a0:.3g}) and {f1:.6g} Hz at the end (rms {a1:.3g}), {100 * (f1 / f0 - 1):+.2g} %; damping ratio "
            f"{d0:.4g} and {d1:.4g}. Spring or damping depends on the amplitude; one value for both is a mean."
        )


@dataclass(frozen=True, eq=False)
class Decays:
    """What free decays say."""

    fit: DecayFit  # of all together
    changes: tuple[Change, ...]  # records in which beginning and end differ

    @property
    def freedom(self) -> float:
        """Degrees of freedom behind the noise."""
        return float(
            len(self.fit.residual) - sum(part.spanned.shape[1] for part in self.fit.parts) - 2
        )

    def as_settings(self) -> dict[str, Any]:
        """For a result, a record each."""
        about = [
            {
                "record": stretch.name,
                "begins_s": stretch.first / stretch.rate_hz,
                "samples": int(stretch.response.size),
                "noise": stretch.scale,
                "noise_order": len(stretch.noise.whitening) - 1,
                "tones_hz": list(stretch.noise.tones_hz),
                "chi2": part.chi2,
                "degrees_of_freedom": part.degrees,
            }
            for stretch, part in zip(self.fit.stretches, parts_of(self.fit), strict=True)
        ]

        return {"decays": about}


def examine(records: Sequence[Record], progress: Progress = silent) -> Decays:
    """Fit one oscillator to free decays.

    ``records``: screened, of excitation ``decay``; ``progress``: called at every step of the last descents.
    """
    starts = [weighed(free_stretch(record)) for record in records]
    stretches = [one.stretches[0] for one in starts]
    found = min((fit(stretches, *one.values, progress) for one in starts), key=lambda one: one.cost)
    changes = [change for one in starts if (change := change_of(one)) is not None]
    if not changes and len(starts) > 1:  # too small for one decay to show
        largest = max(starts, key=lambda one: float(np.max(np.abs(one.free()))))
        changes = [
            change for change in [change_of(largest, _chance_of_bend(found))] if change is not None
        ]
    return Decays(found, tuple(changes))


def verdict(parts: Sequence[Parts]) -> tuple[float, int, bool]:
    """χ² of decays, its degrees of freedom, and whether one linear oscillator explains them."""
    chi2, degrees = sum(p.chi2 for p in parts), sum(p.degrees for p in parts) - 2
    chance = f_tail(degrees, sum(p.freedom for p in parts), chi2 / degrees) if degrees > 0 else 1.0
    return chi2, degrees, chance >= REJECTION


def weighed(found: DecayFit) -> DecayFit:
    """One record's fit, with drift if it is significant, weighted by the residual noise of a flexible fit."""
    for _ in range(2):
        found = found.again(_weighed(found))
        drifting = _drifting(found)
        found = trimmed(found if drifting is None else drifting)
    return without_first(found)


def _weighed(found: DecayFit) -> Stretch:
    """The stretch of a fit with the noise that its flexible residual shows."""
    stretch, frequency, rest, alive = (
        found.stretches[0],
        found.values[0],
        _flexible_residual(found),
        _live_s(found),
    )
    known, after = stretch.noise.tones_hz, int(alive * stretch.rate_hz)
    if after < TAIL * rest.size:  # where the motion has gone, any line is a tone
        tones = tones_of(rest[after:], stretch.rate_hz, (0.0, 0.0), known)
    else:
        tones = tones_of(
            rest,
            stretch.rate_hz,
            (max(0.0, frequency - 3.0 / alive), frequency + 3.0 / alive),
            known,
        )
    rest = _without_tones(rest, replace(stretch, noise=replace(WHITE, tones_hz=tones)))
    quiet = rest[after:] if after < TAIL * rest.size else rest
    coarse = resolution(stretch.response[stretch.valid]) / np.sqrt(12.0)
    if (
        np.std(quiet) < 1.5 * coarse
    ):  # what a coarse recorder shows of a rest is a constant, not its noise
        shown = _while_larger(found, STEPS_OF_MOTION * np.sqrt(12.0) * coarse)
        again = replace(shown, noise=replace(WHITE, tones_hz=tones))
        spread = float(np.sqrt(np.mean(rest[: shown.response.size][shown.valid] ** 2)))
        return replace(again, scale=max(coarse, spread))
    noise = Noise(autoregression(quiet), tones)
    again = replace(stretch, noise=noise, scale=1.0)
    counted = again.rows[rest.size - quiet.size :]
    coloured = noise.applied(rest[:, None])[rest.size - quiet.size :][counted][:, 0]
    taken = 1 if quiet.size < rest.size else 2 * len(_edges(found)) + 1
    scale = float(np.sqrt(np.sum(coloured**2) / max(coloured.size - taken, 1)))
    least = np.finfo(float).eps * float(np.max(np.abs(stretch.response)))
    return replace(again, scale=max(scale, least, np.finfo(float).tiny))


def _while_larger(found: DecayFit, level: float) -> Stretch:
    """The stretch as long as its motion swings beyond a level."""
    stretch = found.stretches[0]
    beyond = np.flatnonzero(np.abs(found.free()) > level)
    last = int(beyond[-1]) + 1 if beyond.size else stretch.response.size
    return shortened(stretch, 0, last) if last > 4 * FEWEST_SAMPLES else stretch


def _without_tones(residual: FloatArray, stretch: Stretch) -> FloatArray:
    columns = replace(stretch, drift=False).beside()
    return residual - columns @ np.linalg.lstsq(columns, residual, rcond=None)[0]


def _drifting(found: DecayFit) -> DecayFit | None:
    """The fit with a straight line among the unknowns, if the line is significant; else None."""
    stretch = found.stretches[0]
    if stretch.drift:
        return None
    trial = found.again(replace(stretch, drift=True))
    return trial if found.cost - trial.cost > SIGNIFICANT**2 else None


def _live_s(found: DecayFit, index: int = 0) -> float:
    """Time from a stretch's beginning until its motion is below three tenths of the noise's standard deviation."""
    stretch, residual, motion = (
        found.stretches[index],
        found.parts[index].residual,
        np.abs(found.free(index)),
    )
    level = float(np.sqrt(np.mean(residual**2))) * stretch.scale * 0.3
    alive = np.flatnonzero(motion > max(level, 1e-6 * float(np.max(motion))))
    last = int(alive[-1]) if alive.size else stretch.response.size - 1
    return (last + 1) / stretch.rate_hz


def _edges(found: DecayFit, index: int = 0) -> list[tuple[int, int]]:
    """Parts of the motion: first sample and the one after the last."""
    stretch, alive = found.stretches[index], _live_s(found, index)
    count = int(np.clip(2.0 * alive * found.values[0], 2, MOST_PARTS))
    samples = min(stretch.response.size, int(np.ceil(alive * stretch.rate_hz)))
    count = max(1, min(count, samples // FEWEST_SAMPLES))
    ends = np.linspace(0, samples, count + 1).astype(int)
    return [(int(a), int(b)) for a, b in itertools.pairwise(ends)]


def _pieces(found: DecayFit, index: int = 0) -> FloatArray:
    """The motion of each part alone, shape (samples, at most 2 parts)."""
    motion, edges = free_motion(*found.values, found.stretches[index].time_s), _edges(found, index)
    spans = [((first, len(motion) - last), basis_of(motion[first:last])) for first, last in edges]
    return np.hstack([np.pad(piece, (rows, (0, 0))) for rows, piece in spans])


def _flexible_residual(found: DecayFit) -> FloatArray:
    """Residual of a decay with a separate amplitude and phase for every part of the motion, shape (samples,).

    It holds almost no misfit of the oscillator, so it shows the noise.
    """
    stretch = found.stretches[0]
    at = replace(
        stretch, noise=replace(WHITE, tones_hz=stretch.noise.tones_hz), scale=1.0, drift=True
    )
    columns = np.concatenate(
        [_pieces(replace(found, problem=replace(found.problem, stretches=(at,)))), at.beside()],
        axis=1,
    )
    linear = np.linalg.lstsq(columns[at.valid], at.response[at.valid], rcond=None)[0]
    return np.where(at.valid, at.response - columns @ linear, 0.0)


def _score(residual: FloatArray, columns: FloatArray, known: FloatArray) -> tuple[float, int]:
    """χ² of a whitened residual along columns beside known ones, and its degrees of freedom (score test; Rao 1948).

    ``columns``: of unit length beside nuisance parameters, shape (rows, m); ``known``: orthonormal, shape (rows, n).
    """
    free = columns - known @ (known.T @ columns)
    values, vectors = np.linalg.eigh(free.T @ free)
    kept = values > WITHIN
    along = (vectors[:, kept].T @ (free.T @ residual)) / np.sqrt(values[kept])
    return float(along @ along), int(kept.sum())


def parts_of(found: DecayFit) -> tuple[Parts, ...]:
    """χ² of each stretch along its motion, part by part: its nuisance parameters at their best, nothing else fitted."""
    parts = []
    for index, (stretch, at) in enumerate(zip(found.stretches, found.parts, strict=True)):
        pieces = basis_of(stretch.whitened(_pieces(found, index)))
        freedom = max(len(at.residual) - pieces.shape[1] - at.spanned.shape[1], 1)
        parts.append(Parts(*_score(at.residual, pieces, at.spanned), float(freedom)))
    return tuple(parts)


def change_of(found: DecayFit, together: float = 1.0) -> Change | None:
    """Whether the beginning of a decay and its end have the same oscillator.

    Score tests of a step of natural frequency and damping ratio, beside one of all nuisance parameters, and of what
    depends on the amplitude.

    Args:
        found: one decay by itself.
        together: probability of as much change with the amplitude in several decays, of which this is one.
    """
    stretch, at = found.stretches[0], found.parts[0]
    alive = int(_live_s(found) * stretch.rate_hz)
    beside = np.concatenate([free_motion(*found.values, stretch.time_s), stretch.beside()], axis=1)
    slopes = (motion_slopes(*found.values, stretch.time_s) @ at.linear[:2]).T
    tested = []
    for middle in (int(share * alive) for share in SHARES):
        if middle * found.values[0] / stretch.rate_hz < 0.75 or middle < 3 * FEWEST_SAMPLES:
            continue
        after = (np.arange(stretch.response.size) >= middle)[:, None]
        known = basis_of(
            np.concatenate([at.spanned, at.jacobian, stretch.whitened(beside * after)], axis=1)
        )
        chi2, degrees = _score(at.residual, unit(stretch.whitened(slopes * after)), known)
        if degrees:
            tested.append((min(1.0, len(SHARES) * chi2_tail(degrees, chi2)), middle))
    if not tested:
        return None
    chance, middle = min(tested)
    chance = min(chance, _chance_of_bend(found), together)
    if chance >= DIFFER:
        return None
    two = [
        found.again(half) for half in (shortened(stretch, 0, middle), shortened(stretch, middle))
    ]
    frequencies, dampings = zip(*(one.values for one in two), strict=True)
    sizes = [float(np.sqrt(np.mean(one.free() ** 2))) for one in two]
    return Change(stretch.name, frequencies, dampings, (sizes[0], sizes[1]))


def _chance_of_bend(found: DecayFit) -> float:
    """Probability that a linear sensor leaves as much of what depends on the amplitude, over all of some decays.

    To first order a damping or a spring that depends on the square of the amplitude adds the motion, or the motion a
    quarter of a period later, times the square of its envelope.
    """
    natural, damping = found.values
    decrement = 2.0 * np.pi * natural * damping
    largest = max(float(np.hypot(*at.linear[:2])) for at in found.parts)
    added, spanned = [], []
    for stretch, at in zip(found.stretches, found.parts, strict=True):
        a, b = at.linear[:2] / largest
        squares = (a**2 + b**2) * np.exp(-2.0 * decrement * stretch.time_s)
        bent = stretch.whitened(
            free_motion(natural, damping, stretch.time_s) @ [[a, b], [b, -a]] * squares[:, None]
        )
        added.append(bent)
        spanned.append(at.spanned @ (at.spanned.T @ bent))
    size = np.linalg.norm(np.concatenate(added), axis=0)
    left = (np.concatenate(added) - np.concatenate(spanned)) / size
    chi2, degrees = _score(
        found.residual, left, basis_of(np.concatenate([at.jacobian for at in found.parts]))
    )
    return (
        chi2_tail(degrees, chi2) if degrees == 2 else 1.0
    )  # what the others can imitate tells nothing


def drifts(found: DecayFit, index: int) -> bool:
    """Whether a stretch rises by more than its slow noise allows.

    A line is a nuisance parameter even if it may be 1/f noise, which an autoregression of few terms does not whiten.
    """
    stretch = found.stretches[index]
    left = (stretch.response - found.free(index))[stretch.valid]
    size = float(np.std(stretch.response[stretch.valid]))
    return significant_rise(left, stretch.time_s[stretch.valid], size) != 0.0
