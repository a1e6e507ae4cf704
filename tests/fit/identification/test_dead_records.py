"""A record whose channels have nothing in common is left out; one that only seems so is kept."""

from dataclasses import replace

import numpy as np
import pytest

from vibrident import identify, simulate
from vibrident.data.records import Calibration, Record
from vibrident.fit.response import find_tones
from vibrident.fit.response.tone_quality import silent_records

#: A resonance rings for some 1600 samples after the motion that it answers.
SHARP = {"sensitivity": 0.01, "natural_frequency": 2000.0, "damping_ratio": 0.0005}
PIECES, SAMPLES = 8, 400
LIGHT = {"sensitivity": 0.01, "natural_frequency": 500.0, "damping_ratio": 0.1}
SINES = {"samples": 1000, "sampling_rate_hz": 10e3, "seed": 3}


def sines(noise: float) -> tuple[Record, ...]:
    """Eight sines from below resonance to far above; noise over the response at 100 Hz."""
    made = simulate(("accelerometer", LIGHT), "sine", frequencies_hz=np.geomspace(60.0, 4000.0, 8), **SINES).records
    size, rng = noise * float(np.std(made[0].response)), np.random.default_rng(5)
    return tuple(r.with_response(r.response + size * rng.standard_normal(r.samples), "") for r in made)


def pieces_of_one_record(seed: int) -> list:
    whole = simulate(
        ("accelerometer", SHARP),
        "random",
        samples=PIECES * SAMPLES,
        sampling_rate_hz=10e3,
        seed=seed,
        response_noise=0.01,
    ).records[0]
    parts = [slice(i * SAMPLES, (i + 1) * SAMPLES) for i in range(PIECES)]
    return [
        replace(whole, name=f"piece-{i}", reference=whole.reference[part], response=whole.response[part], valid=None)
        for i, part in enumerate(parts)
    ]


def test_what_rings_from_before_the_record_is_no_dead_channel():
    """Though noise as large as the response hides the answer to the motion of some records."""
    rng = np.random.default_rng(1)
    records = pieces_of_one_record(1)
    size = float(np.mean([np.std(r.response) for r in records]))
    records = [r.with_response(r.response + size * rng.standard_normal(SAMPLES), "") for r in records]
    result = identify(Calibration(records=tuple(records), model="accelerometer"))
    assert "dead_channel" not in result.warning_codes


@pytest.mark.parametrize("seed", range(5, 10))
@pytest.mark.quick("5", "9")
def test_a_dead_record_is_named_though_it_would_outweigh_all_others(seed):
    """Its noise is a thousandth of the others' responses. A fit of all draws the sensitivity to zero, or the resonance
    to where a ringing, which no motion tells, hides what the record lacks."""
    records = pieces_of_one_record(seed)
    size = 1e-3 * float(np.std(records[5].response))
    records[5] = records[5].with_response(size * np.random.default_rng(1).standard_normal(SAMPLES), "")
    result = identify(Calibration(records=tuple(records), model="accelerometer"))
    (said,) = [w.message for w in result.warnings if w.code == "dead_channel"]
    assert "piece-5" in said
    off = result.parameters["sensitivity"]
    assert abs(off.value - SHARP["sensitivity"]) < 4.0 * off.standard_uncertainty


@pytest.mark.parametrize("level", [1e-6, 0.1])
def test_a_dead_record_among_sines_is_left_out(level):
    """An unconnected channel shows no tone; fitted along, its little noise would outweigh all other records."""
    rng = np.random.default_rng(4)
    records = list(sines(1e-3))
    size = level * float(np.std(records[2].response))
    records[2] = records[2].with_response(size * rng.standard_normal(1000), "")
    result = identify(Calibration(records=tuple(records), model="accelerometer"))
    (said,) = [w.message for w in result.warnings if w.code == "dead_channel"]
    assert records[2].name in said
    assert result.fit.adequate
    for name, truth in LIGHT.items():
        found = result.parameters[name]
        assert abs(found.value - truth) < 4.0 * found.standard_uncertainty


def test_a_tone_below_its_noise_is_no_dead_channel():
    """Far above resonance the response is small: half of its tones are lost in noise, and the model explains all."""
    records = sines(1.0)
    assert silent_records(find_tones(records))
    result = identify(Calibration(records=tuple(records), model="accelerometer"))
    assert "dead_channel" not in result.warning_codes
