"""The residual in time: measured response minus the unrolled network's, weighted by each record's noise.

    r_k = (y_k − ŷ_k(θ; x0, b)) / σ_record

with the initial state x0 and the offset b of every segment eliminated exactly. The derivative is the variable
projection of Kaufman (1975): differentiate with x0 and b held, then take out what they could imitate. Its
Gauss–Newton step is the joint step over all unknowns, and its gradient is the exact gradient.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibrident.backend import jax, jnp, lax
from vibrident.discretize import Method, Weights
from vibrident.discretize.forced import ForcedWeights, accuracy, forced_weights
from vibrident.errors import InputError, ModelError
from vibrident.models import SensorModel
from vibrident.models.state_space import realise
from vibrident.network.forced import forced_normal, forced_response
from vibrident.network.sensitivity import Normal, normal_equations
from vibrident.network.unroll import (
    Lanes,
    Nuisance,
    fit_nuisance,
    nuisance_response,
    projection,
    respond,
)
from vibrident.problem.coordinates import Coordinates
from vibrident.records import BoolArray, FloatArray, Quantity, Record

#: Steps a chunk. Long enough that few chunks need their state passed on, short enough that a vector loop pays.
CHUNK = 256
#: A force is that of a response of at most this many times the largest measured.
BEYOND = 10.0


@dataclass(frozen=True)
class Layout:
    """What of the problem's shape is fixed when it is compiled."""

    model: SensorModel
    method: Method
    quantity: Quantity
    terms: int
    order: int
    segments: int
    nodes: int = 0
    rounds: tuple[int, int] = (0, 0)


@dataclass(frozen=True, eq=False)
class TimeProblem:
    """Records of one sensor, cut into lanes, ready for any estimator that works in time.

    Attributes:
        layout: model, discretisation, quantity, number of inputs, number of segments.
        records: the records, in order.
        lanes: their steps.
        intervals_s: distinct sampling intervals, shape (R,).
        fractions: read-out fraction at ``delay_s``, shape (R,).
        delay_s: delay at which the inputs were interpolated.
        record_of_segment: record of each real segment; segments beyond them are padding.
        pieces: record, samples and first lane of each segment.
    """

    layout: Layout
    records: tuple[Record, ...]
    lanes: Lanes
    intervals_s: FloatArray
    fractions: FloatArray
    delay_s: float
    record_of_segment: np.ndarray
    pieces: tuple[tuple[int, slice, int], ...]

    @classmethod
    def build(
        cls,
        records: Sequence[Record],
        model: SensorModel,
        method: Method,
        quantity: Quantity,
        start: dict[str, float],
    ) -> TimeProblem:
        """Interpolate the inputs at the expected delay and cut the records into lanes.

        Args:
            records: at least one; a record without reference is a free decay, its input is zero.
            model: the sensor model.
            method: the discretisation.
            quantity: what the reference is.
            start: start values of the parameters; the natural frequency and damping set how many inputs a step
                are needed, the delay where they are interpolated.

        Raises:
            InputError: no record is long enough.
        """
        if not model.has_network:
            raise ModelError(
                "This model has no network: it is not a rational function.",
                expected="a model without 'boxcar'",
                found=repr(model.name),
                where="estimator 'ipnn'",
                remedy="use the estimator 'ml', with sine records or a table",
            )
        delay = float(np.asarray(model.delay_s(start))) if model.has_delay else 0.0
        intervals, rate = np.unique([r.sampling_interval_s for r in records], return_inverse=True)
        system = model.rational(start, quantity)
        order = len(system.denominator) - 1
        direct = len(system.numerator) > order  # the response then contains the reference itself
        fastest = 2.0 * np.pi * start["natural_frequency"] * _fastest(start["damping_ratio"])
        terms = max(method.terms(fastest * ts, direct=direct) for ts in intervals)
        pieces, fractions = [], np.zeros(len(intervals))
        for index, record in enumerate(records):
            reference = np.zeros(record.samples) if record.reference is None else np.array(record.reference)
            if record.reference is not None and model.is_linear:  # else it says where on its curve the spring works
                reference -= reference[record.mask].mean() if record.mask.any() else 0.0
            valid = record.mask if record.reference is not None else np.ones(record.samples, dtype=bool)
            step = method.inputs(reference, valid, terms, delay * record.sampling_rate_hz)
            fractions[rate[index]] = step.fraction
            for run in _runs(step.usable):
                if np.sum(record.mask[run]) > 2 * (order + 1):
                    pieces.append((index, run, step.coefficients[run]))
        if not pieces:
            raise InputError(
                "No record is long enough for the network.",
                expected=f"more than {2 * (order + 1)} samples that can be used after interpolation",
                found=f"{max(r.samples for r in records)} samples in the longest record",
                where="records",
                remedy="use longer records, or the estimator 'ml'",
            )
        lanes, first_lanes = _cut(pieces, records, rate, terms)
        nodes, rounds = (0, (0, 0)) if model.is_linear else accuracy(fastest * float(np.max(intervals)))
        layout = Layout(model, method, quantity, terms, order, _bucket(len(pieces) + 1), nodes, rounds)
        owners = np.array([piece[0] for piece in pieces])
        placed = tuple((p[0], p[1], lane) for p, lane in zip(pieces, first_lanes, strict=True))
        return cls(layout, tuple(records), lanes, intervals, fractions, delay, owners, placed)

    @property
    def degrees_of_freedom(self) -> FloatArray:
        """Samples less initial states and offset, for every record, shape (records,)."""
        per_lane = np.sum(self.lanes.weight, axis=0)
        owners = self.by_lane(np.arange(len(self.records)), fill=0).astype(int)  # padding weighs nothing
        counts = np.bincount(owners, weights=per_lane, minlength=len(self.records))
        segments = np.bincount(self.record_of_segment, minlength=len(self.records))
        return np.asarray(counts - (self.layout.order + 1.0) * segments, dtype=np.float64)

    @functools.cached_property
    def data(self) -> tuple[Any, ...]:
        """Arrays that the residual needs beside the parameters and the noise, on the device."""
        return jax.device_put(self._arrays())

    def _arrays(self) -> tuple[Any, ...]:
        return self.lanes, self.intervals_s, self.fractions, self.delay_s

    def by_lane(self, per_record: np.ndarray, fill: float = 1.0) -> np.ndarray:
        """Spread one value a record over its lanes, shape (M,); ``fill`` for padding lanes."""
        spread = np.append(np.asarray(per_record)[self.record_of_segment], fill)
        return spread[np.minimum(np.asarray(self.lanes.segment), len(self.record_of_segment))]

    @functools.cached_property
    def response_size(self) -> float:
        """Largest distance of a valid response sample from its record's mean, response unit."""
        valid = [record.response[record.mask] for record in self.records]
        return max((float(np.max(np.abs(y - y.mean()))) for y in valid if y.size), default=0.0) or 1.0

    def weights(self, parameters: dict[str, Any]) -> Weights:
        """Network weights of the sensor's linear part, one set a sampling interval (leading axis R)."""
        return _compiled_weights(parameters, self.layout, self.intervals_s, self.fractions, self.delay_s)

    def predict(self, coordinates: Coordinates, z: Any) -> list[FloatArray]:
        """Predicted response of every record, NaN where the network gives none, with the best initial states."""
        noise = jnp.ones(self.lanes.segment.shape)
        return self.by_record(evaluate(jnp.asarray(z), coordinates, self.layout, self.data, noise).response)

    def by_record(self, lanes_values: Any) -> list[FloatArray]:
        """Put values of the lanes, shape (L, M), back in the order of the records' samples; NaN elsewhere."""
        flat = np.asarray(lanes_values).T.ravel()  # lane after lane
        ordered = [np.full(record.samples, np.nan) for record in self.records]
        for owner, run, lane in self.pieces:
            ordered[owner][run] = flat[lane * CHUNK : lane * CHUNK + run.stop - run.start]
        return ordered


