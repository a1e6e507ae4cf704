"""Module for SciPy."""

from __future__ import annotations

from functools import partial

from vibrident.export.form import Format
from vibrident.export.python_source import write_module

SCIPY = Format(
    name="scipy",
    title="module for SciPy",
    write=partial(
        write_module,
        imports="from scipy import signal",
        kind="scipy.signal.ZerosPolesGain",
        make="signal.ZerosPolesGain(ZEROS, POLES, GAIN)",
    ),
    holds=(
        "a module whose `sensor()` gives a `scipy.signal.ZerosPolesGain`; parameters, u and "
        "covariance beside it"
    ),
    cannot_hold="uncertainty in the object itself",
)
