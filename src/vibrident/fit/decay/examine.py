"""Free decays examined: natural frequency and damping ratio, their noise, and whether one linear oscillator does it.

A sensor whose spring or damping depends on the amplitude still moves like a linear one for a while. So the motion is
compared in stretches of time, as other motion is in bands of frequency: in each of them the residual's part along the
motion and across it (two numbers) is χ² of two degrees of freedom where the sensor is linear.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.tails import chi2_tail
from vibrident.data.records import FloatArray, Record
from vibrident.data.records.basis import resolution
from vibrident.fit.decay.fit import DecayFit, Local, Stretch, fit, free_motion, local, shortened
from vibrident.fit.decay.noise import WHITE, Noise, autoregression, tones_of
from vibrident.fit.decay.release import free_stretch, trimmed, without_first
from vibrident.fit.response.verdict import rejected
from vibrident.fit.screening.drift import significant_rise

#: Stretches of time that are compared: at most this many, of at least so many samples.
MOST_PARTS, FEWEST_SAMPLES = 12, 8
GONE = 0.3  # the motion has gone where its envelope is below this part of the noise's standard deviation
ROUNDS = 2  # rounds of noise and fit
TAIL = 0.6  # if the motion lasts for less than this part of the record, tones are estimated from the remainder
DRIFTS = 8.0  # a straight line is among the unknowns beyond so many standard deviations
STEPS_OF_MOTION = 6.0  # fewest steps of a coarse recorder in a motion; the rounding of a smaller one follows it
SHARES = (0.1, 0.25, 0.5)  # parts of a decay where its beginning is compared with its end
DIFFER = 1e-4  # beginning and end of a decay differ below this probability
IMITATED = 1e-3  # what is left of a bend's shape must be this part of it, or the linear unknowns imitate it
KNOWN = 0.05  # largest standard uncertainty of ln fn and of δ with which beginning and end are compared


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
    probability: float  # that a linear sensor differs as much


@dataclass(frozen=True, eq=False)
class Decays:
    """What free decays say."""

    fit: DecayFit  # of all together
    parts: tuple[Parts, ...]  # one a record, at the joint values
    changes: tuple[Change, ...]  # records in which beginning and end differ
    covariance: FloatArray  # of (ln fn, δ), from the noise, shape (2, 2)
    freedom: float  # degrees of freedom behind the noise

    @property
    def chi2(self) -> float:
        """Sum over all records."""
        return sum(p.chi2 for p in self.parts)

    @property
    def degrees(self) -> int:
        """Degrees of freedom of χ²: those of the parts less the two parameters."""
        return sum(p.degrees for p in self.parts) - 2

    @property
    def adequate(self) -> bool:
        """Whether one linear oscillator explains the decays."""
        freedom = np.array([p.freedom for p in self.parts])
        return not self.changes and not rejected(self.chi2, self.degrees, freedom)


def examine(records: Sequence[Record]) -> Decays:
    """Fit one oscillator to free decays.

    ``records``: screened, of excitation ``decay``.
    """
    stretches, starts = [], []
    for record in records:
        own = weighed(free_stretch(record))
        stretches.append(own.stretches[0])
        starts.append(own)
    fits = [fit(stretches, one.natural_frequency_hz, max(one.damping_ratio, 1e-6)) for one in starts]
    found = min(fits, key=lambda one: one.cost)
    rows = sum(len(x.residual) for x in found.locals)
    taken = sum(x.spanned.shape[1] for x in found.locals)
    parts = tuple(parts_of(s, found.natural_frequency_hz, found.damping_ratio) for s in found.stretches)
    changes = [change for one in starts if (change := change_of(one)) is not None]
    if not changes and len(starts) > 1:  # too small for one decay to show
        largest = max(starts, key=lambda one: float(np.max(np.abs(_free(one)))))
        changes = [change for change in [change_of(largest, _chance_of_bend(found))] if change is not None]
    return Decays(found, parts, tuple(changes), found.covariance, float(rows - taken - 2))


def at_values(decays: Decays, natural_frequency_hz: float, damping_ratio: float) -> Decays:
    """The same decays at other values, each with the best initial state there."""
    own = decays.fit
    locals_ = tuple(local(stretch, natural_frequency_hz, damping_ratio) for stretch in own.stretches)
    cost = sum(float(x.residual @ x.residual) for x in locals_)
    moved = replace(
        own,
        natural_frequency_hz=natural_frequency_hz,
        damping_ratio=damping_ratio,
        locals=locals_,
        costs=(*own.costs, cost),
        path=(*own.path, (natural_frequency_hz, damping_ratio)),
    )
    parts = tuple(parts_of(stretch, natural_frequency_hz, damping_ratio) for stretch in own.stretches)
    return replace(decays, fit=moved, parts=parts)


def weighed(found: DecayFit) -> DecayFit:
    """One record's fit, with drift if it is significant, weighted by the residual noise of a flexible fit."""
    for _ in range(ROUNDS):
        stretch = _weighed(found)
        found = fit([stretch], found.natural_frequency_hz, max(found.damping_ratio, 1e-6))
        drifting = _drifting(found)
        found = trimmed(found if drifting is None else drifting)
    return without_first(found)


