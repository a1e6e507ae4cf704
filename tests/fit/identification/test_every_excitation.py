"""The main path on simulated calibrations: every excitation, every named sensor, and the laws that must hold."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

import vibrident
from vibrident import Ipnn
from vibrident.physics.simulation import SENSORS, ChannelNoise, one_third_octave, simulate
from vibrident.result import Result

PAPER = dict(SENSORS["paper"].parameters)
#: Where the law does not depend on how many tones there are.
FEW_HZ = 10.0 ** (np.arange(10, 31, 4) / 10)
EXCITATIONS = ("sine", "multisine", "sweep", "random", "shock")


def deviations(result: Result, truth: dict[str, float]) -> dict[str, float]:
    """(identified − true)/u of every parameter."""
    found = result.parameters
    return {k: (found[k].value - v) / (found[k].standard_uncertainty or np.nan) for k, v in truth.items()}


def errors(result: Result, truth: dict[str, float]) -> dict[str, float]:
    """Relative errors."""
    return {k: abs(result.parameters[k].value / v - 1.0) for k, v in truth.items()}


@pytest.mark.parametrize(
    ("sensor", "excitation"),
    [
        *itertools.product(("paper", "seismometer"), EXCITATIONS),
        *itertools.product(("piezo", "geophone"), ("sine", "random")),
        *(
            pytest.param(*each, marks=pytest.mark.slow)
            for each in itertools.product(("piezo", "geophone"), ("multisine", "sweep", "shock"))
        ),
        *(("inverted", excitation) for excitation in ("sine", "random")),
    ],
)
def test_the_truth_lies_within_its_uncertainty(sensor: str, excitation: str) -> None:
    tones = one_third_octave(*SENSORS[sensor].band_hz)[::2] if excitation == "sine" else None
    made = simulate(sensor, excitation, frequencies_hz=tones, response_noise=0.01, samples=8000, seed=3)
    result = vibrident.identify(made)
    truth = SENSORS[sensor].parameters
    assert max(abs(z) for z in deviations(result, truth).values()) < 4.0
    expected = {"polarity"} if sensor == "inverted" else set()
    # Half the usual samples: the lowest tones then hold less than two periods.
    assert set(result.warning_codes) - {"short_record"} == expected
    assert result.fit.adequate


@pytest.mark.parametrize("estimator", ["ml", "ipnn"])
@pytest.mark.parametrize("rate", [2560.0, 16000.0, 51200.0])
@pytest.mark.quick("2560.0-ml", "51200.0-ipnn")
def test_without_channel_noise_the_parameters_are_exact(rate: float, estimator: str) -> None:
    """The paper's excitation, 20 dB of felt noise included: relative error at most 1e-6 at any sampling rate."""
    more = {"sampling_rate_hz": rate, "excitation_snr_db": 20.0, "samples": 8000, "seed": 2}
    calibration = simulate("paper", "sine", frequencies_hz=FEW_HZ, **more)
    result = vibrident.identify(calibration, estimator=estimator)
    assert max(errors(result, PAPER).values()) < 1e-6
    assert set(result.warning_codes) <= {"short_record"}


def test_without_channel_noise_at_one_megahertz() -> None:
    frequencies = 10.0 ** (np.arange(24, 31) / 10)  # those of which 16 000 samples hold two periods or more
    calibration = simulate(
        "paper", "sine", frequencies_hz=frequencies, sampling_rate_hz=1e6, excitation_snr_db=20.0, seed=2
    )
    result = vibrident.identify(calibration, estimator="ipnn")
    assert max(errors(result, PAPER).values()) < 1e-6


def test_euler_costs_what_the_project_found() -> None:
    """Fitted to the output alone at 51.2 kHz, it is about −1 % off in f0 and +21 % in δ."""
    calibration = simulate(
        "paper",
        "sine",
        frequencies_hz=10.0 ** (np.arange(12, 31, 3) / 10),
        excitation_snr_db=20.0,
        samples=8000,
        seed=2,
    )
    result = vibrident.identify(calibration, estimator=Ipnn(discretisation="euler"))
    found = errors(result, PAPER)
    assert 0.003 < found["natural_frequency"] < 0.02
    assert 0.05 < found["damping_ratio"] < 0.3
    assert "lack_of_fit" in result.warning_codes


@pytest.mark.parametrize("quantity", ["velocity", "displacement"])
@pytest.mark.parametrize("estimator", ["ml", "ipnn"])
@pytest.mark.parametrize("sensor", ["paper", "geophone"])
@pytest.mark.quick("paper-ml-velocity", "paper-ipnn-displacement", "geophone-ml-displacement")
def test_reference_in_velocity_or_displacement(sensor: str, estimator: str, quantity: str) -> None:
    tones = one_third_octave(*SENSORS[sensor].band_hz)[::3]
    more = {"response_noise": 0.01, "start": "steady", "samples": 8000, "seed": 4}
    calibration = simulate(sensor, "sine", frequencies_hz=tones, quantity=quantity, **more)
    result = vibrident.identify(calibration, estimator=estimator)
    assert max(abs(z) for z in deviations(result, dict(SENSORS[sensor].parameters)).values()) < 4.0


