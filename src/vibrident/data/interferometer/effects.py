"""Effect of the ellipse's uncertainty, and of the cyclic error left in the phase, on the measured response.

Errors p, q (centre), b − a (ratio), e (quadrature) of the ellipse give the phase error

    −p sin φ + q cos φ + (b − a)/2 sin 2φ + e/2 (1 + cos 2φ).

For a sine of phase amplitude Φ about φ₀ its part at the sine's frequency follows from J₁(Φ) and
J₁(2Φ) (Bessel); for other motion from the cross spectrum of error and phase, by bands.

The cyclic error is harmonics 1, 2 and 4 of the phase itself. Each short piece of the unwrapped
phase is a polynomial of time (the motion) plus harmonics of the phase. The polynomial is projected
out, and one set of harmonics is fitted to all pieces. Motion below a fringe a piece resembles a
polynomial, which gives a large uncertainty.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft
from scipy.special import j1

from vibrident.data.effects import EffectKind, SystematicEffect
from vibrident.data.interferometer.decimation import PASS
from vibrident.data.interferometer.ellipse import Ellipse
from vibrident.data.interferometer.phase import ORDERS, TURN, Path, unwrapped, waves
from vibrident.data.interferometer.setting import BoolArray, FloatArray, Signals, held

CHANCE = 1e-4  # a harmonic is significant below this probability
PIECES = 64  # most pieces of a record
USUAL = 256  # samples of a piece, at least; of fast motion, fewer …
SHORTEST = 32  # … but not below this
LONGEST = 1 << 15  # longest piece, samples
FRINGES = 5.0  # fringes of a piece
DEGREE = 11  # degree of the polynomial
#: Harmonic n of faster motion, rad a sample, is not seen whole: its sidebands, n + 1 times as fast,
#: are filtered out where a carrier is mixed down.
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
MOST = 1 << 18  # most samples used
NEGLIGIBLE = 0.05  # a pattern below this part of the noise of its points is dropped


@dataclass(frozen=True, eq=False)
class Cyclic:
    """Amplitudes of cos nφ and sin nφ for n = 1, 2, 4."""

    waves: FloatArray  # amplitudes, rad, shape (6,)
    covariance: FloatArray  # of them by noise, shape (6, 6)
    freedom: float  # its degrees of freedom
    by_ellipse: FloatArray  # covariance of them by the uncertainty of the ellipse, shape (6, 6)

    def amplitude(self, index: int) -> tuple[float, float]:
        """Return the amplitude of one of the orders and its standard uncertainty, rad."""
        part = slice(2 * index, 2 * index + 2)
        u = float(np.sqrt(0.5 * np.trace(self.covariance[part, part])))
        return float(np.hypot(*self.waves[part])), u

    def rarity(self, index: int) -> float:
        """Return the probability of an amplitude at least as large by chance."""
        part = slice(2 * index, 2 * index + 2)
        wave = self.waves[part]
        covariance = self.covariance[part, part] + self.by_ellipse[part, part]
        square = float(wave @ np.linalg.solve(covariance, wave))
        # Hotelling's T² of two
        return float(np.exp(-0.5 * self.freedom * np.log1p(square / self.freedom)))


def cyclic_error(
    signals: Signals,
    ellipse: Ellipse,
    knots: Sequence[tuple[float, Ellipse]],
    fringes_a_sample: float,
    highest_hz: float,
) -> Cyclic | None:
    """Measure the cyclic error of a record; None if the record or a period of its motion is too short, or its signal
    lost.

    ``ellipse``: that the phase is from; ``knots``: sample index and ellipse, where it changes; else
    empty; ``fringes_a_sample``: mean length of the phase's path between samples, turns;
    ``highest_hz``: of the motion: within a period of it, the polynomial is the motion.
    """
    period = signals.rate_hz / max(highest_hz, 1e-300)
    length = int(min(max(FRINGES / max(fringes_a_sample, 1e-9), USUAL), LONGEST, period))
    if length < SHORTEST or signals.samples < 2 * length:
        return None
    starts = np.unique(
        np.linspace(0, signals.samples - length, min(PIECES, signals.samples // length)).astype(int)
    )
    polynomials, _ = np.linalg.qr(
        np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, length), DEGREE)
    )
    normals = []
    scores = []
    for start in starts.tolist():
        path = Path()
        piece = held(signals.block(start, start + length), signals.rate_hz)
        moved = [(at - start, knot) for at, knot in knots]
        phase = np.concatenate(list(unwrapped(piece, ellipse, moved, path)))
        if path.gaps:
            continue
        # otherwise the phase noise would correlate with the waves
        smooth = polynomials @ (polynomials.T @ phase)
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


def together(found: Sequence[Cyclic]) -> Cyclic:
    """Return the mean of several records, weighted by their covariances.

    Its covariance is that of their scatter, if they scatter by more than theirs.
    """
    weights = [np.linalg.inv(one.covariance) for one in found]
    covariance = np.linalg.inv(np.sum(weights, axis=0))
    mean = covariance @ np.sum(
        [w @ one.waves for w, one in zip(weights, found, strict=True)], axis=0
    )
    apart = [one.waves - mean for one in found]
    scatter = sum(float(d @ w @ d) for d, w in zip(apart, weights, strict=True)) / max(
        6 * (len(found) - 1), 1
    )
    best = min(found, key=lambda one: float(np.trace(one.covariance)))
    by_ellipse = np.mean([one.by_ellipse for one in found], axis=0)
    return Cyclic(mean, covariance * max(scatter, 1.0), best.freedom, by_ellipse)


def significant(found: Sequence[Cyclic | None]) -> Cyclic | None:
    """Return the cyclic error of a set-up in the orders that are significant over all its records; None without any."""
    measured = [one for one in found if one is not None]
    if not measured:
        return None
    whole = together(measured)
    there = np.repeat([whole.rarity(i) < CHANCE for i in range(len(ORDERS))], 2)
    if not there.any():
        return None
    return replace(
        whole,
        waves=np.where(there, whole.waves, 0.0),
        covariance=whole.covariance * np.outer(there, there),
    )


@dataclass(frozen=True, eq=False)
class Answer:
    """Effect of the ellipse's errors on the reference of one record."""

    frequency_hz: FloatArray  # shape (m,)
    # change of the reference for one radian of cos nφ and sin nφ, n = 1, 2, 4, (6, m)
    harmonics: np.ndarray
    noise: FloatArray  # relative standard uncertainty of the reference by phase noise, shape (m,)
    group: int  # of records that share one ellipse
    covariance: FloatArray  # of the ellipse's shape, shape (4, 4)
    cyclic: Cyclic | None  # the measured cyclic error; None if it cannot be measured

    @property
    def relative(self) -> np.ndarray:
        """Return the change of the reference for one unit of p, q, b − a, e of the ellipse, complex, shape (4, m)."""
        cosine, sine, cosine2, sine2 = self.harmonics[:4]
        return np.stack([-sine, cosine, 0.5 * sine2, 0.5 * cosine2])


