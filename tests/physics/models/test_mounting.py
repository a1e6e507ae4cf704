"""A sensor on its mounting: the chain of masses against its equations of motion, integrated by another program."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vibrident.base.errors import ModelError
from vibrident.physics.discretisation import method
from vibrident.physics.models import parse
from vibrident.physics.models.state_space import realise
from vibrident.physics.simulation import Sine, exact_response

SENSOR = {"sensitivity": 1e-3, "natural_frequency": 45e3, "damping_ratio": 0.02}
MOUNTED = SENSOR | {"mounting_frequency": 30e3, "mounting_damping": 0.03}
MASS_RATIOS = (0.0, 0.05, 0.4)


def model_of(ratio):
    return parse("accelerometer+mounting" + (f":{ratio}" if ratio else ""))


def three_bodies(values, ratio, motion, times):
    """Forces on housing (1 kg) and seismic mass (``ratio`` kg, or none) that hang on a surface which moves as stated.

    Springs in N/m and dashpots in N s/m, positions of each body: no line in common with the package.
    """
    seismic = ratio or 1e-12
    whole = 1.0 + ratio
    wm, wn = (2 * np.pi * values[name] for name in ("mounting_frequency", "natural_frequency"))
    k_coupling, c_coupling = whole * wm**2, 2 * values["mounting_damping"] * whole * wm
    k_sensor, c_sensor = seismic * wn**2, 2 * values["damping_ratio"] * seismic * wn

    def slope(t, state):
        housing, v_housing, mass, v_mass = state
        x, v = motion(t)
        on_housing = k_coupling * (x - housing) + c_coupling * (v - v_housing)
        on_mass = k_sensor * (housing - mass) + c_sensor * (v_housing - v_mass)
        return [v_housing, on_housing - on_mass, v_mass, on_mass / seismic]

    solution = solve_ivp(slope, (0.0, times[-1]), [0.0] * 4, "DOP853", times, rtol=1e-11, atol=1e-22)
    return values["sensitivity"] * wn**2 * (solution.y[0] - solution.y[2])


@pytest.mark.parametrize("ratio", MASS_RATIOS)
@pytest.mark.parametrize("frequency", [9e3, 30e3])
def test_the_chain_is_three_bodies_integrated_in_time(ratio, frequency):
    """From rest, 0.5 ms in which all modes ring, against a general solver of the bodies' equations of motion."""
    rate, w = 1e6, 2 * np.pi * frequency
    times = np.arange(500) / rate
    found = exact_response(
        model_of(ratio), MOUNTED, Sine(frequency, 10.0, 0.0), sampling_rate_hz=rate, samples=500, start="rest"
    )
    peak = float(np.max(np.abs(found)))
    moves = Sine(frequency, 10.0, 0.0).value(times)  # what the package calls the phase of a sine

    phase = 0.0 if abs(moves[0]) > 5.0 else -np.pi / 2
    a0, v0 = np.cos(phase), np.sin(phase) / w
    expected = three_bodies(
        MOUNTED,
        ratio,
        lambda t: (
            10.0 * (-(np.cos(w * t + phase) - a0) / w**2 - v0 * t),
            10.0 * (np.sin(w * t + phase) / w - v0),
        ),
        times,
    )
    assert np.max(np.abs(found - expected)) < 2e-6 * peak


@pytest.mark.parametrize("ratio", MASS_RATIOS)
def test_the_response_is_that_of_the_bodies_matrix(ratio):
    """(K + jω C − ω² M) u = (k + jω c) x, solved at each frequency."""
    whole, seismic = 1.0 + ratio, ratio or 1e-9
    wm, wn = 2 * np.pi * 30e3, 2 * np.pi * 45e3
    k, c, ks, cs = whole * wm**2, 2 * 0.03 * whole * wm, seismic * wn**2, 2 * 0.02 * seismic * wn
    frequency = np.geomspace(100.0, 200e3, 80)
    expected = []
    for w in 2 * np.pi * frequency:
        stiffness = np.array([[k + ks, -ks], [-ks, ks]]) + 1j * w * np.array([[c + cs, -cs], [-cs, cs]])
        housing, mass = np.linalg.solve(stiffness - w**2 * np.diag([1.0, seismic]), [k + 1j * w * c, 0.0])
        expected.append(1e-3 * wn**2 * (housing - mass) / -(w**2))
    found = model_of(ratio).frequency_response(MOUNTED, frequency)
    np.testing.assert_allclose(found, expected, rtol=1e-7)


