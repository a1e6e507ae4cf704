"""``vibrident report`` in each form, and the way of [certificate] from the calibration file into the certificate."""

import json
from dataclasses import replace

import numpy as np
import pytest
from tests.support import shell
from tests.support.printed import CERTIFICATE, later

import vibrident
from vibrident.base.nominal import nominal_frequencies
from vibrident.data.io import read
from vibrident.data.io.writer import write_calibration
from vibrident.result import Result
from vibrident.show import certificate, certificate_tables

pytestmark = pytest.mark.usefixtures("unpainted")


def run(*arguments):
    return shell.run("report", *arguments)


def shown(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


@pytest.fixture
def two(tmp_path):
    results = [later(1, 1.0, "2021-03-01"), later(2, 1.001, "2023-03-01")]
    return [result.save(tmp_path / name / "result.json") for result, name in zip(results, "ab", strict=True)]


@pytest.mark.parametrize(("form", "file"), [("html", "report.html"), ("pdf", "certificate.pdf")])
def test_one_result(two, tmp_path, form, file):
    assert run(two[0], "--format", form).exit_code == 0
    assert shown(tmp_path / "a") == sorted([file, "result.json"])
    done = run(two[0], "--format", form, "--out", tmp_path / "new")
    assert done.exit_code == 0, done.output
    assert file in done.stdout
    assert shown(tmp_path / "new") == [file]


def test_several_results(two, tmp_path, monkeypatch):
    done = run(*two, "--format", "pdf", "--out", tmp_path / "all")
    assert done.exit_code == 0, done.output
    assert shown(tmp_path / "all") == ["a/certificate.pdf", "b/certificate.pdf", "comparison.pdf"]
    monkeypatch.chdir(tmp_path)
    assert run(*two, "--format", "html").exit_code == 0
    assert shown(tmp_path / "vibrident-comparison") == ["comparison.html"]
    comparison = tmp_path / "vibrident-comparison" / "comparison.html"
    assert "Comparison of 2" in comparison.read_text(encoding="utf-8")
    assert (tmp_path / "b" / "report.html").is_file()


def test_nothing_is_half_written(two, tmp_path):
    (tmp_path / "bad.json").write_text("{}")
    done = run(*two, tmp_path / "bad.json", "--format", "html", "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert "bad.json" in done.stderr
    assert not (tmp_path / "out").exists()


def test_an_old_result_without_a_certificate_still_loads(two):
    document = json.loads(two[0].read_text(encoding="utf-8"))
    del document["certificate"]
    old = Result.from_dict(document)
    assert old.certificate == {}
    assert certificate.letterhead(old).number is None


def test_from_the_calibration_file_to_the_certificate(tmp_path):
    stated = {**CERTIFICATE, "reference_frequency_hz": 159.155}
    calibration = vibrident.simulate(
        "paper", frequencies_hz=[100.0, 200.0, 400.0, 630.0, 800.0], sampling_rate_hz=12800.0, samples=2000, seed=3
    )
    file = write_calibration(tmp_path, replace(calibration, certificate=stated))
    result = vibrident.identify(read(file))
    result.save(tmp_path / "result.json")
    again = Result.load(tmp_path / "result.json")

    assert json.loads(json.dumps(dict(again.certificate))) == stated
    assert certificate.letterhead(again).number == CERTIFICATE["number"]
    assert certificate_tables.reference(again).rows[0][1] == "159.155 Hz; as stated"
    grid = np.array(again.response.frequency_hz)
    assert 159.155 in grid
    assert (
        " ".join(row[0] for row in certificate_tables.sensitivity(again).rows)
        == "100 125 160 200 250 315 400 500 630 800"
    )
    for item in nominal_frequencies(100.0, 800.0, again.measured.frequency_hz):
        assert item.frequency_hz in grid
        assert item.frequency_hz == item.nominal_hz  # the data were taken at nominal values


def test_results_are_called_by_what_tells_them_apart(two, tmp_path):
    for folder in "ab":
        (tmp_path / folder / "out").mkdir()
        (tmp_path / folder / "result.json").rename(tmp_path / folder / "out" / "result.json")
    files, page = [tmp_path / folder / "out" / "result.json" for folder in "ab"], ("--format", "html", "--out")
    done = run(*files, *page, tmp_path / "beside")
    assert done.exit_code == 0, done.output
    assert {path.name for path in (tmp_path / "beside").iterdir() if path.is_dir()} == {"a", "b"}
    same = run(files[0], files[0], *page, tmp_path / "same")
    assert {path.name for path in (tmp_path / "same").iterdir() if path.is_dir()} == {"result-1", "result-2"}, same
