"""A bent characteristic is found in any motion, with its size; noise of any kind is not taken for one."""

import functools

import numpy as np
import pytest

from vibrident.fit.measure.nonlinearity import LEANING, SPRING, distortion
from vibrident.physics.models import parse
from vibrident.physics.simulation import simulate

P = {"sensitivity": 0.1, "natural_frequency": 800.0, "damping_ratio": 0.1}
MODEL = parse("accelerometer")
KINDS = {
    "sine": {"frequencies_hz": np.geomspace(30.0, 1500.0, 6)},
    "multisine": {"frequencies_hz": np.geomspace(20.0, 2000.0, 25)},
    "random": {"frequencies_hz": (20.0, 2000.0)},
    "sweep": {"frequencies_hz": (20.0, 2000.0), "repeats": 2},
    "shock": {"repeats": 3},
}
BENDS = {
    "compression": lambda v, size, peak: v * (1.0 - size * (v / peak) ** 2),
    "square": lambda v, size, peak: v + size * v * v / peak,
    "dead band": lambda v, size, peak: np.where(np.abs(v) > size * peak, v - np.sign(v) * size * peak, 0.0),
}


@functools.cache
def clean(kind):
    return simulate(
        ("accelerometer", P), kind, sampling_rate_hz=12800.0, samples=4000, amplitude=10.0, seed=2, **KINDS[kind]
    ).records


def over_gain(frequency_hz):
    return MODEL.frequency_response(P | {"sensitivity": 1.0}, frequency_hz)


def judged(records, measured, predicted):
    """The test for these responses and predictions, the gain fitted."""
    pairs = list(zip(measured, predicted, strict=True))
    gain = sum(float(v @ y) for y, v in pairs) / sum(float(v @ v) for _, v in pairs)
    tones = [r.frequency_hz if r.excitation == "sine" else None for r in records]
    made = [r.with_response(y, "") for r, y in zip(records, measured, strict=True)]
    return distortion(made, [gain * v for v in predicted], tones, over_gain)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("bend", "size"),
    [("compression", 0.002), ("compression", 0.2), ("square", 0.01), ("square", 0.1), ("dead band", 0.001)],
)
def test_a_bend_is_found_and_its_size(kind, bend, size):
    """From 0.1 % of the peak on, in noise of 0.1 %; the size at the peak to a third, compression with its sign.

    To a half in motion that is large for a moment only; at rest nothing tells a dead band.
    """
    if (kind, bend) == ("shock", "dead band"):
        return
    records, rng = clean(kind), np.random.default_rng(3)
    linear = [r.response for r in records]
    peak = max(float(np.max(np.abs(v))) for v in linear)
    made = [BENDS[bend](v, size, peak) + 1e-3 * np.std(v) * rng.standard_normal(v.size) for v in linear]
    found = judged(records, made, linear)
    assert found is not None
    assert (
        found.kind
        in {"compression": ("cube", "spring"), "square": ("square",), "dead band": ("dead band", "cube")}[bend]
    )
    if bend != "dead band" and found.kind != "spring" and size < 0.2:  # to first order
        own = next(v for r, v in zip(records, linear, strict=True) if r.name == found.record)
        power = 2 if bend == "compression" else 1
        there = size * (float(np.max(np.abs(own))) / peak) ** power
        assert abs(found.peak) == pytest.approx(there, rel=0.5 if kind in ("sweep", "shock") else 0.34)
    if found.kind == "cube":
        assert found.peak < 0


def noises(v, reference_noise, rng):
    """Prediction and measured response of a linear sensor in noise of each kind."""
    e, n = rng.standard_normal(v.size), v.size
    s, t = float(np.std(v)), np.arange(v.size) / 12800.0
    pink = np.fft.rfft(e)
    pink[1:] /= np.sqrt(np.arange(1, pink.size) / 50.0)
    step = 2.2 * float(np.max(np.abs(v))) / 2**10
    hum = 0.01 * s * np.sin(2 * np.pi * 50.0 * t + 1.0) + 0.003 * s * np.sin(2 * np.pi * 150.0 * t)
    return {
        "white": (v, v + 0.01 * s * e),
        "strong": (v, v + 0.2 * s * e),
        "of the reference": (v + reference_noise, v),
        "1/f": (v, v + 1e-3 * s * np.fft.irfft(pink, n)),
        "hum": (v, v + 1e-3 * s * e + hum),
        "10 bit": (v, np.round((v + 0.02 * step * e) / step) * step),
        "growing": (v, v + 1e-3 * s * e * np.linspace(0.0, 3.0, n)),
        "gain step": (v, v * np.where(np.arange(n) < n // 2, 1.0, 1.01) + 1e-3 * s * e),
    }


@pytest.mark.parametrize("kind", KINDS)
def test_no_noise_is_a_bend(kind):
    """A linear sensor in every kind of noise, three draws each: nothing."""
    records = clean(kind)
    for seed in range(3):
        rng = np.random.default_rng([seed, 9])
        rows = []
        for record in records:
            line = np.fft.rfftfreq(record.samples, 1.0 / record.sampling_rate_hz)
            own = 0.05 * np.std(record.reference) * np.fft.rfft(rng.standard_normal(record.samples))
            passed = np.fft.irfft(own * MODEL.frequency_response(P, line), record.samples)
            rows.append(noises(record.response, passed, rng))
        fired = {
            name: found
            for name in rows[0]
            if (found := judged(records, [r[name][1] for r in rows], [r[name][0] for r in rows])) is not None
        }
        assert fired == {}, seed


def test_a_bend_of_random_motion_below_a_step_of_the_converter_is_found():
    """Rounding of random motion is noise, in which a bend stands out: 0.1 % at the peak, 12 bit."""
    records = clean("random")
    made = []
    for record in records:
        v = record.response
        largest = float(np.max(np.abs(v)))
        step = 2.2 * largest / 2**12
        made.append(np.round(v * (1.0 - 1e-3 * (v / largest) ** 2) / step) * step)
    found = judged(records, made, [r.response for r in records])
    assert found is not None
    assert found.kind == "cube"
    assert -2e-3 < found.peak < -5e-4


@pytest.mark.parametrize("leaning", [0.0, 3.5e-3])
def test_a_rest_point_beside_the_middle_of_a_bent_spring_is_found(leaning):
    """Its force grows with the square of the motion, and passes the sensor; as a square of the response it hid in noise
    of 1 %. Without it nothing is found.
    """
    records, rng = clean("random"), np.random.default_rng(5)
    predicted = [r.response for r in records]
    through = over_gain(np.maximum(np.fft.rfftfreq(4000, 1.0 / 12800.0), 1.0))
    for _ in range(5):
        made = []
        for record, v in zip(records, predicted, strict=True):
            force = np.fft.irfft(through * np.fft.rfft(v * v / np.max(np.abs(v))), v.size)
            noise = 0.01 * np.std(v) * rng.standard_normal(v.size)
            made.append(record.with_response(v + leaning * force + noise, ""))
        args = (made, predicted, [None] * len(made), over_gain)
        found = distortion(*args, springs=(SPRING, LEANING))
        assert (found is not None and found.kind == LEANING) if leaning else found is None
