"""Every command and program of README and pages runs, and prints what the page says that it prints."""

from __future__ import annotations

import re
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from docsite.made import MADE_PAGES
from tests.support.printed import later
from tests.support.sample_results import table2
from tests.support.shell import printed, run
from tests.support.sources import ROOT

import vibrident
from vibrident.data.io import write_calibration
from vibrident.physics.simulation import simulate

SENSOR = (
    "accelerometer+delay",
    {"sensitivity": 0.104, "natural_frequency": 652.0, "damping_ratio": 0.182, "delay": 2e-5},
)
SINES_HZ = [63.1, 251.0, 631.0, 1010.0]
#: What installs, compiles, serves until it is stopped, or needs a cluster; tests of its own hold each.
NOT_RUN = ("pip ", "make ", "dask ", "vibrident serve", "vibrident fleet calibrations/ --out fleet --scheduler")
#: Pages whose programs are held elsewhere: those of a plug-in need a package around them (tests/base/registry).
ELSEWHERE = {"plug-ins.md", *MADE_PAGES}


class Block(NamedTuple):
    """Fenced block of a page: its language, its text, and what stands between it and the one before."""

    language: str
    text: str
    before: str


def batched(parts: list[str]) -> zip[tuple[str, str, str]]:
    return zip(parts[::3], parts[1::3], parts[2::3], strict=True)


