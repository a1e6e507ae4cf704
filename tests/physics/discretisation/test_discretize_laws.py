"""Each discretisation against its laws: order of convergence, exactness, invariance, the paper's equation."""

import numpy as np
import pytest
from numpy.polynomial import legendre
from scipy.linalg import expm as scipy_expm
from scipy.special import spherical_in, spherical_jn
from tests.support.discrete_sensors import PAPER, accelerometer, matrices, recursion, system_of, tone_state, weights_of

from vibrident.base.backend import jax, jnp
from vibrident.base.errors import ModelError
from vibrident.physics.discretisation import METHODS, Weights, method
from vibrident.physics.discretisation.inputs import MAX_TERMS, SERIES_TOLERANCE, USABLE_BAND, terms_needed
from vibrident.physics.discretisation.weights import expm
from vibrident.physics.models import parse
from vibrident.physics.models.state_space import realise, state_scaling


def smooth_error(name, rate, frequency, p, fraction):
    """Largest error over 5 ms of a tone, begun in its exact state, read out at ``fraction`` of the step."""
    chosen = method(name)
    system = system_of(p)
    n = round(5e-3 * rate) + 1
    times = np.arange(n) / rate
    terms = chosen.terms(0.0) if chosen.fixed_terms else 12
    samples = np.cos(2 * np.pi * frequency * times)
    step = chosen.inputs(samples, np.ones(n, dtype=bool), terms)
    weights = weights_of(name, p, 1 / rate, fraction, terms)
    found = recursion(weights, step.coefficients[:-1], tone_state(system, frequency, 0.0))
    h = complex(parse("accelerometer").frequency_response(p, np.array([frequency]))[0])
    exact = np.real(h * np.exp(2j * np.pi * frequency * (times[:-1] + fraction / rate)))
    return np.max(np.abs(found - exact)) / abs(h)


@pytest.mark.parametrize(("name", "order"), [("euler", 1), ("zoh", 1), ("foh", 2), ("tustin", 2)])
@pytest.mark.parametrize("fraction", [0.0, 0.37, 1.0])
@pytest.mark.parametrize(("frequency", "p"), [(300.0, PAPER), (800.0, accelerometer(400.0, 0.9, -2.0))])
def test_order_of_convergence(name, order, fraction, frequency, p):
    """Error against step is a straight line of the stated slope in the logarithms (within 0.06 of it)."""
    assert METHODS[name].order == order
    rates = 51200.0 * 2.0 ** np.arange(1, 4)
    errors = [smooth_error(name, rate, frequency, p, fraction) for rate in rates]
    slope = -np.polyfit(np.log(rates), np.log(errors), 1)[0]
    assert slope == pytest.approx(order, abs=0.06), errors


def test_euler_is_unstable_where_the_paper_does_not_say():
    """Forward Euler needs Ts < 2 δ/ωn: 11.3 kHz for the Table 2 sensor."""
    p = accelerometer(4096.4 / 2 / np.pi, 0.182)
    for rate, stable in ((11.2e3, False), (11.3e3, True)):
        transition = np.asarray(method("euler").weights(system_of(p), 1 / rate, 0.0, 1).transition)
        assert bool(np.max(np.abs(np.linalg.eigvals(transition))) < 1) is stable


@pytest.mark.parametrize("p", [PAPER, accelerometer(652.0, 2.0), accelerometer(30e3, 0.02), accelerometer(5.0, 0.7)])
@pytest.mark.parametrize("rate", [2560.0, 51200.0])
def test_zoh_is_exact_for_held_and_foh_for_straight_lines(p, rate, rng):
    """Against ∫ e^{A(Ts − t)} B (a_k + (a_{k+1} − a_k) t/Ts) dt, by quadrature of SciPy's exponential."""
    a, b, c = matrices(p)
    n, ts = 400, 1 / rate
    samples = rng.standard_normal(n)
    whole = scipy_expm(a * ts)
    x, w = legendre.leggauss(60)
    kernel = np.stack([scipy_expm(a * ts * 0.5 * (1 - node)) @ b for node in x])
    held = 0.5 * ts * w @ kernel
    ramp = 0.5 * ts * (w * 0.5 * (1 + x)) @ kernel
    for name in ("zoh", "foh"):
        state, expected = np.zeros(2), np.empty(n - 1)
        for k in range(n - 1):
            expected[k] = c @ state
            state = whole @ state + held * samples[k]
            if name == "foh":
                state = state + ramp * (samples[k + 1] - samples[k])
        chosen = method(name)
        terms = chosen.terms(0.0)
        coefficients = chosen.inputs(samples, np.ones(n, dtype=bool), terms).coefficients[:-1]
        found = recursion(weights_of(name, p, ts, 0.0, terms), coefficients, np.zeros(2))
        assert np.max(np.abs(found - expected)) < 1e-12 * np.max(np.abs(expected))


