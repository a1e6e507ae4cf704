"""Propagate the ellipse's uncertainty and the remaining cyclic error to the measured response.

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
from vibrident.data.interferometer.decimation import PASS_EDGE
from vibrident.data.interferometer.ellipse import Ellipse, weighted_mean
from vibrident.data.interferometer.phase import ORDERS, TURN, PhasePath, unwrapped, waves
from vibrident.data.interferometer.setting import (
    BoolArray,
    FloatArray,
    SampledSignals,
    signals_in_memory,
)
from vibrident.data.known.unsure import effect_of

HARMONIC_CHANCE = 1e-4  # a harmonic is significant below this probability
MAX_PIECES = 64  # of a record
MIN_USUAL_SAMPLES = 256  # of a piece; of fast motion, fewer …
MIN_PIECE_SAMPLES = 32  # … but not below this
MAX_PIECE_SAMPLES = 1 << 15
FRINGES_PER_PIECE = 5.0
POLYNOMIAL_DEGREE = 11  # of the polynomial
#: Above this speed, rad per sample, harmonic n is not complete: its sidebands, n + 1 times as fast,
#: are filtered out where a carrier is mixed down.
MAX_SPEED_RAD = TURN * PASS_EDGE / (ORDERS[-1] + 1)
MIN_PIECES = 16
MAX_CONDITION = 1e10  # of the normal equations of the harmonics, in float64
FREQUENCY_BANDS = 16  # of frequency, from the lowest line …
MAX_BAND_HZ_OF_RATE = 0.45  # … to this part of the sampling rate
#: Harmonics of the phase error by (p, q, a, b, e) of an ellipse.
_ELLIPSE_HARMONICS = np.array([
    [0.0, 1.0, 0.0, 0.0, 0.0],
    [-1.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 0.0, 0.0, 0.5],
    [0.0, 0.0, -0.5, 0.5, 0.0],
    [0.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 0.0, 0.0, 0.0],
])  # fmt: skip
MAX_SAMPLES = 1 << 18  # of a phase for its spectrum
NEGLIGIBLE_TO_NOISE = 0.05  # a pattern below this share of the noise of its points is dropped


@dataclass(frozen=True, eq=False)
class CyclicError:
    """Cyclic error of a phase: amplitudes of cos nφ and sin nφ for n = 1, 2, 4."""

    waves: FloatArray  # amplitudes, rad, shape (6,)
    covariance: FloatArray  # of the amplitudes, by noise, shape (6, 6)
    freedom: float  # degrees of freedom of that covariance
    by_ellipse: FloatArray  # covariance by the uncertainty of the ellipse, shape (6, 6)

    def amplitude(self, index: int) -> tuple[float, float]:
        """Return the amplitude of one order, by its index, and its standard uncertainty, rad."""
        pair = slice(2 * index, 2 * index + 2)
        u = float(np.sqrt(0.5 * np.trace(self.covariance[pair, pair])))
        return float(np.hypot(*self.waves[pair])), u

    def rarity(self, index: int) -> float:
        """Return the probability by chance of an amplitude at least as large."""
        pair = slice(2 * index, 2 * index + 2)
        wave = self.waves[pair]
        covariance = self.covariance[pair, pair] + self.by_ellipse[pair, pair]
        square = float(wave @ np.linalg.solve(covariance, wave))
        # Hotelling's T² of two amplitudes
        return float(np.exp(-0.5 * self.freedom * np.log1p(square / self.freedom)))


def cyclic_error(
    signals: SampledSignals,
    ellipse: Ellipse,
    knots: Sequence[tuple[float, Ellipse]],
    fringes_a_sample: float,
    highest_hz: float,
) -> CyclicError | None:
    """Measure the cyclic error of a record.

    Args:
        signals: two signals in quadrature.
        ellipse: ellipse that the phase is from.
        knots: sample index and ellipse, if the ellipse changes; else empty.
        fringes_a_sample: mean length of the phase's path between samples, turns.
        highest_hz: highest frequency of the motion, of which a piece covers a period at most.

    Returns:
        None if the record or a period of its motion is too short, or its signal is lost.
    """
    period = signals.rate_hz / max(highest_hz, 1e-300)
    usual = max(FRINGES_PER_PIECE / max(fringes_a_sample, 1e-9), MIN_USUAL_SAMPLES)
    length = int(min(usual, MAX_PIECE_SAMPLES, period))
    if length < MIN_PIECE_SAMPLES or signals.samples < 2 * length:
        return None
    count = min(MAX_PIECES, signals.samples // length)
    starts = np.unique(np.linspace(0, signals.samples - length, count).astype(int))
    time = np.linspace(-1.0, 1.0, length)
    polynomials, _ = np.linalg.qr(np.polynomial.legendre.legvander(time, POLYNOMIAL_DEGREE))
    normals = []
    scores = []
    for start in starts.tolist():
        path = PhasePath()
        piece = signals_in_memory(signals.block(start, start + length), signals.rate_hz)
        piece_knots = [(index - start, knot) for index, knot in knots]
        phase = np.concatenate(list(unwrapped(piece, ellipse, piece_knots, path)))
        if path.gaps:
            continue
        # Waves of the noisy phase would correlate with its noise.
        smooth = polynomials @ (polynomials.T @ phase)
        is_slow = np.abs(np.gradient(smooth)) < MAX_SPEED_RAD
        if np.count_nonzero(is_slow) < MIN_PIECE_SAMPLES:
            continue
        motion = polynomials if is_slow.all() else np.linalg.qr(polynomials[is_slow])[0]
        rows = np.concatenate([waves(smooth), phase[None, :]])[:, is_slow]
        rows = rows - (rows @ motion) @ motion.T
        normals.append(rows[:6] @ rows[:6].T)
        scores.append(rows[:6] @ rows[6])
    if len(normals) < MIN_PIECES:
        return None
    normal = np.sum(normals, axis=0)
    if np.linalg.cond(normal) > MAX_CONDITION:
        return None
    inverse = np.linalg.inv(normal)
    amplitudes = inverse @ np.sum(scores, axis=0)
    residuals = np.array([s - n @ amplitudes for s, n in zip(scores, normals, strict=True)])
    spread = residuals.T @ residuals * len(residuals) / (len(residuals) - 6.0)
    by_ellipse = _ELLIPSE_HARMONICS @ ellipse.covariance @ _ELLIPSE_HARMONICS.T
    return CyclicError(amplitudes, inverse @ spread @ inverse, len(residuals) - 7.0, by_ellipse)


def combined(errors: Sequence[CyclicError]) -> CyclicError:
    """Return the mean cyclic error of several records, weighted by their covariances.

    Its covariance is that of their scatter, if they scatter more than their covariances explain.
    """
    mean, covariance, total = weighted_mean(
        [error.waves for error in errors], [error.covariance for error in errors]
    )
    scatter = total / max(6 * (len(errors) - 1), 1)
    best = min(errors, key=lambda error: float(np.trace(error.covariance)))
    by_ellipse = np.mean([error.by_ellipse for error in errors], axis=0)
    return CyclicError(mean, covariance * max(scatter, 1.0), best.freedom, by_ellipse)


def significant(errors: Sequence[CyclicError | None]) -> CyclicError | None:
    """Return the mean cyclic error in those orders that are significant over all records.

    None if no order is.
    """
    measured = [error for error in errors if error is not None]
    if not measured:
        return None
    mean = combined(measured)
    is_significant = np.repeat([mean.rarity(i) < HARMONIC_CHANCE for i in range(len(ORDERS))], 2)
    if not is_significant.any():
        return None
    return replace(
        mean,
        waves=np.where(is_significant, mean.waves, 0.0),
        covariance=mean.covariance * np.outer(is_significant, is_significant),
    )


@dataclass(frozen=True, eq=False)
class PhaseErrorResponse:
    """Response of the reference of one record to errors of its phase."""

    frequency_hz: FloatArray  # shape (m,)
    # change of the reference for one radian of cos nφ and sin nφ, n = 1, 2, 4, (6, m)
    harmonics: np.ndarray
    noise: FloatArray  # relative standard uncertainty of the reference by phase noise, shape (m,)
    group: int  # of records that share one ellipse
    covariance: FloatArray  # of the ellipse's shape, shape (4, 4)
    cyclic: CyclicError | None  # the measured cyclic error; None if it cannot be measured

    @property
    def relative(self) -> np.ndarray:
        """Return the change of the reference per unit of p, q, b − a, e; complex, shape (4, m)."""
        cosine, sine, cosine2, sine2 = self.harmonics[:4]
        return np.stack([-sine, cosine, 0.5 * sine2, 0.5 * cosine2])


def harmonics_of_sine(
    amplitude: float, mean: float, frequency_hz: float
) -> tuple[FloatArray, np.ndarray]:
    """Return the frequency of a sine, and the change of its reference by harmonics of the phase.

    The frequency has shape (1,). The changes, for one radian of cos nφ, sin nφ, n = 1, 2, 4, have
    shape (6, 1).
    """
    rows = []
    for n in ORDERS:
        bessel = 2.0 * j1(n * amplitude) / max(amplitude, 1e-300)
        rows += [-bessel * np.sin(n * mean), bessel * np.cos(n * mean)]
    return np.array([frequency_hz]), np.array(rows, dtype=complex)[:, None]


def harmonics_of_motion(
    phase: FloatArray, valid: BoolArray, rate_hz: float
) -> tuple[FloatArray, np.ndarray]:
    """Return frequencies of bands, and the change of the reference by each harmonic.

    For any motion; the frequencies have shape (m,), the changes, as for a sine, (6, m).
    """
    phase = np.where(valid, phase, np.mean(phase[valid]))[:MAX_SAMPLES]
    count = phase.shape[0]
    window = np.hanning(count) if count > 64 else np.ones(count)
    reference = np.asarray(fft.rfft((phase - phase.mean()) * window))
    lines = np.arange(reference.shape[0]) * rate_hz / count
    lowest_hz = max(lines[1], 1e-5 * rate_hz)
    edges = np.geomspace(lowest_hz, MAX_BAND_HZ_OF_RATE * rate_hz, FREQUENCY_BANDS + 1)
    harmonics = waves(phase)
    errors = np.asarray(
        fft.rfft((harmonics - harmonics.mean(axis=1, keepdims=True)) * window, axis=1)
    )
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
    answers: Sequence[PhaseErrorResponse],
    cyclic: Sequence[tuple[Sequence[PhaseErrorResponse], FloatArray]] = (),
) -> tuple[SystematicEffect, ...]:
    """Return the systematic effects of ellipses, and of what remains of cyclic errors.

    Args:
        answers: the responses of the records to errors of the phase.
        cyclic: records that share a cyclic error, with the covariance of what remains of its
            amplitudes, shape (6, 6).
    """
    grid = np.unique(np.concatenate([answer.frequency_hz for answer in answers]))
    patterns = []
    for group in dict.fromkeys(answer.group for answer in answers):
        members = [(answer, answer.relative) for answer in answers if answer.group == group]
        patterns += _patterns(
            "ellipse of the interferometer", "ellipse", members, members[0][0].covariance, grid
        )
    for sharing, covariance in cyclic:
        members = [(answer, answer.harmonics) for answer in sharing]
        patterns += _patterns(
            "cyclic error of the interferometer", "cyclic", members, covariance, grid
        )
    patterns.sort(key=lambda item: -item[0])
    return tuple(effect for _, effect in patterns[:24])  # the largest ones


def _patterns(
    source: str,
    kind: EffectKind,
    members: Sequence[tuple[PhaseErrorResponse, np.ndarray]],
    covariance: FloatArray,
    grid: FloatArray,
) -> list[tuple[float, SystematicEffect]]:
    """Return independent effects with their size over the noise; negligible ones are left out.

    Args:
        source: of the effects, for the budget.
        kind: of the effects.
        members: records, with the change of the reference by a unit of each amplitude, shape
            (amplitudes, m).
        covariance: of the amplitudes.
        grid: frequencies, Hz.
    """
    stacked = np.concatenate([change for _, change in members], axis=1)
    noise = np.concatenate([answer.noise for answer, _ in members])
    powers, axes = np.linalg.eigh(covariance)
    root = axes * np.sqrt(np.maximum(powers, 0.0))
    rows = (root.T @ stacked) / np.maximum(noise, 1e-300)
    values, vectors = np.linalg.eigh(np.real(rows @ np.conj(rows.T)))
    directions = root @ vectors
    return [
        (
            float(value),
            _pattern(
                source,
                kind,
                [(answer.frequency_hz, -(direction @ change)) for answer, change in members],
                grid,
            ),
        )
        for value, direction in zip(values, directions.T, strict=True)
        if value > NEGLIGIBLE_TO_NOISE**2
    ]


def _pattern(
    source: str,
    kind: EffectKind,
    changes: Sequence[tuple[FloatArray, np.ndarray]],
    grid: FloatArray,
) -> SystematicEffect:
    """Return an effect with a tabulated pattern: zero at the frequencies of other records."""
    values = np.zeros(grid.shape, dtype=complex)
    counts = np.zeros(grid.shape)
    for frequency, change in changes:
        at = np.searchsorted(grid, frequency)
        values[at] += change
        counts[at] += 1.0
    values /= np.maximum(counts, 1.0)
    return effect_of(source, kind, grid, values)
