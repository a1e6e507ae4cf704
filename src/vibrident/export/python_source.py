"""Sensor as an object of python-control or SciPy, and as a module that makes it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from vibrident.base.escaping import python_docstring
from vibrident.export.approximation import held
from vibrident.export.form import Options, template
from vibrident.export.poles_zeros import PolesZeros
from vibrident.export.sensor import Exported, ExportedSensor, identity
from vibrident.result.sensor import IdentifiedSensor


def system(known: IdentifiedSensor) -> PolesZeros:
    """Return a sensor as poles and zeros in rad/s.

    Delay and average over a window are approximated over the band of its data.
    """
    return held(Exported(known, known.model, known.band_hz or (0.0, 0.0)))[0]


def write_module(
    sensor: ExportedSensor, folder: Path, options: Options, *, imports: str, kind: str, make: str
) -> list[Path]:
    """Write ``NAME_control.py`` or ``NAME_scipy.py``; its ``sensor()`` is of that package.

    ``imports``: line that imports the package; ``kind``: class of the object, its package first;
    ``make``: expression for it, of ZEROS, POLES and GAIN.
    """
    poles_zeros, words = held(sensor)
    names = sensor.known.model.parameter_names
    covariance = sensor.known.covariance
    parameters = "".join(
        f"    {name!r}: ({_number(p.value)}, {p.unit!r}, {_number(p.standard_uncertainty)}),\n"
        for name, p in sensor.result.parameters.items()
    )
    note = "the transfer function holds no uncertainties: PARAMETERS and COVARIANCE beside it do"
    lines = [python_docstring(line) for line in (*identity(sensor), *words, note)]
    text = template("module.py.txt").format(
        title=f"Sensitivity of a vibration sensor as a {kind}.",
        identity="\n".join(lines),
        imports=imports,
        parameters=parameters,
        names=", ".join(names) or "nothing",
        covariance=f"np.array({covariance.tolist()!r})" if np.isfinite(covariance).all() else None,
        zeros=", ".join(repr(complex(z)) for z in poles_zeros.zeros),
        poles=", ".join(repr(complex(p)) for p in poles_zeros.poles),
        gain=poles_zeros.gain,
        input_unit=python_docstring(sensor.input_unit),
        output_unit=python_docstring(sensor.output_unit),
        kind=kind,
        make=make,
    )
    path = folder / f"{options.name}_{kind.partition('.')[0]}.py"
    path.write_text(text, encoding="utf-8")
    return [path]


def _number(value: float | None) -> str:
    """Return a literal; None for a number that is not finite, as in result.json."""
    return "None" if value is None or not math.isfinite(value) else repr(float(value))
