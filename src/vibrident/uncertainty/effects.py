"""Systematic effects in the data: their contribution to each measured point, and the deviations that they explain.

An effect is common to all points: it changes log H along a known pattern d_k(f) with one unknown factor a_k, whose
prior is N(0, 1) in units of its standard uncertainty. The deviations from the right model then have the covariance
Σ = Σ_noise + Σ_k d_k d_kᵀ, and the test of adequacy is the χ² in that metric. It is computed as the least sum of the
squares of the weighted deviations and of the a_k, over the parameters and the a_k (the two are the same, Woodbury),
with the model as it is, so that an effect may be large beside the noise. A pattern that the parameters can follow
explains nothing, and nothing changes. The a_k are judged by themselves too, as many points would hide one of six: with
S = DᵀD of the part of the patterns that no parameter follows, the covariance of the estimated a_k is S(1 + S)⁻¹.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.measure.verdict import probability
from vibrident.problem import Coordinates
from vibrident.records import FloatArray, Quantity, SystematicEffect
from vibrident.uncertainty.budget import pattern, shift_of_effect
from vibrident.uncertainty.linearised import Linearised

#: Weighted deviations, given z and a change of log H at each point.
Weighted = Callable[[FloatArray, np.ndarray], FloatArray]
SEEN = 1e-3  # an effect is in the data if they reduce the prior variance of a_k by at least this part
#: Largest shift of the estimate, in its standard deviations by noise and effects: a larger one is another optimum, not
#: an effect.
MOST_MOVED = 5.0


@dataclass(frozen=True, eq=False)
class Explained:
    """What effects explain."""

    amounts: FloatArray  # a_k of each effect, in its standard uncertainties, shape (K,)
    chi2: float  # what is left of Σ squares, the a_k counted in
    removed: np.ndarray  # factor on the measured response that takes the effects out of it, complex, shape (n,)
    z: FloatArray  # the estimate that this response gives, shape (p,)
    probability: float  # of a_k at least as large


def patterns(
    effects: Sequence[SystematicEffect],
    coordinates: Coordinates,
    z: FloatArray,
    quantity: Quantity,
    frequency_hz: FloatArray,
) -> np.ndarray:
    """Change of log H by one standard uncertainty of each effect, complex, shape (n, K)."""
    columns = [e.standard_uncertainty * pattern(e, coordinates, z, quantity, frequency_hz) for e in effects]
    return np.stack(columns, axis=1) if columns else np.zeros((len(frequency_hz), 0), complex)


def explain(
    weighted: Weighted,
    effects: Sequence[SystematicEffect],
    shape: np.ndarray,
    coordinates: Coordinates,
    z: FloatArray,
    covariance: FloatArray,
    quantity: Quantity,
    linear: Linearised,
) -> Explained | None:
    """Fit the effects beside the parameters; None where that leads to another optimum than the estimate.

    Args:
        weighted: the deviations over their noise.
        effects: K of them.
        shape: their patterns at the points, shape (n, K).
        coordinates: the map from z to parameters.
        z: the estimate, shape (p,).
        covariance: of z, by noise, shape (p, p).
        quantity: of the reference.
        linear: the fit, linearised at ``z``.
    """
    from scipy.optimize import least_squares  # slow to load

    p = len(z)

    def residual(x: FloatArray) -> FloatArray:
        return np.concatenate([weighted(z + x[:p], shape @ x[p:]), x[p:]])

    with np.errstate(all="ignore"):
        found = least_squares(residual, np.zeros(p + shape.shape[1]), jac="3-point", max_nfev=60, xtol=1e-10)
    shift, amounts = found.x[:p], found.x[p:]
    moved = np.stack([shift_of_effect(e, coordinates, z, quantity, linear) for e in effects], axis=1)
    moved = moved * np.maximum(np.abs(amounts), 1.0)
    allowed = MOST_MOVED * np.sqrt(np.maximum(np.diag(covariance), 0.0) + np.sum(moved**2, axis=1)) + 1e-9
    if not np.all(np.isfinite(found.x)) or np.any(np.abs(shift) > allowed):
        return None
    jacobian = found.jac[: -shape.shape[1]]
    stated = np.array([effect.kind != "rounding" for effect in effects])  # of the others the size is no claim
    beside = np.concatenate([np.ones(p, dtype=bool), ~stated])
    chance = _chance(amounts[stated], jacobian[:, beside], jacobian[:, ~beside])
    return Explained(amounts, float(2.0 * found.cost), np.exp(-shape @ amounts), z + shift, chance)


def _chance(amounts: FloatArray, slopes: FloatArray, effects: FloatArray) -> float:
    """Probability of a_k at least as large where the stated uncertainties are right."""
    left, size, _ = np.linalg.svd(slopes, full_matrices=False)
    basis = left[:, size > 1e-9 * max(float(size.max(initial=0.0)), 1e-300)]
    free = effects - basis @ (basis.T @ effects)
    values, vectors = np.linalg.eigh(free.T @ free)
    seen = values > SEEN
    chi2 = float(np.sum((vectors.T @ amounts)[seen] ** 2 * (1.0 + values[seen]) / values[seen]))
    return probability(chi2, int(seen.sum()))


def deviation_uncertainty(linear: Linearised, shape: np.ndarray, scatter: float = 1.0) -> FloatArray:
    """Standard uncertainty of the deviation between the points and a model that was fitted to them.

    The model follows the points: noise by the leverage of each, and of an effect all that its parameters can imitate.
    What it does not follow is left: (1 − h) of the noise's variance, and the rest of each pattern.

    ``linear``: m rows, magnitudes first, phases (if any) after them; ``shape``: patterns of the effects at the n
    points, shape (n, K); ``scatter``: standard deviation of the noise in units of the rows' weights.

    Returns:
        Of log H, shape (m,): relative for magnitudes, rad for phases; NaN for a point that any value would fit.
    """
    repeats = len(linear.frequency_hz) // max(len(shape), 1)
    rows = np.tile(shape, (repeats, 1))
    part = np.where(linear.is_phase[:, None], np.imag(rows), np.real(rows)) * linear.weight[:, None]
    left, size, _ = np.linalg.svd(linear.matrix, full_matrices=False)
    basis = left[:, size > 1e-9 * max(float(size.max(initial=0.0)), 1e-300)]
    noise = 1.0 - np.sum(basis**2, axis=1)
    effect = np.sum((part - basis @ (basis.T @ part)) ** 2, axis=1)
    variance = np.where(noise > 1e-6, scatter**2 * noise + effect, np.nan)
    return np.sqrt(variance) / linear.weight
