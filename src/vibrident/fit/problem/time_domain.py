"""The residual in time: measured response less the unrolled network's, over each record's noise.

    r_k = (y_k − ŷ_k(θ; x0, b)) / σ_record

with the initial state x0 and the offset b of every segment eliminated exactly. The derivative is
the variable projection of Kaufman (1975): differentiate with x0 and b held, then remove the
component that they could imitate. Its Gauss–Newton step is the joint step over all unknowns, and
its gradient is the exact gradient.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibrident.base.backend import jax, jnp, release_kernels
from vibrident.base.participants import takes_part
from vibrident.data.records import FloatArray, Quantity, Record
from vibrident.fit.bins import RecordBins, driven_by, usable_steps
from vibrident.fit.problem.coordinates import Coordinates
from vibrident.fit.problem.cutting import Piece, bucket, cut
from vibrident.fit.problem.network_problem import Frame, NetworkProblem
from vibrident.fit.response.rest import offset_of_reference
from vibrident.fit.response.transform import line_counts
from vibrident.physics.discretisation import Method, Weights
from vibrident.physics.discretisation.forced import ForcedWeights, accuracy, forced_weights
from vibrident.physics.models import SensorModel
from vibrident.physics.models.state_space import realise
from vibrident.physics.network.forced import forced_normal_equations, forced_response
from vibrident.physics.network.sensitivity import NormalEquations, normal_equations
from vibrident.physics.network.unroll import Lanes

jax.tree_util.register_dataclass(
    Coordinates, data_fields=["start", "band_hz", "response_size"], meta_fields=["model"]
)

#: Steps a chunk: long enough that few chunks need their state passed on, short enough that a vector
#: loop pays.
CHUNK = 256
_builds = itertools.count(1)


@dataclass(frozen=True)
class Layout:
    """Static shape of the problem: all that is fixed when its kernel is compiled."""

    model: SensorModel
    method: Method
    quantity: Quantity
    terms: int
    order: int
    segments: int
    nodes: int = 0
    rounds: tuple[int, int] = (0, 0)


@dataclass(frozen=True, eq=False)
class TimeProblem(NetworkProblem):
    """Records of one sensor cut into lanes, for any estimator that works in time.

    Attributes:
        layout: model, discretisation, quantity, number of inputs, number of segments.
        lanes: steps of the records.
        intervals_s: distinct sampling intervals, shape (R,).
        fractions: read-out fraction at ``delay_s``, shape (R,).
        pieces: the real segments; those beyond them are padding.
    """

    layout: Layout
    lanes: Lanes
    intervals_s: FloatArray
    fractions: FloatArray
    pieces: tuple[Piece, ...]

    @classmethod
    def of_frame(cls, records: tuple[Record, ...], frame: Frame) -> TimeProblem:
        """Return the problem of records cut into lanes.

        Raises:
            InputError: no record is long enough.
        """
        takes_part("jax", "jaxlib")
        if next(_builds) % 100 == 0:  # now and then, check the memory maps of compiled kernels
            release_kernels()
        model = frame.model
        method = frame.method
        intervals, rate = np.unique([r.sampling_interval_s for r in records], return_inverse=True)
        offsets: Sequence[float | None] = [None] * len(records)
        if not model.is_linear:  # its spring depends on the rest position
            offsets = frame.reference_offsets or [offset_of_reference(r) for r in records]
        drives = [
            driven_by(record, model, frame.factor_values, offset)
            for record, offset in zip(records, offsets, strict=True)
        ]
        delays = [frame.delay_s * record.sampling_rate_hz for record in records]
        steps = [
            usable_steps(method.inputs(drive.signals[0], drive.valid, frame.terms, delay), record)
            for drive, delay, record in zip(drives, delays, records, strict=True)
        ]
        fractions = np.zeros(len(intervals))
        fractions[rate] = [step.fraction for step in steps]
        lanes, pieces = cut(records, steps, rate, frame.fewest, CHUNK)
        if not pieces:
            raise frame.too_short(records)
        nodes = 0
        rounds = (0, 0)
        if not model.is_linear:
            nodes, rounds = accuracy(frame.fastest * float(np.max(intervals)))
        segments = bucket(len(pieces) + 1)
        layout = Layout(
            model, method, frame.quantity, frame.terms, frame.order, segments, nodes, rounds
        )
        return cls(records, frame, layout, lanes, intervals, fractions, tuple(pieces))

    def at_reference_offsets(self, offsets: FloatArray) -> TimeProblem:
        """Return the problem with offsets of the references, in their unit, shape (records,)."""
        frame = replace(self.frame, reference_offsets=tuple(offsets.tolist()))
        return self.of_frame(self.records, frame)

    @functools.cached_property
    def record_of_segment(self) -> np.ndarray:
        """Return the record index of each real segment."""
        return np.array([piece.record for piece in self.pieces])

    @property
    def degrees_of_freedom(self) -> FloatArray:
        """Return the samples of each record less initial states and offset, shape (records,)."""
        freedom = np.zeros(len(self.records))
        for number, run, _ in self.pieces:
            freedom[number] += self.records[number].mask[run].sum() - (self.frame.order + 1.0)
        return freedom

    @functools.cached_property
    def data(self) -> tuple[Any, ...]:
        """Return the arrays of the residual, without parameters and noise, on the device."""
        return jax.device_put((self.lanes, self.intervals_s, self.fractions, self.frame.delay_s))

    def by_lane(self, per_record: np.ndarray, fill: float = 1.0) -> np.ndarray:
        """Return one value a record spread over its lanes, shape (M,).

        Padding lanes have the value ``fill``.
        """
        spread = np.append(np.asarray(per_record)[self.record_of_segment], fill)
        return spread[np.minimum(np.asarray(self.lanes.segment), len(self.record_of_segment))]

    def weights(self, values: Mapping[str, Any]) -> Weights:
        """Return the network weights of the linear part, by sampling interval (leading axis R)."""
        return _compiled_weights(
            dict(values), self.layout, self.intervals_s, self.fractions, self.frame.delay_s
        )

    def normal(self, z: FloatArray, coordinates: Coordinates, noise: FloatArray) -> NormalEquations:
        """Return the normal equations at coordinates ``z``.

        Args:
            z: shape (parameters,).
            coordinates: of the parameters.
            noise: standard deviation of each record, shape (records,).
        """
        by_lane = jnp.asarray(self.by_lane(noise))
        return evaluate(jnp.asarray(z), coordinates, self.layout, self.data, by_lane)

    def squares(self, normal: NormalEquations, noise: FloatArray) -> FloatArray:
        """Return the unweighted sum of squares of each record's residual, shape (records,)."""
        # Segments beyond the real ones are padding.
        squares = np.asarray(normal.squares)[: len(self.record_of_segment)]
        return np.bincount(self.record_of_segment, squares, len(self.records)).astype(float)

    def record_noise(self, normal: Any, noise: FloatArray) -> FloatArray:
        """Return the standard deviation of each record's residual, shape (records,).

        Args:
            normal: equations that are weighted by ``noise``.
            noise: standard deviation of each record, shape (records,).
        """
        mean = self.squares(normal, noise) / np.maximum(self.degrees_of_freedom, 1.0)
        return np.maximum(np.sqrt(mean), self.noise_floor)

    def lines(self, z: FloatArray, coordinates: Coordinates, noise: FloatArray) -> list[RecordBins]:
        """Return residual and slopes of every record at the bins of its transform.

        Both are in units of the noise of the record.
        """
        normal = self.normal(z, coordinates, noise)
        responses = self.by_record(normal.response)
        columns = [self.by_record(column) for column in normal.columns]
        bins = []
        for index, (record, predicted) in enumerate(zip(self.records, responses, strict=True)):
            used = record.mask & np.isfinite(predicted)
            signals = [
                (record.response - predicted) / noise[index],
                *(column[index] for column in columns),
            ]
            lines = np.fft.rfft(np.where(used, signals, 0.0), axis=1)
            counts = line_counts(record.samples)
            floor = float((self.noise_floor[index] / noise[index]) ** 2)
            bins.append(RecordBins(lines[0], lines[1:], used, counts, floor))
        return bins

    def predict(self, coordinates: Coordinates, z: Any) -> list[FloatArray]:
        """Return the predicted response of every record, with the best initial states.

        NaN where the network gives no value.
        """
        return self.by_record(self.normal(z, coordinates, np.ones(len(self.records))).response)

    def by_record(self, lanes_values: Any) -> list[FloatArray]:
        """Return values of the lanes, shape (L, M), in the order of the records' samples.

        NaN elsewhere.
        """
        values = np.asarray(lanes_values)
        ordered = [np.full(record.samples, np.nan) for record in self.records]
        for number, run, lane in self.pieces:
            steps = run.stop - run.start
            ordered[number][run] = values[:, lane : lane - (-steps // CHUNK)].T.reshape(-1)[:steps]
        return ordered


def _forced(
    parameters: dict[str, Any], layout: Layout, intervals: Any, fractions: Any, delay: Any
) -> ForcedWeights:
    """Return the weights of a nonlinear network at each sampling interval (leading axis)."""
    blocks = layout.model.blocks(parameters, layout.quantity)
    delay_change = layout.model.delay_s(parameters) - delay if layout.model.has_delay else 0.0

    def weights_at(ts: Any, fraction: Any) -> ForcedWeights:
        return forced_weights(
            layout.method, blocks, ts, fraction - delay_change / ts, layout.terms, layout.nodes
        )

    return jax.vmap(weights_at)(jnp.asarray(intervals), jnp.asarray(fractions))


def _weights(
    parameters: dict[str, Any], layout: Layout, intervals: Any, fractions: Any, delay: Any
) -> Weights:
    """Return the weights of a linear network at each sampling interval (leading axis)."""
    system = realise(layout.model.rational(parameters, layout.quantity))
    if not layout.model.has_delay:
        return jax.vmap(lambda ts: layout.method.weights(system, ts, 0.0, layout.terms))(
            jnp.asarray(intervals)
        )
    delay_change = layout.model.delay_s(parameters) - delay

    def weights_at(ts: Any, fraction: Any) -> Weights:
        return layout.method.weights(system, ts, fraction - delay_change / ts, layout.terms)

    return jax.vmap(weights_at)(jnp.asarray(intervals), jnp.asarray(fractions))


_compiled_weights = jax.jit(_weights, static_argnames=("layout",))


def physical_normal(
    z: Any, coordinates: Coordinates, layout: Layout, data: tuple[Any, ...], noise: Any
) -> NormalEquations:
    """Return the accumulated normal equations of the network whose weights the physics ties.

    Args:
        z: coordinates of the parameters.
        coordinates: of the model.
        layout: static shape of the problem.
        data: :attr:`TimeProblem.data`.
        noise: standard deviation by lane.
    """
    lanes, intervals, fractions, delay = data
    if not layout.model.is_linear:
        return _nonlinear_normal(z, coordinates, layout, data, noise)

    def tied(z: Any) -> Weights:
        return _weights(coordinates.physical(z), layout, intervals, fractions, delay)

    return normal_equations(tied(z), jax.jacfwd(tied)(z), lanes, noise, layout.segments)


def _nonlinear_normal(
    z: Any, coordinates: Coordinates, layout: Layout, data: tuple[Any, ...], noise: Any
) -> NormalEquations:
    """Return the normal equations of a sensor with a nonlinear spring."""
    lanes, *timing = data
    # In the padding behind a record the reference jumps to zero, and a Newton step may overshoot:
    # the spring force is limited to that at ten times the largest measured response.
    largest = 10.0 * jnp.max(jnp.abs(lanes.response))
    largest = jnp.where(largest > 0.0, largest, jnp.inf)

    def simulate(z: Any, starts: Any) -> tuple[Any, Any]:
        parameters = coordinates.physical(z)

        def force(response: Any) -> Any:
            return layout.model.force(parameters, jnp.clip(response, -largest, largest))

        return forced_response(
            _forced(parameters, layout, *timing), force, lanes, starts, layout.rounds
        )

    linear = _forced(coordinates.physical(z), layout, *timing).linear
    return forced_normal_equations(simulate, z, linear, lanes, noise, layout.segments)


#: The one large compiled program of the package: all computations on records in time use it.
evaluate = jax.jit(physical_normal, static_argnames=("layout",))
