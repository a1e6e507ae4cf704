"""Stated uncertainties against plain Monte Carlo, verdicts against their error rates; margins of three sigma."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import vibrident
from vibrident.data.records import Calibration
from vibrident.fit.information import inverse_normal
from vibrident.fit.response.verdict import REJECTION, as_chi2, chance_of
from vibrident.physics.simulation import SENSORS, ChannelNoise, simulate, with_noise

TRUTH = dict(SENSORS["paper"].parameters)
FREQUENCIES = [100.0, 250, 400, 550, 630, 700, 850, 1000]


def study(base: Calibration, runs: int, estimator: str, **noise: object) -> tuple[np.ndarray, list[float]]:
    """(identified − true)/u of every run and parameter, and χ²/dof of every run."""
    deviations, chi2 = [], []
    for seed in range(runs):
        result = vibrident.identify(with_noise(base, seed=1000 + seed, **noise), estimator=estimator)  # type: ignore[arg-type]
        found = result.parameters
        deviations.append([(found[k].value - v) / (found[k].standard_uncertainty or np.nan) for k, v in TRUTH.items()])
        chi2.append(result.fit.chi2_reduced or np.nan)
    return np.array(deviations), chi2


@pytest.fixture(scope="module")
def tones() -> Calibration:
    return simulate("paper", "sine", frequencies_hz=FREQUENCIES, samples=2000, excitation_snr_db=20.0, seed=1)


@pytest.mark.parametrize(
    ("estimator", "noise"),
    [
        ("ml", {"response_noise": 0.01}),
        ("ipnn", {"response_noise": 0.01}),
        ("lsm", {"response_noise": 0.01}),
        ("ipnn", {"response_noise": ChannelNoise(white=0.005, flicker=0.01, offset=0.3, drift=0.02)}),
    ],
    ids=["ml-response", "ipnn-response", "lsm-response", "ipnn-coloured"],
)
@pytest.mark.quick("few-ml-response")
@pytest.mark.draws(8, 60)
def test_scatter_and_coverage_are_as_stated(tones: Calibration, estimator: str, noise: dict, draws: int) -> None:
    deviations, chi2 = study(tones, draws, estimator, **noise)
    scatter = deviations.std(axis=0, ddof=1)
    coloured = "coloured" if isinstance(noise.get("response_noise"), ChannelNoise) else ""
    # Coloured noise at a tone is taken from lines that may be louder: u may be too large, not too small.
    low = 0.3 if coloured else 1.0 - 3.0 / np.sqrt(2 * draws)
    assert np.all(scatter < 1.0 + 3.0 / np.sqrt(2 * draws))
    assert np.all(scatter > low)
    assert np.all(np.abs(deviations.mean(axis=0)) < 3.0 / np.sqrt(draws) * max(1.0, float(scatter.max())))
    covered = np.mean(np.abs(deviations) < 1.96, axis=0)
    assert np.all(covered > 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / draws))
    if not coloured:
        degrees = 2 * len(FREQUENCIES) - 3
        assert np.mean(chi2) == pytest.approx(1.0, abs=3.0 * np.sqrt(2.0 / degrees / draws) * 1.2)


@pytest.mark.parametrize(("freedom", "points"), [(4.0, 300), (10.0, 75), (20.0, 75), (50.0, 12), (1e6, 12)])
def test_the_level_of_the_verdict_is_what_it_says(freedom: float, points: int) -> None:
    """Rejections of right models at the level 10⁻³, by Monte Carlo over squares whose variances are estimated."""
    rng, runs, counted = np.random.default_rng(1), 20_000, 0
    for _ in range(10):
        squares = rng.chisquare(2.0, (runs // 10, points)) / (rng.chisquare(freedom, (runs // 10, points)) / freedom)
        counted += sum(chance_of(one, 2 * points) < REJECTION for one in as_chi2(squares, freedom))
    assert counted / runs == pytest.approx(REJECTION, abs=3.0 * np.sqrt(REJECTION / runs))


@pytest.mark.parametrize("single", [False, True])
def test_misfits_of_all_points_and_of_one_are_found(single: bool) -> None:
    """Squares twice as large at 150 points, or a single one of 300, of nine degrees of freedom."""
    rng, freedom = np.random.default_rng(2), np.full(150, 9.0)
    for _ in range(50):
        squares = rng.chisquare(2.0, 150) / (rng.chisquare(9.0, 150) / 9.0)
        if single:
            squares[70] = 300.0
        else:
            squares *= 2.0
        assert chance_of(as_chi2(squares, freedom), 297) < REJECTION


def test_an_open_direction_gets_a_large_variance_and_the_others_keep_theirs() -> None:
    """Two parameters seen only as their sum: their sum's variance stays, each one's is huge."""
    row = np.array([1.0, 1.0, 0.0])
    matrix = np.outer(row, row) * 4.0 + np.diag([0.0, 0.0, 9.0])
    covariance = inverse_normal(matrix)
    assert covariance[0, 0] > 1e6
    assert row @ covariance @ row == pytest.approx(0.25, rel=1e-3)
    assert covariance[2, 2] == pytest.approx(1 / 9, rel=1e-9)


@pytest.mark.parametrize("run", [20, 23, 34, 35])
def test_what_leaks_from_the_ends_of_a_record_is_no_misfit(run):
    """A sharp resonance cut off in the middle of its motion leaks into bands beyond it, prediction and residual alike.

    With 1 % of noise of the reference, which the resonance passes on, one of seven such runs was rejected. That
    noise falls faster than what leaks: weighted by it, little of that is left, and no tone seems to change.
    """
    sines = simulate(
        "piezo", frequencies_hz=[1500.0, 3860.0, 9933.0, 25561.0], sampling_rate_hz=1.2e6, samples=8000, start="steady",
        seed=1,
    )  # fmt: skip
    random = simulate(
        "piezo", "random", frequencies_hz=[900.0, 90e3], sampling_rate_hz=750e3, samples=5000, start="rest", seed=1
    )
    both = replace(sines, records=(*sines.records, *random.records))
    noisy = with_noise(both, reference_noise=0.01, seed=np.random.SeedSequence(1, spawn_key=(run,)))
    result = vibrident.identify(noisy)
    assert result.warning_codes == ()
    assert result.findings == ()
