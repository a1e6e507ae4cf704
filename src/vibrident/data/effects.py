"""Systematic contributions to the uncertainty, as a calibration states them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

# what a calibration file can state
StatedKind = Literal["gain", "timing", "phase", "mounting", "clock"]
EffectKind = Literal[StatedKind, "ellipse", "cyclic", "rounding", "edges", "clocks", "mass ratio"]
_UNITS: dict[EffectKind, str] = {
    "timing": "s",
    "phase": "rad",
    "edges": "s",
}  # the others are relative


@dataclass(frozen=True)
class SystematicEffect:
    """Systematic contribution to the uncertainty, common to all points (GUM 4.3, type B).

    Examples:
        >>> import vibrident
        >>> laser = vibrident.SystematicEffect("laser vibrometer", "gain", 1e-3)
        >>> skew = vibrident.SystematicEffect("skew of the two channels", "timing", 2e-7)
        >>> laser.unit, skew.unit
        ('1', 's')
    """

    source: str  # what it comes from, in words
    # how it acts: ``gain`` (relative), ``timing`` (skew between the channels, s), ``phase`` (rad),
    # ``mounting`` (relative at ``frequency_hz``, growing with its square) or ``clock`` (sampling
    # rate, relative). Found in an interferometer's signals: ``ellipse`` and ``cyclic``; found in
    # the records, each with a ``pattern``: ``rounding`` (relative), ``edges`` (of a held drive, s)
    # and ``clocks`` (the ratio of two, relative). Of a mounting that is fitted: ``mass ratio``
    kind: EffectKind
    standard_uncertainty: float  # in ``unit``
    frequency_hz: float | None = None  # of a mounting effect; None otherwise
    # of the standard uncertainty; infinite if it is taken as known
    degrees_of_freedom: float = math.inf
    # frequency in Hz and change of log H for one unit of the effect, real and imaginary part, for
    # effects without a formula
    pattern: tuple[tuple[float, float, float], ...] = field(default=(), repr=False)

    @property
    def unit(self) -> str:
        """Return the unit of the standard uncertainty; "1" for a relative one."""
        return _UNITS.get(self.kind, "1")


@dataclass(frozen=True)
class Capability:
    """Smallest expanded uncertainty (k = 2) that a laboratory may state over a band.

    The calibration and measurement capability (CMC) of ILAC-P14.
    """

    # of the sensitivity: ``magnitude`` (relative) or ``phase`` (rad)
    quantity: Literal["magnitude", "phase"]
    expanded_uncertainty: float  # relative, or in rad
    # from_hz, to_hz: the band, both ends included
    from_hz: float = 0.0
    to_hz: float = math.inf


@dataclass(frozen=True)
class Circumstances:
    """Circumstances of a record, as far as they are stated."""

    run: str = ""  # one of several runs; empty if there is one only
    mounting: str = ""  # one of several mountings of the sensor; empty if it was mounted once
    # axis of the sensor along which it was moved: ``x``, ``y`` or ``z``; empty for a sensor of one
    # axis
    axis: str = ""
    temperature_c: float | None = None  # of the sensor, in °C
