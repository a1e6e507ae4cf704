"""Frequency responses against the equation of motion, textbook formulas and the realisation in state space."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from vibrident.base.backend import jax, jnp
from vibrident.base.errors import ModelError
from vibrident.physics.models import parse
from vibrident.physics.models.slopes import response_and_slopes
from vibrident.physics.models.state_space import realise, state_scaling

PAPER = {"sensitivity": 0.104, "natural_frequency": 652.0, "damping_ratio": 0.182}
GEOPHONE = {"generator_constant": 28.8, "natural_frequency": 4.5, "damping_ratio": 0.56}
CASES = [
    ("accelerometer", PAPER),
    ("accelerometer", {"sensitivity": -3.0, "natural_frequency": 5e4, "damping_ratio": 0.0}),
    ("accelerometer", {"sensitivity": 2e-12, "natural_frequency": 0.01, "damping_ratio": 2.5}),
    ("accelerometer+delay", PAPER | {"delay": 3e-4}),
    ("velocity-pickup", GEOPHONE),
    ("velocity-pickup+delay", GEOPHONE | {"delay": -1e-3}),
    ("accelerometer+highpass", PAPER | {"highpass_frequency": 0.5}),
    ("accelerometer+mode2", PAPER | {"mode2_frequency": 1800.0, "mode2_damping": 0.02, "mode2_gain": -0.03}),
    (
        "velocity-pickup+highpass+mode2",
        GEOPHONE | {"highpass_frequency": 0.1, "mode2_frequency": 140.0, "mode2_damping": 0.01, "mode2_gain": 0.01},
    ),
    ("accelerometer+mounting", PAPER | {"mounting_frequency": 900.0, "mounting_damping": 0.03}),
    (
        "velocity-pickup+mounting:0.3+highpass",
        GEOPHONE | {"mounting_frequency": 30.0, "mounting_damping": 0.1, "highpass_frequency": 0.1},
    ),
]
#: Not a rational function: no realisation.
BOXCAR = ("accelerometer+boxcar+delay", PAPER | {"boxcar_length": 2.0165e-3, "delay": 5e-4})
QUANTITIES = ["acceleration", "velocity", "displacement", "drive"]


def accelerometer_formula(p, frequency):
    """Magnitude S0/√((1 − r²)² + (2 δ r)²) and phase −atan2(2 δ r, 1 − r²), r = f/fn, as in any textbook."""
    r = frequency / p["natural_frequency"]
    magnitude = p["sensitivity"] / np.hypot(1 - r**2, 2 * p["damping_ratio"] * r)
    return magnitude * np.exp(-1j * np.arctan2(2 * p["damping_ratio"] * r, 1 - r**2))


@pytest.mark.parametrize("damping", [0.0, 0.005, 0.182, 0.7, 1.0, 2.0])
@pytest.mark.parametrize("gain", [0.104, -0.104])
def test_accelerometer_against_the_textbook(damping, gain):
    p = {"sensitivity": gain, "natural_frequency": 652.0, "damping_ratio": damping}
    frequency = np.geomspace(0.65, 65000.0, 200)
    found = parse("accelerometer").frequency_response(p, frequency)
    np.testing.assert_allclose(found, accelerometer_formula(p, frequency), rtol=1e-12)


@pytest.mark.parametrize("damping", [0.02, 0.56, 1.5])
def test_velocity_pickup_against_the_textbook(damping):
    """V/v = G s²/(…) is G r²/√((1 − r²)² + (2 δ r)²), leading by π − atan2(2 δ r, 1 − r²); a = jω v."""
    p = GEOPHONE | {"damping_ratio": damping}
    model = parse("velocity-pickup")
    frequency = np.geomspace(0.045, 450.0, 200)
    r = frequency / 4.5
    per_velocity = 28.8 * r**2 / np.hypot(1 - r**2, 2 * damping * r)
    per_velocity = per_velocity * np.exp(1j * (np.pi - np.arctan2(2 * damping * r, 1 - r**2)))
    omega = 2j * np.pi * frequency
    np.testing.assert_allclose(model.frequency_response(p, frequency, "velocity"), per_velocity, rtol=1e-12)
    np.testing.assert_allclose(model.frequency_response(p, frequency), per_velocity / omega, rtol=1e-12)
    np.testing.assert_allclose(model.frequency_response(p, frequency, "displacement"), per_velocity * omega, rtol=1e-12)


@pytest.mark.parametrize("frequency", [100.0, 630.0, 2000.0])
def test_accelerometer_against_the_equation_of_motion(frequency):
    """V̈ + 2 δ ωn V̇ + ωn² V = K a, integrated from the steady state that the response says, stays on it (eq. 2)."""
    omega, wn = 2 * np.pi * frequency, 2 * np.pi * PAPER["natural_frequency"]
    k, delta = PAPER["sensitivity"] * wn**2, PAPER["damping_ratio"]
    response = complex(parse("accelerometer").frequency_response(PAPER, np.array([frequency]))[0])

    def slope(t, x):
        return [x[1], k * np.cos(omega * t) - 2 * delta * wn * x[1] - wn**2 * x[0]]

    times = np.linspace(0.0, 3 / frequency, 50)
    begin = [response.real, (1j * omega * response).real]
    motion = solve_ivp(slope, (0, times[-1]), begin, "DOP853", times, rtol=1e-11, atol=1e-14 * abs(response))
    np.testing.assert_allclose(motion.y[0], (response * np.exp(1j * omega * times)).real, atol=2e-9 * abs(response))


def test_velocity_pickup_against_the_equation_of_motion():
    """ẍ + 2 δ ωn ẋ + ωn² x = a with V = G ẋ, started from rest, after the transient has died out."""
    frequency = 3.0
    omega, wn, delta = 2 * np.pi * frequency, 2 * np.pi * 4.5, 0.56
    times = np.linspace(4.0, 5.0, 60)  # e^{−0.56 · 28.3 · 4} = 3e−28

    def slope(t, x):
        return [x[1], np.cos(omega * t) - 2 * delta * wn * x[1] - wn**2 * x[0]]

    motion = solve_ivp(slope, (0, 5.0), [0.0, 0.0], "DOP853", times, rtol=1e-11, atol=1e-15)
    response = complex(parse("velocity-pickup").frequency_response(GEOPHONE, np.array([frequency]))[0])
    np.testing.assert_allclose(
        28.8 * motion.y[1], (response * np.exp(1j * omega * times)).real, atol=1e-8 * abs(response)
    )


def test_sensitivity_is_the_gain_at_low_frequency_and_the_generator_constant_at_high():
    low = parse("accelerometer").frequency_response(PAPER, np.array([1e-3]))
    assert abs(low[0] - PAPER["sensitivity"]) < 1e-6 * PAPER["sensitivity"]
    high = parse("velocity-pickup").frequency_response(GEOPHONE, np.array([4.5e6]), "velocity")
    assert abs(high[0] - 28.8) < 3e-6 * 28.8


def test_a_delay_lags():
    """The response channel comes τ later: e^{−jωτ}, phase falling with frequency; a negative delay leads."""
    frequency = np.array([10.0, 100.0])
    plain = parse("accelerometer").frequency_response(PAPER, frequency)
    late = parse("accelerometer+delay").frequency_response(PAPER | {"delay": 1e-3}, frequency)
    np.testing.assert_allclose(np.rad2deg(np.angle(late / plain)), [-3.6, -36.0], rtol=1e-12)
    early = parse("accelerometer+delay").frequency_response(PAPER | {"delay": -1e-3}, frequency)
    np.testing.assert_allclose(np.rad2deg(np.angle(early / plain)), [3.6, 36.0], rtol=1e-12)
    assert np.angle(parse("accelerometer").frequency_response(PAPER, np.array([652.0])))[0] == pytest.approx(-np.pi / 2)


def test_a_high_pass_is_a_first_order_corner():
    """s/(s + 2π fh): 1/√2 and +45° at the corner, one far above."""
    frequency = np.array([0.05, 0.5, 5e5])
    plain = parse("accelerometer").frequency_response(PAPER, frequency)
    passed = parse("accelerometer+highpass").frequency_response(PAPER | {"highpass_frequency": 0.5}, frequency) / plain
    np.testing.assert_allclose(passed, 1 / (1 - 0.5j / frequency), rtol=1e-12)
    assert np.rad2deg(np.angle(passed[1])) == pytest.approx(45.0, rel=1e-12)


def test_a_second_mode_stands_beside_the_first():
    """S0 (H1 + g₂ H2), each by the textbook's formula."""
    p = PAPER | {"mode2_frequency": 1800.0, "mode2_damping": 0.02, "mode2_gain": -0.03}
    frequency = np.geomspace(1.0, 1e4, 100)
    second = {"sensitivity": -0.03, "natural_frequency": 1800.0, "damping_ratio": 0.02}
    expected = PAPER["sensitivity"] * (
        accelerometer_formula(PAPER | {"sensitivity": 1.0}, frequency) + accelerometer_formula(second, frequency)
    )
    np.testing.assert_allclose(parse("accelerometer+mode2").frequency_response(p, frequency), expected, rtol=1e-11)