@pytest.mark.parametrize("excitation", ["sine", "random", "shock"])
@pytest.mark.parametrize("delay", [3.7e-5, -2e-4, 2.3e-3])
@pytest.mark.quick("3.7e-05-sine", "-0.0002-random", "0.0023-shock", "-0.0002-shock")
def test_delay_of_either_sign(delay: float, excitation: str) -> None:
    truth = {**PAPER, "delay": delay}
    calibration = simulate(
        ("accelerometer+delay", truth),
        excitation,
        frequencies_hz=10.0 ** (np.arange(10, 31, 2) / 10),
        sampling_rate_hz=51200.0,
        amplitude=9.8,
        samples=8000,
        response_noise=0.01,
        seed=5,
    )
    result = vibrident.identify(calibration, model="accelerometer+delay")
    assert max(abs(z) for z in deviations(result, truth).values()) < 4.0


@pytest.mark.parametrize("damping", [0.72, 1.0, 2.5])
def test_heavy_damping_is_normal(damping: float) -> None:
    truth = {**PAPER, "damping_ratio": damping}
    calibration = simulate(
        ("accelerometer", truth),
        "sine",
        frequencies_hz=10.0 ** (np.arange(10, 37, 4) / 10),
        sampling_rate_hz=51200.0,
        amplitude=9.8,
        samples=8000,
        response_noise=0.01,
        seed=5,
    )
    result = vibrident.identify(calibration)
    assert max(abs(z) for z in deviations(result, truth).values()) < 4.0
    assert "resonance_frequency" not in result.parameters


def test_records_of_different_kind_length_and_rate_in_one_fit() -> None:
    tones = simulate("paper", "sine", frequencies_hz=[20, 80, 315], samples=8000, response_noise=0.01, seed=6)
    random = simulate("paper", "random", sampling_rate_hz=20000.0, samples=5000, response_noise=0.02, seed=7)
    shock = simulate("paper", "shock", response_noise=0.01, seed=8)
    mixed = dataclasses.replace(tones, records=tones.records + random.records + shock.records)
    result = vibrident.identify(mixed)
    assert result.estimator == "ipnn"
    assert "random, shock, sine" in result.settings["estimator_choice"]
    assert max(abs(z) for z in deviations(result, PAPER).values()) < 4.0
    assert result.warnings == ()


def test_offset_and_start_in_mid_motion_do_no_harm() -> None:
    noise = ChannelNoise(white=0.01, offset=3.0)
    tones = one_third_octave(*SENSORS["seismometer"].band_hz)[::3]
    more = {"start": "rest", "response_noise": noise, "samples": 4000, "seed": 9}
    calibration = simulate("seismometer", "sine", frequencies_hz=tones, **more)
    result = vibrident.identify(calibration, estimator="ipnn")
    assert max(abs(z) for z in deviations(result, dict(SENSORS["seismometer"].parameters)).values()) < 4.0


def test_what_the_data_leave_open_is_not_given_as_certain() -> None:
    """One tone says two numbers; the model has three parameters."""
    result = vibrident.identify(simulate("paper", "sine", frequencies_hz=[160.0], response_noise=0.01))
    assert "weakly_determined" in result.warning_codes
    for name in PAPER:
        parameter = result.parameters[name]
        assert not parameter.identifiable
        assert (parameter.standard_uncertainty or 0.0) > abs(parameter.value)


def test_short_records_keep_their_noise_level() -> None:
    calibration = simulate(
        "paper", "sine", frequencies_hz=[160.0, 400, 800], samples=120, sampling_rate_hz=8000.0, response_noise=1e-3
    )
    for estimator in ("ml", "ipnn"):
        result = vibrident.identify(calibration, estimator=estimator)
        assert max(abs(z) for z in deviations(result, PAPER).values()) < 4.0
        assert result.fit.adequate


@pytest.mark.parametrize(
    ("model", "more"),
    [
        ("accelerometer+highpass", {"highpass_frequency": 3.0}),
        ("accelerometer+mode2", {"mode2_frequency": 300.0, "mode2_damping": 0.02, "mode2_gain": 0.01}),
    ],
)
@pytest.mark.parametrize("estimator", ["ml", "ipnn"])
@pytest.mark.quick("ml-accelerometer+mode2-more1", "ipnn-accelerometer+highpass-more0")
def test_add_ons_are_found_and_missed_when_left_out(model: str, more: dict[str, float], estimator: str) -> None:
    truth = {**PAPER, **more}
    calibration = simulate(
        (model, truth),
        "sine",
        frequencies_hz=10.0 ** (np.arange(11, 31, 3) / 10),
        sampling_rate_hz=51200.0,
        amplitude=9.8,
        samples=4000,
        response_noise=0.01,
        seed=1,
    )
    result = vibrident.identify(calibration, model=model, estimator=estimator)
    assert max(abs(z) for z in deviations(result, truth).values()) < 4.0
    assert result.fit.adequate
    plain = vibrident.identify(calibration, model="accelerometer", estimator=estimator)
    assert not plain.fit.adequate
    assert "lack_of_fit" in plain.warning_codes
