"""Systematic effects of a known response's uncertainty: errors of log K over frequency."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vibrident.base.errors import InputError
from vibrident.data.effects import EffectKind, SystematicEffect

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
ErrorKind = Literal["gain", "phase"]
#: Share of the variance of correlated errors that effects may omit; the others are scaled up.
MAX_OMITTED_VARIANCE = 1e-4
#: Octaves from a corner to which its effect is tabulated, and rows per octave.
CORNER_OCTAVES = 14
ROWS_PER_OCTAVE = 8


def effect_of(
    source: str, kind: EffectKind, frequency_hz: FloatArray, change: NDArray[Any]
) -> SystematicEffect:
    """Return the effect that changes log K by ``change`` per standard uncertainty, shape (n,)."""
    size = float(np.max(np.abs(change))) or 1.0
    columns = frequency_hz, np.real(change) / size, np.imag(change) / size
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return SystematicEffect(source, kind, size, pattern=tuple(rows))


def flat_effects(source: str, relative: float, phase_rad: float) -> tuple[SystematicEffect, ...]:
    """Return effects of a gain error and of a phase error that are equal at all frequencies."""
    sizes: list[tuple[ErrorKind, float]] = [("gain", relative), ("phase", phase_rad)]
    for name, size in sizes:
        _require_sizes(name, np.array([size]))
    return tuple(SystematicEffect(source, kind, float(size)) for kind, size in sizes if size > 0.0)


def change_by(effect: SystematicEffect, frequency_hz: FloatArray) -> ComplexArray:
    """Return the change of log K for one standard uncertainty of an effect, shape (n,)."""
    if not effect.pattern:
        unit = 1.0 if effect.kind == "gain" else -1j
        return np.full(frequency_hz.shape, effect.standard_uncertainty * unit, dtype=complex)
    at, real, imaginary = np.array(effect.pattern).T
    change = np.interp(frequency_hz, at, real) + 1j * np.interp(frequency_hz, at, imaginary)
    return np.asarray(effect.standard_uncertainty * change)


def corner_effect(
    source: str, corner_hz: float, relative: float, *, highpass: bool
) -> SystematicEffect:
    """Return the effect of a first-order corner that is off by ``relative``."""
    octaves = np.linspace(-CORNER_OCTAVES, CORNER_OCTAVES, 2 * CORNER_OCTAVES * ROWS_PER_OCTAVE + 1)
    ratio = 2.0**octaves
    change = relative * (-1.0 if highpass else 1j * ratio) / (1.0 + 1j * ratio)
    return effect_of(f"{source}, corner at {corner_hz:g} Hz", "gain", corner_hz * ratio, change)


def tabulated_effects(
    source: str,
    frequency_hz: FloatArray,
    sizes: Mapping[ErrorKind, Any],
    correlation_octaves: float | None,
) -> tuple[SystematicEffect, ...]:
    """Return the effects of standard uncertainties by frequency.

    Args:
        source: what states them.
        frequency_hz: shape (n,).
        sizes: relative of the gain, rad of the phase, each of shape (n,) or a number; None: none.
        correlation_octaves: distance over which errors lose their correlation; None: full.
    """
    effects: list[SystematicEffect] = []
    for kind, size in sizes.items():
        if size is None:
            continue
        u = np.broadcast_to(np.asarray(size, dtype=float), frequency_hz.shape)
        _require_sizes(kind, u)
        unit = 1.0 if kind == "gain" else -1j
        for column in _columns(frequency_hz, correlation_octaves):
            if np.any(u * column != 0.0):
                effects.append(effect_of(source, kind, frequency_hz, unit * u * column + 0j))
    return tuple(effects)


def _columns(frequency_hz: FloatArray, correlation_octaves: float | None) -> list[FloatArray]:
    """Return columns c with Σ c cᵀ the correlation of errors; ones only for a common error."""
    if correlation_octaves is None:
        return [np.ones(frequency_hz.shape)]
    _require_sizes("correlation", np.array([correlation_octaves]))
    distance = np.subtract.outer(*2 * (np.log2(frequency_hz),)) / max(correlation_octaves, 1e-9)
    values, vectors = np.linalg.eigh(np.exp(-0.5 * distance**2))
    significant = values > MAX_OMITTED_VARIANCE * np.sum(values) / values.size
    columns = vectors[:, significant] * np.sqrt(values[significant])
    columns /= np.sqrt(np.sum(columns**2, axis=1, keepdims=True))
    return list(columns.T[::-1])


def effects_of_covariance(
    source: str, frequency_hz: FloatArray, slopes: ComplexArray, covariance: ArrayLike
) -> tuple[SystematicEffect, ...]:
    """Return the effects of parameters with a covariance.

    Args:
        source: what states them.
        frequency_hz: at which the slopes are, shape (n,).
        slopes: ∂ log K/∂parameter, shape (p, n).
        covariance: of the parameters, shape (p, p).
    """
    size = np.sqrt(np.maximum(np.diag(np.asarray(covariance, dtype=float)), 0.0))
    scale = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(np.asarray(covariance, dtype=float) / np.outer(scale, scale))
    effects = []
    for value, vector in zip(values[::-1], vectors.T[::-1], strict=True):
        change = np.sqrt(max(value, 0.0)) * (scale * vector) @ slopes
        if np.any(change != 0.0):
            turns = np.max(np.abs(change.imag)) > np.max(np.abs(change.real))
            effects.append(effect_of(source, "phase" if turns else "gain", frequency_hz, change))
    return tuple(effects)


def _require_sizes(name: str, sizes: FloatArray) -> None:
    if not np.all(np.isfinite(sizes) & (sizes >= 0.0)):
        raise InputError(
            f"The uncertainty of a known response cannot be used ({name}).",
            expected="finite numbers, 0 or above",
            found=", ".join(f"{value:g}" for value in sizes[:6]),
            where="known response",
            remedy="correct the uncertainties in the file that states the response",
        )
