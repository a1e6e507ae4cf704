"""Bad input: exit 2, one message that says expected, found, where and remedy, no traceback, nothing written."""

import json
import re
from pathlib import Path

import pytest
import typer
from rich.text import Text

from vibrident.app.cli.application import app

RECORD = "100_Hz.csv"


def assert_refused(done, folder: Path, *words: str):
    """One complete message on stderr, nothing else printed, nothing written."""
    assert done.exit_code == 2, done.output
    assert done.exception is None or isinstance(done.exception, SystemExit)
    assert done.stdout == ""
    lines = done.stderr.splitlines()
    assert lines[0].startswith("Error: ")
    assert sum(line.startswith("Error") for line in lines) == 1
    labels = [line.split()[0] for line in lines if line.startswith("  ") and line.split()[0].endswith(":")]
    assert labels == ["expected:", "found:", "where:", "remedy:"]
    assert "Traceback" not in done.output
    for word in words:
        assert word in done.stderr
    assert not folder.exists()
    assert not list(folder.parent.rglob("*.part"))


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new, 1), encoding="utf-8")


def edit_record(calibration: Path, line: int, change) -> None:
    """Change one line (counted from 1) of a record."""
    file = calibration.with_name(RECORD)
    lines = file.read_text().splitlines(keepends=True)
    lines[line - 1] = change(lines[line - 1])
    file.write_text("".join(lines))


def edited(old: str, new: str):
    """The calibration file with another text in the place of one."""
    return lambda file: edit(file, old, new)


def missing_record(file):
    file.with_name(RECORD).unlink()


def repeated_column(file):
    edit_record(file, 1, lambda line: line.replace("time_s", "response"))


def last_cell(text: str):
    """A record with another text at the end of its line 42."""
    return lambda file: edit_record(file, 42, lambda line: f"{line.rpartition(',')[0]},{text}\n")


def lengths_differ(file):
    short = file.with_name("reference.csv")
    lines = file.with_name(RECORD).read_text().splitlines(keepends=True)
    short.write_text("".join("," + line.partition(",")[2] for line in lines[:1500]))
    edit(file, f'file = "{RECORD}"', f'file = "{RECORD}"\nreference_file = "reference.csv"')


def empty_data_file(file):
    file.with_name(RECORD).write_text("")


