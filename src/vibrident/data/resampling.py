"""Band-limited values at other instants: between samples, at a lower rate, and back from uneven stamps.

All use one kernel, a sinc under Kaiser's window of 130 dB (Kaiser 1974), which passes to 0.45 of
the slower rate to 1e-6. What lies above 0.45 of that rate is not reproduced.
"""

from __future__ import annotations

import numpy as np

from vibrident.data.interferometer.decimation import HALF, at_positions, reach, weights_at
from vibrident.data.records import FloatArray

#: Half the kernel's length in intervals of the slower rate: twice the filters of raw light, so half
#: their transition.
HALF_LENGTH = 2 * HALF
PASS_BAND = 0.45  # of the slower rate
DOUBTFUL = 2 * HALF_LENGTH  # samples at either end of evened ones, as nothing is known beyond
_BLOCK = 1 << 14  # stamps that are evened at once
# beside a block; what lies beyond moves its inner values by less than 1e-9
_OVERLAP = 4 * HALF_LENGTH
_MAX_ITERATIONS = 500  # of conjugate gradients; some 40 are usual
_TOLERANCE = 1e-10  # of conjugate gradients, relative
_RIDGE = 1e-10  # keeps values beyond the stamps at zero


def resampled(values: FloatArray, positions: FloatArray, spacing: float) -> FloatArray:
    """Return a band-limited signal at positions between its samples.

    Args:
        values: shape (n,), evenly spaced.
        positions: shape (m,), in samples, from ``lost(spacing)`` to n − 1 − ``lost(spacing)``.
        spacing: distance of the positions in samples, 1 or more; above 1 the signal is low-passed.
    """
    return at_positions(values, positions, spacing, HALF_LENGTH)


def lost(spacing: float) -> int:
    """Return how many samples on either side :func:`resampled` needs."""
    return reach(spacing, HALF_LENGTH)


def evened(values: FloatArray, positions: FloatArray) -> FloatArray:
    """Return the even samples whose band-limited interpolation passes through uneven ones.

    Least squares on the kernel's matrix, by conjugate gradients, block by block. Jitter of up to
    half an interval leaves the problem well conditioned (Kadec 1964 for a quarter; the kernel's
    band of less than half the rate for more).

    Args:
        values: shape (n,), at the positions.
        positions: shape (n,), rising, within half an interval of 0, 1, …, n − 1.

    Returns:
        Values at 0, 1, …, n − 1, shape (n,). The first and last ``DOUBTFUL`` are inaccurate.
    """
    result = np.empty(values.shape[0])
    for begin in range(0, values.shape[0], _BLOCK):
        first = max(begin - _OVERLAP, 0)
        last = min(begin + _BLOCK + _OVERLAP, values.shape[0])
        block = _solve(values[first:last], positions[first:last] - first)
        end = min(begin + _BLOCK, values.shape[0])
        result[begin:end] = block[begin - first : end - first]
    return result


def _solve(values: FloatArray, positions: FloatArray) -> FloatArray:
    from scipy.sparse import csr_array, eye_array
    from scipy.sparse.linalg import aslinearoperator, cg

    count = values.shape[0]
    half = HALF_LENGTH
    base, weights = weights_at(positions, 1.0, half)
    columns = base[:, None] + np.arange(-half, half + 2)
    first = columns.shape[1] * np.arange(count + 1)
    size = count + 2 * (half + 1)  # unknowns beyond both ends, too
    matrix = csr_array((weights.ravel(), columns.ravel() + half + 1, first), shape=(count, size))
    transposed = matrix.T.tocsr()
    level = float(np.mean(values))  # a constant needs no unknowns beyond the ends
    squared = aslinearoperator(transposed) * aslinearoperator(matrix)
    normal = squared + aslinearoperator(_RIDGE * eye_array(size, format="csr"))
    solution, _ = cg(
        normal, transposed @ (values - level), rtol=_TOLERANCE, maxiter=_MAX_ITERATIONS
    )
    return level + solution[half + 1 : half + 1 + count]
