"""Other solutions that fit as well: those along a curved valley, beyond the standard uncertainties at the estimate."""

import numpy as np
import pytest
from bench.adversary.cases import BY_NAME

from vibrident import identify
from vibrident.fit.information import inverse_normal
from vibrident.fit.start.search import LogCoordinates, TargetFRF, descend, differences, information_at
from vibrident.fit.uncertainty.alternatives import Solution, other_solutions
from vibrident.physics.models import parse
from vibrident.physics.models.labels import canonical

MODEL = parse("accelerometer+mode2")
UNITS = {spec.name: spec.unit for spec in MODEL.parameters}
FREQUENCY_HZ = np.geomspace(10.0, 400.0, 240)
SMALL = {"mode2_damping": 0.034, "mode2_gain": 0.01}
#: Both modes above the band, the second of hardly any size.
ABOVE = {"sensitivity": 16.0, "natural_frequency": 1275.0, "damping_ratio": 0.07, "mode2_frequency": 597.0, **SMALL}
#: Both within the band.
WITHIN = {**ABOVE, "natural_frequency": 250.0, "mode2_frequency": 350.0, "mode2_gain": 0.05}


def named(truth, deviation, seed):
    """Messages on the points of a sensor fitted at its optimum, with the uncertainties that hold there."""
    rng = np.random.default_rng(seed)
    response = MODEL.frequency_response(truth, FREQUENCY_HZ)
    noise = deviation * (rng.standard_normal((2, response.size)).T @ [1.0, 1.0j])
    deviations = np.full(response.size, deviation)
    sought = TargetFRF(FREQUENCY_HZ, response * (1.0 + noise), deviations, deviations, has_phase=True, polar=False)
    chart = LogCoordinates(MODEL, "acceleration", FREQUENCY_HZ, 1.0 / (800.0 * np.pi))
    u, sign = chart.place(truth)
    found = descend(chart, u[None], np.array([sign]), differences(sought), 60)
    spread = np.sqrt(np.diag(inverse_normal(information_at(chart, found.u, found.sign, differences(sought))[0])))
    values = canonical(MODEL, chart.named(found.u, found.sign, 0))
    own = {n: abs(values[n]) * s for n, s in zip(values, spread, strict=True)} | {"mode2_gain": float(spread[5])}
    return [w.message for w in other_solutions(MODEL, "acceleration", sought, Solution(values, own), None, UNITS)]


@pytest.mark.parametrize("seed", range(3))
def test_a_valley_that_leads_further_than_the_uncertainties_say_is_named(seed):
    """Two modes above the band: in 2 of 40 runs the truth lies beyond 4 u."""
    assert any("Another solution" in text for text in named(ABOVE, 1e-4, seed))


def test_no_other_solution_is_named_where_the_data_choose():
    """Modes within the band at any noise, and above it where the noise is small."""
    assert not [text for seed in range(4) for text in named(WITHIN, 3e-3, seed)]
    assert not [text for seed in range(4) for text in named(ABOVE, 1e-5, seed)]


@pytest.mark.parametrize("case", ["10 points, no u, no phase", "100 points, u, no phase"])
def test_what_is_hardly_determined_takes_others_with_it(case):
    """Magnitudes under an average over time show hardly anything of a resonance far above the band: its damping ratio,
    well determined where the fit ends, is far from the truth, which its interval holds."""
    trial = BY_NAME[f"table/far-light+boxcar/{case}"].trial(16)
    result = identify(trial.calibration(), trial.model)
    damping, said = result.parameters["damping_ratio"], [w.message for w in result.warnings]
    low, high = damping.interval_95
    assert (low or 0.0) <= trial.truth["damping_ratio"] <= (high or np.inf)
    assert any("determine the damping ratio" in text for text in said)


def test_the_start_of_few_points_is_their_likeliest():
    """Of three points no average, and a resonance in the band, was taken: 3,606 u off, at twice the χ²."""
    trial = BY_NAME["table/far-light+boxcar/3 points, u, phase"].trial(116)
    length = identify(trial.calibration(), trial.model).parameters["boxcar_length"]
    assert abs(length.value - trial.truth["boxcar_length"]) < 3.0 * length.standard_uncertainty


def test_a_sum_of_two_sensitivities_far_below_both_modes_is_not_one_of_them():
    """A mode of 2.5 Hz that hardly shows was stated as the sensor's, its sensitivity 585 u off."""
    trial = BY_NAME["quantities/acceleration/accelerometer+mode2=0.1/shock"].trial(141)
    result = identify(trial.calibration(), model=trial.model)
    (message,) = [w.message for w in result.warnings if w.message.startswith("Another solution")]
    assert "sensitivity" in message
