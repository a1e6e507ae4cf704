"""A fleet of good, broken and deadly calibrations: every one has its row, and none is computed twice."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from tests.support.fleets import BROKEN, broken, deadly, fleet, good

import vibrident
from vibrident.base.errors import InputError
from vibrident.base.process import ProcessDied, ProcessEnded, _Child
from vibrident.lab.fleet import Orders, key, parts
from vibrident.lab.fleet.batch import Identifier
from vibrident.result import Result

GOOD = 6
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the names and pipes of this fleet are none of Windows")
HOSTILE = ("a\nb", '\'; DROP "x" <script>alert(1)</script>', "-o", "ключ 鍵", os.fsdecode(b"\xff\xfe"))
FAILED = {"segfault": "signal 11", "exits": "status 7", "hungry": "memory", "hangs": "too long"}


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("fleet") / "data"
    fleet(folder / "good", GOOD)
    broken(folder / "broken")
    deadly(folder / "deadly", *FAILED)
    for number, name in enumerate(HOSTILE):
        good(folder / "hostile" / name, 700 + number, type_='<b>\\"type\\"</b>\\u202e')
    shutil.copytree(folder / "good" / "s000", folder / "same" / "again")
    (folder / "same" / "dangling").mkdir()
    (folder / "same" / "dangling" / "c.toml").symlink_to("nowhere")
    (folder / "same" / "pipe").mkdir()
    os.mkfifo(folder / "same" / "pipe" / "c.toml")
    (folder / "pyproject.toml").write_text("[project]\nname = 'x'\n")
    return folder


@pytest.fixture(scope="module")
def outcome(data, deadly_site, run_fleet):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("vibrident.lab.fleet.batch._ATTEMPTS_ALONE", 0)  # each try is a process that has to start
        return run_fleet([data], data.parent / "out", workers=2, time_limit_s=4.0)


@pytest.fixture(scope="module")
def table(outcome, rows) -> dict[str, dict]:
    return {Path(row["calibration"]).parent.name: row for row in rows(outcome.files[0].parent)}


def test_every_calibration_has_one_row(table, outcome):
    assert outcome.tally.rows == len(table) == GOOD + len(BROKEN) + len(FAILED) + len(HOSTILE) + 3
    assert outcome.left_out == 1


def test_the_columns_are_those_agreed(outcome):
    names = pq.read_schema(outcome.files[0]).names
    assert names[:8] == ["calibration", "key", "status", "message", "serial_number", "type", "model", "estimator"]
    assert names[-4:] == ["adequate", "chi2_reduced", "warnings", "seconds"]
    assert names[8:-4:2] == [name.removesuffix("_u") for name in names[9:-4:2]]
    assert names[8:14:2] == ["sensitivity", "natural_frequency", "damping_ratio"]


def test_a_row_says_what_identify_says(table, data, outcome):
    for name in ("s001", "s002", HOSTILE[0]):
        row = table[name]
        result = vibrident.identify(vibrident.read(next(data.rglob(f"{name}/c.toml"))))
        assert row["status"] == "identified"
        assert row["serial_number"] == result.sensor["serial_number"]
        for parameter, one in result.parameters.items():
            assert (row[parameter], row[f"{parameter}_u"]) == (one.value, one.standard_uncertainty)
        assert row["chi2_reduced"] == result.fit.chi2_reduced
        assert (row["adequate"], row["warnings"]) == (result.fit.adequate, list(result.warning_codes))
        whole = Result.load(outcome.folder / f"{row['key']}.json")
        assert whole.parameters == result.parameters


@pytest.mark.parametrize("way", BROKEN)
def test_what_is_refused_says_why(table, way):
    row = table[way]
    assert row["status"] == "refused"
    assert BROKEN[way][1] in row["message"]
    for label in ("expected:", "found:", "where:", "remedy:"):
        assert label in row["message"]
    assert row["sensitivity"] is None
    assert row["warnings"] == []


@pytest.mark.parametrize("way", FAILED)
def test_what_ends_its_process_is_a_row_and_takes_no_other_along(table, way):
    assert table[way]["status"] == "failed"
    assert FAILED[way] in table[way]["message"]


def test_what_is_no_file_is_refused_and_waited_for_by_nobody(table):
    assert "no file of that name" in table["dangling"]["message"]
    assert "not a regular file" in table["pipe"]["message"]


def test_the_same_content_under_two_names_is_computed_once(table, outcome):
    first, again = dict(table["s000"]), dict(table["again"])
    assert first.pop("calibration") != again.pop("calibration")
    assert first == again
    assert outcome.computed == outcome.tally.rows - 1


def test_the_page_shows_text_as_text_and_asks_for_nothing(outcome, table):
    page = outcome.files[1].read_text(encoding="utf-8")
    assert "<script>alert" not in page
    assert "<b>&quot;type" not in page
    assert "&lt;b&gt;&quot;type&quot;" in page
    assert "http" not in page.replace("http-equiv", "").replace("http://www.w3.org/2000/svg", "")
    for status, number in outcome.tally.statuses.items():
        assert f"{number}</b>" in page, status
    for way in BROKEN:
        assert f"broken/{way}/c.toml" in page


def test_the_same_command_again_computes_nothing(data, outcome, run_fleet, rows, hashed_here):
    out = outcome.files[0].parent
    before = rows(out)
    again = run_fleet([data], out, time_limit_s=4.0)
    assert again.computed == 0
    assert rows(out) == before
    assert again.tally.statuses == outcome.tally.statuses


def test_only_what_changed_is_done_anew(tmp_path, run_fleet, rows, here, pageless):
    fleet(tmp_path / "data", 4)
    first = run_fleet([tmp_path / "data"], tmp_path / "out")
    assert first.computed == 4
    before = {row["calibration"]: row for row in rows(tmp_path / "out")}
    changed = tmp_path / "data/s002/frf.csv"
    stamp = changed.stat()
    changed.write_text(changed.read_text().replace("0.01", "0.02"))
    os.utime(changed, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    Path(first.folder / f"{before[str(tmp_path / 'data/s000/c.toml')]['key']}.json").unlink()
    (tmp_path / "data/s003/c.toml").unlink()
    second = run_fleet([tmp_path / "data"], tmp_path / "out")
    assert second.computed == 2  # changed, and without its whole result
    after = {row["calibration"]: row for row in rows(tmp_path / "out")}
    assert len(after) == 3
    assert {name for name in after if after[name]["key"] != before[name]["key"]} == {str(changed.with_name("c.toml"))}
    assert run_fleet([tmp_path / "data"], tmp_path / "out", results=False).computed == 0
    assert run_fleet([tmp_path / "data"], tmp_path / "out", model="accelerometer+delay").computed == 3
    assert run_fleet([tmp_path / "data"], tmp_path / "out", fresh=True).computed == 3
    assert len(list((tmp_path / "out/results").iterdir())) == 3


def test_a_wider_limit_tries_again_what_failed_and_nothing_else(
    tmp_path, deadly_site, run_fleet, pageless, hashed_here
):
    deadly(tmp_path / "data", "slow")
    first = run_fleet([tmp_path / "data"], tmp_path / "out", time_limit_s=0.01)
    assert first.tally.statuses == {"failed": 1}
    assert run_fleet([tmp_path / "data"], tmp_path / "out", time_limit_s=0.01).computed == 0
    second = run_fleet([tmp_path / "data"], tmp_path / "out", time_limit_s=60.0)
    assert (second.computed, second.tally.statuses) == (1, {"identified": 1})
    assert run_fleet([tmp_path / "data"], tmp_path / "out", time_limit_s=0.01).computed == 0


def test_the_coordinator_hashes_nothing_itself_while_its_workers_live(tmp_path, run_fleet, monkeypatch, pageless):
    fleet(tmp_path / "data", 2)
    done: list[str] = []
    whole = key.fingerprint
    monkeypatch.setattr(key, "fingerprint", lambda path, orders: done.append(path) or whole(path, orders))
    assert run_fleet([tmp_path / "data"], tmp_path / "out").tally.statuses == {"identified": 2}
    assert not done
    monkeypatch.setattr(Identifier, "fingerprints", died)
    assert run_fleet([tmp_path / "data"], tmp_path / "out").computed == 0
    assert len(done) == 2


def died(*_: object) -> None:
    raise ProcessDied("crash", "a process that somebody killed")


def test_a_worker_that_somebody_kills_costs_no_row(tmp_path, run_fleet, monkeypatch, pageless, hashed_here):
    fleet(tmp_path / "data", 4)
    victims, answer = ["s001", "s003"], _Child.answer

    def killed_once(child, call, *rest):
        if call["name"].endswith(":identified") and (folder := Path(call["args"][0][0]).parent.name) in victims:
            victims.remove(folder)
            child.popen.kill()
        return answer(child, call, *rest)

    monkeypatch.setattr(_Child, "answer", killed_once)
    outcome = run_fleet([tmp_path / "data"], tmp_path / "out")
    assert not victims
    assert outcome.tally.statuses == {"identified": 4}


def test_a_process_that_is_ended_while_it_starts_is_given_no_calibration(tmp_path, monkeypatch):
    process, begin = Identifier(Orders(str(tmp_path))), subprocess.Popen

    def ended_meanwhile(*arguments, **options):
        process.end()
        return begin(*arguments, **options)

    monkeypatch.setattr("vibrident.base.process.subprocess.Popen", ended_meanwhile)
    with pytest.raises(ProcessEnded):
        process.identify([("c.toml", "key")])
    assert not process._process.alive


def test_a_full_disk_is_said_and_what_is_there_stays(tmp_path, run_fleet, here, monkeypatch, pageless):
    fleet(tmp_path / "data", 3)
    whole = parts.write_part

    def full(folder, rows, *limits):
        if list(folder.glob("*.parquet")):
            raise OSError(28, "No space left on device")
        return whole(folder, rows, *limits)

    monkeypatch.setattr("vibrident.lab.fleet.batch.write_part", full)
    with pytest.raises(InputError, match="No space left"):
        run_fleet([tmp_path / "data"], tmp_path / "out")
    assert not (tmp_path / "out/fleet.parquet").exists()
    monkeypatch.setattr("vibrident.lab.fleet.batch.write_part", whole)
    assert run_fleet([tmp_path / "data"], tmp_path / "out").computed < 3


def test_a_folder_that_cannot_be_written_is_refused(tmp_path, run_fleet):
    fleet(tmp_path / "data", 1)
    (tmp_path / "out").write_text("a file")
    with pytest.raises(InputError, match="is a file"):
        run_fleet([tmp_path / "data"], tmp_path / "out")


def test_patterns_are_files_folders_and_globs_and_each_file_counts_once(tmp_path, run_fleet, here, pageless):
    folder = fleet(tmp_path / "data", 3)
    patterns = [folder / "s001/c.toml", folder, folder / "s*/c.toml", Path(f"{folder}/../data/s002/c.toml")]
    assert run_fleet(patterns, tmp_path / "out", results=False).tally.rows == 3
    for nothing in (tmp_path / "none.toml", tmp_path / "x*.toml", tmp_path / "out"):
        with pytest.raises(InputError, match="No calibration file"):
            run_fleet([folder, nothing], tmp_path / "out2")
