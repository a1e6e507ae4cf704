"""A sensor that changes within a record, or a record of another sensor, is named; noise of any colour is not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import cheby2, lfilter, sosfilt

from vibrident.data.records import FloatArray, Record
from vibrident.fit.measure.blocks import Blocks, best, least_left, sums_of
from vibrident.fit.measure.odd_records import odd_record
from vibrident.fit.measure.regimes import changes

N, RATE = 4000, 1e3
T = np.arange(N)


def prediction(kind: str, rng: np.random.Generator) -> tuple[FloatArray, float | None]:
    if kind == "sine":
        hz = rng.uniform(4.0, 300.0)
        return np.sin(2.0 * np.pi * hz * T / RATE + rng.uniform(0.0, 6.3)), hz
    if kind == "multisine":
        tones = rng.uniform(5.0, 200.0, 12)
        return sum(np.cos(2.0 * np.pi * hz * T / RATE + rng.uniform(0.0, 6.3)) for hz in tones) / 3.5, None
    spectrum = np.fft.rfft(rng.standard_normal(N))
    spectrum[800:] = 0.0
    return np.fft.irfft(spectrum, N) * 1.5, None


def noise(kind: str, rng: np.random.Generator) -> FloatArray:
    white = rng.standard_normal(N)
    if kind == "growing":
        return white * np.linspace(0.3, 3.0, N)
    if kind == "1/f":
        spectrum = np.fft.rfft(white) / np.sqrt(np.maximum(np.arange(N // 2 + 1), 1.0))
        return np.fft.irfft(spectrum, N) * 20.0
    if kind == "hum":
        return white + np.cos(2.0 * np.pi * 50.0 * T / RATE)
    return white


def found(kind: str, colour: str, change: float, rng: np.random.Generator, size: float = 1e-2) -> list:
    series, hz = prediction(kind, rng)
    gain = np.where(T < 2200, 1.0, 1.0 + change)
    response = gain * series + size * noise(colour, rng)
    mean = 1.0 + change * (N - 2200) / N
    record = Record("r", series, response, RATE, kind)  # type: ignore[arg-type]
    return changes([record], [mean * series], [hz])


@pytest.mark.parametrize("kind", ["sine", "multisine", "random"])
@pytest.mark.parametrize("colour", ["white", "growing", "1/f", "hum"])
@pytest.mark.draws(10, 100)
def test_noise_of_any_colour_is_no_change(kind: str, colour: str, draws: int, rng: np.random.Generator) -> None:
    """The level is 10⁻⁴ a calibration."""
    assert sum(len(found(kind, colour, 0.0, rng)) for _ in range(draws)) == 0


@pytest.mark.draws(60, 300)
def test_a_steep_filter_at_the_end_of_the_band_makes_no_change(draws: int, rng: np.random.Generator) -> None:
    """A delta-sigma converter has one; whitening its noise made large steps of the cut ends of a slow sine."""
    filters, times = cheby2(8, 80.0, 0.9, output="sos"), np.arange(5 * N)
    for _ in range(draws):
        hz = rng.uniform(0.2, 2.0)
        series = np.sin(2.0 * np.pi * hz * times / RATE + rng.uniform(0.0, 6.3))
        response = series + 1e-2 * sosfilt(filters, rng.standard_normal(6 * N))[N:]
        assert changes([Record("r", series, np.round(response, 4), RATE, "sine")], [series], [hz]) == []


@pytest.mark.draws(5, 50)
def test_the_rest_before_and_behind_a_burst_has_no_gain(draws: int, rng: np.random.Generator) -> None:
    """What motion's skirts leave in it beside steps of a converter is no change, though it looks like one of 100 %."""
    burst = np.where((T > 1500) & (T < 3000), np.sin(np.pi * (T - 1500) / 1500) ** 2, 0.0)
    for _ in range(draws):
        series, _ = prediction("random", rng)
        series = series * burst
        skirts = np.where((T <= 1500) & (T > 1200), 1e-4 * rng.standard_normal(N), 0.0)
        response = np.round((series + 2.0 * skirts) / 1e-4) * 1e-4
        assert changes([Record("r", series, response, RATE, "random")], [series + skirts], [None]) == []


@pytest.mark.draws(10, 100)
def test_noise_of_the_reference_through_a_sharp_resonance_is_no_change(draws: int, rng: np.random.Generator) -> None:
    """It is alike over many blocks, and in the prediction too."""
    lines = np.fft.rfftfreq(N, 1.0 / RATE)
    through = 1.0 / (1.0 - (lines / 20.0) ** 2 + 0.01j * lines / 20.0)
    alarms = 0
    for _ in range(draws):
        motion, noise = prediction("random", rng)[0], 0.01 * rng.standard_normal(N)
        response, unfelt = (np.fft.irfft(through * np.fft.rfft(v), N) for v in (motion, noise))
        response = response + 1e-3 * rng.standard_normal(N)
        alarms += len(changes([Record("r", motion + noise, response, RATE, "random")], [response + unfelt], [None]))
    assert alarms == 0


