"""The sensitivity matrix of a sensor with several axes, as tables."""

from __future__ import annotations

import numpy as np

from vibrident.show.formulas import Words
from vibrident.show.numbers import NONE, magnitude_scale, with_u
from vibrident.show.views import Column, Table, columns
from vibrident.use.triaxial import Matrix

_NOTE = (
    "U with k = 2. Transverse: largest sensitivity across the axis, relative to the main one (ISO "
    "16063-31). Misalignment: angle between the axis and the direction of largest sensitivity. "
    "Both are magnitudes, so noise alone makes them larger than zero."
)


def main_table(matrix: Matrix) -> Table:
    """Return main and transverse sensitivity and misalignment of each output, by frequency."""
    rows = []
    scale = magnitude_scale(matrix.unit, np.abs(matrix.values).ravel())
    for row in matrix.main():
        for n, f in enumerate(matrix.frequency_hz):
            cells = (
                *with_u(row["magnitude"][n], row["magnitude_uncertainty"][n], scale.factor),
                *with_u(row["phase_deg"][n], row["phase_deg_uncertainty"][n], 1.0),
                *with_u(
                    row["transverse_percent"][n], row["transverse_uncertainty_percent"][n], 1.0
                ),
                *with_u(row["misalignment_deg"][n], row["misalignment_uncertainty_deg"][n], 1.0),
            )
            rows.append((row["output"] if n == 0 else "", f"{f:.5g}", *cells))
    heads = [("f", "Hz"), ("|S|", scale.unit), ("U", scale.unit), ("phase", "°"), ("U", "°")]
    heads += [("transverse", "%"), ("U", "%"), ("misalignment", "°"), ("U", "°")]
    numbers = (Column(title, "number", unit) for title, unit in heads)
    return Table(
        (*columns("output"), *numbers),
        tuple(rows),
        notes=(_NOTE,),
        title="Main and transverse sensitivity",
    )


def element_table(matrix: Matrix) -> Table:
    """Tabulate the elements of the matrix with U of Re and Im, a row per frequency and output."""
    scale = magnitude_scale(matrix.unit, np.abs(matrix.values).ravel())
    rows = []
    for n, f in enumerate(matrix.frequency_hz):
        for i, output in enumerate(matrix.outputs):
            cells = []
            for j in range(len(matrix.axes)):
                value = matrix.values[n, i, j]
                u = matrix.u[n, i, j]
                cell_texts = [
                    with_u(component, uncertainty, scale.factor)
                    for component, uncertainty in zip((value.real, value.imag), u, strict=True)
                ]
                cells += [NONE if np.isnan(value) else " ± ".join(pair) for pair in cell_texts]
            rows.append((f"{f:.5g}" if i == 0 else "", output, *cells))
    heads = [Words(f"{component} {axis}") for axis in matrix.axes for component in ("Re", "Im")]
    titled = (Column(head, "number", scale.unit) for head in heads)
    title = "Sensitivity matrix, value ± U (k = 2)"
    return Table(
        (Column("f", "number", "Hz"), *columns("output"), *titled), tuple(rows), title=title
    )
