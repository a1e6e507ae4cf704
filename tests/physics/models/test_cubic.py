"""Cubic stiffness: truth against an ODE solver, the network against the truth, identification against both."""

import functools
import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import chi2

import vibrident
from vibrident.base.backend import jnp
from vibrident.base.errors import InputError, ModelError
from vibrident.data.records import Calibration, ResponseTable
from vibrident.fit.descent.settle import Objective
from vibrident.fit.estimators import Ipnn
from vibrident.fit.problem import BinProblem, Coordinates, Evidence, time_domain
from vibrident.fit.problem.time_domain import TimeProblem, evaluate
from vibrident.physics.discretisation import forced as forced_step
from vibrident.physics.discretisation import method
from vibrident.physics.models import parse
from vibrident.physics.simulation import (
    SENSORS,
    Decay,
    HalfSineShock,
    Multisine,
    Sine,
    Superposition,
    Sweep,
    exact_response,
    excitation_noise,
    simulate,
    with_noise,
)
from vibrident.physics.simulation import cubic as cubic_truth

TRUTH = dict(SENSORS["cubic"].parameters)
MODEL = parse("accelerometer+cubic")
RATE, SAMPLES = 12800.0, 400
FELT = excitation_noise(0.7, sampling_rate_hz=RATE, samples=SAMPLES, rng=np.random.default_rng(5))
MOTIONS = {
    "sine": Sine(630.0, 9.8, 0.4),
    "multisine": Multisine((10.0, 333.3, 1000.0), (4.0, 3.0, 3.0), (0.1, 0.2, 0.3)),
    "sweep": Sweep(100.0, 2000.0, 0.0271, 9.8),
    "shock": HalfSineShock(20.0, 1.777e-3, 1.234e-3),
    "sine with felt noise": Superposition((Sine(400.0, 9.8, -np.pi / 2), FELT)),
}
FEW_HZ = (40.0, 125.0, 250.0, 500.0, 800.0)


def exact(motion, p=TRUTH, model=MODEL, rate=RATE, samples=SAMPLES, start="rest"):
    return exact_response(model, p, motion, sampling_rate_hz=rate, samples=samples, start=start)


def ode(motion, times, p=TRUTH, begin=(0.0, 0.0, 0.0), inputs=True, rtol=1e-13, max_step=5e-5):
    """V̈ + 2 δ ωn V̇ + ωn² (V + k3 V³) = S0 ωn² a by SciPy, from (time, V, V̇/ωn)."""
    wn = 2 * np.pi * p["natural_frequency"]

    def slope(t, x):
        a = float(motion.value(np.array([t]))[0]) if inputs else 0.0
        spring = x[0] + p["cubic_stiffness"] * x[0] ** 3
        return [wn * x[1], wn * (p["sensitivity"] * a - 2 * p["damping_ratio"] * x[1] - spring)]

    x, values = np.array(begin[1:]), np.zeros(times.size)
    breaks = motion.breaks_s if inputs else ()
    for left, right in itertools.pairwise([begin[0], *(b for b in breaks if begin[0] < b < times[-1]), times[-1]]):
        inside = (times >= left) & (times <= right)
        solved = solve_ivp(
            slope, (left, right), x, "DOP853", rtol=rtol, atol=0.01 * rtol, max_step=max_step, dense_output=True
        )
        values[inside], x = solved.sol(times[inside])[0], solved.y[:, -1]
    return values


def relative(found, expected):
    return np.max(np.abs(found - expected)) / np.max(np.abs(expected))


@pytest.mark.parametrize(("name", "stiffness"), [*zip(MOTIONS, itertools.cycle((0.04, -0.02)))])
@pytest.mark.quick("sine-0.04", "multisine--0.02", "sweep-0.04", "shock--0.02")
def test_the_truth_is_what_an_ode_solver_gives(name, stiffness):
    p = TRUTH | {"cubic_stiffness": stiffness}
    expected = ode(MOTIONS[name], np.arange(SAMPLES) / RATE, p)
    assert relative(exact(MOTIONS[name], p), expected) < 2e-11
    linear = exact(MOTIONS[name], {k: p[k] for k in p if k != "cubic_stiffness"}, MODEL.linear)
    assert relative(linear, expected) > 1e-3  # there is something to see


def test_no_stiffness_is_the_linear_sensor():
    linear = exact(MOTIONS["sine"], {k: TRUTH[k] for k in TRUTH if k != "cubic_stiffness"}, MODEL.linear)
    np.testing.assert_allclose(exact(MOTIONS["sine"], TRUTH | {"cubic_stiffness": 0.0}), linear, atol=1e-15)


