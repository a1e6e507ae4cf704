"""A result as a sensor to compute with: its uncertainty at any frequency, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support.exported import CASES, result

from vibrident.base.errors import InputError

F = np.geomspace(5.0, 2000.0, 7)


def sensor(name):
    model, values, band = CASES[name]
    return result(model, values, band).to_sensor()


@pytest.mark.parametrize("name", ["everything", "coil inverted"])
def test_uncertainty_is_that_of_drawn_parameters(name, rng):
    """First-order propagation of a small covariance against the scatter of the responses themselves."""
    known = sensor(name)
    small = replace(known, covariance=1e-4 * known.covariance)
    draws = rng.multivariate_normal(list(known.values.values()), small.covariance, 4000)
    names = known.model.parameter_names
    drawn = [replace(known, values=dict(zip(names, d, strict=True))).frequency_response(F) for d in draws]
    off = np.array(drawn) / known.frequency_response(F) - 1.0
    magnitude, phase = small.uncertainty(F)
    np.testing.assert_allclose(magnitude, off.real.std(axis=0), rtol=0.06)
    np.testing.assert_allclose(phase, off.imag.std(axis=0), rtol=0.06)


def test_what_a_result_does_not_state_is_no_number_and_is_refused_where_needed():
    whole = result(*CASES["paper"])
    parameters = {**whole.parameters}
    parameters["damping_ratio"] = replace(parameters["damping_ratio"], standard_uncertainty=None)
    known = replace(whole, parameters=parameters).to_sensor()
    assert np.isnan(known.uncertainty(F)[0]).all()
    with pytest.raises(InputError, match="uncertainty of a parameter"):
        known.require_uncertainty()
    del parameters["damping_ratio"]
    with pytest.raises(InputError, match="lacks parameters"):
        replace(whole, parameters=parameters).to_sensor()
    with pytest.raises(InputError, match="no linear inverse"):
        replace(whole, model="accelerometer+cubic").require_linear()


def test_band_units_and_zeros():
    assert sensor("paper").band_hz == pytest.approx((10.0, 1000.0))
    assert [sensor(name).zeros_at_rest for name in ("paper", "piezo", "coil", "coil inverted")] == [0, 1, 1, 2]
    driven = result(*CASES["paper"], quantity="drive", unit="A").to_sensor()
    assert (driven.quantity, driven.input_unit, driven.response_unit) == ("drive", "A", "V")
    assert sensor("coil").input_unit == "m/s^2"