def file_cut_in_mid_line(file):
    text = file.with_name(RECORD).read_text()
    file.with_name(RECORD).write_text(text[: text.rindex(",", 0, len(text) // 2) - 3])


SPOILED = {
    "unknown_model": (
        edited('"accelerometer"', '"accelerometr"'),
        ["calibration.toml, [sensor] model", "did you mean 'accelerometer'?"],
    ),
    "missing_record": (missing_record, [RECORD]),
    "missing_column": (edited('"response"', '"respons"'), ["respons", RECORD]),
    "repeated_column": (repeated_column, ["response", RECORD]),
    "text_in_numbers": (last_cell("broken"), ["broken", "line 42"]),
    "nan_in_numbers": (last_cell("nan"), ["nan", RECORD]),
    "nothing_matched": (edited(f'"{RECORD}"', '"nothing*.csv"'), ["nothing*.csv"]),
    "lengths_differ": (lengths_differ, ["1499", "2000"]),
    "rate_of_zero": (edited("rate_hz = 12800.0", "rate_hz = 0.0"), ["rate_hz", "0.0"]),
    "frequency_above_nyquist": (edited("frequency_hz = 100.0", "frequency_hz = 7000.0"), ["7000", "6400"]),
    "unknown_key": (edited("rate_hz", "rate_herz"), ["rate_herz", "rate_hz"]),
    "empty_data_file": (empty_data_file, [RECORD]),
    "file_cut_in_mid_line": (file_cut_in_mid_line, [RECORD, "line"]),
    "invalid_toml": (edited("[response]", "[response"), ["calibration.toml, line"]),
}


@pytest.mark.parametrize("name", SPOILED)
def test_a_spoiled_calibration(name, calibration, run, tmp_path):
    spoil, words = SPOILED[name]
    spoil(calibration)
    done = run("identify", calibration, "--out", tmp_path / "out")
    assert_refused(done, tmp_path / "out", *words)


def test_a_missing_calibration_file(run, tmp_path):
    done = run("identify", tmp_path / "no[where].toml", "--out", tmp_path / "out")
    assert_refused(done, tmp_path / "out", "no[where].toml")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--model", "acelerometer"], ["accelerometer", "did you mean"]),
        (["--model", "accelerometer+dely"], ["delay", "did you mean"]),
        (["--estimator", "mll"], ["auto | ipnn | lsm | ml", "did you mean 'ml'"]),
        (["--uncertainty", "big"], ["auto | noise | inflated"]),
        (["--estimator", "ipnn", "--discretisation", "eular"], ["did you mean 'euler'"]),
        (["--estimator", "ml", "--discretisation", "euler"], ["--discretisation", "--estimator ipnn"]),
        (["--discretisation", "euler"], ["--estimator auto"]),
        (["--estimator", "ipnn", "--steps", "10"], ["--optimiser adam"]),
        (["--estimator", "ipnn", "--optimiser", "adam", "--learning-rate", "-1"], ["--learning-rate"]),
        (["--estimator", "ml", "--weighting", "plain"], ["--estimator lsm"]),
        (["--estimator", "lsm", "--weights"], ["--estimator ipnn"]),
    ],
    ids=" ".join,
)
def test_options_that_do_not_fit(options, words, made, run, tmp_path):
    done = run("identify", made / "calibration.toml", "--out", tmp_path / "out", *options)
    assert_refused(done, tmp_path / "out", *words)


@pytest.mark.parametrize("arguments", [["identify"], ["identify", "a", "b"], ["identify", "--nope"], ["tell"], []])
def test_usage_errors_exit_with_2(arguments, run):
    assert run(*arguments).exit_code == 2


@pytest.mark.parametrize("command", ["predict", "report", "compare"])
@pytest.mark.parametrize("damage", ["cut", "other", "lacking", "missing"])
def test_a_damaged_result(command, damage, identified, made, run, tmp_path):
    text = identified.read_text(encoding="utf-8")
    document = json.loads(text)
    del document["fit"]
    damaged = {"cut": text[: len(text) // 2], "other": '{"schema": "other"}', "lacking": json.dumps(document)}
    file = tmp_path / "result.json"
    if damage != "missing":
        file.write_text(damaged[damage], encoding="utf-8")
    arguments = [file, made / "calibration.toml"] if command == "predict" else [file]
    done = run(command, *arguments, "--out", tmp_path / "out")
    assert_refused(done, tmp_path / "out", str(file))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--sensor", "papper"], ["did you mean 'paper'"]),
        (["--excitation", "sinus"], ["sine"]),
        (["--frequencies", "10-1000"], ["10:1000"]),
        (["--frequencies", "1000:10"], ["1000 to 10", "where:    --frequencies"]),
        (["--frequencies", "10,nan"], ["--frequencies cannot be read", "above 0"]),
        (["--rate", "0"], ["--rate is out of range"]),
        (["--rate", "nan"], ["--rate is out of range"]),
        (["--rate", "1e300"], ["--rate is out of range"]),
        (["--optics", "noise=1"], ["--optics would have no effect", "--interferometer"]),
        (["--interferometer", "quadrature", "--optics", "rate=1"], ["more slowly than the response"]),
        (["--interferometer", "quadrature", "--optics", "noise=nan"], ["--optics noise"]),
        (["--interferometer", "quadrature", "--optics", "bits=40"], ["8 to 16"]),
        (["--interferometer", "quadrature", "--optics", "bits=3"], ["8 to 16"]),
        (["--interferometer", "quadrature", "--optics", "bits=12.7"], ["8 to 16"]),
        (["--interferometer", "quadrature", "--optics", "dropouts=1e9"], ["10000 at most"]),
        (["--interferometer", "quadrature", "--optics", "rate=1e11"], ["too many samples", "--optics rate"]),
        (["--rate", "1500"], ["750"]),
        (["--samples", "2"], ["--samples is out of range"]),
        (["--response-noise", "-1"], ["--response-noise is out of range"]),
        (["--reference-noise", "nan"], ["--reference-noise is out of range"]),
        (["--excitation-snr", "inf"], ["--excitation-snr is out of range"]),
    ],
    ids=" ".join,
)
def test_a_simulation_that_cannot_be(options, words, run, tmp_path):
    assert_refused(run("simulate", "--out", tmp_path / "out", *options), tmp_path / "out", *words)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--scale", "0"], ["--scale is no factor"]),
        (["--scale", "nan"], ["--scale is no factor"]),
        (["--rate", "inf"], ["--rate is out of range"]),
        (["--track"], ["--track would have no effect"]),
    ],
    ids=" ".join,
)
def test_a_table_cannot_be_corrected_so(options, words, identified, run, tmp_path):
    table = tmp_path / "t.csv"
    table.write_text("v\n1\n2\n1\n2\n")
    done = run("correct", identified, table, "--column", "v", "--out", tmp_path / "out", *options)
    assert_refused(done, tmp_path / "out", *words)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--rate", "100"], ["--rate would have no effect", "--format c, fmu"]),
        (["--online"], ["--online would have no effect", "--format c"]),
        (["--channel", "XX.A..BHZ"], ["--channel would have no effect", "stationxml"]),
    ],
    ids=" ".join,
)
def test_an_export_refuses_options_of_other_formats(options, words, identified, run, tmp_path):
    done = run("export", identified, "--format", "csv", "--out", tmp_path / "out", *options)
    assert_refused(done, tmp_path / "out", *words)


