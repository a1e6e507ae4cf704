"""What names of columns say."""

from __future__ import annotations

import json
import wave

import numpy as np
import pytest

from vibrident.app.web.column_guess import likely_excitation
from vibrident.app.web.form.description import describe_guess
from vibrident.app.web.language import language
from vibrident.app.web.preview import preview
from vibrident.base.errors import InputError
from vibrident.data.io.guess import guess_columns
from vibrident.physics.simulation import simulate


def csv(folder, header: str, name: str = "data.csv"):
    path = folder / name
    width = header.count(",") + 1
    path.write_text(
        "\n".join([header, *(",".join(str(row + i / 10) for i in range(width)) for row in range(4))]) + "\n"
    )
    return guess_columns(path)


@pytest.mark.parametrize(
    ("header", "time", "reference", "response", "quantity", "unit"),
    [
        ("time_s,reference_acceleration,response", "time_s", 1, 2, "acceleration", ""),
        ("Seconds,FuncGen,Laser", "Seconds", 1, 2, "drive", ""),
        ("t,ref_vel [mm/s],dut [mV]", "t", 1, 2, "velocity", "mm/s"),
        ("sensor out,acceleration (m/s2)", None, 1, 0, "acceleration", "m/s2"),
        ("laser displacement [um],U", None, 0, 1, "displacement", "um"),
        ("a,b", None, 0, 1, "acceleration", ""),
        ("Nr,Zeit [s],Beschl. [g],Spannung [V]", "Zeit [s]", 2, 3, "acceleration", "g"),
        ("Zeit [s],Geschwindigkeit [mm/s],Ladung [pC]", "Zeit [s]", 1, 2, "velocity", "mm/s"),
    ],
)
def test_records(tmp_path, header, time, reference, response, quantity, unit):
    guess, names = csv(tmp_path, header), header.split(",")
    assert not guess.is_table
    stated = guess.document["reference"]
    assert (guess.time, stated["column"]) == (time, names[reference])
    assert guess.document["response"]["column"] == names[response]
    assert (stated["quantity"], stated["unit"]) == (quantity, unit)
    assert stated["scale"] == 1.0  # the unit is applied


@pytest.mark.parametrize(
    ("header", "detectors", "response"),
    [
        ("t,u1,u2,response", ("u1", "u2"), "response"),
        ("out,Photodiode 1 [V],Photodiode 2 [V]", ("Photodiode 1 [V]", "Photodiode 2 [V]"), "out"),
        ("cos,sin,laser pickup", ("cos", "sin"), "laser pickup"),
        ("t,Q,I,sensor", ("I", "Q"), "sensor"),
        ("t,heterodyne,sensor", ("heterodyne",), "sensor"),
        ("t,reference,u1", (), "u1"),
    ],
)
def test_the_photodetectors_of_an_interferometer(tmp_path, header, detectors, response):
    document = csv(tmp_path, header).document
    assert tuple(document["interferometer"].get("columns", ())) == detectors
    assert document["response"]["column"] == response
    assert ("column" in document["reference"]) == (not detectors)


def test_units_in_a_line_of_their_own(tmp_path):
    (tmp_path / "a.csv").write_text(
        "Zeit;Laser;Prüfling\ns;m/s²;mV\n" + "".join(f"{i};{i},5;{i},2\n" for i in range(9))
    )
    guess = guess_columns(tmp_path / "a.csv")
    reference, response = guess.document["reference"], guess.document["response"]
    assert (guess.time, reference["column"], response["column"]) == ("Zeit", "Laser", "Prüfling")
    assert (reference["quantity"], reference["unit"], response["unit"]) == ("acceleration", "m/s²", "mV")


def test_the_preview_names_the_units_of_the_file(tmp_path):
    """Values are drawn as in the file, so each name has the file's unit, once."""
    rows = "".join(f"{i};{i},5;{i},2\n" for i in range(9))
    (tmp_path / "a.csv").write_text("Zeit;Laser;Prüfling\ns;m/s²;mV\n" + rows)
    (tmp_path / "b.csv").write_text("Zeit [s];Laser [m/s²];Prüfling [mV]\n" + rows)
    expected = {"a.csv": {"Laser / m/s²", "Prüfling / mV"}, "b.csv": {"Laser [m/s²]", "Prüfling [mV]"}}
    for name, names in expected.items():
        given = describe_guess(guess_columns(tmp_path / name))
        drawn = json.loads(preview(given, tmp_path, [name], language("en")))
        assert {trace["name"] for trace in drawn["data"]} == names


