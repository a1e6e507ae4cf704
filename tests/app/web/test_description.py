"""What is confirmed becomes a calibration file that says the same."""

from __future__ import annotations

import pytest

import vibrident
from vibrident.app.web.columns import merged
from vibrident.app.web.description import Description, calibration_text, described, mark
from vibrident.app.web.looks import chart, guess
from vibrident.base.errors import InputError
from vibrident.data.io.calibration_file import read_calibration_file
from vibrident.data.io.guess import guess_columns
from vibrident.physics.simulation.optics import Optics, write_optical_calibration


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


@pytest.mark.parametrize("kind", ["quadrature", "heterodyne"])
def test_an_interferometer_is_reread_as_it_was_given(tmp_path, kind):
    given = Description(
        reference_by=kind,
        first_signal="u1",
        second_signal=4,
        response="out",
        rate_hz=1e5,
        wavelength_nm=1550.12,
        wavelength_relative_uncertainty=1e-7,
        passes=2.0,
        carrier_hz=4e7,
        direction=-1,
        optical_rate_hz=1e8,
        optical_delay_s=1e-6,
        standard_uncertainty=1e-4,
        reference="forgotten",
    )
    read = reread(tmp_path, given, "x.h5")
    assert read.interferometer is not None
    setting = read.interferometer.setting
    assert (setting.kind, setting.wavelength_m, setting.passes, setting.direction) == (kind, 1550.12e-9, 2, -1)
    assert read.interferometer.columns == (["u1", 4] if kind == "quadrature" else ["u1"])
    assert setting.carrier_hz == (None if kind == "quadrature" else 4e7)
    assert (read.interferometer.rate_hz, setting.delay_s) == (1e8, 1e-6)
    assert setting.wavelength_relative_uncertainty == 1e-7
    assert read.reference.standard_uncertainty == 1e-4


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
        (Description(reference_by="quadrature", response=1, first_signal=2), ["a"], "for the sine"),
        (Description(reference_by="quadrature", response=1, first_signal=2, second_signal=2), ["a"], "the same column"),
        (Description(reference_by="heterodyne", response=1, first_signal=2), ["a"], "carrier is empty"),
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


def test_optical_signals_in_files_of_their_own_are_paired_by_their_names(tmp_path):
    """From the uploaded files to the records: guessed, drawn, written and read."""
    optics = Optics(rate_hz=1e6)
    settings = {"sampling_rate_hz": 5e4, "samples": 3000, "frequencies_hz": [200.0, 600.0], "start": "steady"}
    write_optical_calibration(tmp_path, "paper", "sine", optics, seed=1, **settings)
    files = sorted(path.name for path in tmp_path.glob("*.h5"))
    found = guess(tmp_path, files)
    assert (found.optical_part, found.columns.detectors, found.columns.response) == (
        "_optical",
        ("u1", "u2"),
        "response",
    )
    given = merged(None, found).given
    given.rate_hz, given.optical_rate_hz, given.direction = 5e4, 1e6, 1
    assert b"u2" in chart(given, tmp_path, files)
    read = reread(tmp_path, given, *files)
    assert [(r.file, r.reference_file) for r in read.records] == [
        (f"record_0{i}.h5", f"record_0{i}_optical.h5") for i in (1, 2)
    ]
    made = vibrident.read(tmp_path / "calibration.toml").records
    assert [record.optical.fringes for record in made] == pytest.approx([39.5, 4.4], rel=0.03)
    with pytest.raises(InputError, match="do not match"):
        calibration_text(given, files[:-1])


@pytest.mark.parametrize(
    ("files", "part"),
    [
        (["a.csv", "a_light.csv", "b.csv", "b_light.csv"], "_light"),
        (["pd-1.wav", "1.h5"], "pd-"),
        (["160 Hz.csv", "315 Hz.csv"], ""),
        (["1.csv", "10.csv", "2.csv", "20.csv", "3.csv"], ""),
        (["a.csv"], ""),
    ],
)
def test_files_are_pairs_where_names_differ_by_one_part(files, part):
    assert mark(files) == part
