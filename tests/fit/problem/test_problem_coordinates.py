"""The optimiser's numbers and the physical parameters: there and back, bounds, derivatives."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibrident.base.backend import jax, jnp
from vibrident.fit.problem import Coordinates
from vibrident.fit.problem.coordinates import BAND_MARGIN, MARGIN_BELOW, searched
from vibrident.fit.problem.time_domain import TimeProblem
from vibrident.physics.models import parse

START = {
    "sensitivity": -0.104,
    "natural_frequency": 652.0,
    "damping_ratio": 0.182,
    "highpass_frequency": 0.5,
    "delay": 3e-5,
}
NAME = "accelerometer+highpass+delay"


def coordinates(band=(10.0, 1000.0), start=START, name=NAME):
    return Coordinates.at(parse(name), start, band)


def test_the_first_point_is_the_start():
    assert coordinates().values(coordinates().first) == pytest.approx(START, rel=1e-14)
    assert coordinates().first.tolist() == pytest.approx([1.0, 0.0, np.arcsinh(0.182), 0.0, 3e-5 * 2 * np.pi * 1000.0])


@given(
    st.floats(-5, 5).filter(lambda v: abs(v) > 1e-6),
    st.floats(-3, 3),
    st.floats(0, 5),
    st.floats(-3, 3),
    st.floats(-9, 9),
)
def test_there_and_back(gain, natural, damping, corner, delay):
    """z → parameters → z by the table's formulas, for every kind."""
    c = coordinates(band=(1e-2, 1e5))
    values = c.values(np.array([gain, natural, damping, corner, delay]))
    assert values["sensitivity"] / -0.104 == pytest.approx(gain, rel=1e-12)
    assert np.log(values["natural_frequency"] / 652.0) == pytest.approx(natural, abs=1e-12)
    assert values["damping_ratio"] == pytest.approx(np.sinh(damping), rel=1e-12)
    assert np.log(values["highpass_frequency"] / 0.5) == pytest.approx(corner, abs=1e-12)
    assert values["delay"] * 2 * np.pi * 1e5 == pytest.approx(delay, rel=1e-12, abs=1e-15)


def test_add_ons_of_the_other_kinds():
    start = {"sensitivity": 1.0, "natural_frequency": 500.0, "damping_ratio": 0.1, "boxcar_length": 2e-3}
    c = coordinates(start=start, name="accelerometer+boxcar")
    assert c.values([*c.first[:3], np.log(2)])["boxcar_length"] == pytest.approx(4e-3, rel=1e-14)
    assert 0 < c.values([1, 0, 0.1, -50.0])["boxcar_length"] < 2e-6
    start = START | {"mode2_frequency": 900.0, "mode2_damping": 0.02, "mode2_gain": -0.03}
    del start["highpass_frequency"], start["delay"]
    c = coordinates(start=start, name="accelerometer+mode2")
    assert c.values(c.first) == pytest.approx(start, rel=1e-14)


def test_bounds():
    """δ is reflected at zero; a natural frequency stays near the data's band; the gain changes sign."""
    c = coordinates()
    assert c.values([1, 0, -0.3, 0, 0])["damping_ratio"] == np.sinh(0.3)
    assert c.values([1, 60.0, 0, 0, 0])["natural_frequency"] == pytest.approx(1000.0 * BAND_MARGIN)
    assert c.values([1, -60.0, 0, 0, 0])["natural_frequency"] == pytest.approx(10.0 / MARGIN_BELOW)
    assert c.values([-2, 0, 0, 0, 0])["sensitivity"] == pytest.approx(0.208)


def test_numpy_and_traced_values_agree_and_differentiate():
    assert TimeProblem  # loaded, it tells JAX what coordinates are
    c, z = coordinates(), np.array([0.7, 0.2, 0.4, -1.0, 2.0])

    def vector(z):
        return jnp.stack(list(c.physical(z).values()))

    traced = jax.jit(vector)(jnp.asarray(z))
    np.testing.assert_allclose(np.asarray(traced), list(c.values(z).values()), rtol=1e-14)
    slopes = np.asarray(jax.jacfwd(vector)(jnp.asarray(z)))
    for k in range(5):
        step = np.zeros(5)
        step[k] = 1e-6
        sides = [np.array(list(c.values(z + sign * step).values())) for sign in (-1, 1)]
        np.testing.assert_allclose(slopes[:, k], (sides[1] - sides[0]) / 2e-6, rtol=1e-8, atol=1e-12)


def test_a_trial_step_far_beyond_the_search_ends_at_its_limit():
    model = parse("accelerometer")
    start = {"sensitivity": 1.0, "natural_frequency": 100.0, "damping_ratio": 0.1}
    coordinates = Coordinates.at(model, start, (10.0, 1000.0))
    far = coordinates.first + np.array([0.0, 1e4, 0.0])
    assert coordinates.values(far)["natural_frequency"] == searched((10.0, 1000.0))["log"][1]
