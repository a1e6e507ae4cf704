"""Universal files (UFF, UNV): the time signals among their data sets 58 and 58b."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

from vibrident.data.io.columns import (
    Channel,
    Clock,
    ColumnFile,
    Start,
    library,
    reading,
    real_numbers,
    require_room,
)
from vibrident.data.io.reader import Reader
from vibrident.data.io.sampling import plainest_clock
from vibrident.data.io.timeline import clock_from_times
from vibrident.data.records import FloatArray

_EXPECTED = "a universal file with data sets 58 (functions at nodal degrees of freedom)"
#: Function types without a rule against time signals: general or unknown, and time response.
_TIME_SIGNALS = (0, 1)
_DIRECTIONS = {1: "+X", 2: "+Y", 3: "+Z", 4: "+RX", 5: "+RY", 6: "+RZ"}


class UffFile(ColumnFile):
    """A universal file. A channel has the name of its ID line 1, with node and direction where that is not unique.

    The format keeps the sampling interval to five or six digits; see ``plainest_clock`` for what is made of that.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._pyuff = library("pyuff", "uff", path)
        refused: dict[str, str] = {}
        usable: list[tuple[int, dict[str, Any]]] = []
        with reading(path, _EXPECTED):
            file = self._pyuff.UFF(str(path))
            for place, kind in enumerate(file.get_set_types()):
                if kind != 58:
                    continue
                header = file.read_sets(place, header_only=True)
                stated, held = int(header["num_pts"]), path.stat().st_size
                if not 0 < stated <= held:  # pyuff makes as many abscissas as the header states
                    raise ValueError(f"{stated} values in a file of {held} bytes")
                if reason := _reason_against(header):
                    refused[_name(header, repeated=False)] = reason
                else:
                    usable.append((place, header))
            titles = Counter(_name(header, repeated=False) for _, header in usable)
            channels = [
                Channel(
                    _name(header, repeated=titles[_name(header, repeated=False)] > 1),
                    (place, int(header["num_pts"])),
                    self._clock(file, place, header),
                )
                for place, header in usable
            ]
        super().__init__(path, channels, refused)

    def load(self, positions: Sequence[int]) -> tuple[FloatArray, ...]:
        """Read these channels; each has shape (samples,)."""
        with reading(self._path, _EXPECTED):
            file = self._pyuff.UFF(str(self._path))
            require_room(
                self._path, sum(self._channels[position].handle[1] for position in positions)
            )
            return tuple(
                self._signal(file, *self._channels[position].handle) for position in positions
            )

    def _clock(self, file: Any, place: int, header: dict[str, Any]) -> Clock | None:
        """From the abscissas, if each sample has one; else from the interval."""
        if header["abscissa_spacing"] == 1:
            interval_s = float(header["abscissa_inc"])
            return plainest_clock(
                interval_s, _half_unit(interval_s), Start.on_own_clock(header["abscissa_min"])
            )
        times_s = real_numbers(file.read_sets(place)["x"])[: int(header["num_pts"])]
        return clock_from_times(
            times_s, lambda row: f"{self._path}, data set {place + 1}, abscissa {row + 1}"
        )

    def _signal(self, file: Any, place: int, samples: int) -> FloatArray:
        values = real_numbers(file.read_sets(place)["data"])
        if values.size != samples:
            raise ValueError(
                f"data set {place + 1} has {values.size} values where it states {samples}"
            )
        return values


def _reason_against(header: dict[str, Any]) -> str:
    if header["func_type"] not in _TIME_SIGNALS:
        return f"of function type {header['func_type']} and not a time response (1)"
    if header["abscissa_spec_data_type"] == 18:
        return "over frequency and not over time"
    if header["ord_data_type"] in (5, 6):
        return "complex"
    return ""


def _name(header: dict[str, Any], *, repeated: bool) -> str:
    title, sense = str(header["id1"]).strip(), int(header["rsp_dir"])
    place = f"{header['rsp_node']}:{_DIRECTIONS.get(abs(sense), 'scalar').replace('+', '-' if sense < 0 else '+')}"
    if title in ("", "NONE"):
        return place
    return f"{title} ({place})" if repeated else title


def _half_unit(interval_s: float) -> float:
    """Half a unit of the last place of an interval in the file, s."""
    stated = Decimal(repr(interval_s))
    digits = max(
        len(stated.normalize().as_tuple().digits), 5
    )  # FORTRAN's E13.5 prints five, C's six
    return 0.5 * 10.0 ** (stated.adjusted() - digits + 1)


UFF = Reader(
    name="uff", title="universal file format", endings=(".uff", ".unv"), open=UffFile, extra="uff"
)