@pytest.mark.draws(20, 200)
def test_ringing_that_the_noise_of_the_reference_excites_is_no_change(draws: int, rng: np.random.Generator) -> None:
    """δ of 0.0005 to 0.001 in records of 1000 samples: it rings for as long as the record, in the prediction too."""
    alarms, frequency = 0, np.fft.rfftfreq(1000)
    for _ in range(draws):
        angle, damping = 2.0 * np.pi * rng.uniform(0.05, 0.14), rng.uniform(0.0005, 0.001)
        recursion = [1.0, -2.0 * np.exp(-damping * angle) * np.cos(angle), np.exp(-2.0 * damping * angle)]
        spectrum = np.fft.rfft(rng.standard_normal(1000))
        motion = np.fft.irfft(np.where((frequency > 0.005) & (frequency < 0.2), spectrum, 0.0))
        noisy = motion + 0.01 * np.std(motion) * rng.standard_normal(1000)
        response, series = (lfilter([1.0], recursion, v) for v in (motion, noisy))
        response = response + 1e-4 * np.std(response) * rng.standard_normal(1000)
        alarms += len(changes([Record("r", noisy, response, RATE, "random")], [series], [None]))
    assert alarms <= 1


@pytest.mark.parametrize("kind", ["sine", "multisine", "random"])
@pytest.mark.parametrize(("change", "size"), [(0.5, 1e-2), (0.1, 1e-2), (0.01, 1e-2), (1e-3, 1e-3)])
def test_a_step_of_gain_is_found_with_its_time_and_size(
    kind: str, change: float, size: float, rng: np.random.Generator
) -> None:
    """A step of ten standard uncertainties of the gain and more, in every one of ten records."""
    for _ in range(10):
        (one,) = found(kind, "white", change, rng, size)
        assert abs(one.gain - change / (1.0 + change * 1800.0 / N)) < 0.2 * change + 4.0 * size / np.sqrt(N)
        assert abs(one.time_s - 2.2) < 0.5


@pytest.mark.draws(20, 200)
def test_one_record_of_another_sensor_is_named(draws: int, rng: np.random.Generator) -> None:
    """12 sines of a straight line's model; one of them 30 deviations off."""
    frequency = np.linspace(-1.0, 1.0, 12)
    matrix = 1e3 * np.block([[np.ones((12, 1)), frequency[:, None]], [np.zeros((12, 1)), frequency[:, None] ** 2]])
    names = [f"r{k}" for k in range(12)]
    deviation = np.full(12, 1e-3)
    alarms = 0
    for trial in range(draws):
        rest = rng.standard_normal(24)
        alarms += odd_record(matrix, rest, names, deviation) is not None
        rest[5] += 30.0
        odd = odd_record(matrix, rest, names, deviation)
        assert odd is not None, trial
        assert odd.record == "r5"
        assert abs(odd.gain / 0.03 - 1.0) < 0.4
    assert alarms == 0


def oscillator(frequency: float, damping: float) -> Callable[[FloatArray], NDArray[np.complex128]]:
    """Response of an accelerometer of gain one."""

    def response(frequency_hz: FloatArray) -> NDArray[np.complex128]:
        x = frequency_hz / frequency
        return 1.0 / (1.0 - x**2 + 2j * damping * x)

    return response


def slopes(frequency: float, damping: float) -> Callable[[FloatArray], NDArray[np.complex128]]:
    """∂ ln H/∂ ln f_n and ∂ ln H/∂δ of it."""

    def found(frequency_hz: FloatArray) -> NDArray[np.complex128]:
        x = frequency_hz / frequency
        bottom = 1.0 - x**2 + 2j * damping * x
        return np.stack([(-2.0 * x**2 + 2j * damping * x) / bottom, -2j * x / bottom])

    return found


def swept_or_struck(kind: str, rng: np.random.Generator) -> FloatArray:
    """A sweep from 5 to 150 Hz over the record, or three shocks in a row."""
    time = T / N
    if kind == "sweep":
        return np.sin(2.0 * np.pi * 5.0 * N / RATE * (30.0**time - 1.0) / np.log(30.0) + rng.uniform(0.0, 6.3))
    return sum(np.exp(-0.5 * ((T - at * N) / rng.uniform(3.0, 6.0)) ** 2) for at in (0.1, 0.45, 0.8))


