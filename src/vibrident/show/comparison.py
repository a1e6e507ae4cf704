"""Compare several results: values, differences from the first, and E_n."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal

from vibrident.base.amounts import UnitScale, pretty, scaled
from vibrident.physics.naming import described, parameter_name
from vibrident.result import Result
from vibrident.show.formulas import Words
from vibrident.show.numbers import (
    NONE,
    per_unit,
    percent,
    plain,
    rounded,
    sensitivity_scale,
    sensor_name,
    signed,
    unit_of_sensitivity,
    with_sign,
    with_u,
)
from vibrident.show.points import SensitivityPoint, nominal_points, reference_point
from vibrident.show.views import Column, K, Table, columns
from vibrident.use.comparison import (
    assumed_sources,
    normalized_error,
    not_comparable,
    shared_covariance,
    shared_sources,
    stated_sources,
)

MAX_RESULTS_PER_TABLE = 5  # the first result among them; more results need further tables
_MIN_FIXED_POINT = 1e-7  # differences smaller than this carry a power of ten
EN = Words(
    "E_n = (value − first)/√(U² + U_first² − 2 k² cov) with the expanded uncertainties U, k = 2: "
    "|E_n| ≤ 1 says that the two agree within their uncertainties. The covariance is that of the "
    "stated sources which both share, such as the same reference. None is given for two "
    "evaluations of the same data, nor for different sensors."
)


@dataclass(frozen=True)
class Value:
    """A quantity of one result: value and standard uncertainty in the unit of the whole row."""

    value: float  # best estimate
    u: float | None  # None where not known
    # what of u other results may share, by source
    shared: Mapping[str, float] = field(default_factory=dict)

    @property
    def expanded(self) -> float | None:
        """Return the expanded uncertainty U, k = 2."""
        return None if self.u is None else K * self.u


@dataclass(frozen=True)
class ComparedQuantity:
    """A quantity of several results, all in one unit."""

    label: str  # what it is
    scale: UnitScale  # factor from the result's unit to the printed one, and that
    # one a result; None where the result has no such quantity in this unit
    values: tuple[Value | None, ...]
    # its differences are relative ones (not those of a phase or of a delay near zero)
    relative: bool = True


def parameter_value(result: Result, name: str) -> Value:
    """Return the value of a parameter, with what of its u another result may share."""
    parameter = result.parameters[name]
    shared = shared_sources(result, parameter=name)
    return Value(parameter.value, parameter.standard_uncertainty, shared)


def at_point(result: Result, point: SensitivityPoint) -> Value:
    """Return the magnitude of the sensitivity at a point, with what another result may share."""
    shared = shared_sources(result, sensitivity=(point.frequency_hz, point.magnitude))
    return Value(point.magnitude, point.magnitude_uncertainty, shared)


def quantities(results: Sequence[Result]) -> list[ComparedQuantity]:
    """Return the sensitivity at the reference frequency, then parameters of two results or more."""
    compared = []
    is_one_kind = len({sensitivity_kind(result) for result in results}) == 1
    points = [reference_point(result)[0] if is_one_kind else None for result in results]
    points = _points_at_first_frequency(points)
    nominals = [point.nominal for point in points if point is not None]
    if len(nominals) > 1:
        compared.append(_magnitudes(f"|S| at {nominals[0]} Hz", points, results))
    for key in dict.fromkeys(key for result in results for key in result.parameters):
        parameters = [result.parameters.get(key) for result in results]
        unit = next(parameter.unit for parameter in parameters if parameter is not None)
        values = tuple(
            parameter_value(result, key) if p is not None and p.unit == unit else None
            for result, p in zip(results, parameters, strict=True)
        )
        stated = [value for value in values if value is not None]
        if len(stated) > 1:
            scale = _scale(results[0], unit, [abs(v.value) for v in stated if v.value])
            is_relative = getattr(described(key), "kind", "") != "time"
            label = parameter_name(key).words
            compared.append(ComparedQuantity(label, scale, values, is_relative))
    return compared


def _scale(first: Result, unit: str, sizes: Sequence[float]) -> UnitScale:
    if pretty(unit) == pretty(unit_of_sensitivity(first)):
        return sensitivity_scale(first)
    return scaled(unit, sizes[0] if sizes else 0.0)


def sensitivity_kind(result: Result) -> tuple[str, str]:
    """Return the units of the response and of the sensitivity."""
    return result.response_unit, per_unit(result)


def _magnitudes(
    label: str, points: Sequence[SensitivityPoint | None], results: Sequence[Result]
) -> ComparedQuantity:
    values = (
        None if point is None else at_point(result, point)
        for point, result in zip(points, results, strict=True)
    )
    return ComparedQuantity(label, sensitivity_scale(results[0]), tuple(values))


def comparison_tables(
    results: Sequence[Result], names: Sequence[str]
) -> tuple[tuple[str, Table], ...]:
    """Return titles and tables: the results, their parameters, their sensitivities at nominal f.

    ``results``: at least two; differences are from the first; ``names``: what to call each.
    """
    reasons = [not_comparable(results[0], result) for result in results]
    rows = quantities(results)
    notes = tuple(filter(None, (EN, assumption(assumed(rows)))))
    subject_tables = []
    parameter_tables = []
    chunks = _chunks(len(results))
    for chunk in chunks:
        chunk_names = [names[i] for i in chunk]
        suffix = "" if len(chunks) == 1 else f" ({', '.join(chunk_names)})"
        subjects = _subjects_table([results[i] for i in chunk], chunk_names)
        subject_tables.append((f"What is compared{suffix}", subjects))
        if rows:
            body = tuple(line for row in rows for line in _lines(row, chunk, reasons))
            heads = (*columns("quantity", "unit", ""), *columns(*chunk_names, kind="number"))
            parameter_tables.append((f"Parameters{suffix}", Table(heads, body, notes=notes)))
    titled_tables = [*subject_tables, *parameter_tables]
    for result, name, reason in list(zip(results, names, reasons, strict=True))[1:]:
        table = _compare_at_nominal(results[0], result, (names[0], name), reason)
        if table is not None:
            titled_tables.append((f"Sensitivity of {name} beside {names[0]}", table))
    return tuple(titled_tables)


def assumed(rows: Sequence[ComparedQuantity]) -> list[str]:
    """Return the sources that values of one quantity share by assumption."""
    values = [[value for value in row.values if value is not None] for row in rows]
    pairs = itertools.chain.from_iterable(itertools.combinations(group, 2) for group in values)
    words = (assumed_sources(first.shared, second.shared) for first, second in pairs)
    return list(dict.fromkeys(itertools.chain.from_iterable(words)))


def _chunks(count: int) -> list[list[int]]:
    """Return groups of the first result and up to four others, as often as needed."""
    step = MAX_RESULTS_PER_TABLE - 1
    return [[0, *range(start, min(start + step, count))] for start in range(1, count, step)]


def _subjects_table(results: Sequence[Result], names: Sequence[str]) -> Table:
    rows = (
        ("sensor", *(sensor_name(result.sensor) or NONE for result in results)),
        ("model", *(result.model for result in results)),
        ("estimator", *(result.estimator for result in results)),
        (
            "sensitivity in",
            *(f"{pretty(r.response_unit)} per {pretty(per_unit(r))}" for r in results),
        ),
        (
            "date of calibration",
            *(str(r.certificate.get("date_of_calibration") or NONE) for r in results),
        ),
        ("evaluated", *(str(r.provenance.get("time") or NONE) for r in results)),
        ("χ²/ν", *(plain(r.fit.chi2_reduced, 4) for r in results)),
        ("NRMSE", *(plain(r.fit.nrmse, 4) for r in results)),
        ("model adequate", *("yes" if r.fit.adequate else "no" for r in results)),
        ("warnings", *(", ".join(r.warning_codes) or "none" for r in results)),
    )
    return Table(columns("", *names), rows)


def _compare_at_nominal(
    first: Result, second: Result, names: tuple[str, str], reason: str
) -> Table | None:
    """Return magnitude and phase of two results at common nominal frequencies; None without any."""
    if sensitivity_kind(first) != sensitivity_kind(second):
        return None
    scale = sensitivity_scale(first)
    second_points = {point.nominal: point for point in nominal_points(second)}
    rows = []
    for point in nominal_points(first):
        points = _points_at_first_frequency([point, second_points.get(point.nominal)])
        if points[1] is None:
            continue
        magnitudes = _magnitudes("", points, (first, second))
        phases = ComparedQuantity(
            "", UnitScale(1.0, "°"), tuple(_phase(p, point) for p in points), relative=False
        )
        rows.append(
            (
                point.nominal,
                *(text for value in magnitudes.values for text in value_texts(value, scale.factor)),
                *_difference_cells(magnitudes, reason),
                *_difference_cells(phases, reason),
            )
        )
    if not rows:
        return None
    heads = [Column("nominal", "number", "Hz")]
    for name in names:
        heads += [Column(f"{name}: |S|", "number", scale.unit), Column("U", "number")]
    heads += columns("difference", Words("E_n"), kind="number")
    heads += [Column("phase difference", "number", "°"), Column(Words("E_n of phase"), "number")]
    table = Table(tuple(heads), tuple(rows), notes=("Values are those of each identified model.",))
    has_phases = any(row[-2] != NONE for row in rows)
    return table if has_phases else table.select(tuple(range(len(heads) - 2)))


def _phase(point: SensitivityPoint | None, near: SensitivityPoint) -> Value | None:
    if point is None or point.phase_deg is None or near.phase_deg is None:
        return None
    return Value(
        near.phase_deg + (point.phase_deg - near.phase_deg + 180) % 360 - 180,
        point.phase_deg_uncertainty,
    )


def _difference_cells(row: ComparedQuantity, reason: str) -> tuple[str, str]:
    """Return the difference of the second value from the first, and E_n."""
    first, second = row.values
    if first is None or second is None:
        return NONE, NONE
    return difference(second, first, row), reason or error(second, first)


def _points_at_first_frequency(
    points: Sequence[SensitivityPoint | None],
) -> list[SensitivityPoint | None]:
    """Return the points at the frequency of the first.

    Nominal 160 Hz may be 160.00 or 158.49 Hz, where S is not the same.
    """
    first = next((point.frequency_hz for point in points if point is not None), 1.0)
    return [p if p is not None and abs(p.frequency_hz / first - 1) < 1e-6 else None for p in points]


def _lines(
    row: ComparedQuantity, chunk: Sequence[int], reasons: Sequence[str]
) -> list[tuple[str, ...]]:
    """Return the lines of a quantity: values with U, differences from the first, and E_n."""
    first, *later_values = (row.values[i] for i in chunk)
    texts = (value_texts(value, row.scale.factor) for value in (first, *later_values))
    unit = row.scale.printed
    values = (text if u == NONE else f"{text} ± {u}" for text, u in texts)
    lines: list[tuple[str, ...]] = [(row.label, unit, "value ± U", *values)]
    if first is not None:
        differences = (difference(value, first, row) for value in later_values)
        errors = (
            reasons[i] or error(value, first)
            for i, value in zip(chunk[1:], later_values, strict=True)
        )
        lines.append(("", "" if row.relative else unit, "difference", "", *differences))
        lines.append(("", "", Words("E_n"), "", *errors))
    return lines


def value_texts(value: Value | None, factor: float) -> tuple[str, str]:
    """Return value and U as text, the value rounded to the last digit of U."""
    return (NONE, NONE) if value is None else with_u(value.value, value.u, factor)


def difference(value: Value | None, base: Value, row: ComparedQuantity) -> str:
    """Return the difference from the base, relative where the quantity allows it."""
    if value is None:
        return NONE
    is_relative = bool(row.relative and base.value)
    factor = 100.0 / base.value if is_relative else row.scale.factor
    change = (value.value - base.value) * factor
    expanded = _expanded_difference(value, base, abs(factor))
    if is_relative and not expanded:
        return percent(change)
    text = with_sign(_fixed_point(rounded(change, expanded)[0]))
    return f"{text} %" if is_relative else text


def _fixed_point(text: str) -> str:
    """Write a number without a power of ten if few zeros do, so that a column can be compared."""
    if "e" not in text or abs(float(text)) < _MIN_FIXED_POINT:
        return text
    return f"{Decimal(text):f}"


def _expanded_difference(value: Value, base: Value, factor: float) -> float | None:
    """Return U of a difference times ``factor``; None where a u is not known."""
    if value.expanded is None or base.expanded is None:
        return None
    covariance = K**2 * shared_covariance(value.shared, base.shared)
    return max(value.expanded**2 + base.expanded**2 - 2 * covariance, 0.0) ** 0.5 * factor


def error(value: Value | None, base: Value) -> str:
    """Return E_n as text; both ways where an assumed common source decides."""
    if value is None or value.expanded is None or base.expanded is None:
        return NONE
    values = value.value, value.expanded, base.value, base.expanded
    errors = (
        normalized_error(*values, shared_covariance(sources, base.shared))
        for sources in (value.shared, stated_sources(value.shared))
    )
    return both_ways(*errors)


def both_ways(shared: float | None, identified: float | None) -> str:
    """Return E_n, and that without assumed common sources where the two judge otherwise.

    ``shared``: with all sources that both share; ``identified``: with those that an instrument
    identifies.
    """
    if shared is None:
        return NONE
    if identified is None or (abs(shared) > 1.0) == (abs(identified) > 1.0):
        return signed(shared, 2)
    return f"{signed(shared, 2)} or {signed(identified, 2)}"


def assumption(sources: Sequence[str]) -> Words | None:
    """Return what E_n assumes of these sources as a sentence; None without any."""
    if not sources:
        return None
    return Words(
        "Assumed to be the same each time, as no instrument with serial number or certificate "
        f"says so: {', '.join(dict.fromkeys(sources))}. Where E_n judges otherwise if they are "
        "not, it is given both ways."
    )
