"""The first look at two signals in quadrature: their ellipse, whether it changes, how much of it the motion covers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from vibrident.base.errors import InputError
from vibrident.data.interferometer import ellipse as ellipses
from vibrident.data.interferometer import moments
from vibrident.data.interferometer.ellipse import Ellipse
from vibrident.data.interferometer.setting import BoolArray, FloatArray, Signals

STRETCHES = 64  # pieces of the record for the first guess and for pictures
STRETCH = 1024  # samples of a piece
BLOCK = 1 << 17  # samples in a block
MOST = 1 << 22  # most samples for the fit of an ellipse; of longer records, pieces
FEWEST_BLOCKS = 64  # fewest blocks of a record that determine their scatter
LEAST_BLOCK = 64  # fewest samples of a block
# a sample is lost below a radius, over the amplitude, of so many standard deviations of the noise …
LOST_SIGMA = 6.0
LOST = 0.3  # … but at least of this …
MOST_LOST = 0.6  # … and at most of this
TOO_LARGE = 2.0  # a sample is also lost above this radius
PARTS = 32  # parts of the circle that are looked at, to see how much is covered
LEAST_WHOLE = 0.5  # blocks with a lost sample are left out where this part of all is without
PIECES = 16  # pieces of time of an ellipse that may change
KNOWN = 0.05  # largest uncertainty of a piece's ellipse over its amplitude
CHANCE = 1e-5  # probability below which a change is significant
FADES = 8.0  # the amplitude fades if its variance between blocks is this many times that of noise
ALIKE = 0.9999  # signals of a larger correlation are one
AT_LIMIT = (
    0.005  # a signal is at a limit where more than this part of its samples has its extreme value …
)
PILED = 10.0  # … and so many times as many as have the value beside it
FEWEST_TO_FADE = 12  # fewest blocks to detect fading


@dataclass(frozen=True, eq=False)
class Survey:
    """What the first look found."""

    ellipse: Ellipse  # of the whole record
    fitted: bool  # False for if the arc does not determine an ellipse
    covered_rad: float  # part of the circle that the motion covers; 2π for a fringe or more
    points: FloatArray  # some samples, shape (2, n)
    # sample index and ellipse of pieces of time, where it changes; else empty
    knots: tuple[tuple[float, Ellipse], ...] = ()
    # part of each signal's samples at its largest or smallest value, where that is a limit; (2,)
    at_limit: tuple[float, ...] = (0.0, 0.0)

    @property
    def change(self) -> float:
        """Return the largest change of the shape in time, relative to the amplitude; zero if there is none."""
        shapes = [self.ellipse.shape_of(piece) for _, piece in self.knots]
        return float(np.max(np.ptp(shapes, axis=0))) if shapes else 0.0

    @property
    def whole(self) -> bool:
        """Return whether the motion covers a fringe or more."""
        return self.fitted and self.covered_rad > 2.0 * np.pi * (1.0 - 1.5 / PARTS)


def lost_radius(ellipse: Ellipse) -> float:
    """Return the radius over the amplitude below which a sample is lost."""
    return float(np.clip(LOST_SIGMA * ellipse.radial_noise, LOST, MOST_LOST))


def sound(ellipse: Ellipse, u: FloatArray) -> BoolArray:
    """Return the samples, shape (2, n), that are neither lost nor far outside."""
    v = ellipse.round(u)
    radius = v[0] * v[0] + v[1] * v[1]
    return (radius > lost_radius(ellipse) ** 2) & (radius < TOO_LARGE**2)


def survey(signals: Signals) -> Survey:
    """Look at two signals in quadrature. InputError: they draw no figure: one is constant, or both are the same."""
    points = _sample(signals)
    _require_two(points)
    coarse = _coarse(points)
    scale = np.array(coarse.amplitudes)
    blocks, middles = _blocks(signals, coarse, scale)
    start = _scaled(coarse, coarse.centre, scale)
    found = ellipses.fit(blocks, start) if blocks else None
    if found is not None:
        blocks = _steadied(blocks, found)
        found = ellipses.fit(blocks, found)
    if found is None:
        kept = points[:, sound(coarse, points)]
        circle = ellipses.as_circle(kept if kept.shape[1] >= 8 else points, float(signals.samples))
        return Survey(circle, False, _covered(circle, points), points, (), _at_limit(points))
    knots = _knots(blocks, middles, found)
    back = [(at, _unscaled(piece, coarse.centre, scale)) for at, piece in knots]
    whole = _unscaled(found, coarse.centre, scale)
    return Survey(whole, True, _covered(whole, points), points, tuple(back), _at_limit(points))


def _require_two(points: FloatArray) -> None:
    size = np.std(points, axis=1)
    alike = abs(float(np.asarray(np.corrcoef(points))[0, 1])) if np.all(size > 0.0) else 1.0
    if alike > ALIKE:
        dead = [f"signal {i + 1} is constant" for i in range(2) if not size[i] > 0.0]
        raise InputError(
            "The photodetector signals draw no ellipse.",
            expected="two signals, cos and sin of the phase",
            found=", ".join(dead) or "two signals that are the same but for scale and offset",
            where="[interferometer] columns",
            remedy="check columns and detectors",
        )


def _at_limit(points: FloatArray) -> tuple[float, ...]:
    """Return the part of each signal's samples at an extreme, where far more lie there than at the value beside it.

    A free signal's turns put 2.4 times as many into the outermost code of a converter, 5.3 times at
    most.
    """
    found = []
    for signal in points:
        part = 0.0
        for values in (signal, -signal):
            top = np.asarray(values == np.max(values), dtype=bool)
            count = int(np.count_nonzero(top))
            if count > AT_LIMIT * values.size and count < values.size:
                beside = int(np.count_nonzero(values == np.max(values[~top])))
                part += count / values.size if count > PILED * beside else 0.0
        found.append(part)
    return tuple(found)


def _sample(signals: Signals) -> FloatArray:
    length = min(STRETCH, max(signals.samples // STRETCHES, 1))
    if signals.samples <= STRETCHES * STRETCH:
        return signals.block(0, signals.samples).astype(float)
    starts = np.linspace(0, signals.samples - length, STRETCHES).astype(int)
    return np.concatenate(
        [signals.block(int(s), int(s) + length) for s in starts], axis=1, dtype=float
    )


def _coarse(points: FloatArray) -> Ellipse:
    """Return an ellipse through the sample without lost parts, and the ratio of the signals' noise."""
    found = ellipses.circle(points)
    for _ in range(4):
        kept = points[:, sound(found, points)]
        kept = kept if kept.shape[1] > max(0.2 * points.shape[1], 8) else points
        start = ellipses.circle(kept)
        scale = np.array(start.amplitudes)
        normal = _scaled(start, start.centre, scale)
        fitted = ellipses.fit(
            [moments.sums(*((kept - start.centre[:, None]) / scale[:, None]))], normal
        )
        found = start if fitted is None else _unscaled(fitted, start.centre, scale)
    return replace(found, noise=_noise_ratio(found, points[:, sound(found, points)]) * found.noise)


