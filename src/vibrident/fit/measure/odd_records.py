"""Is there one record of another sensor, range or wiring among the others?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.measure.verdict import rejected

#: A single record is another sensor's where it holds at least this part of what χ² exceeds its degrees of freedom by.
ODD = 0.9
#: Fewest records among which one may be odd.
FEWEST_RECORDS = 4


@dataclass(frozen=True)
class OddRecord:
    """A record that does not belong to the others.

    Attributes:
        record: its name.
        chi2_reduced: of all records; without this one.
        without: χ² over degrees of freedom of the others alone.
        gain: relative deviation of its response from the others' prediction, rms over its points.
    """

    record: str
    chi2_reduced: float
    without: float
    gain: float


def odd_record(
    matrix: FloatArray, rest: FloatArray, record: Sequence[str], relative_deviation: FloatArray
) -> OddRecord | None:
    """The one record without which the model explains the data that it does not explain with it.

    Args:
        matrix: slopes of the weighted deviations, real parts then imaginary parts of n points, shape (2 n, p).
        rest: weighted deviations, shape (2 n,).
        record: name of the record of each point, n of them.
        relative_deviation: of each point's real part, shape (n,).
    """
    names = list(dict.fromkeys(record))
    owner = np.tile([names.index(name) for name in record], 2)
    degrees = rest.size - matrix.shape[1]
    whole = _left(matrix, rest)
    if len(names) < FEWEST_RECORDS or degrees <= 0 or not rejected(whole, degrees):
        return None
    lefts = [_left(matrix[owner != k], rest[owner != k]) for k in range(len(names))]
    odd = int(np.argmin(lefts))
    others = owner != odd
    freedom = int(np.sum(others)) - matrix.shape[1]
    if freedom < len(names) // 2 or rejected(lefts[odd], freedom) or whole - lefts[odd] < ODD * (whole - degrees):
        return None
    if any(
        k != odd and not rejected(left, rest.size - int(np.sum(owner == k)) - matrix.shape[1])
        for k, left in enumerate(lefts)
    ):
        return None  # which one, nothing tells
    amounts, *_ = np.linalg.lstsq(matrix[others], rest[others], rcond=1e-12)
    off = (rest - matrix @ amounts) * np.tile(relative_deviation, 2)
    size = float(np.sqrt(2.0 * np.mean(off[~others] ** 2)))
    return OddRecord(names[odd], whole / degrees, lefts[odd] / freedom, size)


def _left(matrix: FloatArray, rest: FloatArray) -> float:
    basis, _ = np.linalg.qr(matrix)
    left = rest - basis @ (basis.T @ rest)
    return float(left @ left)
