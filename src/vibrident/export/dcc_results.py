"""Measurement part of a certificate: methods, equipment, conditions, and numbers in D-SI.

Units are in the spelling of the Digital System of Units, each one checked by dsiUnits.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.records import FloatArray
from vibrident.export.dcc_tree import LANGUAGE, Tree, cleaned, numeral
from vibrident.export.form import library
from vibrident.result import Curve, Parameter, Result
from vibrident.show.certificate import evaluation
from vibrident.show.coverage import coverage
from vibrident.show.curves import column
from vibrident.show.language import Translator
from vibrident.show.numbers import unit_of_sensitivity
from vibrident.show.views import K

_NAMES = {
    "V": "volt", "A": "ampere", "C": "coulomb", "Hz": "hertz", "s": "second", "m": "metre",
    "rad": "radian",
    "deg": "degree", "°": "degree", "N": "newton", "Pa": "pascal", "W": "watt", "F": "farad",
    "Ω": "ohm", "K": "kelvin",
    "%": "percent", "min": "minute",
}  # fmt: skip
_COUNT_UNITS = {
    "1",
    "count",
    "counts",
    "LSB",
    "digit",
    "digits",
}  # spellings of dimensionless counts
_PREFIXES = {
    "f": "femto", "p": "pico", "n": "nano", "u": "micro", "µ": "micro", "μ": "micro",
    "m": "milli", "c": "centi",
    "k": "kilo", "M": "mega", "G": "giga",
}  # fmt: skip
_TOKEN = re.compile(
    r"\s*(?:(\()|(\))|([*·/])|\^(\([+-]?\d+\)|[+-]?\d+)|(1(?![\d.])|[^\W\d_]+|[%°]))"
)
_PLAIN = str.maketrans({"²": "^2", "³": "^3"})


def d_si(unit: str) -> str:
    r"""Return a unit such as ``V/(m/s^2)`` in D-SI: ``\volt\metre\tothe{-1}\second\tothe{2}``.

    Raises:
        InputError: the unit is unknown, or dsiUnits is not installed.
    """
    powers = (
        name if power == 1 else f"{name}\\tothe{{{power}}}"
        for name, power in _parsed(unit).items()
        if power
    )
    text = "".join(powers) or "\\one"
    kind = library("dsi_unit", "dcc").DsiUnit
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # ``valid`` reports the same
        valid = kind(text).valid
    if not valid:
        raise _unknown(unit, text)
    return text


def _parsed(unit: str) -> dict[str, int]:
    """Return the product of named units, name → power, by one pass over the text.

    A quotient applies to the next factor only.
    """
    text = unit.strip().translate(_PLAIN) or "1"
    powers: dict[str, int] = {}
    signs = [1]  # of the parentheses around
    sign = 1  # of the next factor
    at = 0
    last: list[tuple[str, int]] = []
    while at < len(text):
        token = _TOKEN.match(text, at)
        if not token:
            raise _unknown(unit, text[at:])
        at = token.end()
        opened, closed, operator, power, name = token.groups()
        if opened:
            signs.append(signs[-1] * sign)
            sign = 1
            last = []
        elif closed:
            if len(signs) == 1:
                raise _unknown(unit, text)
            signs.pop()
            sign = 1
            last = []
        elif operator:
            sign = -1 if operator == "/" else 1
            last = []
        elif power is not None:
            if not last:
                raise _unknown(unit, text)
            for key, count in last:
                powers[key] += count * (int(power.strip("()")) - 1)
            last = []
        else:
            key = _named(name, unit)
            count = signs[-1] * sign
            if key is not None:
                powers[key] = powers.get(key, 0) + count
            last = [(key, count)] if key is not None else []
            sign = 1
    if len(signs) != 1:
        raise _unknown(unit, text)
    return powers


def _named(name: str, unit: str) -> str | None:
    """Return the D-SI name of a symbol with or without prefix; None for a pure number."""
    if name in _COUNT_UNITS:
        return None
    if name in _NAMES:
        return f"\\{_NAMES[name]}"
    if name[0] in _PREFIXES and name[1:] in _NAMES:
        return f"\\{_PREFIXES[name[0]]}\\{_NAMES[name[1:]]}"
    raise _unknown(unit, name)


def _unknown(unit: str, symbol: str) -> InputError:
    return InputError(
        f"The unit {unit!r} has no form in D-SI.",
        expected="units of the SI by their symbols, such as V/(m/s^2), mV, pC or count",
        found=repr(symbol),
        where="result.json, units",
        remedy="state [response] unit (and that of a drive) by its SI symbol and identify again",
    )


def measurement(tree: Tree, result: Result) -> Any:
    """Return the measurement result of a calibration.

    Raises:
        InputError: a unit has no form in D-SI.
    """
    make = tree.make
    text = tree.text
    certificate = result.certificate
    version = result.provenance.get("vibrident")
    release = cleaned(f"v{version}" if version else "not stated")
    methods = []
    if certificate.get("procedure"):
        procedure = tree.multiline("description", certificate["procedure"])
        methods.append(make("usedMethod", text("name", "calibration procedure"), procedure))
    about = text(
        "description",
        "identification of a parametric model of the sensor from its calibration data",
    )
    methods.append(
        make("usedMethod", text("name", evaluation(result, Translator(LANGUAGE))), about)
    )
    equipment = [_equipment(tree, entry) for entry in certificate.get("instruments", ())]
    conditions = [
        _condition(tree, certificate, *entry)
        for entry in _CONDITIONS
        if certificate.get(f"{entry[1]}_{entry[2]}") is not None
    ]
    quantities = [_parameter(tree, result, *p) for p in result.parameters.items()]
    results = [_result(tree, "parameters", tree.titled("parameters"), quantities)]
    if result.correlation.names and np.isfinite(np.array(result.correlation.matrix, float)).all():
        title = text("name", "Correlation of the estimated parameters")
        results.append(_result(tree, "correlation", title, [_correlation(tree, result)]))
    for key, title, curve in (
        ("response", "curve", result.response),
        ("measured", "measured", result.measured),
    ):
        # Points with frequency and magnitude: D-SI's lists allow no blanks.
        usable = np.flatnonzero(np.isfinite(curve.frequency_hz) & np.isfinite(curve.magnitude))
        if usable.size:
            results.append(
                _result(tree, key, tree.titled(title), [_curve(tree, result, curve, usable)])
            )
    if lists := _budget(tree, result):
        results.append(_result(tree, "budget", tree.titled("budget"), lists))
    return make(
        "measurementResult",
        text("name", "Sensitivity of a vibration sensor"),
        make("usedMethods", *methods),
        make(
            "usedSoftware",
            make("software", text("name", "vibrident"), make("release", text=release)),
        ),
        make("measuringEquipments", *equipment) if equipment else None,
        make("influenceConditions", *conditions) if conditions else None,
        make("results", *results),
    )


_CONDITIONS = (
    ("Temperature", "temperature", "c", r"\degreecelsius"),
    ("Relative humidity", "relative_humidity", "percent", r"\percent"),
    ("Air pressure", "air_pressure", "hpa", r"\hecto\pascal"),
)


def _condition(
    tree: Tree, certificate: Mapping[str, Any], title: str, key: str, suffix: str, unit: str
) -> Any:
    expanded = certificate.get(f"{key}_uncertainty_{suffix}")  # stated with k = 2
    real = _real(tree, float(certificate[f"{key}_{suffix}"]), unit, _expanded(tree, expanded, 0.95))
    quantity = tree.make("quantity", tree.text("name", title), real)
    return tree.make("influenceCondition", tree.text("name", title), tree.make("data", quantity))


def _equipment(tree: Tree, entry: Mapping[str, Any]) -> Any:
    make = tree.make
    text = tree.text
    notes = [
        f"{key.replace('_', ' ')}: {entry[key]}"
        for key in ("certificate", "calibrated_until")
        if entry.get(key)
    ]
    serial = entry.get("serial_number")
    return make(
        "measuringEquipment",
        tree.named(entry["name"]),
        text("description", "; ".join(notes)) if notes else None,
        make("manufacturer", tree.named(entry["manufacturer"]))
        if entry.get("manufacturer")
        else None,
        tree.optional("model", entry.get("type")),
        make("identifications", tree.identification("manufacturer", serial)) if serial else None,
    )


def _result(tree: Tree, key: str, name: Any, data: Sequence[Any]) -> Any:
    return tree.make("result", name, tree.make("data", *data), id=key)


def _budget(tree: Tree, result: Result) -> list[Any]:
    """Return the standard uncertainty of each parameter by source, in the sources' order."""
    rows = result.settings.get("uncertainty_budget") or ()
    rows = [
        row
        for row in rows
        if isinstance(row, Mapping) and isinstance(row.get("contributions"), Mapping)
    ]
    sources = [
        f"{number}: {row['source']} (type {row.get('type')})" for number, row in enumerate(rows, 1)
    ]
    names = [
        n
        for n in dict.fromkeys(n for row in rows for n in row["contributions"])
        if n in result.parameters
    ]
    lists = []
    for name in names:
        sizes = [row["contributions"].get(name) for row in rows]
        if None not in sizes:
            about = tree.make("description", tree.make("content", text=cleaned("; ".join(sources))))
            values = _list(
                tree,
                f"standard uncertainty of {name} by source",
                sizes,
                d_si(result.parameters[name].unit),
            )
            lists.append(tree.make("list", tree.text("name", name), about, values))
    return lists


