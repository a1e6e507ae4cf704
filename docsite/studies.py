"""Copies of the studies for the site, with links that lead to its pages."""

from __future__ import annotations

import shutil
from pathlib import Path

STUDIES = Path(__file__).resolve().parents[1] / "studies"


def write(docs: Path) -> None:
    """Copy every study into ``studies/`` beside the written pages."""
    folder = docs / "studies"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for study in sorted(STUDIES.glob("*.md")):
        text = study.read_text(encoding="utf-8").replace("](../docs/", "](../")
        (folder / study.name).write_text(text, encoding="utf-8")
