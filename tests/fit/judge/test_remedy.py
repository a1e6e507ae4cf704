"""A model that does not explain the data: the one that does is named, and what its misfit looks like is not said."""

from __future__ import annotations

import numpy as np
import pytest

import vibrident
from vibrident.physics.models import parse
from vibrident.physics.simulation import simulate

ACCELEROMETER = {"sensitivity": 0.01, "natural_frequency": 4000.0, "damping_ratio": 0.05}
PICKUP = {"generator_constant": 28.8, "natural_frequency": 400.0, "damping_ratio": 0.4}
SECOND = {"mode2_frequency": 7000.0, "mode2_damping": 0.03, "mode2_gain": 0.1}
SINES = {"frequencies_hz": np.geomspace(100.0, 9000.0, 10), "samples": 1500, "start": "steady"}
RANDOM = {"frequencies_hz": [100.0, 9000.0], "samples": 4000}


@pytest.mark.parametrize(
    ("motion", "true", "more", "asked"),
    [
        # of a multisine, quickly, in the next test
        pytest.param("sine", "accelerometer+delay", {"delay": 2e-5}, "accelerometer", marks=pytest.mark.slow),
        pytest.param(
            "sine", "accelerometer+highpass", {"highpass_frequency": 60.0}, "accelerometer", marks=pytest.mark.slow
        ),
        ("sine", "accelerometer+mode2", SECOND, "accelerometer"),
        pytest.param("sine", "velocity-pickup", PICKUP, "accelerometer", marks=pytest.mark.slow),
        ("random", "accelerometer+delay", {"delay": 2e-5}, "accelerometer"),
    ],
)
def test_the_model_that_explains_the_data_is_named(motion: str, true: str, more: dict[str, float], asked: str) -> None:
    values = more if true == "velocity-pickup" else ACCELEROMETER | more
    quantity = "velocity" if true == "velocity-pickup" else "acceleration"
    made = simulate(
        (true, values), motion, **(SINES if motion == "sine" else RANDOM), sampling_rate_hz=25_600.0,
        quantity=quantity, response_noise=2e-3, seed=1,
    )  # fmt: skip
    result = vibrident.identify(made, model=asked)
    (said,) = (w.message for w in result.warnings if w.code == "lack_of_fit")
    assert f"The model {true} explains them (χ²/dof = " in said
    assert not {"nonlinear", "regimes", "drift"} & set(result.warning_codes)


@pytest.mark.parametrize(("rate", "samples"), [(7314.0, 1300), (51_200.0, 10_240)])
@pytest.mark.quick("7314.0-1300")
def test_what_a_model_leaves_of_a_multisines_tones_is_no_hum(rate: float, samples: int) -> None:
    """A delay that the model lacks: as hum the misfit fitted, with the natural frequency 80 and 300 u off."""
    sensor = {"sensitivity": 0.104, "natural_frequency": 652.0, "damping_ratio": 0.182, "delay": 1.7e-5}
    made = simulate(
        ("accelerometer+delay", sensor),
        "multisine",
        sampling_rate_hz=rate,
        samples=samples,
        response_noise=1e-2,
        seed=3,
    )
    result = vibrident.identify(made, model="accelerometer")
    (said,) = (w.message for w in result.warnings if w.code == "lack_of_fit")
    assert "The model accelerometer+delay explains them" in said
    assert "hum_hz" not in result.settings


def test_no_model_is_named_where_none_explains_the_data(rng: np.random.Generator) -> None:
    """Points of another sensor in the middle of the band."""
    made = simulate(("accelerometer", ACCELEROMETER), "sine", **SINES, sampling_rate_hz=25_600.0, response_noise=2e-3)
    bad = [r.with_response(r.response * (1.0 + 0.1 * rng.standard_normal()), "") for r in made.records]
    result = vibrident.identify(vibrident.Calibration(tuple(bad)), model="accelerometer")
    (said,) = (w.message for w in result.warnings if w.code == "lack_of_fit")
    assert "explains them" not in said


@pytest.mark.parametrize("lead_s", [0.38e-6, 3e-6])
def test_a_converter_that_stamps_the_response_early_is_named(rng: np.random.Generator, lead_s: float) -> None:
    """The lead ends the damping at zero, from where no logarithm returned; the phases were taken for the wrong sign."""
    hz = np.geomspace(10.0, 10_000.0, 31)
    response = parse("accelerometer").frequency_response(
        {"sensitivity": 0.1, "natural_frequency": 30_000.0, "damping_ratio": 0.02}, hz
    ) * np.exp(2j * np.pi * hz * lead_s)
    turn = np.deg2rad(0.1)
    table = vibrident.ResponseTable(
        hz,
        np.abs(response) * (1.0 + 1e-3 * rng.standard_normal(hz.size)),
        np.angle(response) + turn * rng.standard_normal(hz.size),
        1e-3 * np.abs(response),
        np.full(hz.size, turn),
    )
    result = vibrident.identify(vibrident.Calibration(table=table, model="accelerometer"))
    (said,) = (w.message for w in result.warnings if w.code == "lack_of_fit")
    assert "The model accelerometer+delay explains them" in said
    assert "units_suspect" not in result.warning_codes