def _weighed(found: DecayFit) -> Stretch:
    """The stretch of a fit with the noise that its flexible residual shows."""
    stretch, frequency = found.stretches[0], found.natural_frequency_hz
    rest = flexible_residual(stretch, frequency, found.damping_ratio)
    alive = live_s(stretch, found)
    known, after = stretch.noise.tones_hz, int(alive * stretch.rate_hz)
    if after < TAIL * rest.size:  # where the motion has gone, any line is a tone
        tones = tones_of(rest[after:], stretch.rate_hz, (0.0, 0.0), known)
    else:
        tones = tones_of(rest, stretch.rate_hz, (max(0.0, frequency - 3.0 / alive), frequency + 3.0 / alive), known)
    rest = _without_tones(rest, replace(stretch, noise=Noise(WHITE.whitening, tones)))
    quiet = rest[after:] if after < TAIL * rest.size else rest
    coarse = resolution(stretch.response[stretch.valid]) / np.sqrt(12.0)
    if np.std(quiet) < 1.5 * coarse:  # what a coarse recorder shows of a rest is a constant, not its noise
        shown = _while_larger(found, STEPS_OF_MOTION * np.sqrt(12.0) * coarse)
        again = replace(shown, noise=Noise(WHITE.whitening, tones))
        spread = float(np.sqrt(np.mean(rest[: shown.response.size][shown.valid] ** 2)))
        return replace(again, scale=max(coarse, spread))
    noise = Noise(autoregression(quiet), tones)
    again = replace(stretch, noise=noise, scale=1.0)
    counted = again.rows[rest.size - quiet.size :]
    coloured = noise.applied(rest[:, None])[rest.size - quiet.size :][counted][:, 0]
    taken = 1 if quiet.size < rest.size else 2 * len(_edges(stretch, found)) + 1
    scale = float(np.sqrt(np.sum(coloured**2) / max(coloured.size - taken, 1)))
    least = np.finfo(float).eps * float(np.max(np.abs(stretch.response)))
    return replace(again, scale=max(scale, least, np.finfo(float).tiny))


def _while_larger(found: DecayFit, level: float) -> Stretch:
    """The stretch as long as its motion swings beyond a level."""
    stretch = found.stretches[0]
    beyond = np.flatnonzero(np.abs(_free(found)) > level)
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
    with_line = replace(stretch, drift=True)
    trial = fit([with_line], found.natural_frequency_hz, found.damping_ratio)
    return trial if found.cost - trial.cost > DRIFTS**2 else None


def live_s(stretch: Stretch, found: DecayFit) -> float:
    """Time from the stretch's beginning until its motion is lost in the noise."""
    at = local(stretch, found.natural_frequency_hz, found.damping_ratio)
    motion = np.abs(free_motion(found.natural_frequency_hz, found.damping_ratio, stretch.time_s) @ at.linear[:2])
    level = float(np.sqrt(np.mean(at.residual**2))) * stretch.scale * GONE
    alive = np.flatnonzero(motion > max(level, 1e-6 * float(np.max(motion))))
    last = int(alive[-1]) if alive.size else stretch.response.size - 1
    return (last + 1) / stretch.rate_hz


