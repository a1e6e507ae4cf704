"""Calibration by comparison: a reference with a response of its own gives what a laser gives."""

import numpy as np
import pytest
from scipy.special import chdtri
from tests.support.known_channels import (
    POLES,
    RATE_HZ,
    REFERENCE,
    SENSOR,
    Motion,
    accelerometer,
    back_to_back,
    known_reference,
    seismometer,
)

from vibrident import Calibration, InputError, KnownResponse, ResponseTable, identify, predict
from vibrident.data.io import write_calibration

NAMES = ("sensitivity", "natural_frequency", "damping_ratio")
HZ = np.geomspace(30.0, 12000.0, 300)
RELATIVE, TURN = 0.0025, 1e-3
SENSOR_VALUES = np.array(SENSOR)


def stated_by_table(error: np.ndarray | float = 0.0, octaves: float | None = None) -> KnownResponse:
    """A certificate of the reference with U = 0.5 %, whose values are off by a change of log K."""
    value = accelerometer(*REFERENCE)(HZ) * np.exp(error)
    return KnownResponse.from_table(
        HZ,
        np.abs(value),
        np.angle(value),
        magnitude_uncertainty=RELATIVE * np.abs(value),
        phase_uncertainty_rad=np.full(HZ.size, TURN),
        correlation_octaves=octaves,
    )


@pytest.mark.parametrize("kind", ["random", "multisine", "sweep", "shock"])
def test_beside_a_known_reference_the_values_are_those_beside_a_laser(kind):
    laser = identify(back_to_back(kind))
    known = identify(back_to_back(kind, reference_known_response=known_reference(standard_uncertainty=RELATIVE)))
    assert known.warnings == ()
    for name in NAMES:
        u = laser.parameters[name].standard_uncertainty
        assert known.parameters[name].value == pytest.approx(laser.parameters[name].value, abs=u)
    assert known.parameters["sensitivity"].standard_uncertainty == pytest.approx(RELATIVE * SENSOR[0], rel=0.01)
    assert (
        known.parameters["damping_ratio"].standard_uncertainty
        < 2.0 * laser.parameters["damping_ratio"].standard_uncertainty
    )


def test_sines_too():
    rng = np.random.default_rng(4)
    references, responses = [], []
    for hz in np.geomspace(60.0, 7500.0, 9):
        turning = np.exp(2j * np.pi * (hz * np.arange(4000) / RATE_HZ + rng.uniform()))
        values = [complex(accelerometer(*of)(np.array([hz]))[0]) for of in (REFERENCE, SENSOR)]
        signals = [(value * turning).real for value in values]
        references.append(signals[0])
        responses.append(signals[1] + 1e-3 * np.std(signals[1]) * rng.normal(size=4000))
    known = stated_by_table()
    result = identify(Calibration.from_arrays(references, responses, RATE_HZ, reference_known_response=known))
    assert result.warnings == ()
    for name, truth in zip(NAMES, SENSOR, strict=True):
        parameter = result.parameters[name]
        assert parameter.value == pytest.approx(truth, abs=2.0 * parameter.standard_uncertainty)


def test_a_conditioner_and_a_digital_filter_of_the_response_are_taken_out():
    motion = Motion("random", 8192, RATE_HZ, (50.0, 12000.0))
    conditioner = KnownResponse.from_corners([0.5], [30e3], 10.0, corner_uncertainty=0.02)
    chain = conditioner.times(KnownResponse.from_filter(np.hanning(9)[1:-1] / 4.0, rate_hz=RATE_HZ))
    response = motion.channel(accelerometer(*SENSOR), chain.value, noise=1e-3)
    result = identify(
        Calibration.from_arrays(
            [motion.channel()], [response], RATE_HZ, excitation="random", response_known_response=chain
        )
    )
    assert result.warnings == ()
    for name, truth in zip(NAMES, SENSOR, strict=True):
        parameter = result.parameters[name]
        assert parameter.value == pytest.approx(truth, abs=3.0 * parameter.standard_uncertainty)
    budget = {row["source"] for row in result.settings["uncertainty_budget"]}
    assert "conditioner, corner at 0.5 Hz" in budget


@pytest.mark.parametrize("corner", [True, False], ids=["its corner", "flat"])
def test_a_huddle_test_beside_a_broadband(corner):
    motion = Motion("random", 60_000, 100.0, (0.02, 30.0), seed=4)
    sensor, truth = seismometer(30.0, 1.0, 0.6), (30.0, 1.0, 0.6)
    turn = 2.0 * np.pi / 120.0
    poles = np.roots([1.0, 1.414 * turn, turn**2]) if corner else ()
    known = KnownResponse.from_poles(poles, [0.0, 0.0] if corner else (), 1500.0)
    result = identify(
        Calibration.from_arrays(
            [motion.channel(known.value)],
            [motion.channel(sensor, noise=1e-3)],
            100.0,
            quantity="velocity",
            excitation="random",
            model="velocity-pickup",
            reference_known_response=known,
        )
    )
    assert result.warnings == ()
    for name, value in zip(("generator_constant", *NAMES[1:]), truth, strict=True):
        parameter = result.parameters[name]
        assert parameter.value == pytest.approx(value, abs=2.0 * parameter.standard_uncertainty)


