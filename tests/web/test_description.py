"""What is confirmed becomes a calibration file that says the same."""

from __future__ import annotations

import pytest

from vibrident.errors import InputError
from vibrident.io.calibration_file import read_calibration_file
from vibrident.io.guess import guess_columns
from vibrident.web.description import Description, calibration_text, described


def reread(folder, given: Description, *files: str):
    place = folder / "calibration.toml"
    place.write_text(calibration_text(given, files), encoding="utf-8")
    return read_calibration_file(place)


def test_records_are_reread_as_they_were_given(tmp_path):
    given = Description(
        reference='a "quoted" \\ name',
        quantity="velocity",
        scale=1e-3,
        unit="mm/s",
        standard_uncertainty=0.005,
        response=3,
        response_scale=-2.0,
        response_unit="pC",
        rate_hz=51200,
        excitation="sweep",
        core="velocity-pickup",
        add_ons=["delay", "highpass"],
        sensor={"manufacturer": "Müller & Söhne", "type": "", "serial_number": "#1 = 'x'"},
    )
    read = reread(tmp_path, given, "1 Hz.csv", "2.csv")
    assert (read.reference.column, read.reference.quantity) == (given.reference, "velocity")
    assert (read.reference.scale, read.reference.unit) == (1e-3, "mm/s")
    assert read.reference.standard_uncertainty == 0.005
    assert (read.response.column, read.response.scale, read.response.unit) == (3, -2.0, "pC")
    assert read.sampling.rate_hz == 51200.0
    assert [(entry.file, entry.excitation) for entry in read.records] == [("1 Hz.csv", "sweep"), ("2.csv", "sweep")]
    assert read.sensor.model == "velocity-pickup+delay+highpass"
    assert read.sensor_text["manufacturer"] == "Müller & Söhne"
    assert read.sensor_text["serial_number"] == "#1 = 'x'"


def test_a_time_column_goes_before_a_rate(tmp_path):
    read = reread(tmp_path, Description(reference="a", response="b", time="t", rate_hz=10.0), "x.csv")
    assert (read.sampling.time_column, read.sampling.rate_hz) == ("t", None)


def test_a_free_decay_needs_no_reference(tmp_path):
    read = reread(tmp_path, Description(response=1, rate_hz=10.0, excitation="decay"), "x.csv")
    assert read.reference.column is None


def test_a_table_is_reread_as_it_was_given(tmp_path):
    given = Description(
        table=True, frequency="f", magnitude="S", phase=3, magnitude_uncertainty="u", phase_unit="rad", unit="mm/s"
    )
    table = reread(tmp_path, given, "table.csv").table
    assert table is not None
    assert (table.file, table.frequency, table.magnitude, table.phase) == ("table.csv", "f", "S", 3)
    assert (table.magnitude_uncertainty, table.phase_uncertainty, table.phase_unit) == ("u", None, "rad")


@pytest.mark.parametrize(
    ("given", "files", "problem"),
    [
        (Description(reference=1), ["a"], "for the response"),
        (Description(response=1), ["a"], "for the reference"),
        (Description(reference=1, response=1), ["a"], "the same column"),
        (Description(table=True, frequency=1), ["a"], "for the magnitude"),
        (Description(table=True, frequency=1, magnitude=2), ["a", "b"], "one file"),
    ],
)
def test_what_is_missing_is_said(given, files, problem):
    with pytest.raises(InputError, match=problem):
        calibration_text(given, files)


def test_a_guess_is_a_description_that_can_be_corrected(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("frequency_hz,magnitude,phase_rad\n1,2,3\n2,2,3\n")
    given = described(guess_columns(path))
    assert (given.table, given.phase_unit, given.model) == (True, "rad", "accelerometer+delay")
    path.write_text("frequency_hz,magnitude\n1,2\n2,2\n")
    assert described(guess_columns(path)).model == "accelerometer"  # a magnitude alone knows no delay