def test_a_boxcar_is_the_mean_over_a_window():
    """(1/L) ∫₀ᴸ e^{−jωt} dt by quadrature: zero at 1/L, half the window's length late."""
    model = parse("accelerometer+boxcar")
    frequency = np.array([1.0, 130.0, 499.0, 500.0, 777.0])
    t = (np.arange(100000) + 0.5) / 100000 * 2e-3
    mean = np.array([np.mean(np.exp(-2j * np.pi * f * t)) for f in frequency])
    plain = parse("accelerometer").frequency_response(PAPER, frequency)
    found = model.frequency_response(PAPER | {"boxcar_length": 2e-3}, frequency) / plain
    np.testing.assert_allclose(found, mean, atol=1e-8)
    assert not model.has_network
    assert all(parse(name).has_network for name, _ in CASES)


def test_polarity_turns_the_phase_by_half_a_turn():
    frequency = np.geomspace(1, 1e4, 30)
    model = parse("accelerometer")
    inverted = model.frequency_response(PAPER | {"sensitivity": -0.104}, frequency)
    np.testing.assert_allclose(inverted, -model.frequency_response(PAPER, frequency), rtol=1e-15)


@pytest.mark.parametrize(
    ("name", "p", "quantity"),
    [*((*case, "velocity") for case in (*CASES, BOXCAR)), *((*CASES[0], quantity) for quantity in QUANTITIES)],
)
def test_numpy_and_jax_give_the_same(name, p, quantity):
    model, frequency = parse(name), np.geomspace(0.003, 1e5, 40)
    plain = model.frequency_response(p, frequency, quantity)
    traced = jax.jit(lambda v, f: model.frequency_response(v, f, quantity))(p, jnp.asarray(frequency))
    assert isinstance(plain, np.ndarray)
    np.testing.assert_allclose(np.asarray(traced), plain, rtol=1e-12)


