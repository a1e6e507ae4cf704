"""The tones of the sine records, without the part that the network already explains.

A sine fit of each channel alone is disturbed by motion beside the tone: vibration noise is in both
channels, but its start and end in the record leave a transient in the response that no ratio of spectra takes out
(Pintelon & Schoukens 2012, sec. 2.6). So the sine is fitted to the network's residual e = y − ŷ(x; θ), which holds
no vibration, initial state or start transient. The response's amplitude is then Y = H(θ) X + E. To first order it
does not depend on the θ used, and after two rounds the dependence is negligible.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.records import FloatArray, Record
from vibrident.fit.problem import (
    Coordinates,
    Evidence,
    FrequencyProblem,
    NetworkProblem,
    network_of,
)
from vibrident.fit.response import MeasuredResponse, measure_tones
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.sine_fit import phasors
from vibrident.fit.response.transform import hann
from vibrident.physics.discretisation import method
from vibrident.physics.discretisation.inputs import half_width_for


def network_problem(evidence: Evidence, values: dict[str, float]) -> NetworkProblem | None:
    """The network over all records with band-limited inputs; None where every record is too short for it."""
    try:
        return network_of(
            evidence.records, evidence.model, method("bandlimited"), evidence.quantity, values
        )
    except InputError:
        return None


def residual_tones(
    evidence: Evidence,
    problem: NetworkProblem | None,
    coordinates: Coordinates,
    z: FloatArray,
    predicted: Sequence[FloatArray] | None = None,
) -> MeasuredResponse:
    """The tones at coordinates ``z``; plain sine fits for records that the network does not reach.

    Args:
        evidence: with sine records.
        problem: of all records; None if there is none.
        coordinates: the map from z to parameters.
        z: where the residual is taken, shape (p,).
        predicted: the network's response to each record at ``z``, if it is known.
    """
    plain = evidence.tones
    assert plain is not None
    model, values = evidence.model, coordinates.values(z)

    def at(frequency: FloatArray) -> ComplexArray:
        return np.asarray(
            model.frequency_response(values, frequency, evidence.quantity), dtype=complex
        )

    records, poles = [evidence.records[index] for index in plain.record], model.poles(values)
    unknown = [np.full(record.samples, np.nan) for record in records]
    if predicted is None and problem is not None:
        predicted = problem.predict(coordinates, z)
    known = unknown if predicted is None else [predicted[index] for index in plain.record]
    cleaned, rest = _cleaned(records, known, plain, at, poles)
    if (
        predicted is None or not model.is_linear
    ):  # only the network brings its tones to what the linear part answers
        return cleaned
    samples = np.array([record.mask.sum() for record in records])
    deviation, noisier = cleaned.error_deviation(at), 1.5
    # Noise of the reference passes the network: where it is above the noise beside the tone, a plain sine with the free
    # motion is fitted, if that is not the noisier way.
    loud = (rest > 3.0 * deviation * np.sqrt(samples / 2.0)) | (
        deviation > noisier * plain.error_deviation(at)
    )
    if not np.any(loud):
        return cleaned
    by_sines, _ = _cleaned(records, unknown, plain, at, poles)
    loud &= by_sines.error_deviation(at) < noisier * deviation
    loud[loud] = [
        _steady(records[place], by_sines, place) for place in np.flatnonzero(loud).tolist()
    ]
    if not np.any(loud):
        return cleaned
    fewer = [
        nothing if worse else own for own, nothing, worse in zip(known, unknown, loud, strict=True)
    ]
    return _cleaned(records, fewer, plain, at, poles)[0]


def roughly_cleaned(
    evidence: Evidence, problem: NetworkProblem | None, coordinates: Coordinates, z: FloatArray
) -> FrequencyProblem | None:
    """The first look without transients: each tone of the network's residual at ``z`` by one sum under Hann's window.

    None where the network reaches no record.
    """
    first, plain = evidence.first_look, evidence.tones
    if problem is None or first is None or plain is None:
        return None
    predicted, values = problem.predict(coordinates, z), coordinates.values(z)
    frequency, reference, response, deviation = first.data
    explained = reference * evidence.model.frequency_response(values, frequency, evidence.quantity)
    cleaned = np.array(response)
    for place, index in enumerate(plain.record):
        record, series = evidence.records[index], predicted[index]
        used = record.mask & np.isfinite(series)
        window = hann(record.samples) * used
        periods = frequency[place] * record.duration_s
        if (
            used.sum() > 0.5 * record.mask.sum() and periods > 4.0
        ):  # else offset and mirror image mix with the tone
            wave = phasors(
                record.samples, -2.0 * np.pi * frequency[place] / record.sampling_rate_hz
            )
            left = np.where(used, record.response - series, 0.0) * window
            cleaned[place] = explained[place] + 2.0 * (left @ wave) / np.sum(window)
    return replace(first, data=(frequency, reference, cleaned, deviation))


def _steady(record: Record, tones: MeasuredResponse, place: int) -> bool:
    """Whether the reference keeps the size of its tone over the record, as far as its noise tells.

    Else its amplitude is another under Hann's window: the motion rings up, or changes in size, and the sensor's answer
    to that is in no sine.
    """
    mask, turns = record.mask, tones.frequency_hz[place] / record.sampling_rate_hz
    wave = phasors(record.samples, 2.0 * np.pi * turns)[mask]
    rows = np.stack([wave.real, wave.imag, np.ones(wave.size)])
    faded = rows * hann(record.samples)[mask]
    found = np.linalg.lstsq(
        faded @ rows.T, faded @ np.asarray(record.reference)[mask], rcond=1e-12
    )[0]
    noise = np.sqrt(
        np.sum(np.abs(tones.line_reference[place]) ** 2) / np.sum(tones.line_weight[place])
    )
    return bool(abs(found[0] - 1j * found[1] - tones.reference[place]) < 5.0 * noise)


def _cleaned(
    records: Sequence[Record],
    predicted: Sequence[FloatArray],
    plain: MeasuredResponse,
    at: Callable[[FloatArray], ComplexArray],
    poles: ComplexArray,
) -> tuple[MeasuredResponse, FloatArray]:
    """The tones of the residuals, and the rms of what is left beside each (zero where a plain sine was fitted).

    Records and what the network predicts of them, NaN where it does not reach, are in the order of the tones; ``at``:
    response of the model.
    """
    left, reached = [], []
    for record, series in zip(records, predicted, strict=True):
        used = record.mask & np.isfinite(series)
        # Where the network reaches too little, or interpolates by too few samples to be good to 1e-5, the record keeps
        # all its samples and its vibration noise.
        reached.append(
            half_width_for(record.samples) >= 32 and bool(used.sum() > 0.5 * record.mask.sum())
        )
        residual = np.where(used, record.response - series, 0.0)
        left.append(replace(record, response=residual, valid=used) if reached[-1] else record)
    tones = measure_tones(left, plain.frequency_hz.tolist(), poles, records)
    share = np.array(reached, dtype=float)
    power = [
        np.var(own.response[own.mask]) if cleaned else 0.0
        for own, cleaned in zip(left, reached, strict=True)
    ]
    rest = np.sqrt(np.maximum(np.array(power) - 0.5 * np.abs(tones.response) ** 2 * share, 0.0))
    lines = at(tones.line_hz.ravel()).reshape(tones.line_hz.shape)
    found = replace(
        tones,
        response=tones.response + share * at(tones.frequency_hz) * tones.reference,
        line_response=tones.line_response + share[:, None] * lines * tones.line_reference,
        record=plain.record,
    )
    return found, rest
