"""The network: its definition against filters written elsewhere, its unrolling in chunks against the definition."""

import functools

import numpy as np
import pytest
from scipy.signal import lfilter, ss2tf
from tests.support.discrete_sensors import recursion
from tests.support.unrolled import cut, random_weights, respond, stacked

from vibrident.base.backend import jax, jnp
from vibrident.physics.discretisation import Weights
from vibrident.physics.network.cell import Cell, run
from vibrident.physics.network.unroll import Lanes, Nuisance, fit_nuisance, nuisance_response, projection

_respond = jax.jit(respond)


def test_the_cell_is_a_digital_filter(rng):
    """With one input, the unrolled network is SciPy's ``lfilter`` with the transfer function C (z − Φ)⁻¹ Γ + D."""
    weights = random_weights(rng, terms=1)
    numerator, denominator = ss2tf(weights.transition, weights.drive, weights.output[None], weights.feedthrough[None])
    inputs = rng.standard_normal(500)
    expected = lfilter(numerator[0], denominator, inputs)
    found = run(Cell.from_weights(weights), jnp.asarray(inputs)[:, None])
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.max(np.abs(expected)))


@pytest.mark.parametrize(("states", "terms"), [(1, 1), (2, 4), (3, 2)])
def test_the_cell_is_the_recursion(states, terms, rng):
    weights = (
        Weights(np.array([[0.8]]), rng.standard_normal((1, terms)), rng.standard_normal(1), rng.standard_normal(terms))
        if states == 1
        else random_weights(rng, states, terms)
    )
    inputs, state = rng.standard_normal((200, terms)), rng.standard_normal(states)
    expected = recursion(weights, inputs, state)
    found = run(Cell.from_weights(weights), jnp.asarray(inputs), jnp.asarray(state))
    np.testing.assert_allclose(found, expected, atol=1e-11 * np.max(np.abs(expected)))


def test_the_layers_have_the_papers_neurons():
    """Euler, second order: input 1, feedback 2, hidden 2, feedforward 1, output 1; no bias."""
    wn, delta, ts = 4096.4, 0.182, 1 / 51200
    euler = Weights(
        np.array([[1, ts * wn], [-wn * ts, 1 - 2 * delta * wn * ts]]),
        np.array([[0], [wn * ts]]),
        np.eye(2)[0],
        np.zeros(1),
    )
    cell = Cell.from_weights(euler)
    assert [np.shape(w) for w in cell[:4]] == [(2, 1), (2,), (2, 2), (1,)]
    hidden, output = cell(jnp.zeros(2), jnp.zeros(1))
    assert not np.any(np.asarray(hidden))
    assert float(output) == 0.0


def test_tanh_breaks_the_equivalence(rng):
    """Doubled inputs double the linear network's output, to rounding, and not that of the paper's option."""
    cell = Cell.from_weights(random_weights(rng, terms=1))
    inputs = jnp.asarray(rng.standard_normal((300, 1)))
    linear, squashed = run(cell, inputs), run(cell._replace(activation=jnp.tanh), inputs)
    scale = np.max(np.abs(linear))
    assert np.max(np.abs(linear - squashed)) > 0.1 * scale
    np.testing.assert_allclose(run(cell, 2 * inputs), 2 * linear, atol=1e-12 * scale)
    assert np.max(np.abs(run(cell._replace(activation=jnp.tanh), 2 * inputs) - 2 * squashed)) > 0.1 * scale
    small = 1e-7 * inputs  # tanh x = x − x³/3: the option is linear for small signals
    np.testing.assert_allclose(run(cell._replace(activation=jnp.tanh), small), 1e-7 * linear, atol=1e-16 * scale)