def test_the_preview_is_in_seconds(tmp_path):
    (tmp_path / "a.csv").write_text("t [ms],a [m/s²],v [V]\n" + "".join(f"{i / 4},{i},{i % 3}\n" for i in range(9)))
    given = describe_guess(guess_columns(tmp_path / "a.csv"))
    drawn = json.loads(preview(given, tmp_path, ["a.csv"], language("en")))
    assert max(drawn["data"][0]["x"]) == pytest.approx(2e-3)


def test_the_unit_of_the_response(tmp_path):
    assert csv(tmp_path, "t,ref [m/s^2],response [pC]").document["response"]["unit"] == "pC"
    assert csv(tmp_path, "t,ref [m/s^2],response").document["response"]["unit"] == "V"


def test_a_table(tmp_path):
    guess = csv(tmp_path, "frequency_hz,magnitude,u_magnitude,phase_deg,u_phase")
    assert guess.is_table
    assert guess.document["table"] == {
        "frequency": "frequency_hz",
        "magnitude": "magnitude",
        "phase": "phase_deg",
        "magnitude_uncertainty": "u_magnitude",
        "phase_uncertainty": "u_phase",
    }


@pytest.mark.parametrize(
    ("header", "uncertainty", "quantity", "unit"),
    [
        ("Frequenz / Hz,Betrag / (mV/(m/s²)),Phase / °,u Betrag / (mV/(m/s²))", 3, "acceleration", "V"),
        ("f,magnitude [pC/(m/s^2)],U magnitude", None, "acceleration", "pC"),  # expanded: twice as large
        ("f,Betrag [V/(m/s)],Messunsicherheit Betrag", 2, "velocity", "V"),
        ("f,Betrag [V/(m/s)],u Betrag / %", 2, "velocity", "V"),
        ("f,sensitivity [pC/g],phase", None, "acceleration", "pC"),
    ],
)
def test_the_units_of_a_table(tmp_path, header, uncertainty, quantity, unit):
    guess = csv(tmp_path, header)
    assert guess.is_table
    table, names = guess.document["table"], header.split(",")
    assert table.get("magnitude_uncertainty") == (None if uncertainty is None else names[uncertainty])
    assert guess.document["reference"]["quantity"] == quantity
    assert guess.document["response"]["unit"] == unit


@pytest.mark.parametrize(
    ("name", "excitation"),
    [
        ("10Hz", None),
        ("multisine_3", "multisine"),
        ("chirp", "sweep"),
        ("noise", "random"),
        ("hammer 2", "shock"),
        ("free decay", "decay"),
    ],
)
def test_the_excitation_by_the_name_of_the_file(tmp_path, name, excitation):
    assert csv(tmp_path, "t,ref,response", f"{name}.csv").document["records"].get("excitation") == excitation


def test_names_that_occur_twice_become_numbers(tmp_path):
    guess = csv(tmp_path, "t,signal,signal")
    assert guess.columns == ("t", 2, 3)
    assert guess.labels == ("t", "column 2 (signal)", "column 3 (signal)")
    assert {guess.document[section]["column"] for section in ("reference", "response")} == {2, 3}


def test_a_file_that_knows_its_rate_needs_no_time_column(tmp_path):
    with wave.open(str(tmp_path / "a.wav"), "wb") as file:
        file.setnchannels(2)
        file.setsampwidth(2)
        file.setframerate(48000)
        file.writeframes(np.arange(20, dtype="<i2").tobytes())
    guess = guess_columns(tmp_path / "a.wav")
    assert (guess.rate_hz, guess.time) == (48000.0, None)
    assert guess.columns == ("channel 1", "channel 2")
    assert [guess.document[section]["column"] for section in ("reference", "response")] == [*guess.columns]


def test_a_file_that_cannot_be_opened_is_said(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        guess_columns(tmp_path / "none.csv")


@pytest.mark.parametrize("kind", ["sine", "sweep", "random", "shock"])
def test_the_excitation_by_the_motion_where_the_names_do_not_say(tmp_path, kind):
    tones = {"frequencies_hz": [100.0, 200.0, 300.0]} if kind == "sine" else {}
    made = simulate("paper", kind, sampling_rate_hz=25_600.0, samples=8000, seed=1, **tones)
    files = [f"{index}.csv" for index in range(len(made.records))]
    for file, record in zip(files, made.records, strict=True):
        data = np.stack([record.time_s, np.asarray(record.reference), record.response], axis=1)
        np.savetxt(tmp_path / file, data, delimiter=",", header="t,ref,response", comments="")
    guess = guess_columns(tmp_path / files[0])
    assert not guess.document["records"]
    assert likely_excitation(guess, tmp_path, files) == kind
    (tmp_path / files[0]).write_text("t,ref,response\n0,a,1\n")  # what cannot be read is said later
    assert likely_excitation(guess, tmp_path, files[:1]) == "sine"
