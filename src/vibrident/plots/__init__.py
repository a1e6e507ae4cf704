"""Pictures of a result, drawn from its values alone; matplotlib is loaded when the first one is drawn.

Each module has ``figure(result) -> matplotlib.figure.Figure``; ``inspection.figure`` takes a calibration.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from vibrident.plots import deviation, inspection, light, residuals, sensitivity, signals, style, training
from vibrident.result import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "PICTURES",
    "applicable",
    "deviation",
    "inspection",
    "light",
    "residuals",
    "save",
    "save_all",
    "sensitivity",
    "signals",
    "training",
]

#: Name of each picture of a result (its file name without suffix) and what draws it, in the order of a report.
PICTURES: dict[str, Callable[[Result], Figure]] = {
    "sensitivity": sensitivity.figure,
    "deviation": deviation.figure,
    "signals": signals.figure,
    "residuals": residuals.figure,
    "training": training.figure,
}


def applicable(result: Result) -> list[str]:
    """Names of the pictures that the result has something to show in, in the order of a report."""
    points = bool(result.measured.frequency_hz)
    shown = {
        "sensitivity": points or result.has_gain,
        "deviation": points,
        "signals": bool(result.signals),
        "residuals": points or bool(result.signals),
        "training": result.training is not None and bool(result.training.loss or result.training.parameters),
    }
    return [name for name in PICTURES if shown.get(name, True)]


def save(figure: Figure, path: str | os.PathLike[str]) -> Path:
    """Write one figure in the format of the path's suffix (png, svg or pdf); return the path."""
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    return style.save(figure, target)


def save_all(result: Result, folder: str | os.PathLike[str], formats: Sequence[str] = ("png",)) -> list[Path]:
    """Draw every picture that the result has something to show in.

    Args:
        result: any result; no data and no JAX are needed.
        folder: made if missing; files of the same name are replaced.
        formats: suffixes without dot: png, svg, pdf.

    Returns:
        paths written: ``sensitivity``, ``deviation``, ``signals``, ``residuals``, ``training``, as far as there is
        something to show, each in every format.
    """
    written = []
    for name in applicable(result):
        figure = PICTURES[name](result)
        written.extend(save(figure, Path(folder) / f"{name}.{suffix}") for suffix in formats)
    return written
