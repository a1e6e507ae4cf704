"""The kind of a motion is seen in the reference, at any rate and scale; a sine that is none is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import vibrident
from vibrident.fit.response.motion import kind_of_motion, stray_motion
from vibrident.physics.simulation import SENSORS, HalfSineShock, simulate, with_noise

NATURAL_HZ = {"paper": 651.0, "piezo": 30e3, "seismometer": 1.0}
KINDS = ("sine", "multisine", "sweep", "random", "shock")


def moved(kind, sensor="paper", samples=8000, periods=40.0, seed=1, tones=12):
    """Records of a motion, with 2 % of noise in both channels."""
    natural = NATURAL_HZ[sensor]
    shape = {"sampling_rate_hz": periods * natural, "samples": samples, "seed": seed}
    hz = {"sine": [0.2, 1.1], "multisine": np.geomspace(0.05, 3.0, tones), "sweep": [0.05, 3.0], "random": [0.05, 3.0]}
    if kind == "shock":
        made = simulate(sensor, [HalfSineShock(1.0, 0.5 / natural, 0.1 * samples / (periods * natural))], **shape)
    else:
        more = {"excitation_snr_db": 20.0} if kind == "sine" else {}
        made = simulate(sensor, kind, frequencies_hz=(natural * np.array(hz[kind])).tolist(), **shape, **more)
    return with_noise(made, reference_noise=0.02, response_noise=0.02, seed=seed)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("sensor", "samples", "periods"), [("paper", 8000, 10.0), ("seismometer", 8000, 40.0), ("piezo", 60_000, 100.0)]
)
def test_the_kind_is_seen_whatever_rate_scale_and_offset(kind, sensor, samples, periods):
    for record in moved(kind, sensor, samples, periods).records:
        motion = np.asarray(record.reference)
        assert kind_of_motion(motion) == kind
        assert kind_of_motion(-1e9 * motion + 3e8 * np.std(motion)) == kind


def test_nothing_to_see_is_a_sine():
    assert kind_of_motion(np.zeros(1000)) == "sine"
    assert kind_of_motion(np.full(50, np.nan)) == "sine"
    assert kind_of_motion(np.arange(5.0)) == "sine"


@pytest.mark.parametrize("kind", ["multisine", "sweep", "random", "shock"])
def test_other_motion_said_to_be_a_sine_is_refused_with_what_it_looks_like(kind):
    made = moved(kind, tones=48)
    wrong = replace(made, records=tuple(replace(r, excitation="sine", frequency_hz=None) for r in made.records))
    with pytest.raises(vibrident.InputError, match=f'excitation = "{kind}"') as refused:
        vibrident.identify(wrong)
    assert refused.value.where == made.records[0].name


@pytest.mark.parametrize("snr_db", [-5.0, 0.0, 20.0])
@pytest.mark.parametrize("kind", ["felt", "reference", "response"])
def test_a_noisy_sine_is_a_sine(kind, snr_db):
    """A tone weaker than the noise of its channels, or than what else the sensor feels, is one still."""
    part = 10.0 ** (-snr_db / 20.0)
    felt = {"excitation_snr_db": snr_db} if kind == "felt" else {}
    noise = {} if kind == "felt" else {f"{kind}_noise": part}
    made = simulate("paper", frequencies_hz=[130.0, 700.0], sampling_rate_hz=26e3, samples=4000, seed=2, **felt)
    result = vibrident.identify(with_noise(made, seed=3, **noise), "accelerometer")
    found = result.parameters["natural_frequency"]
    assert abs(found.value - SENSORS["paper"].parameters["natural_frequency"]) < 5.0 * found.standard_uncertainty + 1e-6


def test_distortion_and_drift_are_no_other_motion():
    made = simulate("paper", frequencies_hz=[200.0, 400.0], sampling_rate_hz=26e3, samples=4000, seed=2)
    time = made.records[0].time_s
    for record in made.records:
        frequency = float(record.frequency_hz)
        motion = np.asarray(record.reference)
        distorted = sum(np.sin(2.0 * np.pi * order * frequency * time) for order in (2, 3, 5)) * np.ptp(motion)
        drifting = np.ptp(motion) * 3.0 * (time / time[-1]) ** 2
        for more in (distorted, drifting):
            other = replace(record, reference=motion + more, response=record.response + 0.1 * more)
            assert stray_motion(other, frequency) < 0.1