def test_a_delay_of_whole_samples_shifts_and_a_steady_start_has_forgotten_its_own():
    delayed = parse("accelerometer+cubic+delay")
    late = exact(MOTIONS["sweep"], TRUTH | {"delay": 5 / RATE}, delayed)
    np.testing.assert_allclose(late[5:], exact(MOTIONS["sweep"])[:-5], atol=1e-13)
    steady = exact(MOTIONS["sine"], start="steady")
    again = ode(MOTIONS["sine"], np.arange(40) / RATE, begin=(-0.03, 0.0, 0.0))  # e^{−δ ωn t} = 2e-10
    np.testing.assert_allclose(steady[:40], again, atol=2e-9)


def test_a_decay_begins_at_the_bent_spring_s_own_rest():
    y = exact(Decay(9.8))
    assert y[0] + TRUTH["cubic_stiffness"] * y[0] ** 3 == pytest.approx(9.8 * TRUTH["sensitivity"], rel=1e-12)
    assert relative(y, ode(None, np.arange(SAMPLES) / RATE, begin=(0.0, y[0], 0.0), inputs=False)) < 1e-11


def test_the_truth_s_method_has_order_eight(monkeypatch):
    """Error against step: the slope of DOP853, which no wrong coefficient would leave."""
    reference = exact(Sine(1000.0, 9.8, 0.4), rate=4000.0, samples=200)
    errors = []
    for substeps in (2, 3, 4):
        monkeypatch.setattr(cubic_truth, "MAX_STEP_PHASE_RAD", 2 * np.pi * 1000.0 / 4000.0 / (substeps - 0.5))
        errors.append(np.max(np.abs(exact(Sine(1000.0, 9.8, 0.4), rate=4000.0, samples=200) - reference)))
    orders = np.diff(np.log(errors)) / np.diff(np.log([1 / 2, 1 / 3, 1 / 4]))
    assert np.all(orders > 7.3), errors


def test_a_softening_spring_over_its_crest_is_refused():
    with pytest.raises(InputError, match="unstable"):
        exact(Sine(630.0, 60.0), TRUTH | {"cubic_stiffness": -0.1})
    with pytest.raises(InputError, match="does not hold"):
        exact(Decay(60.0), TRUTH | {"cubic_stiffness": -0.1})


def problem_of(calibration, values=TRUTH, model=MODEL, discretisation="bandlimited"):
    problem = TimeProblem.build(calibration.records, model, method(discretisation), calibration.quantity, values)
    size = Evidence.gather(calibration, model).response_size
    coordinates = Coordinates.at(model, values, (10.0, 1000.0), size)
    return problem, coordinates, (coordinates, problem.layout, problem.data, jnp.ones(problem.lanes.segment.shape))


def error_of_parameters(calibration, values=TRUTH, model=MODEL):
    """How far the exact records pull the network from the truth: the Gauss–Newton step there, in coordinates."""
    problem, coordinates, args = problem_of(calibration, values, model)
    normal = evaluate(jnp.asarray(coordinates.first), *args)
    worst = max(
        np.nanmax(np.abs(found - record.response))
        for found, record in zip(problem.by_record(normal.response), calibration.records, strict=True)
    )
    return np.linalg.solve(np.asarray(normal.matrix), np.asarray(normal.gradient)), worst


@pytest.mark.parametrize("rate", [51200.0, RATE, 5120.0])
@pytest.mark.quick("12800.0")  # its kernel serves other tests too
def test_the_network_meets_the_truth(rate):
    """Far below 1e-6 of the parameters at the usual sampling rate, and at a tenth of it."""
    made = simulate("cubic", frequencies_hz=FEW_HZ, sampling_rate_hz=rate, samples=1200)
    step, worst = error_of_parameters(made)
    assert np.max(np.abs(step)) < 1e-8
    assert worst < 2e-8


@pytest.mark.parametrize("quantity", ["velocity", "displacement"])
@pytest.mark.slow
def test_the_network_meets_the_truth_with_other_references_and_a_delay(quantity):
    p = TRUTH | {"delay": 3.3e-5}
    made = simulate(
        ("accelerometer+cubic+delay", p), frequencies_hz=FEW_HZ, sampling_rate_hz=RATE, samples=2000,
        quantity=quantity, start="steady",
    )  # fmt: skip
    step, _ = error_of_parameters(made, p, parse("accelerometer+cubic+delay"))
    assert np.max(np.abs(step)) < 1e-6


