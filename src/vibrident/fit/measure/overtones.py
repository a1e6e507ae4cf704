"""Harmonics that the sensor adds: the residual of a linear sensor's prediction at the multiples of a tone.

The shaker's own distortion is in the reference, passes through the model and is gone from the residual. What a sensor
adds is in its response; a harmonic of the residual that is not in the response was in the reference alone. Of an
interferometer's displacement it is the cyclic error of a motion too small to show it otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy import fft

from vibrident.base.tails import gamma_tail
from vibrident.data.records import FloatArray, Record
from vibrident.fit.measure.lines import about_mean, hann, power_of
from vibrident.fit.measure.response import ComplexArray, MeasuredResponse
from vibrident.fit.measure.rounding import (
    DITHERED,
    FEW,
    converter_step,
    repeated_errors,
    rounding_errors,
    step_of_response,
)
from vibrident.fit.measure.terms import in_parts, products, swung

#: Function from frequencies (Hz) to a complex sensitivity.
Model = Callable[[FloatArray], ComplexArray]
HIGHEST = 5
#: Harmonics count above this part of the fundamental …
LEAST = 3e-3
#: … if noise alone is as strong with less than this probability in all records together.
CHANCE = 1e-4
#: Spectral lines on either side of a harmonic for its noise level: from the first to the last of these.
NOISE_LINES = (3, 12)
#: A harmonic that the sensor adds is in the response by this part of what the prediction leaves.
OWN = 0.5


@dataclass(frozen=True)
class Overtone:
    """Harmonics of one record's residual.

    Attributes:
        record: its name.
        frequency_hz: of the tone.
        ratio: their rms over the response's fundamental.
        strongest: order of the strongest.
        probability: that noise alone is as strong.
    """

    record: str
    frequency_hz: float
    ratio: float
    strongest: int
    probability: float


def audible(found: Sequence[Overtone]) -> tuple[Overtone, ...]:
    """Those that are significant and not negligible, the strongest first."""
    least = CHANCE / max(len(found), 1)
    kept = [tone for tone in found if tone.ratio > LEAST and tone.probability < least]
    return tuple(sorted(kept, key=lambda tone: -tone.ratio))


def overtones(
    records: Sequence[Record], tones: MeasuredResponse, predicted: Sequence[FloatArray], model: Model
) -> list[Overtone]:
    """Harmonics two to five of what each sine record has beyond its prediction, and that its sensor adds.

    Args:
        records: all records; ``tones.record`` counts in them.
        tones: of the sine records.
        predicted: response predicted for each record, NaN where it is not defined.
        model: function from frequencies (Hz) to the complex sensitivity that predicted it.
    """
    return [sensor for sensor, _ in _overtones(records, tones, predicted, model) if sensor is not None]


def of_light(records: Sequence[Record], tones: MeasuredResponse, predicted: Sequence[FloatArray]) -> list[Overtone]:
    """The same of the displacement of an interferometer that the response does not show; arguments as above."""
    return [light for _, light in _overtones(records, tones, predicted, None) if light is not None]


def _overtones(
    records: Sequence[Record], tones: MeasuredResponse, predicted: Sequence[FloatArray], model: Model | None
) -> Iterator[tuple[Overtone | None, Overtone | None]]:
    """Of each sine record, what its sensor adds and what its light does; None for nothing that could be heard."""
    for index, frequency, response in zip(tones.record, tones.frequency_hz.tolist(), tones.response, strict=True):
        record, series = records[int(index)], predicted[int(index)]
        used = record.mask & np.isfinite(series)
        highest = min(HIGHEST, int(0.4 * record.sampling_rate_hz / frequency))
        periods = frequency * used.sum() / record.sampling_rate_hz
        if highest < 2 or used.sum() < 64 or periods < 2.0 * NOISE_LINES[0]:
            continue
        residual = np.where(used, record.response - series, 0.0)
        amplitude, variance = _harmonics(residual, used, frequency, record.sampling_rate_hz, highest)
        variance += _by_response_steps(record, used, residual, series, frequency, highest)
        variance += _by_reference_steps(record, used, frequency, highest, model)
        light = _of_light(record, used, frequency, amplitude)
        size, noise = np.abs(amplitude[1:]) / abs(response), variance[1:] / abs(response) ** 2
        kinds = (~light, light)
        yield tuple(_overtone(record.name, frequency, size, noise, kind) for kind in kinds)  # type: ignore[misc]


def _overtone(name: str, frequency: float, size: FloatArray, variance: FloatArray, kind: np.ndarray) -> Overtone | None:
    """Some of the harmonics from the second on, over the fundamental, with the variance of each; None for none."""
    if not kind.any():
        return None
    power = np.where(kind, size**2, 0.0)
    # Σ|A|²/(2 s²) over h harmonics is Γ(h, 1) for noise alone; s² comes from a few lines, so allow for its spread.
    statistic = float(np.sum(power / (2.0 * variance))) / (1.0 + 2.0 / (NOISE_LINES[1] - NOISE_LINES[0]))
    chance = gamma_tail(int(np.sum(kind)), statistic)
    return Overtone(name, frequency, float(np.sqrt(np.sum(power))), int(np.argmax(power)) + 2, chance)


def _of_light(record: Record, used: np.ndarray, frequency: float, residual: np.ndarray) -> np.ndarray:
    """Which harmonics, from the second on, an interferometer's light made: they are not in the response."""
    highest = len(residual)
    if record.optical is None:
        return np.zeros(highest - 1, dtype=bool)
    response = _harmonics(about_mean(record.response, used), used, frequency, record.sampling_rate_hz, highest)[0]
    return np.abs(response[1:]) < OWN * np.abs(residual[1:])