def _noise_ratio(ellipse: Ellipse, u: FloatArray) -> FloatArray:
    """Return the factors on the noise variances of both signals, from how the radial noise changes round the circle; (2,)."""
    if u.shape[1] < 1000:
        return np.ones(2)
    v = ellipse.round(u)
    radius = np.hypot(v[0], v[1])
    pull = ellipse.inverse.T @ (v / radius)  # of each signal's noise on the radius
    design = (pull * pull * ellipse.noise[:, None]).T
    square = (radius - np.mean(radius)) ** 2
    normal = design.T @ design
    if np.linalg.cond(normal) > 100.0:
        return np.ones(2)
    return np.clip(np.linalg.solve(normal, design.T @ square), 0.1, 10.0)


def _blocks(
    signals: Signals, coarse: Ellipse, scale: FloatArray
) -> tuple[list[FloatArray], list[float]]:
    """Return the sums of blocks in coordinates of the coarse ellipse, and the index of the middle of each."""
    length = int(np.clip(signals.samples // FEWEST_BLOCKS, LEAST_BLOCK, BLOCK))
    count = max(signals.samples // length, 1)
    every = max(int(np.ceil(count * length / MOST)), 1)
    found = []
    middles = []
    whole = []
    for index in range(0, count, every):
        u = signals.block(index * length, min((index + 1) * length, signals.samples))
        good = sound(coarse, u)
        u = u if good.all() else u[:, good]
        if u.shape[1] < 0.5 * length:
            continue
        found.append(
            moments.sums((u[0] - coarse.centre[0]) / scale[0], (u[1] - coarse.centre[1]) / scale[1])
        )
        middles.append((index + 0.5) * length)
        whole.append(bool(good.all()))
    if np.mean(whole or [True]) > LEAST_WHOLE:  # next to a loss the light is unstable
        found, middles = (
            [v for v, kept in zip(values, whole, strict=True) if kept]
            for values in (found, middles)
        )
    return found, middles


def _steadied(blocks: list[FloatArray], whole: Ellipse) -> list[FloatArray]:
    """Return the blocks with a fading common amplitude removed: it does not change the phase."""
    count = np.array([block[0, 0] for block in blocks])
    excess = np.array([ellipses.excess(block, whole) for block in blocks])
    expected = 4.0 * whole.radial_noise**2 / count
    if len(blocks) < FEWEST_TO_FADE or np.var(excess) < FADES * float(np.mean(expected)):
        return blocks
    steadied = []
    for block, more in zip(blocks, excess, strict=True):
        change = moments.moved(whole.centre, np.eye(2) / np.sqrt(max(1.0 + more, 0.1)))
        back = moments.moved(-whole.centre, np.eye(2)) @ change
        steadied.append(moments.from_matrix(back @ moments.matrix(block) @ back.T))
    return steadied


def _knots(
    blocks: Sequence[FloatArray], middles: Sequence[float], whole: Ellipse
) -> list[tuple[float, Ellipse]]:
    """Return the ellipses of those pieces of time that determine one if they differ; else empty."""
    found = []
    for part in np.array_split(np.arange(len(blocks)), min(PIECES, max(len(blocks) // 4, 1))):
        piece = ellipses.fit([blocks[i] for i in part], whole)
        if piece is not None and np.sqrt(np.max(np.diag(piece.covariance))) < KNOWN:
            found.append((float(np.mean([middles[i] for i in part])), piece))
    if len(found) < 3:
        return []
    differences = np.array([whole.shape_of(piece) for _, piece in found])
    weights = np.array([np.linalg.inv(piece.shape_covariance) for _, piece in found])
    # Pieces of small motion are known little: a plain mean would be off by their errors.
    off = differences - np.linalg.solve(
        weights.sum(axis=0), np.einsum("kij,kj->i", weights, differences)
    )
    total = float(np.einsum("ki,kij,kj->", off, weights, off))
    return found if chdtrc(4 * (len(found) - 1), total) < CHANCE else []


def _covered(ellipse: Ellipse, points: FloatArray) -> float:
    v = ellipse.round(points[:, sound(ellipse, points)])
    counts, _ = np.histogram(np.arctan2(v[1], v[0]), bins=PARTS, range=(-np.pi, np.pi))
    filled = np.flatnonzero(counts)
    longest = (
        np.max(np.diff(filled, append=filled[:1] + PARTS) - 1, initial=0) if filled.size else PARTS
    )
    return float(2.0 * np.pi * (1.0 - longest / PARTS))


def _scaled(ellipse: Ellipse, centre: FloatArray, scale: FloatArray) -> Ellipse:
    matrix = ellipse.matrix / scale[:, None]
    noise = ellipse.noise / scale**2
    return replace(ellipse, centre=(ellipse.centre - centre) / scale, matrix=matrix, noise=noise)


def _unscaled(ellipse: Ellipse, centre: FloatArray, scale: FloatArray) -> Ellipse:
    matrix = ellipse.matrix * scale[:, None]
    noise = ellipse.noise * scale**2
    return replace(ellipse, centre=centre + ellipse.centre * scale, matrix=matrix, noise=noise)
