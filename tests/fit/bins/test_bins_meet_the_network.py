"""The lines against the network unrolled in time: the same samples and weights, the same least-squares problem."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

import vibrident
from vibrident.base.errors import InputError
from vibrident.data.records import Calibration, Record
from vibrident.fit.bins import transformable
from vibrident.fit.descent.settle import Objective
from vibrident.fit.optimise import levenberg_marquardt
from vibrident.fit.problem import BinProblem, Coordinates, network_objective
from vibrident.fit.problem.time_domain import TimeProblem
from vibrident.physics.discretisation import METHODS, method
from vibrident.physics.models import parse
from vibrident.physics.simulation import simulate, with_noise

RATE, SAMPLES = 10e3, 1503
SENSORS = {
    "accelerometer": {"sensitivity": 0.104, "natural_frequency": 352.0, "damping_ratio": 0.182},
    "velocity-pickup": {"generator_constant": 28.0, "natural_frequency": 45.0, "damping_ratio": 0.56},
}
ADDED = {
    "delay": {"delay": 137e-6},
    "highpass": {"highpass_frequency": 12.0},
    "mode2": {"mode2_frequency": 1800.0, "mode2_damping": 0.03, "mode2_gain": 0.04},
}


def values_of(model):
    core, *add_ons = model.split("+")
    return {**SENSORS[core], **{name: v for addon in add_ons for name, v in ADDED[addon].items()}}


def random_motion(model, samples=SAMPLES, rate=RATE):
    true = (model, values_of(model))
    made = simulate(true, "random", frequencies_hz=[20.0, 2000.0], sampling_rate_hz=rate, samples=samples, seed=5)
    return with_noise(made, response_noise=0.02, seed=6).records[0]


def records_of_all_kinds(model):
    """With a gap in both channels, at another rate, without a reference, with gaps in the response.

    And with runs shorter than the filters: between two gaps of the reference ten steps may be left, where the inputs
    look at eighty samples. (In so few steps the slow motion of a high-pass is all but an offset.)
    """
    both, response = np.arange(2400) == 1200, np.arange(SAMPLES) % 400 < 30
    short = ~np.isin(np.arange(SAMPLES), [700, 791, 905, 1100])
    made = [
        random_motion(model, 2400).without(both, "test"),
        random_motion(model, rate=1.6 * RATE),
        replace(random_motion(model), reference=None, excitation="decay"),
        random_motion(model).without_response(response, "test"),
        replace(random_motion(model), response=random_motion(model).response + 0.3, reference_valid=short),
    ]
    return made[:4] if "highpass" in model else made


def a_problem(model, quantity, name, rng):
    """The network in time and at the lines, away from the optimum, coordinates, and a noise of each record."""
    start = {key: value * rng.uniform(0.9, 1.1) for key, value in values_of(model).items()}
    records = records_of_all_kinds(model)
    at = (records, parse(model), method(name), quantity, start)
    both = TimeProblem.build(*at), BinProblem.build(*at)
    return *both, Coordinates.at(parse(model), start, (20.0, 2000.0)), 0.03 * np.arange(1.0, len(records) + 1.0)


def assert_the_same_response(in_time, at_lines, coordinates, z):
    """Within 1e-9, with the best initial states, at every sample that is used."""
    responses = (problem.predict(coordinates, z) for problem in (at_lines, in_time))
    for record, ours, theirs in zip(in_time.records, *responses, strict=True):
        known = np.isfinite(ours)
        assert known.sum() > 0.5 * record.samples
        assert not np.any(record.mask & np.isfinite(theirs) & ~known)
        size = np.nanmax(np.abs(theirs))
        np.testing.assert_allclose(ours[known], theirs[known], rtol=0, atol=1e-9 * size)


EVERY_QUANTITY = itertools.product(
    ("accelerometer", "velocity-pickup"), ("acceleration", "velocity", "displacement"), ["bandlimited"]
)
EVERY_DISCRETISATION = itertools.product(["accelerometer+delay"], ["acceleration"], METHODS)
EVERY_ADD_ON = (
    ("velocity-pickup+highpass+delay", "acceleration", "bandlimited"),
    ("accelerometer+mode2+highpass+delay", "acceleration", "bandlimited"),
)


@pytest.mark.parametrize(("model", "quantity", "name"), [*EVERY_QUANTITY, *EVERY_DISCRETISATION, *EVERY_ADD_ON])
@pytest.mark.quick(
    "velocity-pickup+highpass+delay-acceleration-bandlimited",
    "accelerometer+delay-acceleration-zoh",
)
def test_they_are_one_problem(model, quantity, name, rng):
    """Cost, Jᵀr and JᵀJ within 1e-9, and the response."""
    in_time, at_lines, coordinates, noise = a_problem(model, quantity, name, rng)
    z = coordinates.first
    whole, lines = in_time.normal(z, coordinates, noise), Objective.plain(at_lines, coordinates, noise**2)(z)
    scale, size = np.sqrt(np.diag(lines.matrix)), np.sqrt(lines.cost)
    assert lines.cost == pytest.approx(float(whole.cost), rel=1e-9)
    both = np.outer(scale, scale)
    np.testing.assert_allclose(np.asarray(whole.matrix) / both, lines.matrix / both, atol=1e-9)
    np.testing.assert_allclose(np.asarray(whole.gradient) / scale / size, lines.gradient / scale / size, atol=1e-9)
    assert_the_same_response(in_time, at_lines, coordinates, z)


def test_the_optimum(rng):
    """Trained either way: the same parameters to 1e-8 of their scale, and the same response."""
    in_time, at_lines, coordinates, noise = a_problem("accelerometer+delay", "acceleration", "bandlimited", rng)
    args = coordinates, in_time, noise
    one = levenberg_marquardt(network_objective, coordinates.first, args, tolerance=1e-15)
    plain = Objective.plain(at_lines, coordinates, noise**2)
    other = levenberg_marquardt(plain, coordinates.first, None, tolerance=1e-15)
    np.testing.assert_allclose(other.last, one.last, rtol=0, atol=1e-8)
    assert_the_same_response(in_time, at_lines, coordinates, one.last)


def test_a_record_that_no_run_reaches_has_no_lines_and_does_no_harm():
    """Its reference is broken everywhere: it says nothing, and the others are identified as without it."""
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
    lengths = [transformable(slice(3, 3 + samples)) for samples in (8191, 15_921, 70_001, 1_599_921)]
    assert [found.stop - found.start for found in lengths] == [8191, 15_912, 69_984, 1_599_360]
    assert all(found.start == 3 for found in lengths)


def test_records_too_short_are_refused():
    noise = np.random.default_rng(0).standard_normal((2, 12))
    short = [Record("short", noise[0], noise[1], 10e3, valid=np.arange(12) < 6)]
    with pytest.raises(InputError, match="long enough"):
        BinProblem.build(short, parse("accelerometer"), method("euler"), "acceleration", values_of("accelerometer"))


@pytest.mark.parametrize("place", [12.34, 12.0])
def test_a_tone_of_known_frequency_says_nothing_whatever_its_size(place, rng):
    """Cost, gradient and matrix are those without it; between lines and on one, in whole records and in parts."""
    plain = random_motion("accelerometer")
    gap = np.isin(np.arange(SAMPLES), range(600, 640))
    for record in (plain, plain.without_response(gap, "a gap")):
        hum_hz = place * RATE / SAMPLES
        size = 0.3 * np.std(record.response)
        loud = record.with_response(record.response + size * np.cos(2 * np.pi * hum_hz * record.time_s + 1.0), "")
        start = {key: value * 1.01 for key, value in values_of("accelerometer").items()}
        coordinates = Coordinates.at(parse("accelerometer"), start, (20.0, 2000.0))
        quiet, noisy = (
            BinProblem.build([humming], parse("accelerometer"), method("bandlimited"), "acceleration", start)
            for humming in (replace(record, hum_hz=(hum_hz,)), replace(loud, hum_hz=(hum_hz,)))
        )
        found, other = (
            Objective.plain(problem, coordinates, np.ones(1))(coordinates.first) for problem in (quiet, noisy)
        )
        noise = np.sqrt(found.cost)
        assert other.cost == pytest.approx(found.cost, rel=1e-3)
        np.testing.assert_allclose(
            other.gradient / np.sqrt(np.diag(found.matrix)), found.gradient / np.sqrt(np.diag(found.matrix)),
            atol=0.02 * noise,
        )  # fmt: skip
        np.testing.assert_allclose(noisy.predict(coordinates, coordinates.first)[0],
                                   quiet.predict(coordinates, coordinates.first)[0], atol=2e-3 * size)  # fmt: skip


def test_a_tone_of_a_part_of_a_turn_holds_no_offset():
    """Thirty samples between dropouts see so little of a slow tone that their mean tells nothing of its size."""
    whole, values = random_motion("accelerometer"), values_of("accelerometer")
    run = Record("run", whole.reference[600:640], whole.response[600:640], RATE, "random")
    humming = replace(run, hum_hz=(0.5 * RATE / SAMPLES,))
    coordinates = Coordinates.at(parse("accelerometer"), values, (20.0, 2000.0))
    alone, both = (
        BinProblem.build([one], parse("accelerometer"), method("bandlimited"), "acceleration", values).predict(
            coordinates, coordinates.first
        )[0]
        for one in (run, humming)
    )
    np.testing.assert_allclose(both, alone, atol=0.5 * np.nanstd(alone))


def test_a_long_record_is_worked_on_in_blocks_and_gives_the_same(monkeypatch):
    """Blocks of 256 lines, nothing kept between them: every number as at once, but for rounding."""
    made = vibrident.simulate(
        ("accelerometer", values_of("accelerometer")),
        "random",
        frequencies_hz=[20.0, 2000.0],
        sampling_rate_hz=RATE,
        samples=3000,
        seed=5,
    )
    noisy = with_noise(made, response_noise=0.02, reference_noise=0.01, seed=6)
    whole = vibrident.identify(noisy, estimator="ipnn")
    monkeypatch.setattr("vibrident.fit.bins.segments.MAX_CACHED_SAMPLES", 0)
    monkeypatch.setattr("vibrident.fit.response.transform.BLOCK_LINES", 256)
    parts = vibrident.identify(noisy, estimator="ipnn")
    assert parts.settings["noise_weights"] == "spectrum"
    for name, value in whole.parameters.items():
        assert parts.parameters[name].value == pytest.approx(value.value, rel=1e-9)
        assert parts.parameters[name].standard_uncertainty == pytest.approx(value.standard_uncertainty, rel=1e-6)
