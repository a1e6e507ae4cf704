"""From a calibration to residuals: what the records become in time, what tones and tables become in frequency."""

from dataclasses import replace

import numpy as np
import pytest

from vibrident import identify
from vibrident.base.backend import jax
from vibrident.base.errors import InputError, ModelError
from vibrident.data.records import Calibration, Record, ResponseTable
from vibrident.fit.descent.settle import Objective
from vibrident.fit.estimators import Ipnn
from vibrident.fit.problem import BinProblem, Coordinates, Evidence, FrequencyProblem
from vibrident.fit.problem.network_problem import MAX_DELAY_CHANGE_SAMPLES
from vibrident.fit.problem.time_domain import TimeProblem
from vibrident.fit.response.response import MIN_RELATIVE_DEVIATION
from vibrident.paper.estimators.lsm import inverse_residual
from vibrident.physics.discretisation import method
from vibrident.physics.models import parse
from vibrident.physics.simulation import simulate

P = {"sensitivity": 0.104, "natural_frequency": 652.0, "damping_ratio": 0.182}
MODEL = parse("accelerometer")
BAND = (10.0, 1000.0)


def simulated(samples=700, **more):
    return simulate(("accelerometer", P), "random", sampling_rate_hz=10e3, samples=samples, seed=2, **more)


def with_gap(record):
    bad = np.zeros(record.samples, dtype=bool)
    bad[300:310] = True
    return record.without(bad, "test")


def test_records_in_time_keep_their_samples_and_count_their_freedom():
    """A gap of 10 samples in the band-limited record takes 2·40 + 9 steps and makes two segments."""
    records = [simulated().records[0], with_gap(simulated(samples=900).records[0])]
    problem = TimeProblem.build(records, MODEL, method("bandlimited"), "acceleration", P)
    assert problem.record_of_segment.tolist() == [0, 1, 1]
    steps = [700 - 79, 900 - 79 - 89]
    np.testing.assert_array_equal(problem.degrees_of_freedom, [steps[0] - 3, steps[1] - 6])
    assert problem.layout.terms == method("bandlimited").terms(2 * np.pi * 652 / 10e3)
    for record, back in zip(records, problem.by_record(problem.lanes.response), strict=True):
        used = np.isfinite(back)
        np.testing.assert_array_equal(back[used], record.response[used])
        assert not used[:39].any()
        assert not used[-40:].any()
    np.testing.assert_array_equal(problem.by_lane(np.array([2.0, 3.0]))[:3], [2.0, 2.0, 2.0])


def test_transforms_of_long_runs_are_let_go_of_and_made_again(monkeypatch):
    """The inputs' after a prediction, and all of an idle problem; its cost stays to the bit."""
    for module in ("bins.segments", "problem.bin_problem"):
        monkeypatch.setattr(f"vibrident.fit.{module}.MAX_CACHED_SAMPLES", 100)
    problem = BinProblem.build(simulated().records, MODEL, method("bandlimited"), "acceleration", P)
    c, noise = Coordinates.at(MODEL, P, BAND), np.ones(1)
    before = Objective.plain(problem, c, noise)(c.first)
    problem.predict(c, c.first)
    assert "inputs" not in vars(problem.segments[0].transforms)
    idle = problem.idle()
    assert not {"inputs", "response"} & set(vars(idle.segments[0].transforms))
    np.testing.assert_array_equal(Objective.plain(idle, c, noise)(c.first).matrix, before.matrix)


def test_the_true_sensor_leaves_nothing_whatever_the_offsets():
    """Band-limited motion with an offset of either channel and from a steady start: residual below 1e-6 everywhere."""
    record = simulated(start="steady").records[0]
    moved = replace(record, reference=record.reference + 5.0, response=record.response - 3.0)
    problem = BinProblem.build([moved], MODEL, method("bandlimited"), "acceleration", P)
    c = Coordinates.at(MODEL, P, BAND)
    (predicted,) = problem.predict(c, c.first)
    used = np.isfinite(predicted)
    assert used.sum() == 700 - 79
    assert np.max(np.abs(predicted - moved.response)[used]) < 1e-6 * np.std(moved.response)


