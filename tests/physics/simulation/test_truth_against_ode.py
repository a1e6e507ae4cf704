"""The exact response against a general ODE solver, against closed forms and against the frequency response."""

import functools
import itertools
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vibrident.base.errors import InputError
from vibrident.physics.models import parse
from vibrident.physics.simulation import (
    BandLimitedRandom,
    Decay,
    HalfSineShock,
    Multisine,
    Sine,
    Superposition,
    Sweep,
    exact_reference,
    exact_response,
    excitation_noise,
)

RATE, SAMPLES = 16000.0, 320
ACCELEROMETER = {"sensitivity": 0.104, "natural_frequency": 652.0, "damping_ratio": 0.182}
PICKUP = {"generator_constant": -28.8, "natural_frequency": 120.0, "damping_ratio": 0.7}
FELT = excitation_noise(0.7, sampling_rate_hz=RATE, samples=SAMPLES, rng=np.random.default_rng(5))
MOTIONS = {
    "sine": Sine(1000.0, 9.8, 0.4),
    "multisine": Multisine((10.0, 333.3, 2500.0), (1.0, 2.0, 3.0), (0.1, 0.2, 0.3)),
    "random": BandLimitedRandom(50.0, 2000.0, 4.0, 11, 0.05),
    "shock": HalfSineShock(50.0, 1.777e-3, 1.234e-3),
    "shock at once": HalfSineShock(50.0, 1.777e-3, 0.0),
    "linear sweep": Sweep(100.0, 3000.0, 0.0171, 5.0),
    "log sweep": Sweep(2000.0, 50.0, 0.02, 5.0, "log", 0.1),
    "untapered sweep": Sweep(100.0, 3000.0, 0.0171, 5.0, taper=0.0),
    "sine with felt noise": Superposition((Sine(400.0, 9.8, -np.pi / 2), FELT)),
}
TONAL = ("sine", "multisine", "random", "sine with felt noise")


def ode_responses(sensors, motion, times, known=0.0):
    """Sensors by their equation of motion, ẍ + 2 δ ωn ẋ + ωn² x = a, at rest at a time, restarted at breaks.

    All in one integration: what it costs is the motion, which they share. ``times`` are of each sensor, or of all.
    """
    count, times = len(sensors), np.broadcast_to(times, (len(sensors), np.shape(times)[-1]))
    wn = 2 * np.pi * np.array([p["natural_frequency"] for p in sensors])
    damping = np.array([p["damping_ratio"] for p in sensors])
    stiffness, resistance = wn * wn, 2 * damping * wn

    def slope(t, state):
        a = motion.value(np.array([t]))[0]
        return np.concatenate((state[count:], a - resistance * state[count:] - stiffness * state[:count]))

    # Between its steps the solver interpolates, to a lower order: they are short beside the fastest time constant.
    fastest = float(np.max(np.where(damping > 1.0, wn * (damping + np.sqrt(np.maximum(damping**2 - 1.0, 0.0))), 0.0)))
    begin, x, end = known, np.zeros(2 * count), np.max(times)
    edges = [begin, *(b for b in motion.breaks_s if begin < b < end), end]
    out = np.zeros((count, 2, times.shape[1]))
    for left, right in itertools.pairwise(edges):
        inner = 1e-16  # an edge's value belongs to either side: keep the solver between them
        solution = solve_ivp(
            slope,
            (left + inner, right - inner),
            x,
            "DOP853",
            rtol=3e-13,
            atol=1e-20,
            dense_output=True,
            max_step=1.0 / (3e3 + fastest),
        )
        for place, own in enumerate(times):
            inside = (own >= left) & (own <= right)
            found = solution.sol(np.clip(own[inside], left + inner, right - inner))
            out[place][:, inside] = found[[place, count + place]]
        x = solution.y[:, -1]
    return [
        p["sensitivity"] * w * w * moved[0] if "sensitivity" in p else p["generator_constant"] * moved[1]
        for p, w, moved in zip(sensors, wn, out, strict=True)
    ]


def ode_response(p, motion, times, known=0.0):
    return ode_responses([p], motion, times, known)[0]


def relative(found, expected):
    return np.max(np.abs(found - expected)) / np.max(np.abs(expected))


