"""Universal files (UFF, UNV): time signals and frequency responses of data sets 58, 58b and 55."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.data.io.columns import (
    Channel,
    Clock,
    ColumnFile,
    StartTime,
    library,
    reading,
    real_numbers,
    require_few,
)
from vibrident.data.io.reader import Reader
from vibrident.data.io.sampling import plainest_clock
from vibrident.data.io.units import factor_between
from vibrident.data.records import FloatArray

#: Function types without a rule against time signals: general or unknown, and time response.
_TIME_SIGNALS = (0, 1)
#: Frequency response function, and transmissibility.
_RESPONSES = (4, 5)
_TIME = 17  # specific data type of an abscissa
_FREQUENCY = 18  # the same
_COMPLEX = (5, 6)  # ordinate data types
_DIRECTIONS = {1: "+X", 2: "+Y", 3: "+Z", 4: "+RX", 5: "+RY", 6: "+RZ"}
#: Length and force by units code of data set 164, and units of a specific data type: its Table.
_SYSTEMS = {
    1: ("m", "N"), 2: ("ft", "lbf"), 3: ("m", "kgf"), 4: ("ft", "pdl"),
    5: ("mm", "mN"), 6: ("cm", "cN"), 7: ("in", "lbf"), 8: ("mm", "kgf"),
}  # fmt: skip
_LENGTHS = {"m": 1.0, "ft": 1 / 0.3048, "mm": 1e3, "cm": 1e2, "in": 1 / 0.0254}  # a metre in them
_KINDS = {8: "{length}", 11: "{length}/s", 12: "{length}/s^2", 9: "{force}", 13: "{force}"}
_SAME_LENGTH = 1e-4  # relative; files give the factor to some digits


class UffFile(ColumnFile):
    """A universal file. A channel has the name of its ID line 1, or node and direction.

    Where the title is not unique, it has both. The format keeps the sampling interval to five or
    six digits; see ``plainest_clock`` for what is made of that.
    """

    expected = "a universal file with data sets 58 (functions at nodal degrees of freedom) or 55"

    def __init__(self, path: Path) -> None:
        self._path = path
        self._pyuff = library("pyuff", "uff", path)
        refused: dict[str, str] = {}
        functions: list[tuple[int, dict[str, Any]]] = []
        self._units: tuple[str, str] | None = None  # of length and force in the file
        with reading(path, self.expected):
            file = self._pyuff.UFF(str(path))
            kinds = [int(kind) for kind in file.get_set_types()]
            if 164 in kinds:
                self._units = _unit_system(file.read_sets(kinds.index(164)))
            for set_number in (set_number for set_number, kind in enumerate(kinds) if kind == 58):
                header = file.read_sets(set_number, header_only=True)
                points = int(header["num_pts"])
                size = path.stat().st_size
                if not 0 < points <= size:  # pyuff makes as many abscissas as the header states
                    raise ValueError(f"{points} values in a file of {size} bytes")
                if reason := _reason_against(header):
                    refused[_name(header, repeated=False)] = reason
                else:
                    functions.append((set_number, header))
            titles = Counter(_name(header, repeated=False) for _, header in functions)
            channels: list[Channel] = []
            for set_number, header in functions:
                name = _name(header, repeated=titles[_name(header, repeated=False)] > 1)
                channels += self._channels_of(set_number, header, name)
            shapes = [
                _shape(file, set_number) for set_number, kind in enumerate(kinds) if kind == 55
            ]
            channels += self._channels_of_shapes(shapes, refused)
            require_few(path, channels, "channels")
        super().__init__(path, channels, refused)

    def _read(self, handles: Sequence[tuple[Any, str]]) -> Iterator[FloatArray]:
        file = self._pyuff.UFF(str(self._path))
        for numbers, kind in handles:
            if isinstance(numbers, np.ndarray):  # of data sets 55, which were read
                yield numbers.copy()
                continue
            function = file.read_sets(numbers)
            values = function["x" if kind == "frequency" else "data"]
            yield real_numbers(getattr(values, kind) if kind in ("real", "imag") else values)

    def stamps(self, position: int) -> FloatArray | None:
        """Return the times of a channel's samples, in s; None where the file states none."""
        channel = self._channels[position]
        if channel.over_frequency:
            return None
        set_number, _ = channel.handle
        with reading(self._path, self.expected):
            function = self._pyuff.UFF(str(self._path)).read_sets(set_number)
            return None if function["abscissa_spacing"] == 1 else _times(function, channel.samples)

    def _channels_of(self, set_number: int, header: dict[str, Any], name: str) -> Iterator[Channel]:
        """Yield the channels of a function: one over time; axis and parts over frequency."""
        samples = int(header["num_pts"])
        unit = _unit(header, "ordinate", self._units, int(header["rsp_dir"]))
        if header["func_type"] not in _RESPONSES:
            yield Channel(name, (set_number, ""), _clock(header), unit=unit, samples=samples)
            return
        below = _unit(header, "orddenom", self._units, int(header["ref_dir"]))
        if unit and below:
            unit = "/".join(f"({u})" if "/" in u else u for u in (unit, below))
        axis = _label(header, "abscissa") or "Hz"
        values = ("real", "imag") if header["ord_data_type"] in _COMPLEX else ("",)
        units = {"frequency": axis, **dict.fromkeys(values, unit)}
        for kind, its_unit in units.items():
            full = f"{name}.{kind}" if kind else name
            handle = (set_number, kind)
            yield Channel(full, handle, unit=its_unit, over_frequency=True, samples=samples)

    def _channels_of_shapes(
        self, sets: Sequence[dict[str, Any]], refused: dict[str, str]
    ) -> Iterator[Channel]:
        """Yield the responses of data sets 55, each of which holds all nodes at one frequency."""
        steps = [s for s in sets if s.get("analysis_type") == 5 and s.get("data_type") == 5]
        if len(steps) < len(sets):
            refused["data set 55"] = "of modes, or real, and no complex frequency response"
        if not steps:
            return
        nodes = steps[0]["node_nums"]
        if any(not np.array_equal(step["node_nums"], nodes) for step in steps):
            refused["data set 55"] = "of other nodes at other frequencies"
            return
        steps.sort(key=lambda step: step["freq"])
        frequency_hz = np.array([float(step["freq"]) for step in steps])
        unit = _unit_of_kind(steps[0]["spec_data_type"], self._units)
        for index, axis in itertools.product(range(len(nodes)), (1, 2, 3)):
            values = [complex(step[f"r{axis}"][index]) for step in steps]
            columns = {
                "frequency": (frequency_hz, "Hz"),
                "real": (np.array([value.real for value in values]), unit),
                "imag": (np.array([value.imag for value in values]), unit),
            }
            for kind, (numbers, its_unit) in columns.items():
                name = f"{int(nodes[index])}:{_DIRECTIONS[axis]}.{kind}"
                yield Channel(name, (numbers, kind), unit=its_unit, over_frequency=True)


