"""``identify`` of a long record: its parts are read in a process of its own, and what is fitted is kept."""

import json

import pytest
from tests.support.long_records import TRUTH, in_file, random_motion
from tests.support.shell import printed, run

from vibrident.data.io import long_records
from vibrident.use.stretches import identification


def test_a_long_record_is_fitted_by_stretches_and_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(long_records, "MAX_TOGETHER", 3000)
    monkeypatch.setattr(identification, "STRETCH_SAMPLES", 3000)
    path = in_file(tmp_path / "data", *random_motion(9000, 0, TRUTH))
    asked = ("identify", path, "--no-pictures", "--work", tmp_path / "work")
    assert "accelerometer, estimator ipnn" in printed(*asked, "--out", tmp_path / "out")
    result = json.loads((tmp_path / "out/result.json").read_text())
    assert result["settings"]["stretches"]["count"] == 3
    assert len(list((tmp_path / "work").glob("*/*.fit"))) == 2
    monkeypatch.setattr(identification, "fit_stretch", pytest.fail)
    printed(*asked, "--out", tmp_path / "again")
    again = json.loads((tmp_path / "again/result.json").read_text())
    assert again["parameters"] == result["parameters"]
    both = run("identify", path, path, "--work", tmp_path / "work")
    assert both.exit_code == 2
    assert "one calibration at a time" in both.output
