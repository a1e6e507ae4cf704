"""View models as a terminal shows them, with rich, which is loaded when something is printed."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from vibrident.base.escaping import terminal
from vibrident.show.views import Block, Doubt, Facts, Sentence, Table, columns

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions
    from rich.text import Text

_COLOURS = {"fine": "green", "doubt": "bold red", "note": "dim", "plain": ""}
_MAX_UNBROKEN_WORD = 10  # longest word that is not broken
_MIN_COLUMN_WIDTH = 6  # smallest width of a column of words
_COLUMN_GAP = 2  # blanks between two columns


@dataclass(frozen=True)
class ConsoleBlocks:
    """Blocks below each other; what is not for a terminal, such as curves, is left out."""

    blocks: tuple[Block, ...]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Any]:
        for block in self.blocks:
            yield from _block(block, options.max_width)


@dataclass(frozen=True)
class Written:
    """Paths of written files, one a line; long paths are not broken."""

    paths: tuple[str, ...]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Text]:
        from rich.text import Text

        lines = [f"{'Written: ' if i == 0 else ' ' * 9}{path}" for i, path in enumerate(self.paths)]
        yield Text("\n".join(map(terminal, lines)), no_wrap=True, overflow="ignore")


def on_console(*blocks: Block | None) -> ConsoleBlocks:
    """Wrap blocks for a console to print."""
    return ConsoleBlocks(tuple(block for block in blocks if block is not None))


def written(paths: Sequence[str | os.PathLike[str]]) -> Written:
    """Wrap the paths of written files for a console to print."""
    return Written(tuple(os.fspath(path) for path in paths))


def literal(text: str, style: str = "") -> Text:
    """Show foreign text literally: no markup by brackets, no escape sequences."""
    from rich.text import Text

    return Text(terminal(text), style)


def _block(block: Block, width: int) -> Iterator[Any]:
    if isinstance(block, Table):
        yield from (_table(piece, width) for piece in _split_columns(_fitting(block, width), width))
    elif isinstance(block, Facts):
        rows = tuple((name, text or "") for name, text in block.rows)
        yield _table(Table(columns("", ""), rows, title=block.title), width)
    elif isinstance(block, Sentence):
        line = literal(f"{block.lead} " if block.lead else "", "bold").append_text(
            literal(block.text)
        )
        yield (
            line.append_text(literal(f" {block.end}", _COLOURS[block.kind])) if block.end else line
        )
    elif isinstance(block, Doubt):
        yield from _doubt(block)


def _doubt(doubt: Doubt) -> Iterator[Any]:
    from rich.padding import Padding
    from rich.text import Text

    yield Text.assemble(
        ("Warning: ", "bold yellow"), (terminal(doubt.title), "bold"), f" ({terminal(doubt.code)})"
    )
    body = [literal(message) for message in doubt.messages]
    body.append(Text.assemble(("To do: ", "bold"), terminal(doubt.action.replace("`", ""))))
    yield from (Padding(text, (0, 0, 0, 2), expand=False) for text in body)


def _table(table: Table, width: int) -> Any:
    from rich import box
    from rich.table import Table as Grid

    grid = Grid(
        title=literal(table.title) if table.title else None,
        title_justify="left",
        title_style="bold",
        caption=literal("\n".join(table.notes)) if table.notes else None,
        caption_justify="left",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        padding=(0, 1, 0, 0),
        show_header=any(table.header),
    )
    # then columns of numbers are no wider than these, and their headings fold
    tight = _width(table) > width
    for j, column in enumerate(table.columns):
        least = _least(table, j)
        number = column.kind == "number"
        fixed = least if tight and number else None
        justify = "right" if number else "left"
        grid.add_column(
            literal(column.heading), justify=justify, overflow="fold", min_width=least, width=fixed
        )
    for i, row in enumerate(table.rows):
        if i in table.groups:
            grid.add_section()
            grid.add_row(literal(table.groups[i]), style="dim")
        below = bool(i) and row[0] == "" and len(row) > 1
        style = "yellow" if i in table.doubtful else "dim" if below else None
        grid.add_row(*(literal(cell) for cell in row), style=style)
    return grid


def _least(table: Table, j: int) -> int:
    """Return the minimal width of a column: numbers, short words and heading words stay whole."""
    cells = [row[j] for row in table.rows]
    heading = max(map(len, table.columns[j].heading.split()), default=1)
    longest = max((len(line) for cell in cells for line in cell.split("\n")), default=1)
    words = max((len(word) for cell in cells for word in cell.split()), default=1)
    least = (
        longest
        if table.columns[j].kind == "number" or longest <= _MAX_UNBROKEN_WORD
        else max(_MIN_COLUMN_WIDTH, min(words, _MAX_UNBROKEN_WORD))
    )
    return max(least, heading)


def _fitting(table: Table, width: int) -> Table:
    """Drop redundant columns of a table for which a narrow terminal has no room."""
    spare = [j for j, column in enumerate(table.columns) if column.spare]
    if not spare or _width(table) <= width:
        return table
    return table.select(tuple(j for j in range(len(table.columns)) if j not in spare))


def _split_columns(table: Table, width: int) -> Iterator[Table]:
    """Return parts of a table that would be cut off; each repeats the naming columns."""
    count = len(table.columns)
    widths = [_least(table, j) + _COLUMN_GAP for j in range(count)]
    if sum(widths) <= width:
        yield table
        return
    names = next((j for j in table.right if j), 1)
    groups: list[tuple[int, ...]] = [tuple(range(names))]
    for j in range(names, count):
        last = groups[-1]
        if len(last) > names and sum(widths[i] for i in (*last, j)) > width:
            groups.append(tuple(range(names)))
        groups[-1] = (*groups[-1], j)
    for number, group in enumerate(groups):
        title = f"{table.title} (continued)".lstrip() if number else table.title
        notes = table.notes if number == len(groups) - 1 else ()
        yield replace(table.select(group), title=title, notes=notes)


def _width(table: Table) -> int:
    """Return the width of a table whose cells are all on one line."""
    cells = (
        max(len(column.heading), *(len(row[j]) for row in table.rows), 1)
        for j, column in enumerate(table.columns)
    )
    return sum(cell + _COLUMN_GAP for cell in cells)
