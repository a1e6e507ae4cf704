"""The groups of a fit: its records at the bins of their transforms, its sines, or the samples of a nonlinear model.

Noise, hum and the most likely motion are those that the fit is weighted by
(:mod:`vibrident.fit.noise.spectrum`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_below
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.fit.bins import RecordBins, without_offset
from vibrident.fit.departures.departure import Scale
from vibrident.fit.departures.examination import Groups
from vibrident.fit.departures.group import WhitenedGroup
from vibrident.fit.departures.signals import AT_ONCE, Signals, group_of, grouped, most_likely, projected
from vibrident.fit.descent.bins_in_noise import Weighed, beside_hum, nuisances_of, together
from vibrident.fit.descent.weighting import is_steep
from vibrident.fit.estimators import Estimate
from vibrident.fit.information import inverse_normal
from vibrident.fit.noise.motion import Motion, MotionOf, motion_of
from vibrident.fit.noise.spectrum import NoiseSpectrum, noise_spectrum
from vibrident.fit.problem import BinProblem, Evidence
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.tones import free_exponents
from vibrident.fit.response.transform import SHORTEST, line_frequencies, power_of, reference_colour, waves
from vibrident.fit.uncertainty.adequacy import Points
from vibrident.fit.uncertainty.budget import Place, effects_of, patterns
from vibrident.fit.uncertainty.linearised import Linearised
from vibrident.physics.discretisation.inputs import USABLE_BAND
from vibrident.physics.models import SensorModel
from vibrident.physics.models.slopes import response_and_slopes

#: Largest part of a record that is left out for a length that transforms fast.
MOST_LOST = 0.01
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
    problem = estimate.problem
    effects = partial(_effects, evidence, estimate)

    def signals() -> Iterator[Signals]:
        if not estimate.findings.method.is_exact or not evidence.records:
            return iter(())
        if isinstance(problem, BinProblem) and estimate.criterion == "samples":
            groups = together(evidence.records)  # bins of all records at once take more memory than the data
            return chain.from_iterable(_of_bins(evidence, estimate, problem, predicted, some) for some in groups)
        if evidence.only_sines and evidence.model.is_linear and tones is not None:
            return _of_sines(evidence, estimate, predicted, tones)
        return _of_samples(evidence, estimate, predicted)

    def made() -> Iterator[WhitenedGroup]:
        held, first = list[Signals](), 0
        for one in chain(signals(), [None]):
            if held and (one is None or sum(each.used.size for each in held) >= AT_ONCE):
                for numbers in grouped(held):
                    yield group_of([held[k] for k in numbers], [first + k for k in numbers], effects)
                first += len(held)
                held = []
            if one is not None:
                held.append(one)

    return Groups(made, sum(min(record.samples, MOST_PIECES * LONGEST) for record in evidence.records))


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
    evidence: Evidence, estimate: Estimate, problem: BinProblem, predicted: Sequence[FloatArray], some: slice
) -> Iterator[Signals]:
    """Of records that are read together."""
    network = estimate.findings.network
    assert network is not None
    tones = _tones(evidence)
    lines = problem.lines(estimate.z, estimate.coordinates, network.noise, some)
    short = {index: record for index, record in enumerate(lines, some.start) if record.samples <= LONGEST}
    motions = [_motion_of(record, tones.get(index)) for index, record in short.items()]
    spectra = beside_hum(list(short.values()), motions)
    every = zip(evidence.records[some], network.noise[some].tolist(), predicted[some], strict=True)
    for index, (given, noise, series) in enumerate(every, some.start):
        record = lines.pop(0)  # of a long record each copy counts
        whole = record.samples <= LONGEST
        motion_at, spectrum = (motions.pop(0), spectra.pop(0)) if whole else (None, None)
        if record.count < SHORTEST or record.free is None or record.model is None or given.reference is None:
            continue
        first = int(np.argmax(np.isfinite(series)))
        span = slice(first, first + record.samples)
        if motion_at is None or spectrum is None:
            pieces, used = _pieces(record.samples), record.used
            rows = [_cut(np.asarray(fft.irfft(row, used.size)), pieces) for row in (record.residual, *record.jacobian)]
            del record
            for piece, motion, rest, *jacobian in zip(
                pieces, _cut(_about_mean(series[span], used), pieces), *rows, strict=True
            ):
                there = slice(first + piece.start, first + piece.stop)
                signals = (rest * noise, motion, np.array(jacobian) * noise)
                yield _in_time(given, evidence, estimate, there, used[piece], *signals)
            continue
        (noisy,) = Weighed.at([record], [motion_at], [spectrum])
        yield Signals(
            given,
            span,
            record.used,
            record.residual * noise,
            np.array(record.predicted(slice(None))) * noise,
            np.where(record.used, series[span], 0.0),
            noisy.jacobian * noise,
            record.model.through(),
            nuisances_of(record, noisy.spectrum)(slice(None)),
            noisy.spectrum,
            noise,
            record.one_sided,
            turns=tones.get(index),
            seen=motion_at(),
            floor=record.floor,
        )


def _of_sines(
    evidence: Evidence, estimate: Estimate, predicted: Sequence[FloatArray], tones: Points
) -> Iterator[Signals]:
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


def _of_samples(evidence: Evidence, estimate: Estimate, predicted: Sequence[FloatArray]) -> Iterator[Signals]:
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
    pieces = _pieces(fast_below(last - first, MOST_LOST))
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
) -> Signals:
    """Of signals in time: residual and motion, shape (n,), and Jacobian, shape (p, n), zero where not used."""
    n = used.size
    unit = max(float(np.sqrt(np.mean(np.square(motion)))), float(np.finfo(float).tiny))
    hz = line_frequencies(n, record.sampling_rate_hz)
    values, model = estimate.coordinates.values(estimate.z), evidence.model.linear
    transfer = np.array(model.frequency_response(values, hz, evidence.quantity), dtype=complex)
    left, bins, columns = (np.asarray(fft.rfft(signal, axis=-1), dtype=complex) for signal in (rest, motion, jacobian))
    known = [hz * n / record.sampling_rate_hz for hz in record.hum_hz]
    straight, free = np.linspace(-1.0, 1.0, n), _free_motion(model, values, record.sampling_rate_hz, used)
    if pull is None:  # noise of the reference rings beyond either end, and so do the slopes
        free = np.concatenate([free, free * np.arange(n)])
    several = [used[None] * 1.0, used[None] * straight, waves(known, n) * used, free]
    nuisance = np.asarray(fft.rfft(np.concatenate(several), axis=1))
    one_sided = np.where((np.arange(bins.size) > 0) & (np.arange(bins.size) <= USABLE_BAND * n), 2.0, 0.0)
    colour, root = reference_colour(record, n), np.sqrt(one_sided)
    beside = nuisance if pull is None else np.concatenate([nuisance, columns])  # a misfit of the tone is no noise
    own, over = (np.asarray(signal / unit, dtype=complex) for signal in (left, bins))  # noise levels near one
    seen = Motion.of(over.__getitem__, float(used.sum()), np.square(np.abs(transfer)) * colour, colour)
    seen = _beside_harmonics(seen, n, turns)
    floor = (np.finfo(float).eps * float(np.max(np.abs(record.response[span]))) / unit) ** 2
    freed, spectrum = _read(own, beside, seen, floor, root)
    if is_steep(spectrum):
        freed, spectrum = _read(own, beside, seen, floor, root / np.sqrt(spectrum.psd))
    if pull is None and evidence.model.is_linear:
        share = spectrum.input_noise_at * power_of(transfer) / spectrum.psd
        columns = columns + _slopes(evidence, estimate, share * freed * unit, transfer, hz)
    if spectrum.tones:
        nuisance = np.concatenate([nuisance, np.asarray(fft.rfft(waves(spectrum.tones, n) * used, axis=1))])
    spectrum = replace(spectrum, tones=(*known, *spectrum.tones))
    if pull is not None:
        # less the tone itself, whose leakage is above the noise of the reference in all bins, and hides it in none; and
        # less free motion, which is not the reference's
        other = projected(np.asarray(fft.rfft(motion - jacobian[0]) / unit, dtype=complex), nuisance, root)
        share = spectrum.input_noise_at * power_of(transfer) / spectrum.psd
        other = most_likely(other, freed, share, spectrum.psd * float(used.sum()))
        place = round((turns or 0.0) * n)
        other[max(place - NEAR_TONE, 0) : place + NEAR_TONE + 1] = 0.0
        nuisance = np.concatenate([nuisance, _slopes(evidence, estimate, other, transfer, hz)])
    signals = left, bins, motion, columns, transfer, nuisance
    return Signals(record, span, used, *signals, spectrum, unit, one_sided, pull, turns, seen, floor)


def _read(
    rest: ComplexArray, beside: ComplexArray, seen: Motion, floor: float, root: FloatArray
) -> tuple[ComplexArray, NoiseSpectrum]:
    """A residual less the columns that fit it best, each bin weighted by ``root``, and the noise that it shows."""
    freed = projected(rest, beside, root)
    without_offset(freed)
    return freed, noise_spectrum(freed, seen, floor)


def _free_motion(model: SensorModel, values: dict[str, float], rate_hz: float, used: BoolArray) -> FloatArray:
    """Free motion of the sensor, zero where not used, shape (q, n)."""
    lasting = free_exponents(model.poles(values), rate_hz)
    waves_of: ComplexArray = np.exp(lasting[:, None] * np.arange(used.size)) * used
    return np.concatenate([waves_of.real, waves_of.imag[lasting.imag > 0.0]])


def _motion_of(record: RecordBins, turns: float | None) -> MotionOf:
    """What gives the motion of a record; ``turns``: of its tone from sample to sample, None for other motion."""
    found = motion_of(record)()
    heard = None if found is None else _beside_harmonics(found, record.samples, turns)
    return lambda: heard


def _beside_harmonics(motion: Motion, samples: int, turns: float | None) -> Motion:
    """The motion of a sine, whose harmonics are the sensor's and no hum."""
    if turns is None:
        return motion
    place = turns * samples
    order = np.arange(motion.alone.size) / place
    near = np.abs(order - np.round(order)) * place < NEAR_TONE
    return replace(motion, alone=motion.alone | (near & (np.round(order) > 0.0)))


