"""Simulate a calibration: sensor, excitations, exact responses, noise of the channels.

A shock has corners, hence content above half the sampling rate, which aliases unless a filter
removes it before sampling. Both channels pass the same filter, which leaves the sensor's response
to the reference unchanged.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from scipy import fft

from vibrident.base.fft_lengths import fast_length
from vibrident.data.records import QUANTITIES, Calibration, FloatArray, Provenance, Quantity, Record
from vibrident.physics.models import SensorModel, parse
from vibrident.physics.simulation.checks import require, require_choice, require_positive
from vibrident.physics.simulation.excitation import Sine
from vibrident.physics.simulation.motion import Motion
from vibrident.physics.simulation.noise import ChannelNoise
from vibrident.physics.simulation.rk4 import rk4_response
from vibrident.physics.simulation.scheme import (
    Seed,
    SimulationSettings,
    Take,
    one_third_octave,
    stream,
    with_excitation_noise,
)
from vibrident.physics.simulation.sensors import Sensor, sensor_named
from vibrident.physics.simulation.truth import Start, exact_reference, exact_response

#: Simulated rate over the sampling rate: the aliasing of a corner falls with its square.
OVERSAMPLING = 64
#: Edge of the filter's pass band over the sampling rate.
PASS_BAND_EDGE = 0.32
#: Edge of the filter's stop band over the sampling rate.
STOP_BAND_EDGE = 0.42
#: Attenuation of the stop band, dB.
STOP_BAND_ATTENUATION_DB = 160.0


@functools.cache
def _filter_taps() -> FloatArray:
    """Return the filter's taps: a Kaiser-windowed sinc at the simulated rate, odd length, sum one.

    Kaiser (1974) gives length and shape of the window for a stop band and a transition.
    """
    transition_rad = 2.0 * np.pi * (STOP_BAND_EDGE - PASS_BAND_EDGE) / OVERSAMPLING
    half = int(np.ceil((STOP_BAND_ATTENUATION_DB - 8.0) / (2.285 * transition_rad) / 2.0))
    n = np.arange(-half, half + 1)
    cut = (PASS_BAND_EDGE + STOP_BAND_EDGE) / OVERSAMPLING  # over half the simulated rate
    shape = 0.1102 * (STOP_BAND_ATTENUATION_DB - 8.7)
    taps = cut * np.sinc(cut * n) * np.kaiser(2 * half + 1, shape)
    return taps / taps.sum()


def filtered(
    channel: Callable[[float, int], FloatArray], sampling_rate_hz: float, samples: int
) -> FloatArray:
    """Return the samples of a channel behind the filter; at rest before its first sample.

    ``channel``: (sampling rate, number of samples) → values from t = 0 on.
    """
    taps = _filter_taps()
    half = len(taps) // 2
    # The filter looks ahead by half its length.
    count = (samples + math.ceil(half / OVERSAMPLING)) * OVERSAMPLING
    values = channel(sampling_rate_hz * OVERSAMPLING, count)
    size = fast_length(count + 2 * half)
    spectrum = np.asarray(fft.rfft(values, size)) * np.asarray(fft.rfft(taps, size))
    smooth = np.asarray(fft.irfft(spectrum, size))
    return smooth[half : half + samples * OVERSAMPLING : OVERSAMPLING].copy()


def simulate(
    sensor: str | Sensor | tuple[str, Mapping[str, float]] = "paper",
    excitation: str | Motion | Sequence[Motion] = "sine",
    *,
    frequencies_hz: Sequence[float] | FloatArray | None = None,
    sampling_rate_hz: float | None = None,
    samples: int = 16000,
    amplitude: float | None = None,
    repeats: int = 1,
    excitation_snr_db: float | None = None,
    excitation_noise_band_hz: tuple[float, float] | None = None,
    reference_noise: float | ChannelNoise = 0.0,
    response_noise: float | ChannelNoise = 0.0,
    start: Start = "rest",
    quantity: Quantity = "acceleration",
    method: Literal["exact", "rk4"] = "exact",
    substeps: int = 1,
    antialias: bool | None = None,
    seed: Seed = 0,
    keep_takes: list[Take] | None = None,
) -> Calibration:
    """Simulate a calibration. The defaults are the paper's (section 4), without its noise.

    Args:
        sensor: name in ``SENSORS``, a ``Sensor``, or (model, parameters), SI units, frequencies in
            Hz.
        excitation: ``sine`` (a record for every frequency), ``multisine``, ``sweep`` (log),
            ``random``, ``shock``, ``decay`` (one record each), or motions of your own, one a
            record.
        frequencies_hz: of the sines; lowest and highest are the band of sweep and random. None:
            exact one-third-octave frequencies in the sensor's usual band.
        sampling_rate_hz: samples per second; None: the sensor's usual.
        samples: of every record.
        amplitude: peak of sine, sweep and shock, and static value before a decay, m/s²; multisine
            and random have the rms of a sine of this peak. None: the sensor's usual.
        repeats: how often every motion is recorded, each time with noise of its own.
        excitation_snr_db: excitation's rms within the record over that of noise motion of the base,
            dB (paper: 20).
        excitation_noise_band_hz: of that noise, lowest and highest; None: all up to 0.4 of the
            sampling rate. In velocity or displacement its lowest frequencies dominate.
        reference_noise: of the reference channel: white, as a fraction of each record's rms, or a
            ``ChannelNoise``.
        response_noise: of the response channel, likewise.
        start: ``rest`` (as in the paper) or ``steady`` (as in a laboratory).
        quantity: of the reference.
        method: ``exact``, or ``rk4`` (the paper's) with ``substeps`` steps a sample.
        substeps: for ``rk4``.
        antialias: whether both channels pass an anti-alias filter, as in a laboratory; None: only a
            shock, whose corners would alias. Needs ``exact`` and the start from rest.
        seed: of everything random; every record and purpose has a stream of its own.
        keep_takes: a list to which the motions and their sampling are appended.

    Returns:
        Calibration with records in physical units; ``provenance.history`` of each says what was
        made.

    Raises:
        InputError: a setting cannot be used; the message says which.
        ModelError: the model is unknown, or the parameters are not those of the model.

    Examples:
        >>> import vibrident
        >>> true = {"sensitivity": 0.1, "natural_frequency": 900.0, "damping_ratio": 0.05}
        >>> sweep = vibrident.simulate(
        ...     ("accelerometer", true), "sweep", samples=4000, response_noise=1e-3, seed=1
        ... )
        >>> sweep.records[0].excitation, sweep.records[0].response.shape
        ('sweep', (4000,))
    """
    true_sensor = _sensor(sensor)
    require_choice("The start", start, ("rest", "steady"))
    require_choice("The method", method, ("exact", "rk4"))
    require_choice("The reference quantity", quantity, QUANTITIES)
    if antialias:
        require_choice("With antialias the method", method, ("exact",))
        require_choice("With antialias the start", start, ("rest",))
    model = parse(true_sensor.model)
    parameters = true_sensor.parameters
    settings = SimulationSettings(
        _frequencies(frequencies_hz, true_sensor),
        true_sensor.sampling_rate_hz if sampling_rate_hz is None else float(sampling_rate_hz),
        samples,
        true_sensor.amplitude if amplitude is None else float(amplitude),
        model.typical_frequency(parameters),
        seed,
    )
    takes = settings.takes(excitation, repeats)
    if excitation_snr_db is not None:
        for index, take in enumerate(takes):
            rng = stream(seed, index, "excitation noise")
            takes[index] = with_excitation_noise(
                take, rng, excitation_snr_db, excitation_noise_band_hz
            )
    if keep_takes is not None:
        keep_takes.extend(takes)

    may_filter = antialias is not False and method == "exact" and start == "rest"
    has_filter = [may_filter and (bool(antialias) or t.motion.kind == "shock") for t in takes]
    if method == "exact":
        responses = _exact_responses(model, parameters, takes, has_filter, start)
    else:
        responses = rk4_response(
            model,
            parameters,
            [take.motion for take in takes],
            sampling_rates_hz=[take.sampling_rate_hz for take in takes],
            samples=samples,
            start=start,
            substeps=substeps,
        )
    values = ", ".join(f"{name} {value:.9g}" for name, value in parameters.items())
    history = (
        f"simulated: {true_sensor.model} ({values}); "
        f"{method} response, start {start}, seed {_seed_text(seed)}"
    )
    calibration = Calibration(
        tuple(
            _record(take, response, quantity, history, is_filtered)
            for take, response, is_filtered in zip(takes, responses, has_filter, strict=True)
        ),
        model=true_sensor.model,
        quantity=quantity,
        response_unit=true_sensor.response_unit,
        sensor={"manufacturer": "simulated", "type": true_sensor.title},
    )
    return with_noise(
        calibration, reference_noise=reference_noise, response_noise=response_noise, seed=seed
    )


def with_noise(
    calibration: Calibration,
    *,
    reference_noise: float | ChannelNoise = 0.0,
    response_noise: float | ChannelNoise = 0.0,
    seed: Seed = 0,
) -> Calibration:
    """Return the same calibration with noise on its channels: a draw of a Monte Carlo.

    ``with_noise(simulate(…, seed=s), response_noise=e, seed=s)`` holds the samples of
    ``simulate(…, response_noise=e, seed=s)``.

    Args:
        calibration: with records.
        reference_noise: white, as a fraction of each record's rms, or a ``ChannelNoise``.
        response_noise: likewise.
        seed: of the noise; take another for every draw.

    Raises:
        InputError: the calibration is a table, or a level cannot be used.

    Examples:
        >>> import vibrident
        >>> clean = vibrident.simulate(frequencies_hz=[160], samples=4000)
        >>> noisy = vibrident.with_noise(clean, response_noise=0.01, seed=1)
        >>> noise = noisy.records[0].response - clean.records[0].response
        >>> round(float(noise.std() / clean.records[0].response.std()), 3)
        0.01
    """
    require(
        calibration.table is None,
        "Channel noise needs records.",
        expected="a calibration with records",
        found="a table",
        where=calibration.source or "calibration in memory",
        remedy="simulate records",
    )
    noises = {
        "reference": _channel_noise(reference_noise),
        "response": _channel_noise(response_noise),
    }
    noises = {channel: noise for channel, noise in noises.items() if noise.words}
    if not noises:
        return calibration
    records = [
        _noisy(record, index, noises, seed) for index, record in enumerate(calibration.records)
    ]
    return replace(calibration, records=tuple(records))


def _noisy(record: Record, index: int, noises: Mapping[str, ChannelNoise], seed: Seed) -> Record:
    """Return a record with noise on its channels."""
    changed = record
    for channel, noise in noises.items():
        truth = getattr(record, channel)
        if truth is None:  # a free decay has no reference
            continue
        values = noise.applied(truth, record.sampling_rate_hz, stream(seed, index, channel))
        changes: dict[str, Any] = {channel: values}
        if noise.full_scale is not None:
            changes[f"{channel}_full_scale"] = noise.full_scale
        step = f"{channel} channel: {noise.words}, seed {_seed_text(seed)}"
        changed = replace(changed, **changes, provenance=changed.provenance.then(step))
    return changed


def _channel_noise(noise: float | ChannelNoise) -> ChannelNoise:
    """Return the noise of a channel; a number is white noise."""
    return noise if isinstance(noise, ChannelNoise) else ChannelNoise(white=float(noise))


def _sensor(sensor: str | Sensor | tuple[str, Mapping[str, float]]) -> Sensor:
    """Return a sensor by its name, or from its model and parameters."""
    if isinstance(sensor, Sensor):
        return sensor
    if isinstance(sensor, str):
        return sensor_named(sensor)
    model, parameters = sensor
    unit = parse(model).core.response_unit or "V"
    title = "sensor of the given parameters"
    return Sensor("custom", title, model, parameters, response_unit=unit)


def _frequencies(frequencies_hz: Sequence[float] | FloatArray | None, sensor: Sensor) -> FloatArray:
    """Return the frequencies, which are those of the sensor's usual band where none are stated."""
    if frequencies_hz is None:
        return one_third_octave(*sensor.band_hz)
    frequencies = np.atleast_1d(np.asarray(frequencies_hz, dtype=float))
    require(
        frequencies.ndim == 1 and frequencies.size > 0,
        "There are no frequencies.",
        expected="a list of at least one frequency, Hz",
        found=f"shape {frequencies.shape}",
        where="simulate, frequencies_hz",
        remedy="give one_third_octave(low_hz, high_hz), say",
    )
    for frequency in frequencies:
        require_positive("simulate, frequencies_hz", frequency_hz=float(frequency))
    return frequencies


def _exact_responses(
    model: SensorModel,
    parameters: Mapping[str, float],
    takes: Sequence[Take],
    has_filter: Sequence[bool],
    start: Start,
) -> list[FloatArray]:
    """Return the response of each take, shape (samples,), behind a filter where it has one."""

    def response(take: Take, rate_hz: float, count: int) -> FloatArray:
        return exact_response(
            model,
            parameters,
            take.motion,
            sampling_rate_hz=rate_hz,
            samples=count,
            start=start,
        )

    return [
        _sampled(functools.partial(response, take), take, is_filtered)
        for take, is_filtered in zip(takes, has_filter, strict=True)
    ]


def _sampled(
    channel: Callable[[float, int], FloatArray], take: Take, is_filtered: bool
) -> FloatArray:
    """Return a channel's samples, behind an anti-alias filter or as they are."""
    if is_filtered:
        return filtered(channel, take.sampling_rate_hz, take.samples)
    return channel(take.sampling_rate_hz, take.samples)


def _record(
    take: Take, response: FloatArray, quantity: Quantity, history: str, is_filtered: bool
) -> Record:
    """Return the record of a take and its response."""
    motion = take.motion
    excitation = getattr(motion, "terms", (motion,))[0]  # without noise on it
    reference = None
    if motion.kind != "decay":

        def reference_channel(rate_hz: float, count: int) -> FloatArray:
            return exact_reference(motion, quantity, sampling_rate_hz=rate_hz, samples=count)

        reference = _sampled(reference_channel, take, is_filtered)
    steps = [history, f"motion: {motion.words}"]
    if is_filtered:
        steps.append("anti-alias filter")
    return Record(
        take.name,
        reference,
        response,
        take.sampling_rate_hz,
        motion.kind,
        frequency_hz=excitation.frequency_hz if isinstance(excitation, Sine) else None,
        provenance=Provenance(history=tuple(steps)),
    )


def _seed_text(seed: Seed) -> str:
    """Return a seed in words, for a record's history."""
    if isinstance(seed, np.random.SeedSequence):
        return f"{seed.entropy}{list(seed.spawn_key) or ''}"
    return str(seed)
