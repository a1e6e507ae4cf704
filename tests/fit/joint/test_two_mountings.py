"""Which of two resonances is the sensor's and which its mounting's: one calibration leaves it open, two tell."""

import numpy as np
import pytest
from tests.support.mounted import SENSOR, table

import vibrident

LIGHT = SENSOR | {"damping_ratio": 0.004}
HZ = np.geomspace(2e3, 90e3, 40)


def on(mounting_hz, seed):
    values = LIGHT | {"mounting_frequency": mounting_hz, "mounting_damping": 0.004}
    return table(seed, "accelerometer+mounting", values, HZ, noise=0.01)


def test_one_mounting_does_not_tell_and_two_do():
    one = vibrident.identify(on(30e3, 1))
    assert one.warning_codes == ["weakly_determined"] or set(one.warning_codes) == {"weakly_determined"}
    assert any("Another solution explains the data as well" in warning.message for warning in one.warnings)

    results = vibrident.identify_together([on(30e3, 1), on(60e3, 2)])
    for result, mounting_hz in zip(results, (30e3, 60e3), strict=True):
        assert not result.warnings
        found = result.parameters
        for name, true in {**LIGHT, "mounting_frequency": mounting_hz}.items():
            assert found[name].value == pytest.approx(true, abs=4 * found[name].standard_uncertainty), name
    shared = {row["name"] for row in results[0].settings["joint"]["shared"]}
    assert shared == {"sensitivity", "natural_frequency", "damping_ratio"}


def test_what_is_shared_has_one_uncertainty():
    """Also where it is hardly determined: one calibration's profile says nothing of two calibrations."""
    low = np.geomspace(100.0, 20e3, 30)
    made = [
        table(seed, "accelerometer+mounting", SENSOR | {"mounting_frequency": hz, "mounting_damping": 0.03}, low)
        for seed, hz in ((1, 30e3), (2, 60e3))
    ]
    first, second = vibrident.identify_together(made)
    for name in SENSOR:
        u = [result.parameters[name].standard_uncertainty for result in (first, second)]
        assert u[0] == pytest.approx(u[1], rel=1e-9)
