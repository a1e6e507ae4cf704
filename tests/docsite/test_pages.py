"""What is written is short: lines and cells of the pages, links that lead to files, all pages together."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from docsite.hooks import MADE_LINK
from docsite.made import MADE_PAGES
from docsite.schemas import SCHEMAS
from tests.support.sources import ROOT

MAX_LINE = 100
MAX_CELL = 200
MAX_LINES = 2500
DOCS = ROOT / "docs"


def is_made(page: Path) -> bool:
    return page.is_relative_to(DOCS) and page.relative_to(DOCS).as_posix() in MADE_PAGES


PAGES = [page for page in sorted(DOCS.rglob("*.md")) if not is_made(page)]
TEMPLATES = sorted((ROOT / "docsite" / "pages").rglob("*.md"))
OTHERS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
WRITTEN = [*PAGES, *TEMPLATES, *OTHERS]


def named(pages: list[Path]) -> list:
    return [pytest.param(page, id=page.relative_to(ROOT).as_posix()) for page in pages]


def without_code(text: str) -> str:
    return re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)


def links(page: Path) -> Iterator[str]:
    text = without_code(page.read_text(encoding="utf-8"))
    yield from re.findall(r"(?<!`)\]\(([^)\s]+)\)", text)


def is_row(line: str) -> bool:
    return line.startswith("|") and line.endswith("|")


def cells(text: str) -> Iterator[str]:
    for line in without_code(text).splitlines():
        if is_row(line):
            yield from (cell.strip() for cell in re.split(r"(?<!\\)\|", line))


@pytest.mark.parametrize("page", named(WRITTEN))
def test_lines_and_cells_are_short(page):
    """A row of a table is one line whatever its length; its cells are counted instead."""
    text = page.read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if len(line) > MAX_LINE and not is_row(line)]
    assert lines == []
    assert [cell for cell in cells(text) if len(cell) > MAX_CELL] == []


@pytest.mark.parametrize("page", named([*PAGES, *OTHERS]))
def test_links_lead_to_files(page):
    """Also on GitHub, where made pages are named without a link."""
    for target in links(page):
        path = target.partition("#")[0]
        if path and "://" not in path:
            assert (page.parent / path).exists(), target
            assert not is_made((page.parent / path).resolve()), f"{target} is no file of the repository"


@pytest.mark.parametrize("page", named([*PAGES, *OTHERS]))
def test_made_pages_are_named_by_their_path(page):
    for _, target in MADE_LINK.findall(page.read_text(encoding="utf-8")):
        assert target.partition("#")[0] in (*MADE_PAGES, *SCHEMAS), target


@pytest.mark.parametrize("page", named(sorted((ROOT / "studies").glob("*.md"))))
def test_links_of_studies_lead_to_files(page):
    for target in links(page):
        assert "://" in target or (page.parent / target.partition("#")[0]).exists()


def test_the_written_pages_are_short_together():
    lines = {page.name: len(page.read_text(encoding="utf-8").splitlines()) for page in PAGES}
    assert sum(lines.values()) <= MAX_LINES, lines
