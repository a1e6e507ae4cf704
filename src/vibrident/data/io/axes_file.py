"""Read calibration files of several axes: [[response]] per output, one reference or several.

Each output and each motion has its ``axis``. With one reference the sensor was turned, and ``axis``
of each [[records]] entry says along which of its axes it was moved; with several, the exciter moves
along all of them.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vibrident.base.errors import InputError, unknown
from vibrident.data.io.calibration_file import checked_calibration
from vibrident.data.io.reading import calibration_of
from vibrident.data.io.toml_text import read_toml
from vibrident.data.records import Calibration

AXES = ("x", "y", "z")


@dataclass(frozen=True)
class AxesCalibration:
    """A sensor with several outputs.

    Attributes:
        outputs: axis of an output to its calibration by the first reference.
        motions: axis of a reference to a calibration whose records have that reference; empty with
            one reference, where the records say along which axis the exciter moved.
        transverse_motion: relative standard uncertainty of motion across the axis, with one
            reference (ISO 16063-31).
    """

    outputs: Mapping[str, Calibration]
    motions: Mapping[str, Calibration]
    transverse_motion: float = 0.0


def read_axes(path: str | os.PathLike[str]) -> AxesCalibration:
    """Read a calibration file of several axes and its data files.

    Raises:
        InputError: the file or the data cannot be used, or the axes do not fit together.
    """
    file = Path(path)
    where = str(path)
    document = read_toml(file)
    responses = _by_axis(document.get("response"), "[[response]]", where)
    several = isinstance(document.get("reference"), list)
    references = _by_axis(document["reference"], "[[reference]]", where) if several else {}
    single = {} if several else dict(document.get("reference") or {})
    purity = single.pop("transverse_motion", 0.0)
    if isinstance(purity, bool) or not isinstance(purity, int | float) or not 0 <= purity < 1:
        raise InputError(
            "The transverse motion cannot be used.",
            expected="a number from 0 to 1: standard uncertainty relative to the motion along "
            "the axis",
            found=f"transverse_motion = {purity!r}",
            where=f"{where}, [reference]",
            remedy="correct it, or leave it out",
        )
    first = next(iter(references.values()), single)

    def read(response: Mapping[str, Any], reference: Mapping[str, Any]) -> Calibration:
        axis_document = {**document, "response": response, "reference": reference}
        return calibration_of(checked_calibration(axis_document, where), file.parent, where)

    outputs = {axis: read(response, first) for axis, response in responses.items()}
    first_response = next(iter(responses.values()))
    motions = {axis: read(first_response, reference) for axis, reference in references.items()}
    for record in next(iter(outputs.values())).records:
        if record.excitation != "sine" or (not several and not record.circumstances.axis):
            raise InputError(
                "A record does not fit a calibration of several axes.",
                expected='excitation = "sine"'
                + ("" if several else ', and axis = "x", "y" or "z"'),
                found=f"{record.excitation!r}, axis {record.circumstances.axis!r}",
                where=f"{where}, record {record.name!r}",
                remedy="state the axis of the motion in its [[records]] entry, or leave the record "
                "out",
            )
    return AxesCalibration(outputs, motions, float(purity))


def _by_axis(entries: Any, name: str, where: str) -> dict[str, dict[str, Any]]:
    """Return axis → entry, without the key ``axis``."""
    if not isinstance(entries, list) or len(entries) < 2:
        raise InputError(
            "This is no calibration of several axes.",
            expected=f"two or three {name}, each with its axis",
            found=f"{len(entries) if isinstance(entries, list) else 1} of them",
            where=f"{where}, {name}",
            remedy="add the others, or identify it with ⟦command = identify⟧",
        )
    by_axis: dict[str, dict[str, Any]] = {}
    for number, entry in enumerate(entries, 1):
        location = f"{where}, {name} entry {number}"
        fields = dict(entry)
        axis = fields.pop("axis", None)
        if axis not in AXES:
            raise unknown(f"An entry of {name} has no axis.", str(axis), AXES, location)
        if axis in by_axis:
            raise InputError(
                f"Two entries of {name} have one axis.",
                expected="a different axis each",
                found=f"axis = {axis!r} twice",
                where=location,
                remedy="correct one of them",
            )
        by_axis[axis] = fields
    return by_axis
