"""Quantities and units of channels, the provenance of data, and read-only arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from vibrident.base.brief import brief
from vibrident.base.errors import InputError

Quantity = Literal["acceleration", "velocity", "displacement", "drive", "force"]
Motion = Literal["acceleration", "velocity", "displacement"]
Excitation = Literal["sine", "multisine", "sweep", "random", "shock", "decay"]
QUANTITIES: tuple[str, ...] = get_args(Quantity)
#: From acceleration on, each one the integral of the one before.
MOTIONS: tuple[Motion, ...] = get_args(Motion)
EXCITATIONS: tuple[str, ...] = get_args(Excitation)
#: Motion that is alike throughout: each part of it tells what the others do.
STATIONARY_EXCITATIONS: tuple[Excitation, ...] = ("multisine", "random")

#: SI unit of the reference channel by quantity; a drive keeps its own unit.
REFERENCE_UNITS: Mapping[str, str] = MappingProxyType(
    {
        "acceleration": "m/s^2",
        "velocity": "m/s",
        "displacement": "m",
        "drive": "drive unit",
        "force": "N",
    }
)

#: Upper limit of a channel's largest value, in its unit; the lower limit is the reciprocal.
MAX_CHANNEL_VALUE = 1e30
STANDARD_GRAVITY = 9.80665  # standard acceleration of free fall, m/s² (CGPM 1901; ISO 80000-3)
USUAL_MODEL = "accelerometer"  # sensor model of a calibration that names none

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


def is_motion(quantity: str) -> bool:
    """Return whether a reference gives a motion, which integration turns into any other one."""
    return quantity in MOTIONS


def frozen(values: object) -> FloatArray:
    """Return a read-only copy; the array itself if it is read-only already."""
    if (
        type(values) is np.ndarray
        and values.dtype == np.float64
        and values.base is None
        and not values.flags.writeable
    ):
        return values
    array = np.array(values, dtype=np.float64)  # a copy: a record does not follow its source
    array.flags.writeable = False
    return array


def distinct(values: NDArray[Any]) -> NDArray[Any]:
    """Return the different values in rising order, none of them NaN.

    ``np.unique`` would load NumPy's masked arrays.
    """
    ordered = np.sort(values, axis=None)
    return np.concatenate([ordered[:1], ordered[1:][ordered[1:] != ordered[:-1]]])


def runs_of_true(flags: NDArray[np.bool_]) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Return the first sample of every run of True, and the sample behind its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return edges[::2], edges[1::2]


def extend_flags(flags: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Return which samples have a flag at most ``reach`` samples away, shape (samples,)."""
    if not flags.any():
        return flags.copy()
    count = np.cumsum(np.pad(flags, (reach + 1, reach)))
    return count[2 * reach + 1 :] > count[: -2 * reach - 1]


def span_of(flags: NDArray[np.bool_]) -> slice:
    """Return the slice from the first True to the last; empty if there is none."""
    if not flags.any():
        return slice(0, 0)
    return slice(int(np.argmax(flags)), flags.size - int(np.argmax(flags[::-1])))


def resolution(values: FloatArray) -> float:
    """Return the smallest step between values that occur: the quantisation, if there is any."""
    steps = np.diff(np.unique(values[:: max(1, values.size // 20000)]))
    return float(np.min(steps)) if steps.size else 0.0


@dataclass(frozen=True)
class Provenance:
    """Origin of data, and what was done to them.

    Attributes:
        file: file name, as given by the user; empty for data made in memory.
        sha256: hex digest of the file's bytes; empty for data made in memory.
        history: what was done, oldest first, in words.

    Examples:
        >>> import vibrident
        >>> vibrident.Provenance("160.csv").then("scaled by 9.80665").history
        ('scaled by 9.80665',)
    """

    file: str = ""
    sha256: str = ""
    history: tuple[str, ...] = ()

    __repr__ = brief

    def then(self, step: str) -> Provenance:
        """Return the same provenance with one more step in its history."""
        return replace(self, history=(*self.history, step))


def check_size(what: str, values: FloatArray, where: str) -> None:
    """Refuse values of a size that no unit explains."""
    largest = float(np.max(np.abs(values)))
    span = f"a largest value between {1.0 / MAX_CHANNEL_VALUE:g} and {MAX_CHANNEL_VALUE:g}"
    if largest != 0.0 and not 1.0 / MAX_CHANNEL_VALUE <= largest <= MAX_CHANNEL_VALUE:
        text = f"{what} holds values of a size that no unit explains."
        raise InputError(
            text, expected=span, found=f"{largest:.3g}", where=where, remedy="correct the scale"
        )
