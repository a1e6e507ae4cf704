"""Turn the result of a sensor into the known response of the channel that it is in."""

from __future__ import annotations

import os

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.known import KnownResponse, RationalResponse, Shape, Tabulated
from vibrident.data.known.unsure import effects_of_covariance, flat_effects
from vibrident.data.records import FloatArray, Quantity
from vibrident.result.result import Result
from vibrident.result.sensor import IdentifiedSensor

#: Frequencies at which slopes are tabulated, and a response that is not rational.
TABLE_POINTS = 2000


def known_response(
    result: Result | str | os.PathLike[str], quantity: Quantity | None = None
) -> KnownResponse:
    """Return the response of an identified sensor, known in the band of its data.

    Its uncertainty follows from the covariance of the parameters, with its correlation over
    frequency.

    Args:
        result: of an identification, or the path of its file.
        quantity: of the motion that the sensor measures as a reference; None: as it was identified.

    Raises:
        InputError: the file cannot be read, the model is not linear, or the uncertainty of a
            parameter is not stated.
    """
    source = "a result"
    if not isinstance(result, Result):
        source = os.fspath(result)
        result = Result.load(result)
    result.require_linear()
    sensor = result.to_sensor("a known response")
    sensor.require_uncertainty()
    measured_quantity = quantity or sensor.quantity
    if "force" in (measured_quantity, sensor.quantity) and measured_quantity != sensor.quantity:
        raise InputError(
            "The result is not of a sensor of this quantity.",
            expected=f"a sensor that was identified by {measured_quantity}",
            found=f"a response per {sensor.quantity}",
            where=source,
            remedy="give the result of another sensor, or correct the quantity of the reference",
        )
    band_hz = sensor.band_hz or (0.0, np.inf)
    low = max(band_hz[0], 1e-9)
    frequency_hz = np.geomspace(low, min(band_hz[1], 1e9 * low), TABLE_POINTS)
    slopes = sensor.slopes(frequency_hz, measured_quantity)
    slopes = slopes / sensor.frequency_response(frequency_hz, measured_quantity)
    effects = effects_of_covariance(source, frequency_hz, slopes, sensor.covariance)
    effects += flat_effects(f"{source}, whose model was rejected", sensor.misfit, sensor.misfit)
    shape = _shape(sensor, measured_quantity, frequency_hz)
    return KnownResponse((shape,), sensor.response_unit, band_hz, effects, source)


def _shape(sensor: IdentifiedSensor, quantity: Quantity, frequency_hz: FloatArray) -> Shape:
    """Return the response as poles and zeros, or as a table at these frequencies."""
    model = sensor.model
    values = dict(sensor.values)
    if not model.has_network:  # a part of it is not rational
        response = sensor.frequency_response(frequency_hz, quantity)
        return Tabulated(frequency_hz, np.abs(response), np.angle(response))
    system = model.rational(values, quantity)
    numerator, denominator = (
        np.trim_zeros(np.array(c, dtype=float)[::-1], "f")
        for c in (system.numerator, system.denominator)
    )
    gain = float(system.gain) * numerator[0] / denominator[0]
    delay_s = float(model.delay_s(values)) if model.has_delay else 0.0
    poles, zeros = (np.roots(c).astype(complex) for c in (denominator, numerator))
    return RationalResponse(poles, zeros, gain, delay_s)
