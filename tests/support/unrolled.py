"""Random networks, records for them, and their residual and response by the unrolled network."""

import numpy as np

from vibrident.base.backend import jnp, lax
from vibrident.fit.problem.time_domain import _weights
from vibrident.physics.discretisation import Weights
from vibrident.physics.network.unroll import (
    Lanes,
    Nuisance,
    chain_states,
    fit_nuisance,
    free_response_rows,
    nuisance_response,
    per_lane,
    projection,
    respond_freely,
    respond_from_rest,
)


def random_weights(rng, states=2, terms=3, damping=0.03):
    """A stable oscillator in random coordinates of its states: |eigenvalues| = e^{−damping}."""
    angle = rng.uniform(0.1, 1.0)
    turn = np.exp(-damping) * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    phi = np.zeros((states, states))
    phi[:2, :2] = turn
    for k in range(2, states):
        phi[k, k] = 0.9**k
    basis = np.linalg.qr(rng.standard_normal((states, states)))[0] * rng.uniform(0.5, 2.0, states)
    return Weights(
        np.linalg.solve(basis, phi @ basis),
        rng.standard_normal((states, terms)),
        rng.standard_normal(states),
        rng.standard_normal(terms),
    )


def stacked(sets):
    """Sets of weights with a leading axis, as the unrolled network takes them."""
    return Weights(*(np.stack(parts) for parts in zip(*sets, strict=True)))


def cut(segments, chunk):
    """Lanes of ``chunk`` steps from segments (inputs, response, weight, rate), and a function that puts lanes back."""
    terms = segments[0][0].shape[1]
    lanes, owner = [], []
    for number, (inputs, response, weight, rate) in enumerate(segments):
        for start in range(0, len(response), chunk):
            span = slice(start, start + chunk)
            padding = chunk - len(response[span])
            lanes.append(
                (
                    np.pad(inputs[span], ((0, padding), (0, 0))),
                    np.pad(response[span] * weight[span], (0, padding)),
                    np.pad(weight[span], (0, padding)),
                    start == 0,
                    number,
                    rate,
                )
            )
            owner.append(number)
    inputs, response, weight, first, segment, rates = zip(*lanes, strict=True)
    lanes_of_chunks = Lanes(
        np.moveaxis(np.stack(inputs), 0, -1),
        np.stack(response, axis=1),
        np.stack(weight, axis=1),
        np.array(first),
        np.array(segment),
        np.array(rates),
    )
    assert lanes_of_chunks.inputs.shape == (chunk, terms, len(lanes))

    def back(values):
        values = np.asarray(values)
        joined = [
            np.concatenate([values[:, m] for m in np.flatnonzero(np.array(owner) == s)]) for s in range(len(segments))
        ]
        return [series[: len(segment[1])] for series, segment in zip(joined, segments, strict=True)]

    return lanes_of_chunks, back


def time_residual(weights, lanes, noise, segments):
    """Weighted residual of the network with these weights, shape (L·M,), each initial state and offset eliminated.

    ``noise``: standard deviation of the response noise, by lane.
    """
    frozen = lax.stop_gradient(weights)
    p = projection(frozen, lanes, segments)
    zero = Nuisance(jnp.zeros((segments, weights.output.shape[-1])), jnp.zeros(segments))
    nuisance = fit_nuisance(p, lanes, lanes.response - respond(frozen, lanes, zero))
    raw = (lanes.response - respond(weights, lanes, nuisance)) * lanes.weight
    imitated = nuisance_response(p, lanes, fit_nuisance(p, lanes, raw))
    return ((raw - imitated) * lanes.weight / noise).ravel()


def physical_residual(z, coordinates, layout, data, noise):
    """The same of the tied network, weights from the physics at coordinates ``z``."""
    lanes, intervals, fractions, delay = data
    weights = _weights(coordinates.physical(z), layout, intervals, fractions, delay)
    return time_residual(weights, lanes, noise, layout.segments)


def respond(weights: Weights, lanes: Lanes, nuisance: Nuisance):
    """Response of every lane, shape (L, M). ``weights`` carry a leading axis: one set a sampling interval."""
    forced, ends = respond_from_rest(weights, lanes)
    rows, power = free_response_rows(weights, lanes.response.shape[0])
    starts = chain_states(per_lane(power, lanes.rate), ends, lanes.first, nuisance.state[lanes.segment].T)
    return forced + respond_freely(rows, lanes.rate, starts) + nuisance.offset[lanes.segment]
