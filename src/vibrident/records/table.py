"""A tabulated response. Validated."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vibrident.brief import brief
from vibrident.errors import InputError
from vibrident.records.basis import FloatArray, Provenance, check_size, frozen


@dataclass(frozen=True, eq=False)
class ResponseTable:
    """A tabulated complex response: response per unit of the reference quantity.

    Attributes:
        frequency_hz: shape (points,), positive, any order, repeats allowed.
        magnitude: shape (points,), response unit per SI unit of the reference quantity, positive.
        phase_rad: shape (points,) or None; phase of the response minus phase of the reference, lag negative.
        magnitude_uncertainty: standard uncertainty, same unit as magnitude, or None.
        phase_uncertainty_rad: standard uncertainty, rad, or None.
        provenance: file, hash and history.

    Raises:
        InputError: shapes differ, or a value is not finite or not positive where it must be.
    """

    frequency_hz: FloatArray
    magnitude: FloatArray
    phase_rad: FloatArray | None = None
    magnitude_uncertainty: FloatArray | None = None
    phase_uncertainty_rad: FloatArray | None = None
    provenance: Provenance = field(default_factory=Provenance)

    __repr__ = brief

    def __post_init__(self) -> None:
        positive = {"frequency_hz", "magnitude", "magnitude_uncertainty", "phase_uncertainty_rad"}
        shape = np.shape(self.frequency_hz)
        where = f"table {self.provenance.file or 'in memory'!r}"
        for label in ("frequency_hz", "magnitude", "phase_rad", "magnitude_uncertainty", "phase_uncertainty_rad"):
            values = getattr(self, label)
            if values is None:
                continue
            values = frozen(values)
            if values.ndim != 1 or values.shape != shape or values.size == 0:
                raise InputError(
                    f"Column {label} does not fit the table.",
                    expected=f"one dimension, {shape[0] if shape else 'at least 1'} points",
                    found=f"shape {values.shape}",
                    where=where,
                    remedy="give every column the same number of rows",
                )
            bad = np.flatnonzero(~np.isfinite(values) | ((values <= 0) if label in positive else False))
            if bad.size:
                raise InputError(
                    f"Column {label} holds values that cannot be used.",
                    expected="finite numbers" + (" above zero" if label in positive else ""),
                    found=f"{values[bad[0]]} in data row {bad[0] + 1}",
                    where=where,
                    remedy="repair or remove that row",
                )
            check_size(f"Column {label}", values, where)
            object.__setattr__(self, label, values)

    @property
    def points(self) -> int:
        """Number of rows."""
        return int(self.frequency_hz.shape[0])

    @property
    def response(self) -> NDArray[np.complex128]:
        """Complex response, shape (points,); real and positive where the table has no phase."""
        if self.phase_rad is None:
            return self.magnitude.astype(np.complex128)
        return np.asarray(self.magnitude * np.exp(1j * self.phase_rad), dtype=np.complex128)