def test_a_free_decay_has_no_input():
    calibration = simulate(("accelerometer", P), "decay", sampling_rate_hz=10e3, samples=400)
    problem = TimeProblem.build(calibration.records, MODEL, method("bandlimited"), "acceleration", P)
    assert not np.any(problem.lanes.inputs)
    problem = BinProblem.build(calibration.records, MODEL, method("bandlimited"), "acceleration", P)
    c = Coordinates.at(MODEL, P, BAND)
    (predicted,) = problem.predict(c, c.first)
    used = np.isfinite(predicted)
    assert np.max(np.abs(predicted - calibration.records[0].response)[used]) < 1e-10


def test_models_and_records_without_a_network_in_time_are_refused():
    short = Record("short", np.arange(8.0), np.arange(8.0), 1e3, "random")
    with pytest.raises(InputError, match="long enough"):
        TimeProblem.build([short], MODEL, method("bandlimited"), "acceleration", P)
    calibration = replace(simulated(), model="accelerometer+boxcar")
    for settings in ({"optimiser": "adam"}, {"residual": True}):
        with pytest.raises(ModelError, match="boxcar"):
            identify(calibration, estimator=Ipnn().configured(**settings))


def table(phase=True, uncertainty=True, n=12):
    f = np.geomspace(10.0, 1000.0, n)
    h = MODEL.frequency_response(P, f)
    return ResponseTable(
        f,
        np.abs(h),
        np.angle(h) if phase else None,
        0.002 * np.abs(h) if uncertainty else None,
        np.full(n, 0.003) if uncertainty and phase else None,
    )


def test_a_tables_residual_is_in_magnitude_and_phase():
    """(|H| − m)/u_m and (arg H − φ)/u_φ, by NumPy; phases may be a whole turn off."""
    given = table()
    turned = replace(given, phase_rad=given.phase_rad + 2 * np.pi * np.arange(12))
    z = np.array([1.01, 0.02, 0.2])
    c = Coordinates.at(MODEL, P, BAND)
    h = MODEL.frequency_response(c.values(z), given.frequency_hz)
    expected = np.concatenate(
        [(np.abs(h) - given.magnitude) / given.magnitude_uncertainty, (np.angle(h) - given.phase_rad) / 0.003]
    )
    for one in (given, turned):
        problem = FrequencyProblem.of_table(one, MODEL, "acceleration")
        assert (problem.points, problem.equations) == (12, 24)
        found = problem.residual(z, c)
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_a_table_of_magnitudes_and_one_without_uncertainties():
    z = np.array([1.01, 0.02, 0.2])
    c = Coordinates.at(MODEL, P, BAND)
    only = FrequencyProblem.of_table(table(phase=False), MODEL, "acceleration")
    assert (only.has_phase, only.equations) == (False, 12)
    h = np.abs(MODEL.frequency_response(c.values(z), only.data[0]))
    found = only.residual(z, c)
    np.testing.assert_allclose(found, (h - only.data[1]) / only.data[3], atol=1e-9)
    bare = FrequencyProblem.of_table(table(uncertainty=False), MODEL, "acceleration")
    np.testing.assert_allclose(bare.data[3] / bare.data[1], 0.01, rtol=1e-12)
    np.testing.assert_allclose(bare.data[4], 0.01, rtol=1e-12)


def test_a_measured_responses_residual_is_complex():
    """Re and Im of (Y − H X)/σ."""
    rng = np.random.default_rng(3)
    f, x = np.geomspace(10, 1000, 7), rng.standard_normal(7) + 1j * rng.standard_normal(7)
    y, sigma = rng.standard_normal(7) + 1j, rng.uniform(0.1, 1.0, 7)
    c = Coordinates.at(MODEL, P, BAND)
    h = MODEL.frequency_response(P, f, "velocity")
    found = FrequencyProblem(MODEL, "velocity", (f, x, y, sigma)).residual(c.first, c)
    expected = (y - h * x) / sigma
    np.testing.assert_allclose(found, np.concatenate([expected.real, expected.imag]), rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize(("polar", "has_phase"), [(True, True), (True, False), (False, True)])
def test_the_jacobian_is_the_residuals(polar, has_phase):
    """Analytic slopes against automatic differentiation, with every kind of coordinate but the cubic's."""
    model = parse("velocity-pickup+highpass+mode2+delay")
    values = {"generator_constant": -28.8, "natural_frequency": 4.5, "damping_ratio": 0.56, "highpass_frequency": 0.1}
    values |= {"mode2_frequency": 140.0, "mode2_damping": 0.01, "mode2_gain": 0.01, "delay": 3e-4}
    c = Coordinates.at(model, values, (1.0, 200.0))
    z = c.first + 0.01
    rng = np.random.default_rng(5)
    f, u = np.geomspace(1.0, 200.0, 9), rng.uniform(0.1, 1.0, (2, 9))
    x = rng.standard_normal(9) + 1j * rng.standard_normal(9)
    data = (f, np.abs(x), np.angle(x), *u) if polar else (f, x, 1j * x, u[0])
    problem = FrequencyProblem(model, "velocity", data, polar, has_phase)
    expected = jax.jit(jax.jacfwd(lambda z: problem.residual(z, c)))(z)
    found = problem.jacobian(z, c)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12 * float(np.abs(expected).max()))


