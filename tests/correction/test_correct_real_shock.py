"""A real shock, corrected with the sensor's own sine calibration (data README)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import vibrident
from realdata import calibration_beside_data


def test_the_measured_shock(tmp_path: Path) -> None:
    """The output over the sensitivity is 4 % too high at the peak; corrected, it is within 1 %, and named doubtful.

    The interval, from the table's uncertainties taken for independent and beyond the calibrated band, does not reach
    as far: the model is not adequate, and the correction says so.
    """
    for name in ("sine", "shock"):
        (tmp_path / name).mkdir()
    sine = vibrident.read(calibration_beside_data("ptb-shock-sine.toml", "ptb-shock", tmp_path / "sine"))
    shock = vibrident.read(calibration_beside_data("ptb-shock.toml", "ptb-shock", tmp_path / "shock"))
    result = vibrident.identify(sine, model="accelerometer+delay")
    corrections = vibrident.correct(result, shock)
    found = corrections.corrections[0]
    record = found.record
    rest = slice(0, found.surroundings.rest_samples)
    raw = np.max(np.abs(record.response - np.mean(record.response[rest]))) / result.parameters["sensitivity"].value
    peak = found.agreement.reference_peak
    assert raw / peak - 1.0 > 0.04
    assert found.peak.value == pytest.approx(peak, rel=0.01)
    codes = {finding.code for finding in corrections.findings}
    assert {"lack_of_fit", "weakly_determined", "band_sensitive"} <= codes
