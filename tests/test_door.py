"""The public door: the names of ``vibrident``, each of which a stranger may use."""

from __future__ import annotations

import doctest
import re
import sys

import pytest
from tests.support.door import described
from tests.support.sources import ROOT

import vibrident

#: Name → the extra without which its example does not run.
NEEDS = {"Fleet": "fleet", "History": "history", "report": "report", "verify": "history"}
EXAMPLES = [
    pytest.param(name, marks=pytest.mark.needs(NEEDS[name]) if name in NEEDS else ())
    for name in vibrident.__all__
    if name != "__version__"
]


def test_each_public_name_is_there():
    assert sorted(dir(vibrident)) == sorted(vibrident.__all__)
    assert all(getattr(vibrident, name) is not None for name in vibrident.__all__)


def test_a_function_is_not_hidden_by_the_room_of_its_name():
    assert "vibrident.export" in sys.modules
    import vibrident.export.registry

    assert callable(vibrident.export)


def test_an_unknown_name_is_no_attribute():
    with pytest.raises(AttributeError, match="no_such_name"):
        vibrident.no_such_name  # noqa: B018


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_example_of_a_name_runs(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    value, printed = getattr(vibrident, name), []
    found = doctest.DocTestFinder(recurse=False).find(value, name, globs={})
    assert any(each.examples for each in found), f"{name} has no example"
    runner = doctest.DocTestRunner(verbose=False)
    for each in found:
        runner.run(each, out=printed.append)
    assert not runner.failures, "".join(printed)


def test_the_signatures_are_these():
    told = (ROOT / "tests" / "door.txt").read_text(encoding="utf-8")
    remedy = "the public door has changed; if it is meant: python -m tests.support.door > tests/door.txt"
    assert described().splitlines() == told.splitlines(), remedy


#: A page that names the classes behind entry points, which are public too.
ENTRY_POINTS = "plug-ins.md"
INNER_IMPORT = re.compile(r"^\s*(?:from vibrident\.|import vibrident\.)", re.MULTILINE)


def test_documentation_and_tutorials_use_the_door_alone():
    pages = [*(ROOT / "docs").glob("*.md"), *(ROOT / "docsite" / "notebooks").glob("*.py"), ROOT / "README.md"]
    wrong = [page.name for page in pages if INNER_IMPORT.search(page.read_text(encoding="utf-8"))]
    assert set(wrong) <= {ENTRY_POINTS}
