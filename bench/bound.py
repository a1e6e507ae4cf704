"""The Cramér–Rao bound, computed independently: dense Fisher information in numpy from closed-form sensitivities.

Response of V̈ + 2 δ ωn V̇ + ωn² V = S0 ωn² a to a sum of tones, from any initial state:

    y(t) = Re Σ_m H(jω_m) p_m e^{jω_m t} + Re c e^{s t} + b,   s = ωn (−δ + j √(1 − δ²)),
    H(jω) = S0 ωn² / (ωn² − ω² + 2 j δ ωn ω)

    ∂y/∂θ = Re Σ_m ∂H/∂θ p_m e^{jω_m t} + Re c t ∂s/∂θ e^{s t} + (what a change of c gives).

The initial state (c) and the offset b of every record are unknown, so the sensitivities are projected orthogonally to
Re e^{s t}, Im e^{s t} and 1. Nothing of vibrident's estimators or uncertainties is used; simulate's
exact response only checks the sensitivities, by central differences.
"""

from __future__ import annotations

import numpy as np

from bench.truth import PARAMETERS, RESPONSE_NOISE, SENSOR, Truth, model, tones_of
from vibrident.simulation import exact_response

#: Largest relative deviation allowed between closed form and central differences.
AGREEMENT = 1e-6


def standard_deviations(truth: Truth) -> tuple[dict[str, float], float]:
    """Least standard deviation of each parameter under white response noise, and the check of the sensitivities.

    Returns:
        The bound by parameter, and the largest relative deviation of the sensitivities from central differences.

    Raises:
        ArithmeticError: the closed form and simulate's exact response disagree.
    """
    information = np.zeros((3, 3))
    worst = 0.0
    nuisance = _nuisance(truth)
    for motion, record in zip(truth.motions, truth.calibration.records, strict=True):
        free = nuisance @ (nuisance.T @ (columns := sensitivities(truth, motion)))
        columns = columns - free
        differences = _differences(truth, motion)
        differences -= nuisance @ (nuisance.T @ differences)
        deviation = np.linalg.norm(columns - differences, axis=0) / np.linalg.norm(columns, axis=0)
        worst = max(worst, float(np.max(deviation)))
        noise = RESPONSE_NOISE * np.sqrt(np.mean(np.square(record.response)))
        information += columns.T @ columns / noise**2
    if not worst < AGREEMENT:
        raise ArithmeticError(f"The sensitivities of the bound disagree with the exact response by {worst:.2g}.")
    scale = np.sqrt(np.diag(information))
    inverse = np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)
    return dict(zip(PARAMETERS, np.sqrt(np.diag(inverse)).tolist(), strict=True)), worst


def sensitivities(truth: Truth, motion: object) -> np.ndarray:
    """∂y/∂(S0, fn, δ), shape (samples, 3), up to what a change of the initial state gives."""
    gain, fn, damping = (SENSOR.parameters[name] for name in PARAMETERS)
    wn, root = 2.0 * np.pi * fn, np.sqrt(1.0 - damping**2)
    pole = wn * (-damping + 1j * root)
    time = np.arange(truth.samples) / truth.rate_hz
    columns = np.zeros((truth.samples, 3))
    start = np.zeros(2)  # value and slope of the steady response at t = 0
    for frequency, phasor, fundamental in tones_of(motion):
        omega = 2.0 * np.pi * frequency
        denominator = wn**2 - omega**2 + 2j * damping * wn * omega
        response = gain * wn**2 / denominator
        by_wn = response * (2.0 / wn - (2.0 * wn + 2j * damping * omega) / denominator)
        by_damping = -response * 2j * wn * omega / denominator
        for column, slope in enumerate((response / gain, 2.0 * np.pi * by_wn, by_damping)):
            columns[:, column] += _sum(frequency, slope * phasor, fundamental, truth)
        steady = response * phasor
        start += [float(np.sum(steady).real), float(np.sum(1j * omega * steady).real)]
    # At rest at t = 0: Re c = −y(0), Re c s = −ẏ(0).
    real = -start[0]
    free = real + 1j * (start[1] + real * pole.real) / pole.imag
    ringing = free * time * np.exp(pole * time)
    columns[:, 1] += (ringing * 2.0 * np.pi * pole / wn).real
    columns[:, 2] += (ringing * wn * (-1.0 - 1j * damping / root)).real
    return columns


def _sum(frequency: np.ndarray, phasor: np.ndarray, fundamental: float | None, truth: Truth) -> np.ndarray:
    """Re Σ_m p_m e^{j 2π f_m k/rate}, by FFT where the tones are harmonics that repeat after whole samples."""
    if fundamental is None:
        time = np.arange(truth.samples) / truth.rate_hz
        return (np.exp(2j * np.pi * np.outer(time, frequency)) @ phasor).real
    period = round(truth.rate_hz / fundamental)
    spectrum = np.zeros(period, dtype=complex)
    spectrum[np.rint(frequency / fundamental).astype(int)] = phasor
    return np.resize((np.fft.ifft(spectrum) * period).real, truth.samples)


def _nuisance(truth: Truth) -> np.ndarray:
    """Orthonormal columns of the responses to initial state and offset, shape (samples, 3)."""
    _, fn, damping = (SENSOR.parameters[name] for name in PARAMETERS)
    pole = 2.0 * np.pi * fn * (-damping + 1j * np.sqrt(1.0 - damping**2))
    free = np.exp(pole * np.arange(truth.samples) / truth.rate_hz)
    return np.linalg.qr(np.stack([free.real, free.imag, np.ones(truth.samples)], axis=1))[0]


def _differences(truth: Truth, motion: object) -> np.ndarray:
    """The same as ``sensitivities`` by central differences of the exact response, the initial state at rest."""
    columns = []
    for name in PARAMETERS:
        step = 1e-5 * SENSOR.parameters[name]
        pair = [
            exact_response(
                model(),
                {**SENSOR.parameters, name: SENSOR.parameters[name] + sign * step},
                motion,
                sampling_rate_hz=truth.rate_hz,
                samples=truth.samples,
            )
            for sign in (1.0, -1.0)
        ]
        columns.append((pair[0] - pair[1]) / (2.0 * step))
    return np.stack(columns, axis=1)