def test_tustin_is_scipys_bilinear_transform(rng):
    """Same output as SciPy's ``bilinear``, though the state of the trapezoidal rule differs."""
    from scipy.signal import bilinear, lfilter

    wn = 2 * np.pi * 652.0
    rate, n = 8000.0, 500
    b, a = bilinear([0.104 * wn**2], [1, 2 * 0.182 * wn, wn**2], fs=rate)
    samples = np.concatenate([np.zeros(3), rng.standard_normal(n)])
    expected = lfilter(b, a, samples)
    chosen = method("tustin")
    coefficients = chosen.inputs(samples, np.ones(n + 3, dtype=bool), 2).coefficients
    found = recursion(weights_of("tustin", PAPER, 1 / rate, 0.0, 2), coefficients, np.zeros(2))
    np.testing.assert_allclose(found[:-1], expected[:-1], atol=1e-12 * np.max(np.abs(expected)))


@pytest.mark.parametrize("rate", [16000.0, 51200.0, 1e6])
def test_euler_reproduces_equation_7_element_by_element(rate):
    """Ad, Bd, Cd, Dd of the paper in its states V, V̇: W3, W1, W2, W4 of Table 1."""
    system = system_of(PAPER)
    scaled = method("euler").weights(system, 1 / rate, 0.0, 1)
    t = np.asarray(state_scaling(system))
    table = Weights(
        scaled.transition * t[:, None] / t, scaled.drive * t[:, None], scaled.output / t, scaled.feedthrough
    ).table()
    ts, wn, delta = 1 / rate, 2 * np.pi * 652.0, 0.182
    k = 0.104 * wn**2
    gamma = 1 / (1 - 2 * delta * wn * ts + wn**2 * ts**2)
    expected = {
        "W3": [[1, ts], [-(wn**2) * ts, 1 - 2 * delta * wn * ts]],
        "W1": [[0], [k * ts]],
        "W2": [gamma * (1 - 2 * delta * wn * ts), -gamma * ts],
        "W4": [gamma * k * ts**2],
    }
    for name, value in expected.items():
        np.testing.assert_allclose(np.asarray(table[name]), value, rtol=1e-13, atol=1e-20, err_msg=name)


def test_table_updates_first_and_reads_then(rng):
    """y = W2 (W3 x + W1 c) + W4 c is the output read from the old state."""
    weights = Weights(
        rng.standard_normal((2, 2)), rng.standard_normal((2, 3)), rng.standard_normal(2), rng.standard_normal(3)
    )
    table = {name: np.asarray(value) for name, value in weights.table().items()}
    x, c = rng.standard_normal(2), rng.standard_normal(3)
    following = table["W3"] @ x + table["W1"] @ c
    assert table["W2"] @ following + table["W4"] @ c == pytest.approx(weights.output @ x + weights.feedthrough @ c)


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("factor", [1e-3, 60.0])
def test_weights_do_not_depend_on_the_unit_of_time(name, factor):
    """Frequencies times s and the sampling interval over s leave every weight as it is."""
    p = {"generator_constant": 30.0, "natural_frequency": 652.0, "damping_ratio": 0.182}
    faster = p | {"natural_frequency": p["natural_frequency"] * factor}
    terms = METHODS[name].terms(0.1)
    ours = weights_of(name, p, 1 / 51200, 0.3, terms, "velocity-pickup", "drive")
    theirs = weights_of(name, faster, 1 / 51200 / factor, 0.3, terms, "velocity-pickup", "drive")
    np.testing.assert_allclose(np.asarray(theirs.transition), np.asarray(ours.transition), rtol=1e-12)
    product = np.asarray(theirs.drive)[..., None] * np.asarray(theirs.output)
    expected = np.asarray(ours.drive)[..., None] * np.asarray(ours.output)
    # A velocity pickup's gain carries one unit of time: V per m/s² is G times a time.
    np.testing.assert_allclose(product * factor, expected, rtol=1e-11, atol=1e-15 * np.max(np.abs(expected)))


