"""The residual in time: measured response minus the unrolled network's, weighted by each record's noise.

    r_k = (y_k − ŷ_k(θ; x0, b)) / σ_record

with the initial state x0 and the offset b of every segment eliminated exactly. The derivative is the variable
projection of Kaufman (1975): differentiate with x0 and b held, then remove the part that they could imitate. Its
Gauss–Newton step is the joint step over all unknowns, and its gradient is the exact gradient.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibrident.base.backend import jax, jnp, release_kernels
from vibrident.data.records import FloatArray, Quantity, Record
from vibrident.fit.bins import RecordBins
from vibrident.fit.problem.coordinates import Coordinates
from vibrident.fit.problem.cutting import bucket, cut, pieces_of, steps_of
from vibrident.fit.problem.framing import Frame, noise_floor, response_size
from vibrident.fit.response.transform import line_counts
from vibrident.physics.discretisation import Method, Weights
from vibrident.physics.discretisation.forced import ForcedWeights, accuracy, forced_weights
from vibrident.physics.models import SensorModel
from vibrident.physics.models.state_space import realise
from vibrident.physics.network.forced import forced_normal, forced_response
from vibrident.physics.network.sensitivity import Normal, normal_equations
from vibrident.physics.network.unroll import Lanes

jax.tree_util.register_dataclass(Coordinates, data_fields=["start", "band_hz", "response_size"], meta_fields=["model"])

#: Steps a chunk. Long enough that few chunks need their state passed on, short enough that a vector loop pays.
CHUNK = 256
#: Networks between two looks at the memory maps of compiled kernels.
LOOK_EVERY = 100
_builds = itertools.count(1)
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
        frame: shape of the network, and the delay at which the inputs were interpolated.
        lanes: their steps.
        intervals_s: distinct sampling intervals, shape (R,).
        fractions: read-out fraction at ``delay_s``, shape (R,).
        record_of_segment: record of each real segment; segments beyond them are padding.
        pieces: record, samples and first lane of each segment.
    """

    layout: Layout
    records: tuple[Record, ...]
    frame: Frame
    lanes: Lanes
    intervals_s: FloatArray
    fractions: FloatArray
    record_of_segment: np.ndarray
    pieces: tuple[tuple[int, slice, int], ...]

    @classmethod
    def build(
        cls,
        records: Sequence[Record],
        model: SensorModel,
        method: Method,
        quantity: Quantity,
        start: Mapping[str, float],
    ) -> TimeProblem:
        """Interpolate the inputs at the expected delay and cut the records into lanes.

        Args: as of :meth:`vibrident.fit.problem.framing.Frame.of`.

        Raises:
            InputError: no record is long enough.
        """
        if next(_builds) % LOOK_EVERY == 0:
            release_kernels()
        frame = Frame.of(records, model, method, quantity, start)
        intervals, rate = np.unique([r.sampling_interval_s for r in records], return_inverse=True)
        terms, delay, order = frame.terms, frame.delay_s, frame.order
        steps = steps_of(records, method, terms, delay, linear=model.is_linear)
        fractions = np.zeros(len(intervals))
        fractions[rate] = [step.fraction for step in steps]
        pieces = pieces_of(records, steps, fewest=frame.fewest)
        if not pieces:
            raise frame.too_short(records)
        lanes, first_lanes = cut(pieces, records, rate, terms, CHUNK)
        nodes, rounds = (0, (0, 0)) if model.is_linear else accuracy(frame.fastest * float(np.max(intervals)))
        layout = Layout(model, method, quantity, terms, order, bucket(len(pieces) + 1), nodes, rounds)
        owners = np.array([piece.record for piece in pieces])
        placed = tuple((p.record, p.run, lane) for p, lane in zip(pieces, first_lanes, strict=True))
        return cls(layout, tuple(records), frame, lanes, intervals, fractions, owners, placed)

    @property
    def degrees_of_freedom(self) -> FloatArray:
        """Samples less initial states and offset, for every record, shape (records,)."""
        per_lane = np.sum(self.lanes.weight, axis=0)
        owners = self.by_lane(np.arange(len(self.records)), fill=0).astype(int)  # padding weighs nothing
        counts = np.bincount(owners, weights=per_lane, minlength=len(self.records))
        segments = np.bincount(self.record_of_segment, minlength=len(self.records))
        return np.asarray(counts - (self.layout.order + 1.0) * segments, dtype=np.float64)

    @property
    def noise_floor(self) -> FloatArray:
        """Lower limit of the standard deviation of each record's residual, response unit, shape (records,)."""
        return self._noise_floor

    @functools.cached_property
    def _noise_floor(self) -> FloatArray:
        return noise_floor(self.records)

    def idle(self) -> TimeProblem:
        """Itself: nothing of it is made again."""
        return self

    def at_delay_of(self, values: Mapping[str, float]) -> TimeProblem:
        """The same with inputs interpolated at the delay of ``values``; itself where they nearly are."""
        layout = self.layout
        if self.frame.settled(float(layout.model.delay_s(values)), self.records):
            return self
        return TimeProblem.build(self.records, layout.model, layout.method, layout.quantity, values)

    @functools.cached_property
    def data(self) -> tuple[Any, ...]:
        """Arrays that the residual needs beside the parameters and the noise, on the device."""
        return jax.device_put(self._arrays())

    def _arrays(self) -> tuple[Any, ...]:
        return self.lanes, self.intervals_s, self.fractions, self.frame.delay_s

    def by_lane(self, per_record: np.ndarray, fill: float = 1.0) -> np.ndarray:
        """Spread one value a record over its lanes, shape (M,); ``fill`` for padding lanes."""
        spread = np.append(np.asarray(per_record)[self.record_of_segment], fill)
        return spread[np.minimum(np.asarray(self.lanes.segment), len(self.record_of_segment))]

    @functools.cached_property
    def response_size(self) -> float:
        """Largest distance of a valid response sample from its record's mean, response unit."""
        return response_size(self.records)

    def weights(self, values: Mapping[str, Any]) -> Weights:
        """Network weights of the sensor's linear part, one set a sampling interval (leading axis R)."""
        return _compiled_weights(dict(values), self.layout, self.intervals_s, self.fractions, self.frame.delay_s)

    def normal(self, z: FloatArray, coordinates: Coordinates, noise: FloatArray) -> Normal:
        """Normal equations at coordinates ``z``; ``noise``: standard deviation of each record, shape (records,)."""
        by_lane = jnp.asarray(self.by_lane(noise))
        return evaluate(jnp.asarray(z), coordinates, self.layout, self.data, by_lane)

    def record_noise(self, normal: Normal, noise: FloatArray) -> FloatArray:
        """Standard deviation of each record's residual, shape (records,); the sums of squares are not weighted."""
        count = len(self.records)
        squares = np.asarray(normal.squares)[: len(self.record_of_segment)]  # segments beyond are padding
        totals = np.bincount(self.record_of_segment, weights=squares, minlength=count)
        return np.maximum(np.sqrt(totals / np.maximum(self.degrees_of_freedom, 1.0)), self.noise_floor)

    def lines(self, z: FloatArray, coordinates: Coordinates, noise: FloatArray) -> list[RecordBins]:
        """Residual and slopes of every record at the bins of its transform, in units of its noise."""
        normal = self.normal(z, coordinates, noise)
        responses = self.by_record(normal.response)
        columns = [self.by_record(column) for column in normal.columns]
        found = []
        for index, (record, predicted) in enumerate(zip(self.records, responses, strict=True)):
            used = record.mask & np.isfinite(predicted)
            signals = [(record.response - predicted) / noise[index], predicted / noise[index]]
            signals += [column[index] for column in columns]
            lines = np.fft.rfft(np.where(used, signals, 0.0), axis=1)
            one_sided, floor = line_counts(record.samples), float((self.noise_floor[index] / noise[index]) ** 2)
            found.append(RecordBins(lines[0], lines[1].__getitem__, used, one_sided, lines[2:], None, None, z, floor))
        return found

    def predict(self, coordinates: Coordinates, z: Any) -> list[FloatArray]:
        """Predicted response of every record, NaN where the network gives no value, with the best initial states."""
        return self.by_record(self.normal(z, coordinates, np.ones(len(self.records))).response)

    def by_record(self, lanes_values: Any) -> list[FloatArray]:
        """Put values of the lanes, shape (L, M), back in the order of the records' samples; NaN elsewhere."""
        values = np.asarray(lanes_values)
        ordered = [np.full(record.samples, np.nan) for record in self.records]
        for owner, run, lane in self.pieces:
            whole, rest = divmod(run.stop - run.start, CHUNK)
            end = run.stop - rest
            ordered[owner][run.start : end].reshape(whole, CHUNK)[:] = values[:, lane : lane + whole].T
            ordered[owner][end : run.stop] = values[:rest, lane + whole] if rest else 0.0
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


def physical_normal(z: Any, coordinates: Coordinates, layout: Layout, data: tuple[Any, ...], noise: Any) -> Normal:
    """Accumulated normal equations of the tied network, weights from the physics at coordinates ``z``."""
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


#: The one large compiled program of the package: all computations on records in time use it.
evaluate = jax.jit(physical_normal, static_argnames=("layout",))
