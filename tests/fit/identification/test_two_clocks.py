"""A response that was read by another clock than the reference is brought to the clock of the reference."""

import numpy as np
import pytest
from bench.adversary.cases import BY_NAME
from bench.unsuited import UNSUITED

import vibrident
from vibrident.data.records import Calibration, Record
from vibrident.fit.response.clock_ratio import MAX_OFFSET, at_reference_clock, clock_offset, nearby_offset
from vibrident.fit.response.clock_search import ClockSearch

RATE_HZ, SAMPLES, FINER, BEFORE_S = 8000.0, 16000, 4, 0.05
TRUE = {"sensitivity": 1.0, "natural_frequency": 900.0, "damping_ratio": 0.05}
TONES_HZ = (50, 200, 600, 900, 1200, 1600)


def transfer(hz, damping=0.05):
    s, omega = 2j * np.pi * hz, 2 * np.pi * TRUE["natural_frequency"]
    return omega**2 / (s * s + 2 * damping * omega * s + omega**2)


def motion_of(kind, time, rng):
    """Motion below 1500 Hz at a finer rate."""
    if kind == "sweep":
        return np.sin(2 * np.pi * (20 * time + 690 / time[-1] * time**2))
    if kind == "multisine":
        return sum(np.cos(2 * np.pi * 50 * k * time + rng.uniform(0, 6)) for k in range(10, 28))
    if kind == "shock":
        near = [np.clip((time - at) / 4e-3, -0.5, 0.5) for at in np.arange(0.2, time[-1], 0.4)]
        return sum(np.cos(np.pi * each) ** 2 for each in near)
    bins = np.fft.rfft(rng.standard_normal(time.size))
    hz = np.fft.rfftfreq(time.size, time[1])
    return np.fft.irfft(np.where((hz > 20) & (hz < 1500), bins, 0), time.size)


def channels(kind, offset, seed, noise=1e-3, samples=SAMPLES):
    """Reference at k/fs, response at (1 + ε) k/fs, interpolated from a finer rate."""
    from scipy.interpolate import CubicSpline

    rng = np.random.default_rng(seed)
    time = np.arange(FINER * (samples + 2000)) / RATE_HZ / FINER
    bins = np.fft.rfft(motion_of(kind, time, rng))
    answer = bins * transfer(np.fft.rfftfreq(time.size, time[1]))
    moved, answered = (np.fft.irfft(each, time.size) for each in (bins, answer))
    at = np.arange(samples) / RATE_HZ
    reference = CubicSpline(time, moved)(BEFORE_S + at)
    response = CubicSpline(time, answered)(BEFORE_S + at * (1 + offset))
    size, (first, second) = reference.std(), rng.standard_normal((2, samples))
    return reference / size + noise * first, response / size + noise * second


def given(kind, offset, seed):
    pair = channels(kind, offset, seed)
    return Calibration.from_arrays(*pair, RATE_HZ, quantity="acceleration", excitation=kind)


def sines(offset, seed=5, seconds=1.0):
    rng, time, records = np.random.default_rng(seed), np.arange(8000 * seconds) / RATE_HZ, []
    for number, hz in enumerate(TONES_HZ):
        turn = 2j * np.pi * hz * time
        reference = 10 * np.cos(turn.imag) + 1e-3 * rng.normal(size=time.size)
        response = np.real(10 * transfer(hz) * np.exp(turn * (1 + offset)))
        response = response + 1e-3 * rng.normal(size=time.size)
        records.append(Record(f"tone {number}", reference, response, RATE_HZ, "sine"))
    return Calibration(records=tuple(records), quantity="acceleration")


def z_of(result):
    stated = [(result.parameters[name], value) for name, value in TRUE.items()]
    return [(p.value - value) / p.standard_uncertainty for p, value in stated]


