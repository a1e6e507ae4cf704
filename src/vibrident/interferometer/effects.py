"""Effect of the ellipse's uncertainty on the measured response.

Errors p, q (centre), b − a (ratio), e (quadrature) of the ellipse give the phase error

    −p sin φ + q cos φ + (b − a)/2 sin 2φ + e/2 (1 + cos 2φ).

For a sine of phase amplitude Φ about φ₀ its part at the sine's frequency follows from J₁(Φ) and J₁(2Φ) (Bessel); for
other motion from the cross spectrum of error and phase, by bands.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.special import j1

from vibrident.effects import SystematicEffect
from vibrident.interferometer.cyclic import ORDERS, Cyclic, together, waves
from vibrident.interferometer.setting import BoolArray, FloatArray

#: Bands of motion that is not a sine.
BANDS = 16
#: Most samples used.
MOST = 1 << 18
#: Most patterns that are kept, the largest ones.
MOST_PATTERNS = 24
#: A pattern below this part of the noise of its points is dropped.
NEGLIGIBLE = 0.05
#: A harmonic of the cyclic error is significant below this probability.
CHANCE = 1e-4
SOURCE = "ellipse of the interferometer"
CYCLIC = "cyclic error of the interferometer"


@dataclass(frozen=True, eq=False)
class Answer:
    """Effect of the ellipse's errors on the reference of one record.

    Attributes:
        frequency_hz: shape (m,).
        relative: change of the reference for one unit of p, q, b − a, e, complex, shape (4, m).
        harmonics: the same for one radian of cos nφ and sin nφ, n = 1, 2, 4, shape (6, m).
        noise: relative standard uncertainty of the reference by phase noise, shape (m,).
        group: of records that share one ellipse.
        covariance: of the ellipse's shape, shape (4, 4).
        cyclic: the measured cyclic error; None if it cannot be measured.
    """

    frequency_hz: FloatArray
    relative: np.ndarray
    harmonics: np.ndarray
    noise: FloatArray
    group: int
    covariance: FloatArray
    cyclic: Cyclic | None


def of_sine(amplitude: float, mean: float, frequency_hz: float) -> tuple[FloatArray, np.ndarray]:
    """Frequency, shape (1,), and change of the reference for one radian of cos nφ, sin nφ, n = 1, 2, 4: (6, 1)."""
    rows = []
    for n in ORDERS:
        part = 2.0 * j1(n * amplitude) / max(amplitude, 1e-300)
        rows += [-part * np.sin(n * mean), part * np.cos(n * mean)]
    return np.array([frequency_hz]), np.array(rows, dtype=complex)[:, None]


def of_motion(phase: FloatArray, valid: BoolArray, rate_hz: float) -> tuple[FloatArray, np.ndarray]:
    """The same for any motion, in bands: frequencies (m,) and changes (6, m)."""
    phase = np.where(valid, phase, np.mean(phase[valid]))[:MOST]
    count = phase.shape[0]
    window = np.hanning(count) if count > 64 else np.ones(count)
    reference = np.asarray(fft.rfft((phase - phase.mean()) * window))
    lines = np.arange(reference.shape[0]) * rate_hz / count
    edges = np.geomspace(max(lines[1], 1e-5 * rate_hz), 0.45 * rate_hz, BANDS + 1)
    found = waves(phase)
    errors = np.asarray(fft.rfft((found - found.mean(axis=1, keepdims=True)) * window, axis=1))
    frequencies, columns = [], []
    for low, high in itertools.pairwise(edges):
        inside = (lines >= low) & (lines < high)
        power = float(np.sum(np.abs(reference[inside]) ** 2))
        if inside.any() and power > 0:
            frequencies.append(float(np.sqrt(low * high)))
            columns.append(errors[:, inside] @ np.conj(reference[inside]) / power)
    return np.array(frequencies), np.array(columns).T


def of_shape(harmonics: np.ndarray) -> np.ndarray:
    """Change of the reference for one unit of p, q, b − a, e from those for cos nφ, sin nφ: (6, m) → (4, m)."""
    return np.stack([-harmonics[1], harmonics[0], 0.5 * harmonics[3], 0.5 * harmonics[2]])


def effects(answers: Sequence[Answer]) -> tuple[SystematicEffect, ...]:
    """The systematic effects of ellipses and measured cyclic errors on a calibration."""
    found: list[tuple[float, SystematicEffect]] = []
    grid = np.unique(np.concatenate([answer.frequency_hz for answer in answers]))
    for group in dict.fromkeys(answer.group for answer in answers):
        members = [answer for answer in answers if answer.group == group]
        stacked = np.concatenate([answer.relative for answer in members], axis=1)
        noise = np.concatenate([answer.noise for answer in members])
        values, vectors = np.linalg.eigh(_weighed(stacked, noise, members[0].covariance))
        root = _root(members[0].covariance)
        for value, vector in zip(values[::-1], vectors.T[::-1], strict=True):
            if value > NEGLIGIBLE**2:
                parts = [(one.frequency_hz, -(root @ vector @ one.relative)) for one in members]
                found.append((float(value), _pattern(SOURCE, "ellipse", parts, grid)))
    error = _cyclic(answers)
    if np.any(error):
        parts = [(answer.frequency_hz, -(error @ answer.harmonics)) for answer in answers]
        found.append((np.inf, _pattern(CYCLIC, "cyclic", parts, grid)))
    found.sort(key=lambda item: -item[0])
    return tuple(effect for _, effect in found[:MOST_PATTERNS])


def _cyclic(answers: Sequence[Answer]) -> FloatArray:
    """Amplitudes of the set-up's cyclic error, rad, shape (6,): of the orders significant over all records."""
    whole = together([answer.cyclic for answer in answers if answer.cyclic is not None])
    if whole is None:
        return np.zeros(6)
    there = np.array([whole.rarity(i) < CHANCE for i in range(len(ORDERS))])
    return np.where(np.repeat(there, 2), whole.waves, 0.0)


def _root(covariance: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def _weighed(stacked: np.ndarray, noise: FloatArray, covariance: FloatArray) -> FloatArray:
    """Σ over points of |change|² over the noise's variance, in directions of unit variance, shape (4, 4)."""
    rows = (_root(covariance).T @ stacked) / np.maximum(noise, 1e-300)
    return np.real(rows @ np.conj(rows.T))


def _pattern(
    source: str, kind: str, parts: Sequence[tuple[FloatArray, np.ndarray]], grid: FloatArray
) -> SystematicEffect:
    """An effect with a tabulated pattern: zero at the frequencies of other records."""
    values = np.zeros(grid.shape, dtype=complex)
    seen = np.zeros(grid.shape)
    for frequency, change in parts:
        at = np.searchsorted(grid, frequency)
        values[at] += change
        seen[at] += 1.0
    values /= np.maximum(seen, 1.0)
    largest = float(np.max(np.abs(values))) or 1.0
    shape = tuple(
        (float(f), float(v.real) / largest, float(v.imag) / largest) for f, v in zip(grid, values, strict=True)
    )
    return SystematicEffect(source, kind, largest, pattern=shape)  # type: ignore[arg-type]
