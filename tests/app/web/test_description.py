"""What is confirmed becomes a calibration file that says the same."""

from __future__ import annotations

import pytest

import vibrident
from vibrident.app.web.column_guess import guess
from vibrident.app.web.form.columns import merge_guess
from vibrident.app.web.form.description import Description, calibration_text, describe_guess, find_optical_part
from vibrident.app.web.sandboxed import draw_chart
from vibrident.base.errors import InputError
from vibrident.data.io.calibration_file import read_calibration_file
from vibrident.data.io.guess import guess_columns
from vibrident.physics.simulation.optics import Optics, write_optical_calibration


def reread(folder, given: Description, *files: str):
    place = folder / "calibration.toml"
    place.write_text(calibration_text(given, files), encoding="utf-8")
    return read_calibration_file(place)


def records(**sections) -> Description:
    """Two columns, a rate and a sine, or what the sections say."""
    usual = {
        "reference": {"column": "a", "scale": 1.0},
        "response": {"column": "b", "scale": 1.0, "unit": "V"},
        "sampling": {"rate_hz": 10.0},
        "records": {"excitation": "sine"},
    }
    return Description({name: {**usual.get(name, {}), **sections.get(name, {})} for name in {**usual, **sections}})


def test_records_are_reread_as_they_were_given(tmp_path):
    given = records(
        sensor={"manufacturer": "Müller & Söhne", "type": "", "serial_number": "#1 = 'x'", "model": "velocity-pickup"},
        reference={
            "column": 'a "quoted" \\ name',
            "quantity": "velocity",
            "scale": 1e-3,
            "unit": "mm/s",
            "standard_uncertainty": 0.005,
            "full_scale": 10.0,
        },
        response={"column": 3, "scale": -2.0, "unit": "pC", "full_scale": 5.0},
        sampling={"rate_hz": 51200},
        records={"excitation": "sweep", "stop_s": 2.0, "run": "1", "axis": "z", "temperature_c": 23.5},
    )
    given.set("uncertainty", [{"source": "laser", "kind": "gain", "standard_uncertainty": 0.001, "from_hz": 10.0}])
    given.set("cmc", [{"expanded_uncertainty": 0.01}])
    given.set("different", [{"file": "2.csv", "excitation": "sine", "frequency_hz": 160.0, "run": "2"}])
    read = reread(tmp_path, given, "1 Hz.csv", "2.csv")
    assert (read.reference.column, read.reference.quantity) == (given.get("reference.column"), "velocity")
    assert (read.reference.scale, read.reference.unit, read.reference.full_scale) == (1e-3, "mm/s", 10.0)
    assert read.reference.standard_uncertainty == 0.005
    assert (read.response.column, read.response.scale, read.response.unit) == (3, -2.0, "pC")
    assert (read.sampling.rate_hz, read.response.full_scale) == (51200.0, 5.0)
    first, second = read.records
    assert [(entry.file, entry.excitation) for entry in read.records] == [("1 Hz.csv", "sweep"), ("2.csv", "sine")]
    assert (first.stop_s, first.run, first.axis, first.temperature_c, first.frequency_hz) == (2.0, "1", "z", 23.5, None)
    assert (second.stop_s, second.run, second.axis, second.frequency_hz) == (2.0, "2", "z", 160.0)
    assert read.uncertainty[0].from_hz == 10.0
    assert read.cmc[0].quantity == "magnitude"
    assert read.sensor.model == "velocity-pickup"
    assert read.sensor_text == {"manufacturer": "Müller & Söhne", "serial_number": "#1 = 'x'"}


def test_a_time_column_goes_before_a_rate(tmp_path):
    read = reread(tmp_path, records(sampling={"time_column": "t"}), "x.csv")
    assert (read.sampling.time_column, read.sampling.rate_hz) == ("t", None)


def test_a_free_decay_needs_no_reference(tmp_path):
    read = reread(tmp_path, records(records={"excitation": "decay"}), "x.csv")
    assert read.reference.column is None


def test_a_reference_may_be_in_files_of_its_own(tmp_path):
    given = records(reference={"column": "b"})
    given.optical_part = "_ref"
    read = reread(tmp_path, given, "1.csv", "1_ref.csv")
    assert [(entry.file, entry.reference_file) for entry in read.records] == [("1.csv", "1_ref.csv")]


