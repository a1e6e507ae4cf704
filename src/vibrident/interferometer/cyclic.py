"""The cyclic error left in the phase: harmonics 1, 2 and 4 of the phase itself.

Each short piece of the unwrapped phase is a polynomial of time (the motion) plus harmonics of the phase. The polynomial
is projected out, and one set of harmonics is fitted to all pieces. Motion below a fringe a piece resembles a
polynomial, which gives a large uncertainty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.interferometer.decimation import PASS
from vibrident.interferometer.ellipse import Ellipse
from vibrident.interferometer.phase import ORDERS, TURN, Path, unwrapped, waves
from vibrident.interferometer.setting import FloatArray, Held, Signals

CHANCE = 1e-4  # a harmonic is significant below this probability
PIECES = 64  # most pieces of a record
USUAL = 256  # samples of a piece, at least; of fast motion, fewer …
SHORTEST = 32  # … but not below this
LONGEST = 1 << 15  # longest piece, samples
FRINGES = 5.0  # fringes of a piece
DEGREE = 11  # degree of the polynomial
#: Harmonic n of faster motion, rad a sample, is not seen whole: its sidebands, n + 1 times as fast, are filtered out
#: where a carrier is mixed down.
SLOW = TURN * PASS / (ORDERS[-1] + 1)
FEWEST = 16  # fewest pieces
#: Harmonics of the phase error by (p, q, a, b, e) of an ellipse.
_OF_ELLIPSE = np.array([
    [0.0, 1.0, 0.0, 0.0, 0.0],
    [-1.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 0.0, 0.0, 0.5],
    [0.0, 0.0, -0.5, 0.5, 0.0],
    [0.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 0.0, 0.0, 0.0],
])  # fmt: skip


@dataclass(frozen=True, eq=False)
class Cyclic:
    """Amplitudes of cos nφ and sin nφ for n = 1, 2, 4."""

    waves: FloatArray  # amplitudes, rad, shape (6,)
    covariance: FloatArray  # of them by noise, shape (6, 6)
    freedom: float  # its degrees of freedom
    by_ellipse: FloatArray  # covariance of them by the uncertainty of the ellipse, shape (6, 6)

    def amplitude(self, index: int) -> tuple[float, float]:
        """Amplitude of one of the orders and its standard uncertainty, rad."""
        part = slice(2 * index, 2 * index + 2)
        u = float(np.sqrt(0.5 * np.trace(self.covariance[part, part])))
        return float(np.hypot(*self.waves[part])), u

    def rarity(self, index: int) -> float:
        """Probability of an amplitude at least as large by chance."""
        part = slice(2 * index, 2 * index + 2)
        wave = self.waves[part]
        covariance = self.covariance[part, part] + self.by_ellipse[part, part]
        square = float(wave @ np.linalg.solve(covariance, wave))
        return float(np.exp(-0.5 * self.freedom * np.log1p(square / self.freedom)))  # Hotelling's T² of two


def cyclic_error(
    signals: Signals,
    ellipse: Ellipse,
    knots: Sequence[tuple[float, Ellipse]],
    fringes_a_sample: float,
    highest_hz: float,
) -> Cyclic | None:
    """Measure the cyclic error of a record; None if the record or a period of its motion is too short, or its signal
    lost.

    Args:
        signals: two in quadrature.
        ellipse: that the phase is from.
        knots: sample index and ellipse, where it changes; else empty.
        fringes_a_sample: mean length of the phase's path between samples, turns.
        highest_hz: of the motion: within a period of it, the polynomial is the motion.
    """
    period = signals.rate_hz / max(highest_hz, 1e-300)
    length = int(min(max(FRINGES / max(fringes_a_sample, 1e-9), USUAL), LONGEST, period))
    if length < SHORTEST or signals.samples < 2 * length:
        return None
    starts = np.unique(np.linspace(0, signals.samples - length, min(PIECES, signals.samples // length)).astype(int))
    polynomials, _ = np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, length), DEGREE))
    normals, scores = [], []
    for start in starts.tolist():
        path = Path()
        piece = Held(signals.block(start, start + length), signals.rate_hz)
        moved = [(at - start, knot) for at, knot in knots]
        phase = np.concatenate(list(unwrapped(piece, ellipse, moved, path)))
        if path.gaps:
            continue
        smooth = polynomials @ (polynomials.T @ phase)  # otherwise the phase noise would correlate with the waves
        slow = np.abs(np.gradient(smooth)) < SLOW
        if np.count_nonzero(slow) < SHORTEST:
            continue
        motion = polynomials if slow.all() else np.linalg.qr(polynomials[slow])[0]
        rows = np.concatenate([waves(smooth), phase[None, :]])[:, slow]
        rows = rows - (rows @ motion) @ motion.T
        normals.append(rows[:6] @ rows[:6].T)
        scores.append(rows[:6] @ rows[6])
    if len(normals) < FEWEST:
        return None
    whole = np.sum(normals, axis=0)
    if np.linalg.cond(whole) > 1e10:
        return None
    inverse = np.linalg.inv(whole)
    found = inverse @ np.sum(scores, axis=0)
    left = np.array([score - normal @ found for score, normal in zip(scores, normals, strict=True)])
    spread = left.T @ left * len(left) / (len(left) - 6.0)
    allowed = _OF_ELLIPSE @ ellipse.covariance @ _OF_ELLIPSE.T
    return Cyclic(found, inverse @ spread @ inverse, len(left) - 7.0, allowed)


def together(found: Sequence[Cyclic]) -> Cyclic | None:
    """The mean of several records, weighted by their covariances; None without records.

    Its covariance is that of their scatter, if they scatter by more than theirs.
    """
    if not found:
        return None
    weights = [np.linalg.inv(one.covariance) for one in found]
    covariance = np.linalg.inv(np.sum(weights, axis=0))
    mean = covariance @ np.sum([w @ one.waves for w, one in zip(weights, found, strict=True)], axis=0)
    apart = [one.waves - mean for one in found]
    scatter = sum(float(d @ w @ d) for d, w in zip(apart, weights, strict=True)) / max(6 * (len(found) - 1), 1)
    best = min(found, key=lambda one: float(np.trace(one.covariance)))
    by_ellipse = np.mean([one.by_ellipse for one in found], axis=0)
    return Cyclic(mean, covariance * max(scatter, 1.0), best.freedom, by_ellipse)


def significant(found: Sequence[Cyclic]) -> Cyclic | None:
    """The cyclic error of a set-up in the orders that are significant over all its records; None without any."""
    whole = together(found)
    if whole is None:
        return None
    there = np.repeat([whole.rarity(i) < CHANCE for i in range(len(ORDERS))], 2)
    if not there.any():
        return None
    return replace(whole, waves=np.where(there, whole.waves, 0.0), covariance=whole.covariance * np.outer(there, there))
