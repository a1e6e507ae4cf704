"""The groups of a fit that the score tests look at.

They hold its records at the bins of their transforms, its sines, or the samples of a nonlinear
model. Noise, hum and the most likely motion are read as those that the fit is weighted by
(:mod:`vibrident.fit.noise.reading`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from numpy import fft

from vibrident.data.records import FloatArray
from vibrident.fit.departures.departure import Scale
from vibrident.fit.departures.examination import Groups
from vibrident.fit.departures.group import WhitenedGroup
from vibrident.fit.departures.parts import (
    MAX_PIECE_SAMPLES,
    MAX_PIECES,
    at_once,
    parts_of,
    tones_of,
)
from vibrident.fit.departures.signals import Part, Signals, grouped, most_likely
from vibrident.fit.departures.stack import group_of
from vibrident.fit.descent.weighted_bins import freed
from vibrident.fit.descent.weighting import is_steep
from vibrident.fit.estimators import Estimate
from vibrident.fit.group.network import Nuisances
from vibrident.fit.noise.leakage import beside_leakage
from vibrident.fit.noise.spectrum import NoiseSpectrum, PredictedMotion, noise_spectra
from vibrident.fit.noise.tones import MAX_TONE_DISTANCE, harmonic_bins, with_tones
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


def groups_of(
    evidence: Evidence, estimate: Estimate, predicted: Sequence[FloatArray], tones: Points | None
) -> Groups:
    """Return all groups of a fit of records; none of a table, or of too short records.

    Args:
        evidence: the data.
        estimate: the fit.
        predicted: response of each record, NaN where it is not defined.
        tones: of the sine records, in the order of the evidence's; None without any.
    """
    effects = partial(_effects, evidence, estimate)

    def make() -> Iterator[WhitenedGroup]:
        first = 0
        for parts in at_once(parts_of(evidence, estimate, predicted, tones)):
            signals = _signals(evidence, estimate, parts)
            for numbers in grouped(signals):
                yield group_of([signals[k] for k in numbers], [first + k for k in numbers], effects)
            first += len(parts)

    return Groups(
        make,
        sum(min(record.samples, MAX_PIECES * MAX_PIECE_SAMPLES) for record in evidence.records),
    )


def scale_of(evidence: Evidence, predicted: Sequence[FloatArray], linear: Linearised) -> Scale:
    """Return what the records have in common.

    ``linear``: the fit at all excited frequencies, linearised at the estimate.
    """
    order = np.argsort(linear.frequency_hz, kind="stable")
    hz = linear.frequency_hz[order]
    information = np.cumsum(np.sum(np.square(linear.matrix[order]), axis=1))
    top_hz = 0.5 * max((record.sampling_rate_hz for record in evidence.records), default=0.0)
    inner = (
        np.searchsorted(information, information[-1] * np.arange(1, BANDS) / BANDS)
        if hz.size
        else np.zeros(0, dtype=int)
    )
    edges = [float(0.5 * (hz[k] + hz[k + 1])) for k in inner.tolist() if k + 1 < hz.size]
    finite = [series[np.isfinite(series)] for series in predicted]
    motion = max(
        (float(np.max(np.abs(values - np.mean(values)))) for values in finite if values.size),
        default=0.0,
    )
    tones = tones_of(evidence)
    return Scale(
        max(motion, float(np.finfo(float).tiny)),
        (0.0, *dict.fromkeys(edges), top_hz),
        len(evidence.records),
        any(evidence.records[index].optical is not None for index in tones),
        _mass_of(evidence.model.linear, linear.coordinates.values(linear.z)),
        frozenset(add_on.name for add_on in evidence.model.add_ons),
    )


def _mass_of(
    model: SensorModel, values: dict[str, float]
) -> Callable[[FloatArray], tuple[ComplexArray, ComplexArray]] | None:
    """Return the function from frequency to velocity of the mass and response.

    Both are for an acceleration of one; None of no oscillator.
    """
    if model.core.oscillator is None:
        return None
    natural_hz, damping = (values[name] for name in model.core.oscillator)

    def motion_of_mass(hz: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        velocity = (
            1j * hz / (natural_hz**2 - hz**2 + 2j * damping * natural_hz * hz) / (2.0 * np.pi)
        )
        return velocity, np.asarray(
            model.frequency_response(values, hz, "acceleration"), dtype=complex
        )

    return motion_of_mass


def _signals(evidence: Evidence, estimate: Estimate, parts: Sequence[Part]) -> list[Signals]:
    """Return the parts with their noise, which is read together of those alike."""
    numbers_by_kind = dict[tuple[float, ...], list[int]]()
    for number, part in enumerate(parts):
        numbers_by_kind.setdefault(part.alike, []).append(number)
    signals = dict[int, Signals]()
    for numbers in numbers_by_kind.values():
        alike = [parts[number] for number in numbers]
        signals |= zip(numbers, _signals_of_alike(evidence, estimate, alike), strict=True)
    return [signals[number] for number in range(len(parts))]


def _signals_of_alike(
    evidence: Evidence, estimate: Estimate, parts: Sequence[Part]
) -> list[Signals]:
    """Return parts of one length and rate with their noise."""
    first = parts[0]
    samples = first.used.size
    count = first.residual.size
    hz = line_frequencies(samples, first.record.sampling_rate_hz)[:count]
    values = estimate.coordinates.values(estimate.z)
    model = evidence.model.linear
    transfer = np.array(model.frequency_response(values, hz, evidence.quantity), dtype=complex)
    passed = power_of(transfer)
    one_sided = counts_in_band(samples)[:count]
    colour = reference_colour(first.record, samples)
    colour = colour[:count] if isinstance(colour, np.ndarray) else 1.0
    last = int(np.flatnonzero(one_sided)[-1])
    input_colour = passed * colour
    motions = [
        PredictedMotion(
            part.predicted,
            float(part.used.sum()),
            last,
            input_colour,
            colour,
            None if part.turns is None else harmonic_bins(samples, part.turns, count),
        )
        for part in parts
    ]

    @cache
    def slopes() -> ComplexArray:
        _, jacobian = response_and_slopes(evidence.model, values, hz, evidence.quantity)
        jacobian = jacobian * estimate.coordinates.slopes(estimate.z)[:, None]
        return np.divide(jacobian, transfer, out=np.zeros_like(jacobian), where=passed > 0.0)

    signals = list[Signals]()
    for part, motion, reading in zip(
        parts, motions, _read_noise(parts, one_sided, motions), strict=True
    ):
        spectrum = reading.spectrum
        jacobian = part.jacobian
        if part.pull is not None:
            spectrum = replace(spectrum, psd=beside_leakage(spectrum.psd, motion.lines))
        share = spectrum.input_noise_at * passed / spectrum.psd
        nuisance = np.concatenate([part.nuisance, reading.hum])
        if part.pull is not None:
            # Less the tone itself, and less free motion, which is not the reference's.
            motion_beside_tone = freed(part.predicted - jacobian[0], nuisance, one_sided)
            motion_beside_tone = most_likely(
                motion_beside_tone, reading.residual, share, spectrum.psd * motion.count
            )
            motion_beside_tone[_bins_of_tone(part)] = 0.0
            nuisance = np.concatenate([nuisance, slopes() * motion_beside_tone])
        elif evidence.model.is_linear and np.any(share):
            jacobian = jacobian + slopes() * (share * reading.residual)
        in_noise = {"jacobian": jacobian, "nuisance": nuisance, "transfer": transfer}
        in_noise |= {"spectrum": spectrum, "one_sided": one_sided, "motion": motion}
        signals.append(Signals(**vars(part) | in_noise))
    return signals


def _bins_of_tone(part: Part) -> slice:
    """Return the bins of a sine's tone.

    Its leakage is above the noise of the reference in all bins, and hides it in none.
    """
    place = round((part.turns or 0.0) * part.used.size)
    return slice(max(place - MAX_TONE_DISTANCE, 0), place + MAX_TONE_DISTANCE + 1)


class _Reading(NamedTuple):
    """A residual and its noise.

    Attributes:
        residual: of the part beside what is no noise, shape (K,).
        hum: columns of tones, shape (m, K).
        spectrum: of the noise.
    """

    residual: ComplexArray
    hum: ComplexArray
    spectrum: NoiseSpectrum


def _read_noise(
    parts: Sequence[Part], one_sided: FloatArray, motions: Sequence[PredictedMotion]
) -> list[_Reading]:
    """Return the noise of parts of one length and rate, again where hum or steep noise leaks."""
    known = [part.known_noise for part in parts]
    no_hum = np.zeros((0, one_sided.size), dtype=complex)
    if all(noise is not None for noise in known):
        pairs = zip(parts, known, strict=True)
        return [_Reading(part.residual, no_hum, noise) for part, noise in pairs if noise]
    residuals, columns = (
        np.stack(rows)
        for rows in zip(
            *((part.residual, part.columns_beside_noise) for part in parts), strict=True
        )
    )
    weight = np.broadcast_to(one_sided, residuals.shape)
    noise = residuals - Nuisances.in_weight(columns, weight).imitated(residuals[:, None])[:, 0]
    readings = list[_Reading]()
    spectra = noise_spectra(noise, motions, [part.floor for part in parts])
    for part, motion, noise_of_part, spectrum in zip(parts, motions, noise, spectra, strict=True):
        reading = _Reading(noise_of_part, no_hum, spectrum)
        if spectrum.tones or is_steep(spectrum):
            reading = _read_beside_hum(
                part, motion, one_sided / spectrum.psd, with_tones((), spectrum.tones)
            )
        readings.append(reading)
    return readings


def _read_beside_hum(
    part: Part, motion: PredictedMotion, weight: FloatArray, tones: tuple[float, ...]
) -> _Reading:
    """Return the noise of a part in the weight of a first reading.

    What hum and steep noise leak is no noise.
    """

    def hum_at(places: tuple[float, ...]) -> ComplexArray:
        return np.asarray(fft.rfft(waves(places, part.used.size) * part.used, axis=1))[
            :, : part.residual.size
        ]

    hum = hum_at(tones)
    noise = freed(part.residual, np.concatenate([part.columns_beside_noise, hum]), weight)
    (spectrum,) = noise_spectra(noise[None], [motion], [part.floor])
    all_tones = with_tones(tones, spectrum.tones)
    return _Reading(noise, hum if all_tones == tones else hum_at(all_tones), spectrum)


def _effects(evidence: Evidence, estimate: Estimate, signals: Signals) -> ComplexArray:
    """Return the relative change of the response by one u of each stated effect, (K, bins)."""
    stated = [*effects_of(evidence.calibration), *evidence.effects]
    if not stated or not evidence.model.is_linear:
        return np.zeros((0, signals.residual.size), dtype=complex)
    hz = line_frequencies(signals.used.size, signals.record.sampling_rate_hz)[
        : signals.residual.size
    ]
    return patterns(stated, Place(estimate.coordinates, estimate.z, evidence.quantity), hz).T
