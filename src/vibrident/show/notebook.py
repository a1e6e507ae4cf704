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
from vibrident.show.numbers import magnitude_scale, rounded_parameter, sensitivity_unit
from vibrident.show.response_figures import response_panels
from vibrident.show.views import Block, Column, Figure, K, Sentence, Stack, Table, columns

CURVE_POINTS = 200  # of a sensor's curve


def result(identification: Result) -> str:
    """Return parameters, verdict, warnings, findings and sensitivity for a notebook."""
    curve = PICTURES["sensitivity"](identification)
    sentences = (
        terminal.fit_line(identification),
        *scatter_only(identification),
        *describe_findings(identification),
    )
    blocks: list[Block] = [terminal.parameter_table(identification), *sentences]
    return html.fragment(*blocks, *([] if curve is None else [curve]))


def sensor(identified: IdentifiedSensor) -> str:
    """Return the values of a sensor with their uncertainties, and its curve."""
    fields = fields_of_units(
        identified.response_unit, identified.input_unit, drive=not is_motion(identified.quantity)
    )
    rows = []
    for spec, u in zip(
        identified.model.parameters, np.sqrt(np.diag(identified.covariance)), strict=True
    ):
        estimate = Parameter(
            identified.values[spec.name], spec.unit.format(**fields), float(u), (None, None)
        )
        number = rounded_parameter(
            estimate if np.isfinite(u) else replace(estimate, standard_uncertainty=None), K
        )
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
        Sentence(f"Identified sensor, model {identified.model.name}."),
        Table(heads, tuple(rows)),
    ]
    if identified.band_hz is not None and identified.band_hz[0] < identified.band_hz[1]:
        quantity = identified.model.stated_quantity(identified.quantity)
        per = REFERENCE_UNITS[quantity] if is_motion(quantity) else identified.input_unit
        unit = sensitivity_unit(identified.response_unit, per)
        curve = _curve(identified, identified.band_hz, quantity)
        scale = magnitude_scale(unit, curve.magnitude)
        panels = response_panels(curve, MeasuredCurve.none(), scale, quantity, "")
        blocks.append(Figure("sensor", "Sensitivity", (Stack(panels),)))
    return html.fragment(*blocks)


def _curve(identified: IdentifiedSensor, band_hz: tuple[float, float], quantity: Quantity) -> Curve:
    frequency = np.geomspace(*band_hz, CURVE_POINTS)
    response = identified.frequency_response(frequency, quantity)
    relative, angle = identified.uncertainty(frequency, quantity)
    size = np.abs(response)
    return Curve(
        frequency,
        size,
        np.degrees(np.unwrap(np.angle(response))),
        relative * size,
        np.degrees(angle),
    )