def blocks(page: Path) -> list[Block]:
    parts = re.split(r"^```(\w+)[^\n]*\n(.*?)^```$", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    return [Block(language, text, before) for before, language, text in batched(parts[:-1])]


def commands(text: str) -> list[list[str]]:
    """The commands of a block, without those that are not run."""
    lines = text.replace("\\\n", " ").splitlines()
    return [shlex.split(line, comments=True) for line in lines if line and not line.startswith(NOT_RUN)]


def shown_command(before: str) -> list[list[str]]:
    """The command that the last paragraph before an output begins with, if it does."""
    paragraph = before.strip().split("\n\n")[-1]
    command = re.match(r"`(vibrident \w+ [^`]+)`", paragraph)
    return commands(command[1]) if command else []


def words(text: str) -> str:
    """The words of a text, as the terminal wraps its lines where it ends; a ruled line is none."""
    return " ".join(text.replace("─", " ").split())


def assert_shown(expected: str, output: str) -> None:
    """Each line is printed, in this order; ``…`` at its end stands for all that follows."""
    shown = f" {words(output)} "
    for line in expected.splitlines():
        wanted = words(line.rstrip("… "))
        place = shown.find(f" {wanted} ") if wanted else 0
        assert place >= 0, f"{wanted!r} is not printed, or not there: {output}"
        shown = shown[place + len(wanted) :]


def of_sines(samples: int = 2000, **more: Any) -> vibrident.Calibration:
    shape = {"sampling_rate_hz": 10e3, "samples": samples, "start": "steady", "response_noise": 0.01, "seed": 4}
    return simulate(SENSOR, frequencies_hz=SINES_HZ, **shape | more)


def at_random(sampling_rate_hz: float, samples: int) -> vibrident.Record:
    shape = {"sampling_rate_hz": sampling_rate_hz, "samples": samples, "response_noise": 1e-3}
    return simulate(SENSOR, "random", seed=3, **shape).records[0]


def calibration_in(folder: Path, calibration: vibrident.Calibration, name: str) -> None:
    """Write a calibration whose file has a name of its own."""
    write_calibration(folder, calibration).rename(folder / name)


def numbered_results(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A store with eleven calibrations of the sensor 4711, and the result of another."""
    monkeypatch.setenv("VIBRIDENT_STORE", str(folder / "store.db"))
    (folder / "out").mkdir()
    for number in range(11):
        path = later(number + 2, 1.0 + 1e-4 * number, f"{2012 + number}-05-01").save(folder / f"{number}.json")
        printed("history", "add", path)
    undated = replace(later(20, 1.001, "2024-05-01"), certificate={})
    undated.save(folder / "out" / "result.json")


@pytest.fixture
def given(request, tmp_path, monkeypatch) -> dict[str, Any]:
    """The folder that a page supposes, and its names."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "76")
    result = table2()
    known = {"vibrident": vibrident, "np": np, "result": result, "first": result, "second": result, "results": [result]}
    page = request.node.callspec.params["page"]
    if page.name in ("README.md", "python.md"):
        write_calibration(tmp_path, of_sines())
    if page.name == "correct.md":
        walked(ROOT / "docs" / "guide.md", {})
        response = vibrident.read("mine/calibration.toml").records[0].response
        np.savetxt("table.csv", response, header="V", comments="")
    if page.name == "fleet.md":
        for folder in ("calibrations/1", "calibrations/2", "day/2026-05"):
            calibration_in(tmp_path / folder, of_sines(), "cal.toml" if "day" in folder else "calibration.toml")
        calibration_in(tmp_path, of_sines(), "month.toml")
    if page.name == "history.md":
        numbered_results(tmp_path, monkeypatch)
    if page.name == "joint.md":
        calibration_in(tmp_path, of_sines(), "sine.toml")
        calibration_in(tmp_path, simulate(SENSOR, "shock", response_noise=1e-3, seed=5), "shock.toml")
    if page.name == "known-responses.md":
        frequency_hz = np.geomspace(5.0, 25e3, 40)
        records = simulate(
            SENSOR, "random", sampling_rate_hz=51200.0, samples=4000, response_noise=1e-3, seed=3
        ).records
        flat = {"magnitude": np.ones(40), "phase_rad": np.zeros(40), "u": np.full(40, 1e-3)}
        known |= {"frequency_hz": frequency_hz, "reference_v": records[0].reference, "response_v": records[0].response}
        known |= flat
    if page.name == "tracking.md":
        vibrident.identify(of_sines()).save(tmp_path / "result.json")
        record = simulate(SENSOR, "random", sampling_rate_hz=20e3, samples=50000, response_noise=1e-3, seed=3).records[
            0
        ]
        known["blocks"] = zip(np.split(record.reference, 5), np.split(record.response, 5), strict=True)
    return known


def walked(page: Path, given: dict[str, Any], capsys: pytest.CaptureFixture[str] | None = None) -> None:
    """Run all that a page shows, in the working directory."""
    output = ""
    for language, text, before in blocks(page):
        if language == "toml" and "calibration.toml" in before:
            Path("mine/calibration.toml").write_text(text, encoding="utf-8")
        if language == "python":
            exec(compile(text, page.name, "exec"), given)
            output = capsys.readouterr().out if capsys else ""
        elif language == "sh":
            output = "".join(printed(*command[1:]) for command in commands(text))
        elif language == "text":
            shown = shown_command(before)
            if shown:
                output = "".join(printed(*command[1:]) for command in shown)
            elif before.strip():
                continue  # an example of what other data print
            assert_shown(text, output)


NEEDS = {"report.md": "report", "history.md": "history", "fleet.md": "fleet", "guide.md": "report"}
PAGES = [
    pytest.param(page, id=page.name, marks=[pytest.mark.needs(NEEDS[page.name])] if page.name in NEEDS else [])
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    if page.name not in ELSEWHERE and {block.language for block in blocks(page)} & {"sh", "python"}
]


@pytest.mark.parametrize("page", PAGES)
def test_what_a_page_shows_is_what_it_does(page, given, capsys):
    if page.name == "README.md":
        Path("out").mkdir()
    walked(page, given, capsys)


def test_the_error_that_the_guide_shows_is_printed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "76")
    first, description, error, *_ = (block for block in blocks(ROOT / "docs" / "guide.md"))
    for command in commands(first.text):
        printed(*command[1:])
    misspelt = description.text.replace('column = "response"', 'column = "respons"')
    Path("mine/calibration.toml").write_text(misspelt, encoding="utf-8")
    assert_shown(error.text, run("identify", "mine/calibration.toml", "--out", "out").output)