@pytest.mark.parametrize("ratio", MASS_RATIOS)
def test_a_mounting_at_30_khz_moves_10_khz_by_what_theory_says(ratio):
    """S grows by 1/(1 − (f/fm)²) = 12.5 % at 10 kHz, whatever the mass ratio, up to (f/f0)² of a part of it."""
    frequency = np.array([1e3, 10e3])
    stiff = MOUNTED | {"damping_ratio": 0.0, "mounting_damping": 0.0, "natural_frequency": 1e6}
    on_mounting = model_of(ratio).frequency_response(stiff, frequency)
    fixed = parse("accelerometer").frequency_response({n: stiff[n] for n in SENSOR}, frequency)
    np.testing.assert_allclose(on_mounting / fixed, 1 / (1 - (frequency / 30e3) ** 2), rtol=1e-4 * ratio + 1e-12)


def test_a_small_mass_ratio_goes_over_into_the_series():
    frequency = np.geomspace(1e3, 100e3, 50)
    series = model_of(0.0).frequency_response(MOUNTED, frequency)
    errors = [np.max(np.abs(model_of(r).frequency_response(MOUNTED, frequency) / series - 1)) for r in (1e-4, 1e-5)]
    assert errors[0] / errors[1] == pytest.approx(10.0, rel=0.01)


@pytest.mark.parametrize(("name", "order"), [("euler", 1), ("foh", 2), ("tustin", 2)])
@pytest.mark.parametrize("ratio", [0.0, 0.4])
def test_order_of_convergence(name, order, ratio):
    """Error of the state space's step against step, of a tone begun in its exact state: the stated slope."""
    model, frequency = model_of(ratio), 8e3
    system = realise(model.rational(MOUNTED))
    s = 2j * np.pi * frequency
    state = np.linalg.solve(s * np.eye(system.order) - system.a, system.b.astype(complex))
    h = complex(model.frequency_response(MOUNTED, np.array([frequency]))[0])
    chosen = method(name)
    errors, rates = [], 8e6 * 2.0 ** np.arange(3)
    for rate in rates:
        n = round(1e-4 * rate)
        times = np.arange(n) / rate
        step = chosen.inputs(np.cos(2 * np.pi * frequency * times), np.ones(n, bool), chosen.terms(0.0)).coefficients
        weights = chosen.weights(system, 1 / rate, 0.0, chosen.terms(0.0))
        x, found = state.real, np.empty(n - 1)
        for k in range(n - 1):
            found[k] = weights.output @ x + weights.feedthrough @ step[k]
            x = weights.transition @ x + weights.drive @ step[k]
        errors.append(np.max(np.abs(found - np.real(h * np.exp(s * times[:-1])))))
    assert -np.polyfit(np.log(rates), np.log(errors), 1)[0] == pytest.approx(order, abs=0.08), errors


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("accelerometer+mounting:-1", "no ratio of masses"),
        ("accelerometer+mounting:inf", "no ratio of masses"),
        ("accelerometer+mounting:heavy", "cannot be read"),
        ("accelerometer+delay:3", "cannot be read"),
        ("gain+mounting:0.1", "no seismic mass"),
        ("accelerometer+mode2+mounting:0.1", "cannot be combined"),
        ("accelerometer+cubic+mounting", "cannot be combined"),
        ("accelerometer+mounting+mounting:0.1", "same name"),
    ],
)
def test_what_no_chain_is_gets_one_sentence(name, says):
    with pytest.raises(ModelError, match=says):
        parse(name)


def test_names_read_back():
    model = parse("accelerometer+delay+mounting:0.20+highpass")
    assert model.name == "accelerometer+mounting:0.2+highpass+delay"
    assert parse(model.name) == model
    assert parse("accelerometer+mounting:0").name == "accelerometer+mounting"