def test_terms_needed_by_scipys_bessel_functions():
    """The smallest number whose truncation error is below the tolerance, for sensors slow and fast."""
    for rate in np.geomspace(1e-6, 1e3, 40):
        q = np.arange(2, MAX_TERMS)
        error = (2 * q + 1) * np.abs(spherical_jn(q, np.pi * USABLE_BAND)) * np.minimum(1.0, spherical_in(q, rate / 2))
        expected = q[error < SERIES_TOLERANCE]
        assert terms_needed(rate) == (expected[0] if expected.size else MAX_TERMS)


def test_terms_needed():
    """4 inputs a step for the Table 2 sensor at 51.2 kHz, 7 at 2.56 kHz (docs), 12 where nothing smooths the input."""
    wn = 4096.4
    chosen = method("bandlimited")
    assert [chosen.terms(wn / rate) for rate in (51200.0, 2560.0)] == [4, 7]
    many = [chosen.terms(rate) for rate in np.geomspace(1e-4, 1e4, 60)]
    assert many == sorted(many)
    assert many[0] >= 2
    assert many[-1] <= 12
    assert chosen.terms(1e-4, direct=True) == 12
    assert [METHODS[name].terms(5.0) for name in ("euler", "zoh", "foh", "tustin")] == [1, 1, 2, 2]


@pytest.mark.parametrize("name", ["euler", "zoh", "foh", "tustin"])
def test_a_derivative_of_the_input_needs_the_band_limited_step(name):
    p = {"generator_constant": 30.0, "natural_frequency": 652.0, "damping_ratio": 0.182}
    system = system_of(p, "velocity-pickup", "displacement")
    with pytest.raises(ModelError, match="bandlimited"):
        method(name).weights(system, 1e-4, 0.0, METHODS[name].terms(1.0))


def test_an_unknown_method_is_named():
    with pytest.raises(ModelError) as caught:
        method("rk4")
    assert caught.value.expected == "euler | zoh | foh | tustin | bandlimited"


@jax.jit
def _expm_with_slope(matrix, direction):
    return jax.jvp(expm, (matrix,), (direction,))


@pytest.mark.parametrize("damping", [0.0, 0.02, 0.7, 1.0, 2.5])
@pytest.mark.parametrize("angle", [1e-6, 0.08, 1.6, 40.0, 3000.0])
def test_the_exponential_against_scipy(damping, angle):
    """e^M of the step's generator within 2e-12 of SciPy's, relative to its largest entry, as is its derivative."""
    system = realise(parse("accelerometer").rational(accelerometer(1.0, damping)))
    a = np.asarray(system.a) / (2 * np.pi) * angle
    matrix = np.block([[a, np.ones((2, 3))], [np.zeros((3, 2)), np.diag([2.0, 6.0], 1)]])
    expected = scipy_expm(matrix)
    direction = np.zeros((5, 5))
    direction[:2, :2] = a / angle
    found, slope = _expm_with_slope(jnp.asarray(matrix), jnp.asarray(direction))
    for one in (np.asarray(found), expm(matrix)):
        assert np.max(np.abs(one - expected)) < 2e-12 * np.max(np.abs(expected))
    # Van Loan's trick: the derivative sits in the corner of the exponential of a matrix of twice the size.
    both = scipy_expm(np.block([[matrix, direction], [np.zeros((5, 5)), matrix]]))
    expected = both[:5, 5:]
    assert np.max(np.abs(np.asarray(slope) - expected)) < 2e-11 * np.max(np.abs(expected))


def test_the_legendre_basis_obeys_its_differential_equation():
    """d/dx g(x)ᵀ = g(x)ᵀ F on the step, P_j(2x − 1) by NumPy."""
    from vibrident.physics.discretisation.weights import legendre_shift

    x = np.linspace(0, 1, 17)
    slopes = np.stack([2 * legendre.legval(2 * x - 1, legendre.legder(np.eye(8)[j])) for j in range(8)], axis=1)
    np.testing.assert_allclose(legendre.legvander(2 * x - 1, 7) @ legendre_shift(8), slopes, atol=1e-11)
