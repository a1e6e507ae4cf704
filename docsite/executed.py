"""Pages that are programs: cells of text and code between ``# %%`` lines, with what they print and draw."""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

_PAGES = Path(__file__).parent / "pages"
#: Name of the page's folder → its program, and the captions of its pictures.
EXECUTED: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "closed-loop": (
        "closed_loop.py",
        {
            "loop.png": "The open loop: the corrector takes out the sensor's resonance and its lag.",
            "drift.png": "The margin while the sensor drifts.",
        },
    ),
}


def write(docs: Path) -> None:
    """Run each program and write its page, ``index.md`` beside its pictures."""
    for name, (program, captions) in EXECUTED.items():
        folder = docs / name
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        (folder / "index.md").write_text(page(folder, program, captions)[0], encoding="utf-8")


def page(folder: Path, program: str, captions: Mapping[str, str]) -> tuple[str, dict[str, Any]]:
    """The page's text, and the names that its cells leave; pictures are drawn into the folder."""
    import matplotlib as mpl

    mpl.use("agg")
    text = (_PAGES / program).read_text(encoding="utf-8")
    names: dict[str, Any] = {"__name__": "page"}
    parts, drawn = [], set()
    with contextlib.chdir(folder):
        for kind, cell in re.findall(r"^# %%([^\n]*)\n(.*?)(?=^# %%|\Z)", text, re.MULTILINE | re.DOTALL):
            if "markdown" in kind:
                parts.append(_linked(re.sub(r"^# ?", "", cell.strip(), flags=re.MULTILINE)))
                continue
            said = io.StringIO()
            with contextlib.redirect_stdout(said):
                exec(compile(cell, program, "exec"), names)
            parts.append(f"```python\n{cell.strip()}\n```")
            if said.getvalue():
                parts.append(f"```text\n{said.getvalue().strip()}\n```")
            for picture in sorted(set(os.listdir()) & captions.keys() - drawn):
                parts.append(f"![{captions[picture]}]({picture})\n\n*{captions[picture]}*")
                drawn.add(picture)
    return "\n\n".join(parts) + "\n", names


def _linked(text: str) -> str:
    """Links to pages beside the folder."""
    return re.sub(r"\]\(([a-z-]+\.md)", r"](../\1", text)