@pytest.mark.parametrize("offset", [2e-6, -2e-5, 3e-4, -1e-2])
@pytest.mark.parametrize("kind", ["random", "sweep", "multisine", "shock"])
@pytest.mark.quick("random--2e-05", "shock-0.0003", "shock-2e-06")
def test_two_clocks_are_named_and_corrected(kind, offset):
    result = vibrident.identify(given(kind, offset, 7), model="accelerometer+delay")
    assert result.warning_codes == ("clock_suspect",)
    assert result.fit.adequate
    assert np.max(np.abs(z_of(result))) < 4.0
    (row,) = [row for row in result.settings["uncertainty_budget"] if row["kind"] == "clocks"]
    assert abs(result.settings["clock_offset"] - offset) < 4 * row["standard_uncertainty"]


@pytest.mark.parametrize("offset", [2e-5, 2e-2])
@pytest.mark.quick("2e-05")
def test_sines_of_two_clocks(offset):
    result = vibrident.identify(sines(offset), model="accelerometer")
    assert result.warning_codes == ("clock_suspect",)
    assert np.max(np.abs(z_of(result))) < 4.0


@pytest.mark.parametrize("offset", [-7e-5, 1e-4, 3e-4])
@pytest.mark.quick("0.0003")
def test_two_clocks_without_a_delay_in_the_model(offset):
    """Most of the misfit is the mean delay, which is coherent with the motion: no clock was sought."""
    records = tuple(Record(f"r{k}", *channels("random", offset, k), RATE_HZ, "random") for k in range(2))
    result = vibrident.identify(Calibration(records=records, quantity="acceleration"), "accelerometer")
    assert result.warning_codes == ("clock_suspect",)
    assert np.max(np.abs(z_of(result))) < 4.0


@pytest.mark.parametrize("offset", [0.0, -3e-3, 1e-2])
def test_ringing_does_not_hide_the_ratio_of_the_clocks(offset, rng):
    """The search leaves the noise at the true ε though the sensor rings for as long as the record lasts."""
    damping, samples, at = 1e-3, 4000, np.arange(4000) / RATE_HZ
    hz = np.arange(20.0, 1500.0, 0.5)
    lines = rng.standard_normal(hz.size) + 1j * rng.standard_normal(hz.size)
    reference, response = np.empty((2, samples))
    for channel, bins, time in (
        (reference, lines, at),
        (response, lines * transfer(hz, damping), at * (1 + offset)),
    ):
        for block in range(0, samples, 500):
            turns = np.exp(2j * np.pi * np.multiply.outer(time[block : block + 500], hz))
            channel[block : block + 500] = (turns @ bins).real
    pair = Calibration.from_arrays(reference, response, RATE_HZ, excitation="random")
    search = ClockSearch.from_records(pair.records, 2, 2, delayed=False)
    assert search.unexplained(offset, samples) < 1e-4
    assert nearby_offset(pair.records, 2, 2, delayed=False) == pytest.approx(offset, abs=1e-5)


@pytest.mark.parametrize("offset", [1e-3, -5e-3])
def test_the_ratio_is_found_where_a_displacement_is_small(offset, rng):
    """Bins of motion were those of a loud reference: up to 500 Hz of a displacement, below the resonance at 900."""
    samples, at = 24000, np.arange(24000) / RATE_HZ
    hz = rng.uniform(40.0, 1500.0, 400)
    lines = rng.standard_normal(hz.size) + 1j * rng.standard_normal(hz.size)
    channels = []
    for bins, time in ((-lines / hz**2, at), (lines * transfer(hz), at * (1 + offset))):
        blocks = [np.exp(2j * np.pi * np.multiply.outer(block, hz)) @ bins for block in np.split(time, 24)]
        channel = np.concatenate(blocks).real
        channels.append(channel + 1e-4 * np.std(channel) * rng.standard_normal(samples))
    pair = Calibration.from_arrays(*channels, RATE_HZ, quantity="displacement", excitation="random")
    assert clock_offset(pair.records) == pytest.approx(offset, abs=3e-5)


@pytest.mark.draws(1, 15)
@pytest.mark.parametrize("kind", ["random", "sweep", "multisine", "shock"])
def test_one_clock_is_not_taken_for_two(kind, draws):
    for seed in range(draws):
        result = vibrident.identify(given(kind, 0.0, seed), model="accelerometer+delay")
        assert "clock_suspect" not in result.warning_codes


