"""Records of a linear sensor as unbroken segments, at whose bins the network is run."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import FloatArray, Record
from vibrident.fit.bins import (
    Segment,
    Trained,
    between_gaps,
    driven_by,
    segment_of,
    transformable,
    unbroken,
    usable_steps,
)
from vibrident.fit.group.group import Grid, Group, in_batches
from vibrident.fit.group.network import Step, predict
from vibrident.fit.problem.coordinates import Coordinates
from vibrident.fit.problem.network_problem import Frame, NetworkProblem, counted_band
from vibrident.fit.response.transform import MAX_CACHED_SAMPLES
from vibrident.physics.discretisation import Weights
from vibrident.physics.discretisation.inputs import USABLE_BAND


@dataclass(frozen=True, eq=False)
class BinProblem(NetworkProblem):
    """Runs of one linear sensor at the bins of their transforms.

    Attributes:
        segments: the runs, in order.
        fractions: read-out fraction of each record at the delay of the inputs.
    """

    segments: tuple[Segment, ...]
    fractions: FloatArray

    @classmethod
    def of_frame(cls, records: tuple[Record, ...], frame: Frame) -> BinProblem:
        """Return the transforms of all unbroken runs; the model is linear.

        Raises:
            InputError: no record is long enough.
        """
        drives = [driven_by(record, frame.model, frame.factor_values) for record in records]
        steps = [
            frame.method.filters(
                drive.valid,
                frame.terms,
                frame.delay_s * record.sampling_rate_hz,
                counted_band(record, frame.top_hz),
            )
            for record, drive in zip(records, drives, strict=True)
        ]
        steps = [usable_steps(step, record) for step, record in zip(steps, records, strict=True)]
        segments = tuple(
            segment_of(number, record, span, step, drive)
            for number, (record, step, drive) in enumerate(zip(records, steps, drives, strict=True))
            for run in unbroken(step.usable)
            for span in map(transformable, between_gaps(run, record.mask))
            if record.mask[span].sum() > frame.fewest
        )
        if not segments:
            raise frame.too_short(records)
        return cls(records, frame, segments, np.array([step.fraction for step in steps]))

    @functools.cached_property
    def trained(self) -> Trained:
        """Return the network of the sensor model."""
        frame = self.frame
        return Trained(frame.model, frame.method, frame.quantity, frame.terms, frame.factor_values)

    def idle(self) -> BinProblem:
        """Return the problem without the transforms of long runs, recomputed if needed."""
        if all(segment.samples <= MAX_CACHED_SAMPLES for segment in self.segments):
            return self
        return replace(self, segments=tuple(segment.idle() for segment in self.segments))

    def at_factors_of(self, values: Mapping[str, float]) -> BinProblem:
        """Return the same runs with inputs filtered by the factors of ``values``.

        Itself where these are unchanged, as of a rational model.
        """
        factor_values = {name: values[name] for name in self.frame.factor_values}
        if factor_values == self.frame.factor_values:
            return self
        frame = replace(self.frame, factor_values=factor_values)
        drives = [driven_by(record, frame.model, factor_values) for record in self.records]
        segments = tuple(segment.driven(drives[segment.record]) for segment in self.segments)
        return replace(self, frame=frame, segments=segments)

    @property
    def highest(self) -> float:
        """Return the highest line that counts, as a fraction of the sampling rate."""
        return USABLE_BAND if self.frame.method.is_band_limited else 0.5

    def grid_of(self, number: int) -> Grid:
        """Return the grid of all bins of a segment."""
        segment = self.segments[number]
        record = self.records[segment.record]
        bins = segment.samples // 2 + 1
        return Grid(
            segment.samples,
            record.sampling_rate_hz,
            float(self.fractions[segment.record]),
            bins,
            bins,
            segment.hum,
            has_gaps=segment.used is not None,
            driven=record.reference is not None,
            full_band=True,
        )

    def weights(self, values: Mapping[str, float]) -> Weights:
        """Return the network weights, by sampling interval in order (leading axis)."""
        kinds = {self.grid_of(number).step for number in range(len(self.segments))}
        by_kind = [
            self.trained.weights(dict(values), *kind, self.frame.delay_s) for kind in sorted(kinds)
        ]
        return Weights(*(np.stack(fields) for fields in zip(*by_kind, strict=True)))

    def predict(self, coordinates: Coordinates, z: FloatArray) -> list[FloatArray]:
        """Return the response of every record, with the best initial states and offsets.

        NaN where the network gives no value. Hum is not included.
        """
        values = coordinates.values(z)
        responses = [np.full(record.samples, np.nan) for record in self.records]
        alike: dict[Grid, list[int]] = {}
        for number in range(len(self.segments)):
            alike.setdefault(self.grid_of(number), []).append(number)
        for grid, numbers in alike.items():
            step = Step(self.trained.transfer(values, *grid.step, self.frame.delay_s))
            for rows in in_batches(len(numbers), grid.bins):
                segments = [self.segments[number] for number in numbers[rows]]
                predicted = predict(Group.from_segments(grid, numbers[rows], segments), step)
                for segment, series in zip(segments, predicted, strict=True):
                    segment.transforms.forget_inputs()
                    responses[segment.record][segment.span] = series
        return responses

    def lowest_ringing_hz(self, values: dict[str, float]) -> float:
        """Return the lowest frequency of a free oscillation, Hz; zero without one."""
        poles = self.frame.model.poles(values)
        ringing = np.abs(np.imag(poles[np.imag(poles) != 0.0]))
        return float(np.min(ringing)) / (2.0 * np.pi) if ringing.size else 0.0
