"""Survey two signals in quadrature: their ellipse, its changes, and how much of it is covered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from vibrident.base.errors import InputError
from vibrident.data.interferometer import ellipse as ellipses
from vibrident.data.interferometer import moments
from vibrident.data.interferometer.ellipse import Ellipse
from vibrident.data.interferometer.setting import BoolArray, FloatArray, SampledSignals

GUESS_PIECES = 64  # pieces of the record for the first guess and for pictures
GUESS_PIECE_SAMPLES = 1024
BLOCK_SAMPLES = 1 << 17  # samples in a block
MAX_FIT_SAMPLES = 1 << 22  # for the fit of an ellipse; longer records are fitted in pieces
MIN_BLOCKS = 64  # fewest blocks of a record that determine their scatter
MIN_BLOCK_SAMPLES = 64
# a sample is lost below a radius, over the amplitude, of so many standard deviations of the noise …
LOST_SIGMA = 6.0
MIN_LOST_RADIUS = 0.3  # … but at least of this …
MAX_LOST_RADIUS = 0.6  # … and at most of this
MAX_RADIUS = 2.0  # a sample is also lost above this radius
MIN_USABLE_SHARE = 0.2  # samples that are not lost; with fewer, an ellipse is fitted to all …
MIN_USABLE_SAMPLES = 8  # … and with no more than these
MIN_NOISE_SAMPLES = 1000  # that determine the ratio of the signals' noise …
MAX_NOISE_CONDITION = 100.0  # … with equations of at most this condition …
MAX_NOISE_FACTOR = 10.0  # … on the variance of each, or its inverse
SECTORS = 32  # sectors of the circle by which its coverage is determined
MIN_SOUND_BLOCKS = 0.5  # above this share of blocks without lost samples, the others are left out
PIECES = 16  # pieces of time of an ellipse that may change
MAX_PIECE_UNCERTAINTY = 0.05  # of a piece's ellipse over its amplitude
CHANGE_CHANCE = 1e-5  # probability below which a change is significant
MIN_FADING_RATIO = 8.0  # variance of the amplitude between blocks over that of noise, of fading
MAX_CORRELATION = 0.9999  # signals of a larger correlation are the same signal
# a signal is at a limit if more than this share of its samples has its extreme value …
MIN_SHARE_AT_LIMIT = 0.005
MIN_PILE_RATIO = 10.0  # … and this many times as many as have the next value
MIN_FADING_BLOCKS = 12  # fewest blocks to detect fading


@dataclass(frozen=True, eq=False)
class Survey:
    """Ellipse of two signals in quadrature, its changes, and its coverage."""

    ellipse: Ellipse  # of the whole record
    fitted: bool  # False if the arc does not determine an ellipse
    covered_rad: float  # angle of the circle that the motion covers; 2π for a fringe or more
    points: FloatArray  # some samples, shape (2, n)
    # sample index and ellipse of pieces of time, if the ellipse changes; else empty
    knots: tuple[tuple[float, Ellipse], ...] = ()
    # share of each signal's samples at its largest or smallest value, if that is a limit; (2,)
    at_limit: tuple[float, ...] = (0.0, 0.0)

    @property
    def change(self) -> float:
        """Return the largest change of the shape in time, relative to the amplitude; 0 for none."""
        shapes = [self.ellipse.shape_of(piece) for _, piece in self.knots]
        return float(np.max(np.ptp(shapes, axis=0))) if shapes else 0.0

    @property
    def covers_fringe(self) -> bool:
        """Return whether the motion covers a fringe or more."""
        return self.fitted and self.covered_rad > 2.0 * np.pi * (1.0 - 1.5 / SECTORS)


def lost_radius(ellipse: Ellipse) -> float:
    """Return the radius over the amplitude below which a sample is lost."""
    return float(np.clip(LOST_SIGMA * ellipse.radial_noise, MIN_LOST_RADIUS, MAX_LOST_RADIUS))


def usable_samples(ellipse: Ellipse, u: FloatArray) -> BoolArray:
    """Return which samples, shape (2, n), are neither lost nor far outside the ellipse."""
    return is_near_circle(ellipse, ellipse.to_unit_circle(u))


def is_near_circle(ellipse: Ellipse, v: FloatArray) -> BoolArray:
    """Return the same of samples in the coordinates in which the ellipse is the unit circle."""
    radius = v[0] * v[0] + v[1] * v[1]
    return (radius > lost_radius(ellipse) ** 2) & (radius < MAX_RADIUS**2)


def survey(signals: SampledSignals) -> Survey:
    """Fit the ellipse that two signals in quadrature draw, in pieces of time where it changes.

    Raises:
        InputError: they draw no figure: one is constant, or both are the same.
    """
    points = _sample_points(signals)
    _require_two_signals(points)
    coarse = _coarse_ellipse(points)
    scale = np.array(coarse.amplitudes)
    blocks, middles = _block_sums(signals, coarse, scale)
    start = _scaled(coarse, coarse.centre, scale)
    fitted = ellipses.fit_ellipse(blocks, start) if blocks else None
    if fitted is not None:
        blocks = _remove_fading(blocks, fitted)
        fitted = ellipses.fit_ellipse(blocks, fitted)
    if fitted is None:
        usable = points[:, usable_samples(coarse, points)]
        circle = ellipses.fit_short_arc(
            usable if usable.shape[1] >= 8 else points, float(signals.samples)
        )
        return Survey(
            circle, False, _covered_angle(circle, points), points, (), _shares_at_limit(points)
        )
    knots = _knots(blocks, middles, fitted)
    piece_knots = [(at, _unscaled(piece, coarse.centre, scale)) for at, piece in knots]
    ellipse = _unscaled(fitted, coarse.centre, scale)
    return Survey(
        ellipse,
        True,
        _covered_angle(ellipse, points),
        points,
        tuple(piece_knots),
        _shares_at_limit(points),
    )


def _require_two_signals(points: FloatArray) -> None:
    size = np.std(points, axis=1)
    alike = abs(float(np.asarray(np.corrcoef(points))[0, 1])) if np.all(size > 0.0) else 1.0
    if alike > MAX_CORRELATION:
        dead = [f"signal {i + 1} is constant" for i in range(2) if not size[i] > 0.0]
        raise InputError(
            "The photodetector signals draw no ellipse.",
            expected="two signals, cos and sin of the phase",
            found=", ".join(dead) or "two signals that are the same but for scale and offset",
            where="[interferometer] columns",
            remedy="check columns and detectors",
        )


def _shares_at_limit(points: FloatArray) -> tuple[float, ...]:
    """Return the share of each signal's samples at its limit; zero for a signal without one.

    A limit holds far more samples than the value next to it. A free signal's turns put 2.4 times as
    many samples into the outermost code of a converter as into the next, 5.3 times at most.
    """
    shares = []
    for signal in points:
        share = 0.0
        for values in (signal, -signal):
            top = np.asarray(values == np.max(values), dtype=bool)
            count = int(np.count_nonzero(top))
            if count > MIN_SHARE_AT_LIMIT * values.size and count < values.size:
                next_count = int(np.count_nonzero(values == np.max(values[~top])))
                share += count / values.size if count > MIN_PILE_RATIO * next_count else 0.0
        shares.append(share)
    return tuple(shares)


def _sample_points(signals: SampledSignals) -> FloatArray:
    length = min(GUESS_PIECE_SAMPLES, max(signals.samples // GUESS_PIECES, 1))
    if signals.samples <= GUESS_PIECES * GUESS_PIECE_SAMPLES:
        return signals.block(0, signals.samples).astype(float)
    starts = np.linspace(0, signals.samples - length, GUESS_PIECES).astype(int)
    return np.concatenate(
        [signals.block(int(s), int(s) + length) for s in starts], axis=1, dtype=float
    )


def _coarse_ellipse(points: FloatArray) -> Ellipse:
    """Return an ellipse through samples that are not lost, with the ratio of the signals' noise."""
    ellipse = ellipses.fit_circle(points)
    for _ in range(4):
        usable = points[:, usable_samples(ellipse, points)]
        if usable.shape[1] <= max(MIN_USABLE_SHARE * points.shape[1], MIN_USABLE_SAMPLES):
            usable = points
        start = ellipses.fit_circle(usable)
        scale = np.array(start.amplitudes)
        normal = _scaled(start, start.centre, scale)
        fitted = ellipses.fit_ellipse(
            [moments.sums(*((usable - start.centre[:, None]) / scale[:, None]))], normal
        )
        ellipse = start if fitted is None else _unscaled(fitted, start.centre, scale)
    return replace(
        ellipse,
        noise=_noise_ratio(ellipse, points[:, usable_samples(ellipse, points)]) * ellipse.noise,
    )


