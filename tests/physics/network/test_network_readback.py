"""What weights say: back to the sensor, as the network's own curve, and in the form of the paper's table."""

import numpy as np
import pytest

from vibrident.base.errors import ModelError
from vibrident.physics.discretisation import METHODS, Weights, method
from vibrident.physics.discretisation.weights import weight_table
from vibrident.physics.models import parse
from vibrident.physics.models.state_space import realise, state_scaling
from vibrident.physics.network.cell import Cell, run
from vibrident.physics.network.readback import network_response, physics_from_weights

SENSORS = {
    "accelerometer": {"sensitivity": -0.104, "natural_frequency": 652.0, "damping_ratio": 0.182},
    "velocity-pickup": {"generator_constant": 28.8, "natural_frequency": 450.0, "damping_ratio": 0.56},
}
RATE = 51200.0


def tied(name, p, scheme, rate=RATE):
    chosen = method(scheme)
    weights = chosen.weights(realise(parse(name).rational(p)), 1 / rate, 0.0, chosen.terms(0.1))
    return Weights(*(np.asarray(w) for w in weights))


@pytest.mark.parametrize("scheme", METHODS)
@pytest.mark.parametrize("name", SENSORS)
def test_eigenvalues_and_gain_give_the_sensor_back_in_any_coordinates(name, scheme, rng):
    p = SENSORS[name]
    weights = tied(name, p, scheme)
    basis = rng.standard_normal((2, 2))
    turned = Weights(
        np.linalg.solve(basis, weights.transition @ basis),
        np.linalg.solve(basis, weights.drive),
        weights.output @ basis,
        weights.feedthrough,
    )
    # A discretisation's gain at ωn is the sensor's only as far as it is exact there; at zero frequency they all are.
    rough = {"euler": 1e-1, "zoh": 1e-1, "foh": 1e-3, "tustin": 1e-3}.get(scheme, 1e-9)
    for found in (physics_from_weights(w, 1 / RATE, parse(name), scheme) for w in (weights, turned)):
        assert found["natural_frequency"] == pytest.approx(p["natural_frequency"], rel=1e-10)
        assert found["damping_ratio"] == pytest.approx(p["damping_ratio"], rel=1e-9)
        gain = parse(name).gain_name
        assert found[gain] == pytest.approx(p[gain], rel=1e-10 if name == "accelerometer" else rough)


@pytest.mark.parametrize("damping", [0.005, 0.182, 0.7, 1.0, 1.8])
def test_over_and_underdamped(damping):
    p = SENSORS["accelerometer"] | {"damping_ratio": damping}
    found = physics_from_weights(tied("accelerometer", p, "foh"), 1 / RATE, parse("accelerometer"), "foh")
    assert found == pytest.approx(p, rel=1e-7)  # at δ = 1 the eigenvalues are double: half the digits


def test_the_papers_reading_entry_by_entry():
    """Eq. (7): ωn² = −W3[1, 0]/Ts, 2 δ ωn = (1 − W3[1, 1])/Ts, K = W1[1]/Ts, of Euler's weights in V and V̇."""
    p = SENSORS["accelerometer"]
    system = realise(parse("accelerometer").rational(p))
    scaled, t = tied("accelerometer", p, "euler"), np.asarray(state_scaling(system))
    physical = Weights(
        scaled.transition * t[:, None] / t, scaled.drive * t[:, None], scaled.output / t, scaled.feedthrough
    )
    found = physics_from_weights(physical, 1 / RATE, parse("accelerometer"), "euler", "elements")
    assert found == pytest.approx(p, rel=1e-11)
    assert found == pytest.approx(physics_from_weights(physical, 1 / RATE, parse("accelerometer"), "euler"), rel=1e-10)


