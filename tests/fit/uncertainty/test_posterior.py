"""The sampled posterior: u where the problem is nearly linear, a brute-force integral where it is not."""

from __future__ import annotations

import importlib
import sys

import numpy as np
import pytest

import vibrident
from vibrident.data.records import Calibration, ResponseTable
from vibrident.fit.estimators import MaximumLikelihood
from vibrident.fit.problem import Evidence
from vibrident.fit.problem.coordinates import BAND_MARGIN, MARGIN_BELOW
from vibrident.fit.uncertainty.linearised import Linearised
from vibrident.fit.uncertainty.posterior import Sampling, ended_by_prior, likelihood, log_density
from vibrident.physics.models import parse
from vibrident.physics.simulation import SENSORS, simulate

TRUTH = dict(SENSORS["paper"].parameters)
QUICK = Sampling(chains=16, warm_up=200, draws=1500)
MODEL = parse("accelerometer")


def table(parameters, frequency, relative, model="accelerometer", seed=3):
    """A response with a relative standard uncertainty, and noise of that size."""
    rng = np.random.default_rng(seed)
    clean = parse(model).frequency_response(parameters, frequency)
    noise = rng.standard_normal(len(frequency)) + 1j * rng.standard_normal(len(frequency))
    measured = clean * (1.0 + relative * noise)
    u = relative * np.abs(clean), np.full(len(frequency), relative)
    return Calibration(table=ResponseTable(frequency, np.abs(measured), np.angle(measured), *u), model=model)


def test_the_density_is_that_of_the_stated_uncertainties_times_the_priors(rng):
    """−χ²/2 of magnitudes and phases in NumPy, at points around the estimate; nothing outside the range."""
    data, scale = table(TRUTH, np.geomspace(20, 1500, 10), 0.1), 1.3
    evidence = Evidence.gather(data, MODEL)
    estimate = MaximumLikelihood().fit(evidence)
    coordinates = estimate.coordinates
    linear = Linearised.from_table(coordinates, estimate.z, evidence.first_look)
    low, high = np.full(3, -3.0), np.full(3, 3.0)
    density = log_density(*likelihood(evidence, estimate, linear), scale, low, high)
    assert density(np.array([0.9, 4.0, 0.2])) == -np.inf

    def expected(z):
        values, row = coordinates.values(z), data.table
        h = MODEL.frequency_response(values, row.frequency_hz)
        chi2 = np.sum(((np.abs(h) - row.magnitude) / row.magnitude_uncertainty) ** 2)
        chi2 += np.sum((np.angle(np.exp(1j * row.phase_rad) / h) / row.phase_uncertainty_rad) ** 2)
        return -0.5 * chi2 / scale**2

    points = np.asarray(estimate.z) + 0.05 * rng.standard_normal((4, 3))
    found, known = ([of(z) for z in (np.asarray(estimate.z), *points)] for of in (density, expected))
    assert np.diff(found) == pytest.approx(np.diff(known), rel=1e-9)


def test_what_the_range_and_not_the_data_ends_is_named():
    """One draw in fifty near an end is enough; none, or one in five hundred, is not."""
    low, high = np.array([0.0, 0.0, -np.inf]), np.array([1.0, 1.0, np.inf])
    z = np.full((2, 500, 3), 0.5)
    z[0, :20, 0], z[0, 0, 1], z[1, 0, 1] = 0.99, 0.01, 0.01
    assert ended_by_prior(z, low, high, ("first", "second", "third")) == ["first"]


