"""The measured calibrations of shared/data, as they are."""

import numpy as np
import pytest
from tests.support.real_data import calibration_beside_data

from vibrident.data.io import describe, read

SINE_STEPS = [
    *("0_1Hz.csv", "0_2Hz.csv", "0_3Hz.csv", "0_4Hz.csv", "0_5Hz.csv", "0_6Hz.csv", "0_7Hz.csv", "0_8Hz.csv"),
    *("0_9Hz.csv", "1_0Hz.csv", "2_0Hz.csv", "3_0Hz.csv", "4_0Hz.csv", "5_0Hz.csv", "6_0Hz.csv", "8_0Hz.csv"),
    "10_0Hz.csv",
]


def test_sm3_laser(tmp_path):
    calibration = read(calibration_beside_data("sm3-laser.toml", "sm3", tmp_path))

    assert [record.name for record in calibration.records] == SINE_STEPS
    assert calibration.quantity == "drive"
    assert (calibration.reference_unit, calibration.response_unit) == ("V", "m")
    assert calibration.model == "accelerometer+delay"
    for record in calibration.records:
        # Time stamps of 1.4e9 s resolve 0.24 µs: regression over 6400 of them leaves far less than 1e-8.
        assert record.sampling_rate_hz == pytest.approx(1 / 7.68e-3, rel=1e-8)
        assert len(record.provenance.sha256) == 64
    first = calibration.records[4]
    assert first.samples == 6400
    assert first.start_time_s == pytest.approx(1406723001.299, abs=1e-6)
    assert first.reference is not None
    assert first.reference[0] == pytest.approx(474310 * 0.9425e-6, rel=1e-14)
    assert first.response[0] == pytest.approx(-2953842 * 0.95066e-9, rel=1e-14)


def test_sm3_laser_full_scale_marks_the_plateau(tmp_path):
    calibration = read(calibration_beside_data("sm3-laser.toml", "sm3", tmp_path))

    at_limit = {
        r.name: int(np.sum(np.abs(r.response) >= r.response_full_scale))
        for r in calibration.records
        if r.response_full_scale is not None
    }
    assert {name for name, count in at_limit.items() if count} == {"0_2Hz.csv"}
    assert at_limit["0_2Hz.csv"] == 841


def test_sm3_coil_reads_the_misnamed_column(tmp_path):
    calibration = read(calibration_beside_data("sm3-coil.toml", "sm3", tmp_path))

    assert calibration.model == "velocity-pickup+delay"
    assert calibration.records[4].response[0] == pytest.approx(408448 * 0.9425e-6, rel=1e-14)
    assert "'Current'" in " ".join(calibration.records[4].provenance.history)


def test_ptb_sine_table(tmp_path):
    calibration = read(calibration_beside_data("ptb-shock-sine.toml", "ptb-shock", tmp_path))

    table = calibration.table
    assert table is not None
    assert table.points == 49
    assert table.magnitude[0] == 0.22708
    assert table.phase_rad is not None
    assert np.degrees(table.phase_rad[-1]) == pytest.approx(-4.18, rel=1e-14)
    assert table.magnitude_uncertainty is not None
    assert table.magnitude_uncertainty[0] / table.magnitude[0] == pytest.approx(0.005, rel=1e-12)
    assert table.magnitude_uncertainty[20] / table.magnitude[20] == pytest.approx(0.0015, rel=1e-12)
    assert table.phase_uncertainty_rad is not None
    assert np.degrees(table.phase_uncertainty_rad[[0, -1]]) == pytest.approx([0.25, 0.5], rel=1e-12)


def test_ptb_shock_in_two_files(tmp_path):
    calibration = read(calibration_beside_data("ptb-shock.toml", "ptb-shock", tmp_path))

    (record,) = calibration.records
    assert record.samples == 18000
    assert record.sampling_rate_hz == 1e7
    assert record.excitation == "shock"
    assert record.reference is not None
    assert record.reference[0] == pytest.approx(-1.7155029e-3, rel=1e-14)
    assert record.response[0] == pytest.approx(6.0888397e-3, rel=1e-14)
    assert any("measured_input_accel.txt" in step for step in record.provenance.history)


def test_mpu9250_table_in_rad(tmp_path):
    calibration = read(calibration_beside_data("mpu9250.toml", "mpu9250", tmp_path))

    table = calibration.table
    assert table is not None
    assert table.points == 170
    assert table.magnitude[0] == 1.0195540753444348
    assert table.phase_rad is not None
    assert table.phase_rad[-1] == -2.3732838832986385
    (row,) = describe(calibration)
    assert (row["from / Hz"], row["to / Hz"]) == (10.0, 250.0)