def _slopes(
    evidence: Evidence, estimate: Estimate, bins: ComplexArray, transfer: ComplexArray, hz: FloatArray
) -> ComplexArray:
    """Bins of the response's slopes with the coordinates, shape (P, bins), for a part of the response.

    The part is what the most likely motion has beyond the reference, or the motion beside the tone of a sine, which the
    points do not use. The latter is zero where the reference may be noise: the residual is coherent with that noise.
    """
    _, jacobian = response_and_slopes(evidence.model, estimate.coordinates.values(estimate.z), hz, evidence.quantity)
    moved = np.divide(bins, transfer, out=np.zeros_like(bins), where=power_of(transfer) > 0.0)
    return np.asarray(jacobian * estimate.coordinates.slopes(estimate.z)[:, None] * moved)


def _effects(evidence: Evidence, estimate: Estimate, signals: Signals) -> ComplexArray:
    """Relative change of the response by one standard uncertainty of each stated systematic effect, shape (K, bins)."""
    stated = [*effects_of(evidence.calibration), *evidence.effects]
    if not stated or not evidence.model.is_linear:
        return np.zeros((0, signals.rest.size), dtype=complex)
    hz = line_frequencies(signals.used.size, signals.record.sampling_rate_hz)
    return patterns(stated, Place(estimate.coordinates, estimate.z, evidence.quantity), hz).T