@pytest.mark.parametrize(("name", "p"), CASES)
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_state_space_is_the_rational_function(name, p, quantity):
    """C (sI − A)⁻¹ B + Σ D_m sᵐ against gain N(s)/D(s), on the imaginary axis and all over the plane."""
    model = parse(name)
    wn = 2 * np.pi * p["natural_frequency"]
    rational = model.rational(p, quantity)
    system = realise(rational)
    assert system.order == 2 + name.count("highpass") + 2 * name.count("mode2") + 2 * name.count("mounting")
    a, b, c = (np.asarray(m) for m in (system.a, system.b, system.c))
    s = wn * np.concatenate([1j * np.geomspace(1e-2, 1e2, 31), np.array([0.3 + 0.2j, -3 - 1j, 5.0, -0.01 + 2j])])
    if p["damping_ratio"] == 0:
        s = s[np.abs(s - 1j * wn) > 1e-3 * wn]
    states = np.stack([np.linalg.solve(value * np.eye(system.order) - a, b.astype(complex)) for value in s])
    parts = np.stack([states @ c, *(float(d) * s**m for m, d in enumerate(system.d))])
    ascending = np.polynomial.polynomial
    expected = rational.gain * ascending.polyval(s, rational.numerator) / ascending.polyval(s, rational.denominator)
    # Where direct parts all but cancel the rest, rounding is that of the largest of them.
    error = np.abs(parts.sum(axis=0) - expected)
    assert np.max(error / np.abs(parts).max(axis=0)) < 2e-13
    assert system.d or np.max(error / np.abs(expected)) < 2e-13


