"""A result and a sensor as a notebook shows them: a table and the curve, as a fragment of HTML."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vibrident.data.records import REFERENCE_UNITS, Quantity, is_motion
from vibrident.fit.uncertainty.parameters import fields_of_units
from vibrident.physics.naming import parameter_name
from vibrident.result import Curve, MeasuredCurve, Parameter, Result
from vibrident.result.sensor import IdentifiedSensor
from vibrident.show import terminal
from vibrident.show.coverage import scatter_only
from vibrident.show.figures import PICTURES
from vibrident.show.findings import describe_findings
from vibrident.show.media import html
from vibrident.show.numbers import magnitude_scale, sensitivity_unit, stated
from vibrident.show.response_figures import response_panels
from vibrident.show.views import Block, Column, Figure, K, Sentence, Stack, Table, columns

POINTS = 200  # of a sensor's curve


def result(shown: Result) -> str:
    """Return parameters, verdict, warnings, findings and sensitivity for a notebook."""
    curve = PICTURES["sensitivity"](shown)
    sentences = (terminal.fit_line(shown), *scatter_only(shown), *describe_findings(shown))
    blocks: list[Block] = [terminal.parameter_table(shown), *sentences]
    return html.fragment(*blocks, *([] if curve is None else [curve]))


def sensor(shown: IdentifiedSensor) -> str:
    """Return the values of a sensor with their uncertainties, and its curve."""
    fields = fields_of_units(
        shown.response_unit, shown.input_unit, drive=not is_motion(shown.quantity)
    )
    rows = []
    for spec, u in zip(shown.model.parameters, np.sqrt(np.diag(shown.covariance)), strict=True):
        known = Parameter(
            shown.values[spec.name], spec.unit.format(**fields), float(u), (None, None)
        )
        number = stated(known if np.isfinite(u) else replace(known, standard_uncertainty=None), K)
        rows.append(
            (
                parameter_name(spec.name).words,
                number.value,
                number.standard,
                number.expanded,
                number.unit,
            )
        )
    heads = (
        Column("parameter"),
        *columns("value", "u", f"U (k = {K:g})", kind="number"),
        Column("unit"),
    )
    blocks: list[Block] = [
        Sentence(f"Identified sensor, model {shown.model.name}."),
        Table(heads, tuple(rows)),
    ]
    if shown.band_hz is not None and shown.band_hz[0] < shown.band_hz[1]:
        quantity = shown.model.stated_quantity(shown.quantity)
        per = REFERENCE_UNITS[quantity] if is_motion(quantity) else shown.input_unit
        unit = sensitivity_unit(shown.response_unit, per)
        curve = _curve(shown, shown.band_hz, quantity)
        scale = magnitude_scale(unit, curve.magnitude)
        panels = response_panels(curve, MeasuredCurve.none(), scale, quantity, "")
        blocks.append(Figure("sensor", "Sensitivity", (Stack(panels),)))
    return html.fragment(*blocks)


def _curve(shown: IdentifiedSensor, band_hz: tuple[float, float], quantity: Quantity) -> Curve:
    frequency = np.geomspace(*band_hz, POINTS)
    response = shown.frequency_response(frequency, quantity)
    relative, angle = shown.uncertainty(frequency, quantity)
    size = np.abs(response)
    return Curve(
        frequency,
        size,
        np.degrees(np.unwrap(np.angle(response))),
        relative * size,
        np.degrees(angle),
    )