def _forced(parameters: dict[str, Any], layout: Layout, intervals: Any, fractions: Any, delay: Any) -> ForcedWeights:
    blocks = layout.model.blocks(parameters, layout.quantity)
    late = layout.model.delay_s(parameters) - delay if layout.model.has_delay else 0.0

    def one(ts: Any, fraction: Any) -> ForcedWeights:
        return forced_weights(layout.method, blocks, ts, fraction - late / ts, layout.terms, layout.nodes)

    return jax.vmap(one)(jnp.asarray(intervals), jnp.asarray(fractions))


def _weights(parameters: dict[str, Any], layout: Layout, intervals: Any, fractions: Any, delay: Any) -> Weights:
    system = realise(layout.model.rational(parameters, layout.quantity))
    if not layout.model.has_delay:
        return jax.vmap(lambda ts: layout.method.weights(system, ts, 0.0, layout.terms))(jnp.asarray(intervals))
    late = layout.model.delay_s(parameters) - delay

    def one(ts: Any, fraction: Any) -> Weights:
        return layout.method.weights(system, ts, fraction - late / ts, layout.terms)

    return jax.vmap(one)(jnp.asarray(intervals), jnp.asarray(fractions))


_compiled_weights = jax.jit(_weights, static_argnames=("layout",))