def test_improper_part_appears_for_a_velocity_pickup_on_displacement():
    """G s³/(s² + 2 δ ωn s + ωn²) = G s − 2 δ ωn G + …: the response holds the derivative of the input."""
    counts = {q: len(realise(parse("velocity-pickup").rational(GEOPHONE, q)).d) for q in QUANTITIES}
    assert counts == {"acceleration": 0, "velocity": 1, "displacement": 2, "drive": 0}
    d = realise(parse("velocity-pickup").rational(GEOPHONE, "displacement")).d
    assert float(d[1]) == pytest.approx(28.8, rel=1e-14)
    assert float(d[0]) == pytest.approx(-2 * 0.56 * 2 * np.pi * 4.5 * 28.8, rel=1e-14)
    assert {q: len(realise(parse("accelerometer").rational(PAPER, q)).d) for q in QUANTITIES} == {
        "acceleration": 0,
        "velocity": 0,
        "displacement": 1,
        "drive": 0,
    }


def test_scaled_states_give_back_the_papers():
    """t A t⁻¹, t B, C t⁻¹ with the state scaling is eq. (4): [[0, 1], [−ωn², −2 δ ωn]], [0, K], [1, 0]."""
    system = realise(parse("accelerometer").rational(PAPER))
    t = np.asarray(state_scaling(system))
    wn, delta = 2 * np.pi * 652.0, 0.182
    np.testing.assert_allclose(
        np.asarray(system.a) * t[:, None] / t, [[0, 1], [-(wn**2), -2 * delta * wn]], rtol=1e-14, atol=1e-9
    )
    np.testing.assert_allclose(np.asarray(system.b) * t, [0, 0.104 * wn**2], rtol=1e-14)
    np.testing.assert_allclose(np.asarray(system.c) / t, [1, 0], rtol=1e-14, atol=0)


@given(st.floats(1e-3, 0.7), st.floats(0.1, 1e5), st.floats(1e-6, 1e3))
def test_derived_quantities_follow_equation_3(damping, natural, gain):
    p = {"sensitivity": gain, "natural_frequency": natural, "damping_ratio": damping}
    model = parse("accelerometer")
    derived = {d.name: d.value(p) for d in model.derived(p)}
    wr = 2 * np.pi * derived["resonance_frequency"]
    assert wr / np.sqrt(1 - 2 * damping**2) == pytest.approx(2 * np.pi * natural, rel=1e-11)
    assert derived["natural_angular_frequency"] == pytest.approx(2 * np.pi * natural, rel=1e-15)
    assert derived["conversion_coefficient"] == pytest.approx(gain * (2 * np.pi * natural) ** 2, rel=1e-14)
    # The resonance is where |V/a| is largest: no frequency a part in a thousand away is larger.
    f0 = derived["resonance_frequency"]
    size = np.abs(model.frequency_response(p, np.array([f0, f0 * 0.999, f0 * 1.001])))
    assert size[0] >= size[1] * (1 - 1e-15)
    assert size[0] >= size[2] * (1 - 1e-15)


