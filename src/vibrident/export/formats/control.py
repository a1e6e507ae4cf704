"""Module for python-control."""

from __future__ import annotations

from vibrident.export.form import Format
from vibrident.export.python_source import write_control

CONTROL = Format(
    name="control",
    title="module for python-control",
    write=write_control,
    holds="a module whose `sensor()` gives a `control.TransferFunction`; parameters, u and covariance beside it",
    cannot_hold="uncertainty in the object itself",
    extra="control",
)
