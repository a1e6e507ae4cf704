"""First steps: the README, less what is for those who work on the code."""

from __future__ import annotations

import re
from pathlib import Path

_README = Path(__file__).resolve().parents[1] / "README.md"
_LEFT_OUT = ("Tests and benchmarks", "License")


def first_steps() -> str:
    """Return the README with links to pages of this site; other files have none."""
    title, *sections = re.split(
        r"^(?=## )", _README.read_text(encoding="utf-8"), flags=re.MULTILINE
    )
    lines = [
        section
        for section in sections
        if not section.startswith(tuple(f"## {name}" for name in _LEFT_OUT))
    ]
    within = re.sub(r"\]\(docs/", "](", title + "".join(lines))
    return re.sub(
        r"\[([^\]]+)\]\((?!\w+:)[^)]+(?<!\.md)(?<!\.png)\)|\[(\S+\.md)\]\(\2\)", r"\1\2", within
    )