@pytest.mark.slow
def test_the_force_s_quadrature_has_order_two_a_node(monkeypatch):
    monkeypatch.setattr(time_domain, "accuracy", lambda rate_times_step: (2, (12, 3)))
    errors = []
    for rate in (6400.0, 12800.0):
        made = simulate("cubic", frequencies_hz=(250.0, 500.0), sampling_rate_hz=rate, samples=1000)
        errors.append(error_of_parameters(made)[1])
    order = np.log(errors[0] / errors[1]) / np.log(2.0)
    assert order == pytest.approx(4.0, abs=0.35), errors


def test_the_derivative_is_that_of_the_cost():
    """JᵀJ's gradient against central differences of the cost, with initial states and offset refitted each time."""
    _, coordinates, args = problem_of(with_noise(clean(), response_noise=0.01, seed=3))
    z = coordinates.first + np.array([0.01, -0.02, 0.015, 0.05])
    normal = evaluate(jnp.asarray(z), *args)
    for index, unit in enumerate(np.eye(4)):
        ahead, behind = (float(evaluate(jnp.asarray(z + s * 1e-5 * unit), *args).cost) for s in (1, -1))
        assert -2 * normal.gradient[index] == pytest.approx((ahead - behind) / 2e-5, rel=1e-5)


def test_zero_force_is_the_linear_network():
    made = simulate("paper", frequencies_hz=FEW_HZ, sampling_rate_hz=RATE, samples=1200, response_noise=0.01, seed=3)
    values = TRUTH | {"cubic_stiffness": 0.0}
    _, coordinates, args = problem_of(made, values)
    problem = BinProblem.build(made.records, MODEL.linear, method("bandlimited"), made.quantity, values)
    linear = Coordinates.at(MODEL.linear, values, (10.0, 1000.0))
    found = evaluate(jnp.asarray(coordinates.first), *args)
    expected = Objective.plain(problem, linear, np.ones(len(made.records)))(linear.first)
    assert float(found.cost) == pytest.approx(float(expected.cost), rel=1e-9)
    np.testing.assert_allclose(found.matrix[:3, :3], expected.matrix, rtol=1e-7)


@functools.cache
def clean():
    return simulate("cubic", frequencies_hz=FEW_HZ, sampling_rate_hz=RATE, samples=1200)


@functools.cache
def identified(seed):
    return vibrident.identify(with_noise(clean(), response_noise=0.01, seed=seed), model="accelerometer+cubic")


def scores(result, truth=TRUTH):
    parameters = {name: result.parameters[name] for name in truth}
    return np.array([(p.value - truth[name]) / p.standard_uncertainty for name, p in parameters.items()])


@pytest.mark.draws(2, 6)
def test_monte_carlo_deviations_are_of_the_size_of_their_uncertainty(draws):
    """Runs of four parameters: the sum of z² within what chance gives in 98 of 100; and no single one far out."""
    z = np.array([scores(identified(seed)) for seed in range(draws)])
    assert np.max(np.abs(z)) < 4.0
    assert chi2.ppf(0.01, z.size) < np.sum(z**2) < chi2.ppf(0.99, z.size)


def test_the_stiffness_is_detected_and_only_where_it_is():
    bent = identified(0)
    assert bent.estimator == "ipnn"
    assert bent.warning_codes == ()
    assert bent.parameters["cubic_stiffness"].value > 50 * bent.parameters["cubic_stiffness"].standard_uncertainty
    assert bent.parameters["cubic_stiffness"].unit == "1/V^2"
    assert "small signals" in bent.settings["response_curve"]
    straight = simulate("paper", frequencies_hz=FEW_HZ, sampling_rate_hz=RATE, samples=1200, response_noise=0.01)
    none = vibrident.identify(straight, model="accelerometer+cubic")
    assert none.warning_codes == ()
    assert np.max(np.abs(scores(none, TRUTH | {"cubic_stiffness": 0.0}))) < 4.0


def test_one_per_cent_of_third_harmonic_is_detected_in_the_linear_fit():
    """A motion so small that the third harmonic is 1 % of the response at its most: linear is refused all the same."""
    quiet = simulate(
        "cubic", frequencies_hz=FEW_HZ, amplitude=4.0, sampling_rate_hz=RATE, samples=1200, response_noise=0.003
    )
    assert "lack_of_fit" in vibrident.identify(quiet, model="accelerometer", estimator="ipnn").warning_codes


