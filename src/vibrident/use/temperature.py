"""Temperature coefficients of sensitivity, frequencies and damping, relative, per kelvin.

The records of each temperature are identified by themselves. A line through the values of a
parameter over temperature, weighted by their type A uncertainties, gives its value at the reference
temperature and its slope; their ratio is the coefficient. Systematic effects are common to all
temperatures, so they are in no ratio. Where the values do not lie on the line (probability below
10⁻³ for all lines together), that is a warning, and the coefficient's u is widened.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vibrident.base.amounts import plain
from vibrident.base.fields import Fields
from vibrident.data.records import Calibration
from vibrident.fit.response.verdict import REJECTION
from vibrident.fit.uncertainty.parameters import coverage_factor
from vibrident.physics.naming import in_words
from vibrident.result import Finding, Result, ResultWarning
from vibrident.use.line import Line, LinePoints, explanations, fit_line
from vibrident.use.repeats import partly_stated_error

DEFAULT_REFERENCE_C = (
    23.0  # reference temperature where the certificate states none (ISO 16063-11, 4.1)
)


def group_by_temperature(calibration: Calibration) -> dict[float, Calibration]:
    """Group the records by temperature in °C, rising; empty if fewer than two are stated.

    Raises:
        InputError: some records state their temperature and others do not.
    """
    temperatures = [record.circumstances.temperature_c for record in calibration.records]
    distinct = sorted({t for t in temperatures if t is not None})
    if len(distinct) < 2:
        return {}
    at = {
        t: tuple(r for r in calibration.records if r.circumstances.temperature_c == t)
        for t in (*distinct, None)
    }
    if lacking := [r.name for r in at.pop(None)]:
        words = "state a temperature, and others do not"
        raise partly_stated_error(calibration, lacking, words, "temperature_c", "temperature")
    return {t: replace(calibration, records=at[t]) for t in distinct}


def identify_temperatures(
    groups: Mapping[float, Calibration], identify: Callable[[Calibration], Result]
) -> Result:
    """Return the result at the temperature nearest to the reference.

    ``settings.temperature`` of the result holds the coefficients.

    Args:
        groups: temperature in °C to its calibration, two or more.
        identify: a calibration to its result.
    """
    results = {t: identify(calibration) for t, calibration in groups.items()}
    certificate_c = next(iter(groups.values())).certificate.get("temperature_c")
    reference = DEFAULT_REFERENCE_C if certificate_c is None else float(certificate_c)
    reference = min(max(reference, min(results)), max(results))
    nearest = min(results, key=lambda t: abs(t - reference))
    base = results[nearest]
    names = [name for name, p in base.parameters.items() if not p.derived or p.unit == "Hz"]
    all_points = {name: _points(results, name, reference) for name in names}
    points = {name: point for name, point in all_points.items() if point is not None}
    rejection = REJECTION / max(len(points), 1)
    lines = {
        name: _TemperatureLine(name, tuple(results), fit_line(parameter), rejection)
        for name, parameter in points.items()
    }
    # A derived parameter of parameters on straight lines lies on none.
    bent = [
        line for line in lines.values() if line.rejected and not base.parameters[line.name].derived
    ]
    settings = {
        **base.settings,
        "temperature": {
            "reference_c": reference,
            "of_result_c": nearest,
            "temperatures_c": list(results),
            "coefficients": {
                name: line.as_settings(base.parameters[name].unit) for name, line in lines.items()
            },
        },
    }
    warnings = [warning for result in results.values() for warning in result.warnings]
    warnings += [ResultWarning("lack_of_fit", line.sentence()) for line in bent]
    return replace(
        base,
        settings=settings,
        warnings=tuple(dict.fromkeys(warnings)),
        findings=(*base.findings, *(line.finding(nearest) for line in bent)),
        fit=replace(base.fit, adequate=all(result.fit.adequate for result in results.values())),
    )


def _points(results: Mapping[float, Result], name: str, reference: float) -> LinePoints | None:
    """Return a parameter's values over temperature, less the reference's.

    None where a u is not known.
    """
    values = [
        (t, result.parameters.get(name), _scatter(result, name)) for t, result in results.items()
    ]
    rows = [(t - reference, p.value, u) for t, p, u in values if p is not None and p.value and u]
    if len(rows) < len(results):
        return None
    x, y, u = np.array(rows).T
    return LinePoints(x, y, u, np.array([_freedom(result) for result in results.values()]))


@dataclass(frozen=True, eq=False)
class _TemperatureLine:
    """A parameter's line over temperature with its test.

    Attributes:
        name: of the parameter.
        temperatures_c: of the points, shape (n,).
        line: through the values over temperature less the reference.
        rejection: probability below which the values do not lie on it.
    """

    name: str
    temperatures_c: tuple[float, ...]
    line: Line
    rejection: float

    @property
    def rejected(self) -> bool:
        """Return whether the values do not lie on the line."""
        return self.line.probability < self.rejection

    @cached_property
    def explained_by(self) -> list[int | None]:
        """Return the causes that bring the values back to a line.

        Each is the index of a temperature, or None for a parabola.
        """
        return explanations(self.line.points, self.rejection) if self.rejected else []

    def as_settings(self, unit: str) -> Fields:
        """Return the coefficient with its u.

        The u is widened by the Birge ratio where the line is rejected.
        """
        at, slope = self.line.coefficients
        u, freedom = self.line.uncertainty(np.array([-slope / at**2, 1.0 / at]))
        settings: Fields = {
            "value_at_reference": float(at),
            "unit": unit,
            "per_k": float(slope / at),
        }
        if self.rejected:
            u = u * self._birge
            freedom = self.line.degrees
            outliers = [None if i is None else self.temperatures_c[i] for i in self.explained_by]
            settings |= {"birge_ratio": self._birge, "explained_by_c": outliers}
        k = coverage_factor(freedom)
        degrees = self.line.degrees
        return settings | {
            "standard_uncertainty": u,
            "interval_95": [settings["per_k"] - k * u, settings["per_k"] + k * u],
            "chi2": self.line.chi2,
            "degrees_of_freedom": degrees,
            "probability": self.line.probability if degrees > 0 else None,
        }

    @property
    def _birge(self) -> float:
        return float(np.sqrt(self.line.ratio))

    def sentence(self) -> str:
        """Return the test's outcome in words, and what alone explains it."""
        return (
            f"The {in_words(self.name)} over temperature is no straight line (χ² "
            f"{plain(self.line.chi2, 3)} with {self.line.degrees} degrees of freedom); the u of "
            f"its coefficient is widened by the Birge ratio {plain(self._birge, 3)}. "
            f"{self._explanation()}"
        )

    def _explanation(self) -> str:
        if self.line.degrees < 2:
            return "Three temperatures do not tell which value is off; measure at a fourth."
        if not self.explained_by:
            return "Neither one temperature nor a parabola alone explains it."
        words = [
            "a parabola" if i is None else f"the value at {plain(self.temperatures_c[i])} °C"
            for i in self.explained_by
        ]
        text = f"It is explained by {' or by '.join(words)} alone"
        if self._outlier is None:
            return f"{text}."
        with_it, without = (
            float(line.coefficients[1] / line.coefficients[0])
            for line in (self.line, self._without)
        )
        coefficients = f"{plain(1e6 * without, 4)} · 10⁻⁶/K in place of {plain(1e6 * with_it, 4)}"
        return f"{text}; without it the coefficient is {coefficients} · 10⁻⁶/K."

    @property
    def _outlier(self) -> int | None:
        return self.explained_by[0] if len(self.explained_by) == 1 else None

    @property
    def _without(self) -> Line:
        """Return the line with a free amount for the outlier."""
        assert self._outlier is not None
        return fit_line(self.line.points, np.eye(len(self.temperatures_c))[self._outlier])

    def finding(self, nearest: float) -> Finding:
        """Return the finding that one calibration does not lie on the line of the others.

        An outlier at ``nearest``, the temperature of the result, is part of its value.
        """
        moved = self._outlier is not None and self.temperatures_c[self._outlier] == nearest
        impact = {self.name: float(self._without.coefficients[2])} if moved else {}
        return Finding("lack_of_fit", None, None, self.line.probability, impact, self.sentence())


def _scatter(result: Result, name: str) -> float | None:
    """Return the type A standard uncertainty of a parameter.

    That of a derived frequency is in proportion to the first frequency that it follows from.
    """
    parameter = result.parameters.get(name)
    if parameter is None or parameter.standard_uncertainty is None:
        return None
    frequencies = (key for key, p in result.parameters.items() if not p.derived and p.unit == "Hz")
    source = next(frequencies, name) if parameter.derived else name
    scatter = math.sqrt(
        sum(float(row["contributions"].get(source) or 0.0) ** 2 for row in _type_a(result))
    )
    total = result.parameters[source].standard_uncertainty
    return parameter.standard_uncertainty * scatter / total if total else None


def _freedom(result: Result) -> float:
    """Return the degrees of freedom of the type A part."""
    freedoms = [
        float(row["degrees_of_freedom"]) for row in _type_a(result) if row.get("degrees_of_freedom")
    ]
    return min(freedoms, default=math.inf)


def _type_a(result: Result) -> list[Fields]:
    """Return the type A rows of the budget."""
    return [
        row for row in result.settings.get("uncertainty_budget") or () if row.get("type") == "A"
    ]