@pytest.mark.needs("history")
def test_a_report_refuses_a_store_that_does_not_exist(identified, run, tmp_path):
    store = tmp_path / "none.db"
    done = run("report", identified, "--store", store, "--out", tmp_path / "out")
    assert_refused(done, tmp_path / "out", "no history here")
    assert not store.exists()


def test_words_in_brackets_stand_in_the_help(run):
    """The help is markup, of which [records] would be a style."""
    text = " ".join(run("axes", "--help").output.split())
    assert "has a [[response]] for each output" in text
    assert "axis of the motion in each [[records]] entry" in text


def all_commands(command):
    yield command
    for subcommand in getattr(command, "commands", {}).values():
        yield from all_commands(subcommand)


def test_no_help_loses_words_in_brackets():
    """Every text of every command is printed as it stands, without its escapes."""
    for command in all_commands(typer.main.get_command(app)):
        texts = [command.help, *(getattr(parameter, "help", None) for parameter in command.params)]
        for text in filter(None, texts):
            assert Text.from_markup(text).plain == re.sub(r"\\(?=\[)", "", text), command.name


PLANNED = ["--frequencies", "100:1000", "--model", "accelerometer"]
PLANNED += ["--parameter", "sensitivity=1", "--parameter", "natural_frequency=2e3", "--parameter", "damping_ratio=0.1"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([*PLANNED, "--response-noise", "-1"], ["--response-noise is out of range"]),
        ([*PLANNED, "--magnitude-uncertainty", "nan"], ["--magnitude-uncertainty is out of range"]),
        ([*PLANNED, "--rate", "1e4", "--samples", "1000"], ["--response-noise, --reference-noise"]),
        ([*PLANNED, "--magnitude-uncertainty", "0.01", "--best", "1"], ["where:    --best"]),
        ([*PLANNED, "--rate", "1e3", "--samples", "1000", "--response-noise", "1"], ["--amplitude, --frequencies"]),
        (["--from", "RESULT", "--times-as-long", "0"], ["--times-as-long is out of range"]),
        (["--from", "RESULT", "--mounting-mass", "0"], ["--mounting-mass is out of range"]),
        (["--model", "accelerometr", "--frequencies", "10:1000"], ["where:    --model"]),
    ],
    ids=lambda value: " ".join(value[-2:]),
)
def test_a_plan_that_cannot_be(options, words, identified, run, tmp_path):
    named = [identified if option == "RESULT" else option for option in options]
    assert_refused(run("plan", "--out", tmp_path / "out", *named), tmp_path / "out", *words)


