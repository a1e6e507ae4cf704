"""Noise of the bins and band of the motion, estimated before any model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy import fft
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.group.group import Group
from vibrident.fit.noise.averages import windowed
from vibrident.fit.noise.local import SmoothColumns
from vibrident.fit.noise.projection import BLOCK_BINS
from vibrident.fit.noise.tones import MAX_TONE_DISTANCE
from vibrident.fit.problem.band import Band
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of

#: A bin shows motion where the power of the response is so many times the noise.
MIN_MOTION_RATIO = 10.0
#: Fraction of its weight that a bin without motion keeps, so that the equations stay regular.
MIN_WEIGHT = 1e-9


class NoiseLevels(NamedTuple):
    """Power of the noise of each bin, before any model.

    Attributes:
        response: of the noise of the response, shape (…, K).
        reference: of the noise of the reference, shape (…, K).
        passed: |H|² that response and reference show, at most, shape (…, K).
    """

    response: FloatArray
    reference: FloatArray
    passed: FloatArray

    @property
    def total(self) -> FloatArray:
        """Return the power of the noise of the response given the motion, shape (…, K)."""
        return self.response + self.reference * self.passed


@dataclass(frozen=True, eq=False)
class MotionAndNoise:
    """Noise of the response given the motion, without a model.

    It serves segments of other lengths, too, as another delay or other inputs give; an additional
    one is as the last.

    Attributes:
        levels: noise by number of the segment, of K bins each.
        heard: samples, and bins at which motion shows in the response, by number of the segment.
        band_hz: lowest and highest frequency at which response and reference are coherent.
        weights: of the bins in another noise, by number of the segment; empty: in this one.
        filled: response with omitted samples filled in, by number of the segments that have such,
            shape (K,) each.
    """

    levels: Mapping[int, NoiseLevels]
    heard: Mapping[int, tuple[int, BoolArray]]
    band_hz: tuple[float, float]
    weights: Mapping[int, FloatArray] = field(default_factory=dict)
    filled: Mapping[int, ComplexArray] = field(default_factory=dict)

    @property
    def count(self) -> float:
        """Return the number of bins at which motion shows."""
        return float(sum(np.sum(heard) for _, heard in self.heard.values()))

    def levels_in(self, group: Group) -> NoiseLevels:
        """Return the noise in a group, shape (R, K)."""
        grid = group.grid
        rows = []
        for number in self._numbers(group):
            samples = self.heard[number][0]
            response, reference, passed = (
                grid.resampled(bins, samples) for bins in self.levels[number]
            )
            more = grid.samples / samples  # power of a bin grows with the samples
            rows.append((more * response, more * reference, passed))
        return NoiseLevels(*(np.stack(bins) for bins in zip(*rows, strict=True)))

    def heard_in(self, group: Group) -> BoolArray:
        """Return where motion shows in a group, shape (R, K)."""
        heard = (self.heard[number] for number in self._numbers(group))
        return np.stack(
            [group.grid.resampled(bins.astype(float), samples) > 0.5 for samples, bins in heard]
        )

    def heard_everywhere(self, look: Band) -> MotionAndNoise:
        """Return the same noise, with motion in every bin that counts.

        What rings in a resonance narrower than a bin seems incoherent.
        """
        heard: dict[int, tuple[int, BoolArray]] = {}
        for group in look.groups:
            heard |= dict.fromkeys(group.segments, (group.grid.samples, group.grid.counts > 0.0))
        return replace(self, heard=heard)

    def moved(self, look: Band, band: Band) -> MotionAndNoise:
        """Return the motion and noise of a look with omitted samples filled in another band's.

        A segment that goes beyond those of the look is not filled in.
        """
        filled: dict[int, ComplexArray] = {}
        for source, lines in self.filled.items():
            looked = look.problem.segments[source]
            signal = fft.irfft(lines, looked.samples)
            for number, segment in enumerate(band.problem.segments):
                begin, end = (
                    at - looked.span.start for at in (segment.span.start, segment.span.stop)
                )
                if segment.record == looked.record and begin >= 0 and end <= looked.samples:
                    filled[number] = fft.rfft(signal[begin:end])
        return replace(self, filled=filled)

    def _numbers(self, group: Group) -> list[int]:
        """Return the number of the segment that stands for each of a group."""
        return [min(number, len(self.heard) - 1) for number in group.segments]

    def weights_in(self, group: Group) -> FloatArray:
        """Return the weights in the noise of the response, shape (R, K).

        They are next to zero where no motion shows.
        """
        if self.weights:
            return np.stack([self.weights[number][: group.grid.bins] for number in group.segments])
        # Noise is at least rounding; a response of zeros has a noise of one.
        loudest = np.max(power_of(group.response), axis=1, keepdims=True)
        rounding = np.where(loudest > 0.0, np.finfo(float).eps ** 2 * loudest, 1.0)
        floor = np.maximum(self.levels_in(group).response, rounding)
        return self.shown_in(group) * group.grid.counts * group.grid.samples / floor

    def shown_in(self, group: Group) -> FloatArray:
        """Return one where motion shows, next to zero elsewhere, shape (R, K)."""
        return np.asarray(self.heard_in(group) + MIN_WEIGHT, dtype=float)


def estimate_motion_and_noise(band: Band) -> MotionAndNoise:
    """Return the noise of each group, and the band of the motion."""
    levels: dict[int, NoiseLevels] = {}
    heard_bins: dict[int, tuple[int, BoolArray]] = {}
    shown: list[FloatArray] = []
    all_bins: list[FloatArray] = []
    filled: dict[int, ComplexArray] = {}
    for group in band.groups:
        measured = _measured(group, band.problem.frame.zeros)
        power = power_of(measured.response)
        heard = power > MIN_MOTION_RATIO * measured.level.total
        if group.grid.driven:  # leakage from other bins is no motion
            heard &= measured.moving
            if band.model.has_delay:  # a reference ahead of the response looks like noise
                in_response = measured.moving & (power > MIN_MOTION_RATIO * measured.level.response)
                heard |= in_response & ~np.any(heard, axis=1, keepdims=True)
            # Few bins only bound the noise by the power of everything.
            heard |= ~measured.has_enough_bins[:, None]
            heard &= _near_tones(band, group)
        heard &= group.grid.counts > 0.0
        samples = group.grid.samples
        heard_bins |= {n: (samples, row) for n, row in zip(group.segments, heard, strict=True)}
        rows_of_levels = (NoiseLevels(*rows) for rows in zip(*measured.level, strict=True))
        levels |= zip(group.segments, rows_of_levels, strict=True)
        if group.used is not None and group.grid.driven:
            root_share = np.sqrt(np.mean(group.used, axis=1, keepdims=True))
            rows = zip(
                group.segments,
                measured.response / root_share,
                measured.has_enough_bins,
                strict=True,
            )
            filled |= {number: row for number, row, enough in rows if enough}
        frequency = group.grid.frequency_hz
        all_bins.append(frequency[[group.grid.first, group.grid.last - 1]])
        # Free motion is where it is heard.
        moving = measured.moving[measured.has_enough_bins] if group.grid.driven else heard
        moving = moving & (group.grid.counts > 0.0)
        places = 1 + np.flatnonzero(np.any(moving[:, 1:], axis=0))
        if places.size:
            shown.append(frequency[np.minimum(places[[0, -1]], group.grid.last - 1)])
    span = np.concatenate(shown) if shown else np.zeros(0)
    span = span if span.size else np.concatenate(all_bins)
    return MotionAndNoise(
        levels, heard_bins, (float(np.min(span)), float(np.max(span))), filled=filled
    )


def _near_tones(band: Band, group: Group) -> BoolArray:
    """Return the bins of a group that tell of the motion, shape (R, K): of a sine those around it.

    Elsewhere a sine leaks, and what the reference is rounded by is larger than that.
    """
    records = [band.problem.records[owner] for owner in band.owners(group)]
    near = np.ones(group.response.shape, dtype=bool)
    sines = [row for row, record in enumerate(records) if record.excitation == "sine"]
    if sines:
        reference, response = (
            power_of(windowed(rows)) for rows in (group.inputs[sines, 0], group.response[sines])
        )
        tops = 1 + np.argmax(reference * response, axis=1)
        near[sines] = np.abs(np.arange(group.grid.bins) - tops[:, None]) <= MAX_TONE_DISTANCE
    return near


def loud_bins(band: Band) -> list[BoolArray]:
    """Return where both channels are loud, of each group, shape (R, K).

    Loud bins exceed the quietest interval of the band. A response that comes late is not coherent
    with its cause within a few bins, as the phase between them turns.
    """
    loud: list[BoolArray] = []
    for group in band.groups:
        both_loud = np.ones((len(group.segments), group.grid.bins), dtype=bool)
        for rows in (group.response, group.inputs[:, 0]):
            power = np.zeros(rows.shape)
            power[:, 1:-1] = power_of(windowed(rows))
            blocks = max((group.grid.last - 1) // BLOCK_BINS, 1)
            intervals = np.array_split(power[:, 1 : group.grid.last - 1], blocks, axis=1)
            quiet = np.min([np.mean(interval, axis=1) for interval in intervals], axis=0)
            both_loud &= power > MIN_MOTION_RATIO * quiet[:, None]
        both_loud |= ~np.any(both_loud, axis=1, keepdims=True)  # the motion is everywhere
        loud.append(both_loud)
    return loud


class _GroupMotion(NamedTuple):
    """Motion and noise in a group, without a model.

    Attributes:
        response: at the bins, with omitted samples filled in, scaled to the power of those used,
            shape (R, K).
        level: noise of each bin, shape (R, K).
        moving: bins that move with the reference, shape (R, K).
        has_enough_bins: whether the bins suffice to separate noise from motion, shape (R,).
    """

    response: ComplexArray
    level: NoiseLevels
    moving: BoolArray
    has_enough_bins: BoolArray


def _measured(group: Group, order: int) -> _GroupMotion:
    """Return motion and noise of a group, segments with omitted samples one by one.

    ``order``: derivatives of the reference to what the response is like at low frequencies.
    """
    references = list[_Reference]()
    if group.grid.driven:
        references.append(_Reference.from_lines(group.inputs[:, 0], order))
    if group.used is None:
        return _measured_rows(group.response, references, None)
    # The bin at half the sampling rate has no phase.
    inner = slice(0, (group.grid.samples + 1) // 2)
    by_row = [
        _measured_rows(
            group.response[row : row + 1, inner],
            [reference.part(row, inner) for reference in references],
            used[None],
        )
        for row, used in enumerate(group.used)
    ]
    padding = ((0, 0), (0, group.grid.bins - by_row[0].response.shape[1]))

    def joined(rows: Iterable[NDArray[Any]]) -> NDArray[Any]:
        return np.pad(np.concatenate(list(rows)), padding, mode="edge")

    return _GroupMotion(
        joined(row.response for row in by_row),
        NoiseLevels(*(joined(rows) for rows in zip(*(row.level for row in by_row), strict=True))),
        joined(row.moving for row in by_row),
        np.concatenate([row.has_enough_bins for row in by_row]),
    )


class _Reference(NamedTuple):
    """Reference, and its derivatives to what the response is like at low frequencies.

    A displacement over the response of an accelerometer is as steep as the inverse square of the
    frequency in the lowest bins, and one that does not end as it began leaks so: neither is smooth.

    Attributes:
        lines: the reference, shape (R, K).
        scale: factor of its derivatives at each bin, one at the last, shape (K,).
    """

    lines: ComplexArray
    scale: FloatArray

    @classmethod
    def from_lines(cls, lines: ComplexArray, order: int) -> _Reference:
        """Return a reference with its derivatives of an order; lines of shape (R, K)."""
        return cls(lines, np.linspace(0.0, 1.0, lines.shape[1]) ** order)

    def part(self, row: int, bins: slice) -> _Reference:
        """Return one segment at some of the bins."""
        return _Reference(self.lines[row : row + 1, bins], self.scale[bins])


def _measured_rows(
    response: ComplexArray, references: Sequence[_Reference], used: BoolArray | None
) -> _GroupMotion:
    """Return motion and noise of segments.

    Args:
        response: shape (R, K).
        references: that of the segments; none in a free decay.
        used: samples of the response that are used, shape (R, N); None: all.
    """
    share = 1.0 if used is None else float(np.mean(used))
    motions = [reference.lines for reference in references]
    columns = SmoothColumns.from_motions(motions, response.shape, share)
    enough = np.full(len(response), columns is not None)
    zeros = np.zeros(response.shape)
    if columns is None:
        mean = np.mean(power_of(response[:, 1:]), axis=1, keepdims=True)
        level = NoiseLevels(zeros + mean, zeros, zeros)
        return _GroupMotion(response, level, zeros > 0.0, enough)
    filled = response if used is None else columns.filled(response, used)
    bins = response.shape[1]
    response_level, moving = columns.incoherent_level(filled, may_ring=True)
    moving_bins = columns.each_bin(moving, bins)
    level = NoiseLevels(columns.level_at_bins(response_level, moving, bins), zeros, zeros)
    for reference in references:
        # Noise of the reference is not in the response; at a single tone it shows in nothing else.
        response_columns = SmoothColumns.from_motions([filled], filled.shape, share)
        assert response_columns is not None
        derived = reference.lines * reference.scale
        derived_level, coherent = response_columns.incoherent_level(derived)
        power_of_scale = reference.scale**2
        # White noise of the reference becomes as steep as the scale, also within a block.
        reference_level = derived_level / columns.mean_of_blocks(power_of_scale)
        # Leakage into both channels has passed at other frequencies.
        powers = [columns.power_without_leaks(rows) for rows in (filled, derived)]
        gain = np.divide(*powers, out=np.zeros_like(powers[0]), where=powers[1] > 0.0)
        through = columns.level_at_bins(share * gain * reference_level, coherent, bins)
        noise = columns.level_at_bins(reference_level, coherent, bins)
        # Without motion no |H|² shows.
        passed = np.where(moving_bins, through * power_of_scale / noise, 0.0)
        level = NoiseLevels(level.response, noise, passed)
    return _GroupMotion(filled * np.sqrt(share), level, moving_bins, enough)