def of_sine(amplitude: float, mean: float, frequency_hz: float) -> tuple[FloatArray, np.ndarray]:
    """Return the frequency, shape (1,), and change of the reference for one radian of cos nφ, sin nφ, n = 1, 2, 4: (6, 1)."""
    rows = []
    for n in ORDERS:
        part = 2.0 * j1(n * amplitude) / max(amplitude, 1e-300)
        rows += [-part * np.sin(n * mean), part * np.cos(n * mean)]
    return np.array([frequency_hz]), np.array(rows, dtype=complex)[:, None]


def of_motion(phase: FloatArray, valid: BoolArray, rate_hz: float) -> tuple[FloatArray, np.ndarray]:
    """Return the same for any motion, in bands: frequencies (m,) and changes (6, m)."""
    phase = np.where(valid, phase, np.mean(phase[valid]))[:MOST]
    count = phase.shape[0]
    window = np.hanning(count) if count > 64 else np.ones(count)
    reference = np.asarray(fft.rfft((phase - phase.mean()) * window))
    lines = np.arange(reference.shape[0]) * rate_hz / count
    edges = np.geomspace(max(lines[1], 1e-5 * rate_hz), 0.45 * rate_hz, 17)  # of 16 bands
    found = waves(phase)
    errors = np.asarray(fft.rfft((found - found.mean(axis=1, keepdims=True)) * window, axis=1))
    frequencies = []
    columns = []
    for low, high in itertools.pairwise(edges):
        inside = (lines >= low) & (lines < high)
        power = float(np.sum(np.abs(reference[inside]) ** 2))
        if inside.any() and power > 0:
            frequencies.append(float(np.sqrt(low * high)))
            columns.append(errors[:, inside] @ np.conj(reference[inside]) / power)
    return np.array(frequencies), np.array(columns).T


