"""Units are a convention: what is in them scales, and nothing that is stated in u knows which were taken."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

import vibrident
from vibrident.base.errors import InputError
from vibrident.data.records import Calibration, Record
from vibrident.physics.simulation import simulate

PICKUP = ("velocity-pickup", {"generator_constant": 28.8, "natural_frequency": 4.5, "damping_ratio": 0.6})
GAINS = ("sensitivity", "generator_constant", "conversion_coefficient")
POWERS_OF_THE_RATE = {
    "natural_frequency": 1, "natural_angular_frequency": 1, "resonance_frequency": 1, "generator_constant": 1,
    "conversion_coefficient": 2, "free_period": -1,
}  # fmt: skip
TONES = [100.0, 250.0, 400.0, 550.0, 630.0, 700.0, 850.0, 1000.0]


@functools.cache
def calibration(kind: str) -> Calibration:
    if kind == "sine":
        shape = {"frequencies_hz": TONES, "samples": 3000, "sampling_rate_hz": 2e4, "response_noise": 1e-3}
        return simulate("paper", "sine", reference_noise=1e-3, seed=1, **shape)
    shape = {"frequencies_hz": [1.0, 60.0], "samples": 6000, "sampling_rate_hz": 500.0, "amplitude": 1.0}
    return simulate(PICKUP, "random", response_noise=1e-2, reference_noise=1e-2, seed=1, **shape)


def in_units(kind: str, reference: float, response: float, rate: float = 1.0) -> Calibration:
    made = calibration(kind)
    records = [
        replace(
            r,
            reference=np.asarray(r.reference) * reference,
            response=r.response * response,
            sampling_rate_hz=r.sampling_rate_hz * rate,
            frequency_hz=r.frequency_hz and r.frequency_hz * rate,
        )
        for r in made.records
    ]
    return replace(made, records=tuple(records))


@pytest.mark.parametrize(("kind", "estimator"), [("sine", "ml"), ("sine", "ipnn"), ("random", "ipnn")])
def test_results_do_not_depend_on_the_units_of_either_channel_and_of_time(kind: str, estimator: str) -> None:
    plain = vibrident.identify(calibration(kind), estimator=estimator)
    for reference, response, rate in (
        (2.0**-60, 2.0**-43, 1e-3),
        (1e-20, 1e20, 1e3),
    ):
        other = vibrident.identify(in_units(kind, reference, response, rate), estimator=estimator)
        assert other.warning_codes == plain.warning_codes
        assert other.fit.chi2_reduced == pytest.approx(plain.fit.chi2_reduced, rel=1e-6)
        for name, known in plain.parameters.items():
            found, u = other.parameters[name], known.standard_uncertainty
            scale = rate ** POWERS_OF_THE_RATE.get(name, 0) * (response / reference if name in GAINS else 1.0)
            assert found.value / scale == pytest.approx(known.value, abs=1e-4 * u), (name, reference, response, rate)
            assert found.standard_uncertainty == pytest.approx(scale * u, rel=1e-4)


@pytest.mark.parametrize("factor", [1e150, 1e-150])
def test_a_size_that_no_unit_explains_is_refused(factor: float) -> None:
    with pytest.raises(InputError, match="no unit explains"):
        in_units("sine", 1.0, factor)


def test_a_channel_of_zeros_has_no_size() -> None:
    assert Record("rest", np.zeros(20), np.zeros(20), 100.0).samples == 20


def test_strings_of_numpy_are_strings() -> None:
    made = calibration("sine")
    records = tuple(replace(r, excitation=np.str_("sine")) for r in made.records)
    other = replace(made, records=records, quantity=np.str_("acceleration"), model=np.str_(made.model))
    assert vibrident.identify(other).parameters == vibrident.identify(made).parameters


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.quick("1")
def test_a_shock_whose_reference_is_displacement_ends_in_a_result_that_is_doubted(seed: int) -> None:
    noisy = simulate("piezo", "shock", quantity="displacement", response_noise=1e-3, reference_noise=1e-3, seed=seed)
    result = vibrident.identify(noisy)
    assert {"lack_of_fit", "weakly_determined"} & set(result.warning_codes)


@pytest.mark.parametrize("excitation", ["sine", "sweep", "random", "shock"])
def test_clean_motion_against_a_displacement_is_no_misfit(excitation):
    """The interferometer's own case: the interpolation differentiated slow motion with errors above the noise.

    χ²/ν of sines was 44, sweeps had regimes, shocks drifted, and a motion from rest to one side was clipped.
    """
    truth = {"sensitivity": 1e-2, "natural_frequency": 3000.0, "damping_ratio": 0.02}
    frequencies_hz = np.geomspace(5.0, 2000.0, 8 if excitation == "sine" else 2)
    calibration = simulate(
        ("accelerometer", truth), excitation=excitation, frequencies_hz=frequencies_hz.tolist(),
        sampling_rate_hz=10e3, samples=16000, response_noise=1e-5, quantity="displacement", seed=3,
    )  # fmt: skip
    result = vibrident.identify(calibration, model="accelerometer")
    assert result.warning_codes == ()
    for name, value in truth.items():
        parameter = result.parameters[name]
        assert abs(parameter.value - value) < 4.0 * parameter.standard_uncertainty