def _parameter(tree: Tree, result: Result, name: str, p: Parameter) -> Any:
    low, high = p.interval_95
    u = p.standard_uncertainty
    if u is not None and low is not None and high is not None:
        spread = tree.make(
            "si:coverageInterval",
            tree.make("si:standardUnc", text=numeral(u)),
            tree.make("si:intervalMin", text=numeral(low)),
            tree.make("si:intervalMax", text=numeral(high)),
            tree.make("si:coverageProbability", text="0.95"),
        )
    else:
        spread = _expanded(tree, None if u is None else K * u, coverage(result).probability)
    notes = [name.replace("_", " ") + (", derived from the estimated ones" if p.derived else "")]
    notes += [] if p.identifiable else ["not determined by the data"]
    notes += [] if u is not None else ["uncertainty not stated"]
    if low is not None and high is None:  # in words, because D-SI's interval has two ends
        notes.append(f"95 % coverage interval from {numeral(low)}, without an upper limit")
    if low is None and high is not None:
        notes.append(f"95 % coverage interval up to {numeral(high)}, without a lower limit")
    if p.value is not None and math.isfinite(p.value):
        quantity = _real(tree, p.value, d_si(p.unit), spread, name)
    else:  # a derived one: JSON has no infinity, nor has D-SI
        quantity = tree.text("noQuantity", "no finite value")
    return tree.make(
        "quantity", tree.text("name", name), tree.text("description", "; ".join(notes)), quantity
    )


