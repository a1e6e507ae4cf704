"""Matrix exponential of small matrices: scaling, Taylor series, squaring (Higham 2009, sec. 2).

The norm is brought below one half, where 18 terms are exact to rounding; each squaring doubles the error, so for the
norms used here (up to 10⁴) the result is good to about 1e-12, tested against SciPy. SciPy's own takes 0.2 s to load.
JAX's compiles five Padé approximants with their solves, several seconds with derivatives; here the loops are rolled up.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vibrident.models.base import array_library

TERMS = 18


def expm(matrix: Any) -> Any:
    """exp(matrix), shape (n, n); of JAX arrays, with forward derivatives."""
    if array_library(matrix) is np:
        return _expm(matrix)
    from vibrident.backend import jnp, lax

    norm = jnp.max(jnp.sum(jnp.abs(lax.stop_gradient(matrix)), axis=0))
    squarings = jnp.maximum(0, jnp.ceil(jnp.log2(jnp.maximum(norm, 1e-300))) + 1).astype(int)
    scaled = matrix * 0.5**squarings
    unit = jnp.eye(matrix.shape[0])

    def horner(step: Any, series: Any) -> Any:
        return unit + scaled @ series / (TERMS - step)

    series = lax.fori_loop(0, TERMS, horner, unit)
    return lax.fori_loop(0, squarings, lambda _, power: power @ power, series)


def _expm(matrix: Any) -> Any:
    norm = float(np.max(np.sum(np.abs(matrix), axis=0)))
    if not np.isfinite(norm):
        return np.full_like(matrix, np.nan)
    squarings = max(0, int(np.ceil(np.log2(max(norm, 1e-300)))) + 1)
    scaled, unit = matrix * 0.5**squarings, np.eye(len(matrix))
    power = unit
    for terms in range(TERMS, 0, -1):
        power = unit + scaled @ power / terms
    for _ in range(squarings):
        power = power @ power
    return power
