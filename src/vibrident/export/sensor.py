"""Prepare the sensor of a result for export: model, values, band, and their description."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from vibrident.base.errors import InputError, unknown
from vibrident.base.escaping import one_line
from vibrident.base.version import __version__
from vibrident.data.records import FloatArray, Quantity
from vibrident.physics.models import ADD_ONS, SensorModel, parse
from vibrident.result import Result
from vibrident.result.sensor import IdentifiedSensor

POINTS = 400  # points at which errors over the band are computed


@dataclass(frozen=True, eq=False)
class Exported:
    """Identified sensor over a band, complete or without add-ons."""

    identified: IdentifiedSensor  # the identified sensor
    model: SensorModel  # the exported model: the result's without what is left out
    band_hz: tuple[float, float]  # lowest and highest frequency of the data, or the user's choice
    left_out: tuple[str, ...] = field(
        default=(), kw_only=True
    )  # add-ons of the result that the export does not hold

    @property
    def values(self) -> Mapping[str, float]:
        """Return parameter name → value as in the result, SI units, frequencies in Hz."""
        return self.identified.values

    @property
    def quantity(self) -> Quantity:
        """Return the input quantity of the exported sensitivity: acceleration or the drive."""
        return self.identified.quantity

    @property
    def band(self) -> FloatArray:
        """Return frequencies over the band, Hz, shape (points,)."""
        low, high = self.band_hz
        return np.geomspace(low, high, POINTS) if high > low else np.array([low])

    def response(self, frequency_hz: FloatArray) -> np.ndarray:
        """Return the complex sensitivity to ``quantity``, shape (points,), for e^{+jωt}."""
        return np.asarray(
            self.model.frequency_response(
                self.values, np.asarray(frequency_hz, float), self.quantity
            )
        )

    @property
    def delay_s(self) -> float:
        """Return the delay of the exported model, s."""
        return float(self.model.delay_s(self.values))

    @property
    def delay_u_s(self) -> float:
        """Return the standard uncertainty of the delay, s."""
        times = [
            i for i, spec in enumerate(self.identified.model.parameters) if spec.kind == "time"
        ]
        return float(np.sqrt(np.sum(np.diag(self.identified.covariance)[times])))

    @property
    def input_unit(self) -> str:
        """Return the unit of the exported input."""
        return self.identified.input_unit

    @property
    def output_unit(self) -> str:
        """Return the unit of the exported output."""
        return self.identified.response_unit

    @property
    def error_of_leaving_out(self) -> float:
        """Return the largest relative deviation from the result's model over the band.

        It is 0 if the exported model is complete.
        """
        if not self.left_out:
            return 0.0
        complete = self.identified.frequency_response(self.band)
        return float(np.max(np.abs(self.response(self.band) / complete - 1.0)))

    def without(self, names: Sequence[str]) -> Self:
        """Return the sensor without these add-ons.

        Raises:
            InputError: an add-on cannot be left out.
        """
        possible = not_rational()
        for name in names:
            if name not in possible:
                remedy = "identify with a model without it, if the sensor has none"
                raise unknown(
                    f"{name!r} cannot be left out.", name, possible, "⟦export.without⟧", remedy
                )
        add_ons = [addon.name for addon in self.model.add_ons]
        remaining = [name for name in add_ons if name not in names]
        removed = [name for name in add_ons if name in names]
        model = parse("+".join([self.model.core.name, *remaining]))
        return replace(self, model=model, left_out=(*self.left_out, *removed))

    @property
    def apart(self) -> list[str]:
        """Return the add-ons that the poles and zeros do not contain, a delay first."""
        return [
            addon.name
            for addon in reversed(self.model.add_ons)
            if addon.rational is None and addon.force is None
        ]

    @property
    def window_s(self) -> float:
        """Return the length of the windows over which the exported model averages, s."""
        return float(sum(self.values[name] for name in self.model.windows))


@dataclass(frozen=True, eq=False)
class ExportedSensor(Exported):
    """Exported sensor with the result that it comes from."""

    result: Result


def not_rational() -> tuple[str, ...]:
    """Return the add-ons that are not rational, which some formats cannot hold exactly."""
    return tuple(name for name, addon in ADD_ONS.items() if addon.rational is None)


def read_sensor(result: Result, band_hz: tuple[float, float] | None = None) -> ExportedSensor:
    """Read a result for export.

    Raises:
        InputError: the result lacks a parameter of its model or a band, or the band cannot be used.
    """
    identified = result.to_sensor("an export")
    band = band_hz or identified.band_hz
    if band is None:
        raise InputError(
            "The result states no frequencies.",
            expected="measured points or a response curve",
            found="neither",
            where="result.json",
            remedy="give ⟦export.band_hz = (LOW, HIGH)⟧, or run ⟦command = identify⟧ again",
        )
    return ExportedSensor(identified, identified.model, band, result)


def require_linear(sensor: Exported) -> None:
    """Refuse a nonlinear model."""
    if not sensor.model.is_linear:
        spring = next(addon for addon in sensor.model.add_ons if addon.force is not None)
        raise InputError(
            f"This format describes linear sensors only, and this sensor has a {spring.title}.",
            expected="a linear model, or a format of tables and curves",
            found=sensor.model.name,
            where="⟦export.form⟧",
            remedy=(
                f"give ⟦export.without = [{spring.name!r}]⟧ for what the sensor is to small signals"
            ),
        )


def check_band(low: float, high: float) -> tuple[float, float]:
    """Return the two frequencies, refused if they are not a band."""
    if not (math.isfinite(high) and 0.0 < low < high):
        raise InputError(
            "The band cannot be used.",
            expected="a lower and a higher frequency in Hz, both above 0, such as 10:1000",
            found=f"{low:g}:{high:g}",
            where="⟦export.band_hz⟧",
            remedy="write ⟦export.band_hz = (LOW, HIGH)⟧",
        )
    return float(low), float(high)


def identity(sensor: ExportedSensor) -> list[str]:
    """Return the header of every file: sensor, model, origin, uncertainties; one line each."""
    result = sensor.result
    keys = ("manufacturer", "type", "serial_number")
    words = filter(None, (result.sensor.get(key) for key in keys))
    low, high = sensor.band_hz
    lines = [
        f"sensor: {' '.join(words) or 'not named'}",
        f"model: {result.model}, identified by vibrident ({result.estimator}), written by "
        f"{__version__}",
    ]
    if time := result.provenance.get("time"):
        lines.append(f"identified: {time}")
    lines += [
        f"sensitivity: {sensor.output_unit} per {sensor.input_unit}, for e^(+j w t), lag negative",
        f"band of the data: {low:.10g} Hz to {high:.10g} Hz",
    ]
    for name, p in result.parameters.items():
        unit = "" if p.unit == "1" else f" {p.unit}"
        u = "not stated" if p.standard_uncertainty is None else f"{p.standard_uncertainty!r}{unit}"
        note = "" if p.identifiable else ", not determined by the data"
        lines.append(f"{name} = {p.value!r}{unit}, standard uncertainty u = {u}{note}")
    if result.warning_codes:
        lines.append("warnings of the result: " + ", ".join(result.warning_codes))
    lines += [f"left out on request: {name}" for name in sensor.left_out]
    springs = {
        addon.name: addon.title
        for addon in sensor.identified.model.add_ons
        if addon.force is not None
    }
    lines += [
        f"without the {springs[name]} this is the sensor's response to small signals only"
        for name in sensor.left_out
        if name in springs
    ]
    if set(sensor.left_out) - set(springs):
        error = sensor.error_of_leaving_out
        lines.append(
            f"without it, the response deviates from the model by up to {error:.2e} (relative) "
            "over the band"
        )
    return [one_line(line) for line in lines]
