"""`vibrident track`: every source gives the same end; a session that is killed goes on; bad input is one message."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from tests.support.lives import calibrated
from tests.support.random_record import RATE_HZ, TRUTH
from tests.support.shell import printed, run
from tests.support.tracked import answered, motion

from vibrident import Calibration, Result, identify

SAMPLES = 20000
TEXT = """[sensor]
model = "accelerometer"
[reference]
column = 2
[response]
column = 3
[sampling]
rate_hz = 20000.0
time_column = 1
[[records]]
file = "{file}"
excitation = "random"
"""
STAMPED = TEXT.replace("rate_hz = 20000.0\n", "") + "rate_hz = 20000.0\n"


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """A result, and a record whose sensitivity changes by 1 % in its middle."""
    folder = tmp_path_factory.mktemp("track")
    rng = np.random.default_rng(1)
    u = motion("random", 8000, rng)
    y = answered(u) + 1e-3 * rng.normal(size=len(u))
    identify(Calibration.from_arrays(u, y, RATE_HZ, excitation="random")).save(folder / "result.json")
    u = motion("random", SAMPLES, rng)
    y = np.where(np.arange(SAMPLES) < SAMPLES // 2, answered(u), answered(u, {**TRUTH, "sensitivity": 0.101}))
    table = np.column_stack([np.arange(SAMPLES) / RATE_HZ, u, y + 1e-3 * rng.normal(size=SAMPLES)])
    np.savetxt(folder / "record.csv", table, delimiter=",", fmt="%.10g", header="t,ref,resp", comments="")
    (folder / "cal.toml").write_text(TEXT.format(file="record.csv").replace("time_column = 1\n", ""))
    (folder / "stream.toml").write_text(STAMPED.format(file="growing.csv"))
    return folder, table


def track(case, name, *more, cal="cal.toml", result="result.json", given=()):
    """The command in this process; ``given`` are the pieces that come by standard input."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("vibrident.data.sources.kinds.stdin._pieces", lambda: iter(given))
        return run(*arguments(case, name, *more, cal=cal, result=result))


def arguments(case, name, *more, cal, result="result.json"):
    folder = case[0]
    files = (str(folder / result), str(folder / cal), "--out", str(folder / name))
    return ["track", *files, "--no-pictures", "--every", "0.1", *more]


def shell(case, name, *more, cal):
    return [sys.executable, "-m", "vibrident", *arguments(case, name, *more, cal=cal)]


def written(case, name):
    return json.loads((case[0] / name / "track.json").read_text()), (case[0] / name / "track.csv").read_text()


def done(case, name, *more, **given):
    ran = track(case, name, *more, **given)
    assert ran.exit_code == 0, ran.output
    return written(case, name)


@pytest.fixture(scope="module")
def whole(case):
    return done(case, "whole")


def same(one, two):
    for name in TRUTH:
        for key in ("value", "standard_uncertainty"):
            assert one["parameters"][name][key] == pytest.approx(two["parameters"][name][key], rel=1e-6)
    named = [(a["parameter"], a["what"], round(a["time_s"], 3)) for a in one["alarms"]]
    assert named == [(a["parameter"], a["what"], round(a["time_s"], 3)) for a in two["alarms"]]


def test_records_give_rows_parameters_and_the_alarm(whole):
    document, rows = whole
    lines = rows.splitlines()
    assert lines[0].split(",")[:3] == ["time_s", "sensitivity", "sensitivity_u"]
    assert lines[0].split(",")[-2:] == ["innovation", "excited"]
    assert len(lines) == 1 + SAMPLES / RATE_HZ / 0.1 + 1  # one each 0.1 s, and the end
    (alarm,) = document["alarms"]
    assert (alarm["parameter"], alarm["what"]) == ("sensitivity", "gain")
    assert abs(alarm["to"] - 0.101) < 5.0 * alarm["u"]
    found = document["parameters"]["sensitivity"]
    assert abs(found["value"] - 0.101) < 5.0 * found["standard_uncertainty"]


@pytest.mark.needs("history")
def test_the_end_is_a_result_that_other_commands_take(case, whole):
    folder = case[0]
    result = Result.load(folder / "whole" / "result.json")
    assert result.estimator == "tracked"
    for name in TRUTH:
        assert result.parameters[name].value == pytest.approx(whole[0]["parameters"][name]["value"], rel=1e-12)
    store = ("--store", f"sqlite:///{folder / 'history.sqlite'}")
    printed("history", "add", folder / "whole" / "result.json", "--serial", "4711", *store)
    assert '"tracked"' in printed("history", "show", "4711", "--quantity", "sensitivity", "--format", "json", *store)


def test_standard_input_gives_the_same_in_either_form(case, whole):
    text = (case[0] / "record.csv").read_bytes()
    ran = subprocess.run(shell(case, "csv", "--stdin", "csv", cal="cal.toml"), input=text, capture_output=True)
    assert ran.returncode == 0, ran.stderr.decode()
    same(written(case, "csv")[0], whole[0])
    raw = case[1].astype("<f4").tobytes()
    same_float = done(case, "raw", "--stdin", "float32", given=[raw])[0]
    for name in TRUTH:
        u = whole[0]["parameters"][name]["standard_uncertainty"]
        assert abs(same_float["parameters"][name]["value"] - whole[0]["parameters"][name]["value"]) < 0.2 * u