@pytest.mark.slow
def test_where_the_problem_is_nearly_linear_it_is_the_stated_uncertainty():
    """Mean and standard deviation within four of their Monte Carlo errors; u/10 for what is not linear."""
    result = vibrident.identify(table(TRUTH, np.geomspace(20, 1500, 30), 0.002), posterior=QUICK)
    posterior = result.settings["posterior"]
    assert posterior["converged"]
    assert posterior["ends_by_prior"] == []
    assert set(posterior["parameters"]) == set(result.parameters)
    for name, row in posterior["parameters"].items():
        stated, draws = result.parameters[name], row["effective_sample_size"]
        assert row["mean"] == pytest.approx(
            stated.value, abs=(4.0 / np.sqrt(draws) + 0.1) * stated.standard_uncertainty
        )
        assert row["standard_deviation"] == pytest.approx(
            stated.standard_uncertainty, rel=4.0 / np.sqrt(2 * draws) + 0.02
        )


@pytest.mark.parametrize("excitation", ["random", "shock"])
@pytest.mark.quick("random")
def test_of_every_motion_it_is_the_stated_uncertainty(excitation):
    """Of a nearly linear problem: sd/u within four of its Monte Carlo errors, and 3 % for what is not linear."""
    records = simulate("paper", excitation, samples=2000, response_noise=0.003, seed=1)
    result = vibrident.identify(records, posterior=QUICK)
    posterior, ratios = result.settings["posterior"], []
    assert result.estimator == "ipnn"
    assert posterior["converged"]
    for name in TRUTH:
        stated, row = result.parameters[name], posterior["parameters"][name]
        assert row["mean"] == pytest.approx(stated.value, abs=0.2 * stated.standard_uncertainty)
        ratios.append(row["standard_deviation"] / stated.standard_uncertainty)
        error = 4.0 / np.sqrt(2.0 * row["effective_sample_size"])
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.0, abs=error + 0.03)


def test_chains_shorter_than_fifty_autocorrelation_times_are_said():
    short = Sampling(chains=8, warm_up=5, draws=20)
    result = vibrident.identify(table(TRUTH, np.geomspace(20, 1500, 30), 0.002), posterior=short)
    assert not result.settings["posterior"]["converged"]


@pytest.mark.slow
def test_of_records_too():
    """Student's t for noise that was estimated: u within what 1 + 4/ν, which it carries, may differ from that."""
    tones = [100.0, 250.0, 400.0, 550.0, 630.0, 700.0, 850.0, 1000.0]
    records = simulate("paper", "sine", frequencies_hz=tones, samples=2000, response_noise=0.01, seed=1)
    result = vibrident.identify(records, posterior=QUICK)
    posterior = result.settings["posterior"]
    assert posterior["converged"]
    for name in TRUTH:
        stated, row = result.parameters[name], posterior["parameters"][name]
        assert row["mean"] == pytest.approx(stated.value, abs=0.2 * stated.standard_uncertainty)
        assert row["standard_deviation"] == pytest.approx(stated.standard_uncertainty, rel=0.15)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_numbers():
    short = Sampling(chains=8, warm_up=20, draws=20, seed=4)
    data = table(TRUTH, np.geomspace(20, 1500, 30), 0.002)
    one, other = (vibrident.identify(data, posterior=short).settings["posterior"] for _ in range(2))
    assert one == other


def integrated(calibration, low_hz, high_hz):
    """Quantiles of the natural frequency by a sum over a grid: flat in its logarithm, asinh of damping, gain flat.

    In the magnitudes the gain is linear and its integral a Gaussian's: exp(−χ²/2)/√(Σ h²/u²) at the best gain.
    """
    data = calibration.table
    fn = np.geomspace(low_hz, high_hz, 400)[:, None, None]
    slope = np.linspace(0.0, 1e-4, 401)[None, :, None]  # δ/fn, which the phase shows
    damping, x = slope * fn, data.frequency_hz / fn
    h = 1.0 / (1.0 - x**2 + 2j * damping * x)
    weight = 1.0 / data.magnitude_uncertainty**2
    best = np.sum(weight * np.abs(h) * data.magnitude, axis=-1) / np.sum(weight * np.abs(h) ** 2, axis=-1)
    chi2 = np.sum(weight * (data.magnitude - best[..., None] * np.abs(h)) ** 2, axis=-1)
    chi2 += np.sum((np.angle(np.exp(1j * data.phase_rad) / h) / data.phase_uncertainty_rad) ** 2, axis=-1)
    density = np.exp(-0.5 * (chi2 - chi2.min())) / np.sqrt(np.sum(weight * np.abs(h) ** 2, axis=-1))
    density *= (fn / np.sqrt(1.0 + damping**2))[..., 0]  # dδ = fn d(δ/fn)
    share = np.cumsum(np.sum(density, axis=1))
    return np.interp([0.025, 0.975], share / share[-1], fn[:, 0, 0])