def _real(tree: Tree, value: float, unit: str, spread: Any, label: str | None = None) -> Any:
    return tree.make(
        "si:real",
        tree.optional("si:label", label),
        tree.make("si:value", text=numeral(value)),
        tree.make("si:unit", text=unit),
        spread,
    )


def _expanded(tree: Tree, expanded: float | None, probability: float) -> Any:
    """Return U with k = 2; empty if not stated."""
    if expanded is None:
        return None
    return tree.make(
        "si:expandedUnc",
        tree.make("si:uncertainty", text=numeral(float(expanded))),
        tree.make("si:coverageFactor", text="2.0"),
        tree.make("si:coverageProbability", text=_probability(probability)),
    )


def _correlation(tree: Tree, result: Result) -> Any:
    names = result.correlation.names
    rows = [
        _list(tree, name, row, r"\one")
        for name, row in zip(names, result.correlation.matrix, strict=True)
    ]
    order = "columns in the order of the rows: " + ", ".join(names)
    return tree.make(
        "list", tree.text("name", "Correlation matrix"), tree.text("description", order), *rows
    )


def _curve(tree: Tree, result: Result, curve: Curve, usable: np.ndarray) -> Any:
    """Return frequency, magnitude and phase as lists.

    The phase is left out if a point lacks it.
    """
    unit = d_si(unit_of_sensitivity(result))
    probability = coverage(result).probability
    sizes, phases = (column(curve, name)[usable] for name in ("magnitude", "phase_deg"))
    u_sizes, u_phases = (
        column(curve, f"{name}_uncertainty")[usable] for name in ("magnitude", "phase_deg")
    )
    columns = [
        _list(tree, "Frequency", curve.frequency_hz[usable], d_si("Hz")),
        _list(tree, "Magnitude", sizes, unit, u_sizes, probability),
    ]
    if not np.isnan(phases).any():
        columns.append(
            _list(tree, "Phase, lag negative", phases, d_si("deg"), u_phases, probability)
        )
    about = tree.text("description", f"response per {result.quantity}")
    return tree.make("list", tree.text("name", "Sensitivity over frequency"), about, *columns)


def _list(
    tree: Tree,
    title: str,
    values: Sequence[float] | FloatArray,
    unit: str,
    u: Sequence[float] | FloatArray = (),
    probability: float = 0.95,
) -> Any:
    """Return a list with one unit; expanded uncertainties (k = 2) if every point has one."""
    spread = None
    if len(u) and not np.isnan(u).any():
        spread = tree.make(
            "si:expandedUncXMLList",
            tree.make(
                "si:uncertaintyXMLList",
                text=" ".join(numeral(K * uncertainty) for uncertainty in u),
            ),
            tree.make("si:coverageFactorXMLList", text="2.0"),
            tree.make("si:coverageProbabilityXMLList", text=_probability(probability)),
        )
    return tree.make(
        "quantity",
        tree.text("name", title),
        tree.make(
            "si:realListXMLList",
            tree.make("si:valueXMLList", text=" ".join(map(numeral, values))),
            tree.make("si:unitXMLList", text=unit),
            spread,
        ),
    )


def _probability(value: float) -> str:
    """Return a probability without an exponent, as D-SI requires."""
    return f"{value:.6f}".rstrip("0")