def test_a_killed_session_goes_on_and_says_nothing_twice(case, whole):
    lines = (case[0] / "record.csv").read_text().splitlines(keepends=True)
    growing = case[0] / "growing.csv"
    growing.write_text("".join(lines[:14000]) + lines[14000][:7])  # within a line, behind the alarm
    running = subprocess.Popen(
        shell(case, "killed", "--follow", cal="stream.toml"), stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    state = case[0] / "killed" / "track.state"
    for _ in range(600):
        if state.exists():
            break
        time.sleep(0.1)
    time.sleep(0.2)
    os.kill(running.pid, signal.SIGKILL)
    running.communicate()
    with growing.open("a") as stream:
        stream.write(lines[14000][7:] + "".join(lines[14001:]))
    with (case[0] / "killed" / "track.csv").open("a") as stream:
        stream.write("what was half writt")
    document, rows = done(case, "killed", "--follow", "--idle", "0.3", cal="stream.toml")
    same(document, whole[0])
    assert len(document["alarms"]) == 1
    assert len(rows.splitlines()) == len(whole[1].splitlines())
    assert document["samples"]["taken"] == SAMPLES


def test_chunks_that_are_lost_or_doubled_are_named(case):
    lines = (case[0] / "record.csv").read_text().splitlines(keepends=True)
    given = "".join([*lines[:5000], *lines[4000:7000], *lines[8000:10000], *lines[2000:2500], *lines[10000:]])
    document, _ = done(case, "broken", "--stdin", "csv", cal="stream.toml", given=[given.encode()])
    samples = document["samples"]
    assert (samples["lost"], samples["doubled"], samples["late"]) == (1000, 1000, 500)
    assert samples["taken"] == SAMPLES - 1000
    assert [trouble["what"] for trouble in document["troubles"]] == ["doubled", "lost", "late"]
    assert [alarm["parameter"] for alarm in document["alarms"]] == ["sensitivity"]


@pytest.mark.parametrize(
    ("more", "given", "said"),
    [
        (["--stdin", "csv"], b"1,2,3\n1,x,3\n", "cannot be read"),
        (["--stdin", "xml"], b"", "form of the samples"),
        (["--source", "nothing"], b"", "not known"),
        (["--stdin", "csv", "--follow"], b"", "More than one source"),
        (["--false-alarms-per-day", "0"], b"", "out of range"),
        (["--follow"], b"", "cannot be followed"),
    ],
)
def test_bad_input_is_one_message(case, more, given, said, tmp_path):
    cal = "cal.toml"
    if more == ["--follow"]:
        cal = "missing.toml"
        (case[0] / cal).write_text(STAMPED.format(file="missing.csv"))
    ran = track(case, tmp_path.name, *more, cal=cal, given=[given])
    assert ran.exit_code == 2
    assert said in ran.stderr
    assert "Traceback" not in ran.stderr


def test_tracking_needs_neither_jax_nor_matplotlib():
    code = "import vibrident.use.tracking.session, sys; print([m for m in ('jax', 'matplotlib') if m in sys.modules])"
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "[]"


@pytest.mark.needs("history")
def test_u_of_what_is_not_excited_grows_by_the_random_walk_of_the_history(case, tmp_path):
    """Five years between the certificate's time and the motion's, at rest: u² grows by five times the walk's square."""
    from vibrident.lab.histories import History
    from vibrident.lab.history.document import random_walks
    from vibrident.lab.history.store import Store

    result = replace(Result.load(case[0] / "result.json"), sensor=calibrated().sensor)
    result.save(case[0] / "named.json")
    lives = [
        replace(calibrated(0.1 * (1.0 + step), f"{2015 + year}-01-01", noise=1e-4, shared={}), provenance={})
        for year, step in enumerate((0.0, 0.02, 0.0, 0.025, 0.005, 0.03))
    ]
    store = str(tmp_path / "h.db")
    with History(store) as history:
        history.add(lives)
    with Store(store) as opened:
        walks = random_walks(opened, result)
    assert walks.keys() == {"sensitivity", "natural_frequency"}
    assert 0.01 < walks["sensitivity"] < 0.05
    years = 365.25 * 86400.0 * np.array([0.0, 5.0])
    rows = np.column_stack([np.repeat(years, 100) + np.tile(np.arange(100) / RATE_HZ, 2), np.zeros((200, 2))])
    text = "\n".join(",".join(map(repr, row)) for row in rows.tolist())
    (case[0] / "named.toml").write_text(STAMPED.format(file="none.csv"))
    given = {"result": "named.json", "cal": "named.toml", "given": [text.encode()]}
    ran = track(case, "walk", "--stdin", "csv", "--store", store, **given)
    assert "no random walk of damping_ratio: 1% a year" in ran.stderr
    found = json.loads((case[0] / "walk" / "track.json").read_text())["parameters"]["sensitivity"]
    first = result.parameters["sensitivity"]
    grown = np.sqrt(found["standard_uncertainty"] ** 2 - first.standard_uncertainty**2) / found["value"]
    assert grown == pytest.approx(walks["sensitivity"] * np.sqrt(5.0), rel=0.01)
