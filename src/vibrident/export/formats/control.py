"""Module for python-control."""

from __future__ import annotations

from functools import partial

from vibrident.export.form import Format
from vibrident.export.python_source import write_module

CONTROL = Format(
    name="control",
    title="module for python-control",
    write=partial(
        write_module,
        imports="import control",
        kind="control.TransferFunction",
        make=(
            "control.TransferFunction(GAIN * np.atleast_1d(np.poly(ZEROS).real), "
            "np.poly(POLES).real)"
        ),
    ),
    holds=(
        "a module whose `sensor()` gives a `control.TransferFunction`; parameters, u and "
        "covariance beside it"
    ),
    cannot_hold="uncertainty in the object itself",
    extra="control",
)
