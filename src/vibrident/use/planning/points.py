"""Information of each planned point: its residual's derivative over the expected noise.

The residual is that of the estimator `ml`: a plan differs from a calibration only in that its noise
is predicted. A tone of amplitude X in N samples of white noise has real and imaginary part with
variance 2 σ²/N each; that of Y − H X follows from both channels,

    σ² = (2/N) (c σ_response² + |H|² σ_reference²).

c is one except near a sharp resonance: there the sensor's free motion, of unknown initial state, is
nearly collinear with the tone within the record.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibrident.base.errors import InputError
from vibrident.base.fields import NamedNumbers
from vibrident.data.records import FloatArray, Quantity, Record
from vibrident.fit.decay.motion import free_motion
from vibrident.fit.problem import Coordinates, FrequencyProblem
from vibrident.fit.response.tones import measure_tones
from vibrident.physics.models import SensorModel
from vibrident.physics.models.base import DERIVATIVES
from vibrident.physics.models.slopes import ComplexArray

MIN_PERIODS = 5.0  # that separate a tone from offset, drift and the sensor's free motion
MAX_FREQUENCY_OF_RATE = 0.45  # in units of the sampling rate
MIN_REPORTED_RATIO = 1.1  # factor of free motion on a tone's variance that is reported


@dataclass(frozen=True)
class Recording:
    """Length, rate and noise with which a planned calibration records each sine.

    Examples:
        >>> import vibrident
        >>> recording = vibrident.Recording(51200.0, 16000, response_noise=1e-3)
        >>> true = {"sensitivity": 0.1, "natural_frequency": 650.0, "damping_ratio": 0.18}
        >>> tones = [100.0, 400.0, 650.0]
        >>> plan = vibrident.plan("accelerometer", true, frequencies_hz=tones, recording=recording)
        >>> plan.parameters["sensitivity"].standard_uncertainty < 1e-5
        True
    """

    sampling_rate_hz: float  # samples per second
    samples: int  # of every record
    response_noise: float = 0.0  # white, as a fraction of the response's rms in each record
    response_noise_rms: float = 0.0  # white, in the response unit; added to the former
    # white, as a fraction of the reference's rms, not motion of the sensor
    reference_noise: float = 0.0
    reference_noise_rms: float = 0.0  # white, in the reference's unit; added to the former

    def __post_init__(self) -> None:
        if not (
            np.isfinite(self.sampling_rate_hz) and self.sampling_rate_hz > 0 and self.samples >= 16
        ):
            raise InputError(
                "The recording cannot be planned.",
                expected="a sampling rate above 0 and at least 16 samples",
                found=f"{self.sampling_rate_hz!r} Hz, {self.samples!r} samples",
                where="⟦plan.sampling_rate_hz⟧, ⟦plan.samples⟧",
                remedy="correct them",
            )
        noise = np.array(
            [
                self.response_noise,
                self.response_noise_rms,
                self.reference_noise,
                self.reference_noise_rms,
            ]
        )
        if not (np.isfinite(noise).all() and (noise >= 0).all() and noise.any()):
            raise InputError(
                "The noise cannot be planned with.",
                expected="finite numbers, 0 or above, and one of them above 0",
                found=", ".join(f"{value:g}" for value in noise),
                where="⟦plan.response_noise⟧, ⟦plan.reference_noise⟧",
                remedy="give the noise of the response (and of the reference), relative or as rms",
            )


@dataclass(frozen=True, eq=False)
class Subject:
    """Sensor that is planned for, and the planned frequencies."""

    model: SensorModel  # linear
    values: NamedNumbers  # of its parameters, SI units, frequencies in Hz
    quantity: Quantity  # of the reference
    frequency_hz: FloatArray  # ascending, shape (n,)

    def response(self) -> ComplexArray:
        """Return the complex response per unit of the reference, shape (n,)."""
        return np.asarray(
            self.model.frequency_response(self.values, self.frequency_hz, self.quantity),
            dtype=complex,
        )


@dataclass(frozen=True, eq=False)
class PlannedPoints:
    """Planned points and their information."""

    coordinates: Coordinates  # map from z to parameters; the sensor is at their ``first``
    subject: Subject  # sensor and frequencies
    information: FloatArray  # JᵀJ of each point, shape (n, p, p)
    # standard deviation of each point's sensitivity over its size, shape (n,)
    relative_deviation: FloatArray
    # degrees of freedom of each point's noise estimate, infinite where uncertainties are stated;
    # shape (n,)
    freedom: FloatArray
    equations: int  # real residuals of a point
    findings: tuple[str, ...] = ()  # doubts in words
    periods: FloatArray | None = None  # in each point's record, shape (n,); None for a table


def points_of_records(
    subject: Subject, amplitude: FloatArray, recording: Recording
) -> PlannedPoints:
    """Return points of sine records.

    Args:
        subject: sensor and frequencies.
        amplitude: peak of the acceleration at each frequency, m/s², shape (n,).
        recording: of every sine.

    Raises:
        InputError: a frequency or an amplitude cannot be recorded.
    """
    frequency_hz = subject.frequency_hz
    highest = MAX_FREQUENCY_OF_RATE * recording.sampling_rate_hz
    if not (
        (amplitude > 0).all()
        and np.isfinite(amplitude).all()
        and float(frequency_hz.max()) <= highest
    ):
        raise InputError(
            "A point cannot be recorded.",
            expected=(
                f"amplitudes above 0, and frequencies up to {highest:g} Hz (0.45 of the sampling "
                "rate)"
            ),
            found=(
                f"amplitudes from {amplitude.min():g}, frequencies up to {frequency_hz.max():g} Hz"
            ),
            where="⟦plan.amplitude⟧, ⟦plan.frequencies_hz⟧",
            remedy="correct the amplitude, lower the frequency, or raise the sampling rate",
        )
    reference = amplitude / np.abs(2j * np.pi * frequency_hz) ** DERIVATIVES[subject.quantity]
    gain = subject.response()
    response = np.abs(gain) * reference
    noise_y = (recording.response_noise * response) ** 2 / 2.0 + recording.response_noise_rms**2
    noise_x = (recording.reference_noise * reference) ** 2 / 2.0 + recording.reference_noise_rms**2
    ratio = np.array([_free_motion_ratio(subject, f, recording) for f in frequency_hz])
    deviation = np.sqrt(2.0 / recording.samples * (ratio * noise_y + np.abs(gain) ** 2 * noise_x))
    freedom = np.array([_freedom(f, recording) for f in frequency_hz])
    findings = _resonance_findings(subject, ratio)
    data = (frequency_hz, reference.astype(complex), gain * reference, deviation)
    points = _points(subject, data, False, True, deviation / response, freedom, findings)
    duration_s = recording.samples / recording.sampling_rate_hz
    return replace(points, periods=frequency_hz * duration_s)


def points_of_table(
    subject: Subject, magnitude: FloatArray, phase_rad: FloatArray | None
) -> PlannedPoints:
    """Return points with stated uncertainties.

    Args:
        subject: sensor and frequencies.
        magnitude: relative standard uncertainty of the magnitude at each frequency, shape (n,).
        phase_rad: standard uncertainty of the phase at each frequency, rad, shape (n,); None: no
            phase is measured.

    Raises:
        InputError: an uncertainty is not above zero.
    """
    for label, where, u in (
        ("magnitude", "⟦plan.magnitude_uncertainty⟧", magnitude),
        ("phase", "⟦plan.phase_uncertainty_rad⟧", phase_rad),
    ):
        if u is not None and not (np.isfinite(u).all() and (u > 0).all()):
            raise InputError(
                f"The uncertainty of the {label} cannot be planned with.",
                expected="finite numbers above 0",
                found=f"{np.min(u):g}",
                where=where,
                remedy="give a standard uncertainty (k = 1)",
            )
    gain = subject.response()
    size = np.abs(gain)
    phase = np.angle(gain)
    u_phase = np.ones_like(size) if phase_rad is None else phase_rad
    data = (subject.frequency_hz, size, phase, magnitude * size, u_phase)
    freedom = np.full(size.shape, np.inf)
    return _points(subject, data, True, phase_rad is not None, magnitude, freedom, ())


def _points(
    subject: Subject,
    data: tuple[Any, ...],
    polar: bool,
    has_phase: bool,
    relative: FloatArray,
    freedom: FloatArray,
    findings: tuple[str, ...],
) -> PlannedPoints:
    frequency = subject.frequency_hz
    coordinates = Coordinates.at(
        subject.model, subject.values, (float(frequency.min()), float(frequency.max()))
    )
    z = coordinates.first
    rows = FrequencyProblem(subject.model, subject.quantity, data, polar, has_phase).jacobian(
        z, coordinates
    )
    blocks = rows.reshape(-1, frequency.size, z.size)
    information = np.einsum("rki,rkj->kij", blocks, blocks)
    return PlannedPoints(
        coordinates, subject, information, relative, freedom, blocks.shape[0], findings
    )


def short_record_findings(points: PlannedPoints, chosen: np.ndarray) -> tuple[str, ...]:
    """Return the finding on records of few periods; ``chosen``: indices of the planned points."""
    if points.periods is None:
        return ()
    few = points.subject.frequency_hz[chosen][points.periods[chosen] < MIN_PERIODS]
    if not few.size:
        return ()
    return (
        f"{few.size} records hold fewer than {MIN_PERIODS:g} periods (up to {few.max():.4g} Hz): "
        "offset, drift and the sensor's free motion will increase their uncertainty beyond this "
        "plan.",
    )


def _resonance_findings(subject: Subject, ratio: FloatArray) -> tuple[str, ...]:
    """Return the effects of a sharp resonance that a plan does not include."""
    oscillator = subject.model.core.oscillator
    frequency_hz = subject.frequency_hz
    if oscillator is None:
        return ()
    natural, damping = (subject.values[name] for name in oscillator)
    width = 2.0 * damping * natural
    lasts = 1.0 / (np.pi * width) if width > 0 else np.inf
    findings = []
    if np.any(ratio > MIN_REPORTED_RATIO):
        findings.append(
            f"The sensor rings on for {lasts:.3g} s (to 1/e) after a record begins, which near "
            f"{natural:.4g} Hz is hardly separable from the tone: estimates may scatter up to "
            "twice as much as planned. Record for longer."
        )
    if (
        frequency_hz.min() < natural < frequency_hz.max()
        and np.min(np.abs(frequency_hz - natural)) > width
    ):
        findings.append(
            f"No point lies within the resonance, {width:.3g} Hz wide at {natural:.5g} Hz: the "
            "identification may settle on another optimum, and the plan holds for the right one "
            "only. Plan points within it."
        )
    return tuple(findings)


def _free_motion_ratio(subject: Subject, frequency: float, recording: Recording) -> float:
    """Return the factor by which free motion and an offset increase a tone's variance.

    It is the mean of the tone's two parts.
    """
    time = np.arange(recording.samples) / recording.sampling_rate_hz
    angle = 2.0 * np.pi * frequency * time
    tone = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    oscillator = subject.model.core.oscillator
    if oscillator is None:
        motion = np.exp(-subject.model.fastest(subject.values) * time)[:, None]
    else:
        natural, damping = (subject.values[name] for name in oscillator)
        motion = free_motion(natural, max(damping, 0.0), time)
    free, _ = np.linalg.qr(np.concatenate([motion, np.ones((time.size, 1))], axis=1))
    projected = tone - free @ (free.T @ tone)
    inverse = np.linalg.inv(projected.T @ projected)
    return float(np.trace(inverse) / 2.0 * recording.samples / 2.0)


def _freedom(frequency: float, recording: Recording) -> float:
    """Return the degrees of freedom of the noise in the sine fit of such a record."""
    time = np.arange(recording.samples) / recording.sampling_rate_hz
    noise = np.random.default_rng(0).standard_normal((2, recording.samples))
    tone = np.sin(2.0 * np.pi * frequency * time)
    record = Record(
        "planned", tone + 1e-3 * noise[0], tone + 1e-3 * noise[1], recording.sampling_rate_hz
    )
    return float(measure_tones([record], [frequency]).degrees_of_freedom[0])