def test_the_papers_least_squares_is_linear_in_three_constants():
    """w (1/H_model − 1/H) = w (c0 + c1 jω + c2 (jω)²) − w/H with c = (1/S0, 2 δ/(ωn S0), 1/(ωn² S0))."""
    f = np.geomspace(10, 1000, 9)
    h = MODEL.frequency_response(P, f) * (1 + 0.01j)
    weight = np.linspace(0.5, 2, 9)
    z, c = np.array([1.1, 0.05, 0.3]), Coordinates.at(MODEL, P, BAND)
    v = c.values(z)
    wn, s = 2 * np.pi * v["natural_frequency"], 2j * np.pi * f
    linear = (1 + 2 * v["damping_ratio"] / wn * s + s**2 / wn**2) / v["sensitivity"]
    found, jacobian = inverse_residual(z, c, "acceleration", (f, h, weight))
    expected = weight * (linear - 1 / h)
    np.testing.assert_allclose(found[:9] + 1j * found[9:], expected, rtol=1e-10)
    for step, column in zip(1e-6 * np.eye(3), jacobian.T, strict=True):
        ahead, behind = (inverse_residual(z + s, c, "acceleration", (f, h, weight))[0] for s in (step, -step))
        np.testing.assert_allclose(column, (ahead - behind) / 2e-6, rtol=1e-6, atol=1e-8 * np.abs(column).max())


def test_evidence_numbers_records_as_they_were_given():
    sine = simulate(("accelerometer", P), frequencies_hz=[100.0, 400.0], sampling_rate_hz=10e3, samples=700)
    mixed = Calibration((sine.records[0], simulated().records[0], sine.records[1]))
    evidence = Evidence.gather(mixed, MODEL)
    assert evidence.tones.record.tolist() == [0, 2]
    assert set(evidence.bands.record.tolist()) == {1}
    assert not evidence.only_sines
    assert Evidence.gather(sine, MODEL).only_sines
    np.testing.assert_allclose(evidence.tones.frequency_hz, [100.0, 400.0], rtol=1e-3)
    low, high = evidence.band_hz
    assert 5.0 < low < 100.0
    assert 900.0 < high < 1300.0
    assert Evidence.gather(Calibration(table=table()), MODEL).band_hz == pytest.approx(BAND)


def test_a_delay_that_counts_as_that_of_the_inputs_leaves_no_error():
    """Read beside the delay of its inputs, a sine at a fifth of the rate was 10⁻⁶ off: 20 u at 24 bit."""
    values = {"generator_constant": 28.0, "natural_frequency": 1.4, "damping_ratio": 0.6, "delay": 1.05e-3}
    model = parse("velocity-pickup+delay")
    made = simulate(
        (model.name, values), "sine", frequencies_hz=[19.8], sampling_rate_hz=100.0, samples=1000, start="steady"
    )
    beside = values | {"delay": values["delay"] + 0.9 * MAX_DELAY_CHANGE_SAMPLES / 100.0}
    problem = BinProblem.build(made.records, model, method("bandlimited"), "acceleration", beside)
    assert problem.at_delay_of(values) is problem
    coordinates = Coordinates.at(model, values, (1.0, 20.0))
    (predicted,) = problem.predict(coordinates, coordinates.first)
    used = np.isfinite(predicted)
    off = np.asarray(made.records[0].response)[used] - predicted[used]
    assert np.std(off) < MIN_RELATIVE_DEVIATION * np.std(np.asarray(made.records[0].response))
