"""D- and A-optimal choices of points, by exchange, and their efficiency.

With M the information of a design, the D-optimal one has the largest det M (the smallest ellipsoid
of all parameters), the A-optimal one the smallest Σ (u_i/scale_i)² (the smallest variances). The
choice of n out of many is found by exchanging points while that improves it (Fedorov 1972), from
several starts. Its bound is the best design of the same total with arbitrary weights, characterised
by the equivalence theorem of Kiefer and Wolfowitz and found by the multiplicative algorithm
(Silvey, Titterington & Torsney 1978).
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.information import inverse_normal

Criterion = Literal["D", "A"]
CRITERIA: tuple[str, ...] = ("D", "A")

RANDOM_STARTS = 20  # of the exchange, in addition to the greedy start
MAX_ITERATIONS = 20_000  # of the multiplicative algorithm
EQUIVALENCE_TOLERANCE = 1e-6  # of the condition of the equivalence theorem


def loss(matrix: FloatArray, criterion: Criterion, scale: FloatArray) -> float:
    """Return the criterion of a design, smaller is better: D: −log det M / p; A: Σ (u/scale)²."""
    if criterion == "D":
        size = np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
        values = np.linalg.eigvalsh(matrix / size[:, None] / size)
        return float(-np.mean(np.log(np.maximum(values, 1e-14))) - 2.0 * np.mean(np.log(size)))
    return float(np.sum(np.diag(inverse_normal(matrix)) / scale**2))


def best_points(
    information: FloatArray,
    count: int,
    criterion: Criterion,
    scale: FloatArray,
    *,
    repeats: bool = False,
) -> np.ndarray:
    """Return the uses of each point, shape (n,): ``count`` in all.

    Each is used at most once unless ``repeats``. ``information``: of each point, shape (n, p, p);
    ``scale``: of each parameter, for the criterion A, shape (p,).
    """
    rng = np.random.default_rng(0)
    points = information.shape[0]
    starts = [_greedy_uses(information, count, criterion, scale, repeats=repeats)]
    for _ in range(RANDOM_STARTS):
        picks = rng.choice(points, count, replace=repeats)
        starts.append(np.bincount(picks, minlength=points))
    designs = [_exchange(uses, information, criterion, scale, repeats=repeats) for uses in starts]
    return min(designs, key=lambda uses: loss(total(uses, information), criterion, scale))


def total(uses: np.ndarray, information: FloatArray) -> FloatArray:
    """Return the information of points, each used so many times, shape (p, p)."""
    return np.einsum("k,kij->ij", uses.astype(float), information)


def _greedy_uses(
    information: FloatArray, count: int, criterion: Criterion, scale: FloatArray, *, repeats: bool
) -> np.ndarray:
    """Choose one point after the other.

    The start is a small part of all points, so that the first matrix is regular.
    """
    uses = np.zeros(information.shape[0], dtype=int)
    matrix = 1e-6 * np.mean(information, axis=0)
    for _ in range(count):
        open_points = np.flatnonzero(repeats | (uses == 0))
        losses = [loss(matrix + information[k], criterion, scale) for k in open_points]
        pick = open_points[int(np.argmin(losses))]
        uses[pick] += 1
        matrix = matrix + information[pick]
    return uses


def _exchange(
    uses: np.ndarray,
    information: FloatArray,
    criterion: Criterion,
    scale: FloatArray,
    *,
    repeats: bool,
) -> np.ndarray:
    uses = uses.copy()
    matrix = total(uses, information)
    best = loss(matrix, criterion, scale)
    while True:
        step = None
        for out in np.flatnonzero(uses):
            without = matrix - information[out]
            for new in np.flatnonzero(repeats | (uses == 0)):
                value = loss(without + information[new], criterion, scale)
                if value < best - 1e-9 * max(abs(best), 1.0):
                    best = value
                    step = (out, new)
        if step is None:
            return uses
        uses[step[0]] -= 1
        uses[step[1]] += 1
        matrix = total(uses, information)  # summed again: updates accumulate rounding errors


def best_weights(information: FloatArray, criterion: Criterion, scale: FloatArray) -> FloatArray:
    """Return the weights of the best design, of total one, shape (n,)."""
    points = information.shape[0]
    order = information.shape[1]
    weights = np.full(points, 1.0 / points)
    for _ in range(MAX_ITERATIONS):
        inverse = inverse_normal(total(weights, information))
        if criterion == "D":
            gain = np.einsum("kij,ji->k", information, inverse) / order
        else:
            middle = inverse @ np.diag(scale**-2.0) @ inverse
            gain = np.einsum("kij,ji->k", information, middle) / np.trace(
                inverse @ np.diag(scale**-2.0)
            )
        if float(np.max(gain)) < 1.0 + EQUIVALENCE_TOLERANCE:
            break
        weights = weights * (gain if criterion == "D" else np.sqrt(gain))
        weights /= weights.sum()
    return weights


def efficiency(
    uses: np.ndarray, information: FloatArray, criterion: Criterion, scale: FloatArray
) -> float:
    """Return the efficiency of a choice relative to the best design of the same total, 0 to 1.

    It is the part of the measuring time that the best design would need for the same criterion.
    """
    count = float(np.sum(uses))
    weights = best_weights(information, criterion, scale)
    ideal = count * total(weights, information)
    achieved = loss(total(np.asarray(uses), information), criterion, scale)
    best = loss(ideal, criterion, scale)
    return float(np.exp(best - achieved)) if criterion == "D" else best / achieved
