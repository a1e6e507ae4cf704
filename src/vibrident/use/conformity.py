"""Conformity with requirements: decision rules, probability of conformance (JCGM 106:2012)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from vibrident.base.errors import unknown
from vibrident.data.records import FloatArray
from vibrident.physics.models import installed
from vibrident.result import Result

Rule = Literal["simple", "guarded"]
#: Quantity: deviation in percent from the sensitivity at the reference frequency.
DEVIATION = "sensitivity_deviation"
#: A ratio nearer to one than the rounding of its two values and of the quotient is one.
MAX_RATIO_ROUNDING = 4.0 * np.finfo(float).eps
GUARD_BAND_IN_U = 2.0  # w = U with k = 2 (ILAC-G8:09/2019, 5.1)


@dataclass(frozen=True)
class JudgedRequirement:
    """Requirement with its judgement."""

    quantity: str  # name of a parameter, or ``sensitivity_deviation``
    unit: str  # of value and limits
    low: float  # tolerance limit; −∞ where there is none
    high: float  # tolerance limit; ∞ where there is none
    source: str  # of the requirement, as stated
    # of the result; of a deviation at the frequency where conformance is least probable
    value: float
    u: float | None  # standard uncertainty of the value; None where it is not known
    frequency_hz: float | None  # of a deviation; None otherwise
    probability: float | None  # of conformance; None without u
    met: bool | None  # by the decision rule; None where it cannot be judged


def probability_of_conformance(value: float, u: float, low: float, high: float) -> float:
    """Return the probability that a quantity lies within its limits (JCGM 106, 7.2).

    The quantity is normally distributed.
    """
    if u == 0.0:
        return float(low <= value <= high)
    ends = [math.erf((end - value) / (u * math.sqrt(2.0))) for end in (low, high)]
    return 0.5 * (ends[1] - ends[0])


def accepted(value: float, u: float | None, low: float, high: float, rule: Rule) -> bool | None:
    """Return whether a value is accepted, or None if that cannot be judged.

    ``simple``: it lies within its limits (JCGM 106, 8.2); ``guarded``: it does so by U with k = 2
    (8.3.2), which cannot be judged without u.
    """
    if rule == "simple":
        return low <= value <= high
    return None if u is None else low + GUARD_BAND_IN_U * u <= value <= high - GUARD_BAND_IN_U * u


def judge_requirements(
    result: Result, reference_hz: float | None, reference: tuple[float, float | None] | None
) -> list[JudgedRequirement]:
    """Judge each requirement of ``result.certificate``.

    Args:
        result: with the requirements and the decision rule in its certificate.
        reference_hz: the reference frequency; None where there is none.
        reference: magnitude of the sensitivity there and its standard uncertainty; None where there
            is none.

    Raises:
        InputError: a requirement is of a quantity that the result does not have.
    """
    rule: Rule = result.certificate.get("decision_rule") or "simple"
    judgements = []
    for entry in result.certificate.get("requirements") or ():
        low, high = (entry.get(key) for key in ("low", "high"))
        limits = -math.inf if low is None else float(low), math.inf if high is None else float(high)
        if entry["quantity"] == DEVIATION:
            points = (
                []
                if reference_hz is None
                else [*_deviations(result, entry, reference_hz, reference)]
            )
            rows = [_row(entry, "%", limits, *point, rule) for point in points]
            if not rows:
                rows = [_row(entry, "%", limits, math.nan, None, None, rule)]
            judgements.append(min(rows, key=_order))
            continue
        if _is_unstated(result, entry["quantity"]):
            judgements.append(_row(entry, "", limits, math.nan, None, None, rule))
            continue
        if entry["quantity"] not in result.parameters:
            raise unknown(
                "A requirement is of a quantity that the result does not have.",
                entry["quantity"],
                [*result.parameters, DEVIATION],
                "[[certificate.requirements]] quantity",
                "name one of these, or remove the requirement",
            )
        parameter = result.parameters[entry["quantity"]]
        u = parameter.standard_uncertainty
        judgements.append(_row(entry, parameter.unit, limits, parameter.value, u, None, rule))
    return judgements


def judge_points(
    result: Result, reference_hz: float, reference: tuple[float, float | None], *, limited: bool
) -> list[JudgedRequirement]:
    """Return the deviation of every measured point, with the narrowest limits that apply to it.

    Args:
        result: with the requirements and the decision rule in its certificate.
        reference_hz: the reference frequency.
        reference: magnitude of the sensitivity there, and its u.
        limited: whether the limits of the requirements apply.
    """
    rule: Rule = result.certificate.get("decision_rule") or "simple"
    entries = [
        entry
        for entry in result.certificate.get("requirements") or ()
        if limited and entry["quantity"] == DEVIATION
    ]
    judgements = []
    for value, u, frequency_hz in _deviations(result, {}, reference_hz, reference):
        valid = [entry for entry in entries if _applies_at(entry, frequency_hz)]
        low = max(
            (entry["low"] for entry in valid if entry.get("low") is not None), default=-math.inf
        )
        high = min(
            (entry["high"] for entry in valid if entry.get("high") is not None), default=math.inf
        )
        entry = {"quantity": DEVIATION}
        judgements.append(_row(entry, "%", (float(low), float(high)), value, u, frequency_hz, rule))
    return judgements


def _applies_at(entry: Any, frequency_hz: float) -> bool:
    """Return whether a requirement applies at this frequency."""
    low = entry.get("from_hz") or 0.0
    high = entry.get("to_hz") or math.inf
    return low * (1 - 1e-9) <= frequency_hz <= high * (1 + 1e-9)


def _is_unstated(result: Result, name: str) -> bool:
    """Return whether a parameter of the result's model is not stated, as of a rejected model."""
    model = installed(result.model)
    if model is None or name in result.parameters:
        return False
    return name in (*model.parameter_names, *(derived.name for derived in model.core.derived))


