"""The groups of a fit: its records at the bins of their transforms, its sines, or the samples of a nonlinear model.

Noise, hum and the most likely motion are read as those that the fit is weighted by
(:mod:`vibrident.fit.noise.reading`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_below
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.fit.departures.departure import Scale
from vibrident.fit.departures.examination import Groups
from vibrident.fit.departures.group import WhitenedGroup
from vibrident.fit.departures.signals import AT_ONCE, Signals, group_of, grouped, most_likely
from vibrident.fit.descent.settle import InNoise
from vibrident.fit.descent.weighed import MAX_LOST, freed
from vibrident.fit.descent.weighting import is_steep
from vibrident.fit.estimators import Estimate
from vibrident.fit.group.network import Nuisances
from vibrident.fit.information import inverse_normal
from vibrident.fit.noise.leakage import beside_leakage
from vibrident.fit.noise.spectrum import Motion, NoiseSpectrum, noise_spectra
from vibrident.fit.noise.tones import with_tones
from vibrident.fit.problem import Evidence
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.tones import free_exponents
from vibrident.fit.response.transform import (
    SHORTEST,
    counts_in_band,
    line_frequencies,
    power_of,
    reference_colour,
    waves,
)
from vibrident.fit.uncertainty.adequacy import Points
from vibrident.fit.uncertainty.budget import Place, effects_of, patterns
from vibrident.fit.uncertainty.linearised import Linearised
from vibrident.physics.models import SensorModel
from vibrident.physics.models.slopes import response_and_slopes

#: Longer records are looked at in pieces of so many samples, so many of them: a limit of memory.
LONGEST, MOST_PIECES = 1 << 16, 4
#: Central differences of a nonlinear model's response, in its coordinates.
STEP = 1e-5
#: Bands of like information.
BANDS = 8
#: Bins on either side of a sine's tone that are of the tone.
NEAR_TONE = 4


def groups_of(evidence: Evidence, estimate: Estimate, predicted: Sequence[FloatArray], tones: Points | None) -> Groups:
    """All groups of a fit of records; none of a table, or of records that are too short.

    Args:
        evidence: the data.
        estimate: the fit.
        predicted: response of each record, NaN where it is not defined.
        tones: of the sine records, in the order of the evidence's; None without any.
    """
    effects = partial(_effects, evidence, estimate)

    def parts() -> Iterator[_Part]:
        if not estimate.findings.method.is_exact or not evidence.records:
            return iter(())
        if estimate.in_noise is not None:
            return _of_bins(evidence, estimate, estimate.in_noise, predicted)
        if evidence.only_sines and evidence.model.is_linear and tones is not None:
            return _of_sines(evidence, estimate, predicted, tones)
        return _of_samples(evidence, estimate, predicted)

    def made() -> Iterator[WhitenedGroup]:
        first = 0
        for some in _at_once(parts()):
            signals = _signals(evidence, estimate, some)
            for numbers in grouped(signals):
                yield group_of([signals[k] for k in numbers], [first + k for k in numbers], effects)
            first += len(some)

    return Groups(made, sum(min(record.samples, MOST_PIECES * LONGEST) for record in evidence.records))


@dataclass(frozen=True, eq=False)
class _Part:
    """A record, or a piece of it, of which the noise is not read yet.

    Attributes:
        record: the record.
        span: its samples, n in number.
        used: those that count, shape (n,).
        rest: residual, shape (K,).
        bins: response to the reference, shape (K,).
        motion: response as the fit has it, in time, shape (n,).
        columns: of the response's slopes with the coordinates, shape (p, K).
        nuisance: columns of the nuisance parameters, shape (m, K).
        pull: shift of the fit's coordinates by those of the record, shape (P, p); None: the same.
        turns: of the record's sine from sample to sample; None for other motion.
    """

    record: Record
    span: slice
    used: BoolArray
    rest: ComplexArray
    bins: ComplexArray
    motion: FloatArray
    columns: ComplexArray
    nuisance: ComplexArray
    pull: FloatArray | None = None
    turns: float | None = None

    @property
    def beside(self) -> ComplexArray:
        """Return the columns that are no noise, shape (q, K)."""
        if self.pull is None:
            return self.nuisance
        return np.concatenate([self.nuisance, self.columns])  # a misfit of the tone is no noise

    @property
    def floor(self) -> float:
        """Return the lower limit of the noise."""
        largest = float(np.max(np.abs(self.record.response[self.span])))
        return (np.finfo(float).eps * largest) ** 2

    @property
    def alike(self) -> tuple[float, ...]:
        """Return what parts have in common whose noise is read together."""
        counts = self.used.size, self.rest.size, len(self.beside), self.record.reference_noise_order
        return self.record.sampling_rate_hz, *counts, self.pull is None, self.turns is None


def _at_once(parts: Iterable[_Part]) -> Iterator[list[_Part]]:
    """Yield as many parts as are worked on at once."""
    held = list[_Part]()
    for part in parts:
        held.append(part)
        if sum(each.used.size for each in held) >= AT_ONCE:
            yield held
            held = []
    if held:
        yield held


def scale_of(evidence: Evidence, predicted: Sequence[FloatArray], linear: Linearised) -> Scale:
    """What the records have in common; ``linear``: the fit at all excited frequencies, linearised at the estimate."""
    order = np.argsort(linear.frequency_hz, kind="stable")
    hz, told = linear.frequency_hz[order], np.cumsum(np.sum(np.square(linear.matrix[order]), axis=1))
    top_hz = 0.5 * max((record.sampling_rate_hz for record in evidence.records), default=0.0)
    inner = np.searchsorted(told, told[-1] * np.arange(1, BANDS) / BANDS) if hz.size else np.zeros(0, dtype=int)
    between = [float(0.5 * (hz[k] + hz[k + 1])) for k in inner.tolist() if k + 1 < hz.size]
    finite = [series[np.isfinite(series)] for series in predicted]
    motion = max((float(np.max(np.abs(s - np.mean(s)))) for s in finite if s.size), default=0.0)
    tones = _tones(evidence)
    return Scale(
        max(motion, float(np.finfo(float).tiny)),
        (0.0, *dict.fromkeys(between), top_hz),
        len(evidence.records),
        any(evidence.records[index].optical is not None for index in tones),
        _mass_of(evidence.model.linear, linear.coordinates.values(linear.z)),
    )


def _mass_of(
    model: SensorModel, values: dict[str, float]
) -> Callable[[FloatArray], tuple[ComplexArray, ComplexArray]] | None:
    """Return what gives velocity of the mass and response for an acceleration of one; None of no oscillator."""
    if model.core.oscillator is None:
        return None
    natural_hz, damping = (values[name] for name in model.core.oscillator)

    def at(hz: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        velocity = 1j * hz / (natural_hz**2 - hz**2 + 2j * damping * natural_hz * hz) / (2.0 * np.pi)
        return velocity, np.asarray(model.frequency_response(values, hz, "acceleration"), dtype=complex)

    return at


def _of_bins(
    evidence: Evidence, estimate: Estimate, in_noise: InNoise, predicted: Sequence[FloatArray]
) -> Iterator[_Part]:
    """Of the segments that the fit is of, at all bins that count."""
    tones, segments = _tones(evidence), in_noise.band.problem.segments
    for place in in_noise.places(estimate.z, estimate.coordinates, whole=True):
        grid = place.group.grid
        if not grid.driven:
            continue
        for row, number in enumerate(place.group.segments):
            segment = segments[number]
            given, series = evidence.records[segment.record], predicted[segment.record][segment.span]
            used = np.ones(grid.samples, dtype=bool) if place.group.used is None else place.group.used[row]
            if used.sum() < SHORTEST:
                continue
            rest, jacobian = place.rows.residual[row], place.rows.jacobian[row]
            jacobian = jacobian * estimate.coordinates.slopes(estimate.z)[:, None]
            if grid.samples <= LONGEST:
                signals = (
                    rest,
                    place.rows.predicted[row],
                    np.where(used, series, 0.0),
                    jacobian,
                    place.rows.nuisances.columns[row],
                )
                tone = tones.get(segment.record)
                yield _Part(given, segment.span, used, *signals, turns=tone)
                continue
            pieces = _pieces(grid.samples)
            rows = [_cut(np.asarray(fft.irfft(each, grid.samples)), pieces) for each in (rest, *jacobian)]
            motions = _cut(_about_mean(series, used), pieces)
            for piece, motion, left, *columns in zip(pieces, motions, *rows, strict=True):
                there = slice(segment.span.start + piece.start, segment.span.start + piece.stop)
                yield _in_time(given, evidence, estimate, there, used[piece], left, motion, np.array(columns))


def _of_sines(
    evidence: Evidence, estimate: Estimate, predicted: Sequence[FloatArray], tones: Points
) -> Iterator[_Part]:
    """Each beside an amplitude and a phase of its own, which the points give to the fit."""
    assert evidence.tones is not None
    count = len(tones.frequency_hz)
    linear = Linearised.of_points(
        estimate.coordinates,
        estimate.z,
        evidence.quantity,
        tones.frequency_hz,
        tones.measured,
        tones.relative_deviation,
    )
    inverse = inverse_normal(linear.matrix.T @ linear.matrix)
    for place, index in enumerate(evidence.tones.record.tolist()):
        record, series = evidence.records[index], predicted[index]
        for span in _spans(record, series):
            used = (record.mask & np.isfinite(series))[span]
            turns = float(tones.frequency_hz[place]) / record.sampling_rate_hz
            wave = np.exp(2j * np.pi * turns * np.arange(used.size)) * used
            columns = np.stack([wave.real, wave.imag, used])
            moved = np.where(used, series[span], 0.0)
            share = np.linalg.lstsq(columns @ columns.T, columns @ moved, rcond=None)[0]
            motion = moved - share[2] * used  # the mean of what is no whole number of periods is not where it rests
            tone = (share[0] - 1j * share[1]) * wave
            rest = np.where(used, record.response[span] - series[span], 0.0)
            rows = np.stack([linear.matrix[place], linear.matrix[count + place]], axis=1) * linear.weight[place]
            own = (rest, motion, np.stack([tone.real, -tone.imag]))
            yield _in_time(record, evidence, estimate, span, used, *own, inverse @ rows, turns)


def _of_samples(evidence: Evidence, estimate: Estimate, predicted: Sequence[FloatArray]) -> Iterator[_Part]:
    """Of a network that runs in time, with slopes by differences."""
    if estimate.problem is None or estimate.findings.learned is not None:
        return
    step, tones = np.eye(len(estimate.z)) * STEP, _tones(evidence)
    ends = [
        [estimate.problem.predict(estimate.coordinates, estimate.z + sign * each) for sign in (1.0, -1.0)]
        for each in step
    ]
    for index, (record, series) in enumerate(zip(evidence.records, predicted, strict=True)):
        if record.reference is None:
            continue
        for span in _spans(record, series):
            used = (record.mask & np.isfinite(series))[span]
            jacobian = [np.where(used, (up[index] - down[index])[span], 0.0) / (2.0 * STEP) for up, down in ends]
            rest = np.where(used, record.response[span] - series[span], 0.0)
            own = (rest, _about_mean(series[span], used), np.array(jacobian))
            yield _in_time(record, evidence, estimate, span, used, *own, turns=tones.get(index))


def _tones(evidence: Evidence) -> dict[int, float]:
    """Turns from sample to sample of each record that is a sine."""
    if evidence.tones is None:
        return {}
    every = zip(evidence.tones.record.tolist(), evidence.tones.frequency_hz.tolist(), strict=True)
    return {index: hz / evidence.records[index].sampling_rate_hz for index, hz in every}


def _spans(record: Record, series: FloatArray) -> list[slice]:
    """Pieces of what is predicted of a record; none where that is too short."""
    used = record.mask & np.isfinite(series)
    if used.sum() < SHORTEST:
        return []
    first, last = int(np.argmax(used)), used.size - int(np.argmax(used[::-1]))
    pieces = _pieces(fast_below(last - first, MAX_LOST))
    spans = [slice(first + piece.start, first + piece.stop) for piece in pieces]
    return [span for span in spans if used[span].sum() >= SHORTEST]


def _pieces(samples: int) -> list[slice]:
    """A record, or pieces of a long one: evenly spread where it has many, as each costs memory."""
    if samples <= LONGEST:
        return [slice(0, samples)]
    every = np.arange(0, samples - SHORTEST, LONGEST)
    kept = every[np.unique(np.linspace(0, every.size - 1, min(every.size, MOST_PIECES)).astype(int))]
    return [slice(begin, min(begin + LONGEST, samples)) for begin in kept.tolist()]


def _cut(series: FloatArray, pieces: Sequence[slice]) -> list[FloatArray]:
    return [series[piece].copy() for piece in pieces]


def _about_mean(series: FloatArray, used: BoolArray) -> FloatArray:
    return np.where(used, series - np.mean(series[used]), 0.0)


def _in_time(
    record: Record,
    evidence: Evidence,
    estimate: Estimate,
    span: slice,
    used: BoolArray,
    rest: FloatArray,
    motion: FloatArray,
    jacobian: FloatArray,
    pull: FloatArray | None = None,
    turns: float | None = None,
) -> _Part:
    """Of signals in time: residual and motion, shape (n,), and Jacobian, shape (p, n), zero where not used."""
    n, values, model = used.size, estimate.coordinates.values(estimate.z), evidence.model.linear
    known = [hz * n / record.sampling_rate_hz for hz in record.hum_hz]
    straight, free = np.linspace(-1.0, 1.0, n), _free_motion(model, values, record.sampling_rate_hz, used)
    if pull is None:  # noise of the reference rings beyond either end, and so do the slopes
        free = np.concatenate([free, free * np.arange(n)])
    nuisance = np.concatenate([used[None] * 1.0, used[None] * straight, waves(known, n) * used, free])
    left, bins, columns, beside = (
        np.asarray(fft.rfft(signal, axis=-1), dtype=complex) for signal in (rest, motion, jacobian, nuisance)
    )
    return _Part(record, span, used, left, bins, motion, columns, beside, pull, turns)


def _signals(evidence: Evidence, estimate: Estimate, parts: Sequence[_Part]) -> list[Signals]:
    """Return parts with their noise; of those alike it is read together."""
    alike = dict[tuple[float, ...], list[int]]()
    for number, part in enumerate(parts):
        alike.setdefault(part.alike, []).append(number)
    signals = dict[int, Signals]()
    for numbers in alike.values():
        some = [parts[number] for number in numbers]
        signals |= zip(numbers, _signals_of_alike(evidence, estimate, some), strict=True)
    return [signals[number] for number in range(len(parts))]


def _signals_of_alike(evidence: Evidence, estimate: Estimate, parts: Sequence[_Part]) -> list[Signals]:
    """Return parts of one length and rate with their noise."""
    first = parts[0]
    samples, count = first.used.size, first.rest.size
    hz = line_frequencies(samples, first.record.sampling_rate_hz)[:count]
    values, model = estimate.coordinates.values(estimate.z), evidence.model.linear
    transfer = np.array(model.frequency_response(values, hz, evidence.quantity), dtype=complex)
    passed = power_of(transfer)
    one_sided, colour = counts_in_band(samples)[:count], reference_colour(first.record, samples)
    colour = colour[:count] if isinstance(colour, np.ndarray) else 1.0
    last, through = int(np.flatnonzero(one_sided)[-1]), passed * colour
    seen = [
        Motion(part.bins, float(part.used.sum()), last, through, colour, _harmonics(samples, part.turns, count))
        for part in parts
    ]

    @cache
    def slopes() -> ComplexArray:
        _, jacobian = response_and_slopes(evidence.model, values, hz, evidence.quantity)
        jacobian = jacobian * estimate.coordinates.slopes(estimate.z)[:, None]
        return np.divide(jacobian, transfer, out=np.zeros_like(jacobian), where=passed > 0.0)

    signals = list[Signals]()
    for part, motion, read in zip(parts, seen, _read(parts, one_sided, seen), strict=True):
        spectrum, columns = read.spectrum, part.columns
        if part.pull is not None:
            spectrum = replace(spectrum, psd=beside_leakage(spectrum.psd, motion.lines))
        share = spectrum.input_noise_at * passed / spectrum.psd
        nuisance = np.concatenate([part.nuisance, read.hum])
        if part.pull is not None:
            # less the tone itself, whose leakage is above the noise of the reference in all bins, and hides it in
            # none; and less free motion, which is not the reference's
            other = freed(part.bins - columns[0], nuisance, one_sided)
            other = most_likely(other, read.left, share, spectrum.psd * motion.count)
            place = round((part.turns or 0.0) * samples)
            other[max(place - NEAR_TONE, 0) : place + NEAR_TONE + 1] = 0.0
            nuisance = np.concatenate([nuisance, slopes() * other])
        elif evidence.model.is_linear and np.any(share):
            columns = columns + slopes() * (share * read.left)
        own = part.rest, part.bins, part.motion, columns, transfer, nuisance, spectrum, one_sided
        signals.append(Signals(part.record, part.span, part.used, *own, motion, part.floor, part.pull, part.turns))
    return signals


class _Read(NamedTuple):
    """A residual and its noise.

    Attributes:
        left: the residual beside what is no noise, shape (K,).
        hum: columns of tones, shape (m, K).
        spectrum: of the noise.
    """

    left: ComplexArray
    hum: ComplexArray
    spectrum: NoiseSpectrum


def _read(parts: Sequence[_Part], one_sided: FloatArray, seen: Sequence[Motion]) -> list[_Read]:
    """Read the noise of parts of one length and rate, again where hum or steep noise leaks."""
    rest, beside = (np.stack(rows) for rows in zip(*((part.rest, part.beside) for part in parts), strict=True))
    weight = np.broadcast_to(one_sided, rest.shape)
    left = rest - Nuisances.in_weight(beside, weight).imitated(rest[:, None])[:, 0]
    none = np.zeros((0, one_sided.size), dtype=complex)
    every = list[_Read]()
    spectra = noise_spectra(left, seen, [part.floor for part in parts])
    for part, motion, row, spectrum in zip(parts, seen, left, spectra, strict=True):
        read = _Read(row, none, spectrum)
        if spectrum.tones or is_steep(spectrum):
            read = _read_beside_hum(part, motion, one_sided / spectrum.psd, with_tones((), spectrum.tones))
        every.append(read)
    return every


def _read_beside_hum(part: _Part, motion: Motion, weight: FloatArray, tones: tuple[float, ...]) -> _Read:
    """Read the noise of a part in the weight of a first reading: what hum and steep noise leak is no noise."""

    def hum_at(places: tuple[float, ...]) -> ComplexArray:
        return np.asarray(fft.rfft(waves(places, part.used.size) * part.used, axis=1))[:, : part.rest.size]

    hum = hum_at(tones)
    left = freed(part.rest, np.concatenate([part.beside, hum]), weight)
    (spectrum,) = noise_spectra(left[None], [motion], [part.floor])
    known = with_tones(tones, spectrum.tones)
    return _Read(left, hum if known == tones else hum_at(known), spectrum)


def _free_motion(model: SensorModel, values: dict[str, float], rate_hz: float, used: BoolArray) -> FloatArray:
    """Free motion of the sensor, zero where not used, shape (q, n)."""
    lasting = free_exponents(model.poles(values), rate_hz)
    waves_of: ComplexArray = np.exp(lasting[:, None] * np.arange(used.size)) * used
    return np.concatenate([waves_of.real, waves_of.imag[lasting.imag > 0.0]])


def _harmonics(samples: int, turns: float | None, count: int) -> BoolArray | None:
    """Return the bins of a sine's harmonics, which are the sensor's and no hum, shape (K,); None of other motion."""
    if turns is None:
        return None
    place = turns * samples
    order = np.arange(count) / place
    return (np.abs(order - np.round(order)) * place < NEAR_TONE) & (np.round(order) > 0.0)


def _effects(evidence: Evidence, estimate: Estimate, signals: Signals) -> ComplexArray:
    """Relative change of the response by one standard uncertainty of each stated systematic effect, shape (K, bins)."""
    stated = [*effects_of(evidence.calibration), *evidence.effects]
    if not stated or not evidence.model.is_linear:
        return np.zeros((0, signals.rest.size), dtype=complex)
    hz = line_frequencies(signals.used.size, signals.record.sampling_rate_hz)[: signals.rest.size]
    return patterns(stated, Place(estimate.coordinates, estimate.z, evidence.quantity), hz).T
