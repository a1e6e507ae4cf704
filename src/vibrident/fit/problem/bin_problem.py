"""The residual of a linear sensor at the bins of its segments' transforms: the same problem as in time, in NumPy.

What remains of a run when its network is taken away, weighted by the noise of its record; the states of every run are
eliminated. Lines above the band in which samples tell their signal are left out. A run whose response has samples that
are not used is summed over its samples, as no transform of its response exists.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy import fft

from vibrident.data.records import FloatArray, Record
from vibrident.fit.bins import (
    Batch,
    BinNormal,
    DiscreteTransfer,
    RecordBins,
    Segment,
    SegmentNormals,
    SegmentSeries,
    Step,
    Trained,
    add_batch,
    add_series,
    driven_by,
    hum_of,
    residual_and_jacobian,
    segment_of,
    series_of,
    transformable,
    unbroken,
    usable_steps,
)
from vibrident.fit.bins.normal import AT_ONCE
from vibrident.fit.bins.record import FreeLines, ModelLines, counted, free_of_pieces, free_of_run
from vibrident.fit.bins.segments import TONE_COLUMNS
from vibrident.fit.problem.coordinates import FARTHEST, Coordinates
from vibrident.fit.problem.network_problem import Frame, NetworkProblem
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import MOST_KEPT, in_blocks, line_frequencies, reference_colour
from vibrident.physics.discretisation import Weights
from vibrident.physics.discretisation.inputs import USABLE_BAND

#: Transfer function of a step, and its slopes.
Transfer = tuple[DiscreteTransfer, DiscreteTransfer]


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
        """The transforms of all unbroken runs; the model is linear."""
        drives = [driven_by(record, frame.model, frame.factor_values) for record in records]
        steps = [
            frame.method.filters(drive.valid, frame.terms, frame.delay_s * record.sampling_rate_hz)
            for record, drive in zip(records, drives, strict=True)
        ]
        steps = [usable_steps(step, record) for step, record in zip(steps, records, strict=True)]
        segments = tuple(
            segment_of(number, record, span, step, drive)
            for number, (record, step, drive) in enumerate(zip(records, steps, drives, strict=True))
            for span in map(transformable, unbroken(step.usable))
            if record.mask[span].sum() > frame.fewest
        )
        if not segments:
            raise frame.too_short(records)
        return cls(records, frame, segments, np.array([step.fraction for step in steps]))

    @functools.cached_property
    def trained(self) -> Trained:
        """The network of the sensor model."""
        frame = self.frame
        return Trained(frame.model, frame.method, frame.quantity, frame.terms, frame.factor_values)

    def idle(self) -> BinProblem:
        """The same without the transforms of long runs, which are made again when they are asked for."""
        if all(segment.samples <= MOST_KEPT for segment in self.segments):
            return self
        return replace(self, segments=tuple(segment.idle() for segment in self.segments))

    def at_factors_of(self, values: Mapping[str, float]) -> BinProblem:
        """Return the same runs with inputs behind the factors of ``values``.

        Itself where these are the same, as of a rational model.
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
        """Highest line that counts, as a part of the sampling rate."""
        return USABLE_BAND if self.frame.method.is_exact else 0.5

    @property
    def degrees_of_freedom(self) -> FloatArray:
        """Numbers that count, less initial states and offset, for every record, shape (records,)."""
        found = np.zeros(len(self.records))
        for segment in self.segments:
            if segment.used is None:
                found[segment.record] += counted(segment.samples, self.highest).sum() - self.frame.order
            else:
                found[segment.record] += segment.used.sum() - (self.frame.order + 1.0)
            found[segment.record] -= TONE_COLUMNS * len(segment.hum)
        return found

    @functools.cached_property
    def _groups(self) -> list[tuple[tuple[float, float], tuple[int, ...]]]:
        """Numbers of whole runs of one length and hum that are worked on side by side, behind their step."""
        alike: dict[tuple[tuple[float, float], int, tuple[float, ...]], list[int]] = {}
        for number, segment in enumerate(self.segments):
            if segment.used is None:
                alike.setdefault((self._step_of(segment), segment.samples, segment.hum), []).append(number)
        found = []
        for (step, samples, _), numbers in alike.items():
            width = max(AT_ONCE // samples, 1)
            found += [(step, tuple(numbers[first : first + width])) for first in range(0, len(numbers), width)]
        return found

    @functools.cached_property
    def _joined(self) -> dict[tuple[int, ...], Batch]:
        """Batches of several runs, for which these are copied."""
        return {numbers: self._batch(numbers) for _, numbers in self._groups if len(numbers) > 1}

    def _batch(self, numbers: Sequence[int]) -> Batch:
        return Batch.of([self.segments[number] for number in numbers], numbers)

    def _step_of(self, segment: Segment) -> tuple[float, float]:
        """Sampling interval and read-out fraction of a run."""
        return self.records[segment.record].sampling_interval_s, float(self.fractions[segment.record])

    def weights(self, values: Mapping[str, float]) -> Weights:
        """Network weights, one set a sampling interval in order (leading axis)."""
        found = [self.trained.weights(dict(values), *kind, self.frame.delay_s) for kind in sorted(self._all_kinds)]
        return Weights(*(np.stack(parts) for parts in zip(*found, strict=True)))

    @functools.cached_property
    def _all_kinds(self) -> set[tuple[float, float]]:
        return {self._step_of(segment) for segment in self.segments}

    def _all_steps(self, values: dict[str, float]) -> dict[tuple[float, float], Transfer]:
        """Transfer function of each kind of step, and its slopes with the physical parameters."""
        every = [(kind, (values, *kind, self.frame.delay_s)) for kind in self._all_kinds]
        network = self.trained
        return self._kept("steps", values, lambda: {kind: network.with_slopes(*at) for kind, at in every})

    def normal(self, z: FloatArray, coordinates: Coordinates, noise: FloatArray) -> BinNormal:
        """Normal equations at coordinates ``z``; ``noise``: standard deviation of each record, shape (records,)."""
        values = coordinates.values(z)
        normals = self._kept("normals", values, lambda: self._made_normals(values))
        return normals.weighed(noise[[segment.record for segment in self.segments]], coordinates.slopes(z))

    def _kept(self, name: str, values: dict[str, float], make: Callable[[], Any]) -> Any:
        """What was made last of this name: another noise level, or the lines, need the same again."""
        key = tuple(values.items())
        if self._last.get(name, ((),))[0] != key:
            self._last[name] = key, make()
        return self._last[name][1]

    @functools.cached_property
    def _last(self) -> dict[str, tuple[Any, Any]]:
        return {}

    def _made_normals(self, values: dict[str, float]) -> SegmentNormals:
        steps = self._all_steps(values)
        stable = all(self._stable(kind, transfer) for kind, (transfer, _) in steps.items())
        normals = SegmentNormals.of(len(self.segments), len(values), 0.0 if stable else np.inf)
        if not stable:
            return normals
        made: dict[Any, Step] = {}
        for kind, numbers in self._groups:
            batch = self._joined.get(numbers) or self._batch(numbers)
            counts = counted(batch.samples, self.highest) / batch.samples
            add_batch(normals, batch, _step(made, batch, steps[kind], counts))
        for number, segment in enumerate(self.segments):
            if segment.used is not None:
                add_series(normals, number, series_of(segment, *steps[self._step_of(segment)]))
        return normals

    def _stable(self, kind: tuple[float, float], transfer: DiscreteTransfer) -> bool:
        """Whether no state of a kind of step grows beyond all numbers over its runs, as Euler's may."""
        if not np.all(np.isfinite(transfer.denominator)):
            return False
        longest = max(segment.samples for segment in self.segments if self._step_of(segment) == kind)
        poles = 1.0 + np.roots(transfer.denominator[::-1])
        return bool(longest * np.log(np.max(np.abs(poles), initial=1.0)) <= FARTHEST)

    def squares(self, normal: BinNormal, noise: FloatArray) -> FloatArray:
        """Sum of squares of each record's residual, shape (records,), of normal equations weighted by ``noise``."""
        owners = [segment.record for segment in self.segments]
        return np.bincount(owners, np.maximum(normal.squares, 0.0), len(self.records)) * noise**2

    def predict(self, coordinates: Coordinates, z: FloatArray) -> list[FloatArray]:
        """Response of every record with the best initial states and offsets, NaN where the network gives no value.

        Hum is no part of it.
        """
        values = coordinates.values(z)
        found = [np.full(record.samples, np.nan) for record in self.records]
        made: dict[tuple[float, float], Transfer] = {}
        for kind in self._all_kinds:
            step = self.trained.transfer(values, *kind, self.frame.delay_s)
            made[kind] = step, DiscreteTransfer(step.denominator[None][:0], step.numerator[None][:0])  # no slopes
        kept: dict[Any, Step] = {}
        for segment in self.segments:
            transfer = made[self._step_of(segment)]
            if segment.used is not None:
                found[segment.record][segment.span] = series_of(segment, *transfer).predicted
                continue
            batch, every = Batch.of([segment], [0]), counted(segment.samples, 0.5)  # all lines: line 0 holds the offset
            left, _, hum = residual_and_jacobian(batch, _step(kept, batch, transfer, every))
            del batch
            segment.transforms.forget_inputs()
            left[:, 0] = 0.0
            if segment.hum:
                hum[:, 0] *= min(segment.hum) >= 1.0  # what is less than a turn tells nothing of its mean
                left += hum
            own = self.records[segment.record].response[segment.span]
            found[segment.record][segment.span] = own - np.asarray(fft.irfft(left[0], segment.samples))
        return found

    def lines(
        self, z: FloatArray, coordinates: Coordinates, noise: FloatArray, some: slice = slice(None)
    ) -> list[RecordBins]:
        """Every record, or some, at the bins of its transform, in order; one that no run reaches has no samples."""
        steps = self._all_steps(coordinates.values(z))
        turn, lowest = coordinates.slopes(z)[:, None], self.lowest_ringing_hz(coordinates.values(z))
        found: list[RecordBins] = []
        models: dict[tuple[int, float], ModelLines] = {}
        states: dict[tuple[int, float, float], FreeLines] = {}
        kept: dict[Any, Step] = {}
        for number in range(len(self.records))[some]:
            record, segments = self.records[number], [one for one in self.segments if one.record == number]
            floor = float((self.noise_floor[number] / noise[number]) ** 2)
            if len(segments) == 1 and segments[0].used is None:
                key, step = (segments[0].samples, *self._step_of(segments[0])), steps[self._step_of(segments[0])]
                own = self._whole(segments[0], step, turn, noise[number], kept)
                own["free"] = states.setdefault(key, free_of_run(key[0], step[0].denominator))
            else:
                pieces = [(segment.span, series_of(segment, *steps[self._step_of(segment)])) for segment in segments]
                own = _in_pieces(pieces, turn, noise[number], self.highest)
            samples, model = len(own["used"]), None
            unseen = lowest > 0.5 * record.sampling_rate_hz
            if record.reference is not None and samples > 1:
                grid = samples, record.sampling_rate_hz
                model = models.setdefault(grid, self._response(coordinates, z, *grid))
            hum, colour = hum_of(record, samples), reference_colour(record, samples)
            made = RecordBins(**own, model=model, z=z, floor=floor, hum=hum, rings_unseen=unseen, colour=colour)
            made = made.without_ringing() if unseen and made.free is not None else made
            found.append(made.beside_drift())
        return found

    def lowest_ringing_hz(self, values: dict[str, float]) -> float:
        """Lowest frequency of a free oscillation, Hz; zero where the sensor has none."""
        poles = self.frame.model.poles(values)
        ringing = np.abs(np.imag(poles[np.imag(poles) != 0.0]))
        return float(np.min(ringing)) / (2.0 * np.pi) if ringing.size else 0.0

    def _whole(
        self,
        segment: Segment,
        step: Transfer,
        turn: FloatArray,
        noise: float,
        kept: dict[Any, Step],
    ) -> dict[str, Any]:
        """What the lines of a record say that is one whole run."""
        one_sided, batch = counted(segment.samples, self.highest), Batch.of([segment], [0])
        found = residual_and_jacobian(batch, _step(kept, batch, step, one_sided))
        segment.transforms.forget_inputs()
        left, own = found.residual[0], found.jacobian[0]
        left /= noise

        def predicted(part: slice) -> ComplexArray:
            explained = segment.response[part] / noise - left[part]
            return explained - found.hum[0, part] / noise if found.hum.size else explained

        return {
            "residual": left,
            "predicted": predicted,
            "used": np.broadcast_to(True, segment.samples),
            "one_sided": one_sided,
            "jacobian": np.multiply(own, turn / noise, out=own),
        }

    def _response(self, coordinates: Coordinates, z: FloatArray, samples: int, rate_hz: float) -> ModelLines:
        """H at the lines of the transform of so many samples."""
        lines, quantity = samples // 2 + 1, self.frame.quantity

        def at(z: FloatArray) -> ComplexArray:
            values, found = coordinates.values(z), np.empty(lines, dtype=complex)
            for part in in_blocks(lines):  # of a long record each copy counts
                frequency = line_frequencies(samples, rate_hz, part)
                found[part] = coordinates.model.frequency_response(values, frequency, quantity)
            return found

        return ModelLines(at, z, lines)


def _step(made: dict[Any, Step], batch: Batch, transfer: Transfer, counts: FloatArray) -> Step:
    """What a batch has in common with others; made once."""
    key = batch.samples, batch.hum, id(transfer[0])
    if key not in made:
        made[key] = Step(batch.samples, *transfer, batch.hum, counts)
    return made[key]


def _in_pieces(
    pieces: Sequence[tuple[slice, SegmentSeries]], turn: FloatArray, noise: float, highest: float
) -> dict[str, Any]:
    """What the lines of a record say that has samples left out."""
    begin, end = (pieces[0][0].start, pieces[-1][0].stop) if pieces else (0, 0)
    placed = [(slice(span.start - begin, span.stop - begin), series) for span, series in pieces]
    signals, used = np.zeros((2 + len(turn), end - begin)), np.zeros(end - begin, dtype=bool)
    for place, series in placed:
        used[place] = series.free[-1] > 0.0
        signals[:, place] = [series.residual, series.predicted * used[place], *(series.projected_jacobian() * turn)]
    lines = np.fft.rfft(signals / noise, axis=1) if end > begin else np.zeros((len(signals), 1), dtype=complex)
    return {
        "residual": lines[0],
        "predicted": lines[1].__getitem__,
        "used": used,
        "one_sided": counted(end - begin, highest),
        "jacobian": lines[2:],
        "free": free_of_pieces(end - begin, placed),
    }
