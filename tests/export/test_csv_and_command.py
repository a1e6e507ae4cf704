"""Tables against the result, digit by digit, and the command ``vibrident export``."""

from __future__ import annotations

import csv
from dataclasses import replace

import pytest
import typer
from tests.support.exported import CASES, case, paper
from tests.support.shell import run
from tests.support.sources import ROOT

from vibrident.app.cli import app
from vibrident.app.cli.words import shell_word
from vibrident.base.errors import InputError
from vibrident.export import export
from vibrident.export.form import library
from vibrident.export.registry import EXPORTS
from vibrident.result import Result

pytestmark = pytest.mark.filterwarnings("ignore:SelectableGroups:DeprecationWarning")


def rows(path):
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.reader(stream))


def number(text):
    return None if text == "" else float(text)


@pytest.mark.parametrize("name", CASES)
def test_tables_hold_every_number_of_the_result(name, tmp_path):
    made = case(name)
    parameters, correlation, response, measured, *_ = map(rows, export(made, "csv", tmp_path))
    for (key, p), row in zip(made.parameters.items(), parameters[1:], strict=True):
        assert row[0] == key
        assert number(row[1]) == p.value
        assert row[2] == p.unit
        assert [number(text) for text in row[3:6]] == [p.standard_uncertainty, *p.interval_95]
        assert row[6:] == ["yes", "yes" if p.derived else "no"]
    assert correlation[0][1:] == list(made.correlation.names)
    assert tuple(tuple(map(float, row[1:])) for row in correlation[1:]) == made.correlation.matrix
    for table, curve in ((response, made.response), (measured, made.measured)):
        columns = list(zip(*table[1:], strict=True))
        wanted = (curve.frequency_hz, curve.magnitude, curve.phase_deg)
        wanted += (curve.magnitude_uncertainty, curve.phase_deg_uncertainty)
        for texts, values in zip(columns, wanted, strict=False):
            assert tuple(map(number, texts)) == tuple(values)
    assert {row[7] for row in measured[1:]} == {'a, "b".csv'}


def test_blanks_stand_for_what_is_not_known(tmp_path):
    made = paper()
    blank = replace(made.measured, phase_deg=(None,) * 25, deviation_phase_deg=(), record=())
    *_, measured, _ = map(rows, export(replace(made, measured=blank), "csv", tmp_path))
    assert all(row[2] == row[6] == row[7] == "" for row in measured[1:])


def test_command_and_documentation_offer_every_format_and_option():
    done = run("export", "--help")
    page = (ROOT / "docs" / "exports.md").read_text(encoding="utf-8")
    for name, form in EXPORTS.all().items():
        assert name in done.output
        assert f"`{name}`" in page
        assert form.contents in page
        assert form.cannot_hold in page
        for option in form.options:
            flag = shell_word(typer.main.get_command(app))(f"export.{option}", "")
            assert any(flag in line and name in line for line in done.output.splitlines())
            assert any(flag in line and f"`{name}`" in line for line in page.splitlines())


@pytest.mark.parametrize(
    ("form", "files"),
    [
        ("csv", {f"sensor_{name}.csv" for name in ("parameters", "correlation", "response", "measured", "level")}),
        ("c", {"sensor.c", "sensor.h"}),
        ("stationxml", {"sensor.station.xml"}),
        ("fmu", {"sensor.fmu"}),
    ],
)
def test_the_command_writes_whole_files(form, files, tmp_path):
    source = paper().save(tmp_path / "result.json")
    out = tmp_path / "out"
    rate = ("--rate", "51200") if "rate_hz" in EXPORTS[form].options else ()
    done = run("export", source, "--format", form, "--out", out, *rate)
    assert done.exit_code == 0, done.output
    assert {path.name for path in out.iterdir()} == files
    again = tmp_path / "again"
    again.mkdir()
    for path in export(Result.load(source), form, again, rate_hz=51200.0):
        if form in ("csv", "c"):
            assert path.read_bytes() == (out / path.name).read_bytes()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--format", "xls"], "is not a choice of --format"),
        (["--format", "c"], "needs a sampling rate"),
        (["--format", "c", "--rate", "51200", "--band", "1000:10"], "The band cannot be used"),
        (["--format", "c", "--rate", "51200", "--band", "wide"], "--band cannot be read"),
        (["--format", "dcc"], "must state"),
        (["--format", "sacpz", "--without", "mode2"], "is not a choice of --without"),
    ],
)
def test_bad_input_is_one_message_and_leaves_nothing(arguments, said, tmp_path):
    source = paper().save(tmp_path / "result.json")
    out = tmp_path / "out"
    done = run("export", source, *arguments, "--out", out)
    assert done.exit_code == 2
    assert said in done.stderr
    assert "Traceback" not in done.output
    assert not out.exists()


def test_a_missing_library_names_its_extra():
    with pytest.raises(InputError, match="not installed") as caught:
        library("no_such_library", "seismic")
    assert caught.value.remedy == "pip install 'vibrident[seismic]'"
