"""Simulation of calibrations: excitations in continuous time, exact truth, noise, records.

    calibration = simulate("paper", "sine", excitation_snr_db=20.0, response_noise=0.01, seed=1)

The truth is computed from the continuous acceleration, not from its samples, so that it can judge
every discretisation.
"""

from vibrident.physics.simulation.calibration import simulate, with_noise
from vibrident.physics.simulation.excitation import (
    BandLimitedRandom,
    Decay,
    HalfSineShock,
    Multisine,
    Sine,
    Sweep,
    random_phases,
)
from vibrident.physics.simulation.motion import Motion, Superposition
from vibrident.physics.simulation.noise import ChannelNoise, excitation_noise
from vibrident.physics.simulation.rk4 import rk4_response
from vibrident.physics.simulation.scheme import nominal_frequency_name, one_third_octave
from vibrident.physics.simulation.sensors import SENSORS, Sensor, sensor_named
from vibrident.physics.simulation.truth import exact_reference, exact_response

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
