"""The tones of the sine records, without the part that the network already explains.

Motion beside the tone disturbs a sine fit of each channel alone: vibration noise is in both
channels, but its start and end in the record leave a transient in the response that no ratio of
spectra removes (Pintelon & Schoukens 2012, sec. 2.6). So the sine is fitted to the network's
residual e = y − ŷ(x; θ), which holds no vibration, initial state or start transient. The response's
amplitude is then Y = H(θ) X + E. To first order it does not depend on θ; after two rounds the
dependence is negligible.
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
from vibrident.physics.discretisation.inputs import kernel_for


def network_problem(evidence: Evidence, values: dict[str, float]) -> NetworkProblem | None:
    """Return the network over all records with band-limited inputs, None if all are too short."""
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
    """Return the tones at coordinates ``z``, by the network's residual.

    Records that the network does not reach have plain sine fits.

    Args:
        evidence: with sine records.
        problem: of all records; None if there is none.
        coordinates: the map from z to parameters.
        z: where the residual is taken, shape (p,).
        predicted: the network's response to each record at ``z``, if it is known.
    """
    plain = evidence.tones
    assert plain is not None
    model = evidence.model
    values = coordinates.values(z)

    def response(frequency: FloatArray) -> ComplexArray:
        return model.frequency_response(values, frequency, evidence.quantity)

    records = [evidence.records[index] for index in plain.record]
    poles = model.poles(values)
    unpredicted = [np.full(record.samples, np.nan) for record in records]
    if predicted is None and problem is not None:
        predicted = problem.predict(coordinates, z)
    predicted_by_tone = (
        unpredicted if predicted is None else [predicted[index] for index in plain.record]
    )
    cleaned, noise_rms = _tones_of_residuals(records, predicted_by_tone, plain, response, poles)
    # Only the network reduces the tones of a nonlinear model to those of its linear part.
    if predicted is None or not model.is_linear:
        return cleaned
    samples = np.array([record.mask.sum() for record in records])
    deviation = cleaned.error_deviation(response)
    max_noise_ratio = 1.5
    # Noise of the reference passes the network. Where it exceeds the noise beside the tone, a plain
    # sine with the free motion is fitted, unless that is noisier.
    noisy = (noise_rms > 3.0 * deviation * np.sqrt(samples / 2.0)) | (
        deviation > max_noise_ratio * plain.error_deviation(response)
    )
    if not np.any(noisy):
        return cleaned
    plain_cleaned, _ = _tones_of_residuals(records, unpredicted, plain, response, poles)
    noisy &= plain_cleaned.error_deviation(response) < max_noise_ratio * deviation
    noisy[noisy] = [
        _is_steady(records[place], plain_cleaned, place) for place in np.flatnonzero(noisy).tolist()
    ]
    if not np.any(noisy):
        return cleaned
    predictions = [
        unpredicted[place] if noisy[place] else prediction
        for place, prediction in enumerate(predicted_by_tone)
    ]
    return _tones_of_residuals(records, predictions, plain, response, poles)[0]


def roughly_cleaned(
    evidence: Evidence, problem: NetworkProblem | None, coordinates: Coordinates, z: FloatArray
) -> FrequencyProblem | None:
    """Return the first look without transients, None where the network reaches no record.

    Each tone of the network's residual at ``z`` comes from one sum under Hann's window.
    """
    first_look = evidence.first_look
    plain = evidence.tones
    if problem is None or first_look is None or plain is None:
        return None
    predicted = problem.predict(coordinates, z)
    values = coordinates.values(z)
    frequency, reference, response, deviation = first_look.data
    explained = reference * evidence.model.frequency_response(values, frequency, evidence.quantity)
    cleaned = np.array(response)
    for place, index in enumerate(plain.record):
        record = evidence.records[index]
        series = predicted[index]
        used = record.mask & np.isfinite(series)
        window = hann(record.samples) * used
        periods = frequency[place] * record.duration_s
        # With fewer samples or periods, offset and mirror image mix with the tone.
        if used.sum() > 0.5 * record.mask.sum() and periods > 4.0:
            wave = phasors(
                record.samples, -2.0 * np.pi * frequency[place] / record.sampling_rate_hz
            )
            residual = np.where(used, record.response - series, 0.0) * window
            cleaned[place] = explained[place] + 2.0 * (residual @ wave) / np.sum(window)
    return replace(first_look, data=(frequency, reference, cleaned, deviation))


def _is_steady(record: Record, tones: MeasuredResponse, place: int) -> bool:
    """Return whether the reference keeps the size of its tone within its noise.

    If the motion rings up or changes in size, its amplitude under Hann's window differs, and no
    sine describes the sensor's response.
    """
    mask = record.mask
    turns = tones.frequency_hz[place] / record.sampling_rate_hz
    wave = phasors(record.samples, 2.0 * np.pi * turns)[mask]
    rows = np.stack([wave.real, wave.imag, np.ones(wave.size)])
    windowed_rows = rows * hann(record.samples)[mask]
    amplitudes = np.linalg.lstsq(
        windowed_rows @ rows.T, windowed_rows @ np.asarray(record.reference)[mask], rcond=1e-12
    )[0]
    noise = np.sqrt(
        np.sum(np.abs(tones.line_reference[place]) ** 2) / np.sum(tones.line_weight[place])
    )
    return bool(abs(amplitudes[0] - 1j * amplitudes[1] - tones.reference[place]) < 5.0 * noise)


def _tones_of_residuals(
    records: Sequence[Record],
    predicted: Sequence[FloatArray],
    plain: MeasuredResponse,
    response_at: Callable[[FloatArray], ComplexArray],
    poles: ComplexArray,
) -> tuple[MeasuredResponse, FloatArray]:
    """Return the tones of the residuals, and the rms of the noise beside each.

    The rms is zero where a plain sine was fitted.

    Args:
        records: in the order of the tones.
        predicted: response of each by the network, NaN where it does not reach.
        plain: tones of the records themselves.
        response_at: complex sensitivity of the model at frequencies.
        poles: of the sensor, 1/s.
    """
    residual_records = []
    reaches = []
    for record, series in zip(records, predicted, strict=True):
        used = record.mask & np.isfinite(series)
        # Where the network predicts too few samples, or interpolates by too few for an error of
        # 1e-5, the record keeps all its samples and its vibration noise.
        reaches.append(
            kernel_for(record.samples).half_width >= 32
            and bool(used.sum() > 0.5 * record.mask.sum())
        )
        residual = np.where(used, record.response - series, 0.0)
        residual_records.append(
            replace(record, response=residual, valid=used) if reaches[-1] else record
        )
    tones = measure_tones(residual_records, plain.frequency_hz.tolist(), poles, records)
    share = np.array(reaches, dtype=float)
    powers = np.array([np.var(record.response[record.mask]) for record in residual_records])
    noise_rms = np.sqrt(np.maximum(share * (powers - 0.5 * np.abs(tones.response) ** 2), 0.0))
    lines = response_at(tones.line_hz.ravel()).reshape(tones.line_hz.shape)
    measured = replace(
        tones,
        response=tones.response + share * response_at(tones.frequency_hz) * tones.reference,
        line_response=tones.line_response + share[:, None] * lines * tones.line_reference,
        record=plain.record,
    )
    return measured, noise_rms