@pytest.mark.parametrize("kind", ["multisine", "random"])
@pytest.mark.parametrize("step", [0.0, 0.01])
def test_a_resonance_that_moves_is_told_from_a_gain(kind: str, step: float, rng: np.random.Generator) -> None:
    """1 % of the natural frequency under motion that never rests; none is found where nothing moved."""
    lines = np.fft.rfftfreq(N, 1.0 / RATE)
    for _ in range(5):
        motion, _ = prediction(kind, rng)
        before, behind, series = (
            np.fft.irfft(oscillator(60.0 * (1.0 + k * step), 0.05)(lines) * np.fft.rfft(motion), N)
            for k in (-0.5, 0.5, 0.0)
        )
        response = np.where(T < 2200, before, behind) + 1e-3 * np.std(series) * rng.standard_normal(N)
        record = Record("r", motion, response, RATE, kind)  # type: ignore[arg-type]
        found = changes([record], [series], [None], slopes(60.0, 0.05))
        assert len(found) == bool(step)
        for one in found:
            assert abs(one.natural_frequency - step) < 0.2 * step
            assert one.gain == 0.0
            assert abs(one.time_s - 2.2) < 0.5


@pytest.mark.parametrize(
    ("kind", "changed"),
    [
        ("sweep", "gain"),
        ("sweep", "damping"),
        ("sweep", "nothing"),
        *(("shock", c) for c in ("gain", "damping", "frequency", "nothing")),
    ],
)
def test_a_change_within_a_sweep_or_among_shocks_is_found(kind: str, changed: str, rng: np.random.Generator) -> None:
    """5 % of gain, 10 % of damping (30 % among shocks), 0.3 % of natural frequency, in seven of ten or more."""
    frequency, damping = 60.0, 0.05
    after = (
        frequency * (1.003 if changed == "frequency" else 1.0),
        damping * (1.3 if changed == "damping" and kind == "shock" else 1.1 if changed == "damping" else 1.0),
    )
    lines = np.fft.rfftfreq(N, 1.0 / RATE)
    number = 0
    for _ in range(10):
        motion = swept_or_struck(kind, rng)
        before, behind = (
            np.fft.irfft(oscillator(*one)(lines) * np.fft.rfft(motion), N) for one in ((frequency, damping), after)
        )
        gate = T < 2200  # the sweep is at the resonance, and the second shock rings
        response = np.where(gate, before, behind * (1.05 if changed == "gain" else 1.0))
        response = response + 1e-3 * np.std(before) * rng.standard_normal(N)
        record = Record("r", motion, response, RATE, kind)  # type: ignore[arg-type]
        found = changes([record], [before], [None], slopes(frequency, damping))
        number += len(found)
        for one in found:
            assert 1.7 < one.time_s < (3.3 if kind == "shock" else 2.8)  # shocks: before the third
            if changed == "gain":
                assert abs(one.gain - 0.05) < 0.02
            elif kind == "shock":
                assert one.gain == 0.0
                assert abs(one.damping_ratio - (after[1] - damping)) < 2e-3
                assert abs(one.natural_frequency - (after[0] / frequency - 1.0)) < 1e-3  # to first order
    assert number >= 7 if changed != "nothing" else number == 0


@pytest.mark.draws(4, 20)
def test_what_rounding_leaves_of_a_swing_that_dies_away_is_no_change(draws: int, rng: np.random.Generator) -> None:
    """A shock rings for the whole record, in steps of a thousandth of its peak and without noise."""
    lines, motion = np.fft.rfftfreq(2 * N, 1.0 / RATE), np.zeros(2 * N)
    for _ in range(draws):
        motion[:N] = np.exp(-0.5 * ((T - rng.uniform(0.2, 0.3) * N) / 5.0) ** 2)
        frequency, damping = rng.uniform(30.0, 80.0), rng.uniform(0.002, 0.006)
        series = np.fft.irfft(oscillator(frequency, damping)(lines) * np.fft.rfft(motion), 2 * N)[:N]
        step = 1e-3 * float(np.max(np.abs(series)))
        record = Record("r", motion[:N], step * np.round(series / step), RATE, "shock")
        assert changes([record], [series], [None], slopes(frequency, damping)) == []


def test_no_change_leaves_less_than_the_bound_that_spares_looking_for_it(rng):
    """What any amounts of the columns in each block leave is no more than what the best change leaves."""
    columns, parts = rng.standard_normal((2, 1600)), np.array_split(np.arange(1600), 16)
    for step in (0.0, 0.3, 3.0):
        residual = rng.standard_normal(1600) + step * columns[0] * (np.arange(1600) > 700)
        left = residual - best(Blocks.of(columns, residual, parts, 1000.0)).signal(columns, parts)
        assert least_left(sums_of(columns, residual, parts), parts) <= float(left @ left)
