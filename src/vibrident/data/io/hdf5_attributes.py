"""Read the statements of an HDF5 or netCDF 4 file's attributes about its datasets."""

from __future__ import annotations

import functools
import math
import mmap
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.io.stated import Level, Levels, meaning_of, scalar, statements
from vibrident.data.records import FloatArray

#: Filters that come with the library: deflate, shuffle, Fletcher-32, szip, n-bit, scale-offset;
#: LZF comes with h5py.
_FILTERS = frozenset({1, 2, 3, 4, 5, 6, 32000})
_HEAP = b"GCOL\x01\0\0\0"
_MAX_REMARKS = 1000  # members of a group without columns
_MAX_STATED_ITEMS = 10_000  # of an attribute or of a dataset that states something


@dataclass(frozen=True)
class Packing:
    """Packing of a dataset's numbers by the conventions of netCDF."""

    scale: float
    offset: float
    missing: tuple[float, ...]  # numbers that stand for no value

    def unpack(self, values: FloatArray) -> None:
        """Turn stored numbers into values, in place; missing ones become NaN."""
        for number in self.missing:
            values[values == number] = np.nan
        with np.errstate(over="ignore"):  # an infinite value is refused where it is used
            values *= self.scale
            values += self.offset


def levels_of(file: Any, array: str, groups: dict[str, Level]) -> Levels:
    """Return the statements about a dataset: its own, its groups' and the file's, nearest first.

    A dataset of one number or text, such as "fs" or "unit", is a statement of its group, as MATLAB
    stores it. ``groups``: the statements of groups that were read, by path.
    """
    levels = [_statements_of(file[array])]
    while array:
        array = array.rpartition("/")[0]
        if array not in groups:
            group = file[array or "/"]
            level: Level = {}
            for name in group:
                if _is_remark(group, name):
                    level = {**_group_statements(group[name]), **level}
            groups[array] = {**level, **_group_statements(group)}
        levels.append(groups[array])
    return levels


def _group_statements(group: Any) -> Level:
    """Return the statements of a group, by its datasets of one number or text and attributes."""
    named = {name: _statement_value(group, name) for name in group if meaning_of(name)[0]}
    values = {name: value for name, value in named.items() if value is not None}
    return {**statements(values), **_statements_of(group)}


def _is_remark(parent: Any, name: str) -> bool:
    """Tell whether a member is a group without columns: what it states is of its parent."""
    import h5py

    if not isinstance(parent.get(name, getlink=True), h5py.HardLink):
        return False
    group = parent[name]
    return (
        isinstance(group, h5py.Group)
        and not name.startswith("#")
        and len(group) <= _MAX_REMARKS
        and all(isinstance(group.get(member, getlink=True), h5py.HardLink) for member in group)
        and not any(_holds_column(item) for item in group.values())
    )


def _holds_column(item: Any) -> bool:
    import h5py

    if not isinstance(item, h5py.Dataset):
        return True  # a group in it may hold some
    is_text = item.dtype.kind in "SO" or text_attribute(item, "MATLAB_class") == "char"
    return math.prod(item.shape or ()) > 1 and not is_text


def packing_of(dataset: Any, where: str) -> Packing | None:
    """Return how a dataset's numbers are packed; None if they are the values.

    InputError: a scale or an offset is no finite number, or the scale is 0.
    """
    scale = _packing_number(dataset, "scale_factor", 1.0, where)
    offset = _packing_number(dataset, "add_offset", 0.0, where)
    stored = [
        np.asarray(dataset.attrs.get(name, ())).reshape(-1)
        for name in ("_FillValue", "missing_value")
    ]
    missing = [
        float(number)
        for numbers in stored
        if numbers.dtype.kind in "iuf"
        for number in numbers[np.isfinite(numbers)]
    ]
    packing = Packing(scale, offset, tuple(missing))
    return None if packing == Packing(1.0, 0.0, ()) else packing


def _packing_number(dataset: Any, name: str, default: float, where: str) -> float:
    """Return the number of an attribute, finite and, of a scale, not 0."""
    value = np.asarray(dataset.attrs.get(name, default))
    if value.size == 1 and value.dtype.kind in "iuf":
        number = float(value.reshape(-1)[0])
        if math.isfinite(number) and (number != 0.0 or name != "scale_factor"):
            return number
    raise InputError(
        "A dataset's numbers cannot be scaled as the file says.",
        expected=f"{name} to be one finite number, and scale_factor not 0",
        found=f"{name} = {dataset.attrs[name]!r}",
        where=where,
        remedy="correct the attribute, or write the dataset's values unpacked",
    )


