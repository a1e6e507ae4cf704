"""Module for SciPy."""

from __future__ import annotations

from vibrident.export.form import Format
from vibrident.export.python_source import write_scipy

SCIPY = Format(
    name="scipy",
    title="module for SciPy",
    write=write_scipy,
    holds="a module whose `sensor()` gives a `scipy.signal.ZerosPolesGain`; parameters, u and covariance beside it",
    cannot_hold="uncertainty in the object itself",
)
