"""The sensitivity curve, whose uncertainty is propagated from the parameters' covariance."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from vibrident.base.nominal import SAME, choose_reference, nominal_frequencies
from vibrident.data.records import FloatArray, Quantity
from vibrident.data.records.basis import distinct
from vibrident.fit.problem import Coordinates
from vibrident.fit.uncertainty.linearised import fitted_sensor
from vibrident.fit.uncertainty.parameters import MAX_RELATIVE_UNCERTAINTY
from vibrident.physics.models.base import Rational
from vibrident.result import Curve

POINTS = 201


def frequencies(
    band_hz: tuple[float, float],
    measured_hz: Iterable[float] = (),
    reference_hz: float | None = None,
) -> FloatArray:
    """Return a logarithmic grid over the band of the data; one point if it is one frequency.

    The points nearest to the frequencies of a certificate (nominal one-third octaves, the
    reference) are moved there, so that the result holds the values of a certificate.

    Args:
        band_hz: band of the data.
        measured_hz: frequencies of the data, which decide between nominal and exact frequencies.
        reference_hz: the requested reference frequency.
    """
    low, high = band_hz
    if not high > low:
        return np.array([low])
    grid = np.geomspace(low, high, POINTS)
    chosen = [point.frequency_hz for point in nominal_frequencies(low, high, measured_hz)]
    reference_point, _ = choose_reference(low, high, measured_hz, reference_hz)
    if reference_point and reference_point.frequency_hz not in chosen:
        chosen.append(reference_point.frequency_hz)
    distance = np.abs(np.log(grid[:, None] / np.array(chosen)))
    distance[[0, -1]] = np.where(distance[[0, -1]] <= SAME, -1.0, np.inf)  # the ends stay the ends
    for column, frequency in enumerate(chosen):
        nearest = int(np.argmin(distance[:, column]))
        grid[nearest] = frequency
        distance[nearest] = np.inf  # moved once
    return np.sort(grid)


def with_resonances(grid_hz: FloatArray, system: Rational) -> FloatArray:
    """Return the grid with more points at each pole and zero too sharp for it, so peaks are met.

    The points around a pole p lie by its half width (|Re p| / 2π), densely within two of these and
    then ever wider apart, until the grid takes over.

    ``grid_hz``: logarithmic, ascending; ``system``: the sensor's transfer function.
    """
    if grid_hz.size < 2:
        return grid_hz
    grids = [grid_hz]
    for coefficients in (system.numerator, system.denominator):
        for root in np.roots(np.asarray(coefficients, dtype=float)[::-1]):
            centre = abs(root.imag) / (2.0 * np.pi)
            half_width = max(abs(root.real) / (2.0 * np.pi), 1e-9 * abs(root))
            spacing = centre * float(np.log(grid_hz[-1] / grid_hz[0])) / (grid_hz.size - 1)
            if grid_hz[0] < centre < grid_hz[-1] and half_width < 2.0 * spacing:
                reach = max(8.0 * spacing / half_width, 4.0)
                outer_steps = np.geomspace(2.0, reach, 8 + int(12 * np.log10(reach)))
                steps = half_width * np.concatenate([np.arange(0.0, 2.0, 0.2), outer_steps])
                grids += [centre + steps, centre - steps]
    frequency_hz = distinct(np.concatenate(grids))
    return frequency_hz[(frequency_hz >= grid_hz[0]) & (frequency_hz <= grid_hz[-1])]


def curve(
    coordinates: Coordinates,
    z: FloatArray,
    covariance: FloatArray,
    quantity: Quantity,
    frequency_hz: FloatArray,
) -> Curve:
    """Return the model's curve at ``frequency_hz``, shape (points,), with standard uncertainties.

    The curve is per the sensor's own quantity; ``quantity``: of the reference.
    """
    sensor = fitted_sensor(coordinates, z, covariance, coordinates.model.stated_quantity(quantity))
    response = sensor.frequency_response(frequency_hz)
    relative, u_phase = sensor.uncertainty(frequency_hz)
    magnitude = np.abs(response)
    u_magnitude = magnitude * relative
    return Curve(
        frequency_hz,
        magnitude,
        np.rad2deg(np.angle(response)),
        np.where(u_magnitude < MAX_RELATIVE_UNCERTAINTY * magnitude, u_magnitude, np.nan),
        np.where(np.rad2deg(u_phase) < MAX_RELATIVE_UNCERTAINTY, np.rad2deg(u_phase), np.nan),
    )
