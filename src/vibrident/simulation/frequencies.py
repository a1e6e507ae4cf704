"""One-third-octave frequencies: exact base-10 values for computing, nominal names for print (ISO 266:1997)."""

from __future__ import annotations

import math

import numpy as np

from vibrident.nominal import nominal_value
from vibrident.records import FloatArray
from vibrident.simulation.checks import require, require_positive

#: A limit may be given by its nominal value, which lies up to 1.2 % (0.05 steps) from the exact one.
_LIMIT_TOLERANCE = 0.1
_NAME_TOLERANCE = 1e-4  # relative distance within which a frequency counts as an exact one-third-octave frequency


def one_third_octave(low_hz: float, high_hz: float) -> FloatArray:
    """Exact one-third-octave frequencies 10^(n/10) Hz from ``low_hz`` to ``high_hz``, both included.

    Args:
        low_hz: lower limit, Hz, exact or nominal (12.5 means 12.589…).
        high_hz: upper limit, Hz, exact or nominal.

    Returns:
        Ascending, shape (points,): 21 for 10 to 1000 Hz, 41 for 0.1 to 1000 Hz.

    Raises:
        InputError: a limit is not positive, or no frequency lies between them.
    """
    require_positive("one_third_octave", low_hz=low_hz, high_hz=high_hz)
    first = math.ceil(10.0 * math.log10(low_hz) - _LIMIT_TOLERANCE)
    last = math.floor(10.0 * math.log10(high_hz) + _LIMIT_TOLERANCE)
    require(
        first <= last,
        "No one-third-octave frequency lies in this range.",
        expected="low_hz at or below high_hz, with a frequency 10^(n/10) between them",
        found=f"{low_hz:g} to {high_hz:g} Hz",
        where="one_third_octave",
        remedy="widen the range",
    )
    return np.array([10.0 ** (n / 10.0) for n in range(first, last + 1)])


def nominal_frequency_name(frequency_hz: float) -> str:
    """Nominal name of an exact one-third-octave frequency (158.49 → "160"); any other frequency as it is.

    ``frequency_hz``: Hz, positive.
    """
    n = round(10.0 * math.log10(frequency_hz))
    if abs(frequency_hz / 10.0 ** (n / 10.0) - 1.0) > _NAME_TOLERANCE:
        return f"{frequency_hz:.6g}"
    return f"{nominal_value(n):.6g}"
