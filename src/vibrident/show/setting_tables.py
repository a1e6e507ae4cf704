"""Tabulate a result's settings: uncertainty budget, and quality of interferometer signals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vibrident.base.amounts import UnitScale, pretty
from vibrident.physics.naming import parameter_name
from vibrident.result import Result
from vibrident.show.language import ENGLISH, Say
from vibrident.show.numbers import (
    NONE,
    parameter_scale,
    plain,
    sensitivity_scale,
    uncertainty,
    with_u,
)
from vibrident.show.views import Column, K, Table, columns


def budget(result: Result, say: Say = ENGLISH) -> Table | None:
    """Return a row a source and a column a parameter; None without a budget."""
    rows = result.settings.get("uncertainty_budget")
    if not isinstance(rows, list | tuple) or not rows or not all(_is_row(row) for row in rows):
        return None
    contributed = dict.fromkeys(name for row in rows for name in row["contributions"])
    names = [name for name in contributed if name in result.parameters]
    if not names:
        return None
    units = {name: parameter_scale(result, result.parameters[name]) for name in names}
    body: list[tuple[str, ...]] = [
        (
            _translated(str(row["source"]), say),
            str(row.get("type") or NONE),
            say.word("kind", str(row["kind"])) if row.get("kind") else NONE,
            _amount_text(row),
            plain(row.get("degrees_of_freedom"), 4),
            *(_size(row["contributions"].get(name), units[name]) for name in names),
        )
        for row in rows
    ]
    together = (_size(result.parameters[name].standard_uncertainty, units[name]) for name in names)
    body.append((say("text", "u_of_result"), "", "", "", "", *together))
    heads = (
        columns(*(say("head", key) for key in ("source", "type", "kind"))),
        columns("u", "ν", kind="number"),
    )
    parameter_columns = (
        Column(say.translate(parameter_name(name).words), "number", units[name].printed)
        for name in names
    )
    return Table(
        (*heads[0], *heads[1], *parameter_columns), tuple(body), notes=(say("text", "budget_note"),)
    )


def _translated(source: str, say: Say) -> str:
    """Translate the name of a source if it is one of ours; keep that of others."""
    return say.translate(source) if say.has(source) else source


def point_budget(result: Result, say: Say = ENGLISH) -> tuple[Table, ...]:
    """Return the budget of magnitude and phase by frequency and source; empty without effects."""
    document = result.settings.get("point_budget")
    if not isinstance(document, Mapping) or not document.get("sources"):
        return ()
    points = result.measured
    scale = sensitivity_scale(result)
    indices = [int(np.argmin(np.abs(points.frequency_hz - f))) for f in document["frequency_hz"]]
    kinds = [("magnitude", "magnitude", scale.factor, scale.unit, points.magnitude_uncertainty)]
    kinds += [("phase_deg", "phase", 1.0, "°", points.phase_deg_uncertainty)]
    tables = []
    for key, word, factor, unit, total in kinds:
        if not np.isfinite(total).any():
            continue
        sizes = [source[key] for source in document["sources"]]
        rows = []
        for i, index in enumerate(indices):
            u = None if np.isnan(total[index]) else factor * float(total[index])
            cells = [uncertainty(None if size[i] is None else factor * size[i]) for size in sizes]
            both = uncertainty(u), uncertainty(None if u is None else K * u)
            rows.append((f"{document['frequency_hz'][i]:.5g}", *cells, *both))
        sources = columns(
            *(_translated(str(source["source"]), say) for source in document["sources"]),
            kind="number",
        )
        heads = (
            Column("f", "number", "Hz"),
            *sources,
            Column("u", "number", unit),
            Column("U", "number", unit),
        )
        tables.append(
            Table(heads, tuple(rows), title=f"{word}, standard uncertainties in {unit}", name=word)
        )
    return tuple(tables)


def repeats(result: Result) -> Table | None:
    """Return the values of each run; None for a single one."""
    repeated = result.settings.get("repeats")
    if not isinstance(repeated, Mapping) or not repeated.get("values"):
        return None
    names = [name for name in repeated["values"][0] if name in result.parameters]
    scales = [parameter_scale(result, result.parameters[name]) for name in names]
    runs = repeated["values"]
    scatter = [float(np.std([row[name] for row in runs])) or None for name in names]
    printed = list(zip(names, scatter, scales, strict=True))
    rows = tuple(
        (
            row["mounting"],
            row["run"],
            *(with_u(row[n], u, scale.factor)[0] for n, u, scale in printed),
        )
        for row in runs
    )
    heads = [
        Column(parameter_name(n).words, "number", scale.printed)
        for n, scale in zip(names, scales, strict=True)
    ]
    return Table((*columns("mounting", "run"), *heads), rows).telling()


def regimes(result: Result) -> Table | None:
    """Return times and parameters of each regime of a changed sensor; None without a change."""
    entries = result.settings.get("regimes")
    if not isinstance(entries, list | tuple) or not entries:
        return None
    names = [name for name in entries[0]["parameters"] if name in result.parameters]
    scales = {name: parameter_scale(result, result.parameters[name]) for name in names}
    rows = []
    for regime in entries:
        cells = []
        for name in names:
            each = regime["parameters"][name]
            factor = scales[name].factor
            cells.append(with_u(each["value"], each["standard_uncertainty"], factor)[0])
        rows.append((plain(regime["from_s"], 5), plain(regime["to_s"], 5), *cells))
    heads = [
        Column(parameter_name(name).words, "number", scale.printed)
        for name, scale in scales.items()
    ]
    times = Column("from", "number", "s"), Column("to", "number", "s")
    return Table((*times, *heads), tuple(rows), title="Regimes of the sensor")


def _is_row(row: Any) -> bool:
    return (
        isinstance(row, Mapping)
        and "source" in row
        and isinstance(row.get("contributions"), Mapping)
    )


def _size(value: float | None, scale: UnitScale) -> str:
    return uncertainty(scale.times(value))


def _amount_text(row: Mapping[str, Any]) -> str:
    value = row.get("standard_uncertainty")
    unit = str(row.get("unit") or "")
    return (
        NONE
        if value is None
        else f"{plain(value, 4)} {pretty(unit) if unit != '1' else ''}".strip()
    )


_LIGHT_HEADS = (
    Column("record"),
    *columns("fringes", "counted", "by phase", "gaps", kind="number"),
    Column("left out", "number", "%"),
    Column("phase noise", "number", "rad"),
    Column("noise", "number", "m/√Hz"),
    *columns("offsets", "ratio", kind="number"),
    Column("quadrature error", "number", "rad"),
    Column("cyclic error", "text", "rad"),
)
_LIGHT_NOTE = (
    "Fringes: range of the phase in turns. Counted, by phase: half fringes by the signs of one "
    "signal and by the unwrapped phase (– where samples are too far apart to count). Offsets over "
    "the amplitude and ratio of the amplitudes are those of the ellipse that was used. Cyclic "
    "error: amplitudes of harmonics 1, 2 and 4 of the phase in what is left, with their standard "
    "uncertainties."
)


def light(result: Result) -> Table | None:
    """Return the quality of an interferometer's signals by record; None for other references."""
    interferometer = result.settings.get("interferometer")
    if not isinstance(interferometer, Mapping) or not all(
        isinstance(row, Mapping) for row in interferometer.values()
    ):
        return None
    rows = tuple((str(name), *_cells(row)) for name, row in interferometer.items())
    return Table(_LIGHT_HEADS, rows, notes=(_LIGHT_NOTE,)) if rows else None


def _cells(row: Mapping[str, Any]) -> list[str]:
    ellipse = row.get("ellipse") or {}
    counted = [
        plain(row.get(key) or None, 6) for key in ("half_fringes_counted", "half_fringes_by_phase")
    ]
    amplitudes = ellipse.get("amplitudes")
    centre = ellipse.get("centre")
    offsets = NONE
    ratio = NONE
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
