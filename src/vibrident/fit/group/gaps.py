"""Samples of a response that are left out, as nuisance parameters of their segment.

A signal that is set to zero in a gap leaks: noise that rings in a narrow resonance reaches bins in
which there is hardly any. The values in the gap are unknown numbers instead, which are least
squares in the weights W of the bins, as all nuisances are. With E their impulses, rows R become

    R − E (Eᵀ W E)⁻¹ Eᵀ W R,

whose product with any impulse is zero; Eᵀ W E is the transform of W at the distances between the
samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy import fft
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.response.response import ComplexArray

#: Most samples of a segment that are nuisances: a limit of time, as it takes their cube.
MAX_FILLED_SAMPLES = 256
#: Ridge on Eᵀ W E over its diagonal, above rounding: values that the bins do not show stay zero.
RIDGE = 1e-12


@dataclass(frozen=True, eq=False)
class RowFilling:
    """Fills the gaps of one segment.

    Attributes:
        places: samples that are left out, shape (L,).
        weight: of the bins, shape (K,).
        samples: N of the segment.
        root: Q, shape (L, L), of (Eᵀ W E)⁻¹ = Qᵀ Q.
    """

    places: NDArray[np.int_]
    weight: FloatArray
    samples: int
    root: FloatArray

    @classmethod
    def in_weight(cls, used: BoolArray, weight: FloatArray) -> RowFilling:
        """Return the filling of what is not used, shape (N,), in a weight of the bins (K,).

        The gaps stay zero in a segment of no weight.
        """
        places = np.flatnonzero(~used)
        kernel = _summed_over_bins(weight, used.size)
        if kernel[0] == 0.0:
            return cls(places, weight, used.size, np.zeros((places.size, places.size)))
        gram = kernel[np.abs(places[:, None] - places)]
        gram[np.diag_indices(places.size)] += RIDGE * kernel[0]
        root: FloatArray = np.asarray(np.linalg.inv(np.linalg.cholesky(gram)), dtype=float)
        return cls(places, weight, used.size, root)

    def __call__(self, rows: ComplexArray) -> ComplexArray:
        """Return rows (i, K) with the values in the gaps that fit them best."""
        products = _summed_over_bins(rows * self.weight, self.samples)[:, self.places]
        values = products @ self.root.T @ self.root
        impulses = np.zeros((len(rows), self.samples))
        impulses[:, self.places] = values
        return rows - fft.rfft(impulses, axis=-1)[:, : rows.shape[1]]


def _summed_over_bins(rows: ComplexArray | FloatArray, samples: int) -> FloatArray:
    """Return Re Σ_k row[k] exp(2πi k n / N) for each sample n, shape (…, N)."""
    halves = 0.5 * samples * np.asarray(rows, dtype=complex)
    halves[..., 0] *= 2.0
    if samples % 2 == 0 and rows.shape[-1] == samples // 2 + 1:
        halves[..., -1] *= 2.0
    return np.asarray(fft.irfft(halves, samples, axis=-1))
