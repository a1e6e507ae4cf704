"""The folder of one user: names, room, and whose the calibration file is."""

from __future__ import annotations

from pathlib import Path

import pytest

from vibrident.app.web.session import CALIBRATION, MAX_RESULTS, PageSession, refuse_outside, safe_name
from vibrident.base.errors import InputError

TOML = """[reference]
column = 1

[response]
column = 2

[sampling]
rate_hz = 1000.0

[[records]]
file = "{file}"
excitation = "random"
"""


@pytest.fixture
def session(tmp_path):
    made = PageSession(tmp_path, 1.0)
    assert not list(tmp_path.iterdir()), "a page without files costs a folder"
    yield made
    made.close()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "safe"),
    [
        ("../x.csv", "x.csv"),
        ("..\\..\\x.csv", "x.csv"),
        ("/etc/passwd", "passwd"),
        ("C:\\data\\10 Hz.csv", "10 Hz.csv"),
        ("C:x.csv", "C_x.csv"),
        ("a\x00b\nc\x1b[31m.csv", "a_b_c_31m.csv"),
        ("x\u202evsc.csv", "x_vsc.csv"),
        ("*?.csv", "_.csv"),
        ("", "file"),
        ("..", "file"),
        (" . ", "file"),
        ("-rf.csv", "_-rf.csv"),
        ("NUL.csv", "_NUL.csv"),
        ("com1", "_com1"),
        ("Stoß 1µm.csv", "Stoß 1µm.csv"),
    ],
)
def test_a_name_stays_in_its_folder(name, safe):
    assert safe_name(name) == safe


def test_a_long_name_is_cut_and_keeps_its_ending():
    assert len(safe_name("x" * 300 + ".csv")) == 120
    assert safe_name("x" * 300 + ".csv").endswith("x.csv")
    assert len(safe_name("a." + "x" * 300)) == 120


def test_what_is_no_data_what_is_there_and_what_has_no_room_is_refused(session):
    with pytest.raises(InputError, match="format is not known"):
        session.reserve_path("data.npy", 1)
    with pytest.raises(InputError, match="A spreadsheet is not read"):
        session.reserve_path("data.ods", 1)
    place = session.reserve_path("../a.csv", 600_000)
    assert place == session.data / "a.csv"
    place.write_bytes(b"x" * 600_000)
    with pytest.raises(InputError, match="of that name already exists"):
        session.reserve_path("a.csv", 1)
    with pytest.raises(InputError, match="too large"):
        session.reserve_path("b.csv", 600_000)
    assert session.reserve_path("b.csv", 400_000).parent == session.data


def test_files_are_in_natural_order(session):
    for name in ("10_Hz.csv", "9_Hz.csv", "notes.toml"):
        put(session, name)
    assert session.files == ["9_Hz.csv", "10_Hz.csv"]


def test_what_the_page_wrote_is_never_taken_as_the_users_own(session):
    put(session, "a.csv")
    session.write_calibration("one")
    session.write_calibration("two")
    assert session.calibration is None
    session.forget_calibration()
    assert not (session.data / CALIBRATION).exists()
    session.write_calibration("three")
    session.clear()
    assert session.calibration is None
    session.write_calibration("four")
    session.reserve_path(CALIBRATION, 1).write_text("own")
    assert session.calibration == CALIBRATION
    session.forget_calibration()
    assert session.calibration == CALIBRATION
    assert (session.data / CALIBRATION).read_text() == "own"


def test_a_mended_calibration_file_takes_the_place_of_the_broken_one(session):
    session.reserve_path("my.toml", 1).write_text("broken")
    session.reserve_path("my.toml", 1).write_text("mended")
    assert session.calibration == "my.toml"
    put(session, "other.toml")
    with pytest.raises(InputError, match="More than one calibration file"):
        _ = session.calibration
    put(session, CALIBRATION)
    assert session.calibration == CALIBRATION


def put(session, name: str, text: str = "") -> None:
    session.reserve_path(name, len(text)).write_text(text)


def test_a_file_of_the_same_name_in_capitals_is_the_same_file(session):
    put(session, "A.csv")
    with pytest.raises(InputError, match="already exists"):
        put(session, "a.CSV")
    session.remove("A.csv")
    put(session, "a.CSV")
    assert session.files == ["a.CSV"]


def test_a_copy_keeps_what_the_person_changes_later(session):
    put(session, "a.csv", "one")
    put(session, "my.toml", "one")
    (copy := session.folder / "copy").mkdir()
    session.copy_to(copy)
    put(session, "my.toml", "two")
    session.remove("a.csv")
    assert ((copy / "a.csv").read_text(), (copy / "my.toml").read_text()) == ("one", "one")


def test_the_oldest_results_go_when_there_are_too_many_or_they_are_too_large(session, tmp_path):
    def keep(size: int) -> tuple[Path, list[Path]]:
        (made := tmp_path / "made.json").write_bytes(bytes(size))
        return session.keep_result(made)

    kept = [keep(10)[0] for _ in range(MAX_RESULTS)]
    assert all(path.exists() for path in kept)
    _, gone = keep(10)
    assert gone == kept[:1]
    _, gone = keep(1_000_000)
    assert len(gone) == MAX_RESULTS
    assert not any(path.exists() for path in gone)
    last, gone = keep(2_000_000)
    assert len(gone) == 1
    assert last.exists()


def test_downloads_do_not_pile_up(session):
    places = [session.download(b"x") for _ in range(10)]
    assert sum(place.exists() for place in places) <= 4
    assert places[-1].read_bytes() == b"x"


@pytest.mark.parametrize("file", ["/etc/passwd", "../x.csv", "a/../../x.csv", "~/x.csv", "C:/x.csv", "C:x.csv"])
def test_a_calibration_file_reaches_no_other_folder(session, file):
    session.open()
    place = session.data / CALIBRATION
    place.write_text(TOML.format(file=file))
    with pytest.raises(InputError, match="beside the calibration file only") as caught:
        refuse_outside(place)
    assert session.with_local_paths(caught.value).where == f"{CALIBRATION}, file"


@pytest.mark.parametrize("file", ["x.csv", "*.csv", "folder/x.csv", "a..b.csv"])
def test_files_beside_the_calibration_file_are_welcome(session, file):
    session.open()
    place = session.data / CALIBRATION
    place.write_text(TOML.format(file=file))
    refuse_outside(place)