@pytest.mark.parametrize(
    ("damping", "exists"), [(0.0, True), (0.707, True), (2**-0.5, False), (0.7072, False), (3, False)]
)
@pytest.mark.parametrize("name", ["accelerometer", "velocity-pickup"])
def test_no_resonance_from_one_over_root_two_on(name, damping, exists):
    p = (PAPER if name == "accelerometer" else GEOPHONE) | {"damping_ratio": float(damping)}
    assert ("resonance_frequency" in {d.name for d in parse(name).derived(p)}) is exists


def test_velocity_pickups_resonance_is_the_peak_per_velocity():
    p = GEOPHONE | {"damping_ratio": 0.3}
    derived = {d.name: d.value(p) for d in parse("velocity-pickup").derived(p)}
    frequency = np.linspace(3, 8, 50001)
    size = np.abs(parse("velocity-pickup").frequency_response(p, frequency, "velocity"))
    assert derived["resonance_frequency"] == pytest.approx(frequency[np.argmax(size)], abs=2e-4)


def test_names_units_and_order_of_parameters():
    model = parse(" accelerometer + delay ")
    assert model.name == "accelerometer+delay"
    assert model.parameter_names == ("sensitivity", "natural_frequency", "damping_ratio", "delay")
    assert (model.gain_name, parse("velocity-pickup").gain_name) == ("sensitivity", "generator_constant")
    assert model.has_delay
    assert not parse("accelerometer").has_delay
    assert [spec.kind for spec in model.parameters] == ["gain", "log", "positive", "time"]


@pytest.mark.parametrize(
    ("name", "says", "remedy"),
    [
        ("acelerometer", "sensor model 'acelerometer'", "did you mean 'accelerometer'?"),
        ("velocity_pickup", "sensor model", "did you mean 'velocity-pickup'?"),
        ("", "sensor model ''", "choose one of the expected"),
        ("delay", "sensor model 'delay'", "choose one of the expected"),
        ("accelerometer+dealy", "add-on 'dealy'", "did you mean 'delay'?"),
        ("accelerometer+", "add-on ''", "choose one of the expected"),
        ("accelerometer+delay+delay", "named twice", "leave one 'delay' out"),
        ("accelerometer+velocity-pickup", "add-on", "choose one of the expected"),
    ],
)
def test_refused_names_say_what_and_what_instead(name, says, remedy):
    with pytest.raises(ModelError) as caught:
        parse(name)
    assert says in str(caught.value)
    assert remedy in caught.value.remedy
    assert caught.value.where == "model"
    assert caught.value.expected


@pytest.mark.parametrize("quantity", ["acceleration", "displacement"])
@pytest.mark.parametrize(("name", "values"), [*CASES, BOXCAR])
def test_slopes_are_those_of_the_response(name, values, quantity):
    """∂H/∂θ of every parameter against central differences, and H itself against ``frequency_response``."""
    model, frequency = parse(name), np.geomspace(0.3, 30.0, 40) * values["natural_frequency"]
    response, slopes = response_and_slopes(model, values, frequency, quantity)
    np.testing.assert_allclose(response, model.frequency_response(values, frequency, quantity), rtol=1e-13)
    for row, parameter in zip(slopes, model.parameter_names, strict=True):
        step = 1e-6 * (abs(values[parameter]) or 1.0)
        sides = [
            model.frequency_response(values | {parameter: values[parameter] + sign * step}, frequency, quantity)
            for sign in (1.0, -1.0)
        ]
        difference = (sides[0] - sides[1]) / (2.0 * step)
        np.testing.assert_allclose(row, difference, rtol=2e-7, atol=1e-9 * np.abs(response).max() / step * 1e-6)
