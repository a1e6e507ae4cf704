"""Weights by the noise's own spectrum: what must hold of the estimate, of u, and of the spectrum that is read."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

import vibrident
from vibrident.data.records import Calibration
from vibrident.fit.descent import reweighting
from vibrident.fit.descent.reweighting import reweighted
from vibrident.fit.estimators.kinds import ipnn
from vibrident.fit.noise.motion import Motion
from vibrident.fit.noise.spectrum import noise_spectrum
from vibrident.fit.problem import BinProblem, Coordinates
from vibrident.physics.discretisation import method
from vibrident.physics.models import parse
from vibrident.physics.simulation import ChannelNoise, HalfSineShock, sensor_named, simulate, with_noise

PIEZO = "piezo"
SHAPE = {"sampling_rate_hz": 1.2e6, "samples": 4000, "frequencies_hz": [900.0, 9e4], "repeats": 2, "seed": 3}


@functools.cache
def random_motion() -> Calibration:
    return simulate(PIEZO, "random", **SHAPE)  # type: ignore[arg-type]


def deviations(base: Calibration, runs: int, **noise: object) -> tuple[np.ndarray, np.ndarray]:
    """(identified − true)/u and u/|true| of every run and parameter, shapes (runs, 3)."""
    true = sensor_named(PIEZO).parameters
    found, spread = [], []
    for seed in range(runs):
        result = vibrident.identify(with_noise(base, seed=seed, **noise), estimator="ipnn")  # type: ignore[arg-type]
        known = [result.parameters[name] for name in true]
        found.append([(p.value - t) / p.standard_uncertainty for p, t in zip(known, true.values(), strict=True)])
        spread.append([p.standard_uncertainty / abs(t) for p, t in zip(known, true.values(), strict=True)])
    return np.array(found), np.array(spread)


def with_equal_weights(calibration: Calibration, monkeypatch: pytest.MonkeyPatch) -> vibrident.Result:
    with monkeypatch.context() as patch:
        patch.setattr(ipnn, "reweighted", lambda *_, **__: None)
        return vibrident.identify(calibration, estimator="ipnn")


@pytest.mark.parametrize(
    "noise",
    [
        {"reference_noise": 0.01},
        {"reference_noise": 0.01, "response_noise": 0.002},
        {"response_noise": ChannelNoise(white=0.003, flicker=0.01)},
    ],
    ids=["reference", "both", "flicker"],
)
@pytest.mark.quick("few-reference")
@pytest.mark.draws(6, 24)
def test_no_bias_and_u_is_the_scatter(noise: dict, draws: int) -> None:
    found, _ = deviations(random_motion(), draws, **noise)
    assert np.all(np.abs(found.mean(axis=0)) < 3.0 / np.sqrt(draws))
    assert np.all(np.abs(np.sqrt(np.mean(found**2, axis=0)) - 1.0) < 3.0 / np.sqrt(2 * draws))


def test_noise_of_the_reference_costs_a_sharp_resonance_little(monkeypatch: pytest.MonkeyPatch) -> None:
    """Equal weights let what passes the resonance drown what the reference says elsewhere, of the gain above all."""
    noisy = with_noise(random_motion(), reference_noise=0.01, seed=1)
    weighed = vibrident.identify(noisy, estimator="ipnn").parameters["sensitivity"]
    equal = with_equal_weights(noisy, monkeypatch).parameters["sensitivity"]
    assert weighed.standard_uncertainty < 0.5 * equal.standard_uncertainty


def test_noise_of_the_reference_leads_two_modes_above_the_band_not_astray() -> None:
    """They trade along a curved valley, where it draws equal weights thirty standard uncertainties aside."""
    values = {"sensitivity": 166.0, "natural_frequency": 1538.0, "damping_ratio": 0.033}
    values |= {"mode2_frequency": 620.0, "mode2_damping": 0.05, "mode2_gain": 0.01}
    band = {"sampling_rate_hz": 2722.0, "samples": 1000, "frequencies_hz": [14.0, 544.0], "repeats": 8}
    base = simulate(("accelerometer+mode2", values), "random", seed=1, **band)  # type: ignore[arg-type]
    for seed in (0, 2):
        result = vibrident.identify(with_noise(base, seed=seed, reference_noise=3e-3, response_noise=1e-4))
        assert result.settings["noise_weights"] == "spectrum"
        assert set(result.warning_codes) <= {"weakly_determined"}
        for name, true in values.items():
            known = result.parameters[name]
            assert abs(known.value - true) < 4.0 * known.standard_uncertainty


def test_white_noise_changes_next_to_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    noisy = with_noise(random_motion(), response_noise=0.01, seed=2)
    weighed, equal = vibrident.identify(noisy, estimator="ipnn"), with_equal_weights(noisy, monkeypatch)
    assert (weighed.settings["noise_weights"], equal.settings["noise_weights"]) == ("spectrum", "white")
    for name, other in equal.parameters.items():
        known = weighed.parameters[name]
        assert abs(known.value - other.value) < 0.25 * other.standard_uncertainty
        # Both read the noise near the resonance from some tens of lines.
        freedom = weighed.settings["effective_degrees_of_freedom"]
        assert known.standard_uncertainty == pytest.approx(other.standard_uncertainty, rel=3.0 / np.sqrt(2.0 * freedom))


def test_hum_is_an_unknown_and_costs_little() -> None:
    quiet = deviations(random_motion(), 3, response_noise=0.003)[1]
    tone = ChannelNoise(white=0.003, hum=0.1, hum_frequency_hz=12345.0, hum_harmonics=(1.0, 0.3))
    found, humming = deviations(random_motion(), 3, response_noise=tone)
    assert np.all(humming < 1.1 * quiet)
    assert np.all(np.abs(found) < 4.0)


def test_what_the_spectrum_says_of_its_parts() -> None:
    """White noise that passed a resonance, white noise, and a tone: each found for what it is."""
    rng = np.random.default_rng(4)
    n = 20000
    order = np.arange(n // 2 + 1) / n
    through = 1.0 / np.abs(1.0 - (order / 0.1) ** 2 + 0.1j * order / 0.1) ** 2
    input_noise = np.fft.irfft(np.fft.rfft(rng.standard_normal(n)) * np.sqrt(through), n)
    place = 3210.3
    tone = 0.3 * np.cos(2.0 * np.pi * place * np.arange(n) / n)
    signal = 0.5 * input_noise + 0.2 * rng.standard_normal(n) + tone
    nothing = np.zeros(n // 2 + 1, dtype=complex)
    found = noise_spectrum(np.fft.rfft(signal), Motion.of(nothing.__getitem__, n, through), 0.0)
    assert found.input_noise == pytest.approx(0.25, rel=0.07)  # three standard deviations
    expected = 0.25 * through + 0.04
    middle = (order > 0.01) & (np.abs(order * n - place) > 40)
    assert np.median(found.psd[middle] / expected[middle]) == pytest.approx(1.0, abs=0.03)
    assert found.tones == pytest.approx((place,), abs=0.015)  # a parabola between lines is off by 0.02
    quiet = noise_spectrum(np.fft.rfft(rng.standard_normal(n)), Motion.of(nothing.__getitem__, n, through), 0.0)
    assert (quiet.input_noise, quiet.tones) == (0.0, ())
    assert np.max(quiet.doubt()) < 0.05


@pytest.mark.parametrize("excitation", ["random", "shock"])
def test_a_misfit_is_not_weighed_away(excitation: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second mode that the model has not: the fit stays the best overall, and the result says what is wrong."""
    shape = {"sampling_rate_hz": 40e3, "samples": 4000, "repeats": 2, "seed": 3}
    band = {} if excitation == "shock" else {"frequencies_hz": [30.0, 3000.0]}
    noisy = with_noise(simulate("two-mode", excitation, **shape, **band), response_noise=1e-4, seed=1)  # type: ignore[arg-type]
    found = vibrident.identify(noisy, "accelerometer", "ipnn")
    equal = with_equal_weights(replace(noisy, model="accelerometer"), monkeypatch)
    assert found.settings["noise_weights"] == "white"
    assert "lack_of_fit" in found.warning_codes
    for name, parameter in equal.parameters.items():
        assert found.parameters[name].value == pytest.approx(parameter.value, rel=1e-9)


