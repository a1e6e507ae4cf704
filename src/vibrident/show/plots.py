"""Draw pictures of a result from its values alone; matplotlib is loaded with the first one."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from vibrident.base.errors import unknown
from vibrident.result import Result
from vibrident.show.data_figures import inspection, light
from vibrident.show.figures import PICTURES
from vibrident.show.media import drawing
from vibrident.show.use_figures import correction, plan, tracking
from vibrident.show.views import Figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture

    from vibrident.data.records import Calibration

__all__ = [
    "PICTURES",
    "correction",
    "draw",
    "inspection",
    "light",
    "plan",
    "save",
    "save_all",
    "tracking",
]


def draw(name: str, result: Result) -> Picture:
    """Return one picture of a result as a matplotlib figure.

    Args:
        name: ``sensitivity``, ``deviation``, ``signals``, ``residuals`` or ``training``.
        result: any result; where it has nothing to show, the picture says so.

    Raises:
        InputError: there is no such picture.
    """
    if name not in PICTURES:
        raise unknown(
            "There is no such picture of a result.", name, list(PICTURES), "name of the picture"
        )
    figure = PICTURES[name](result)
    return drawing.picture(
        figure or Figure(name, f"{name.capitalize()}: nothing in the result", ())
    )


def draw_inspection(calibration: Calibration) -> Picture:
    """Return excerpts of a calibration's records, or its table with U, as a matplotlib figure."""
    return drawing.picture(inspection(calibration))


def save(figure: Figure | Picture, path: str | os.PathLike[str]) -> Path:
    """Write one figure as png, svg or pdf, by the path's suffix; return the path.

    The file has no date.
    """
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(drawing.content(figure, target.suffix[1:].lower()))
    return target


def save_all(
    result: Result,
    folder: str | os.PathLike[str],
    formats: Sequence[str] = ("png",),
    names: Sequence[str] = tuple(PICTURES),
) -> list[Path]:
    """Draw every picture that the result has something to show in.

    Args:
        result: any result; no data and no JAX are needed.
        folder: made if missing; files of the same name are replaced.
        formats: suffixes without dot: png, svg, pdf.
        names: of the pictures.

    Returns:
        paths written: ``sensitivity``, ``deviation``, ``signals``, ``residuals``, ``training``, as
        far as there is something to show, each in every format.
    """
    written = []
    for name in names:
        if (figure := PICTURES[name](result)) is not None:
            drawn = drawing.picture(figure)
            written.extend(save(drawn, Path(folder) / f"{name}.{suffix}") for suffix in formats)
    return written