def _edges(stretch: Stretch, found: DecayFit) -> list[tuple[int, int]]:
    """Parts of the motion: first sample and the one after the last."""
    alive = live_s(stretch, found)
    count = int(np.clip(2.0 * alive * found.natural_frequency_hz, 2, MOST_PARTS))
    samples = min(stretch.response.size, int(np.ceil(alive * stretch.rate_hz)))
    count = max(1, min(count, samples // FEWEST_SAMPLES))
    ends = np.linspace(0, samples, count + 1).astype(int)
    return [(int(a), int(b)) for a, b in itertools.pairwise(ends)]


def _pieces(stretch: Stretch, found: DecayFit) -> FloatArray:
    """The motion of each part alone, shape (samples, 2 parts)."""
    motion = free_motion(found.natural_frequency_hz, found.damping_ratio, stretch.time_s)
    edges = _edges(stretch, found)
    columns = np.zeros((stretch.response.size, 2 * len(edges)))
    for index, (first, last) in enumerate(edges):
        piece = np.linalg.qr(motion[first:last] / np.maximum(np.abs(motion[first:last]).max(axis=0), 1e-300))[0]
        columns[first:last, 2 * index : 2 * index + 2] = piece
    return columns


def flexible_residual(stretch: Stretch, natural_frequency_hz: float, damping_ratio: float) -> FloatArray:
    """Residual of a fit with a separate amplitude and phase for every part of the motion, shape (samples,).

    It holds almost no misfit of the oscillator, so it shows the noise.
    """
    at = replace(stretch, noise=Noise(WHITE.whitening, stretch.noise.tones_hz), scale=1.0, drift=True)
    found = fit_at(at, natural_frequency_hz, damping_ratio)
    columns = np.concatenate([_pieces(at, found), at.beside()], axis=1)
    rows = at.valid
    linear = np.linalg.lstsq(columns[rows], at.response[rows], rcond=None)[0]
    return np.where(rows, at.response - columns @ linear, 0.0)


def fit_at(stretch: Stretch, natural_frequency_hz: float, damping_ratio: float) -> DecayFit:
    """A stretch at given values, nothing fitted but what is linear."""
    at = local(stretch, natural_frequency_hz, damping_ratio)
    cost, value = float(at.residual @ at.residual), (natural_frequency_hz, damping_ratio)
    return DecayFit(*value, np.zeros((2, 2)), (stretch,), (at,), (cost,), (value,))


def parts_of(stretch: Stretch, natural_frequency_hz: float, damping_ratio: float) -> Parts:
    """χ² of a decay at given values: initial state, offset and drift at their best, nothing else fitted."""
    found = fit_at(stretch, natural_frequency_hz, damping_ratio)
    at: Local = found.locals[0]
    pieces = stretch.whitened(_pieces(stretch, found))
    pieces, _ = np.linalg.qr(pieces)
    free = pieces - at.spanned @ (at.spanned.T @ pieces)
    values, vectors = np.linalg.eigh(free.T @ free)
    kept = values > 0.05
    projected = (vectors[:, kept].T @ (free.T @ at.residual)) / np.sqrt(values[kept])
    freedom = max(len(at.residual) - pieces.shape[1] - at.spanned.shape[1], 1)
    return Parts(float(projected @ projected), int(kept.sum()), float(freedom))


def change_of(found: DecayFit, together: float = 1.0) -> Change | None:
    """Whether the beginning of a decay and its end have the same oscillator.

    ``found``: one decay by itself; ``together``: probability of as much change with the amplitude in several decays, of
    which this is one.
    """
    stretch = found.stretches[0]
    alive = int(live_s(stretch, found) * stretch.rate_hz)
    best: Change | None = None
    for share in SHARES:
        middle = int(share * alive)
        if middle * found.natural_frequency_hz / stretch.rate_hz < 0.75 or middle < 3 * FEWEST_SAMPLES:
            continue
        halves = [shortened(stretch, 0, middle), shortened(stretch, middle)]
        two = [fit([half], found.natural_frequency_hz, max(found.damping_ratio, 1e-6)) for half in halves]
        if any(np.any(np.diag(one.covariance) > KNOWN**2) for one in two):
            continue  # of two real poles, the slow one alone outlasts the beginning
        # By likelihoods: where the motion is hardly above the noise, values are not normally distributed.
        alike = fit(halves, found.natural_frequency_hz, max(found.damping_ratio, 1e-6))
        squares = alike.cost - sum(one.cost for one in two)
        chance = min(1.0, len(SHARES) * float(chi2_tail(2, max(squares, 0.0))))
        if best is None or chance < best.probability:
            sizes = [float(np.sqrt(np.mean(_free(one) ** 2))) for one in two]
            best = Change(
                stretch.name,
                (two[0].natural_frequency_hz, two[1].natural_frequency_hz),
                (two[0].damping_ratio, two[1].damping_ratio),
                (sizes[0], sizes[1]),
                chance,
            )
    if best is None:
        return None
    best = replace(best, probability=min(best.probability, _chance_of_bend(found), together))
    return best if best.probability < DIFFER else None


def _chance_of_bend(found: DecayFit) -> float:
    """Probability that a linear sensor leaves as much of what depends on the amplitude, over all of some decays.

    A score test (Rao 1948): to first order a damping or a spring that depends on the square of the amplitude adds the
    motion, or the motion a quarter of a period later, times the square of its envelope. What the linear unknowns can
    imitate does not count.
    """
    decrement = 2.0 * np.pi * found.natural_frequency_hz * found.damping_ratio
    sizes = [float(np.hypot(*at.linear[:2])) for at in found.locals]
    rows = []
    for stretch, at, size in zip(found.stretches, found.locals, sizes, strict=True):
        motion = free_motion(found.natural_frequency_hz, found.damping_ratio, stretch.time_s)
        squares = (size / max(sizes)) ** 2 * np.exp(-2.0 * decrement * stretch.time_s)
        (a, b) = at.linear[:2] / max(sizes)
        added = stretch.whitened(motion @ np.array([[a, b], [b, -a]]) * squares[:, None])
        rows.append((added, added - at.spanned @ (at.spanned.T @ added)))
    added, left = (np.concatenate(part) for part in zip(*rows, strict=True))
    slopes = np.concatenate([at.slopes for at in found.locals])
    known = np.linalg.qr(slopes / np.linalg.norm(slopes, axis=0))[0]
    left = left - known @ (known.T @ left)
    if np.any(np.linalg.norm(left, axis=0) < IMITATED * np.linalg.norm(added, axis=0)):
        return 1.0
    across = np.linalg.qr(left)[0]
    residual = np.concatenate([at.residual for at in found.locals])
    return float(chi2_tail(2, float(np.sum((across.T @ residual) ** 2))))


def _free(found: DecayFit) -> FloatArray:
    """The motion of a fit's first part, without offset, drift and tones."""
    motion = free_motion(found.natural_frequency_hz, found.damping_ratio, found.stretches[0].time_s)
    return motion @ found.locals[0].linear[:2]


def drifts(found: DecayFit, index: int) -> bool:
    """Whether a stretch rises by more than its slow noise allows.

    A line is among the unknowns even if it may be 1/f noise, which an autoregression of few terms does not whiten.
    """
    stretch = found.stretches[index]
    motion = free_motion(found.natural_frequency_hz, found.damping_ratio, stretch.time_s)
    left = (stretch.response - motion @ found.locals[index].linear[:2])[stretch.valid]
    size = float(np.std(stretch.response[stretch.valid]))
    return significant_rise(left, stretch.time_s[stretch.valid], size) != 0.0


def motion_of(found: DecayFit, index: int) -> FloatArray:
    """What a fit predicts of a stretch: motion, offset, drift and tones; shape (samples,)."""
    stretch, linear = found.stretches[index], found.locals[index].linear
    motion = free_motion(found.natural_frequency_hz, found.damping_ratio, stretch.time_s)
    return np.concatenate([motion, stretch.beside()], axis=1) @ linear
