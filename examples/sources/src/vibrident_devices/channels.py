"""What both devices share: which channels are read, and chunks of them."""

from __future__ import annotations

import numpy as np

from vibrident import InputError
from vibrident.data.sources.source import Chunk, SourceRequest

PIECE_S = 0.1  # seconds of a chunk
SAME_RATE = 1e-6  # relative difference of two rates that are one


def numbers(wanted: SourceRequest) -> tuple[int, int]:
    """Channels of reference and response, counted from 1.

    Raises:
        InputError: a column is not a number.
    """
    columns = wanted.calibration.reference.column, wanted.calibration.response.column
    reference, response = columns
    if not (isinstance(reference, int) and isinstance(response, int)):
        raise InputError(
            "Channels of a device have no names.",
            expected="[reference] column and [response] column as numbers from 1",
            found=", ".join(map(repr, columns)),
            where=str(wanted.file),
        )
    return reference, response


def check_rate(wanted: SourceRequest, rate_hz: float) -> None:
    """Refuse a device that samples at a rate other than requested, which moves every frequency."""
    if abs(rate_hz / wanted.rate_hz - 1.0) > SAME_RATE:
        raise InputError(
            "The device has not this sampling rate.",
            expected=f"{wanted.rate_hz!r} Hz, as in {wanted.file}",
            found=f"{rate_hz!r} Hz",
            where=wanted.address,
            remedy="state the device's rate under [sampling]",
        )


def chunk(
    wanted: SourceRequest, reference: np.ndarray, response: np.ndarray, *, separate: bool
) -> Chunk:
    """Samples of the device, shape (samples,) each, in physical units.

    ``separate``: samples before them were lost.
    """
    to = wanted.calibration
    return Chunk(reference * to.reference.scale, response * to.response.scale, separate=separate)