def exact(model, p, motion, start="rest", samples=SAMPLES, rate=RATE):
    return exact_response(parse(model), p, motion, sampling_rate_hz=rate, samples=samples, start=start)


#: Dampings of an accelerometer that each motion is tried with beside the usual one, and its delay.
DAMPINGS = {"sine": (0.0, 1.0 - 1e-9), "shock": (1e-4, 1.0), "linear sweep": (0.7, 1.0 + 1e-9)}
DELAYS = dict(zip(MOTIONS, 3 * (3.7 / RATE, 0.3 / RATE, -2.2 / RATE), strict=True))


@functools.cache
def from_rest(name):
    """Of each model and its parameters the ODE's response to a motion; zero before the start."""
    sensors = [("accelerometer", ACCELEROMETER), ("velocity-pickup", PICKUP)]
    sensors += [("accelerometer", ACCELEROMETER | {"damping_ratio": damping}) for damping in DAMPINGS.get(name, ())]
    sensors += [("accelerometer+delay", ACCELEROMETER | {"delay": DELAYS[name]})]
    times = np.array([np.arange(SAMPLES) / RATE - p.get("delay", 0.0) for _, p in sensors])
    found = ode_responses([p for _, p in sensors], MOTIONS[name], np.maximum(times, 0.0))
    return [(model, p, np.where(t > 0, y, 0.0)) for (model, p), t, y in zip(sensors, times, found, strict=True)]


@pytest.mark.parametrize("name", MOTIONS)
def test_from_rest_is_what_an_ode_solver_gives(name):
    for model, p, expected in from_rest(name)[:2]:
        assert relative(exact(model, p, MOTIONS[name]), expected) < 2e-11, model


@pytest.mark.parametrize("name", DAMPINGS)
def test_any_damping(name):
    for model, p, expected in from_rest(name)[2:-1]:
        assert relative(exact(model, p, MOTIONS[name]), expected) < 2e-11, p


@pytest.mark.parametrize("name", ["sine", "shock"])
@pytest.mark.quick("shock")
def test_heavy_damping(name):
    p = ACCELEROMETER | {"damping_ratio": 5.0}
    expected = ode_response(p, MOTIONS[name], np.arange(SAMPLES) / RATE)
    assert relative(exact("accelerometer", p, MOTIONS[name]), expected) < 2e-11


@pytest.mark.parametrize("name", MOTIONS)
def test_a_delayed_response_is_the_response_of_earlier(name):
    """The ODE solution at t − τ, zero before the start."""
    model, p, expected = from_rest(name)[-1]
    assert relative(exact(model, p, MOTIONS[name]), expected) < 2e-11


@pytest.mark.parametrize(("model", "p"), [("accelerometer", ACCELEROMETER), ("velocity-pickup", PICKUP)])
def test_steady_tones_have_the_frequency_response(model, p):
    """Fitted amplitude and phase of each tone are the model's, delay included."""
    motion, p, m = MOTIONS["multisine"], p | {"delay": 3.3e-5}, parse(f"{model}+delay")
    y = exact_response(m, p, motion, sampling_rate_hz=RATE, samples=16000, start="steady")
    f = np.array(motion.frequencies_hz)
    basis = np.exp(2j * np.pi * np.outer(np.arange(16000) / RATE, f))
    coefficients = np.linalg.lstsq(np.hstack([basis.real, -basis.imag]), y, rcond=None)[0]
    found = (coefficients[:3] + 1j * coefficients[3:]) / motion.tones.phasor
    np.testing.assert_allclose(found, m.frequency_response(p, f), rtol=1e-11)


@pytest.mark.parametrize(("name", "start"), [*((m, "rest") for m in MOTIONS), *((m, "steady") for m in TONAL)])
@pytest.mark.quick("shock-rest", "multisine-steady", "sine with felt noise-steady")
def test_a_boxcar_averages_the_response_over_its_window(name, start):
    """∫ V(t − u) du / L by 200 Gauss–Legendre nodes: V at each node is that of a sensor with a delay u."""
    length = 7.3 / RATE
    found = exact("accelerometer+boxcar", ACCELEROMETER | {"boxcar_length": length}, MOTIONS[name], start)
    nodes, weights = np.polynomial.legendre.leggauss(200)
    expected = np.zeros(SAMPLES)
    for node, weight in zip(nodes, weights, strict=True):
        late = ACCELEROMETER | {"delay": 0.5 * length * (1.0 + node)}
        expected += 0.5 * weight * exact("accelerometer+delay", late, MOTIONS[name], start)
    # At the corners of a motion V has a jump in its second derivative or higher, which costs the quadrature digits.
    assert relative(found, expected) < (1e-11 if start == "steady" else 1e-7)


