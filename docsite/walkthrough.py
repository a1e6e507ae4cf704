"""Pages that are read as a session at a terminal, and run as one when the site is built.

The blocks of a template are run in their order, in a temporary folder: ``python`` as a script,
``toml title="PATH"`` written as that file, and of ``console`` each line behind ``$``, with what it
prints below it. Pictures that the template shows are taken from that folder.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path

from docsite.executed import MAX_WIDTH

TEMPLATES = Path(__file__).parent / "pages"
PAGES = ("own-files.md",)
_BLOCK = re.compile(
    r'^( *)```(python|toml|console)(?: title="([^"]+)")?\n(.*?)^\1```$', re.M | re.S
)
_PICTURE = re.compile(r"^!\[([^\]]+)\]\(([^)]+\.png)\)$", re.MULTILINE)


def write(docs: Path) -> None:
    """Run each page's session; write the page, and its pictures into a folder of its name."""
    for name in PAGES:
        pictures = docs / Path(name).stem
        shutil.rmtree(pictures, ignore_errors=True)
        pictures.mkdir()
        template = (TEMPLATES / name).read_text(encoding="utf-8")
        (docs / name).write_text(page(template, pictures), encoding="utf-8")


def page(template: str, pictures: Path) -> str:
    """Return the page with the output of its session; write its pictures into the folder.

    Raises:
        CalledProcessError: a command or script of the page fails.
    """
    with tempfile.TemporaryDirectory(prefix="vibrident-walkthrough-") as temporary:
        folder = Path(temporary)
        session = folder / "session"
        session.mkdir()
        environment = _environment(folder / "programs")

        def run(block: re.Match[str]) -> str:
            return _run(block, session, environment)

        def copy(picture: re.Match[str]) -> str:
            name = picture[2].replace("/", "-")
            shutil.copy(session / picture[2], pictures / name)
            return f"![{picture[1]}]({pictures.name}/{name})"

        text = _BLOCK.sub(run, template)
        return _PICTURE.sub(copy, text)


def _environment(programs: Path) -> dict[str, str]:
    """Return the environment of a session: this Python's ``vibrident``, at the page's width."""
    programs.mkdir()
    command = programs / "vibrident"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m vibrident "$@"\n', encoding="utf-8")
    command.chmod(0o755)
    path = f"{programs}{os.pathsep}{os.environ['PATH']}"
    return os.environ | {"PATH": path, "COLUMNS": str(MAX_WIDTH), "LC_ALL": "C.UTF-8"}


def _run(block: re.Match[str], session: Path, environment: dict[str, str]) -> str:
    """Run a block; return what the page shows of it."""
    indent, language, title, source = block.groups()
    source = textwrap.dedent(source)
    if language == "toml" and title:
        file = session / title
        file.parent.mkdir(exist_ok=True)
        file.write_text(source, encoding="utf-8")
    if language == "python":
        arguments = [sys.executable, "-c", source]
        subprocess.run(arguments, cwd=session, env=environment, check=True, timeout=300)
    if language != "console":
        return block[0]
    lines = [
        line for command in _commands(source) for line in _output(command, session, environment)
    ]
    return textwrap.indent("\n".join(["```console", *lines, "```"]), indent)


def _commands(source: str) -> list[str]:
    """Return the commands of a block; a line that ends with a backslash goes on."""
    joined = re.split(r"^\$ ", source, flags=re.MULTILINE)[1:]
    return [command.rstrip() for command in joined]


def _output(command: str, session: Path, environment: dict[str, str]) -> list[str]:
    """Return a command and the lines that it prints, broken at blanks where they are too wide."""
    done = subprocess.run(
        command,
        shell=True,
        cwd=session,
        env=environment,
        check=True,
        timeout=300,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        encoding="utf-8",
    )
    lines = [f"$ {command}"]
    for line in done.stdout.strip().splitlines():
        lines += _broken(line.rstrip())
    return lines


def _broken(line: str) -> list[str]:
    """Return a printed line as lines that fit the page."""
    if len(line) <= MAX_WIDTH:
        return [line]
    indent = " " * (len(line) - len(line.lstrip()))
    wrapper = textwrap.TextWrapper(MAX_WIDTH, subsequent_indent=indent)
    wrapper.break_long_words = wrapper.break_on_hyphens = False
    return wrapper.wrap(line)
