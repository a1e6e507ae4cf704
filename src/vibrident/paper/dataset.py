"""The data of the paper's section 4: how records become a training and a test set.

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
SNR_DB = 20.0  # excitation over its noise, as the paper states it
#: Below this frequency a record is sampled more slowly, so that it holds as many periods as this
#: one does.
SLOWER_BELOW_HZ = 10.0
TRAINING_SHARE = 0.8  # share of the records that are trained on
#: Robust standard deviations from its neighbours beyond which a sample is an outlier.
OUTLYING = 10.0
LARGEST_STEP = 0.3  # longest step of RK4 in radians of the natural frequency


@dataclass(frozen=True)
class Scale:
    """One scale for all records of a channel: physical value = normalised value · unit.

    The smallest and the largest normalised value over the training records lie in [−1, 1] and one
    of them equals ±1. Zero stays zero, unlike the paper's min–max: a network without bias cannot
    correct a shift.
    """

    unit: float  # physical value of a normalised 1
    shift: float  # the normalised value that plain min–max would give to zero

    @classmethod
    def of(cls, signals: Sequence[FloatArray]) -> Scale:
        """Return the scale of these signals together."""
        low = min(float(s.min()) for s in signals)
        high = max(float(s.max()) for s in signals)
        return cls(max(abs(low), abs(high)), -(high + low) / (high - low))


@dataclass(frozen=True, eq=False)
class Dataset:
    """Records split and scaled."""

    # Physical units; outliers are replaced in the signals and marked invalid.
    calibration: Calibration
    training: tuple[int, ...]  # indices of the records to train on
    test: tuple[int, ...]  # indices of the others
    reference: Scale  # scale of the reference channel
    response: Scale  # scale of the response channel
    outliers: int  # samples detected as outliers
    motions: tuple[Motion, ...] = ()  # the true motion of every simulated record

    @property
    def training_calibration(self) -> Calibration:
        """Return the training records alone, in physical units."""
        return replace(
            self.calibration, records=tuple(self.calibration.records[i] for i in self.training)
        )

    @property
    def sha256(self) -> str:
        """Of the samples of all records in order."""
        digest = hashlib.sha256()
        for record in self.calibration.records:
            digest.update(reference_of(record).tobytes() + record.response.tobytes())
        return digest.hexdigest()


def section_4(
    *, seed: int, rate_hz: float = RATE_HZ, samples: int = SAMPLES, full_range: bool = False
) -> Dataset:
    """Return the paper's simulated data, at a rate that it does not state; ``seed``: of the noise and of the split.

    ``full_range``: 0.1 to 1000 Hz (41 records) in place of 10 to 1000 Hz (21, the paper's number).
    """
    calibration, motions = sines(
        seed=seed, rate_hz=rate_hz, samples=samples, low_hz=0.1 if full_range else 10.0
    )
    return replace(prepared(calibration, seed=seed), motions=motions)


def sines(
    *, seed: int, rate_hz: float, samples: int, low_hz: float = 10.0
) -> tuple[Calibration, tuple[Motion, ...]]:
    """Return the paper's sines to 1000 Hz with noise motion, the response by RK4; and the motions."""
    frequencies = one_third_octave(low_hz, 1000.0)
    rates = rate_hz * np.minimum(1.0, frequencies / SLOWER_BELOW_HZ)
    streams = np.random.SeedSequence(seed).spawn(len(frequencies))
    motions = tuple(
        _motion(float(frequency), float(rate), samples, np.random.default_rng(stream))
        for frequency, rate, stream in zip(frequencies, rates, streams, strict=True)
    )
    responses = _runge_kutta(motions, rates, samples)
    made = f"simulated: {SENSOR.title}; rk4 response, start rest, seed {seed}"
    records = [
        Record(
            f"{nominal_frequency_name(float(frequency))} Hz",
            exact_reference(motion, "acceleration", sampling_rate_hz=float(rate), samples=samples),
            response,
            float(rate),
            "sine",
            frequency_hz=float(frequency),
            provenance=Provenance(history=(made, f"motion: {motion.words}")),
        )
        for frequency, rate, motion, response in zip(
            frequencies, rates, motions, responses, strict=True
        )
    ]
    whole = Calibration(
        tuple(records),
        model=SENSOR.model,
        response_unit=SENSOR.response_unit,
        sensor={"manufacturer": "simulated", "type": SENSOR.title},
    )
    return whole, motions


def _motion(
    frequency_hz: float, rate_hz: float, samples: int, rng: np.random.Generator
) -> Superposition:
    rms = STANDARD_GRAVITY / np.sqrt(2.0) * 10.0 ** (-SNR_DB / 20.0)
    noise = excitation_noise(rms, sampling_rate_hz=rate_hz, samples=samples, rng=rng)
    return Superposition((Sine(frequency_hz, STANDARD_GRAVITY, -0.5 * np.pi), noise))


def _runge_kutta(motions: tuple[Motion, ...], rates: FloatArray, samples: int) -> list[FloatArray]:
    """One step a sample, as in the paper; more if a record's sampling rate is too low for RK4."""
    fastest = 2.0 * np.pi * SENSOR.parameters["natural_frequency"]
    steps = np.maximum(1, np.ceil(fastest / LARGEST_STEP / rates)).astype(int)
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


def prepared(calibration: Calibration, *, seed: int) -> Dataset:
    """Outliers removed, split 8:2 by record at random, scaled.

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
    pairs = [_mended(record) for record in calibration.records]
    records = tuple(record for record, _ in pairs)
    order = np.random.default_rng([seed, count]).permutation(count)
    first = min(count - 1, round(TRAINING_SHARE * count))
    training, test = (tuple(sorted(part.tolist())) for part in (order[:first], order[first:]))
    return Dataset(
        replace(calibration, records=records),
        training,
        test,
        Scale.of([reference_of(records[i]) for i in training]),
        Scale.of([records[i].response for i in training]),
        sum(found for _, found in pairs),
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
    limit = max(OUTLYING * 1.4826 * float(np.median(distance)), 0.02 * float(np.std(signal)))
    return (distance > limit) & (distance == ndimage.maximum_filter1d(distance, 5))


def _mended(record: Record) -> tuple[Record, int]:
    """Return the record with its outliers replaced by their neighbours' mean and marked; and how many there were."""
    channels = {"reference": reference_of(record), "response": record.response}
    found = {name: outliers(signal) for name, signal in channels.items()}
    bad = found["reference"] | found["response"]
    if not bad.any():
        return record, 0
    smooth = {
        name: np.where(found[name], 0.5 * (np.roll(signal, 1) + np.roll(signal, -1)), signal)
        for name, signal in channels.items()
    }
    marked = record.without(bad, "outliers")
    return replace(marked, reference=smooth["reference"], response=smooth["response"]), int(
        np.sum(bad)
    )


def reference_of(record: Record) -> FloatArray:
    """Its reference, which every record here has: ``prepared`` checks it."""
    assert record.reference is not None
    return record.reference


RUN_IN = 512  # steps of a window that are run and not scored, also at the beginning of a record
SCORED = 512  # steps of a window that are scored
RUN_OUT = 40  # steps at the end of a record that are not scored
#: One of so many windows of the training records is held back for early stopping: 8:2 again.
HOLD_BACK = 5


class Windows(NamedTuple):
    """Normalised windows: inputs (W, L, q), targets (W, L), score (W, L), one where a sample counts."""

    inputs: Any
    targets: Any
    score: Any


@dataclass(frozen=True)
class Seen:
    """Inputs of a network: the samples, or the coefficients of the band-limited signal."""

    method: Method  # the discretisation
    terms: int = 1  # inputs a step
    delay_s: float = 0.0  # delay at which the inputs are taken

    def of(self, record: Record, unit: float) -> FloatArray:
        """Normalised inputs of a record, shape (samples, terms)."""
        late = self.delay_s * record.sampling_rate_hz
        every = np.ones(record.samples, dtype=bool)
        return self.method.inputs(reference_of(record), every, self.terms, late).coefficients / unit


AS_SAMPLED = Seen(method("euler"))


def cut(dataset: Dataset, seen: Seen = AS_SAMPLED) -> tuple[Windows, Windows]:
    """Windows of the training records to train on, and those held back."""
    parts = [_of_record(dataset, dataset.calibration.records[i], seen) for i in dataset.training]
    whole = Windows(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
    held = np.arange(len(whole.targets)) % HOLD_BACK == HOLD_BACK - 1
    return Windows(*(a[~held] for a in whole)), Windows(*(a[held] for a in whole))


def _of_record(dataset: Dataset, record: Record, seen: Seen) -> Windows:
    starts = np.arange(0, record.samples - RUN_OUT - RUN_IN - SCORED + 1, SCORED)
    take = starts[:, None] + np.arange(RUN_IN + SCORED)
    score = record.mask.astype(float)[take]
    score[:, :RUN_IN] = 0.0
    return Windows(
        seen.of(record, dataset.reference.unit)[take],
        (record.response / dataset.response.unit)[take],
        score,
    )


def scored(record: Record) -> slice:
    """Return the samples of a whole record on which predictions are compared."""
    return slice(RUN_IN, record.samples - RUN_OUT)


def whole_records(dataset: Dataset, indices: Sequence[int], seen: Seen = AS_SAMPLED) -> FloatArray:
    """Normalised inputs, shape (longest, q, records), padded with zeros."""
    records = [dataset.calibration.records[i] for i in indices]
    inputs = np.zeros((max(r.samples for r in records), seen.terms, len(records)))
    for column, record in enumerate(records):
        inputs[: record.samples, :, column] = seen.of(record, dataset.reference.unit)
    return inputs
