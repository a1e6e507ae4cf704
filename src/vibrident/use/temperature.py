"""A sensor at several temperatures: coefficients of sensitivity, frequencies and damping, relative, per kelvin.

The records of each temperature are identified by themselves. A line through the values of a parameter over temperature,
weighted by their type A uncertainties, gives its value at the reference temperature and its slope; their ratio is the
coefficient. Systematic effects are common to all temperatures, so they are in no ratio.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from vibrident.base.tails import chi2_tail
from vibrident.data.records import Calibration
from vibrident.fit.uncertainty.parameters import coverage_factor
from vibrident.result import Result
from vibrident.use.repeats import stated_by_some

USUAL_C = 23.0  # reference temperature where the certificate states none (ISO 16063-11, 4.1)


def temperatures_of(calibration: Calibration) -> dict[float, Calibration]:
    """Temperature in °C to the records at it, rising; empty where fewer than two are stated.

    Raises:
        InputError: some records state their temperature and others do not.
    """
    stated = [record.circumstances.temperature_c for record in calibration.records]
    known = sorted({t for t in stated if t is not None})
    if len(known) < 2:
        return {}
    at = {t: tuple(r for r in calibration.records if r.circumstances.temperature_c == t) for t in (*known, None)}
    if lacking := [r.name for r in at.pop(None)]:
        words = "state a temperature, and others do not"
        raise stated_by_some(calibration, lacking, words, "temperature_c", "temperature")
    return {t: replace(calibration, records=at[t]) for t in known}


def identify_temperatures(groups: Mapping[float, Calibration], identify: Callable[[Calibration], Result]) -> Result:
    """The result at the temperature nearest to the reference, with the coefficients in ``settings.temperature``.

    Args:
        groups: temperature in °C to its calibration, two or more.
        identify: a calibration to its result.
    """
    results = {t: identify(one) for t, one in groups.items()}
    stated = next(iter(groups.values())).certificate.get("temperature_c")
    reference = USUAL_C if stated is None else float(stated)
    reference = min(max(reference, min(results)), max(results))
    nearest = min(results, key=lambda t: abs(t - reference))
    base = results[nearest]
    names = [name for name, p in base.parameters.items() if not p.derived or p.unit == "Hz"]
    lines = {name: found for name in names if (found := _line(results, name, reference)) is not None}
    settings = {
        **base.settings,
        "temperature": {
            "reference_c": reference,
            "of_result_c": nearest,
            "temperatures_c": list(results),
            "coefficients": lines,
        },
    }
    warnings = tuple(dict.fromkeys(warning for one in results.values() for warning in one.warnings))
    adequate = all(one.fit.adequate for one in results.values())
    return replace(base, settings=settings, warnings=warnings, fit=replace(base.fit, adequate=adequate))


def _line(results: Mapping[float, Result], name: str, reference: float) -> dict[str, Any] | None:
    """Value at the reference temperature and relative slope per kelvin, with u; None where a u is not known."""
    found = [(t, one.parameters.get(name), _scatter(one, name)) for t, one in results.items()]
    known = [(t - reference, p.value, u) for t, p, u in found if p is not None and p.value and u]
    if len(known) < len(results):
        return None
    offset, value, u = np.array(known).T
    design = np.stack([np.ones_like(offset), offset], axis=1) / u[:, None]
    covariance = np.linalg.inv(design.T @ design)
    at, slope = covariance @ (design.T @ (value / u))
    chi2, degrees = float(np.sum(((value - at - slope * offset) / u) ** 2)), len(known) - 2
    gradient = np.array([-slope / at**2, 1.0 / at])
    own = float(np.sqrt(gradient @ covariance @ gradient))
    freedom = min(_freedom(one) for one in results.values())
    k, coefficient = coverage_factor(freedom * len(known)), float(slope / at)
    return {
        "value_at_reference": float(at),
        "unit": next(p.unit for _, p, _ in found if p is not None),
        "per_k": coefficient,
        "standard_uncertainty": own,
        "interval_95": [coefficient - k * own, coefficient + k * own],
        "chi2": chi2,
        "degrees_of_freedom": degrees,
        "probability": chi2_tail(degrees, chi2) if degrees > 0 else None,
    }


def _scatter(result: Result, name: str) -> float | None:
    """Type A standard uncertainty of a parameter; of a derived frequency in proportion to the first it follows from."""
    parameter = result.parameters.get(name)
    if parameter is None or parameter.standard_uncertainty is None:
        return None
    frequencies = (other for other, p in result.parameters.items() if not p.derived and p.unit == "Hz")
    source = next(frequencies, name) if parameter.derived else name
    own = math.sqrt(sum(float(row["contributions"].get(source) or 0.0) ** 2 for row in _type_a(result)))
    whole = result.parameters[source].standard_uncertainty
    return parameter.standard_uncertainty * own / whole if whole else None


def _freedom(result: Result) -> float:
    """Degrees of freedom of the type A part."""
    stated = [float(row["degrees_of_freedom"]) for row in _type_a(result) if row.get("degrees_of_freedom")]
    return min(stated, default=math.inf)


def _type_a(result: Result) -> list[dict[str, Any]]:
    """Rows of the budget."""
    return [row for row in result.settings.get("uncertainty_budget") or () if row.get("type") == "A"]