def time_residual(weights: Weights, lanes: Lanes, noise: Any, segments: int) -> Any:
    """Weighted residual of the network with these weights, shape (L·M,); see the module's text.

    Args:
        weights: one set a sampling interval (leading axis R); may be traced, tied to the physics or free.
        lanes: the data.
        noise: standard deviation of the response noise, by lane, shape (M,).
        segments: number of segments.
    """
    frozen = lax.stop_gradient(weights)
    p = projection(frozen, lanes, segments)
    zero = Nuisance(jnp.zeros((segments, weights.output.shape[-1])), jnp.zeros(segments))
    nuisance = fit_nuisance(p, lanes, lanes.response - respond(frozen, lanes, zero))
    raw = (lanes.response - respond(weights, lanes, nuisance)) * lanes.weight
    imitated = nuisance_response(p, lanes, fit_nuisance(p, lanes, raw))
    return ((raw - imitated) * lanes.weight / noise).ravel()


def physical_residual(z: Any, coordinates: Coordinates, layout: Layout, data: tuple[Any, ...], noise: Any) -> Any:
    """``time_residual`` of the tied network, weights from the physics at coordinates ``z``; shape (L·M,)."""
    lanes, intervals, fractions, delay = data
    weights = _weights(coordinates.physical(z), layout, intervals, fractions, delay)
    return time_residual(weights, lanes, noise, layout.segments)


def physical_normal(z: Any, coordinates: Coordinates, layout: Layout, data: tuple[Any, ...], noise: Any) -> Normal:
    """Accumulated normal equations of ``physical_residual`` at ``z``."""
    lanes, intervals, fractions, delay = data
    if not layout.model.is_linear:
        return _nonlinear_normal(z, coordinates, layout, data, noise)

    def tied(z: Any) -> Weights:
        return _weights(coordinates.physical(z), layout, intervals, fractions, delay)

    return normal_equations(tied(z), jax.jacfwd(tied)(z), lanes, noise, layout.segments)


def _nonlinear_normal(z: Any, coordinates: Coordinates, layout: Layout, data: tuple[Any, ...], noise: Any) -> Normal:
    lanes, *where = data
    # In the padding behind a record the reference jumps to zero, and a step of Newton's may go too far: what a spring
    # would do to a response that was never seen must not drown the rest.
    largest = BEYOND * jnp.max(jnp.abs(lanes.response))
    largest = jnp.where(largest > 0.0, largest, jnp.inf)

    def simulate(z: Any, starts: Any) -> tuple[Any, Any]:
        parameters = coordinates.physical(z)

        def force(response: Any) -> Any:
            return layout.model.force(parameters, jnp.clip(response, -largest, largest))

        return forced_response(_forced(parameters, layout, *where), force, lanes, starts, layout.rounds)

    linear = _forced(coordinates.physical(z), layout, *where).linear
    return forced_normal(simulate, z, linear, lanes, noise, layout.segments)


def _fastest(damping: float) -> float:
    """Largest |pole| over ωn: one when underdamped, δ + √(δ² − 1) when not."""
    return damping + np.sqrt(damping * damping - 1.0) if damping > 1.0 else 1.0


#: Compiled, and the one large program of the package: everything that looks at records in time goes through it.
evaluate = jax.jit(physical_normal, static_argnames=("layout",))


def _bucket(count: int) -> int:
    """The next number of the form m·2ᵏ with 8 ≤ m ≤ 16: at most an eighth more."""
    step = max(1, 1 << (max(count - 1, 1).bit_length() - 4)) if count > 16 else 1
    return -(-count // step) * step


def _runs(usable: BoolArray) -> list[slice]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], usable, [False]]).astype(np.int8)))
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _cut(
    pieces: list[tuple[int, slice, FloatArray]], records: Sequence[Record], rate: np.ndarray, terms: int
) -> tuple[Lanes, list[int]]:
    """Cut segments into chunks of CHUNK steps, the last one padded with weight zero; also each one's first lane."""
    counts = [-(-(piece[1].stop - piece[1].start) // CHUNK) for piece in pieces]
    total = _bucket(sum(counts))  # padded, so that calibrations of about the same size share one compiled program
    padding = len(pieces)
    inputs = np.zeros((total, CHUNK, terms))
    response, weight = np.zeros((total, CHUNK)), np.zeros((total, CHUNK))
    first, segment, rates = np.ones(total, dtype=bool), np.full(total, padding), np.zeros(total, dtype=int)
    lane = 0
    for number, ((index, run, coefficients), count) in enumerate(zip(pieces, counts, strict=True)):
        steps = run.stop - run.start
        mine = slice(lane, lane + count)
        mask = records[index].mask[run].astype(float)
        inputs[mine].reshape(-1, terms)[:steps] = coefficients
        response[mine].reshape(-1)[:steps] = records[index].response[run] * mask
        weight[mine].reshape(-1)[:steps] = mask
        first[mine], segment[mine], rates[mine] = False, number, rate[index]
        first[lane] = True
        lane += count
    lanes = Lanes(
        np.ascontiguousarray(np.moveaxis(inputs, 0, -1)),
        np.ascontiguousarray(response.T),
        np.ascontiguousarray(weight.T),
        first,
        segment,
        rates,
    )
    return lanes, [sum(counts[:i]) for i in range(len(counts))]
