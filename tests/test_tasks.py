"""Thirteen tasks of the documentation, each a short script that uses the public names alone."""

from __future__ import annotations

import ast
import runpy
import sys
from pathlib import Path

import pytest
from tests.support.sources import ROOT

FOLDER = ROOT / "examples" / "tasks"
#: Script → what it prints, in part.
PRINTED = {
    "identify_folder": "natural frequency           651.96",
    "certificate": "written: certificate.pdf",
    "compare_with_history": "due: {'date': '20",
    "correct_signal": "peak 9.82",
    "predict_response": "0.10% of the response",
    "plan_calibration": "sensitivity: u = ",
    "own_model": "corner        25.000",
    "known_reference": "sensitivity                   104.0",
    "joint_fit": "by sine alone, ",
    "mounting": "changes by -4.0 %",
    "tracking": "sensitivity 0.104 → 0.098",
    "export_c": "sensor.c 25",
    "fleet": "computed: 3",
}
NEEDS = {"certificate": "report", "compare_with_history": "history", "fleet": "fleet"}
MAX_LINES = 24
LIBRARIES = {"numpy", "vibrident"}


def marked(name: str):
    return pytest.param(name, marks=pytest.mark.needs(NEEDS[name]) if name in NEEDS else ())


@pytest.mark.parametrize("name", [marked(name) for name in PRINTED])
def test_a_task_is_done(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(FOLDER / f"{name}.py"), run_name="__main__")
    assert PRINTED[name] in capsys.readouterr().out


def test_there_are_thirteen_tasks_each_in_the_list():
    assert {path.stem for path in FOLDER.glob("*.py")} == set(PRINTED)
    listed = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert all(f"({name}.py)" in listed for name in PRINTED)


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda path: path.stem)
def test_a_task_needs_the_door_alone(path: Path):
    text = path.read_text(encoding="utf-8")
    nodes = list(ast.walk(ast.parse(text)))
    imported = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    assert not [node for node in nodes if isinstance(node, ast.ImportFrom)]
    assert imported <= LIBRARIES | sys.stdlib_module_names
    assert len(text.splitlines()) <= MAX_LINES
