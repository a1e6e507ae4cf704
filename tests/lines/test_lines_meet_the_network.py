"""The lines against the network unrolled in time: the same samples and weights, the same least-squares problem."""

from dataclasses import replace

import numpy as np
import pytest

from vibrident.backend import jnp
from vibrident.discretize import method
from vibrident.lines import Batch, Trained, normal_equations, runs_of
from vibrident.models import parse
from vibrident.problem import Coordinates, TimeProblem
from vibrident.problem.time_domain import evaluate
from vibrident.simulation import simulate, with_noise

RATE = 10e3
STEPS = 1440  # of the network: a length that no transform shortens
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


def samples_for(steps, name, delay_s):
    """Length of the record in which the network takes so many steps."""
    for samples in range(steps, steps + 200):
        usable = method(name).filters(np.ones(samples, dtype=bool), 2, delay_s * RATE).usable
        if usable.sum() == steps:
            return samples
    raise AssertionError


def both_ways(model, quantity, name, rng):
    """Cost, Jᵀr and JᵀJ of the network in time, and of its lines, with physical values for coordinates."""
    true = values_of(model)
    start = {key: value * rng.uniform(0.9, 1.1) for key, value in true.items()}
    samples = samples_for(STEPS, name, start.get("delay", 0.0))
    record = random_motion(model, samples, RATE)
    return of_records([record], model, quantity, name, start)


def random_motion(model, samples, rate):
    true = (model, values_of(model))
    made = simulate(true, "random", frequencies_hz=[20.0, 2000.0], sampling_rate_hz=rate, samples=samples, seed=5)
    return with_noise(made, response_noise=0.02, seed=6).records[0]


def of_records(records, model, quantity, name, start):
    parsed, step = parse(model), method(name)
    problem = TimeProblem.build(records, parsed, step, quantity, start)
    coordinates = Coordinates.at(parsed, start, (20.0, 2000.0))
    z, layout = coordinates.first, problem.layout
    noise = 0.03 * np.arange(1.0, len(records) + 1.0)
    whole = evaluate(jnp.asarray(z), coordinates, layout, problem.data, jnp.asarray(problem.by_lane(noise)))

    trained = Trained(parsed, step, quantity, layout.terms)
    runs = runs_of(records, trained, problem.delay_s, highest=0.5, fewest=2 * (layout.order + 1) + 1)
    assert [run.span for run in runs] == [run for _, run, _ in problem.pieces]
    intervals = [records[run.record].sampling_interval_s for run in runs]
    fractions = dict(zip(problem.intervals_s, problem.fractions, strict=True))
    at = [(start, interval, float(fractions[interval]), problem.delay_s) for interval in intervals]
    lines = normal_equations(
        [Batch.of([run], [number]) for number, run in enumerate(runs)],
        [trained.transfer(*each) for each in at],
        [trained.slopes(*each) for each in at],
        [(run.share * run.samples / noise[run.record] ** 2)[None, :] for run in runs],
    )
    return whole, lines, np.array([_slope(coordinates, z, number) for number in range(len(z))])


def _slope(coordinates, z, number):
    """∂ physical value / ∂ coordinate, by central differences."""
    step = 1e-6 * np.eye(len(z))[number]
    name = coordinates.model.parameter_names[number]
    return (coordinates.values(z + step)[name] - coordinates.values(z - step)[name]) / 2e-6


def assert_the_same(whole, lines, turn):
    matrix = lines.matrix * np.outer(turn, turn)
    scale = np.sqrt(np.diag(matrix))
    assert lines.cost == pytest.approx(float(whole.cost), rel=1e-9)
    np.testing.assert_allclose(
        np.asarray(whole.matrix) / np.outer(scale, scale), matrix / np.outer(scale, scale), atol=1e-9
    )
    size = np.sqrt(lines.cost)
    np.testing.assert_allclose(
        np.asarray(whole.gradient) / scale / size, lines.gradient * turn / scale / size, atol=1e-9
    )


@pytest.mark.parametrize("quantity", ["acceleration", "velocity", "displacement"])
@pytest.mark.parametrize("core", ["accelerometer", "velocity-pickup"])
def test_every_reference_quantity(core, quantity, rng):
    assert_the_same(*both_ways(core, quantity, "bandlimited", rng))


@pytest.mark.parametrize("name", ["euler", "zoh", "foh", "tustin"])
def test_every_discretisation(name, rng):
    assert_the_same(*both_ways("accelerometer+delay", "acceleration", name, rng))


@pytest.mark.parametrize(
    "model",
    [
        "accelerometer+delay",
        "velocity-pickup+highpass+delay",
        "accelerometer+mode2",
        "accelerometer+mode2+highpass+delay",
    ],
)
def test_every_model(model, rng):
    assert_the_same(*both_ways(model, "acceleration", "bandlimited", rng))


def with_gap(model, delay_s):
    """A record whose network takes 1440 steps, then 1200 behind a gap."""
    record = random_motion(model, 3200, RATE)
    steps = method("bandlimited").filters(np.arange(3200) != 1600, 2, delay_s * RATE).usable
    first, second = (np.flatnonzero(np.diff(steps.astype(int)) == edge) for edge in (1, -1))
    before, after = second[0] - first[0] - 1440, second[1] - first[1] - 1200
    return cut_to(record.without(np.arange(3200) == 1600, "test"), before, 3200 - after)


def cut_to(record, start, stop):
    part = slice(start, stop)
    return replace(record, reference=record.reference[part], response=record.response[part], valid=record.mask[part])


def test_gaps_decays_and_two_rates(rng):
    """A record with a gap, one at another rate, and a free decay, which has no reference."""
    model = "accelerometer+delay"
    start = {key: value * rng.uniform(0.9, 1.1) for key, value in values_of(model).items()}
    delay = start["delay"]
    records = [
        with_gap(model, delay),
        random_motion(model, samples_for(STEPS, "bandlimited", 1.6 * delay), 1.6 * RATE),
        replace(
            random_motion(model, samples_for(STEPS, "bandlimited", delay), RATE), reference=None, excitation="decay"
        ),
    ]
    assert_the_same(*of_records(records, model, "acceleration", "bandlimited", start))
