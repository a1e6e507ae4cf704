"""Print tables to stdout and all else to stderr, without control codes in files."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from vibrident.base.errors import InputError, VibridentError
from vibrident.base.escaping import terminal as printable
from vibrident.base.settings import Word

if TYPE_CHECKING:
    from rich.console import Console

    from vibrident.app.workflow.task_output import TaskOutput
    from vibrident.show.views import Block


#: Least width of what is printed, characters: a broken line is better than a cut number.
MIN_COLUMNS = 76
#: Exit codes: of input that cannot be used, of a warning with --strict, after Ctrl-C.
BAD_INPUT = 2
DOUBTFUL = 3
INTERRUPTED = 130


def make_streams_forgiving() -> None:
    """Print ``?`` for characters that the encoding lacks, and nothing to a closed stream."""
    # None: closed by the caller
    sys.stdout = sys.stdout or _nowhere()
    sys.stderr = sys.stderr or _nowhere()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _nowhere() -> TextIO:
    return open(os.devnull, "w", encoding="utf-8")


def output_console() -> Console:
    """Return the console of the command's results.

    It has 120 columns in a file or a pipe: a broken line is better than a cut number.
    """
    console = _console(stderr=False)
    free = not sys.stdout.isatty() and not os.environ.get("COLUMNS")
    console.width = 120 if free else max(console.width, MIN_COLUMNS)
    return console


def error_console() -> Console:
    """Return the console for everything else: errors, warnings, progress."""
    return _console(stderr=True)


def _console(*, stderr: bool) -> Console:
    from rich.console import Console

    return Console(stderr=stderr, markup=False, highlight=False, emoji=False)


def print_line(text: str, style: str = "") -> None:
    """Print a line on stdout."""
    output_console().print(printable(text), style=style, soft_wrap=True)


def show(*blocks: Block | None) -> None:
    """Print tables and sentences on stdout."""
    from vibrident.show.media.console import on_console

    output_console().print(on_console(*blocks))


def show_rows(rows: Sequence[Mapping[str, object]], title: str) -> None:
    """Print a table of rows, column name to value, on stdout."""
    from vibrident.show.rows import table_of

    show(table_of(rows, title))


def show_output(output: TaskOutput) -> None:
    """Print what a task made: warnings and remarks on stderr, tables and sentences on stdout."""
    warn(output.findings)
    for text in output.notes:
        note(text)
    show(*output.blocks)


def note(text: str) -> None:
    """Print a line on stderr."""
    error_console().print(printable(text), soft_wrap=True)


def warn(findings: Iterable[Any]) -> None:
    """Print findings or warnings on stderr, each with its code."""
    for finding in findings:
        note(f"Warning ({finding.code}): {finding.message}")


def show_written(paths: Sequence[str | os.PathLike[str]]) -> None:
    """Print the paths of written files on stdout, unbroken."""
    from vibrident.show.media.console import written

    output_console().print(written(paths), soft_wrap=True)


def show_error(error: VibridentError, word: Word) -> None:
    """Print an error on stderr: the problem, what was expected and found, where, and what to do.

    ``word``: the command line's words for settings.
    """
    from rich.table import Table
    from rich.text import Text

    if isinstance(error, InputError):
        error = error.in_words(word)
    console = error_console()
    if not isinstance(error, InputError) or not console.is_terminal:
        console.print(Text.assemble(("Error: ", "bold red"), printable(str(error))), soft_wrap=True)
        return
    console.print(Text.assemble(("Error: ", "bold red"), printable(error.problem)))
    grid = Table.grid(padding=(0, 1, 0, 0))
    grid.add_column(style="bold", no_wrap=True)
    grid.add_column(overflow="fold")
    for label, text in error.parts:
        grid.add_row(f"  {label}:", Text(printable(text)))
    console.print(grid)


def distinct_names(paths: Sequence[Path]) -> list[str]:
    """Return a name for each result: the last part of the path that differs."""
    levels = [(path.stem, *reversed(path.resolve().parent.parts[1:])) for path in paths]
    names = next(
        (list(level) for level in zip(*levels, strict=False) if len(set(level)) > 1),
        [p[0] for p in levels],
    )
    return [
        f"{name}-{names[: i + 1].count(name)}" if names.count(name) > 1 else name
        for i, name in enumerate(names)
    ]
