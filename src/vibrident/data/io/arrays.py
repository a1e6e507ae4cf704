"""Named arrays as columns: of one and two axes, with fields, and complex.

HDF5 and both kinds of MATLAB files share this.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibrident.data.io.columns import MAX_COLUMNS, Channel, ColumnFile
from vibrident.data.io.stated import Levels, clock_of, nearest_unit, start_of

#: Fields of a compound type that is a complex number, as h5py's, MATLAB's and others' are.
_COMPLEX_FIELDS = (("real", "imag"), ("r", "i"), ("re", "im"))


@dataclass(frozen=True)
class ArrayColumn:
    """Column of an array in a file."""

    array: str  # path of the dataset, or name of the variable
    name: str  # as a calibration file writes it
    column: int | None = None  # of a two-dimensional array, from 0; else None
    field: str = ""  # of a compound type; "" for plain numbers
    component: str = ""  # "real" or "imag" of complex numbers; "" for real ones

    @property
    def without_part(self) -> str:
        """Return the name of the column whose real and imaginary parts are two channels."""
        return self.name.removesuffix(".real").removesuffix(".imag")

    def values_in(self, array: Any) -> Any:
        """Return the numbers of this column, shape (samples,).

        ``array``: the dataset or variable, of :func:`samples_first`.
        """
        values = array.reshape(-1) if self.column is None else array[:, self.column]
        if self.field:
            values = values[self.field]
        return getattr(values, self.component) if self.component else values


def samples_first(array: Any) -> Any:
    """Return an array with its longer axis, that of the samples, in front."""
    return array.T if array.ndim == 2 and array.shape[1] > array.shape[0] else array


def columns_of(
    array: str, name: str, shape: tuple[int, ...], dtype: np.dtype[Any]
) -> tuple[ArrayColumn, ...]:
    """Return the columns of an array: samples run along the longer axis.

    Column 2 of ``name`` is "name:2", a field of a compound type "name:field"; complex numbers have
    "….real" and "….imag". Scalars, arrays of three axes, very wide ones and types without numbers
    give none.
    """
    long_axes = [length for length in shape if length != 1]
    if len(shape) > 2 or not long_axes or min(shape) < 1:
        return ()
    if dtype.names:
        return _fields(array, name, dtype) if len(long_axes) == 1 else ()
    if len(long_axes) == 1:
        return _real_columns(ArrayColumn(array, name), dtype)
    if min(shape) > MAX_COLUMNS:
        return ()
    columns = (ArrayColumn(array, f"{name}:{number + 1}", number) for number in range(min(shape)))
    return tuple(real for column in columns for real in _real_columns(column, dtype))


def _fields(array: str, name: str, dtype: np.dtype[Any]) -> tuple[ArrayColumn, ...]:
    """Return the fields of numbers of a compound type; two may be those of complex numbers."""
    fields = dtype.names or ()
    for real, imag in _COMPLEX_FIELDS:
        if set(fields) == {real, imag}:
            field_columns = (
                ArrayColumn(array, f"{name}.real", field=real),
                ArrayColumn(array, f"{name}.imag", field=imag),
            )
            return field_columns if all(dtype[field].kind in "iuf" for field in fields) else ()
    columns = (
        (ArrayColumn(array, f"{name}:{field}", field=field), dtype[field]) for field in fields
    )
    return tuple(real for column, kind in columns for real in _real_columns(column, kind))


def _real_columns(column: ArrayColumn, dtype: np.dtype[Any]) -> tuple[ArrayColumn, ...]:
    """Return the column, the two parts of a complex one, or nothing for no numbers."""
    if dtype.kind == "c":
        return tuple(
            replace(column, name=f"{column.name}.{component}", component=component)
            for component in ("real", "imag")
        )
    return (column,) if dtype.kind in "iufb" and dtype.shape == () else ()


def channels_of(columns: Sequence[ArrayColumn], levels: Levels, where: str) -> Iterator[Channel]:
    """Yield the channels of one array, with the statements about them.

    ``levels``: statements about the array, by itself first, then by what holds it; ``where``: the
    file, for messages.
    """
    distinct = list(dict.fromkeys(column.without_part for column in columns))
    for column in columns:
        index = distinct.index(column.without_part)
        name = re.split("[/.]", column.array)[-1]
        unit = nearest_unit(name, levels[0], levels[1], index, len(distinct))
        clock = clock_of(levels, f"{where}, array {column.name!r}")
        yield Channel(column.name, column, clock, unit=unit, start=start_of(levels))


class ArrayFile(ColumnFile):
    """A file of named arrays, whose channels have ArrayColumns as handles; subclasses read them."""

    names_are_paths = True
    word = "array"

    @property
    def numbered(self) -> tuple[int, ...]:
        """Return the columns of the only array with several, or of the only array."""
        columns: list[ArrayColumn] = [channel.handle for channel in self._channels]
        several = [column.column is not None or ":" in column.name for column in columns]
        tables = {c.array for c, of_several in zip(columns, several, strict=True) if of_several}
        if len(tables) == 1:
            return tuple(i for i, of_several in enumerate(several) if of_several)
        return (0,) if len(columns) == 1 else ()

    def _plain_name(self, name: str) -> str:
        return name.strip().strip("/")