def _by_response_steps(
    record: Record, used: np.ndarray, residual: FloatArray, series: FloatArray, frequency: float, highest: int
) -> FloatArray:
    """Variance of harmonics 1…highest that the response's converter makes, shape (highest,)."""
    return _by_steps(record.response, used, step_of_response(record), residual, series, record, frequency, highest)


def _by_reference_steps(
    record: Record, used: np.ndarray, frequency: float, highest: int, model: Model | None
) -> FloatArray | float:
    """The same of the reference's converter, as the prediction has them: a resonance makes them larger."""
    reference = record.reference
    step = 0.0 if reference is None else converter_step(reference, record.reference_mask)
    if reference is None or step == 0.0 or model is None:
        return 0.0
    rate = record.sampling_rate_hz
    centred = about_mean(reference, used)
    first = _harmonics(centred, used, frequency, rate, 1)[0]
    sine = swung(first, np.array([2j * np.pi * frequency / rate]), record.samples) * used
    series = sine + float(np.mean(reference[used]))
    made = _by_steps(reference, used, step, centred - sine, series, record, frequency, highest)
    multiples = np.asarray(frequency * np.arange(1, highest + 1), dtype=float)
    return made * np.abs(model(multiples)) ** 2


def _by_steps(
    channel: FloatArray,
    used: np.ndarray,
    step: float,
    noise: FloatArray,
    series: FloatArray,
    record: Record,
    frequency: float,
    highest: int,
) -> FloatArray:
    """Variance of harmonics 1…highest that a converter makes of a sine; zero where noise dithers it."""
    if step == 0.0 or float(np.std(noise[used])) > DITHERED * step:
        return np.zeros(highest)
    rate = record.sampling_rate_hz
    number, _ = repeated_errors(channel, used, frequency / rate)
    if 0 < number < FEW:
        return np.full(highest, step**2 / 6.0 / number)
    errors = rounding_errors(np.where(used, series, 0.0), used, step, float(channel[used][0]))
    made = [_harmonics(e, used, frequency, rate, highest)[0] for e in errors]
    return np.mean(np.abs(made) ** 2, axis=0) / 2.0


def _harmonics(
    residual: FloatArray, used: np.ndarray, frequency: float, rate: float, highest: int
) -> tuple[np.ndarray, FloatArray]:
    """Complex amplitudes of harmonics 1…highest, and the variance of their real parts from lines beside them.

    Both under Hann's window: strong noise elsewhere, of a sharp resonance, would leak into the harmonics else.
    """
    n, window = residual.shape[0], hann(residual.shape[0])
    orders, faded = np.arange(1, highest + 1), window * used
    turns = np.asarray(2j * np.pi * frequency / rate * np.arange(2 * highest + 1), dtype=complex)
    right = products(faded * residual, turns[: highest + 1])
    right = np.concatenate([right[1:].real, right[1:].imag, right[:1].real])
    found, *_ = np.linalg.lstsq(_gram(faded, turns), right, rcond=1e-12)
    amplitude = found[:highest] - 1j * found[highest : 2 * highest]
    left = residual - swung(np.append(found[-1], amplitude), turns[: highest + 1], n)
    if not used.all():
        left *= used
    power = power_of(np.asarray(fft.rfft(left * window))) * 2.0 / max(float(np.sum(window[used])), 1.0) ** 2
    variance = np.empty(highest)
    first, last = NOISE_LINES
    offsets = np.concatenate([np.arange(-last, -first + 1), np.arange(first, last + 1)])
    for h in orders:
        lines = round(h * frequency * n / rate) + offsets
        lines = lines[(lines > 0) & (lines < power.shape[0])]
        variance[h - 1] = np.mean(power[lines]) if lines.size else np.inf
    if not used.all():  # omitted samples make harmonics correlated
        inverse = np.diag(np.linalg.pinv(_gram(used.astype(float), turns), rcond=1e-12, hermitian=True))[: 2 * highest]
        variance *= np.maximum(np.max(inverse.reshape(2, highest), axis=0) * used.sum() / 2.0, 1.0)
    return amplitude, np.maximum(variance, 1e-300)


def _gram(weight: FloatArray, turns: ComplexArray) -> FloatArray:
    """Weighted products of cosines and sines of harmonics 1…h, and one, with each other, shape (2 h + 1, 2 h + 1).

    Args:
        weight: of each sample.
        turns: exponents a sample of harmonics 0…2 h.
    """
    sums = products(weight, turns)
    both = np.concatenate([np.conj(sums[:0:-1]), sums])  # from −2 h to 2 h
    order, middle = np.arange(1, len(sums) // 2 + 1), len(sums) - 1
    alone = sums[order]
    gram = np.empty((len(sums), len(sums)))
    gram[:-1, :-1] = in_parts(both[middle + order[:, None] + order], both[middle + order[:, None] - order])
    gram[-1, :-1] = gram[:-1, -1] = np.concatenate([alone.real, alone.imag])
    gram[-1, -1] = sums[0].real
    return gram