STIFF = ("accelerometer", {"sensitivity": 0.01, "natural_frequency": 30e3, "damping_ratio": 0.02})


@functools.cache
def far_below_resonance(kind: str) -> Calibration:
    """Motion to 4 kHz of a sensor with its resonance at 30 kHz, sampled at 20 kHz: |H| is level over the band."""
    shape = {"sampling_rate_hz": 2e4, "samples": 4000}
    if kind == "shock":
        return simulate(STIFF, [HalfSineShock(1000.0, 1e-3, 0.04)], **shape)
    band = np.geomspace(50.0, 4000.0, 40) if kind == "multisine" else (50.0, 4000.0)
    return simulate(STIFF, kind, frequencies_hz=band, **shape)


@pytest.mark.parametrize(
    ("kind", "noise"),
    [
        ("shock", {"reference_noise": 0.001, "response_noise": 1e-5}),  # rest is not exact
        ("sweep", {"reference_noise": 0.01, "response_noise": 0.01}),
        ("multisine", {"reference_noise": 0.01}),
        ("random", {"reference_noise": ChannelNoise(flicker=0.01)}),
    ],
    ids=["shock", "sweep", "multisine", "flicker"],
)
def test_a_level_response_lets_lines_without_motion_tell_the_noise_of_the_reference(kind: str, noise: dict) -> None:
    """Without them the gain is drawn down where there is noise alone, and the resonance away with it, by many u."""
    runs, found = 8, []
    for seed in range(runs):
        result = vibrident.identify(with_noise(far_below_resonance(kind), seed=seed, **noise), estimator="ipnn")
        assert set(result.warning_codes) <= {"weakly_determined"}
        known = [result.parameters[name] for name in STIFF[1]]
        found.append([(p.value - t) / p.standard_uncertainty for p, t in zip(known, STIFF[1].values(), strict=True)])
    assert np.all(np.sqrt(np.mean(np.square(found), axis=0)) < 1.0 + 3.0 / np.sqrt(2 * runs))


