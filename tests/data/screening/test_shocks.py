"""A shock is motion, however short it is; wild samples beside it are none."""

from dataclasses import replace

import numpy as np
import pytest
from bench.adversary.cases import BY_NAME

from vibrident.data.records import Record
from vibrident.data.screening import screen

RATE_HZ = 15000.0
SAMPLES = 12000


def shock(seed: int) -> tuple[Record, np.random.Generator]:
    """Return a band-limited shock of a geophone against its velocity, of one or two samples at its peak."""
    rng = np.random.default_rng(seed)
    padded = 4 * SAMPLES
    frequency = np.fft.rfftfreq(padded, 1 / RATE_HZ)
    time = np.arange(padded) / RATE_HZ
    peak_s = rng.uniform(1.2, 1.8) * SAMPLES / RATE_HZ
    pulse = np.exp(-0.5 * ((time - peak_s) * RATE_HZ / rng.uniform(0.4, 1.0)) ** 2)
    motion = np.fft.rfft(pulse) * ((frequency > 0.003 * RATE_HZ) & (frequency < 0.35 * RATE_HZ))
    s = 2j * np.pi * frequency
    natural = 2 * np.pi * rng.uniform(0.006, 0.05) * RATE_HZ
    response = motion * s**2 / (s**2 + 2 * rng.uniform(0.05, 0.7) * natural * s + natural**2)
    part = slice(SAMPLES, 2 * SAMPLES)
    reference, answer = (np.fft.irfft(spectrum, padded)[part] for spectrum in (motion, response))
    answer = answer + 10 ** rng.uniform(-4, -2) * answer.std() * rng.standard_normal(SAMPLES)
    return Record(name="shock", reference=reference, response=answer, sampling_rate_hz=RATE_HZ, excitation="shock"), rng


@pytest.mark.parametrize("seed", range(20))
def test_no_sample_of_a_short_shock_is_wild(seed: int) -> None:
    record, _ = shock(seed)
    (screened,), findings = screen([record], {})
    assert findings == ()
    assert screened.mask.all()


@pytest.mark.parametrize(
    ("name", "run"),
    [
        ("clean/in-damped+delay/shock/hum 1 %", 79),
        ("clean/above-sharp/shock/hum 1 %", 80),
        ("clean/below-light/shock/12 bit", 80),
        ("quantities/displacement/accelerometer+delay/shock running", 97),  # the top of a soft pulse
    ],
)
def test_a_shock_that_the_response_hardly_foretells_is_not_wild(name: str, run: int) -> None:
    """Of some twenty samples, in a record that rests before: no prediction is fitted to any motion but the shock."""
    records = BY_NAME[name].trial(run).calibration().records
    screened, findings = screen(records, {})
    assert findings == ()
    assert all(record.mask.all() for record in screened)


@pytest.mark.parametrize("seed", range(20))
def test_bursts_beside_a_shock_are_left_out(seed: int) -> None:
    """3 to 30 wild values in a row, twice to a thousand times the response's deviation, at rest."""
    record, rng = shock(seed)
    spoilt = record.response.copy()
    peak = int(np.argmax(np.abs(record.reference)))
    begins = [peak // 3, peak + (SAMPLES - peak) // 3]
    for begin in begins:
        length = int(rng.integers(3, 31))
        size = spoilt.std() * 10 ** rng.uniform(0.3, 3)
        spoilt[begin : begin + length] = rng.uniform(-size, size, length)
    wild = np.abs(spoilt - record.response) > 0.5 * record.response.std()
    (screened,), findings = screen([replace(record, response=spoilt)], {})
    assert not screened.mask[wild].any()
    assert np.sum(~screened.mask) < 120
    assert {finding.code for finding in findings} == {"dead_channel"}


@pytest.mark.parametrize("seed", range(10))
def test_an_edge_of_a_stepped_drive_is_no_wild_sample(seed: int) -> None:
    """An edge is odd in both channels at once, whatever its size."""
    from scipy.signal import lfilter

    rng = np.random.default_rng(seed)
    drive = np.repeat(rng.standard_normal(270), 53)
    damping = 0.86
    poles = np.exp(2 * np.pi * rng.uniform(0.2, 0.25) * (-damping + np.array([1j, -1j]) * np.sqrt(1 - damping**2)))
    denominator = np.poly(poles).real
    answer = lfilter(np.array([0.0, 0.55, 0.45]) * denominator.sum(), denominator, drive)
    answer = answer + 1e-3 * answer.std() * rng.standard_normal(answer.size)
    record = Record(name="stairs", reference=drive, response=answer, sampling_rate_hz=RATE_HZ, excitation="random")
    (screened,), findings = screen([record], {})
    assert findings == ()
    assert screened.mask.all()
