"""Tabulate a result's settings: budgets, runs, regimes, quality of interferometer signals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from vibrident.base.amounts import UnitScale, pretty
from vibrident.physics.naming import parameter_name
from vibrident.result import Result
from vibrident.show.language import ENGLISH, Translator
from vibrident.show.numbers import (
    NONE,
    parameter_scale,
    plain,
    sensitivity_scale,
    uncertainty,
    with_u,
)
from vibrident.show.views import Column, K, Table, columns


def budget(result: Result, translate: Translator = ENGLISH) -> Table | None:
    """Return the uncertainty budget: a row a source, a column a parameter; None without one."""
    rows = result.settings.get("uncertainty_budget")
    if not isinstance(rows, list | tuple) or not rows or not all(_is_row(row) for row in rows):
        return None
    contributed = dict.fromkeys(name for row in rows for name in row["contributions"])
    scales = _parameter_scales(result, contributed)
    if not scales:
        return None
    body: list[tuple[str, ...]] = [
        (
            _source_name(row, translate),
            str(row.get("type") or NONE),
            translate.name("kind", str(row["kind"])) if row.get("kind") else NONE,
            _amount_text(row),
            plain(row.get("degrees_of_freedom"), 4),
            *(uncertainty(scale.times(row["contributions"].get(n))) for n, scale in scales.items()),
        )
        for row in rows
    ]
    totals = (
        uncertainty(scale.times(result.parameters[name].standard_uncertainty))
        for name, scale in scales.items()
    )
    body.append((translate("text", "u_of_result"), "", "", "", "", *totals))
    heads = (
        *columns(*(translate("head", key) for key in ("source", "type", "kind"))),
        *columns("u", "ν", kind="number"),
        *_parameter_columns(scales, translate),
    )
    return Table(heads, tuple(body), notes=(translate("text", "budget_note"),))


def point_budget(result: Result, translate: Translator = ENGLISH) -> tuple[Table, ...]:
    """Return the budget of magnitude and phase by frequency and source; empty without effects."""
    document = result.settings.get("point_budget")
    if not isinstance(document, Mapping) or not document.get("sources"):
        return ()
    points = result.measured
    indices = [int(np.argmin(np.abs(points.frequency_hz - f))) for f in document["frequency_hz"]]
    sources = columns(
        *(_source_name(source, translate) for source in document["sources"]), kind="number"
    )
    tables = []
    for key, name, scale in (
        ("magnitude", "magnitude", sensitivity_scale(result)),
        ("phase_deg", "phase", UnitScale(1.0, "°")),
    ):
        totals = getattr(points, f"{key}_uncertainty")
        if not np.isfinite(totals).any():
            continue
        rows = []
        for i, index in enumerate(indices):
            cells = [uncertainty(scale.times(source[key][i])) for source in document["sources"]]
            u = None if np.isnan(totals[index]) else scale.times(float(totals[index]))
            cells += [uncertainty(u), uncertainty(None if u is None else K * u)]
            rows.append((f"{document['frequency_hz'][i]:.5g}", *cells))
        heads = (
            Column("f", "number", "Hz"),
            *sources,
            Column("u", "number", scale.unit),
            Column("U", "number", scale.unit),
        )
        title = f"{name}, standard uncertainties in {scale.unit}"
        tables.append(Table(heads, tuple(rows), title=title, name=name))
    return tuple(tables)


def repeats(result: Result) -> Table | None:
    """Return the values of each run; None for a single one."""
    repeated = result.settings.get("repeats")
    if not isinstance(repeated, Mapping) or not repeated.get("values"):
        return None
    runs = repeated["values"]
    scales = _parameter_scales(result, runs[0])
    scatter = {name: float(np.std([row[name] for row in runs])) or None for name in scales}
    rows = tuple(
        (
            row["mounting"],
            row["run"],
            *(with_u(row[n], scatter[n], scale.factor)[0] for n, scale in scales.items()),
        )
        for row in runs
    )
    heads = (*columns("mounting", "run"), *_parameter_columns(scales))
    return Table(heads, rows).telling()


def regimes(result: Result) -> Table | None:
    """Return times and parameters of each regime of a changed sensor; None without a change."""
    entries = result.settings.get("regimes")
    if not isinstance(entries, list | tuple) or not entries:
        return None
    scales = _parameter_scales(result, entries[0]["parameters"])
    rows = []
    for regime in entries:
        cells = []
        for name, scale in scales.items():
            stated = regime["parameters"][name]
            cells.append(with_u(stated["value"], stated["standard_uncertainty"], scale.factor)[0])
        rows.append((plain(regime["from_s"], 5), plain(regime["to_s"], 5), *cells))
    times = Column("from", "number", "s"), Column("to", "number", "s")
    heads = (*times, *_parameter_columns(scales))
    return Table(heads, tuple(rows), title="Regimes of the sensor")


def _parameter_scales(result: Result, names: Iterable[str]) -> dict[str, UnitScale]:
    """Return the printed unit of each of these names that is a parameter of the result."""
    parameters = result.parameters
    return {n: parameter_scale(result, parameters[n]) for n in names if n in parameters}


def _parameter_columns(
    scales: Mapping[str, UnitScale], translate: Translator = ENGLISH
) -> tuple[Column, ...]:
    return tuple(
        Column(translate.phrase(parameter_name(name).words), "number", scale.printed)
        for name, scale in scales.items()
    )


def _source_name(row: Mapping[str, Any], translate: Translator) -> str:
    """Return the name of a source: ours translated, with formulas; that of others unchanged."""
    name = str(row["source"])
    return translate.phrase(name) if translate.knows(name) else name


def _is_row(row: Any) -> bool:
    return (
        isinstance(row, Mapping)
        and "source" in row
        and isinstance(row.get("contributions"), Mapping)
    )


def _amount_text(row: Mapping[str, Any]) -> str:
    value = row.get("standard_uncertainty")
    unit = str(row.get("unit") or "1")
    if value is None:
        return NONE
    return plain(value, 4) if unit == "1" else f"{plain(value, 4)} {pretty(unit)}"


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
    rows = tuple((str(name), *_light_cells(row)) for name, row in interferometer.items())
    return Table(_LIGHT_HEADS, rows, notes=(_LIGHT_NOTE,)) if rows else None


def _light_cells(row: Mapping[str, Any]) -> list[str]:
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