@pytest.mark.slow
def test_a_resonance_far_above_the_band_is_bounded_from_below_alone():
    """Seven times above the highest tone: the linearised interval ends, the distribution does not."""
    sensor = {"sensitivity": 0.1, "natural_frequency": 3000.0, "damping_ratio": 0.05}
    calibration = table(sensor, np.geomspace(10, 400, 16), 0.01)
    result = vibrident.identify(calibration, posterior=Sampling(chains=16, warm_up=1000, draws=3000))
    posterior, stated = result.settings["posterior"], result.parameters["natural_frequency"]
    row = posterior["parameters"]["natural_frequency"]
    assert posterior["converged"]
    assert posterior["ends_by_prior"] == ["natural_frequency"]
    low, high = row["interval_95"]
    assert high > 3.0 * stated.interval_95[1]
    assert low > stated.interval_95[0]
    expected = integrated(calibration, 400.0 / 4.0, 400.0 * BAND_MARGIN)
    assert MARGIN_BELOW > 1e3  # below the grid's lower end the likelihood is nothing
    assert np.log([low, high]) == pytest.approx(np.log(expected), abs=0.15)


@pytest.mark.slow
def test_a_delay_that_trades_with_damping_has_the_tails_of_a_curved_ridge():
    """Below resonance the phase shows τ + 2 δ/ωn; δ ≥ 0 cuts the ridge off, which a symmetric interval cannot say."""
    sensor = {"sensitivity": 0.1, "natural_frequency": 1500.0, "damping_ratio": 0.03, "delay": 4e-5}
    calibration = table(sensor, np.geomspace(20, 700, 20), 0.01, "accelerometer+delay", seed=5)
    result = vibrident.identify(calibration, posterior=Sampling(chains=16, warm_up=1000, draws=3000))
    stated, row = result.parameters["delay"], result.settings["posterior"]["parameters"]["delay"]
    damping = result.settings["posterior"]["parameters"]["damping_ratio"]
    assert result.settings["posterior"]["converged"]
    assert damping["interval_95"][0] > 0.0
    middle = row["mean"]
    down, up = middle - row["interval_95"][0], row["interval_95"][1] - middle
    assert down > 1.2 * up  # δ may grow without end, and the delay then shrinks; δ cannot shrink below zero
    symmetric = (stated.interval_95[0] + stated.interval_95[1]) / 2.0
    assert symmetric == pytest.approx(stated.value, rel=1e-6)


def test_a_model_without_transfer_function_has_no_such_likelihood():
    pytest.importorskip("jax")
    made = simulate("cubic", "random", samples=400, response_noise=0.01)
    with pytest.raises(vibrident.InputError, match="responses in frequency"):
        vibrident.identify(made, posterior=QUICK)


def test_a_missing_library_names_the_line_that_installs_it(monkeypatch):
    known = importlib.import_module

    def missing(name, *rest, **more):
        if name.partition(".")[0] == "emcee":
            raise ImportError("No module named 'emcee'")
        return known(name, *rest, **more)

    for name in [n for n in sys.modules if n.partition(".")[0] == "emcee"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr("importlib.import_module", missing)
    with pytest.raises(vibrident.InputError, match=r"vibrident\[bayes\]"):
        vibrident.identify(table(TRUTH, np.geomspace(20, 1500, 30), 0.002), posterior=QUICK)
