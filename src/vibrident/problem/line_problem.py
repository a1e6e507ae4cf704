"""The residual of a linear sensor at the lines of its runs' transforms: the same problem as in time, in NumPy.

What remains of a run when its network is taken away, weighted by the noise of its record; the states of every run are
eliminated. Lines above the band in which samples tell their signal are left out.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from scipy import fft

from vibrident.discretize.inputs import USABLE_BAND
from vibrident.lines import Batch, LineNormal, Run, StepTransfer, Trained, columns_of, normal_equations
from vibrident.measure.lines import line_counts
from vibrident.problem.coordinates import Coordinates
from vibrident.records import FloatArray, Record

#: Lines of runs that are taken side by side.
AT_ONCE = 1 << 14


@dataclass(frozen=True, eq=False)
class LineProblem:
    """Runs of one linear sensor at the lines of their transforms.

    Attributes:
        records: the records, in order.
        trained: the network of the sensor model.
        runs: in order.
        fractions: read-out fraction at ``delay_s``, of each record.
        delay_s: delay at which the inputs were interpolated.
    """

    records: tuple[Record, ...]
    trained: Trained
    runs: tuple[Run, ...]
    fractions: FloatArray
    delay_s: float

    @functools.cached_property
    def counts(self) -> tuple[FloatArray, ...]:
        """How often each line of a run counts in a sum over all; zero for line 0, where its offset stands."""
        found = []
        for run in self.runs:
            twice = line_counts(run.samples)
            twice[0] = 0.0
            if self.trained.method.fixed_terms is None:
                twice[run.lines > USABLE_BAND * run.samples] = 0.0
            found.append(twice)
        return tuple(found)

    @functools.cached_property
    def degrees_of_freedom(self) -> FloatArray:
        """Numbers that count, less initial states, for every record, shape (records,)."""
        found = np.zeros(len(self.records))
        for run, counts in zip(self.runs, self.counts, strict=True):
            found[run.record] += counts.sum() - self.trained.order
        return found

    @functools.cached_property
    def _batches(self) -> tuple[tuple[Batch, FloatArray, float, float], ...]:
        """Runs of one rate and length side by side, how their lines count, sampling interval and fraction."""
        groups: dict[tuple[float, float, int], list[int]] = {}
        for number, run in enumerate(self.runs):
            key = (self.records[run.record].sampling_interval_s, float(self.fractions[run.record]), run.samples)
            groups.setdefault(key, []).append(number)
        found = []
        for (interval, fraction, samples), numbers in groups.items():
            width = max(2 * AT_ONCE // samples, 1)
            for first in range(0, len(numbers), width):
                some = numbers[first : first + width]
                counts = self.counts[some[0]] / samples
                found.append((Batch.of([self.runs[i] for i in some], some), counts[None, :], interval, fraction))
        return tuple(found)

    def steps(self, values: dict[str, float], interval_s: float, fraction: float) -> tuple[StepTransfer, StepTransfer]:
        """Transfer function of a step, and its slopes with the physical parameters."""
        at = (values, interval_s, fraction, self.delay_s)
        return self.trained.transfer(*at), self.trained.slopes(*at)

    def normal(self, z: FloatArray, coordinates: Coordinates, noise: FloatArray) -> LineNormal:
        """Normal equations at coordinates ``z``; ``noise``: standard deviation of each record, shape (records,)."""
        values = coordinates.values(z)
        owners = np.array([run.record for run in self.runs])
        steps = {key: self.steps(values, *key) for key in {(i, f) for _, _, i, f in self._batches}}
        found = normal_equations(
            [batch for batch, *_ in self._batches],
            [steps[i, f][0] for *_, i, f in self._batches],
            [steps[i, f][1] for *_, i, f in self._batches],
            [counts / noise[owners[batch.runs]][:, None] ** 2 for batch, counts, *_ in self._batches],
        )
        turn = _turn(coordinates, z)
        return LineNormal(found.matrix * np.outer(turn, turn), found.gradient * turn, found.cost, found.squares)

    def predicted(self, values: dict[str, float]) -> list[FloatArray]:
        """Response of every record with the best initial states and offsets, NaN where the network gives none."""
        found = [np.full(record.samples, np.nan) for record in self.records]
        for run in self.runs:
            record = self.records[run.record]
            at = (values, record.sampling_interval_s, float(self.fractions[run.record]), self.delay_s)
            transfer = self.trained.transfer(*at)
            batch, every = Batch.of([run], [0]), line_counts(run.samples)
            every[0] = 0.0
            nothing = StepTransfer(np.zeros((0, len(transfer.denominator))), np.zeros((0, *transfer.numerator.shape)))
            residual, _, _ = columns_of(batch, transfer, nothing, np.sqrt(every)[None, :])
            residual[:, 0] = 0.0
            found[run.record][run.span] = record.response[run.span] - np.asarray(fft.irfft(residual[0], run.samples))
        return found


def _turn(coordinates: Coordinates, z: FloatArray) -> FloatArray:
    """Slopes of the physical values with their coordinates, zero at the ends of the range searched."""
    low, high = coordinates.edges
    return np.where((low < z) & (z < high), coordinates.slopes(z), 0.0)


def line_objective(z: FloatArray, args: tuple[Coordinates, LineProblem, FloatArray]) -> LineNormal:
    """The residual of all runs in the form the optimisers take; args: coordinates, problem, noise of each record."""
    coordinates, problem, noise = args
    return problem.normal(np.asarray(z, dtype=float), coordinates, noise)
