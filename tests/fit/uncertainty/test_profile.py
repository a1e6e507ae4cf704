"""Intervals where a parameter is at its bound, or χ² is flat or skew: they cover the truth as they say."""

from __future__ import annotations

import numpy as np
import pytest
from bench.adversary.cases import BY_NAME
from bench.adversary.judge import judged

import vibrident
from vibrident.data.records import Calibration, ResponseTable
from vibrident.fit.problem import Coordinates, FrequencyProblem
from vibrident.fit.uncertainty.parameters import deviations, fields_of_units, parameter_table
from vibrident.fit.uncertainty.profile import Profile, needs_profile, profile_of, with_profile
from vibrident.physics.models import parse

MODEL = parse("accelerometer")


def table_of(rng, phase: bool, above: float, damping: float, noise: float, points: int = 25):
    """A right table up to a frequency that the resonance is so many times above of, in its stated noise."""
    frequency = np.geomspace(20.0, 5000.0, points)
    truth = {"sensitivity": 0.1, "natural_frequency": above * 5000.0, "damping_ratio": damping}
    h = MODEL.frequency_response(truth, frequency)
    size = np.abs(h) * (1.0 + noise * rng.standard_normal(points))
    turn = np.angle(h) + noise * rng.standard_normal(points) if phase else None
    turn_u = np.full(points, noise) if phase else None
    return truth, Calibration(table=ResponseTable(frequency, size, turn, noise * np.abs(h), turn_u))


def fitted_table(rng):
    """Coordinates, problem and optimum of a well-determined table."""
    truth, calibration = table_of(rng, True, 0.6, 0.1, 1e-4)
    coordinates = Coordinates.at(MODEL, truth, (20.0, 5000.0))
    problem = FrequencyProblem.of_table(calibration.table, MODEL, "acceleration")
    z = coordinates.first
    for _ in range(5):
        local = problem.normal(z, coordinates)
        z = z + np.linalg.solve(local.matrix, local.gradient)
    return coordinates, problem, z


def covers(parameter, value: float) -> bool:
    low, high = parameter.interval_95
    return (low is None or low <= value) and (high is None or value <= high)


@pytest.mark.parametrize(("half_width", "is_weak"), [(1e-3, False), (0.05, True)])
def test_a_skew_interval_is_a_warning_where_it_is_wide(half_width, is_weak):
    """An interval of 0.05 % was called hardly determined, nine of thirty false alarms of 876 clean cases."""
    values = {"sensitivity": 0.1, "natural_frequency": 1e4, "damping_ratio": 0.1}
    coordinates = Coordinates.at(MODEL, values, (20.0, 5000.0))
    z = coordinates.place(values)
    narrow = np.diag((1e-5 * z) ** 2)
    table = parameter_table(coordinates, z, narrow, np.inf, fields_of_units("V", "m/s^2", drive=False), {})
    ends = np.tile(z, (3, 2, 1))
    ends[0, :, 0] = z[0] * np.array([1.0 - 0.1 * half_width, 1.0 + half_width])
    stated, sentences = with_profile(table, Profile(z, ends), coordinates, np.zeros((3, 3)), 1.96)
    assert list(sentences) == (["sensitivity"] if is_weak else [])
    assert stated["sensitivity"].interval_95 == pytest.approx((0.1 - 0.01 * half_width, 0.1 + 0.1 * half_width))


@pytest.mark.parametrize("phase", [False, True])
@pytest.mark.draws(16, 200)
def test_intervals_cover_the_truth_with_damping_near_its_bound_and_a_band_far_below_resonance(phase, draws):
    """Of magnitudes alone 57 % of the intervals of damping and 83 % of those of fn did: 16.13 ± 0.20 kHz for 13.76."""
    rng, inside = np.random.default_rng([7, phase]), []
    for _ in range(draws):
        about = rng.uniform(1.2, 6.0), 10.0 ** rng.uniform(-2.5, -0.1), 10.0 ** rng.uniform(-3.3, -1.8)
        truth, calibration = table_of(rng, phase, *about)
        result = vibrident.identify(calibration)
        inside.append([covers(result.parameters[name], value) for name, value in truth.items()])
        for name, value in truth.items():
            if not covers(result.parameters[name], value):
                continue
            u = result.parameters[name].standard_uncertainty
            assert u is None or abs(result.parameters[name].value - value) < 4.0 * u
    assert np.all(np.mean(inside, axis=0) > 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / draws))


def test_a_parabola_has_the_ends_of_its_covariance(rng):
    """A well-determined sensor needs no profile, and would have the same ends."""
    coordinates, problem, z = fitted_table(rng)
    covariance = np.linalg.inv(problem.normal(z, coordinates).matrix)
    assert not needs_profile(coordinates, z, covariance)
    profile = profile_of(problem, coordinates, z, covariance, 4.0)
    for k, u in enumerate(deviations(covariance)):
        np.testing.assert_allclose(profile.ends[k, :, k] - z[k], [-2.0 * u, 2.0 * u], rtol=0.05)


def test_what_the_profile_widens_is_said():
    """Magnitudes far below a damped resonance: damping may be zero, and fn is told with its interval."""
    _, calibration = table_of(np.random.default_rng(2), False, 3.0, 0.4, 2e-3)
    result = vibrident.identify(calibration)
    said = [w.message for w in result.warnings if w.code == "weakly_determined"]
    (natural,) = [text for text in said if "determine the natural frequency" in text]
    assert "profile likelihood" in natural


def test_a_variance_larger_than_the_curvature_of_chi2_moves_the_ends_as_far(rng):
    """Points do not know of free motion, nor V of noise of the reference: the covariance does."""
    coordinates, problem, z = fitted_table(rng)
    covariance = 9.0 * np.linalg.inv(problem.normal(z, coordinates).matrix)
    ends = profile_of(problem, coordinates, z, covariance, 1.96**2).ends
    for k in range(3):
        half_widths = np.abs(ends[k, :, k] - z[k])
        np.testing.assert_allclose(half_widths, 1.96 * np.sqrt(covariance[k, k]), rtol=0.06)


def test_the_interval_of_a_far_sensor_goes_along_its_valley():
    """A shock that runs when the record begins: fn 13 times the band trades against the delay, and ζ follows.

    By the points alone, which do not know of the free motion, ζ was 0.719(8) for 0.434, and fn 1.9(9) kHz for 26.5.
    """
    assert judged(BY_NAME["quantities/velocity/accelerometer+delay/shock running"].trial(93))["class"] == "right"