def test_a_boxcar_cannot_be_simulated_with_a_decay():
    with pytest.raises(InputError, match="boxcar"):
        exact("accelerometer+boxcar", ACCELEROMETER | {"boxcar_length": 1e-3}, Decay(9.8))


@pytest.mark.parametrize("name", TONAL)
def test_steady_is_an_ode_solution_from_its_own_start(name):
    """The ODE started long before, from rest, has forgotten its start by t = 0."""
    p = ACCELEROMETER | {"damping_ratio": 0.7}
    times = np.arange(60) / RATE
    expected = ode_response(p, MOTIONS[name], times, -0.012)  # e^{−δ ωn t} = 1e-15
    assert relative(exact("accelerometer", p, MOTIONS[name], "steady", 60), expected) < 2e-11


@pytest.mark.parametrize("damping", [0.0, 0.02, 0.7, 1.0, 3.0, 100.0])
def test_free_decay_closed_form(damping):
    """Release from V0 = S0 a0 at rest: the textbook formulas, over 16 000 samples."""
    p = ACCELEROMETER | {"damping_ratio": damping}
    t = np.arange(16000) / RATE
    wn = 2 * np.pi * p["natural_frequency"]
    if damping < 1:
        wd = wn * np.sqrt(1 - damping**2)
        shape = np.exp(-damping * wn * t) * (np.cos(wd * t) + damping * wn / wd * np.sin(wd * t))
    elif damping == 1:
        shape = np.exp(-wn * t) * (1 + wn * t)
    else:
        fast = wn * (damping + np.sqrt(damping**2 - 1))
        slow = wn * wn / fast
        shape = (fast * np.exp(-slow * t) - slow * np.exp(-fast * t)) / (fast - slow)
    y = exact("accelerometer", p, Decay(2.0), samples=16000)
    assert np.max(np.abs(y - p["sensitivity"] * 2.0 * shape)) < 1e-11 * abs(p["sensitivity"] * 2.0)


def test_a_geophone_released_starts_from_zero_volts():
    """V = G ẋ with x(0) = a0/ωn²: V(0) = 0 and dV/dt(0) = −G a0."""
    y = exact("velocity-pickup", PICKUP, Decay(2.0), samples=8, rate=1e7)
    assert y[0] == pytest.approx(0.0, abs=1e-12)
    assert (y[1] - y[0]) * 1e7 == pytest.approx(-PICKUP["generator_constant"] * 2.0, rel=1e-3)


def test_a_late_decay_is_held_until_it_is_released():
    y = exact("accelerometer+delay", ACCELEROMETER | {"delay": 5.5 / RATE}, Decay(2.0))
    np.testing.assert_allclose(y[:6], 0.208, rtol=1e-12)
    assert y[6] < 0.208


@dataclass(frozen=True)
class Plain:
    """A motion that says nothing of itself but values and breaks: everything goes by quadrature."""

    of: object
    kind: str = "shock"
    words: str = "plain"
    highest_hz: float = 0.0

    @property
    def breaks_s(self):
        return self.of.breaks_s

    def value(self, time_s):
        return np.where(time_s < 0, 0.0, self.of.value(time_s))


@pytest.mark.parametrize("name", ["sine", "multisine", "shock", "shock at once", "sine with felt noise"])
@pytest.mark.parametrize(("model", "p"), [("accelerometer", ACCELEROMETER), ("velocity-pickup", PICKUP)])
def test_closed_forms_equal_the_quadrature(name, model, p):
    """Two independent ways to one response, to 1e-12; delay and early samples included."""
    p = p | {"delay": 2.6 / RATE}
    motion = MOTIONS[name]
    found = exact(f"{model}+delay", p, motion)
    assert relative(found, exact(f"{model}+delay", p, Plain(motion))) < 1e-12


