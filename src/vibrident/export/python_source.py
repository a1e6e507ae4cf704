"""Python: the sensor as an object of python-control or SciPy, and as a module that makes it from its own numbers."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from vibrident.escaping import python_docstring
from vibrident.export.approximation import held
from vibrident.export.options import Options
from vibrident.export.poles_zeros import PolesZeros
from vibrident.export.sensor import Exported, ExportedSensor, identity
from vibrident.sensor import IdentifiedSensor

_MODULE = '''"""{title}

{identity}
"""

import numpy as np
{imports}

#: name → (value, unit, standard uncertainty or None), as in result.json.
PARAMETERS = {{
{parameters}}}
#: Covariance of {names}; None if it is not stated.
COVARIANCE = {covariance}

ZEROS = np.array([{zeros}], dtype=complex)  # rad/s
POLES = np.array([{poles}], dtype=complex)  # rad/s
GAIN = {gain!r}


def sensor():
    """{input_unit} to {output_unit}: {kind}."""
    return {make}
'''

_CONTROL = "control.TransferFunction(GAIN * np.atleast_1d(np.poly(ZEROS).real), np.poly(POLES).real)"
_SCIPY = "signal.ZerosPolesGain(ZEROS, POLES, GAIN)"


def system(known: IdentifiedSensor) -> PolesZeros:
    """A sensor as poles and zeros in rad/s; delay and average over a window approximated over the band of its data.

    Raises:
        InputError: the model is not linear, or poles and zeros cannot hold it.
    """
    return held(Exported(known, known.model, known.band_hz or (0.0, 0.0)))[0]


def write_control(sensor: ExportedSensor, folder: Path, options: Options) -> list[Path]:
    """Write ``NAME_control.py``, whose ``sensor()`` is a ``control.TransferFunction``."""
    text = _module(sensor, "import control", "control.TransferFunction", _CONTROL)
    return [_written(folder / f"{options.name}_control.py", text)]


def write_scipy(sensor: ExportedSensor, folder: Path, options: Options) -> list[Path]:
    """Write ``NAME_scipy.py``, whose ``sensor()`` is a ``scipy.signal.ZerosPolesGain``."""
    text = _module(sensor, "from scipy import signal", "scipy.signal.ZerosPolesGain", _SCIPY)
    return [_written(folder / f"{options.name}_scipy.py", text)]


def _module(sensor: ExportedSensor, imports: str, kind: str, make: str) -> str:
    poles_zeros, words = held(sensor)
    names, covariance = sensor.known.model.parameter_names, sensor.known.covariance
    parameters = "".join(
        f"    {name!r}: ({_number(p.value)}, {p.unit!r}, {_number(p.standard_uncertainty)}),\n"
        for name, p in sensor.result.parameters.items()
    )
    note = "the transfer function holds no uncertainties: PARAMETERS and COVARIANCE beside it do"
    lines = [python_docstring(line) for line in (*identity(sensor), *words, note)]
    return _MODULE.format(
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


def _number(value: float | None) -> str:
    """A literal; None for a number that is not finite, as in result.json."""
    return "None" if value is None or not math.isfinite(value) else repr(float(value))


def _written(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path