def same_but(change, powers, **more):
    """Identify the same records after a change: the same values to a thousandth of u, scaled by powers of 1000."""
    noisy = with_noise(clean(), response_noise=0.01, seed=0)
    records = tuple(r.__class__(**{**vars(r), **change(r)}) for r in noisy.records)
    other = vibrident.identify(Calibration(**{**vars(noisy), "records": records, **more}), model="accelerometer+cubic")
    for name, one in identified(0).parameters.items():
        found, scale = other.parameters[name], 1000.0 ** powers.get(name, 0)
        assert found.value == pytest.approx(scale * one.value, abs=1e-3 * found.standard_uncertainty)
        assert found.standard_uncertainty == pytest.approx(scale * one.standard_uncertainty, rel=1e-3)


def test_neither_the_unit_nor_an_offset_of_the_reference_matters():
    """In millivolts, the stiffness a million times smaller and as certain; the offset is twice the motion's peak."""
    powers = {"sensitivity": 1, "conversion_coefficient": 1, "cubic_stiffness": -2}
    same_but(
        lambda record: {"response": 1e3 * record.response, "reference": record.reference - 20.0},
        powers,
        response_unit="mV",
    )


@pytest.mark.parametrize("offset", [0.2, -20.0])
@pytest.mark.slow
def test_an_offset_of_the_reference_is_no_acceleration(offset):
    same_but(lambda record: {"reference": record.reference + offset}, {})


def test_a_spring_that_rests_beside_its_middle_is_named(rng):
    """A static load that the reference does not show: its square stands out of what the symmetric spring leaves."""
    times, load, s0 = clean().records[0].time_s, 10.0, TRUTH["sensitivity"]
    wn, turns = 2 * np.pi * TRUTH["natural_frequency"], 2 * np.pi * np.array(FEW_HZ)

    def slope(t, state):
        place, speed = state.reshape(2, -1)
        pushed = s0 * (load + 9.8 * np.cos(turns * t + 0.3)) - 2 * TRUTH["damping_ratio"] * speed
        return np.concatenate([wn * speed, wn * (pushed - place - TRUTH["cubic_stiffness"] * place**3)])

    begin = np.repeat([s0 * load, 0.0], turns.size)
    responses = solve_ivp(slope, (0.0, times[-1]), begin, "DOP853", times, rtol=1e-6, atol=1e-8).y[: turns.size]
    records = []
    for hz, response in zip(FEW_HZ, responses, strict=True):
        seen = response + 3e-3 * np.std(response) * rng.standard_normal(times.size) - np.mean(response)
        records.append(vibrident.Record(f"{hz}", Sine(hz, 9.8, 0.3).value(times), seen, RATE, "sine"))
    found = vibrident.identify(Calibration(records=tuple(records)), model="accelerometer+cubic")
    assert any("rests beside its middle" in w.message for w in found.warnings if w.code == "nonlinear")


def test_prediction_of_other_records():
    """Sines that the identification never saw, one stronger than all of those: what is left is their noise."""
    others = (31.5, 80.0, 200.0, 400.0, 630.0)
    made = simulate(
        "cubic", frequencies_hz=others, amplitude=12.0, sampling_rate_hz=RATE, samples=1200, response_noise=1e-3, seed=9
    )
    for prediction in vibrident.predict(identified(0), made).predictions:
        assert prediction.nrmse < 1.5e-3  # the noise, and what 1 % of it left of the parameters


def test_what_has_no_transfer_function_is_refused_where_one_is_needed():
    frequency = np.array([100.0, 300.0, 600.0, 900.0])
    table = ResponseTable(frequency, np.array([0.1, 0.13, 0.28, 0.1]), None, None, None)
    with pytest.raises(InputError, match="no transfer function"):
        vibrident.identify(Calibration(table=table, model="accelerometer+cubic"))
    for estimator in ("ml", "lsm"):
        with pytest.raises(InputError, match="no transfer function"):
            vibrident.identify(clean(), model="accelerometer+cubic", estimator=estimator)
    with pytest.raises(ModelError, match="no step for a nonlinear sensor"):
        vibrident.identify(clean(), model="accelerometer+cubic", estimator=Ipnn(discretisation="euler"))
    with pytest.raises(ModelError, match="linear sensors"):
        simulate("cubic", method="rk4")


@pytest.mark.parametrize("name", ["velocity-pickup+cubic", "accelerometer+cubic+mode2", "accelerometer+highpass+cubic"])
def test_combinations_whose_equation_is_another_are_refused(name):
    with pytest.raises(ModelError, match="cannot be combined"):
        parse(name)


def test_a_stiff_step_takes_more_nodes_and_more_rounds():
    few, many = forced_step.accuracy(0.08), forced_step.accuracy(1.0)
    assert few[0] < many[0]
    assert few[1][0] < many[1][0]
    assert few[1][1] <= many[1][1]
