"""Quality of an interferometer's signals as a table, one row per record."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vibrident.present.numbers import NONE, plain
from vibrident.present.views import Column, Table, columns
from vibrident.result import Result

_HEADS = (
    Column("record"),
    *columns("fringes", "counted", "by phase", "gaps", kind="number"),
    Column("left out", "number", "%"),
    Column("phase noise", "number", "rad"),
    Column("noise", "number", "m/√Hz"),
    *columns("offsets", "ratio", kind="number"),
    Column("quadrature error", "number", "rad"),
    Column("cyclic error", "text", "rad"),
)
_NOTE = (
    "Fringes: range of the phase in turns. Counted, by phase: half fringes by the signs of one signal and by the "
    "unwrapped phase (– where samples are too far apart to count). Offsets over the amplitude and ratio of the "
    "amplitudes are those of the ellipse that was used. Cyclic error: amplitudes of harmonics 1, 2 and 4 of the phase "
    "in what is left, with their standard uncertainties."
)


def light(result: Result) -> Table | None:
    """The table; None where the reference was no raw light."""
    found = result.settings.get("interferometer")
    if not isinstance(found, Mapping) or not all(isinstance(row, Mapping) for row in found.values()):
        return None
    rows = tuple((str(name), *_cells(row)) for name, row in found.items())
    return Table(_HEADS, rows, notes=(_NOTE,)) if rows else None


def _cells(row: Mapping[str, Any]) -> list[str]:
    ellipse = row.get("ellipse") or {}
    counted = [plain(row.get(key) or None, 6) for key in ("half_fringes_counted", "half_fringes_by_phase")]
    amplitudes, centre = ellipse.get("amplitudes"), ellipse.get("centre")
    offsets, ratio = NONE, NONE
    if amplitudes and centre:
        offsets = ", ".join(plain(c / a, 3) for c, a in zip(centre, amplitudes, strict=True))
        ratio = plain(amplitudes[1] / amplitudes[0], 5)
    cyclic = "; ".join(
        f"{order}: {plain(size.get('amplitude'), 2)} (u {plain(size.get('u'), 1)})"
        for order, size in (row.get("cyclic_error_rad") or {}).items()
    )
    left_out = row.get("left_out")
    return [
        plain(row.get("fringes"), 5),
        *counted,
        plain(row.get("gaps"), 5),
        plain(None if left_out is None else 100.0 * left_out, 3),
        plain(row.get("phase_noise_rad"), 2),
        plain(row.get("noise_density_m"), 2),
        offsets,
        ratio,
        plain(ellipse.get("quadrature_error_rad"), 3),
        cyclic or NONE,
    ]