def _shape(file: Any, set_number: int) -> dict[str, Any]:
    """Return a data set 55; empty where pyuff cannot read it."""
    try:
        return file.read_sets(set_number)
    except Exception:  # pyuff raises nothing more special
        return {}


def _reason_against(header: dict[str, Any]) -> str:
    """Return why a function is refused; "" if it is not."""
    kind = header["func_type"]
    axis = header["abscissa_spec_data_type"]
    if kind in _RESPONSES:
        return "a frequency response over time" if axis == _TIME else ""
    if kind not in _TIME_SIGNALS:
        return f"of function type {kind}, and no time response (1) or frequency response (4)"
    if axis == _FREQUENCY:
        return "over frequency and not over time"
    return "complex" if header["ord_data_type"] in _COMPLEX else ""


def _name(header: dict[str, Any], *, repeated: bool) -> str:
    title = str(header["id1"]).strip()
    freedoms = _degree_of_freedom(header, "rsp")
    if header["func_type"] in _RESPONSES and int(header["ref_node"]):
        freedoms += f"/{_degree_of_freedom(header, 'ref')}"
    if title in ("", "NONE"):
        return freedoms
    return f"{title} ({freedoms})" if repeated else title


def _degree_of_freedom(header: dict[str, Any], end: str) -> str:
    sense = int(header[f"{end}_dir"])
    direction = _DIRECTIONS.get(abs(sense), "scalar").replace("+", "-" if sense < 0 else "+")
    return f"{header[f'{end}_node']}:{direction}"


def _label(header: dict[str, Any], axis: str) -> str:
    """Return the label of an axis's unit; "" for none."""
    label = str(header.get(f"{axis}_axis_units_lab") or "").strip()
    return "" if label.upper() == "NONE" else label


def _unit(header: dict[str, Any], axis: str, units: tuple[str, str] | None, direction: int) -> str:
    """Return the unit of an ordinate: its label, or by its kind where it is no rotation."""
    kind = 0 if abs(direction) > 3 else header[f"{axis}_spec_data_type"]
    return _label(header, axis) or _unit_of_kind(kind, units)


def _unit_of_kind(kind: float, units: tuple[str, str] | None) -> str:
    """Return the unit of a specific data type in a system of units; "" where that is not known.

    Source: data sets 58 and 164, Structural Dynamics Research Laboratory, University of Cincinnati.
    """
    if units is None:
        return ""
    return _KINDS.get(int(kind), "").format(length=units[0], force=units[1])


def _unit_system(units: dict[str, Any]) -> tuple[str, str] | None:
    """Return units of length and force by data set 164; None where code and factor differ."""
    system = _SYSTEMS.get(int(units["units_code"]))
    factor = float(units["length"])
    if system is None:
        lengths = [n for n, f in _LENGTHS.items() if math.isclose(f, factor, rel_tol=_SAME_LENGTH)]
        return (lengths[0], "") if lengths else None
    same = math.isclose(_LENGTHS[system[0]], factor, rel_tol=_SAME_LENGTH)
    return system if same else None


def _seconds(header: dict[str, Any]) -> float:
    """Return seconds per unit of a function's times; ValueError for a unit of something else."""
    label = _label(header, "abscissa")
    seconds = factor_between(label or "s", "s")
    if seconds is None:
        raise ValueError(f"times in {label!r}")
    return seconds


def _clock(header: dict[str, Any]) -> Clock | None:
    """Return the clock of an even abscissa; None where each sample has its own."""
    seconds = _seconds(header)
    if header["abscissa_spacing"] != 1:
        return None
    interval = float(header["abscissa_inc"])
    start = StartTime.on_own_clock(header["abscissa_min"] * seconds)
    return plainest_clock(interval * seconds, _half_unit(interval) * seconds, start)


def _times(function: dict[str, Any], samples: int) -> FloatArray:
    return real_numbers(function["x"])[:samples] * _seconds(function)


def _half_unit(interval: float) -> float:
    """Return half a unit of the last place of an interval in the file."""
    decimal = Decimal(repr(interval))
    # FORTRAN's E13.5 prints five, C's six
    digits = max(len(decimal.normalize().as_tuple().digits), 5)
    return 0.5 * 10.0 ** (decimal.adjusted() - digits + 1)


UFF = Reader(
    name="uff", title="universal file format", endings=(".uff", ".unv"), open=UffFile, extra="uff"
)