def a_few_records(rng, terms=3):
    """Segments of unequal length at two sampling rates, some samples of them without weight."""
    sets = [random_weights(rng, terms=terms) for _ in range(2)]
    segments = []
    for steps, rate in ((700, 0), (64, 1), (65, 0), (9, 1), (333, 1)):
        weight = np.ones(steps)
        weight[rng.integers(0, steps, steps // 20)] = 0.0
        segments.append((rng.standard_normal((steps, terms)), rng.standard_normal(steps), weight, rate))
    return sets, segments


@pytest.mark.parametrize("chunk", [1, 7, 64, 256, 1000])
def test_chunks_are_the_recursion_sample_by_sample(chunk, rng):
    """Whatever the chunk length, records of unequal length and rate come out as the recursion gives them (1e-12)."""
    sets, segments = a_few_records(rng)
    lanes, back = cut(segments, chunk)
    states, offsets = rng.standard_normal((len(segments), 2)), rng.standard_normal(len(segments))
    found = back(_respond(stacked(sets), lanes, Nuisance(jnp.asarray(states), jnp.asarray(offsets))))
    for series, (inputs, _, _, rate), state, offset in zip(found, segments, states, offsets, strict=True):
        expected = recursion(sets[rate], inputs, state, offset)
        np.testing.assert_allclose(series, expected, atol=1e-12 * np.max(np.abs(expected)))


def test_one_set_of_weights_for_all(rng):
    """The shorter path for a single sampling rate gives the same."""
    sets, segments = a_few_records(rng)
    segments = [(*segment[:3], 0) for segment in segments]
    lanes, back = cut(segments, 64)
    states, offsets = rng.standard_normal((len(segments), 2)), rng.standard_normal(len(segments))
    nuisance = Nuisance(jnp.asarray(states), jnp.asarray(offsets))
    one = back(_respond(stacked(sets[:1]), lanes, nuisance))
    two = back(_respond(stacked(sets), lanes, nuisance))
    for a, b in zip(one, two, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12 * np.max(np.abs(b)))


def test_a_gap_makes_two_segments_with_states_of_their_own(rng):
    """A record cut in two at a gap: each part with the state that the whole recursion has there."""
    weights = random_weights(rng)
    inputs = rng.standard_normal((300, 3))
    whole = recursion(weights, inputs, np.zeros(2))
    phi, gamma = weights.transition, weights.drive
    state = np.zeros(2)
    for u in inputs[:170]:
        state = phi @ state + gamma @ u
    parts = [(inputs[:150], whole[:150], np.ones(150), 0), (inputs[170:], whole[170:], np.ones(130), 0)]
    lanes, back = cut(parts, 64)
    nuisance = Nuisance(jnp.asarray(np.stack([np.zeros(2), state])), jnp.zeros(2))
    first, second = back(_respond(stacked([weights]), lanes, nuisance))
    np.testing.assert_allclose(first, whole[:150], atol=1e-11)
    np.testing.assert_allclose(second, whole[170:], atol=1e-11)


@functools.partial(jax.jit, static_argnames=("segments",))
def _nuisance(weights, lanes, segments):
    p = projection(weights, lanes, segments)
    zero = Nuisance(jnp.zeros((segments, 2)), jnp.zeros(segments))
    found = fit_nuisance(p, lanes, lanes.response - respond(weights, lanes, zero))
    return found, nuisance_response(p, lanes, found)


@pytest.mark.parametrize("chunk", [32, 256])
def test_initial_states_and_offsets_are_found_exactly(chunk, rng):
    """Made with known states and offsets, some samples missing: least squares gives them back to 1e-10."""
    sets, segments = a_few_records(rng)
    states, offsets = rng.standard_normal((len(segments), 2)), rng.standard_normal(len(segments))
    made = [
        (inputs, recursion(sets[rate], inputs, state, offset), weight, rate)
        for (inputs, _, weight, rate), state, offset in zip(segments, states, offsets, strict=True)
    ]
    lanes, _ = cut(made, chunk)
    found, _ = _nuisance(stacked(sets), lanes, len(made))
    np.testing.assert_allclose(found.state, states, atol=1e-10)
    np.testing.assert_allclose(found.offset, offsets, atol=1e-10)


def test_the_nuisance_is_the_dense_least_squares(rng):
    """Against NumPy's ``lstsq`` on the columns C Φᵏ and 1, for responses that the network does not explain."""
    sets, segments = a_few_records(rng)
    lanes, back = cut(segments, 32)
    found, imitated = _nuisance(stacked(sets), lanes, len(segments))
    for number, (inputs, response, weight, rate) in enumerate(segments):
        free = np.stack([recursion(sets[rate], 0 * inputs, e) for e in np.eye(2)] + [np.ones(len(inputs))], axis=1)
        target = response - recursion(sets[rate], inputs, np.zeros(2))
        solution, *_ = np.linalg.lstsq(free * weight[:, None], target * weight, rcond=None)
        np.testing.assert_allclose(found.state[number], solution[:2], atol=1e-9)
        np.testing.assert_allclose(found.offset[number], solution[2], atol=1e-9)
        np.testing.assert_allclose(back(imitated)[number], free @ solution, atol=1e-9)


def test_a_state_that_is_gone_in_one_step_does_no_harm(rng):
    """Φ = 0 in one direction: nothing can be said of its start, and nothing is divided by."""
    weights = Weights(np.array([[0.9, 0.0], [0.0, 0.0]]), np.ones((2, 1)), np.array([1.0, 0.0]), np.zeros(1))
    inputs = rng.standard_normal((100, 1))
    lanes, _ = cut([(inputs, recursion(weights, inputs, [0.5, 3.0]), np.ones(100), 0)], 32)
    found, _ = _nuisance(stacked([weights]), lanes, 1)
    assert np.all(np.isfinite(found.state))
    assert float(found.state[0, 0]) == pytest.approx(0.5, abs=1e-12)


def test_lanes_are_a_plain_tuple_of_arrays(rng):
    lanes, _ = cut(a_few_records(rng)[1], 64)
    assert isinstance(lanes, Lanes)
    assert lanes.inputs.shape == (64, 3, lanes.segment.shape[0])