def test_a_stiff_sensor_sampled_slowly():
    """30 kHz sensor at 2.56 kHz: 74 rad a step, and still the ODE's solution."""
    p = {"sensitivity": 1e-3, "natural_frequency": 30e3, "damping_ratio": 0.02}
    motion = Sweep(100.0, 1000.0, 0.004, 5.0)
    times = np.arange(5) / 2560.0
    found = exact("accelerometer", p, motion, samples=5, rate=2560.0)
    assert relative(found, ode_response(p, motion, times)) < 1e-8


# Reference quantities ------------------------------------------------------------------------------------------------

#: Eighth-order central differences (Fornberg 1988).
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])
QUIET = excitation_noise(0.7, sampling_rate_hz=RATE, samples=4000, rng=np.random.default_rng(6), band_hz=(5.0, 300.0))
SMOOTH = {
    "sine": Sine(160.0, 9.8, 0.3),
    "random": BandLimitedRandom(10.0, 300.0, 2.0, 4, 0.3),
    "sine with felt noise": Superposition((Sine(160.0, 9.8, -1.0), QUIET)),
    "sweep": Sweep(20.0, 300.0, 0.25, 5.0, taper=0.4),
}


@pytest.mark.parametrize("name", SMOOTH)
@pytest.mark.parametrize(("quantity", "stencil", "order"), [("velocity", FIRST, 1), ("displacement", SECOND, 2)])
def test_reference_differentiates_back_to_acceleration(name, quantity, stencil, order):
    motion = SMOOTH[name]
    x = exact_reference(motion, quantity, sampling_rate_hz=RATE, samples=4000)
    a = exact_reference(motion, "acceleration", sampling_rate_hz=RATE, samples=4000)[4:-4]
    derivative = np.convolve(x, stencil[::-1], "valid") * RATE**order
    smooth = np.ones(a.size, dtype=bool)
    for instant in motion.breaks_s:  # the sweep's third derivative jumps there
        smooth &= np.abs(np.arange(4, 3996) / RATE - instant) > 5 / RATE
    assert relative(derivative[smooth], a[smooth]) < 1e-8


def test_shock_velocity_and_displacement_closed_form():
    """v = (peak T/π)(1 − cos(π τ/T)), x its integral; after the pulse v = 2 peak T/π and x grows linearly."""
    shock = HalfSineShock(500.0, 2e-3, 1.05e-3)
    t = np.arange(200) / RATE
    tau = np.clip(t - 1.05e-3, 0, 2e-3)
    after = np.clip(t - 3.05e-3, 0, None)
    c = 500.0 * 2e-3 / np.pi
    v = c * (1 - np.cos(np.pi * tau / 2e-3))
    x = c * (tau - 2e-3 / np.pi * np.sin(np.pi * tau / 2e-3)) + 2 * c * after
    for quantity, expected in (("velocity", v), ("displacement", x)):
        found = exact_reference(shock, quantity, sampling_rate_hz=RATE, samples=200)
        assert relative(found, expected) < 1e-12


def test_drive_is_the_acceleration_and_a_decay_shows_nothing():
    sine = MOTIONS["sine"]
    drive, acceleration = (
        exact_reference(sine, q, sampling_rate_hz=RATE, samples=50) for q in ("drive", "acceleration")
    )
    np.testing.assert_array_equal(drive, acceleration)
    assert not np.any(exact_reference(Decay(1.0), "velocity", sampling_rate_hz=RATE, samples=50))


def test_a_velocity_reference_through_the_model_is_the_response():
    """Response = H_v · v for tones: what the estimators will assume of a velocity reference."""
    motion, m = replace(MOTIONS["sine"], frequency_hz=200.0), parse("velocity-pickup")
    v = exact_reference(motion, "velocity", sampling_rate_hz=RATE, samples=800)
    y = exact_response(m, PICKUP, motion, sampling_rate_hz=RATE, samples=800, start="steady")
    lines = np.fft.rfft([v, y])[:, 10]  # 10 whole periods
    assert lines[1] / lines[0] == pytest.approx(m.frequency_response(PICKUP, 200.0 + 0j, "velocity"), rel=1e-11)