def test_a_result_is_the_reference_of_the_next_with_its_covariance(tmp_path):
    motion = Motion("random", 8192, RATE_HZ, (50.0, 12000.0))
    laser = Calibration.from_arrays(
        [motion.channel()],
        [motion.channel(accelerometer(*REFERENCE), noise=0.03)],
        RATE_HZ,
        excitation="random",
        reference_standard_uncertainty=RELATIVE,
    )
    first = identify(laser)
    first.save(tmp_path / "result.json")
    known = KnownResponse.from_result(tmp_path / "result.json")
    np.testing.assert_allclose(known.value(HZ), first.to_sensor().frequency_response(HZ), rtol=1e-10)
    sizes = np.sqrt(np.diag(known.covariance(HZ)))
    np.testing.assert_allclose(sizes, np.concatenate(first.to_sensor().uncertainty(HZ)), rtol=0.02, atol=1e-7)
    second = identify(back_to_back(reference_known_response=known))
    for name, truth in zip(NAMES, SENSOR, strict=True):
        parameter = second.parameters[name]
        assert parameter.value == pytest.approx(truth, abs=3.0 * parameter.standard_uncertainty)
    assert second.parameters["sensitivity"].standard_uncertainty >= RELATIVE * SENSOR[0]


@pytest.mark.draws(16, 400)
def test_an_error_of_the_reference_over_frequency_is_in_the_covariance(draws):
    """χ² over draws of the reference's true response, whose errors are alike over four octaves."""
    rng = np.random.default_rng(7)
    hz = np.geomspace(60.0, 8000.0, 16)
    distance = np.log2(np.divide.outer(hz, hz)) / 4.0
    root = np.linalg.cholesky(np.exp(-0.5 * distance**2) + 1e-9 * np.eye(hz.size))
    known = stated_by_table(octaves=4.0)
    noise = np.full(hz.size, 1e-4)
    squares = 0.0
    for _ in range(draws):
        real, imaginary = root @ rng.normal(size=(hz.size, 2)).T.reshape(2, hz.size, 1)
        error = RELATIVE * real[:, 0] + 1j * TURN * imaginary[:, 0]
        ratio = accelerometer(*SENSOR)(hz) / (accelerometer(*REFERENCE)(hz) * np.exp(error))
        ratio *= 1.0 + noise * (rng.normal(size=hz.size) + 1j * rng.normal(size=hz.size))
        table = ResponseTable(hz, np.abs(ratio), np.angle(ratio), noise * np.abs(ratio), noise)
        sensor = identify(Calibration(table=table, reference_known_response=known)).to_sensor()
        scale = np.sqrt(np.diag(sensor.covariance))
        off = np.array([sensor.values[name] for name in sensor.model.parameter_names]) - SENSOR_VALUES
        squares += off / scale @ np.linalg.solve(sensor.covariance / np.outer(scale, scale), off / scale)
    assert chdtri(3 * draws, 0.999) < squares < chdtri(3 * draws, 0.001)


@pytest.mark.slow
def test_coverage_over_500_draws_of_the_reference():
    """Back to back, U of 0.5 % and a resonance of the reference in the band: 95 ± 2 %."""
    rng = np.random.default_rng(11)
    inside = []
    known = stated_by_table()
    for seed in range(500):
        motion = Motion("random", 4096, RATE_HZ, (100.0, 12000.0), seed)
        error = complex(RELATIVE * rng.normal(), TURN * rng.normal())
        drawn = accelerometer(*REFERENCE)

        def reference(hz: np.ndarray, drawn=drawn, error=error) -> np.ndarray:
            return drawn(hz) * np.exp(error)

        result = identify(
            Calibration.from_arrays(
                [motion.channel(reference)],
                [motion.channel(accelerometer(*SENSOR), noise=1e-3)],
                RATE_HZ,
                excitation="random",
                reference_known_response=known,
            )
        )
        pairs = zip(NAMES, SENSOR, strict=True)
        intervals = [(result.parameters[name].interval_95, truth) for name, truth in pairs]
        inside.append([low <= truth <= high for (low, high), truth in intervals])
    coverage = np.mean(inside, axis=0)
    np.testing.assert_allclose(coverage, 0.95, atol=0.02)


def test_a_prediction_takes_it_out_and_what_does_not_refuses_by_name(tmp_path):
    result = identify(back_to_back())
    known = back_to_back(seed=2, reference_known_response=known_reference())
    predicted = predict(result, known)
    assert predicted.rmse is not None
    assert predicted.rmse < 2e-3 * np.std(known.records[0].response)
    with pytest.raises(InputError, match="A written calibration takes no known response"):
        write_calibration(tmp_path, known)


def test_its_files_and_band_are_in_the_result():
    result = identify(back_to_back(reference_known_response=stated_by_table()))
    (row,) = result.settings["known_responses"]
    assert row["channel"] == "reference"
    assert row["band_hz"] == pytest.approx([30.0, 12000.0])
    assert result.uncertainty["covers"] == ["noise", "gain", "phase"]
    assert len(POLES) == 2
