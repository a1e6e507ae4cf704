"""Simulated calibrations: excitations in continuous time, exact and Runge–Kutta truth, noise, records.

    calibration = simulate("paper", "sine", excitation_snr_db=20.0, response_noise=0.01, seed=1)

The truth is computed from the continuous acceleration, not from its samples, so that it can judge every discretisation.
"""

from vibrident.simulation.calibration import simulate, with_noise
from vibrident.simulation.excitation import (
    BandLimitedRandom,
    Decay,
    HalfSineShock,
    Multisine,
    Sine,
    Sweep,
    random_phases,
)
from vibrident.simulation.motion import Motion, Superposition
from vibrident.simulation.noise import ChannelNoise, excitation_noise
from vibrident.simulation.rk4 import rk4_response
from vibrident.simulation.scheme import nominal_frequency_name, one_third_octave
from vibrident.simulation.sensors import SENSORS, Sensor, sensor_named
from vibrident.simulation.truth import exact_reference, exact_response

__all__ = [
    "SENSORS",
    "BandLimitedRandom",
    "ChannelNoise",
    "Decay",
    "HalfSineShock",
    "Motion",
    "Multisine",
    "Sensor",
    "Sine",
    "Superposition",
    "Sweep",
    "exact_reference",
    "exact_response",
    "excitation_noise",
    "nominal_frequency_name",
    "one_third_octave",
    "random_phases",
    "rk4_response",
    "sensor_named",
    "simulate",
    "with_noise",
]