def _order(row: JudgedRequirement) -> tuple[bool, float, float]:
    """Return a sort key by which the point that decides comes first.

    A point decides that is not met, then least probable, then farthest from the middle.
    """
    return row.met is True, 1.0 if row.probability is None else row.probability, -abs(row.value)


def _row(
    entry: Any,
    unit: str,
    limits: tuple[float, float],
    value: float,
    u: float | None,
    frequency: float | None,
    rule: Rule,
) -> JudgedRequirement:
    is_finite = math.isfinite(value)
    chance = probability_of_conformance(value, u, *limits) if is_finite and u is not None else None
    met = accepted(value, u, *limits, rule) if is_finite else None
    return JudgedRequirement(
        entry["quantity"],
        unit,
        *limits,
        str(entry.get("source") or ""),
        value,
        u,
        frequency,
        chance,
        met,
    )


def _deviations(
    result: Result, entry: Any, reference_hz: float, reference: tuple[float, float | None] | None
) -> Iterator[tuple[float, float | None, float]]:
    """Yield deviation in percent, its u and its frequency, for the measured points of a band."""
    if reference is None or not reference[0]:
        return
    base, base_u = reference
    points = result.measured
    common = _common_gains(result, np.append(points.frequency_hz, reference_hz))
    columns = points.frequency_hz, points.magnitude, points.magnitude_uncertainty, common[:-1]
    for f, magnitude, u, gains in zip(*columns, strict=True):
        if not (_applies_at(entry, f) and np.isfinite(magnitude)):
            continue
        ratio = float(magnitude / base)
        if abs(ratio - 1.0) <= MAX_RATIO_ROUNDING:
            ratio = 1.0
        if ratio == 1.0 and f == reference_hz:
            yield 0.0, 0.0, float(f)
            continue
        relative = None
        if base_u is not None and np.isfinite(u):
            relative = ratio_uncertainty(u / magnitude, gains, base_u / base, common[-1])
        u_percent = None if relative is None else 100.0 * abs(ratio) * relative
        yield 100.0 * (ratio - 1.0), u_percent, float(f)


def ratio_uncertainty(
    u: float, common: FloatArray, base_u: float, base_common: FloatArray
) -> float:
    """Return the relative standard uncertainty of a ratio of two values that share sources.

    A shared source multiplies both values by nearly the same factor, so only the difference of its
    contributions remains (GUM 5.2.2); all else of the two values is taken as independent.

    Args:
        u: relative standard uncertainty of the numerator.
        common: relative contributions of the shared sources to it, shape (sources,).
        base_u: relative standard uncertainty of the denominator.
        base_common: contributions to that, shape (sources,).
    """
    independent = [
        max(total**2 - float(np.sum(shared**2)), 0.0)
        for total, shared in ((u, common), (base_u, base_common))
    ]
    rounding = 8.0 * np.finfo(float).eps
    independent = [
        variance if variance > rounding * total**2 else 0.0
        for variance, total in zip(independent, (u, base_u), strict=True)
    ]
    return math.sqrt(sum(independent) + float(np.sum((common - base_common) ** 2)))


def _common_gains(result: Result, frequency_hz: FloatArray) -> FloatArray:
    """Return relative contributions of gains and mountings to the magnitude, shape (m, sources).

    These act on all frequencies with one sign. A source that also acts in another way is left out:
    it then counts as new at each frequency.
    """
    kinds: dict[str, set[str]] = {}
    for row in result.settings.get("uncertainty_budget") or ():
        kinds.setdefault(str(row.get("source")), set()).add(str(row.get("kind")))
    budget = result.settings.get("point_budget") or {}
    sources = [
        source
        for source in budget.get("sources") or ()
        if kinds.get(str(source.get("source")), {""}) <= {"gain", "mounting"}
    ]
    if not sources:
        return np.zeros((len(frequency_hz), 0))
    known_hz = np.asarray(budget["frequency_hz"], dtype=float)
    points = result.measured
    nearest = np.argmin(np.abs(points.frequency_hz[:, None] - known_hz), axis=0)
    size = np.abs(points.magnitude[nearest])
    order = np.argsort(known_hz)
    columns = [
        np.interp(
            frequency_hz, known_hz[order], (np.asarray(source["magnitude"], float) / size)[order]
        )
        for source in sources
    ]
    return np.stack(columns, axis=1)
