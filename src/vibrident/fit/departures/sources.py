"""The groups of a fit: its records at the bins of their transforms, its sines, or the samples of a nonlinear model.

Noise, hum and the most likely motion are read as those that the fit is weighted by
(:mod:`vibrident.fit.noise.reading`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from numpy import fft

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.departures.departure import Scale
from vibrident.fit.departures.examination import Groups
from vibrident.fit.departures.group import WhitenedGroup
from vibrident.fit.departures.parts import LONGEST, MOST_PIECES, Part, at_once, parts_of, tones_of
from vibrident.fit.departures.signals import Signals, group_of, grouped, most_likely
from vibrident.fit.descent.weighed import freed
from vibrident.fit.descent.weighting import is_steep
from vibrident.fit.estimators import Estimate
from vibrident.fit.group.network import Nuisances
from vibrident.fit.noise.leakage import beside_leakage
from vibrident.fit.noise.spectrum import Motion, NoiseSpectrum, noise_spectra
from vibrident.fit.noise.tones import with_tones
from vibrident.fit.problem import Evidence
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import (
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

#: Bands of like information.
BANDS = 8
#: Bins on either side of a sine's tone that are of the tone.
NEAR_TONE = 4


def groups_of(
    evidence: Evidence, estimate: Estimate, predicted: Sequence[FloatArray], tones: Points | None
) -> Groups:
    """All groups of a fit of records; none of a table, or of records that are too short.

    Args:
        evidence: the data.
        estimate: the fit.
        predicted: response of each record, NaN where it is not defined.
        tones: of the sine records, in the order of the evidence's; None without any.
    """
    effects = partial(_effects, evidence, estimate)

    def made() -> Iterator[WhitenedGroup]:
        first = 0
        for some in at_once(parts_of(evidence, estimate, predicted, tones)):
            signals = _signals(evidence, estimate, some)
            for numbers in grouped(signals):
                yield group_of([signals[k] for k in numbers], [first + k for k in numbers], effects)
            first += len(some)

    return Groups(
        made, sum(min(record.samples, MOST_PIECES * LONGEST) for record in evidence.records)
    )


def scale_of(evidence: Evidence, predicted: Sequence[FloatArray], linear: Linearised) -> Scale:
    """What the records have in common; ``linear``: the fit at all excited frequencies, linearised at the estimate."""
    order = np.argsort(linear.frequency_hz, kind="stable")
    hz = linear.frequency_hz[order]
    told = np.cumsum(np.sum(np.square(linear.matrix[order]), axis=1))
    top_hz = 0.5 * max((record.sampling_rate_hz for record in evidence.records), default=0.0)
    inner = (
        np.searchsorted(told, told[-1] * np.arange(1, BANDS) / BANDS)
        if hz.size
        else np.zeros(0, dtype=int)
    )
    between = [float(0.5 * (hz[k] + hz[k + 1])) for k in inner.tolist() if k + 1 < hz.size]
    finite = [series[np.isfinite(series)] for series in predicted]
    motion = max((float(np.max(np.abs(s - np.mean(s)))) for s in finite if s.size), default=0.0)
    tones = tones_of(evidence)
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
        velocity = (
            1j * hz / (natural_hz**2 - hz**2 + 2j * damping * natural_hz * hz) / (2.0 * np.pi)
        )
        return velocity, np.asarray(
            model.frequency_response(values, hz, "acceleration"), dtype=complex
        )

    return at


def _signals(evidence: Evidence, estimate: Estimate, parts: Sequence[Part]) -> list[Signals]:
    """Return parts with their noise; of those alike it is read together."""
    alike = dict[tuple[float, ...], list[int]]()
    for number, part in enumerate(parts):
        alike.setdefault(part.alike, []).append(number)
    signals = dict[int, Signals]()
    for numbers in alike.values():
        some = [parts[number] for number in numbers]
        signals |= zip(numbers, _signals_of_alike(evidence, estimate, some), strict=True)
    return [signals[number] for number in range(len(parts))]


def _signals_of_alike(
    evidence: Evidence, estimate: Estimate, parts: Sequence[Part]
) -> list[Signals]:
    """Return parts of one length and rate with their noise."""
    first = parts[0]
    samples = first.used.size
    count = first.rest.size
    hz = line_frequencies(samples, first.record.sampling_rate_hz)[:count]
    values = estimate.coordinates.values(estimate.z)
    model = evidence.model.linear
    transfer = np.array(model.frequency_response(values, hz, evidence.quantity), dtype=complex)
    passed = power_of(transfer)
    one_sided = counts_in_band(samples)[:count]
    colour = reference_colour(first.record, samples)
    colour = colour[:count] if isinstance(colour, np.ndarray) else 1.0
    last = int(np.flatnonzero(one_sided)[-1])
    through = passed * colour
    seen = [
        Motion(
            part.bins,
            float(part.used.sum()),
            last,
            through,
            colour,
            _harmonics(samples, part.turns, count),
        )
        for part in parts
    ]

    @cache
    def slopes() -> ComplexArray:
        _, jacobian = response_and_slopes(evidence.model, values, hz, evidence.quantity)
        jacobian = jacobian * estimate.coordinates.slopes(estimate.z)[:, None]
        return np.divide(jacobian, transfer, out=np.zeros_like(jacobian), where=passed > 0.0)

    signals = list[Signals]()
    for part, motion, read in zip(parts, seen, _read(parts, one_sided, seen), strict=True):
        spectrum = read.spectrum
        columns = part.columns
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
        signals.append(
            Signals(
                part.record, part.span, part.used, *own, motion, part.floor, part.pull, part.turns
            )
        )
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


def _read(parts: Sequence[Part], one_sided: FloatArray, seen: Sequence[Motion]) -> list[_Read]:
    """Read the noise of parts of one length and rate, again where hum or steep noise leaks."""
    rest, beside = (
        np.stack(rows) for rows in zip(*((part.rest, part.beside) for part in parts), strict=True)
    )
    weight = np.broadcast_to(one_sided, rest.shape)
    left = rest - Nuisances.in_weight(beside, weight).imitated(rest[:, None])[:, 0]
    none = np.zeros((0, one_sided.size), dtype=complex)
    every = list[_Read]()
    spectra = noise_spectra(left, seen, [part.floor for part in parts])
    for part, motion, row, spectrum in zip(parts, seen, left, spectra, strict=True):
        read = _Read(row, none, spectrum)
        if spectrum.tones or is_steep(spectrum):
            read = _read_beside_hum(
                part, motion, one_sided / spectrum.psd, with_tones((), spectrum.tones)
            )
        every.append(read)
    return every


def _read_beside_hum(
    part: Part, motion: Motion, weight: FloatArray, tones: tuple[float, ...]
) -> _Read:
    """Read the noise of a part in the weight of a first reading: what hum and steep noise leak is no noise."""

    def hum_at(places: tuple[float, ...]) -> ComplexArray:
        return np.asarray(fft.rfft(waves(places, part.used.size) * part.used, axis=1))[
            :, : part.rest.size
        ]

    hum = hum_at(tones)
    left = freed(part.rest, np.concatenate([part.beside, hum]), weight)
    (spectrum,) = noise_spectra(left[None], [motion], [part.floor])
    known = with_tones(tones, spectrum.tones)
    return _Read(left, hum if known == tones else hum_at(known), spectrum)


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
