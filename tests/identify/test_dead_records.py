"""A record whose channels have nothing in common is left out; one that only seems so is kept."""

from dataclasses import replace

import numpy as np

from vibrident import identify, simulate
from vibrident.measure import measure_bands
from vibrident.measure.bands import uncorrelated_records
from vibrident.records import Calibration

#: A resonance rings for some 1600 samples after the motion that it answers.
SHARP = {"sensitivity": 0.01, "natural_frequency": 2000.0, "damping_ratio": 0.0005}
PIECES, SAMPLES = 8, 400


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
    seeming = 0
    for seed in (1, 2):
        rng = np.random.default_rng(seed)
        records = pieces_of_one_record(seed)
        size = float(np.mean([np.std(r.response) for r in records]))
        records = [r.with_response(r.response + size * rng.standard_normal(SAMPLES), "") for r in records]
        seeming += len(uncorrelated_records(measure_bands(records)))
        result = identify(Calibration(records=tuple(records), model="accelerometer"))
        assert "dead_channel" not in {w.code for w in result.warnings}
    assert seeming  # the coherence alone would have left some out


def test_a_dead_record_is_named_though_it_would_outweigh_all_others():
    """Its noise is a thousandth of the others' responses: a fit of all draws the sensitivity to zero."""
    rng = np.random.default_rng(1)
    for dead in (0, 5):
        records = pieces_of_one_record(dead)
        size = 1e-3 * float(np.std(records[dead].response))
        records[dead] = records[dead].with_response(size * rng.standard_normal(SAMPLES), "")
        result = identify(Calibration(records=tuple(records), model="accelerometer"))
        said = [w.message for w in result.warnings if w.code == "dead_channel"]
        assert len(said) == 1
        assert f"piece-{dead}" in said[0]
        off = result.parameters["sensitivity"]
        assert abs(off.value - SHARP["sensitivity"]) < 4.0 * off.standard_uncertainty
