"""What a channel could not follow, and what a recorder lost: found in any motion, and not in clean data."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from bench.adversary.cases import BY_NAME
from tests.support.real_data import calibration_beside_data

from vibrident import identify
from vibrident.base.errors import InputError
from vibrident.data.io import read
from vibrident.data.records import Calibration, FloatArray, Record
from vibrident.data.screening import gaps, screen
from vibrident.data.screening.channel import ChannelSamples
from vibrident.data.screening.clipping import find_clipped
from vibrident.data.screening.gaps import find_lost_samples
from vibrident.data.screening.held import is_stairs
from vibrident.data.screening.prediction import ORDER
from vibrident.data.screening.wild import GUARD_SAMPLES, MAX_RUN_SAMPLES, PredictedChannel, find_breaks
from vibrident.physics.simulation import SENSORS, simulate

N = 4000
T = np.arange(N)
ALL = np.ones(N, dtype=bool)


def band_limited(rng: np.random.Generator, low: float = 0.005, high: float = 0.2) -> FloatArray:
    frequency = np.fft.rfftfreq(N)
    lines = rng.normal(size=(2, frequency.size)) * ((frequency > low) & (frequency < high))
    values = np.fft.irfft(lines[0] + 1j * lines[1], N)
    return values / np.std(values)


def multisine(rng: np.random.Generator) -> FloatArray:
    return sum(np.cos(0.01 * (k + 3) * T + rng.uniform(0.0, 6.3)) for k in range(20)) / np.sqrt(10.0)


def swept(rng: np.random.Generator) -> FloatArray:
    return np.sin(0.01 * T + 0.4 * T**2 / N / 2.0 + rng.uniform(0.0, 6.3))


def sine(rng: np.random.Generator) -> FloatArray:
    return np.sin(rng.uniform(0.02, 2.5) * T + rng.uniform(0.0, 6.3))


def slow_or_quick(rng: np.random.Generator, orders: tuple[int, ...] = (1,)) -> FloatArray:
    """A sine of 1e-4 to 0.45 of the sampling rate, or with harmonics."""
    angle = 2.0 * np.pi * 10.0 ** rng.uniform(-4.0, np.log10(0.45))
    return sum(np.sin(order * angle * T + rng.uniform(0.0, 6.3)) / order**2 for order in orders)


def in_step(rng: np.random.Generator) -> FloatArray:
    """A sine of 3 to 12 samples a period that begins in the record, and settles."""
    wave = np.sin(2.0 * np.pi * (T + rng.uniform(0.0, 1.0)) / rng.integers(3, 13))
    return wave * (1.0 - np.exp(-np.clip(T - rng.uniform(0.0, 1000.0), 0.0, None) / rng.uniform(3.0, 100.0)))


def swept_from_a_quarter_of_the_rate(rng: np.random.Generator) -> FloatArray:
    return np.sin(0.5 * np.pi * T - 0.5 * rng.uniform(0.2, 1.4) * T**2 / N)


def of_few_digits(rng: np.random.Generator) -> FloatArray:
    """As a text file holds a slow sine with noise."""
    values = rng.uniform(1.2, 9.0) * slow_or_quick(rng) + 10.0 ** rng.uniform(-6.0, -3.0) * rng.standard_normal(N)
    digits = rng.integers(3, 6)
    return np.array([float(f"{value:.{digits}e}") for value in values])


def shock(rng: np.random.Generator) -> FloatArray:
    u = (T - rng.uniform(500.0, 2000.0)) / rng.uniform(40.0, 150.0)
    return np.exp(-(u**2)) - 0.2 * np.exp(-(((u - 4.0) / 3.0) ** 2))


MOTIONS: dict[str, Callable[[np.random.Generator], FloatArray]] = {
    "random": band_limited,
    "multisine": multisine,
    "sweep": swept,
    "sine": sine,
    "shock": shock,
}


def converted(values: FloatArray, rng: np.random.Generator) -> FloatArray:
    """With noise from 1e-6 to 3 %, or none, through a converter of 8 bits to none; a part of its range is used."""
    values = values + rng.choice([0.0, 10.0 ** rng.uniform(-6.0, -1.5)]) * rng.standard_normal(N)
    step = 2.0 ** -rng.integers(4, 24) * np.max(np.abs(values))
    return values if rng.random() < 0.3 else np.rint(values / step) * step


FREE = {
    **MOTIONS,
    "slow or quick sine": slow_or_quick,
    "harmonics": lambda rng: slow_or_quick(rng, (1, 2, 3)),
    "noise": lambda rng: rng.standard_normal(N),
    "in step": in_step,
    "swept from a quarter of the rate": swept_from_a_quarter_of_the_rate,
}


@pytest.mark.parametrize("motion", FREE)
@pytest.mark.draws(20, 300)
def test_free_signals_are_left_alone(motion: str, draws: int, rng: np.random.Generator) -> None:
    """Offset or not, in coarse and fine steps: at most one finding in all 2400."""
    found = 0
    for _ in range(draws):
        values = converted(FREE[motion](rng) + rng.choice([0.0, 3.0]), rng)
        found += (
            bool(find_clipped(ChannelSamples(values, ALL))[0].any())
            + bool(find_lost_samples(ChannelSamples(values, ALL)).any())
            + bool(PredictedChannel.from_samples(ChannelSamples(values, ALL)).wild.any())
        )
    assert found <= (1 if motion == "sine" else 0)


def in_single_precision(rng: np.random.Generator) -> FloatArray:
    """A slow sine with noise through a converter of 8 to 20 bits, kept in single precision, then scaled."""
    values = slow_or_quick(rng) + 10.0 ** rng.uniform(-6.0, -3.0) * rng.standard_normal(N)
    step = rng.uniform(2.0, 4.0) * 2.0 ** -rng.integers(8, 21)
    return rng.uniform(0.1, 10.0) * (np.rint(values / step) * step).astype(np.float32).astype(float)


@pytest.mark.draws(40, 300)
def test_single_precision_does_not_hide_a_converters_steps(draws: int, rng: np.random.Generator) -> None:
    """Two equal samples at the top are then no rail."""
    for _ in range(draws):
        assert not find_clipped(ChannelSamples(in_single_precision(rng), ALL))[0].any()


@pytest.mark.draws(60, 300)
def test_numbers_of_few_digits_do_not_stand_still(draws: int, rng: np.random.Generator) -> None:
    """Their steps are ten times as coarse above one as below it."""
    for _ in range(draws):
        values = of_few_digits(rng)
        assert not find_clipped(ChannelSamples(values, ALL))[0].any()
        assert not find_lost_samples(ChannelSamples(values, ALL)).any()


@pytest.mark.parametrize("motion", ["random", "multisine", "sweep", "shock"])
@pytest.mark.parametrize("part", [0.7, 0.4])
@pytest.mark.parametrize("sides", [2, 1])
def test_a_rail_is_found_in_any_motion(motion: str, part: float, sides: int, rng: np.random.Generator) -> None:
    for _ in range(4):
        free = MOTIONS[motion](rng) + 1e-3 * rng.standard_normal(N)
        level = part * np.max(np.abs(free)) if sides == 2 else part * np.max(free)
        cut = np.clip(free, -level if sides == 2 else None, level)
        over = cut != free
        bad, rails = find_clipped(ChannelSamples(cut, ALL))
        assert np.mean(bad[over]) > 0.7  # a side with a single sample cut off shows nothing
        assert np.all(bad[over & (np.sign(cut) == np.sign(rails[0]))])
        assert np.sum(bad & ~over) <= np.sum(np.abs(np.diff(over.astype(int)))) + 1
        assert all(abs(abs(rail) / level - 1.0) < 1e-12 for rail in rails)


def test_a_rail_under_noise_is_found(rng: np.random.Generator) -> None:
    """Noise of 0.1 % that came after the clipping."""
    for part in (0.5, 0.4):
        free = band_limited(rng)
        level = part * np.max(np.abs(free))
        over = np.abs(free) > level
        bad, _ = find_clipped(ChannelSamples(np.clip(free, -level, level) + 1e-3 * rng.standard_normal(N), ALL))
        assert np.mean(bad[over]) > 0.95


def test_rest_is_no_rail(rng: np.random.Generator) -> None:
    """A drive at rest for 45 % of the record, before, after or amidst its motion, one-sided or not."""
    for noise in (0.0, 1e-3):
        for begin in (0, 900, 2200):
            moved = np.abs(np.sin(0.05 * T)) if begin == 900 else band_limited(rng)
            moved[begin : begin + 1800] = 0.0
            moved += noise * rng.standard_normal(N)
            assert not find_clipped(ChannelSamples(moved, ALL))[0].any()
            assert not find_lost_samples(ChannelSamples(moved, ALL)).any()
            assert not PredictedChannel.from_samples(ChannelSamples(moved, ALL)).wild.any()


@pytest.mark.parametrize("turns", [3, 40])
@pytest.mark.parametrize("power", [2, 8])
def test_a_motion_from_rest_to_one_side_is_at_no_rail(turns: int, power: int) -> None:
    """Displacement of a sweep that begins softly: its first samples are equal within rounding, at the extreme."""
    acceleration = np.sin(2.0 * np.pi * turns * (T / N) ** 2) * np.minimum(20.0 * T / N, 1.0) ** power
    displacement = np.cumsum(np.cumsum(acceleration))
    for values in (displacement, displacement[::-1], -displacement):
        assert not find_clipped(ChannelSamples(values, ALL))[0].any()


@pytest.mark.parametrize("steps", [2, 8, 30])
@pytest.mark.parametrize("noise", [0.0, 1e-3, 3e-2])
def test_stairs_are_told_from_a_motion_that_jumps(steps: int, noise: float, rng: np.random.Generator) -> None:
    """Lost time is one jump; were it a stair, it would not be looked for."""
    free = band_limited(rng, 0.001, 0.1)
    stairs = np.repeat(free[::steps], steps)[:N]
    broken = np.delete(free, slice(1500, 1600))
    assert is_stairs(stairs + noise * rng.standard_normal(stairs.size))
    assert not is_stairs(broken + noise * rng.standard_normal(broken.size))


@pytest.mark.parametrize("steps", [3, 7, 20])
def test_staircases_and_squares_are_left_alone(steps: int, rng: np.random.Generator) -> None:
    square = np.tanh(30.0 * np.sin(0.0431 * T))
    held = np.repeat(band_limited(rng)[:: steps * 2], steps)[:N]
    for values in (held, np.sign(np.sin(0.0431 * T)), square + 1e-3 * rng.standard_normal(N)):
        valid = np.ones(values.size, dtype=bool)
        assert not find_clipped(ChannelSamples(values, valid))[0].any()
        assert not find_lost_samples(ChannelSamples(values, valid)).any()
        assert not PredictedChannel.from_samples(ChannelSamples(values, valid)).wild.any()


@pytest.mark.parametrize("levels", [[0.0, 0.5, 1.0, 2.0], [-1.0, 0.0, 0.4, 0.9, 2.5]])
@pytest.mark.parametrize("noise", [0.0, 1e-4, 3e-3])
@pytest.mark.draws(10, 100)
def test_the_highest_of_unequal_levels_is_no_rail(
    levels: list[float], noise: float, draws: int, rng: np.random.Generator
) -> None:
    """A command in stairs: a quarter of it was left out, and u grew a thousandfold."""
    for _ in range(draws):
        steps = rng.choice(levels, 60)
        values = np.repeat(steps, rng.integers(20, 160, steps.size))
        values = values + noise * rng.standard_normal(values.size)
        found, _ = find_clipped(ChannelSamples(values, np.ones(values.size, dtype=bool)))
        assert not found.any()


def test_full_scale_decides_where_it_is_given(rng: np.random.Generator) -> None:
    """In both channels, on both sides; a plateau below it is the signal's own."""
    values = np.clip(band_limited(rng), -2.2, 2.2)
    for channel in ("reference", "response"):
        others = {"reference": band_limited(rng), "response": band_limited(rng), channel: values}
        for full_scale, said in ((2.2, True), (2.3, False)):
            limits = {f"{channel}_full_scale": full_scale}
            _, findings = screen([Record("r", sampling_rate_hz=1e3, excitation="random", **others, **limits)])
            assert ("clipped" in [f.code for f in findings]) == said
            assert all(channel in f.message for f in findings)