def test_a_sensor_that_changes_is_not_taken_for_two_clocks():
    reference, response = channels("random", 0.0, 3)
    growing = response * np.linspace(1.0, 1.04, response.size)
    pair = Calibration.from_arrays(reference, growing, RATE_HZ, quantity="acceleration", excitation="random")
    codes = vibrident.identify(pair, model="accelerometer").warning_codes
    assert "regimes" in codes
    assert "clock_suspect" not in codes


def test_several_records_share_one_ratio():
    records = tuple(
        Record(f"record {seed}", *channels("random", 1e-3, seed, samples=6000), RATE_HZ, "random") for seed in range(3)
    )
    assert clock_offset(records) == pytest.approx(1e-3, abs=1e-6)
    result = vibrident.identify(Calibration(records=records, quantity="acceleration"), "accelerometer")
    assert result.warning_codes == ("clock_suspect",)
    assert np.max(np.abs(z_of(result))) < 4.0


def test_bringing_to_one_clock_is_exact_in_the_band():
    """A tone below 0.4 of the rate keeps amplitude and phase to 1e-6."""
    time = np.arange(4000) / RATE_HZ
    for hz in (100.0, 1500.0, 3200.0):
        late = np.sin(2 * np.pi * hz * time * 1.003)
        record = Record("tone", np.sin(2 * np.pi * hz * time), late, RATE_HZ, "random")
        moved = at_reference_clock(record, 3e-3)
        np.testing.assert_allclose(moved.response, moved.reference, atol=3e-6)


def test_a_response_of_which_nothing_is_left_at_another_clock_keeps_its_own() -> None:
    """Samples are missing all over it, so that none can be interpolated."""
    samples = np.arange(1000)
    wave = np.sin(0.1 * samples)
    record = Record("r", wave, wave, 1e3, "sine", valid=samples % 20 > 0)
    assert at_reference_clock(record, 1e-4) is record


def test_few_periods_are_not_read_at_impossible_clocks():
    """Of a record without its shock little is left but slow motion: the search stays within what clocks do."""
    rng = np.random.default_rng(0)
    time = np.arange(4000) / RATE_HZ
    reference = np.cos(2 * np.pi * 1.3 * time) + 1e-4 * rng.standard_normal(time.size)
    response = 1e-3 * np.cos(2 * np.pi * 1.3 * time) + rng.standard_normal(time.size)
    pair = Calibration.from_arrays(reference, response, RATE_HZ, quantity="displacement")
    assert abs(nearby_offset(pair.records, 2, 0, delayed=False)) <= 2 * MAX_OFFSET


@pytest.mark.parametrize("samples", [8, 9, 10, 12, 19, 40])
@pytest.mark.parametrize("still", [False, True])
def test_short_and_still_records_have_one_clock(samples, still, rng):
    """A single step after the first samples has no bin that moves in them."""
    reference = np.zeros(samples) if still else rng.standard_normal(samples)
    records = (Record("r", reference, rng.standard_normal(samples), RATE_HZ, "random"),)
    assert abs(clock_offset(records)) <= MAX_OFFSET
    assert abs(nearby_offset(records, 2, 2, delayed=True)) <= MAX_OFFSET


def test_a_missing_delay_is_not_two_clocks():
    """At a wrong ratio motion became incoherent, and the misfit passed for noise."""
    pair = UNSUITED["missing delay"](np.random.default_rng(1))
    result = vibrident.identify(pair, model="accelerometer")
    assert not result.fit.adequate
    assert "clock_suspect" not in result.warning_codes


@pytest.mark.slow
def test_a_start_that_went_astray_is_not_two_clocks():
    """The fit at another ratio began anew and was right; the ratio was stated with seven standard uncertainties."""
    trial = BY_NAME["quantities/acceleration/accelerometer+mode2=0.1/shock running"].trial(135)
    result = vibrident.identify(trial.calibration(), model=trial.model)
    assert result.fit.adequate
    assert result.warning_codes == ()
