"""Which model to take: information criteria, cross-validation and the sentence that comes of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import vibrident
from vibrident.data.records import Calibration, ResponseTable
from vibrident.physics.models import parse
from vibrident.physics.simulation import SENSORS
from vibrident.use.model_choice import criteria, recommendation
from vibrident.use.validation import cross_validate

TRUTH = SENSORS["paper"].parameters
FREQUENCY = np.geomspace(20, 1500, 40)


def table(model, values, seed=1, relative=0.002):
    rng = np.random.default_rng(seed)
    h = parse(model).frequency_response(values, FREQUENCY)
    u = relative * np.abs(h)
    noisy = h * (1.0 + relative * (rng.standard_normal(40) + 1j * rng.standard_normal(40)))
    data = ResponseTable(FREQUENCY, np.abs(noisy), np.unwrap(np.angle(noisy)), u, np.full(40, relative))
    return Calibration(table=data)


def results(calibration, *models):
    return {name: vibrident.identify(calibration, name) for name in models}


def test_the_simplest_model_that_explains_the_data_is_taken():
    found = results(table("accelerometer", TRUTH), "accelerometer", "accelerometer+delay", "accelerometer+highpass")
    choice = recommendation(found)
    assert choice.method == "accelerometer"
    assert "BIC" in choice.words or "determine" in choice.words
    # nested models: one more parameter cannot fit worse, and lowers χ² by no more than chance
    chi2 = {name: criteria(result).chi2 for name, result in found.items()}
    for larger in ("accelerometer+delay", "accelerometer+highpass"):
        assert -0.05 < chi2["accelerometer"] - chi2[larger] < 12.0


def test_physics_that_is_there_is_asked_for():
    found = results(table("accelerometer+delay", TRUTH | {"delay": 40e-6}), "accelerometer", "accelerometer+delay")
    choice = recommendation(found)
    assert choice.method == "accelerometer+delay"
    assert "accelerometer does not explain them" in choice.words


def test_where_no_model_explains_the_data_none_is_recommended():
    strange = table(
        "accelerometer+mode2", TRUTH | {"mode2_frequency": 300.0, "mode2_damping": 0.02, "mode2_gain": 0.05}
    )
    choice = recommendation(results(strange, "accelerometer", "accelerometer+delay"))
    assert choice.method is None
    assert "None of these" in choice.words


def test_cross_validation_is_one_for_the_right_model_and_large_for_a_wrong_one():
    calibration = table("accelerometer+delay", TRUTH | {"delay": 40e-6})
    right, wrong = (vibrident.identify(calibration, m) for m in ("accelerometer+delay", "accelerometer"))
    good, bad = cross_validate(calibration, right), cross_validate(calibration, wrong, folds=2)
    assert good is not None
    assert bad is not None
    assert good.folds == 5
    assert good.deviation_in_u == pytest.approx(1.0, abs=0.35)
    assert good.deviation_percent == pytest.approx(100 * 0.002 * np.sqrt(2), rel=0.35)
    assert bad.deviation_in_u > 5.0


def test_cross_validation_of_records_knows_whose_points_they_are():
    calibration = vibrident.simulate(
        "paper", "sine", frequencies_hz=[100.0, 400.0, 550.0, 630.0, 700.0, 1000.0], samples=2000,
        sampling_rate_hz=20_000.0, start="steady", response_noise=0.003, seed=3,
    )  # fmt: skip
    backwards = replace(calibration, records=calibration.records[::-1])
    scores = [cross_validate(c, vibrident.identify(c), folds=3) for c in (calibration, backwards)]
    for score in scores:
        assert score is not None
        assert 0.5 < score.deviation_in_u < 2.5
    few = replace(calibration, records=calibration.records[:3])
    assert cross_validate(few, vibrident.identify(few)) is None