def test_the_highest_code_of_a_converter_is_full_scale(rng: np.random.Generator) -> None:
    step = 2.0**-9
    values = np.clip(np.rint(band_limited(rng) / step) * step, -2.0, 2.0 - step)
    bad, rails = find_clipped(ChannelSamples(values, ALL), 2.0)
    assert np.all(bad[values == 2.0 - step])
    assert len(rails) == 2


@pytest.mark.parametrize("motion", ["random", "multisine", "sweep", "sine"])
@pytest.mark.parametrize(("count", "length"), [(10, 5), (1, 20), (3, 100)])
@pytest.mark.parametrize("held", [True, False])
def test_lost_samples_are_found(motion: str, count: int, length: int, held: bool, rng: np.random.Generator) -> None:
    for _ in range(5):
        values = MOTIONS[motion](rng) + 1e-3 * rng.standard_normal(N)
        kept = values.copy()
        begins = 13 + (N // count) * np.arange(count) + rng.integers(0, N // count - length - 20, count)
        for at in begins:
            values[at : at + length] = values[at - 1] if held else 0.0
        bad = find_lost_samples(ChannelSamples(values, ALL))
        assert np.all(bad[values != kept])
        assert np.sum(bad & (values == kept)) <= 3 * count


@pytest.mark.parametrize("steps", [2, 8, 30])
def test_what_held_samples_look_like_is_counted_once(
    steps: int, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where most values return at once, no run of them needs a look at its neighbours."""
    looks: list[int] = []
    monkeypatch.setattr(gaps, "_chance_of_equal", lambda *_: looks.append(1) or 1.0)
    assert not find_lost_samples(
        ChannelSamples(np.repeat(rng.standard_normal(N // steps), steps), ALL[: N // steps * steps])
    ).any()
    assert not looks


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize(("size", "share"), [(1.0, 0.3), (10.0, 0.9), (100.0, 0.9)])
def test_single_wild_samples_are_found(motion: str, size: float, share: float, rng: np.random.Generator) -> None:
    """Off by 1 to 100 times the rms, under noise of 0.1 % and 1 %: most of them, and no other sample."""
    hit = 0
    for level in (1e-3, 1e-2) * 5:
        free = MOTIONS[motion](rng)
        free = free + level * np.std(free) * rng.standard_normal(N)
        values = free.copy()
        places = rng.choice(N // 40, 4, replace=False) * 40 + 20
        values[places] += size * np.std(free) * rng.choice([-1.0, 1.0], 4)
        bad = PredictedChannel.from_samples(ChannelSamples(values, ALL)).wild
        assert bad.any() or size == 1.0
        assert not np.any(bad & (values == free))
        hit += int(bad[places].sum())
    assert hit >= share * 40


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("place", [ORDER + 1, 2 * ORDER, 3 * ORDER])
def test_wild_samples_near_an_end_are_found(motion: str, place: int, rng: np.random.Generator) -> None:
    """As soon as enough samples stand on both sides; nearer to an end a motion from rest looks alike."""
    for index in (place, N - 1 - place):
        free = MOTIONS[motion](rng)
        bad = index == T
        values = free + (10.0 * bad + 1e-2 * rng.standard_normal(N)) * np.std(free)
        assert np.all(PredictedChannel.from_samples(ChannelSamples(values, ALL)).wild == bad)


@pytest.mark.draws(20, 100)
def test_corners_and_edges_of_a_motion_are_not_wild(draws: int, rng: np.random.Generator) -> None:
    """Half-sines of 4 samples and more that begin at once, struck sensors, triangles."""
    for _ in range(draws):
        length, noise = int(rng.integers(4, 200)), 10.0 ** rng.uniform(-6.0, -2.0) * rng.standard_normal(N)
        push = np.where(np.abs(T - 700.0 - 0.5 * length) < 0.5 * length, np.sin(np.pi * (T - 700) / length), 0.0)
        since = np.maximum(T - rng.uniform(500.0, 900.0), 0.0)
        struck = np.exp(-since * rng.uniform(1e-3, 0.05)) * np.sin(rng.uniform(0.01, 2.0) * since)
        triangle = np.arcsin(np.sin(rng.uniform(0.01, 0.3) * T))
        for values in (push, struck, triangle):
            assert not PredictedChannel.from_samples(ChannelSamples(values + noise, ALL)).wild.any()


def test_what_both_channels_show_is_motion(rng: np.random.Generator) -> None:
    """A stiff sensor answers a blow of one sample by one sample."""
    blow = np.where(T == 1200, 8.0, 0.0)
    reference, response = (band_limited(rng) + 1e-3 * rng.standard_normal(N) for _ in range(2))
    assert screen([Record("r", reference + blow, response - 0.5 * blow, 1e3, "shock")])[1] == ()
    _, (said,) = screen([Record("r", reference + blow, response, 1e3, "shock")])
    assert said.code == "dead_channel"
    assert "reference channel has a single sample far off its neighbours at 1.2 s" in said.message


@pytest.mark.parametrize("length", [1, 2])
@pytest.mark.parametrize("sizes", [(1.2, 3.0), (100.0, 30.0), (-0.7, 9.0)])
@pytest.mark.parametrize("quantity", [0, 1, 2])
def test_a_glitch_of_both_channels_is_no_lost_time(
    length: int, sizes: tuple[float, float], quantity: int, rng: np.random.Generator
) -> None:
    """A converter of many channels fails for a sample or two in all of them: no more is left out, whatever derivative
    of the motion is measured. The sensor, of 1.8 % of the rate, cannot answer like that."""
    frequency = np.fft.rfftfreq(N)
    s, w = 2j * np.pi * frequency, 2.0 * np.pi * 0.018
    lines = np.fft.rfft(band_limited(rng, 0.002, 0.08))
    lines[1:] /= s[1:] ** quantity
    reference = np.fft.irfft(lines, N)
    response = np.fft.irfft(lines * s**quantity * w * w / (s * s + 0.2 * w * s + w * w), N)
    for _ in range(3):
        bad = np.isin(T, rng.integers(60, N - 60) + np.arange(length))
        channels = [
            values + (bad * size + 0.1 * rng.standard_normal(N)) * np.std(values)
            for values, size in zip((reference, response), sizes, strict=True)
        ]
        (kept,), findings = screen([Record("r", *channels, 1e3, "random")])  # type: ignore[arg-type]
        assert "clock_suspect" not in [finding.code for finding in findings]
        assert np.all(kept.mask == ~bad)


@pytest.mark.parametrize("motion", ["random", "multisine", "sweep", "sine"])
@pytest.mark.parametrize("length", [3, 12, 40])
@pytest.mark.parametrize("size", [10.0, 1e2, 1e5])
def test_a_run_of_wild_samples_is_found(motion: str, length: int, size: float, rng: np.random.Generator) -> None:
    """A buffer that slips, in errors of the prediction of a sample by those before it: no run of it is overlooked, and
    little else is left out."""
    for level in (1e-3, 1e-2):
        free = MOTIONS[motion](rng)
        free = free + level * np.std(free) * rng.standard_normal(N)
        scale = (
            np.max(np.abs(free - np.median(free)))
            * PredictedChannel.from_samples(ChannelSamples(free, ALL)).prediction.deviation
        )
        bad = np.isin(T, np.add.outer([700, 2100, 3300], np.arange(length)))
        values = free + bad * size * scale * rng.choice([-1.0, 1.0], N) * rng.uniform(0.7, 1.3, N)
        wild = PredictedChannel.from_samples(ChannelSamples(values, ALL), MAX_RUN_SAMPLES).wild
        assert np.all(wild[bad])
        assert np.sum(wild & ~bad) <= 3 * 2 * GUARD_SAMPLES


@pytest.mark.parametrize("motion", ["random", "multisine"])
@pytest.mark.parametrize("length", [8, 20, 40])
def test_what_the_reference_shows_too_is_no_run_of_wild_samples(
    motion: str, length: int, rng: np.random.Generator
) -> None:
    """A table that is struck while it shakes: motion, whatever the sensor makes of it."""
    knock = np.where(np.abs(T - 1500) < 0.5 * length, np.cos(np.pi * (T - 1500) / length), 0.0)
    for gain in (1.0, 10.0):
        moved = MOTIONS[motion](rng)
        moved = moved / np.std(moved) + gain * knock
        response = np.convolve(moved, np.exp(-0.3 * np.arange(40)))[:N]
        channels = [v + 1e-3 * np.std(v) * rng.standard_normal(N) for v in (moved, response)]
        assert screen([Record("r", *channels, 1e3, motion)])[1] == ()  # type: ignore[arg-type]


def test_a_jump_of_velocity_is_a_pulse_of_acceleration(rng: np.random.Generator) -> None:
    """A reference in velocity jumps, in displacement it bends, where the response is a pulse of a sample: motion."""
    pulse = np.interp(T - 1200.0, [-1.0, 0.0, 1.0], [0.0, 8.0, 0.0]) + band_limited(rng)
    response = pulse + 1e-3 * rng.standard_normal(N)
    for reference in (np.cumsum(pulse), np.cumsum(np.cumsum(pulse))):
        noisy = reference + 1e-4 * rng.standard_normal(N)
        assert screen([Record("r", noisy, response, 1e3, "shock")])[1] == ()
        _, (said,) = screen([Record("r", noisy, response + np.where(T == 700, 8.0, 0.0), 1e3, "shock")])
        assert "a single sample far off its neighbours at 0.7 s" in said.message


@pytest.mark.parametrize("noise", [1e-6, 1e-3, 1e-2])
@pytest.mark.draws(10, 60)
def test_a_burst_that_begins_softly_is_sound(noise: float, draws: int, rng: np.random.Generator) -> None:
    """The reference is free of noise: it shows each corner of its envelope, the response those beyond its noise."""
    for _ in range(draws):
        envelope = np.sin(0.5 * np.pi * np.clip((T - 1800.0) / 50.0, 0.0, 1.0)) ** 2
        lines = np.fft.rfft(envelope * band_limited(rng, 0.002, 0.15))
        moved = np.fft.irfft(np.where(np.fft.rfftfreq(N) < 0.45, lines, 0.0), N)
        response = np.convolve(moved, np.exp(-0.3 * np.arange(40)))[:N]
        response = response + noise * np.std(response) * rng.standard_normal(N)
        assert screen([Record("r", moved, response, 1e3, "random")])[1] == ()


@pytest.mark.parametrize("motion", ["random", "multisine", "sine"])
def test_lost_time_is_found_and_cut_off(motion: str, rng: np.random.Generator) -> None:
    """Both channels lose 37 samples: the longer part stays, whatever the response is. Whole ones stay whole."""
    for part in (0.3, 0.6) * 5:
        motion_, at = MOTIONS[motion](rng), int(part * N)
        response = np.convolve(motion_, np.exp(-0.3 * np.arange(40)))[:N]
        channels = [v + 1e-3 * np.std(v) * rng.standard_normal(N) for v in (motion_, response)]
        assert find_breaks(*(PredictedChannel.from_samples(ChannelSamples(one, ALL)) for one in channels)).size == 0
        cut = [np.delete(values, slice(at, at + 37)) for values in channels]
        (place,) = find_breaks(
            *(PredictedChannel.from_samples(ChannelSamples(one, np.ones(N - 37, dtype=bool))) for one in cut)
        )
        assert abs(place - at) <= 2
    (kept,), (said,) = screen([Record("r", *cut, 1e3, motion)])  # type: ignore[arg-type]
    assert said.code == "clock_suspect"
    assert "break off at 2.4" in said.message or "break off at 2.39" in said.message
    assert not kept.mask[at + 2 :].any()
    assert kept.mask[: at - 4].all()


@pytest.mark.parametrize("size", [0.0, 5.0, 20.0])
def test_wild_samples_at_the_end_are_left_out(size: float, rng: np.random.Generator) -> None:
    """What comes after them is not known; the reference denies them. At zero, the channel has stopped."""
    motion = band_limited(rng)
    response = np.convolve(motion, np.exp(-0.3 * np.arange(40)))[:N]
    channels = [v / np.std(v) + 1e-3 * rng.standard_normal(N) for v in (motion, response)]
    assert screen([Record("r", *channels, 1e3, "random")])[1] == ()
    channels[1][-25:] = size * rng.uniform(-1.0, 1.0, 25)
    (screened,), (said,) = screen([Record("r", *channels, 1e3, "random")])
    assert said.code == "dead_channel"
    assert not screened.mask[-20:].any()
    assert screened.mask[:-45].all()


def test_two_equal_tops_of_a_slow_tone_are_no_rail() -> None:
    """Of 24 bit: no step was seen in values that lie dozens of steps apart."""
    records = BY_NAME["clean/in-light+delay/mixed/24 bit"].trial(96).calibration().records
    _, findings = screen(records, {})
    assert findings == ()


@pytest.mark.draws(20, 100)
def test_a_converter_that_flickers_before_the_motion_has_lost_nothing(draws: int, rng: np.random.Generator) -> None:
    """A sweep of 16 bit "stood still" before it began: its first run of equal codes was not at the very begin."""
    late = np.maximum(T - 20.0, 0.0)
    moved = 16e3 * np.sin(1e-2 * late**2) * np.minimum(late / 100.0, 1.0)
    for _ in range(draws):
        codes = np.rint(moved - 234.7 + 0.15 * rng.standard_normal(N))
        for values in (codes, codes[::-1]):
            assert not find_lost_samples(ChannelSamples(values, ALL)).any()


def test_a_sensor_that_comes_to_rest_before_the_motion_has_lost_nothing() -> None:
    """A free motion of 16 bit ends in equal codes, and the sweep begins: the reference rests until then."""
    late = np.maximum(T - 40.0, 0.0)
    moved = np.rint(16e3 * np.sin(1e-2 * late**2) * np.minimum(late / 100.0, 1.0))
    answered = np.rint(np.roll(moved, 3) - 8e3 * np.exp(-0.3 * T) * np.cos(0.8 * T))
    reference, response = (ChannelSamples(values, ALL) for values in (moved, answered))
    assert find_lost_samples(response).any()
    assert not find_lost_samples(response, reference).any()
    held = answered.copy()
    held[400:412] = held[399]
    assert find_lost_samples(ChannelSamples(held, ALL), reference).any()


def test_a_motion_that_begins_is_no_lost_time(rng: np.random.Generator) -> None:
    for noise in (1e-6, 1e-3):
        channels = [np.where(T < 1500, 0.0, band_limited(rng)) + noise * rng.standard_normal(N) for _ in range(2)]
        assert find_breaks(*(PredictedChannel.from_samples(ChannelSamples(one, ALL)) for one in channels)).size == 0


@pytest.mark.parametrize(("channel", "part"), [("reference", 0.8), ("response", 0.4)])
def test_what_is_left_gives_the_sensor(channel: str, part: float) -> None:
    """Random motion cut in one channel: the sensor within its stated uncertainty."""
    truth = SENSORS["paper"].parameters
    clean = simulate(
        "paper",
        "random",
        samples=N,
        sampling_rate_hz=10e3,
        frequencies_hz=[30.0, 1500.0],
        repeats=2,
        response_noise=1e-3,
        seed=4,
    )
    records = []
    for record in clean.records:
        level = part * float(np.max(np.abs(getattr(record, channel))))
        changed = {name: getattr(record, name) for name in ("reference", "response")}
        changed[channel] = np.clip(changed[channel], -level, level)
        records.append(Record(record.name, sampling_rate_hz=10e3, excitation="random", **changed))
    result = identify(Calibration(tuple(records), model=clean.model))
    assert "clipped" in result.warning_codes
    for name, value in truth.items():
        found = result.parameters[name]
        assert found.standard_uncertainty is not None
        assert abs(found.value - value) < 4.0 * found.standard_uncertainty


def test_a_reference_that_is_nowhere_whole_is_refused(rng: np.random.Generator) -> None:
    motion = band_limited(rng)
    record = Record("r", np.clip(motion, -0.8, 0.8), motion, 1e3, "random")
    with pytest.raises(InputError, match="too little is left"):
        screen([record])


def test_a_generator_of_coarse_stairs_is_not_overdriven(tmp_path: Path) -> None:
    """The drive of the real seismometer: stairs with noise on them, the top one the widest; its laser is at a rail."""
    calibration = read(calibration_beside_data("sm3-laser.toml", "sm3", tmp_path))
    _, findings = screen(calibration.records)
    (said,) = [f.message for f in findings if f.code == "clipped"]
    assert said.startswith("0_2Hz.csv: the response channel")


def test_a_burst_that_fades_in_breaks_off_nowhere():
    """Its displacement has a corner of a tenth of the step between samples; half of it was left out."""
    calibration = BY_NAME["quantities/displacement/velocity-pickup/burst"].trial(102).calibration()
    assert not screen(calibration.records, calibration.units)[1]
