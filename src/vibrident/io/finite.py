"""Check for finite values; the message states which value is not, and its place."""

from __future__ import annotations

import numpy as np

from vibrident.errors import InputError
from vibrident.io.columns import ColumnFile
from vibrident.records import FloatArray


def require_finite(source: ColumnFile, position: int, values: FloatArray, first_row: int, remedy: str) -> None:
    """Raise if a value is missing, NaN or infinite.

    Args:
        source: file of the values.
        position: the column's position in it.
        values: shape (samples,).
        first_row: row of the first value in the file, from 0.
        remedy: what the user can do.

    Raises:
        InputError: a value is not finite.
    """
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        value = values[bad[0]]
        raise InputError(
            "A value that is needed is not a number.",
            expected="finite numbers",
            found=f"{'an empty cell or NaN' if np.isnan(value) else value}; {bad.size} such in this column",
            where=source.locate(position, first_row + int(bad[0])),
            remedy=remedy,
        )
