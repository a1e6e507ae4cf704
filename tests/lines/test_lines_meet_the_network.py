"""The lines against the network unrolled in time: the same samples and weights, the same least-squares problem."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support.line_sensors import values_of

from vibrident.discretize import method
from vibrident.estimators.optimise import levenberg_marquardt
from vibrident.lines import transformable
from vibrident.models import parse
from vibrident.problem import Coordinates, LineProblem, network_objective
from vibrident.problem.time_domain import TimeProblem
from vibrident.simulation import simulate, with_noise

RATE, SAMPLES = 10e3, 1503


@pytest.fixture(autouse=True)
def every_line_counts(monkeypatch):
    """As every sample does in time; otherwise lines near half the sampling rate are left out."""
    monkeypatch.setattr("vibrident.problem.line_problem.USABLE_BAND", 0.5)


def random_motion(model, samples=SAMPLES, rate=RATE):
    true = (model, values_of(model))
    made = simulate(true, "random", frequencies_hz=[20.0, 2000.0], sampling_rate_hz=rate, samples=samples, seed=5)
    return with_noise(made, response_noise=0.02, seed=6).records[0]


def a_problem(records, model, quantity, name, rng):
    """The network in time and at the lines, away from the optimum, coordinates, and a noise of each record."""
    start = {key: value * rng.uniform(0.9, 1.1) for key, value in values_of(model).items()}
    at = (records, parse(model), method(name), quantity, start)
    both = TimeProblem.build(*at), LineProblem.build(*at)
    return *both, Coordinates.at(parse(model), start, (20.0, 2000.0)), 0.03 * np.arange(1.0, len(records) + 1.0)


def assert_the_same(in_time, at_lines, coordinates, noise):
    """Cost, Jᵀr and JᵀJ within 1e-9, and the noise of each record."""
    z = coordinates.first
    whole, lines = (problem.normal(z, coordinates, noise) for problem in (in_time, at_lines))
    np.testing.assert_allclose(at_lines.record_noise(lines, noise), in_time.record_noise(whole, noise), rtol=1e-9)
    scale, size = np.sqrt(np.diag(lines.matrix)), np.sqrt(lines.cost)
    assert lines.cost == pytest.approx(float(whole.cost), rel=1e-9)
    both = np.outer(scale, scale)
    np.testing.assert_allclose(np.asarray(whole.matrix) / both, lines.matrix / both, atol=1e-9)
    np.testing.assert_allclose(np.asarray(whole.gradient) / scale / size, lines.gradient / scale / size, atol=1e-9)


@pytest.mark.parametrize("quantity", ["acceleration", "velocity", "displacement"])
@pytest.mark.parametrize("core", ["accelerometer", "velocity-pickup"])
@pytest.mark.quick("accelerometer-velocity", "velocity-pickup-velocity")
def test_every_reference_quantity(core, quantity, rng):
    assert_the_same(*a_problem([random_motion(core)], core, quantity, "bandlimited", rng))


@pytest.mark.parametrize("name", ["euler", "zoh", "foh", "tustin"])
@pytest.mark.quick("zoh")
def test_every_discretisation(name, rng):
    model = "accelerometer+delay"
    assert_the_same(*a_problem([random_motion(model)], model, "acceleration", name, rng))


@pytest.mark.parametrize(
    "model",
    ["accelerometer+delay", "velocity-pickup+highpass+delay", "accelerometer+mode2+highpass+delay"],
)
@pytest.mark.quick("accelerometer+mode2+highpass+delay")
def test_every_add_on(model, rng):
    assert_the_same(*a_problem([random_motion(model)], model, "acceleration", "bandlimited", rng))


def test_runs_shorter_than_the_filters(rng):
    """Between two gaps of the reference ten steps may be left, where the inputs look at eighty samples."""
    record = random_motion("accelerometer")
    gaps = np.isin(np.arange(SAMPLES), [700, 791, 905, 1100])
    record = replace(record, reference_valid=~gaps)
    assert_the_same(*a_problem([record], "accelerometer", "acceleration", "bandlimited", rng))


def records_of_all_kinds(model):
    """Records with a gap in both channels, at another rate, without a reference, and with gaps in the response."""
    both, response = np.arange(2400) == 1200, np.arange(SAMPLES) % 400 < 30
    return [
        random_motion(model, 2400).without(both, "test"),
        random_motion(model, rate=1.6 * RATE),
        replace(random_motion(model), reference=None, excitation="decay"),
        random_motion(model).without_response(response, "test"),
    ]


def test_gaps_decays_and_two_rates(rng):
    model = "accelerometer+delay"
    assert_the_same(*a_problem(records_of_all_kinds(model), model, "acceleration", "bandlimited", rng))


def test_the_optimum_and_the_predicted_response(rng):
    """Trained either way: the same parameters to 1e-8 of their scale, and the same response with the best states."""
    model = "accelerometer+delay"
    in_time, at_lines, coordinates, noise = a_problem(
        records_of_all_kinds(model), model, "acceleration", "bandlimited", rng
    )
    one, other = (
        levenberg_marquardt(network_objective, coordinates.first, (coordinates, problem, noise), tolerance=1e-15)
        for problem in (in_time, at_lines)
    )
    np.testing.assert_allclose(other.last, one.last, rtol=0, atol=1e-8)
    responses = (problem.predict(coordinates, one.last) for problem in (at_lines, in_time))
    for record, ours, theirs in zip(in_time.records, *responses, strict=True):
        known = np.isfinite(ours)
        assert not np.any(record.mask & np.isfinite(theirs) & ~known)
        np.testing.assert_allclose(
            ours[known], theirs[known], rtol=0, atol=1e-9 * np.max(np.abs(record.response[record.mask]))
        )


def test_a_record_that_no_run_reaches_has_no_lines_and_does_no_harm():
    """Its reference is broken everywhere: it says nothing, and the others are identified as without it."""
    import vibrident
    from vibrident.records import Calibration

    good = random_motion("accelerometer")
    broken = replace(good, name="broken", reference_valid=np.arange(SAMPLES) % 20 > 0)
    alone, both = (
        vibrident.identify(Calibration(records=records, model="accelerometer"), estimator="ipnn")
        for records in ((good,), (good, broken))
    )
    for name, value in alone.parameters.items():
        assert both.parameters[name].value == pytest.approx(value.value, rel=1e-9)


def test_a_long_run_has_a_length_that_transforms_fast():
    """A factor of 10 457 would take fifteen times as long; less than a thousandth of the samples goes for it."""
    lengths = [transformable(slice(3, 3 + samples)) for samples in (15_921, 70_001, 1_599_921)]
    assert [found.stop - found.start for found in lengths] == [15_921, 70_000, 1_599_696]
    assert all(found.start == 3 for found in lengths)