def axes_of(file: Any, arrays: Sequence[str]) -> dict[str, str]:
    """Return array → path of the axis that is attached to its samples, of those that have one.

    The axes' own lists are read: the arrays' are of variable length, and HDF5 never returns from
    reading such a list in some damaged files.
    """
    axes: dict[str, str] = {}
    for axis in arrays:
        for reference, along in file[axis].attrs.get("REFERENCE_LIST", ()):
            dataset = file[reference]
            array = dataset.name.strip("/")
            if array in arrays and array != axis and along == np.argmax(dataset.shape):
                axes[array] = axis
    return axes


def external_reason(dataset: Any) -> str:
    """Return why a dataset's numbers are outside the file or need a plug-in; "" if neither."""
    if dataset.external:
        return f"stored in another file, {str(dataset.external[0][0])!r}"
    if dataset.is_virtual:
        return "assembled from other datasets or files (a virtual dataset)"
    steps = dataset.id.get_create_plist()
    for step in range(steps.get_nfilters()):
        number, _, _, name = steps.get_filter(step)
        if number not in _FILTERS:
            words = name.decode("ascii", "replace")
            return f"compressed with filter {number} ({words}), which is a plug-in"
    return ""


def text_attribute(dataset: Any, name: str) -> str:
    """Return an attribute as text; "" where it is absent."""
    value = scalar(dataset.attrs.get(name, b""))
    return value if isinstance(value, str) else str(value)


def _statements_of(item: Any) -> Level:
    """Return the statements among the attributes of a dataset or group."""
    import h5py

    values: dict[str, Any] = {}
    for name in item.attrs:
        if not meaning_of(name)[0]:
            continue
        attribute = item.attrs.get_id(name)
        if not 0 < math.prod(attribute.shape or ()) <= _MAX_STATED_ITEMS:
            continue
        if h5py.check_string_dtype(attribute.dtype) is not None:
            _require_whole_heaps(item.file.filename, os.stat(item.file.filename).st_mtime_ns)
        values[name] = item.attrs[name]
    return statements(values)


@functools.lru_cache(maxsize=8)
def _require_whole_heaps(path: str, changed_ns: int) -> None:
    """Refuse a file whose texts HDF5 would never end to look for, with ValueError.

    Source: HDF5 File Format Specification, III.E, Global Heap: a collection is "GCOL", a version,
    and its size; its objects have an index, and their size at byte 8. ``changed_ns``: when the file
    changed.
    """
    with (
        open(path, "rb") as stream,
        mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content,
    ):
        start = content.find(_HEAP)
        while start >= 0:
            end = start + int.from_bytes(content[start + 8 : start + 16], "little")
            at = start + 16
            while at + 16 <= end:
                index = int.from_bytes(content[at : at + 2], "little")
                size = int.from_bytes(content[at + 8 : at + 16], "little")
                step = size if index == 0 else 16 + -(-size // 8) * 8
                if step == 0 or at + step > end or end > len(content):
                    raise ValueError(f"a damaged heap of texts at byte {at}")
                at += step
            start = content.find(_HEAP, start + 4)


def _statement_value(group: Any, name: str) -> Any:
    """Return the number or text that a dataset of a group holds; None for a column or a link."""
    import h5py

    if not isinstance(group.get(name, getlink=True), h5py.HardLink):
        return None
    item = group[name]
    if not isinstance(item, h5py.Dataset) or item.shape is None or external_reason(item):
        return None
    size = math.prod(item.shape)
    if (
        text_attribute(item, "MATLAB_class") == "char"
        and item.dtype.kind in "iu"
        and size <= _MAX_STATED_ITEMS
    ):
        return "".join(map(chr, np.asarray(item[...]).reshape(-1)))
    if item.dtype.kind == "O":
        _require_whole_heaps(item.file.filename, os.stat(item.file.filename).st_mtime_ns)
    return item[...].reshape(-1)[0] if size == 1 and item.dtype.kind in "iufSO" else None
