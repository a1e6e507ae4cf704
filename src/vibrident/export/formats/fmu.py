"""FMI 2.0 co-simulation unit: the model filter and the cell at a fixed step (pythonfmu).

A co-simulation sets the input at the beginning of a step and reads the output at its end, so both
outputs are one step late, plus the filter's latency; the unit states both in seconds.
"""

from __future__ import annotations

import contextlib
import hashlib
import keyword
import math
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.base.escaping import python_docstring, xml_text
from vibrident.export.filters import checked_rate, model_filter
from vibrident.export.form import Format, Options, library, template
from vibrident.export.poles_zeros import poles_zeros
from vibrident.export.sensor import ExportedSensor, identity
from vibrident.physics.naming import described

SLAVE = "slave.py.txt"


def write(sensor: ExportedSensor, folder: Path, options: Options) -> list[Path]:
    """Write ``NAME.fmu``."""
    library("pythonfmu", "fmu")
    from pythonfmu import FmuBuilder

    text = slave(sensor, options)
    # a process imports a name only once
    module = f"{options.name}_{hashlib.sha256(text.encode()).hexdigest()[:12]}"
    path = folder / f"{options.name}.fmu"
    with tempfile.TemporaryDirectory() as work, _imports_as_before(module):
        script = Path(work) / f"{module}.py"
        script.write_text(text, encoding="utf-8")
        fixed: dict[str, Any] = {"canHandleVariableCommunicationStepSize": False}
        notes = Path(work) / "documentation"
        notes.mkdir()
        (notes / "sensor.txt").write_text(text.split('"""')[1].strip() + "\n", encoding="utf-8")
        built = FmuBuilder.build_FMU(script, dest=Path(work), documentation_folder=notes, **fixed)
        shutil.move(built, path)
    return [path]


@contextlib.contextmanager
def _imports_as_before(module: str) -> Iterator[None]:
    """Restore imports: the builder imports the script by name and leaves its folder on the path."""
    before = list(sys.path)
    bytecode = sys.dont_write_bytecode
    sys.dont_write_bytecode = True
    try:
        yield
    finally:
        sys.path[:] = before
        sys.dont_write_bytecode = bytecode
        sys.modules.pop(module, None)


def _class_name(name: str) -> str:
    """Return the name with a capital; one more letter if it is taken in Python or the unit."""
    capitalised = name[0].upper() + name[1:]
    return (
        f"{capitalised}_"
        if keyword.iskeyword(capitalised) or re.search(rf"\b{capitalised}\b", template(SLAVE))
        else capitalised
    )


def slave(sensor: ExportedSensor, options: Options) -> str:
    """Return the Python text of the unit."""
    rate = checked_rate(sensor, options.rate_hz)
    model, cell = model_filter(sensor, rate)
    f = sensor.band
    error = float(np.max(np.abs(model.response(f) / (sensor.response(f) * model.late(f)) - 1.0)))
    cell_error = float(np.max(np.abs(cell.response(f) / poles_zeros(sensor).response(f) - 1.0)))
    apart = sensor.apart
    plain = f"; without {' and '.join(apart)}" if apart else ""
    late = (model.latency + 1) / rate
    once = 1.0 / rate
    response_text = (
        f"{sensor.output_unit}; late by response_latency; error over the band {error:.1e}, relative"
    )
    cell_text = (
        f"{sensor.output_unit}; late by one step; first-order hold, error {cell_error:.1e}, "
        f"relative{plain}"
    )
    about = [
        *identity(sensor),
        f"fixed step 1/{rate!r} s; response is late by {late!r} s, response_cell by {once!r} s",
        f"response: {response_text}",
        f"response_cell: {cell_text}",
        "the uncertainties of the parameters are constants; the outputs carry none",
    ]
    constants = [("response_latency", late, "s"), ("response_cell_latency", once, "s")]
    for name, p in sensor.result.parameters.items():
        is_usable = described(name) is not None and p.value is not None and math.isfinite(p.value)
        constants += [(name, p.value, p.unit)] if is_usable else []
        if (
            is_usable
            and p.standard_uncertainty is not None
            and math.isfinite(p.standard_uncertainty)
        ):
            constants.append(
                (f"{name}_u", p.standard_uncertainty, f"{p.unit}, standard uncertainty")
            )
    return template(SLAVE).format(
        about="\n".join(python_docstring(line) for line in about),
        interval=once,
        taps=model.taps.taps.tolist(),
        lead=model.taps.lead,
        sections=model.sections.rows.tolist(),
        growth=cell.growth.tolist(),
        before=cell.before.tolist(),
        now=cell.now.tolist(),
        output=cell.output.tolist(),
        direct=float(cell.feedthrough),
        constants="".join(
            f"    {name!r}: ({float(value)!r}, {xml_text(text)!r}),\n"
            for name, value, text in constants
        ),
        model=_class_name(options.name),
        description=xml_text("; ".join(about[:2])),
        input_text=xml_text(f"{sensor.input_unit}, at the beginning of a step"),
        response_text=xml_text(response_text),
        cell_text=xml_text(cell_text),
    )


FMU = Format(
    name="fmu",
    title="FMI 2.0 co-simulation unit",
    write=write,
    contents="model and cell at a fixed step; parameters and u as constants",
    cannot_hold="uncertainty of the outputs",
    options=("rate_hz",),
    extra="fmu",
)
