"""Responses per one quantity of motion from those per another."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibrident.data.records import Quantity
from vibrident.physics.models.base import DERIVATIVES

_TURNS = (1.0, 1j, -1.0, -1j)  # whole powers of j, without rounding


def conversion(frequency_hz: Any, per: Quantity, target: Quantity) -> Any:
    """Return the factor from a response per the quantity ``per`` to that per ``target``.

    Each power of s = jω is exact in phase. A drive and a force are per themselves alone.
    """
    power = DERIVATIVES[target] - DERIVATIVES[per]
    return _TURNS[power % 4] * (2.0 * np.pi * frequency_hz) ** power
