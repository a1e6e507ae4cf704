"""A wrong sampling rate is seen in the frequencies of the tones; right ones, and rough ones, are no fault."""

import numpy as np
import pytest

from vibrident.data.records import Record
from vibrident.fit.response.clock import judge_clocks

RATE_HZ = 10_000.0
NOMINAL = (12.5, 31.5, 125.0, 315.0, 1250.0)
EXACT = (12.589254, 31.622777, 125.892541, 316.227766, 1258.92541)


def sines(found_hz, stated_hz, rng, noise=0.01, hum=0.0):
    times = np.arange(5000) / RATE_HZ
    records = []
    for number, (true, stated) in enumerate(zip(found_hz, stated_hz, strict=True)):
        motion = np.sin(2 * np.pi * true * times + rng.uniform(0, 6)) + 3 * times
        motion += noise * rng.standard_normal(times.size) + hum * np.sin(2 * np.pi * 50 * times)
        records.append(Record(f"r{number}", motion, 2 * motion, RATE_HZ, "sine", stated))
    return records


@pytest.mark.parametrize("ratio", [1.024, 0.5, 2.0, 1000.0])
@pytest.mark.parametrize("count", [1, 5])
def test_tones_in_one_wrong_ratio_are_a_wrong_clock(ratio, count):
    found = np.array([160.0, 20.0, 80.0, 40.0, 120.0])[:count] if ratio < 100 else np.linspace(1000, 4000, count)
    if count == 1 and abs(ratio - 1) < 0.05:
        return
    records, findings = judge_clocks(sines(found, found / ratio, np.random.default_rng(1)))
    assert [finding.code for finding in findings] == ["clock_suspect"]
    assert float(findings[0].message.split("lies at ")[1].split()[0]) == pytest.approx(ratio, rel=2e-3)
    assert all(record.frequency_hz is None for record in records)


def test_right_rough_and_nominal_frequencies_are_no_fault():
    """About 1500 clean calibrations in groups: not one finding."""
    rng = np.random.default_rng(2)
    for _ in range(60):
        count = int(rng.integers(1, 6))
        found = np.exp(rng.uniform(np.log(8), np.log(3000), count))
        noise = float(rng.choice([0.0, 0.01, 0.3]))
        for stated in (found, found * rng.uniform(0.97, 1.03, count) if count == 1 else found):
            assert not judge_clocks(sines(found, stated, rng, noise))[1]
        assert not judge_clocks(sines(found, found, rng, noise, hum=5.0))[1]
    assert not judge_clocks(sines(EXACT, NOMINAL, rng))[1]
    assert not judge_clocks(sines(EXACT[::2], NOMINAL[::2], rng))[1]


def test_a_wrong_clock_reaches_the_result_of_an_identification():
    from vibrident.data.records import Calibration
    from vibrident.fit.problem.evidence import Evidence
    from vibrident.physics.models import parse

    found = np.array([160.0, 20.0, 80.0, 40.0, 120.0])
    for stated, codes in ((found / 2, ["clock_suspect"]), (found, [])):
        records = tuple(sines(found, stated, np.random.default_rng(1)))
        evidence = Evidence.gather(Calibration(records=records), parse("accelerometer"))
        assert [finding.code for finding in evidence.findings] == codes
        np.testing.assert_allclose(evidence.tones.frequency_hz, found, rtol=1e-3)
