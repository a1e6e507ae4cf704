"""The sensitivity curve with its uncertainty: magnitude and phase propagated from the parameters' covariance."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from vibrident.nominal import SAME, reference, series
from vibrident.problem import Coordinates
from vibrident.records import FloatArray, Quantity
from vibrident.result import Curve
from vibrident.uncertainty.identifiability import NOTHING
from vibrident.uncertainty.linearised import fitted_sensor

POINTS = 201


def frequencies(
    band_hz: tuple[float, float], measured_hz: Iterable[float] = (), reference_hz: float | None = None
) -> FloatArray:
    """Logarithmic grid over the band of the data; one point where the band is one frequency.

    The points nearest to the frequencies of a certificate (nominal one-third octaves, the reference) are moved there,
    so that its values stand in the result; their number, and with it the compiled program, stays the same.

    Args:
        band_hz: band of the data.
        measured_hz: frequencies at which there are data; they tell nominal from exact frequencies.
        reference_hz: a reference frequency that was asked for.
    """
    low, high = band_hz
    if not high > low:
        return np.array([low])
    grid = np.geomspace(low, high, POINTS)
    chosen = [item.frequency_hz for item in series(low, high, measured_hz)]
    extra, _ = reference(low, high, measured_hz, reference_hz)
    chosen += [extra.frequency_hz] if extra and extra.frequency_hz not in chosen else []
    distance = np.abs(np.log(grid[:, None] / np.array(chosen)))
    distance[[0, -1]] = np.where(distance[[0, -1]] <= SAME, -1.0, np.inf)  # the ends stay the ends
    for column, frequency in enumerate(chosen):
        nearest = int(np.argmin(distance[:, column]))
        grid[nearest] = frequency
        distance[nearest] = np.inf  # moved once
    return np.sort(grid)


def curve(
    coordinates: Coordinates, z: FloatArray, covariance: FloatArray, quantity: Quantity, frequency_hz: FloatArray
) -> Curve:
    """Curve of the model at ``frequency_hz``, shape (points,), with standard uncertainties."""
    sensor = fitted_sensor(coordinates, z, covariance, quantity)
    response, (relative, u_p) = sensor.frequency_response(frequency_hz), sensor.uncertainty(frequency_hz)
    magnitude = np.abs(response)
    u_m = magnitude * relative
    return Curve(
        tuple(frequency_hz.tolist()),
        tuple(magnitude.tolist()),
        tuple(np.rad2deg(np.angle(response)).tolist()),
        tuple(u if u < NOTHING * m else None for u, m in zip(u_m.tolist(), magnitude.tolist(), strict=True)),
        tuple(u if u < NOTHING else None for u in np.rad2deg(u_p).tolist()),
    )
