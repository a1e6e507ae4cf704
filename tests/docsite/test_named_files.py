"""Files, modules and documents that texts, comments and docstrings name are there."""

from __future__ import annotations

import io
import re
import sys
import tokenize
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest
from tests.support.sources import ROOT

PACKAGE = ROOT / "src" / "vibrident"
TOP = {"src", "tests", "docs", "docsite", "bench", "examples", "deploy", "studies"}
ROOMS = {folder.name for folder in PACKAGE.iterdir() if folder.is_dir()}
#: A path in backticks, without blanks; its first folder is one of the repository or a room.
NAMED = re.compile(r"`{1,2}([a-z_]+(?:/[A-Za-z0-9_.-]+)+/?)`{1,2}")
#: In comments and docstrings, a path without backticks too.
BARE = re.compile(r"(?<![\w/.:-])([a-z_]+(?:/[A-Za-z0-9_-]+)+(?:\.[a-z]+)?)")
#: A dotted name in backticks, such as ``records.cut``.
DOTTED = re.compile(r"`{1,2}~?((?:[a-z_]\w*\.)+[A-Za-z_]\w*)(?:\(\))?`")
#: What a dotted name is not, where it ends so: a file that a command writes.
ENDINGS = {"csv", "html", "json", "md", "p12", "parquet", "pdf", "pem", "toml"}
#: Names of documents that are no part of the repository.
ELSEWHERE = re.compile(r"\b(?:DESIGN|CORE|STYLE|PAPER)(?:\.md)?\b(?! =)(?=[,:)]| section| §)")
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


def remarks(tokens: Iterable[tokenize.TokenInfo]) -> Iterator[str]:
    """Yield comments and docstrings: strings that are a statement of their own."""
    begins = True
    for token in tokens:
        if token.type == tokenize.COMMENT or (token.type == tokenize.STRING and begins):
            yield token.string
        if token.type not in (tokenize.COMMENT, tokenize.NL):
            begins = token.type in (tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT)


@cache
def stems() -> set[str]:
    """Return the names of modules and packages of the repository, and of Python's modules."""
    folders = (PACKAGE, *(ROOT / name for name in TOP))
    paths = [path for folder in folders for path in folder.rglob("*.py")]
    names = {path.stem for path in paths} | {path.parent.name for path in paths}
    return names | set(sys.stdlib_module_names) | {"vibrident"}


def unknown(source: str, folder: Path) -> list[str]:
    """Names in comments and docstrings of a module, which lies in a folder, that nothing bears."""
    bare = missing(" ".join(f"`{name}`" for name in BARE.findall(source)))
    if not (bare or ELSEWHERE.search(source) or DOTTED.search(source)):
        return []  # nor in its remarks, which take a hundred times as long to find
    tokens = list(tokenize.generate_tokens(io.StringIO(source).readline))
    used = {token.string for token in tokens if token.type == tokenize.NAME}
    found = []
    for text in remarks(tokens):
        found += missing("".join(f"`{name}` " for name in BARE.findall(text)))
        found += ELSEWHERE.findall(text)
        for name in DOTTED.findall(text):
            first, second = name.split(".")[:2]
            beside = folder / f"{first}.py"
            if name.split(".")[-1] in ENDINGS:
                continue
            other = beside.read_text(encoding="utf-8") if beside.exists() else second
            if first not in used | stems() or not re.search(rf"\b{second}\b", other):
                found.append(name)
    return found


def test_what_comments_and_docstrings_name_exists():
    modules = [path for path in documents() if path.suffix == ".py"]
    complaints = [
        f"{path.relative_to(ROOT)} names {name}, which is nowhere"
        for path in modules
        for name in unknown(path.read_text(encoding="utf-8"), path.parent)
    ]
    if complaints:
        pytest.fail("\n".join(complaints), pytrace=False)


def test_a_name_that_is_gone_is_seen():
    source = "# see fit/measure, ``measure_of.lines`` and ``re.compile``, as DESIGN, section 3, says"
    assert unknown(source, ROOT) == ["fit/measure", "DESIGN", "measure_of.lines"]
    assert unknown("# ``registry.nothing``", PACKAGE / "fit") == ["registry.nothing"]


def test_a_file_that_is_gone_is_seen():
    assert missing("see `fit/nowhere/lines.py` and `src/vibrident/fit`") == ["fit/nowhere/lines.py"]
