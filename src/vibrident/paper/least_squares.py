"""Least squares that the paper compares with: constants from sensitivities at frequencies.

    1/H = (ωn² − ω² + 2 j δ ωn ω)/K        three constants, linear: 1/S0, 2 δ/(S0 ωn), 1/(S0 ωn²)

``from_sine_fits`` takes H from a sine fit of each channel, each point of 1/H with equal weight. The
paper does not state how its H were read. ``from_extremes`` reads them in the simplest way: largest
response over largest excitation, with noise, without phase:

    1/|H|² = (1 + (4 δ² − 2) (ω/ωn)² + (ω/ωn)⁴)/S0²,

linear in 1/S0², (4 δ² − 2)/(S0 ωn)² and 1/(S0² ωn⁴).
"""

from __future__ import annotations

import numpy as np

from vibrident.base.errors import NotConverged
from vibrident.data.records import Calibration, FloatArray
from vibrident.fit.response import find_tones


def from_sine_fits(calibration: Calibration) -> dict[str, float]:
    """Fit 1/H by unweighted linear least squares.

    The records are sines with acceleration (or drive) as reference.

    Raises:
        NotConverged: the constants are not those of a stable oscillator.
    """
    tones = find_tones(calibration.records)
    inverse = tones.reference / tones.response
    omega = 2.0 * np.pi * tones.frequency_hz
    unit = float(np.exp(np.mean(np.log(omega))))
    rate = omega / unit
    real = np.stack([np.ones_like(rate), np.zeros_like(rate), -(rate**2)], axis=1)
    imaginary = np.stack([np.zeros_like(rate), rate, np.zeros_like(rate)], axis=1)
    matrix = np.concatenate([real, imaginary])
    right_side = np.concatenate([inverse.real, inverse.imag])
    static, viscous, inertial = np.linalg.lstsq(matrix, right_side, rcond=None)[0]
    if not (static / inertial > 0.0 and viscous / static > 0.0):
        raise NotConverged(
            "Plain least squares on 1/H gives no stable oscillator: "
            "the points of small sensitivity dominate and are too noisy "
            "or not those of a second-order sensor."
        )
    natural = np.sqrt(static / inertial)
    return _named(1.0 / static, natural * unit, 0.5 * viscous / static * natural)


def from_extremes(calibration: Calibration) -> dict[str, float]:
    """Fit 1/|H|² from the largest excursions of both channels, after the start transient."""
    frequency = np.array([record.frequency_hz for record in calibration.records], dtype=float)
    ratio = np.array(
        [_amplitude(r.response) / _amplitude(np.asarray(r.reference)) for r in calibration.records]
    )
    omega = 2.0 * np.pi * frequency
    unit = float(np.exp(np.mean(np.log(omega))))
    square = (omega / unit) ** 2
    matrix = np.stack([np.ones_like(square), square, square**2], axis=1)
    # Divided by 1/H²: relative deviations; otherwise the points far above the resonance would
    # dominate.
    scale = ratio**2
    static, slope, quartic = np.linalg.lstsq(
        matrix * scale[:, None], np.ones_like(square), rcond=None
    )[0]
    natural_square = np.sqrt(static / quartic)
    damping = 0.25 * (slope / static * natural_square + 2.0)
    return _named(static**-0.5, np.sqrt(natural_square) * unit, np.sqrt(max(damping, 0.0)))


def _amplitude(signal: FloatArray) -> float:
    """Return half the range of a signal after its first quarter."""
    steady = signal[signal.size // 4 :]
    return 0.5 * float(np.ptp(steady))


def _named(
    sensitivity: float, natural_angular_frequency: float, damping_ratio: float
) -> dict[str, float]:
    return {
        "sensitivity": float(sensitivity),
        "natural_frequency": float(natural_angular_frequency / (2.0 * np.pi)),
        "damping_ratio": float(damping_ratio),
    }
