"""Files that documents and docstrings name are there."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.support.sources import ROOT

PACKAGE = ROOT / "src" / "vibrident"
TOP = {"src", "tests", "docs", "docsite", "bench", "examples", "deploy", "studies"}
ROOMS = {folder.name for folder in PACKAGE.iterdir() if folder.is_dir()}
#: A path in backticks, without blanks, whose first folder is one of the repository or a room of the package.
NAMED = re.compile(r"`{1,2}([a-z_]+(?:/[A-Za-z0-9_.-]+)+/?)`{1,2}")
#: What commands write, and cells of the scenarios, which look like paths.
WRITTEN = re.compile(r"^(docs|bench)/(results|images)/|^paper/[a-z]+/[a-f]$")


def documents() -> Iterator[Path]:
    yield from (ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md"))
    for folder in ("docs", "studies"):
        yield from sorted((ROOT / folder).glob("*.md"))
    for folder in ("src", "tests", "bench", "docsite"):
        others = sorted((ROOT / folder).rglob("*.py"))
        yield from (path for path in others if path != Path(__file__))


def missing(text: str) -> list[str]:
    """Paths that a text names and that are nowhere."""
    gone = []
    for name in NAMED.findall(text):
        first = name.split("/")[0]
        if first not in TOP | ROOMS or WRITTEN.match(name):
            continue
        places = (ROOT / name, PACKAGE / name, ROOT / f"{name}.py", PACKAGE / f"{name}.py")
        if not any(place.exists() for place in places):
            gone.append(name)
    return gone


def test_named_files_exist():
    complaints = [
        f"{path.relative_to(ROOT)} names {name}, which is nowhere"
        for path in documents()
        for name in missing(path.read_text(encoding="utf-8"))
    ]
    if complaints:
        pytest.fail("\n".join(complaints), pytrace=False)


def test_a_file_that_is_gone_is_seen():
    assert missing("see `fit/nowhere/lines.py` and `src/vibrident/fit`") == ["fit/nowhere/lines.py"]