def _noise_ratio(ellipse: Ellipse, u: FloatArray) -> FloatArray:
    """Return factors on the noise variances of both signals, shape (2,).

    They follow from how the radial noise changes round the circle.
    """
    if u.shape[1] < MIN_NOISE_SAMPLES:
        return np.ones(2)
    v = ellipse.to_unit_circle(u)
    radius = np.hypot(v[0], v[1])
    sensitivity = ellipse.inverse.T @ (v / radius)  # of each signal's noise on the radius
    design = (sensitivity * sensitivity * ellipse.noise[:, None]).T
    square = (radius - np.mean(radius)) ** 2
    normal = design.T @ design
    if np.linalg.cond(normal) > MAX_NOISE_CONDITION:
        return np.ones(2)
    factors = np.linalg.solve(normal, design.T @ square)
    return np.clip(factors, 1.0 / MAX_NOISE_FACTOR, MAX_NOISE_FACTOR)


def _block_sums(
    signals: SampledSignals, coarse: Ellipse, scale: FloatArray
) -> tuple[list[FloatArray], list[float]]:
    """Return sums of blocks in coordinates of the coarse ellipse, and the middle index of each."""
    length = int(np.clip(signals.samples // MIN_BLOCKS, MIN_BLOCK_SAMPLES, BLOCK_SAMPLES))
    count = max(signals.samples // length, 1)
    every = max(int(np.ceil(count * length / MAX_FIT_SAMPLES)), 1)
    sums = []
    middles = []
    sound_blocks = []
    for index in range(0, count, every):
        u = signals.block(index * length, min((index + 1) * length, signals.samples))
        good = usable_samples(coarse, u)
        u = u if good.all() else u[:, good]
        if u.shape[1] < 0.5 * length:
            continue
        sums.append(
            moments.sums((u[0] - coarse.centre[0]) / scale[0], (u[1] - coarse.centre[1]) / scale[1])
        )
        middles.append((index + 0.5) * length)
        sound_blocks.append(bool(good.all()))
    if np.mean(sound_blocks or [True]) > MIN_SOUND_BLOCKS:  # next to a loss the light is unstable
        sums, middles = (
            [v for v, is_sound in zip(values, sound_blocks, strict=True) if is_sound]
            for values in (sums, middles)
        )
    return sums, middles


def _remove_fading(blocks: list[FloatArray], ellipse: Ellipse) -> list[FloatArray]:
    """Return the sums of the blocks without common fading, which leaves the phase alone."""
    count = np.array([block[0, 0] for block in blocks])
    excess = np.array([ellipses.excess(block, ellipse) for block in blocks])
    expected = 4.0 * ellipse.radial_noise**2 / count
    if len(blocks) < MIN_FADING_BLOCKS or np.var(excess) < MIN_FADING_RATIO * float(
        np.mean(expected)
    ):
        return blocks
    steadied = []
    for block, deviation in zip(blocks, excess, strict=True):
        change = moments.change_of_coordinates(
            ellipse.centre, np.eye(2) / np.sqrt(max(1.0 + deviation, 0.1))
        )
        back = moments.change_of_coordinates(-ellipse.centre, np.eye(2)) @ change
        steadied.append(moments.from_matrix(back @ moments.matrix(block) @ back.T))
    return steadied


def _knots(
    blocks: Sequence[FloatArray], middles: Sequence[float], ellipse: Ellipse
) -> list[tuple[float, Ellipse]]:
    """Return middle and ellipse of those pieces of time that determine one; none if they agree."""
    pieces = []
    for indices in np.array_split(np.arange(len(blocks)), min(PIECES, max(len(blocks) // 4, 1))):
        piece = ellipses.fit_ellipse([blocks[i] for i in indices], ellipse)
        if piece is not None and np.sqrt(np.max(np.diag(piece.covariance))) < MAX_PIECE_UNCERTAINTY:
            pieces.append((float(np.mean([middles[i] for i in indices])), piece))
    if len(pieces) < 3:
        return []
    # Pieces of small motion have large errors: an unweighted mean would have, too.
    _, _, total = ellipses.weighted_mean(
        [ellipse.shape_of(piece) for _, piece in pieces],
        [piece.shape_covariance for _, piece in pieces],
    )
    return pieces if chdtrc(4 * (len(pieces) - 1), total) < CHANGE_CHANCE else []


def _covered_angle(ellipse: Ellipse, points: FloatArray) -> float:
    v = ellipse.to_unit_circle(points[:, usable_samples(ellipse, points)])
    counts, _ = np.histogram(np.arctan2(v[1], v[0]), bins=SECTORS, range=(-np.pi, np.pi))
    filled = np.flatnonzero(counts)
    longest = (
        np.max(np.diff(filled, append=filled[:1] + SECTORS) - 1, initial=0)
        if filled.size
        else SECTORS
    )
    return float(2.0 * np.pi * (1.0 - longest / SECTORS))


def _scaled(ellipse: Ellipse, centre: FloatArray, scale: FloatArray) -> Ellipse:
    matrix = ellipse.matrix / scale[:, None]
    noise = ellipse.noise / scale**2
    return replace(ellipse, centre=(ellipse.centre - centre) / scale, matrix=matrix, noise=noise)


def _unscaled(ellipse: Ellipse, centre: FloatArray, scale: FloatArray) -> Ellipse:
    matrix = ellipse.matrix * scale[:, None]
    noise = ellipse.noise * scale**2
    return replace(ellipse, centre=centre + ellipse.centre * scale, matrix=matrix, noise=noise)
