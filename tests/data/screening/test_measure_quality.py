"""Screening: what is flagged, and what must not be."""

from dataclasses import replace

import numpy as np
import pytest

from vibrident.base.errors import InputError
from vibrident.data.records import Record
from vibrident.data.screening import screen
from vibrident.data.screening.channel import ChannelSamples
from vibrident.data.screening.clipping import find_clipped
from vibrident.fit.response import measure_tones
from vibrident.fit.response.tone_quality import short_records, silent_channels
from vibrident.physics.simulation import simulate

N = 8000
T = np.arange(N)
ALL = np.ones(N, dtype=bool)


def flagged_share(samples_per_period, level, noise, rng):
    """Share of the truly clipped samples that are marked, and free ones that are, as a share of all."""
    free = np.sin(2 * np.pi * T / samples_per_period * 1.0173 + 0.3) + noise * rng.standard_normal(N)
    over = np.abs(free) > level
    bad = find_clipped(ChannelSamples(np.clip(free, -level, level), ALL))[0]
    return np.mean(bad[over]), np.mean(bad & ~over)


@pytest.mark.parametrize("level", [0.95, 0.9, 0.8, 0.7, 0.6])
@pytest.mark.parametrize("samples_per_period", [50, 200, 1000, 2500])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_an_overdriven_sine_is_marked_wherever_it_is_clipped(samples_per_period, level, noise, rng):
    """Clipped at 60 to 95 % of its amplitude, 50 samples a period and more: every clipped sample, and little else."""
    hit, beside = flagged_share(samples_per_period, level, noise, rng)
    assert hit == 1.0
    assert beside < 9 / samples_per_period + 0.02  # four guards of two samples a period, and the tolerance


@pytest.mark.parametrize(("samples_per_period", "level"), [(200, 0.3), (1000, 0.3), (50, 0.5), (20, 0.5), (12, 0.7)])
def test_a_heavily_overdriven_sine_is_marked(samples_per_period, level, rng):
    assert flagged_share(samples_per_period, level, 1e-3, rng)[0] > 0.99


def test_one_rail_only(rng):
    x = np.minimum(np.sin(2 * np.pi * T / 200.3), 0.8)
    bad = find_clipped(ChannelSamples(x, ALL))[0]
    assert bad[x >= 0.8].all()
    assert not bad[x < 0.5].any()


def test_a_few_samples_thrown_to_a_rail(rng):
    """A signal that jumps to full scale and stays for a while, as the laser of the SM-3 does."""
    x = np.sin(2 * np.pi * T / 400.7) + 0.001 * rng.standard_normal(N)
    for start in (1000, 3100, 5200):
        x[start : start + 40] = 5.0
    bad = find_clipped(ChannelSamples(x, ALL))[0]
    assert bad[x == 5.0].all()
    assert bad.sum() <= 3 * 44


@pytest.mark.parametrize("excitation", ["sine", "multisine", "sweep", "random", "shock", "decay"])
@pytest.mark.parametrize("sensor", ["paper", "piezo", "geophone"])
def test_no_finding_for_simulated_records(sensor, excitation):
    """No excitation of any sensor looks clipped, dead or aliased."""
    calibration = simulate(sensor, excitation, samples=4000, response_noise=0.001, seed=1)
    records, findings = screen(calibration.records)
    assert len(records) == len(calibration.records)
    assert findings == ()
    assert all(r.mask.all() for r in records)


def sine_record(frequency=200.0, samples=4000, rate=10e3, amplitude=1.0, noise=1e-3, seed=0, **more):
    rng = np.random.default_rng(seed)
    t = np.arange(samples) / rate
    channels = amplitude * np.sin(2 * np.pi * frequency * t) + noise * rng.standard_normal((2, samples))
    return Record("record", channels[0], channels[1], rate, "sine", **more)


def test_a_clipped_record_says_what_and_loses_those_samples():
    record = sine_record()
    cut = replace(record, response=np.clip(record.response, -0.8, 0.8))
    (kept,), findings = screen([cut])
    (finding,) = findings  # the reference does not look aliased
    assert finding.code == "clipped"
    assert all(words in finding.message for words in ("record", "response channel", "0.8"))
    lost = np.abs(cut.response) == 0.8
    assert not kept.mask[lost].any()
    assert f"{np.sum(~kept.mask)} of 4000" in finding.message
    assert any("clipped" in step for step in kept.provenance.history)
    (said,) = screen([cut], {"response": "V"})[1]
    assert "clipped at 800 mV and -800 mV;" in said.message


@pytest.mark.parametrize("channel", ["reference", "response"])
def test_a_channel_that_never_changes_is_dead(channel):
    good = sine_record()
    dead = replace(good, name="flat", **{channel: np.full(4000, 277.0)})
    kept, findings = screen([good, dead])
    assert [r.name for r in kept] == ["record"]
    assert [f.code for f in findings] == ["dead_channel"]
    assert "flat" in findings[0].message
    with pytest.raises(InputError, match="No record can be used") as refusal:
        screen([replace(dead, name=f"flat {n}") for n in range(7)])
    names = ", ".join(f"flat {n}" for n in range(5))
    assert refusal.value.found == f"the {channel} channel never changes: {names} and 2 more"


@pytest.mark.parametrize("channel", ["reference", "response"])
def test_a_channel_of_noise_alone_is_silent(channel):
    rng = np.random.default_rng(2)
    records = [replace(sine_record(f, seed=int(f)), **{channel: rng.standard_normal(4000)}) for f in (100.0, 300.0)]
    (finding,) = silent_channels(measure_tones(records, [100.0, 300.0]))
    assert finding.code == "dead_channel"
    assert channel in finding.message
    assert silent_channels(measure_tones([records[0], sine_record(300.0)], [100.0, 300.0])) == []


def test_a_silent_channel_has_few_false_alarms():
    """Five standard deviations: a tone of 10 standard deviations is heard in each of 100 draws."""
    level = 10 * np.sqrt(2 / 1000)
    for seed in range(100):
        record = sine_record(200.0, 1000, amplitude=level, noise=1.0, seed=seed)
        assert silent_channels(measure_tones([record], [200.0])) == []


@pytest.mark.parametrize(("share", "flagged"), [(0.0, False), (0.05, False), (0.2, True), (1.0, True)])
def test_aliasing(share, flagged):
    """Power above 0.45 of the sampling rate: more than 1 % of the reference's is doubted (0.2² = 4 % here)."""
    record = sine_record(200.0)
    high = share * np.sin(2 * np.pi * 4700.0 * record.time_s)
    _, findings = screen([replace(record, reference=record.reference + high)])
    assert [f.code for f in findings] == (["aliasing"] if flagged else [])


def test_short_records():
    """Fewer than two periods of valid samples."""
    records = [sine_record(f, 1000) for f in (15.0, 25.0)]
    assert [f.code for f in short_records(records, np.array([15.0, 25.0]))] == ["short_record"]
    half = records[1].without(np.arange(1000) > 500, "test")
    assert len(short_records([half], np.array([25.0]))) == 1


def test_samples_left_out_by_the_user_are_not_looked_at():
    record = sine_record()
    spoilt = np.array(record.response)
    spoilt[100:200] = 1e6
    masked = replace(record, response=spoilt, valid=~((T[:4000] >= 100) & (T[:4000] < 200)))
    (kept,), findings = screen([masked])
    assert findings == ()
    assert np.sum(~kept.mask) == 100
