"""The doctor says "ok" of nothing that cannot be used."""

from __future__ import annotations

import importlib
import importlib.metadata
import sys
from pathlib import Path

import pytest
from tests.support.lives import calibrated
from tests.support.plug_ins import described

from vibrident.app import doctor
from vibrident.app.requirements import requirements_by_extra
from vibrident.base.registry import PlugIn
from vibrident.lab.histories import History

#: Package → source of its module; each is installed as version 1.5.
FAKES = {
    "fakegood": "",
    "fakebroken": "raise ImportError('no native library')",
    "fakecrash": "import os; os._exit(7)",
    "fakeprints": "print('[1]')",
    "fakeold": "",
}
REQUIRED = (
    "numpy>=1",
    "fakegood>=1; extra == 'good'",
    "fakeprints>=1; extra == 'good'",
    "fakebroken>=1; extra == 'broken'",
    "fakegood; extra == 'broken'",
    "fakecrash; extra == 'crash'",
    "fakeold>=2; extra == 'old'",
    "fakeabsent>=1; extra == 'absent'",
    "fakebroken>=1; extra == 'dev'",
)


@pytest.fixture
def fakes(tmp_path, monkeypatch):
    for name, source in FAKES.items():
        (tmp_path / f"{name}.py").write_text(source, encoding="utf-8")
        described(tmp_path, name, "1.5", "")
        (tmp_path / f"{name}-1.5.dist-info" / "top_level.txt").write_text(name, encoding="utf-8")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.setattr(importlib.metadata, "requires", lambda _: list(REQUIRED))
    importlib.invalidate_caches()


def test_each_extra_is_ok_or_not_installed_or_cannot_be_used(fakes):
    checks = {check.subject: check for check in doctor._packages_and_extras()}
    assert {name: check.verdict for name, check in checks.items()} == {
        "Packages": "ok",
        "Extra absent": "not installed",
        "Extra broken": "cannot be used",
        "Extra crash": "cannot be used",
        "Extra good": "ok",
        "Extra old": "cannot be used",
    }
    assert "no native library" in checks["Extra broken"].finding
    assert "status 7" in checks["Extra crash"].finding
    assert "1.5, but >=2" in checks["Extra old"].finding
    assert not any(check.fatal for check in checks.values())
    assert all(check.remedy for check in checks.values() if check.verdict != "ok")


@pytest.mark.parametrize("lacking", ["fakebroken", "fakeold>=2", "fakeabsent"])
def test_a_package_that_all_needs_is_fatal(fakes, monkeypatch, lacking):
    monkeypatch.setattr(importlib.metadata, "requires", lambda _: ["numpy>=1", lacking])
    (packages,) = doctor._packages_and_extras()
    assert packages.fatal
    assert lacking.partition(">")[0] in packages.finding


def test_the_requirements_are_those_of_the_package():
    known = {extra: [each.name.lower() for each in required] for extra, required in requirements_by_extra().items()}
    assert "numpy" in known[""]
    assert known["tdms"] == ["nptdms"]
    assert "dev" not in known


@pytest.mark.needs("network")
def test_jax_that_computes_wrongly_cannot_be_used(monkeypatch):
    from vibrident.base import backend

    monkeypatch.setattr(backend, "arithmetic_error", lambda: float("inf"))
    assert {check.subject for check in doctor._jax() if check.fatal} == {"Sum of matrix products"}


def test_jax_that_does_not_load_cannot_be_used_and_is_said_once(monkeypatch):
    import vibrident.base

    monkeypatch.setattr(doctor, "_version", lambda package: "0.0.1")
    monkeypatch.setitem(sys.modules, "vibrident.base.backend", None)
    monkeypatch.delattr(vibrident.base, "backend", raising=False)
    (check,) = doctor._jax()
    assert (check.verdict, check.fatal) == ("cannot be used", True)
    assert doctor._cache() == []


def test_a_plug_in_that_cannot_be_used_is_not_ok(monkeypatch):
    class Registry:
        def plug_ins(self):
            return [PlugIn("vibrident.models", "a", "b 1"), PlugIn("vibrident.models", "c", "d 1", "it is broken")]

    monkeypatch.setattr(doctor, "REGISTRIES", (Registry(),))
    sound, broken = doctor._plug_ins()
    assert (sound.verdict, broken.verdict, broken.fatal) == ("ok", "cannot be used", False)


@pytest.mark.needs("network")
def test_a_cache_that_cannot_be_written_is_not_ok(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("", encoding="utf-8")
    monkeypatch.setenv("VIBRIDENT_CACHE", str(tmp_path / "file" / "folder"))
    (check,) = doctor._cache()
    assert check.verdict == "cannot be used"


@pytest.mark.needs("history")
def test_a_store_is_ok_where_it_can_be_opened_or_begun(monkeypatch, tmp_path):
    def check(place: Path | str) -> doctor.Check:
        monkeypatch.setenv("VIBRIDENT_STORE", str(place))
        (found,) = doctor._store()
        return found

    assert check(tmp_path / "new" / "h.db").verdict == "ok"
    assert not (tmp_path / "new").exists()
    with History(tmp_path / "h.db") as history:
        history.add(calibrated())
    assert check(tmp_path / "h.db").verdict == "ok"
    (tmp_path / "damaged.db").write_bytes(b"no database" * 100)
    for place in (tmp_path / "damaged.db", tmp_path / "damaged.db" / "h.db", "nothing://at/all"):
        found = check(place)
        assert (found.verdict, found.fatal) == ("cannot be used", False), found
        assert found.remedy
