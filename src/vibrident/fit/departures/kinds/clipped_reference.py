"""A reference that was cut off: H{sgn u max(|u| − c, 0)}, and H{1[± u > c]}."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from vibrident.base.amounts import plain
from vibrident.base.warning_kinds import WarningCode
from vibrident.fit.departures.departure import Departure, Scale
from vibrident.fit.departures.part import Part
from vibrident.fit.measure.response import ComplexArray

#: Levels over the largest of the record, and that of samples that stand at the limit.
LEVELS, AT_LIMIT = (0.5, 0.8, 0.95), 0.98


class ClippedReference(Departure):
    """Recorder of the reference at its limit."""

    name: ClassVar[str] = "clipped-reference"
    code: ClassVar[WarningCode] = "clipped"
    linear: ClassVar[bool] = False

    def columns(self, part: Part, scale: Scale) -> Iterable[tuple[str, ComplexArray]]:
        """What lies beyond each level, through the sensor."""
        u, top = part.reference, float(np.max(np.abs(part.reference), initial=0.0))
        beyond = [np.sign(u) * np.maximum(np.abs(u) - level * top, 0.0) for level in LEVELS]
        at_limit = [sign * top * (sign * u > AT_LIMIT * top) for sign in (1.0, -1.0)]
        words = [f"beyond {plain(100.0 * level, 2)} % of its largest" for level in LEVELS]
        bins = part.through(np.array([*beyond, *at_limit], dtype=float))
        for said, own in zip([*words, "at its highest", "at its lowest"], bins, strict=True):
            yield f"the reference departs {said}, as where its channel is overdriven", own[None]


CLIPPED_REFERENCE = ClippedReference()