@pytest.mark.parametrize("kind", ["quadrature", "heterodyne"])
def test_an_interferometer_is_reread_as_it_was_given(tmp_path, kind):
    given = records(
        reference={"column": "forgotten", "standard_uncertainty": 1e-4},
        interferometer={
            "kind": kind,
            "columns": ["u1", 4],
            "wavelength_m": 1550.12e-9,
            "wavelength_relative_uncertainty": 1e-7,
            "passes": 2,
            "carrier_hz": 4e7,
            "direction": -1,
            "rate_hz": 1e8,
            "delay_s": 1e-6,
        },
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


def table(**keys) -> Description:
    return Description({"table": keys, "reference": {"scale": 2.0, "unit": "mm/s"}}, table=True)


def test_a_table_is_reread_as_it_was_given(tmp_path):
    given = table(frequency="f", magnitude="S", phase=3, magnitude_uncertainty="u", phase_unit="rad")
    read = reread(tmp_path, given, "table.csv")
    assert read.table is not None
    assert (read.table.file, read.table.frequency, read.table.magnitude, read.table.phase) == ("table.csv", "f", "S", 3)
    assert (read.table.magnitude_uncertainty, read.table.phase_uncertainty) == ("u", None)
    assert read.table.phase_unit == "rad"
    assert (read.reference.scale, read.reference.unit) == (1.0, "")  # of records


def light(*columns, kind="quadrature") -> Description:
    return records(
        reference={"column": None}, interferometer={"kind": kind, "columns": [*columns], "wavelength_m": 633e-9}
    )


@pytest.mark.parametrize(
    ("given", "files", "problem"),
    [
        (records(response={"column": None}), ["a"], "“Response: column” is empty"),
        (records(reference={"column": None}), ["a"], "“Reference: column” is empty"),
        (records(reference={"column": "b"}), ["a"], "the same column"),
        (records(reference={"scale": None}), ["a"], "“Reference: scale” is empty"),
        (records(records={"start_s": 2.0, "stop_s": 1.0}), ["a"], "part of the record is empty"),
        (records(reference={"standard_uncertainty": -1.0}), ["a"], "cannot be used"),
        (light("a"), ["a"], "“Signals” is empty"),
        (light("a", "a"), ["a"], "the same column"),
        (light("a", kind="heterodyne"), ["a"], "“Carrier, approximately, Hz” is empty"),
        (table(frequency=1), ["a"], "response in one way"),
        (table(magnitude=1), ["a"], "frequency is missing"),
        (table(frequency=1, magnitude=2, real=3, imaginary=4), ["a"], "response in one way"),
        (table(frequency=1, magnitude=2), ["a", "b"], "one file"),
    ],
)
def test_what_is_missing_or_wrong_is_said(given, files, problem):
    with pytest.raises(InputError, match=problem):
        calibration_text(given, files)


def test_a_guess_is_a_description_that_can_be_corrected(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("frequency_hz,magnitude,phase_rad\n1,2,3\n2,2,3\n")
    given = describe_guess(guess_columns(path))
    assert (given.table, given.get("table.phase_unit")) == (True, None)  # the file states it
    (tmp_path / "calibration.toml").write_text(calibration_text(given, ["table.csv"]))
    table = vibrident.read(tmp_path / "calibration.toml").table
    assert table is not None
    assert list(table.phase_rad) == [3.0, 3.0]
    assert given.get("sensor.model") == "accelerometer+delay"
    path.write_text("frequency_hz,magnitude\n1,2\n2,2\n")
    assert (
        describe_guess(guess_columns(path)).get("sensor.model") == "accelerometer"
    )  # a magnitude alone knows no delay


def test_optical_signals_in_files_of_their_own_are_paired_by_their_names(tmp_path):
    """From the uploaded files to the records: guessed, drawn, written and read."""
    optics = Optics(rate_hz=1e6)
    settings = {"sampling_rate_hz": 5e4, "samples": 3000, "frequencies_hz": [200.0, 600.0], "start": "steady"}
    write_optical_calibration(tmp_path, "paper", "sine", optics, seed=1, **settings)
    files = sorted(path.name for path in tmp_path.glob("*.h5"))
    found = guess(tmp_path, files)
    given = merge_guess(None, found).description
    assert (found.optical_part, given.signals, given.get("response.column")) == ("_optical", ("u1", "u2"), "response")
    for path, value in {"sampling.rate_hz": 5e4, "interferometer.rate_hz": 1e6, "interferometer.direction": 1}.items():
        given.set(path, value)
    assert b"u2" in draw_chart(given, tmp_path, files)
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
    assert find_optical_part(files) == part
