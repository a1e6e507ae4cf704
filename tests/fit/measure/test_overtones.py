"""Harmonics are the sensor's where the response has them, not where a converter's steps put them in the reference."""

import numpy as np

from vibrident.data.records import Record
from vibrident.fit.measure import measure_tones
from vibrident.fit.measure.overtones import audible, overtones

N, RATE, TONE = 1000, 1e4, 400.0
TURN = 2.0 * np.pi * TONE / RATE * np.arange(N)


def heard(reference, response, predicted, model=np.ones_like):
    record = Record("r", reference, response, RATE, "sine")
    return audible(overtones([record], measure_tones([record], [TONE]), [predicted], model))


def thrice(frequency_hz):
    """The slope of differentiating three times, in time of the tone."""
    return (1j * frequency_hz / TONE) ** 3


def differentiated(values):
    """Thrice, in time of the tone: a velocity pickup above its resonance, by its displacement."""
    lines = np.fft.rfft(values)
    return np.fft.irfft(lines * thrice(np.fft.rfftfreq(N, 1.0 / RATE)), N)


def test_steps_of_a_displacement_are_no_harmonics_of_the_sensor():
    rng, found = np.random.default_rng(2), 0
    for phase in rng.uniform(0.0, 2.0 * np.pi, 20):
        motion = np.cos(TURN + phase)
        reference = np.rint(motion * 64.0) / 64.0
        response = differentiated(motion) + 1e-4 * rng.standard_normal(N)
        found += len(heard(reference, response, differentiated(reference), thrice))
    assert found == 0


def test_steps_of_both_converters_are_no_harmonics_of_the_sensor():
    """In step with the sampling both repeat, and a sensor that answers more at high frequencies makes them larger."""
    rng, found = np.random.default_rng(5), 0

    def rising(frequency_hz):
        return (frequency_hz / TONE) ** 0.7

    for phase in rng.uniform(0.0, 2.0 * np.pi, 40):
        motion = np.cos(TURN + phase)
        reference, response = np.rint(motion * 64.0) / 64.0, np.rint((motion + 0.3) * 64.0) / 64.0
        predicted = np.fft.irfft(np.fft.rfft(reference) * rising(np.fft.rfftfreq(N, 1.0 / RATE)), N)
        found += len(heard(reference, response, predicted, rising))
    assert found == 0


def test_steps_of_the_response_are_no_harmonics_of_the_sensor():
    """Of a tone of 2 to 30 steps the converter makes harmonics of 0.1 step and more; one of a step is the sensor's."""
    rng, found, missed = np.random.default_rng(4), 0, 0
    for steps, phase in rng.uniform((2.0, 0.0), (30.0, 2.0 * np.pi), (40, 2)):
        motion = np.cos(TURN + phase)
        quiet = motion + 1e-4 / steps * rng.standard_normal(N)
        found += len(heard(motion, np.rint(quiet * steps) / steps, motion))
        bent = quiet + 0.04 * np.cos(3.0 * TURN)
        missed += steps > 20.0 and not heard(motion, np.rint(bent * steps) / steps, motion)
    assert found == 0
    assert missed == 0


def test_harmonics_of_the_response_are_found_beside_a_rounded_reference():
    rng = np.random.default_rng(3)
    motion = np.cos(TURN)
    response = motion + 0.01 * np.cos(3.0 * TURN) + 1e-3 * rng.standard_normal(N)
    (one,) = heard(np.rint(motion * 2**12) / 2**12, response, motion)
    assert abs(one.ratio - 0.01) < 1e-3
    assert one.strongest == 3