@pytest.mark.parametrize("scheme", METHODS)
def test_the_networks_curve_is_its_steady_response(scheme):
    """``network_response`` against the unrolled network itself on a sampled tone, once the transient is gone."""
    n, frequency = 3000, 0.07 * RATE
    weights = tied("accelerometer", SENSORS["accelerometer"], scheme)
    k = np.arange(n)
    chosen = method(scheme)
    inputs = chosen.inputs(np.cos(2 * np.pi * frequency / RATE * k), np.ones(n, dtype=bool), weights.drive.shape[1])
    output = np.asarray(run(Cell.from_weights(weights), inputs.coefficients))[1500:-100]
    basis = np.exp(2j * np.pi * frequency / RATE * k[1500:-100])
    fitted = np.linalg.lstsq(np.stack([basis.real, -basis.imag], axis=1), output, rcond=None)[0]
    own = network_response(weights, np.array([frequency]), 1 / RATE, scheme)[0]
    assert abs(own - (fitted[0] + 1j * fitted[1])) < 1e-6 * abs(own)


def test_the_band_limited_networks_curve_is_the_sensors():
    p = SENSORS["accelerometer"]
    frequency = np.geomspace(1.0, 0.4 * RATE, 50)
    chosen = method("bandlimited")
    terms = chosen.terms(2 * np.pi * 652 / RATE)
    weights = chosen.weights(realise(parse("accelerometer").rational(p)), 1 / RATE, 0.0, terms)
    own = network_response(Weights(*(np.asarray(w) for w in weights)), frequency, 1 / RATE, "bandlimited")
    true = parse("accelerometer").frequency_response(p, frequency)
    assert np.max(np.abs(own / true - 1)) < 1e-6  # the series is cut at 1e-10 of the response, not of its far tail
    assert np.max(np.abs(own - true)) < 1e-9 * np.max(np.abs(true))


def test_eulers_curve_shows_its_error():
    """At 51.2 kHz Euler with the true weights has too little damping; its peak is off by 20 to 60 %."""
    p = SENSORS["accelerometer"]
    frequency = np.linspace(500.0, 800.0, 3001)
    own = np.abs(network_response(tied("accelerometer", p, "euler"), frequency, 1 / RATE, "euler"))
    true = np.abs(parse("accelerometer").frequency_response(p, frequency))
    assert 1.2 < own.max() / true.max() < 1.6


@pytest.mark.parametrize(
    ("transition", "says"),
    [
        (np.diag([1.1, 0.9]), "stable oscillator"),
        (np.diag([1.1, 1.2]), "stable oscillator"),
        (np.array([[0.8, -0.7], [0.7, 0.8]]), "stable oscillator"),
        (np.diag([-0.5, 0.9]), "stable oscillator"),
        (np.eye(3), "two hidden states"),
    ],
)
def test_weights_that_are_no_oscillator_are_refused(transition, says):
    n = len(transition)
    weights = Weights(transition, np.ones((n, 1)), np.ones(n), np.zeros(1))
    with pytest.raises(ModelError, match=says):
        physics_from_weights(weights, 1e-3, parse("accelerometer"), "zoh")


def test_weight_table_is_the_papers_table_1():
    """W1…W4 in V and V̇ with layer and meaning, plain numbers; run as a cell they give the network's output."""
    p = SENSORS["accelerometer"]
    system = realise(parse("accelerometer").rational(p))
    weights = tied("accelerometer", p, "euler")
    table = weight_table(weights, np.asarray(state_scaling(system)))
    assert [table[name]["layer"] for name in ("W1", "W2", "W3", "W4")] == [
        "input → hidden",
        "hidden → output",
        "feedback hidden → hidden",
        "feedforward input → output",
    ]
    ts, wn, delta = 1 / RATE, 2 * np.pi * 652.0, 0.182
    np.testing.assert_allclose(table["W3"]["value"], [[1, ts], [-(wn**2) * ts, 1 - 2 * delta * wn * ts]], rtol=1e-13)
    np.testing.assert_allclose(table["W1"]["value"], [[0], [-0.104 * wn**2 * ts]], rtol=1e-13, atol=1e-20)
    assert isinstance(table["W4"]["value"][0], float)
    physical = Cell(*(np.array(table[name]["value"]) for name in ("W1", "W2", "W3", "W4")))
    inputs = np.random.default_rng(1).standard_normal((200, 1))
    np.testing.assert_allclose(run(physical, inputs), run(Cell.from_weights(weights), inputs), rtol=1e-9, atol=1e-12)
    assert np.shape(weight_table(weights)["W1"]["value"]) == (2, 1)