def effects(
    answers: Sequence[Answer], cyclic: Sequence[tuple[Sequence[Answer], FloatArray]] = ()
) -> tuple[SystematicEffect, ...]:
    """Return the systematic effects of ellipses, and of what remains of cyclic errors, on a calibration.

    ``cyclic``: records that share a cyclic error, with the covariance of what remains of its
    amplitudes, shape (6, 6).
    """
    grid = np.unique(np.concatenate([answer.frequency_hz for answer in answers]))
    found = []
    for group in dict.fromkeys(answer.group for answer in answers):
        members = [(answer, answer.relative) for answer in answers if answer.group == group]
        found += _patterns(
            "ellipse of the interferometer", "ellipse", members, members[0][0].covariance, grid
        )
    for some, covariance in cyclic:
        members = [(answer, answer.harmonics) for answer in some]
        found += _patterns(
            "cyclic error of the interferometer", "cyclic", members, covariance, grid
        )
    found.sort(key=lambda item: -item[0])
    return tuple(effect for _, effect in found[:24])  # the largest ones


def _patterns(
    source: str,
    kind: EffectKind,
    members: Sequence[tuple[Answer, np.ndarray]],
    covariance: FloatArray,
    grid: FloatArray,
) -> list[tuple[float, SystematicEffect]]:
    """Return independent effects of amplitudes with a covariance, with their size over the noise; not negligible ones.

    ``source``: of the effects, for the budget; ``members``: records, with the change of the
    reference by a unit of each amplitude, shape (amplitudes, m); ``covariance``: of the amplitudes;
    ``grid``: frequencies, Hz.
    """
    stacked = np.concatenate([change for _, change in members], axis=1)
    noise = np.concatenate([answer.noise for answer, _ in members])
    powers, axes = np.linalg.eigh(covariance)
    root = axes * np.sqrt(np.maximum(powers, 0.0))
    rows = (root.T @ stacked) / np.maximum(noise, 1e-300)
    values, vectors = np.linalg.eigh(np.real(rows @ np.conj(rows.T)))
    turned = root @ vectors
    return [
        (
            float(value),
            _pattern(
                source,
                kind,
                [(one.frequency_hz, -(along @ change)) for one, change in members],
                grid,
            ),
        )
        for value, along in zip(values, turned.T, strict=True)
        if value > NEGLIGIBLE**2
    ]


def _pattern(
    source: str, kind: EffectKind, parts: Sequence[tuple[FloatArray, np.ndarray]], grid: FloatArray
) -> SystematicEffect:
    """Return an effect with a tabulated pattern: zero at the frequencies of other records."""
    values = np.zeros(grid.shape, dtype=complex)
    seen = np.zeros(grid.shape)
    for frequency, change in parts:
        at = np.searchsorted(grid, frequency)
        values[at] += change
        seen[at] += 1.0
    values /= np.maximum(seen, 1.0)
    largest = float(np.max(np.abs(values))) or 1.0
    shape = tuple(
        (float(f), float(v.real) / largest, float(v.imag) / largest)
        for f, v in zip(grid, values, strict=True)
    )
    return SystematicEffect(source, kind, largest, pattern=shape)
