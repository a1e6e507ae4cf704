"""Make the data of the paper's section 4, and split records into a training and a test set.

Sines of 1 g at one-third-octave frequencies, with Gaussian white noise motion 20 dB below; response
by RK4 from rest; outliers removed; one scale for each channel; 8:2 split by record.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage

from vibrident.base.errors import InputError
from vibrident.data.records import (
    STANDARD_GRAVITY,
    BoolArray,
    Calibration,
    FloatArray,
    Provenance,
    Record,
)
from vibrident.physics.discretisation import Method, method
from vibrident.physics.models import parse
from vibrident.physics.simulation import (
    SENSORS,
    Motion,
    Sine,
    Superposition,
    exact_reference,
    excitation_noise,
    nominal_frequency_name,
    one_third_octave,
    rk4_response,
)

SENSOR = SENSORS["paper"]
RATE_HZ = 51200.0
SAMPLES = 16000
#: Excitation over its noise, as the paper states it.
SNR_DB = 20.0
#: Below this frequency a record is sampled more slowly, so that it holds as many periods as this
#: one does.
SLOWER_BELOW_HZ = 10.0
#: Share of the records that are trained on.
TRAINING_SHARE = 0.8
#: Robust standard deviations from its neighbours beyond which a sample is an outlier.
MAX_ROBUST_DEVIATIONS = 10.0
#: Longest step of RK4 in radians of the natural frequency.
MAX_STEP_RAD = 0.3


@dataclass(frozen=True)
class ChannelScale:
    """Scale for all records of a channel: physical value = normalised value · unit.

    The smallest and the largest normalised value over the training records lie in [−1, 1] and one
    of them equals ±1. Zero stays zero, unlike the paper's min–max: a network without bias cannot
    correct a shift.

    Attributes:
        unit: physical value of a normalised 1.
        shift: the normalised value that plain min–max would give to zero.
    """

    unit: float
    shift: float

    @classmethod
    def from_signals(cls, signals: Sequence[FloatArray]) -> ChannelScale:
        """Return the common scale of signals."""
        low = min(float(s.min()) for s in signals)
        high = max(float(s.max()) for s in signals)
        return cls(max(abs(low), abs(high)), -(high + low) / (high - low))


@dataclass(frozen=True, eq=False)
class Dataset:
    """Records split and scaled.

    Attributes:
        calibration: physical units; outliers are replaced in the signals and marked invalid.
        training: indices of the records to train on.
        test: indices of the others.
        reference: scale of the reference channel.
        response: scale of the response channel.
        outliers: samples detected as outliers.
        motions: the true motion of every simulated record.
    """

    calibration: Calibration
    training: tuple[int, ...]
    test: tuple[int, ...]
    reference: ChannelScale
    response: ChannelScale
    outliers: int
    motions: tuple[Motion, ...] = ()

    @property
    def training_calibration(self) -> Calibration:
        """Return the training records alone, in physical units."""
        return replace(
            self.calibration, records=tuple(self.calibration.records[i] for i in self.training)
        )

    @property
    def sha256(self) -> str:
        """Return the SHA-256 of the samples of all records in order."""
        digest = hashlib.sha256()
        for record in self.calibration.records:
            digest.update(reference_signal(record).tobytes() + record.response.tobytes())
        return digest.hexdigest()


def simulate_section_4(
    *, seed: int, rate_hz: float = RATE_HZ, samples: int = SAMPLES, full_range: bool = False
) -> Dataset:
    """Return the paper's simulated data.

    ``seed``: of the noise and of the split; ``rate_hz``: which the paper does not state;
    ``full_range``: 0.1 to 1000 Hz (41 records) in place of 10 to 1000 Hz (21, the paper's number).
    """
    calibration, motions = sines(
        seed=seed, rate_hz=rate_hz, samples=samples, low_hz=0.1 if full_range else 10.0
    )
    return replace(prepare(calibration, seed=seed), motions=motions)


def sines(
    *, seed: int, rate_hz: float, samples: int, low_hz: float = 10.0
) -> tuple[Calibration, tuple[Motion, ...]]:
    """Return the paper's sines to 1000 Hz with noise motion, responses by RK4, and the motions."""
    frequencies = one_third_octave(low_hz, 1000.0)
    rates = rate_hz * np.minimum(1.0, frequencies / SLOWER_BELOW_HZ)
    streams = np.random.SeedSequence(seed).spawn(len(frequencies))
    motions = tuple(
        _motion(float(frequency), float(rate), samples, np.random.default_rng(stream))
        for frequency, rate, stream in zip(frequencies, rates, streams, strict=True)
    )
    responses = _runge_kutta(motions, rates, samples)
    history = f"simulated: {SENSOR.title}; rk4 response, start rest, seed {seed}"
    records = [
        Record(
            f"{nominal_frequency_name(float(frequency))} Hz",
            exact_reference(motion, "acceleration", sampling_rate_hz=float(rate), samples=samples),
            response,
            float(rate),
            "sine",
            frequency_hz=float(frequency),
            provenance=Provenance(history=(history, f"motion: {motion.words}")),
        )
        for frequency, rate, motion, response in zip(
            frequencies, rates, motions, responses, strict=True
        )
    ]
    calibration = Calibration(
        tuple(records),
        model=SENSOR.model,
        response_unit=SENSOR.response_unit,
        sensor={"manufacturer": "simulated", "type": SENSOR.title},
    )
    return calibration, motions


def _motion(
    frequency_hz: float, rate_hz: float, samples: int, rng: np.random.Generator
) -> Superposition:
    rms = STANDARD_GRAVITY / np.sqrt(2.0) * 10.0 ** (-SNR_DB / 20.0)
    noise = excitation_noise(rms, sampling_rate_hz=rate_hz, samples=samples, rng=rng)
    return Superposition((Sine(frequency_hz, STANDARD_GRAVITY, -0.5 * np.pi), noise))


def _runge_kutta(motions: tuple[Motion, ...], rates: FloatArray, samples: int) -> list[FloatArray]:
    """Return the responses by RK4, with one step a sample as in the paper, or more if needed."""
    fastest = 2.0 * np.pi * SENSOR.parameters["natural_frequency"]
    steps = np.maximum(1, np.ceil(fastest / MAX_STEP_RAD / rates)).astype(int)
    responses: list[FloatArray] = [np.empty(0)] * len(motions)
    for group in (np.flatnonzero(steps == 1), np.flatnonzero(steps > 1)):
        if group.size:
            rows = rk4_response(
                parse(SENSOR.model),
                SENSOR.parameters,
                [motions[i] for i in group],
                sampling_rates_hz=rates[group].tolist(),
                samples=samples,
                substeps=int(steps[group].max()),
            )
            for index, row in zip(group.tolist(), rows, strict=True):
                responses[index] = row
    return responses


def prepare(calibration: Calibration, *, seed: int) -> Dataset:
    """Remove outliers, split 8:2 by record at random, and scale.

    Raises:
        InputError: there are fewer than two records, or one has no reference.
    """
    count = len(calibration.records)
    if count < 2 or any(record.reference is None for record in calibration.records):
        raise InputError(
            "These records cannot be split into a training and a test set.",
            expected="at least two records with a reference",
            found=f"{count} records",
            where=calibration.source or "calibration in memory",
            remedy="give more records",
        )
    pairs = [_without_outliers(record) for record in calibration.records]
    records = tuple(record for record, _ in pairs)
    order = np.random.default_rng([seed, count]).permutation(count)
    first = min(count - 1, round(TRAINING_SHARE * count))
    training, test = (tuple(sorted(indices.tolist())) for indices in (order[:first], order[first:]))
    return Dataset(
        replace(calibration, records=records),
        training,
        test,
        ChannelScale.from_signals([reference_signal(records[i]) for i in training]),
        ChannelScale.from_signals([records[i].response for i in training]),
        sum(count for _, count in pairs),
    )


def outliers(signal: FloatArray) -> BoolArray:
    """Return the samples far from the cubic through their four neighbours, shape (samples,).

    The distance is relative to the usual one in the same record, so neither noise nor a steep
    signal is an outlier. An outlier also affects its neighbours: of five samples only the farthest
    counts, which finds spikes of one sample.
    """
    k = np.arange(2, signal.size - 2)
    distance = np.zeros(signal.size)
    distance[k] = np.abs(
        signal[k] - (4.0 * (signal[k - 1] + signal[k + 1]) - signal[k - 2] - signal[k + 2]) / 6.0
    )
    # A clean signal's distances are rounding and curvature, and define no usual distance.
    limit = max(
        MAX_ROBUST_DEVIATIONS * 1.4826 * float(np.median(distance)), 0.02 * float(np.std(signal))
    )
    return (distance > limit) & (distance == ndimage.maximum_filter1d(distance, 5))


def _without_outliers(record: Record) -> tuple[Record, int]:
    """Return the record without outliers, and how many there were.

    They are replaced by their neighbours' mean, and marked as invalid.
    """
    channels = {"reference": reference_signal(record), "response": record.response}
    outlying = {name: outliers(signal) for name, signal in channels.items()}
    bad = outlying["reference"] | outlying["response"]
    if not bad.any():
        return record, 0
    smooth = {
        name: np.where(outlying[name], 0.5 * (np.roll(signal, 1) + np.roll(signal, -1)), signal)
        for name, signal in channels.items()
    }
    return replace(record.without(bad, "outliers"), **smooth), int(np.sum(bad))


def reference_signal(record: Record) -> FloatArray:
    """Return the reference of a record, which each has here: ``prepare`` checks it."""
    assert record.reference is not None
    return record.reference


#: Steps of a window that are run and not scored, also at the beginning of a record.
WARM_UP_STEPS = 512
#: Steps of a window that are scored.
SCORED = 512
#: Steps at the end of a record that are not scored.
RUN_OUT = 40
#: Windows of the training records of which one is held back for early stopping: 8:2 again.
WINDOWS_PER_HELD_BACK = 5


class Windows(NamedTuple):
    """Normalised windows.

    Attributes:
        inputs: shape (W, L, q).
        targets: shape (W, L).
        score: one where a sample counts, shape (W, L).
    """

    inputs: Any
    targets: Any
    score: Any


@dataclass(frozen=True)
class NetworkInputs:
    """Inputs of a network: the samples, or the coefficients of the band-limited signal.

    Attributes:
        method: the discretisation.
        terms: inputs a step.
        delay_s: delay at which the inputs are taken.
    """

    method: Method
    terms: int = 1
    delay_s: float = 0.0

    def of(self, record: Record, unit: float) -> FloatArray:
        """Return the normalised inputs of a record, shape (samples, terms)."""
        late = self.delay_s * record.sampling_rate_hz
        every = np.ones(record.samples, dtype=bool)
        return (
            self.method.inputs(reference_signal(record), every, self.terms, late).coefficients
            / unit
        )


AS_SAMPLED = NetworkInputs(method("euler"))


def cut(dataset: Dataset, network_inputs: NetworkInputs = AS_SAMPLED) -> tuple[Windows, Windows]:
    """Cut the training records into windows to train on, and those held back."""
    by_record = [
        _cut_record(dataset, dataset.calibration.records[i], network_inputs)
        for i in dataset.training
    ]
    windows = Windows(*(np.concatenate(arrays) for arrays in zip(*by_record, strict=True)))
    numbers = np.arange(len(windows.targets))
    is_held_back = numbers % WINDOWS_PER_HELD_BACK == WINDOWS_PER_HELD_BACK - 1
    training, held_back = (
        Windows(*(array[selection] for array in windows))
        for selection in (~is_held_back, is_held_back)
    )
    return training, held_back


def _cut_record(dataset: Dataset, record: Record, network_inputs: NetworkInputs) -> Windows:
    starts = np.arange(0, record.samples - RUN_OUT - WARM_UP_STEPS - SCORED + 1, SCORED)
    take = starts[:, None] + np.arange(WARM_UP_STEPS + SCORED)
    score = record.mask.astype(float)[take]
    score[:, :WARM_UP_STEPS] = 0.0
    return Windows(
        network_inputs.of(record, dataset.reference.unit)[take],
        (record.response / dataset.response.unit)[take],
        score,
    )


def scored(record: Record) -> slice:
    """Return the samples of a whole record on which predictions are compared."""
    return slice(WARM_UP_STEPS, record.samples - RUN_OUT)


def whole_records(
    dataset: Dataset, indices: Sequence[int], network_inputs: NetworkInputs = AS_SAMPLED
) -> FloatArray:
    """Return the normalised inputs of records, padded with zeros, shape (longest, q, records)."""
    records = [dataset.calibration.records[i] for i in indices]
    inputs = np.zeros((max(r.samples for r in records), network_inputs.terms, len(records)))
    for column, record in enumerate(records):
        inputs[: record.samples, :, column] = network_inputs.of(record, dataset.reference.unit)
    return inputs
