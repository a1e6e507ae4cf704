"""The chunked network against its definition."""

from __future__ import annotations

import numpy as np
import pytest

from vibrident.base.backend import jnp
from vibrident.data.records import Record
from vibrident.fit.problem import BinProblem, Coordinates
from vibrident.fit.problem.time_domain import TimeProblem
from vibrident.physics.discretisation import Weights, method
from vibrident.physics.models import parse
from vibrident.physics.network.cell import Cell, run

TRUTH = {"sensitivity": 0.1, "natural_frequency": 650.0, "damping_ratio": 0.2, "delay": 3e-5}


def records(rng: np.random.Generator, gap: bool) -> list[Record]:
    made = []
    for samples, rate in ((900, 20e3), (2300, 51.2e3), (520, 20e3)):
        time = np.arange(samples) / rate
        tone = np.sin(2 * np.pi * 700 * time) + 0.3 * np.sin(2 * np.pi * 1900 * time + 1)
        valid = np.ones(samples, dtype=bool)
        if gap:
            valid[300:306] = False
        response = rng.standard_normal(samples) * 0.01 + 0.1 * np.roll(tone, 3)
        made.append(Record(f"{samples}", tone, response, rate, "random", valid=valid))
    return made


@pytest.fixture(params=["accelerometer", "accelerometer+delay", "velocity-pickup"])
def model_name(request: pytest.FixtureRequest) -> str:
    return request.param


def built(model_name: str, rng: np.random.Generator, gap: bool):
    model = parse(model_name)
    start = {**TRUTH, "generator_constant": 5.0}
    start = {name: start[name] for name in model.parameter_names}
    problem = TimeProblem.build(records(rng, gap), model, method("bandlimited"), "acceleration", start)
    return problem, Coordinates.at(model, {**start, "damping_ratio": 0.25}, (100.0, 5000.0))


@pytest.mark.parametrize("gap", [False, True])
@pytest.mark.quick("velocity-pickup-True")
def test_chunks_give_the_recursion_sample_by_sample(model_name: str, gap: bool, rng: np.random.Generator) -> None:
    """Each segment: the definition, run from the best initial state, plus an offset, explains the same prediction."""
    problem, coordinates = built(model_name, rng, gap)
    predicted = problem.predict(coordinates, coordinates.first)
    values = coordinates.values(coordinates.first)
    weights = problem.weights(values)
    for owner, segment_of, _lane in problem.pieces:
        record = problem.records[owner]
        rate = int(np.searchsorted(problem.intervals_s, record.sampling_interval_s))
        one = Weights(*(jnp.asarray(w)[rate] for w in weights))
        valid = record.mask
        reference = np.where(valid, np.asarray(record.reference) - np.asarray(record.reference)[valid].mean(), 0.0)
        delay = problem.frame.delay_s * record.sampling_rate_hz
        inputs = problem.layout.method.inputs(reference, valid, problem.layout.terms, delay).coefficients[segment_of]
        cell = Cell.from_weights(one)
        forced = np.asarray(run(cell, inputs))
        basis = [np.asarray(run(cell, 0.0 * inputs, jnp.eye(2)[i])) for i in range(2)]
        design = np.stack([*basis, np.ones(len(forced))], axis=1)
        used = valid[segment_of]
        found = np.linalg.lstsq(design[used], (record.response[segment_of] - forced)[used], rcond=None)[0]
        np.testing.assert_allclose(predicted[owner][segment_of], forced + design @ found, rtol=0, atol=1e-9)


@pytest.mark.parametrize("way", [BinProblem, TimeProblem])
def test_a_sensor_far_above_the_sampling_rate_keeps_its_response(way: type) -> None:
    """ωn Ts = 190: the poles are gone within a step, and the network is still exact."""
    model = parse("accelerometer")
    start = {"sensitivity": 0.1, "natural_frequency": 30e3, "damping_ratio": 0.01}
    time = np.arange(3000) / 1000.0
    reference = np.sin(2 * np.pi * 60 * time)
    response = model.frequency_response(start, np.array([60.0]))[0]
    exact = np.imag(response * np.exp(2j * np.pi * 60 * time))
    record = Record("slow", reference, exact, 1000.0, "random")
    problem = way.build([record], model, method("bandlimited"), "acceleration", start)
    coordinates = Coordinates.at(model, start, (10.0, 400.0))
    (predicted,) = problem.predict(coordinates, coordinates.first)
    used = np.isfinite(predicted)
    np.testing.assert_allclose(predicted[used], exact[used], rtol=0, atol=1e-9)
