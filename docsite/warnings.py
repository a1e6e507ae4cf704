"""A page for each warning: meaning and remedy from the code, causes and an example from a template.

The example of ``pages/warnings/CODE.md`` is a program. It is run when the site is built, its output
is shown below it, and the build ends where that does not name the warning.
"""

from __future__ import annotations

import re
import shlex
import shutil
import tempfile
import textwrap
from pathlib import Path

import typer.main

from docsite import executed
from vibrident.app.cli.application import app
from vibrident.app.cli.words import shell_word
from vibrident.base.settings import rendered
from vibrident.base.warning_kinds import WARNINGS

TEMPLATES = Path(__file__).parent / "pages" / "warnings"
MAX_COLUMNS = 76  # of printed text, which does not scroll sideways then
_COMMANDS = re.compile(r"^```sh\nvibrident (.*?)\n```$", re.MULTILINE | re.DOTALL)
_EXAMPLE = re.compile(r"```python\n(.*?)```\n*", re.DOTALL)


def write(docs: Path) -> None:
    """Write the page and the picture of each warning into ``warnings/``."""
    folder = docs / "warnings"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for code in WARNINGS:
        (folder / f"{code}.md").write_text(page(code, folder), encoding="utf-8")


def page(code: str, folder: Path) -> str:
    """Return the page of a warning; its picture is written into the folder."""
    causes, example, after = program(code)
    kind = WARNINGS[code]
    word = shell_word(typer.main.get_command(app))
    meaning, action = (rendered(text, word) for text in (kind.meaning, kind.action))
    title = kind.title[:1].upper() + kind.title[1:]
    text = f"# `{code}`\n\n**{title}.** {meaning}\n\n## What to do\n\n{action}\n\n{causes.strip()}"
    with tempfile.TemporaryDirectory() as temporary:
        path = Path(temporary) / f"{code}.py"
        check = f"# %% [check]\n{_preparation(causes)}"
        source = f"# %% [markdown]\n{_commented(text)}\n{check}\n# %%\n{example}"
        path.write_text(source, encoding="utf-8")
        cells = executed.run(path)
    for output in (
        output for cell in cells for output in cell.get("outputs", ()) if "text" in output
    ):
        output["text"] = "\n".join(
            textwrap.fill(line, MAX_COLUMNS) for line in output["text"].splitlines()
        )
    printed = "".join(
        output.get("text", "") for cell in cells for output in cell.get("outputs", ())
    )
    if code not in printed:
        raise ValueError(
            f"the example of {code} was expected to print this code; it printed {printed!r}"
        )
    markdown = executed.page(cells, folder, code)
    markdown = re.sub(r"^\*\[.*?\]\(.*?\.ipynb\)\*\n+", "", markdown, flags=re.MULTILINE)
    return f"{markdown.rstrip()}\n\n{after.strip()}".rstrip() + "\n"


def program(code: str) -> tuple[str, str, str]:
    """Return what a template says before its example, the example, and what it says after it."""
    before, example, after = _EXAMPLE.split((TEMPLATES / f"{code}.md").read_text(encoding="utf-8"))
    return before, example, after


def _preparation(causes: str) -> str:
    """Return the program that runs the commands shown before an example, quietly."""
    commands = [shlex.split(command.replace("\\\n", " ")) for command in _COMMANDS.findall(causes)]
    calls = [
        f"subprocess.run([sys.executable, '-m', 'vibrident', *{words}], **quiet)"
        for words in commands
    ]
    quiet = 'quiet = {"check": True, "stdout": subprocess.DEVNULL}'
    return "\n".join(["import subprocess, sys", quiet, *calls])


def _commented(text: str) -> str:
    return "\n".join(f"# {line}".rstrip() for line in text.splitlines())