def test_a_used_folder_is_not_simulated_into(run, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    done = run("simulate", "--out", tmp_path)
    assert done.exit_code == 2
    assert "--force" in done.stderr
    assert [file.name for file in tmp_path.iterdir()] == ["notes.txt"]


def test_an_output_that_is_a_file(made, run, tmp_path):
    (tmp_path / "out").write_text("mine")
    done = run("identify", made / "calibration.toml", "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert "is a file" in done.stderr
    assert (tmp_path / "out").read_text() == "mine"


def test_a_form_of_report_that_does_not_exist(identified, run, tmp_path):
    done = run("report", identified, "--out", tmp_path / "out", "--format", "docx")
    assert_refused(done, tmp_path / "out", "'docx'", "html | pdf | md")
    done = run("report", identified, "--out", tmp_path / "out" / "report.pdf", "--format", "html")
    assert_refused(done, tmp_path / "out", "report.pdf", "a folder")


def test_a_prediction_in_another_unit(calibration, identified, run, tmp_path):
    edit(calibration, 'unit = "V"', 'unit = "mV"')
    done = run("predict", identified, calibration, "--out", tmp_path / "out")
    assert_refused(done, tmp_path / "out", '"mV"', '"V"')


def test_a_prediction_for_a_table(identified, run, tmp_path):
    (tmp_path / "frf.csv").write_text("f,m\n1,1\n2,1\n3,1\n4,1\n")
    (tmp_path / "table.toml").write_text('[table]\nfile = "frf.csv"\nfrequency = 1\nmagnitude = 2\n')
    done = run("predict", identified, tmp_path / "table.toml", "--out", tmp_path / "out")
    assert_refused(done, tmp_path / "out", "[table]")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["CAL", "RESULT"], ["one calibration file"]),
        (["CAL", "--estimators", "ml,foo"], ["ipnn | lsm | ml"]),
        (["CAL", "--estimators", ","], ["joined by commas"]),
        (["CAL", "--estimators", "ml", "--discretisations", "euler"], ["--estimators with ipnn"]),
        (["CAL", "--models", "nope"], ["accelerometer"]),
        (["CAL", "--truth", "CAL"], ["truth.json"]),
        (["RESULT", "--models", "accelerometer"], ["results, which exist already"]),
    ],
    ids=lambda value: " ".join(value),
)
def test_comparisons_that_cannot_be(arguments, words, made, identified, run, tmp_path):
    files = {"CAL": made / "calibration.toml", "RESULT": identified}
    done = run("compare", *(files.get(argument, argument) for argument in arguments), "--out", tmp_path / "out")
    assert_refused(done, tmp_path / "out", *words)


@pytest.mark.parametrize(
    ("option", "value"), [("--port", "-1"), ("--port", "65536"), ("--limit-mb", "0"), ("--limit-mb", "nan")]
)
def test_a_page_that_cannot_be(option, value, run, tmp_path):
    assert_refused(run("serve", option, value), tmp_path / "out", f"{option} is out of range", "a number from", option)


def test_a_calibration_file_in_the_place_of_a_result(made, identified, run, tmp_path):
    done = run("correct", made / "calibration.toml", identified, "--out", tmp_path / "out")
    assert_refused(done, tmp_path / "out", "A result is needed here", "calibration.toml", "the result first")
