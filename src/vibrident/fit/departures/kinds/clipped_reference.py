"""A reference that was cut off: H{sgn u max(|u| − c, 0)}, and H{1[± u > c]}."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from vibrident.base.amounts import plain
from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import FloatArray
from vibrident.fit.departures.departure import OfReference, Size

#: Levels over the largest of the record.
LEVELS = (0.5, 0.8, 0.95)
#: Level over the largest of samples that stand at the limit.
MIN_LIMIT_LEVEL = 0.98


class ClippedReference(OfReference):
    """A recorder of the reference at its limit."""

    name: ClassVar[str] = "clipped-reference"
    code: ClassVar[WarningCode] = "clipped"

    def shapes(self, signal: FloatArray, size: Size) -> Iterable[tuple[str, FloatArray]]:
        """Yield what lies beyond each level."""
        largest = size.largest
        sentence = "the reference departs {}, as where its channel is overdriven"
        for level in LEVELS:
            words = sentence.format(f"beyond {plain(100.0 * level, 2)} % of its largest")
            limit = level * largest
            yield words, signal - np.clip(signal, -limit, limit)
        for sign, end in ((1.0, "highest"), (-1.0, "lowest")):
            is_at_end = sign * signal > MIN_LIMIT_LEVEL * largest
            yield sentence.format(f"at its {end}"), is_at_end * (sign * largest)


CLIPPED_REFERENCE = ClippedReference()
