"""Which writer belongs to which format. A new format is one module and one line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from vibrident.export import c_source, csv_file, dcc, fmu, python_source, sacpz, stationxml
from vibrident.export.options import Options
from vibrident.export.sensor import Sensor


@dataclass(frozen=True)
class Format:
    """A way to write a sensor.

    Attributes:
        title: what it is, in a few words.
        write: (sensor, folder, options) → files.
    """

    title: str
    write: Callable[[Sensor, Path, Options], list[Path]]


FORMATS: Mapping[str, Format] = MappingProxyType(
    {
        "csv": Format("tables of all numbers", csv_file.write),
        "control": Format("module for python-control", python_source.write_control),
        "scipy": Format("module for SciPy", python_source.write_scipy),
        "stationxml": Format("FDSN StationXML", stationxml.write),
        "sacpz": Format("SAC poles and zeros", sacpz.write),
        "c": Format("C99 for firmware", c_source.write),
        "fmu": Format("FMI 2.0 co-simulation unit", fmu.write),
        "dcc": Format("digital calibration certificate", dcc.write),
    }
)