def test_free_motion_above_half_the_sampling_rate_tells_nothing() -> None:
    """It was not recorded; of the states, which hold noise then, each alias made an optimum of its own, 5 u apart."""
    true = {"sensitivity": 0.1, "natural_frequency": 8390.0, "damping_ratio": 0.0117}
    shape = {"frequencies_hz": [10.0, 400.0], "sampling_rate_hz": 2000.0, "samples": 600, "repeats": 8}
    made = simulate(("accelerometer", true), "random", response_noise=1e-3, start="steady", seed=0, **shape)  # type: ignore[arg-type]
    model, noise = parse("accelerometer"), np.array([1e-3 * np.std(r.response) for r in made.records])
    problem = BinProblem.build(made.records, model, method("bandlimited"), "acceleration", true)
    coordinates = Coordinates.at(model, true, (10.0, 400.0), 0.1)
    ends = []
    for begin in (0.0, 0.03):
        end = reweighted(problem, coordinates, [coordinates.first + np.array([0.0, begin, 0.0])], noise)
        assert end is not None
        ends.append((end.z - coordinates.first) / np.sqrt(np.diag(end.covariance)))
    assert np.all(np.abs(ends[0]) < 4.0)
    np.testing.assert_allclose(ends[1], ends[0], atol=0.1)


def test_a_start_from_which_the_network_explodes_is_passed_over() -> None:
    """Its residual is finite, but the sum of its squares overflows: eigenvalues of the noise did not converge."""
    made, model = random_motion(), parse("accelerometer")
    true = dict(sensor_named(PIEZO).parameters)
    problem = BinProblem.build(made.records, model, method("bandlimited"), "acceleration", true)
    coordinates = Coordinates.at(model, true, (100.0, 4000.0), 0.1)
    assert reweighted(problem, coordinates, [coordinates.first], np.full(len(made.records), 1e-200)) is None


@pytest.mark.parametrize(("seed", "open_above"), [(0, {"natural_frequency"}), (12, set())])
def test_a_sensor_of_which_little_is_seen_reaches_its_optimum_in_noise_of_the_reference(seed, open_above):
    """Twenty times above the band: each full step led back to where it came from, and equal weights were rejected.

    In the first draw χ² rises by 3.5 up to a sensor without resonance, and 95 % take 3.9: no u would be true.
    """
    stiff = {"sensitivity": 0.1, "natural_frequency": 44e3, "damping_ratio": 0.01}
    clean = simulate(
        ("accelerometer", stiff), "random", frequencies_hz=[50.0, 2000.0], sampling_rate_hz=10e3, samples=1000,
        repeats=4, start="rest", seed=seed,
    )  # fmt: skip
    result = vibrident.identify(with_noise(clean, reference_noise=0.01, response_noise=1e-3, seed=seed))
    assert result.settings["noise_weights"] == "spectrum"
    assert result.fit.adequate
    for name, true in stiff.items():
        found = result.parameters[name]
        low, high = found.interval_95
        assert (high is None) == (found.standard_uncertainty is None) == (name in open_above), name
        assert low < true if high is None else abs(found.value - true) < 4.0 * found.standard_uncertainty, name


@dataclass(eq=False)
class Wandering:
    """An iterate so many standard deviations from the optimum, as it seems."""

    far: float
    misfit: bool = False
    z: np.ndarray = field(default_factory=lambda: np.ones(3))
    end: None = None
    spectra: tuple[()] = ()

    def ahead(self, *_):
        return self.z

    def leads_to(self, *_):
        return True

    def astray(self, _):
        return self.misfit


@pytest.mark.parametrize(
    ("ways", "taken"),
    [
        ([30.0, 8.0, 0.09, 1.0, 2.5, 0.3, 2.2, 3.0, 1.4, 0.4], 6),  # four steps no closer than the third
        ([30.0, 20.0, 30.0, 25.0, 3.0, 0.01], 5),
        ([30.0, (20.0, "misfit"), 3.0], 1),
        ([30.0, None, None, None, None, 3.0], 0),  # as four rejected steps are
        ([30.0, None, None, 3.0, None, None, None, 0.01], 7),
    ],
)
def test_a_descent_ends_where_it_comes_no_closer_or_what_is_left_is_no_noise(monkeypatch, ways, taken):
    every = [None if way is None else Wandering(*(way if isinstance(way, tuple) else (way,))) for way in ways]
    first, made = every[0], iter(every[1:])
    monkeypatch.setattr(reweighting, "iterate_at", lambda *_: next(made))
    monkeypatch.setattr(reweighting, "motion_of", lambda _: None)
    end = reweighting._down(first, [], lambda _: [SimpleNamespace(samples=100)], None)
    assert end is every[taken]
