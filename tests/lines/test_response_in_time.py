"""The response in time without a compiler against the compiled network's: the same numbers to 1e-9."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support.line_sensors import values_of

from vibrident.discretize import method
from vibrident.errors import InputError, ModelError
from vibrident.models import parse
from vibrident.problem import Coordinates, LineProblem
from vibrident.problem.time_domain import TimeProblem
from vibrident.records import Record
from vibrident.simulation import simulate, with_noise


def records_of(model, samples=1503):
    """Random motion with an offset, a gap in the response, clipped samples of the reference, and another rate."""
    made = []
    for rate in (10e3, 8e3):
        motion = simulate(
            (model, values_of(model)), "random", frequencies_hz=[20.0, 2000.0], sampling_rate_hz=rate, samples=samples
        )
        made.append(with_noise(motion, response_noise=0.02, seed=6).records[0])
    valid = np.ones(samples, dtype=bool)
    valid[[300, 301, 900]] = False
    first = replace(made[0], response=made[0].response + 0.3, valid=valid, reference_valid=np.arange(samples) != 700)
    return [first, made[1]]


def assert_as_compiled(records, name, quantity, step):
    model = parse(name)
    values = {key: value * 1.02 for key, value in values_of(name).items()}
    problem = TimeProblem.build(records, model, method(step), quantity, values)
    coordinates = Coordinates.at(model, values, (1e-9, 1e12))
    expected = problem.predict(coordinates, coordinates.first)
    at_lines = LineProblem.build(records, model, method(step), quantity, values)
    found = at_lines.predict(coordinates, coordinates.first)
    for ours, theirs, record in zip(found, expected, records, strict=True):
        np.testing.assert_array_equal(np.isnan(ours), np.isnan(theirs))
        assert np.isfinite(ours).sum() > 0.8 * record.samples
        np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-9 * float(np.nanmax(np.abs(theirs))))


@pytest.mark.parametrize(
    ("name", "quantity", "step"),
    [
        ("accelerometer+mode2+highpass+delay", "acceleration", "bandlimited"),
        ("velocity-pickup+delay", "displacement", "bandlimited"),
        ("accelerometer+delay", "acceleration", "tustin"),
    ],
)
@pytest.mark.quick("velocity-pickup+delay-displacement-bandlimited")
def test_the_response_is_the_compiled_networks(name, quantity, step):
    assert_as_compiled(records_of("accelerometer+delay"), name, quantity, step)


def test_a_free_decay_has_no_input():
    decay = simulate("paper", "decay", sampling_rate_hz=10e3, samples=600).records
    assert_as_compiled(list(decay), "accelerometer", "acceleration", "bandlimited")


def test_records_too_short_and_models_without_network_are_refused():
    noise = np.random.default_rng(0).standard_normal((2, 12))
    short = [Record("short", noise[0], noise[1], 10e3, valid=np.arange(12) < 6)]
    with pytest.raises(InputError, match="long enough"):
        LineProblem.build(short, parse("accelerometer"), method("euler"), "acceleration", values_of("accelerometer"))
    values = values_of("accelerometer") | {"boxcar_length": 1e-3}
    with pytest.raises(ModelError, match="no network"):
        LineProblem.build(short, parse("accelerometer+boxcar"), method("euler"), "acceleration", values)
