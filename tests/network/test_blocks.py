"""Lanes of long records, taken in blocks with inputs made when needed: the same numbers as all at once."""

import numpy as np
import pytest

from vibrident.backend import jnp
from vibrident.discretize import method
from vibrident.discretize.weights import METHODS
from vibrident.models import parse
from vibrident.network.blocks import Windows, step_inputs
from vibrident.problem import Coordinates
from vibrident.problem.time_domain import TimeProblem, evaluate
from vibrident.simulation import simulate, with_noise

TRUE = {"sensitivity": 0.104, "natural_frequency": 652.0, "damping_ratio": 0.182, "delay": 137e-6}
MODEL = parse("accelerometer+delay")


def some_records(shapes=((10e3, 3300), (10e3, 5100), (16e3, 4200))):
    """Random motion with 2 % noise, records of several lengths and two rates, one with a gap."""
    records = []
    for rate, samples in shapes:
        made = simulate(
            (MODEL.name, TRUE), "random", frequencies_hz=[20.0, 2000.0], sampling_rate_hz=rate, samples=samples,
            seed=samples,
        )  # fmt: skip
        records += with_noise(made, response_noise=0.02, seed=samples).records
    bad = np.zeros(records[0].samples, dtype=bool)
    bad[600:640] = True
    records[0] = records[0].without(bad, "test")
    return records


START = {k: v * f for (k, v), f in zip(TRUE.items(), (1.05, 0.97, 1.2, 0.9), strict=True)}


def built(name, records):
    return TimeProblem.build(records, MODEL, method(name), "acceleration", START)


def evaluated(name, records):
    problem = built(name, records)
    coordinates = Coordinates.at(MODEL, START, (20.0, 2000.0))
    noise = problem.by_lane(np.linspace(0.02, 0.05, len(records)))
    args = (jnp.asarray(coordinates.first), coordinates, problem.layout, problem.data, jnp.asarray(noise))
    return problem, evaluate(*args)


@pytest.fixture
def long_from(monkeypatch):
    def shorten(samples, lanes_in_block=4):
        monkeypatch.setattr("vibrident.problem.cutting.MOST_AT_ONCE", samples)
        monkeypatch.setattr("vibrident.problem.cutting.LANES_IN_BLOCK", lanes_in_block)

    return shorten


def test_blocks_give_the_numbers_of_all_lanes_at_once(long_from):
    """Matrix, gradient, cost, squares, response and every column, to 1e-12 of their size."""
    records = some_records()
    whole, expected = evaluated("bandlimited", records)
    long_from(1000)
    problem, found = evaluated("bandlimited", records)
    assert whole.layout.blocks == 1
    assert problem.layout.blocks > 5
    scale = np.sqrt(np.diag(expected.matrix))
    np.testing.assert_allclose(
        found.matrix / np.outer(scale, scale), expected.matrix / np.outer(scale, scale), atol=1e-12
    )
    size = float(np.sqrt(expected.cost))
    np.testing.assert_allclose(found.gradient / scale / size, expected.gradient / scale / size, atol=1e-12)
    assert float(found.cost) == pytest.approx(float(expected.cost), rel=1e-12)
    np.testing.assert_allclose(found.squares, expected.squares, rtol=1e-11)
    assert len(found.columns) == len(expected.columns)
    pairs = [(found.response, expected.response), *zip(found.columns, expected.columns, strict=True)]
    for one, other in pairs:
        for a, b in zip(problem.by_record(one), whole.by_record(other), strict=True):
            np.testing.assert_array_equal(np.isfinite(a), np.isfinite(b))
            np.testing.assert_allclose(a, b, atol=1e-12 * np.nanmax(np.abs(b)))


@pytest.mark.parametrize("name", METHODS)
def test_inputs_made_when_needed_are_those_held(name, long_from):
    """In every lane, at every step that counts."""
    records = some_records()
    whole = built(name, records).lanes
    long_from(1000)
    lanes = built(name, records).lanes
    assert isinstance(lanes.inputs, Windows)
    made = np.asarray(step_inputs(lanes.inputs)) * lanes.weight[:, None]
    held = whole.inputs * whole.weight[:, None]
    np.testing.assert_allclose(made, held, atol=1e-12 * np.max(np.abs(held)))


def test_records_of_many_short_lengths_hold_their_inputs(long_from):
    """A short record has a filter of its own: with more than a few of them, blocks take inputs that are held."""
    records = some_records(((10e3, 3300), (10e3, 130), (10e3, 140), (10e3, 150), (10e3, 160)))
    whole = built("bandlimited", records)
    long_from(1000)
    problem = built("bandlimited", records)
    assert problem.layout.blocks > 1
    np.testing.assert_array_equal(problem.lanes.inputs, whole.lanes.inputs)
