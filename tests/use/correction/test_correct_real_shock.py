"""A real shock, corrected with the sensor's own sine calibration (data README)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.support.real_data import calibration_beside_data

import vibrident


def test_the_measured_shock(tmp_path: Path) -> None:
    """The output over the sensitivity is 4 % too high at the peak; corrected, it is within 1 %, and named doubtful.

    The model is not adequate, which the correction says; its misfit at the calibrated points is part of the interval,
    which holds the peak of the reference. The band is not what is amiss: as far off in the calibrated band alone.
    """
    for name in ("sine", "shock"):
        (tmp_path / name).mkdir()
    sine = vibrident.read(calibration_beside_data("ptb-shock-sine.toml", "ptb-shock", tmp_path / "sine"))
    shock = vibrident.read(calibration_beside_data("ptb-shock.toml", "ptb-shock", tmp_path / "shock"))
    result = vibrident.identify(sine, model="accelerometer+delay")
    corrections = vibrident.correct(result, shock)
    found = corrections.corrections[0]
    record = found.record
    rest = slice(0, found.baseline.rest_samples)
    raw = np.max(np.abs(record.response - np.mean(record.response[rest]))) / result.parameters["sensitivity"].value
    peak = found.agreement.reference_peak
    assert raw / peak - 1.0 > 0.04
    assert found.peak.value == pytest.approx(peak, rel=0.01)
    assert found.peak.interval_95[0] < peak < found.peak.interval_95[1]
    assert found.peak.standard_uncertainty < 0.01 * peak
    capped = vibrident.correct(result, shock, band_hz=(0.0, 20e3)).corrections[0]
    assert capped.peak.value / capped.agreement.reference_peak == pytest.approx(found.peak.value / peak, abs=5e-4)
    codes = {finding.code for finding in corrections.findings}
    assert {"lack_of_fit", "weakly_determined", "band_sensitive"} <= codes
