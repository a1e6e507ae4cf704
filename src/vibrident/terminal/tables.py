"""What all tables have in common."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vibrident.escaping import terminal
from vibrident.present.numbers import reference_unit, sensitivity_unit

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

    from vibrident.result import Result


def titled(title: str, first: str | None = "parameter") -> Table:
    """A table with this title, and the heading of its first column; None: no column yet."""
    from rich import box
    from rich.table import Table

    table = Table(
        title=literal(title),
        title_justify="left",
        title_style="bold",
        caption_justify="left",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    if first is not None:
        table.add_column(first, overflow="fold")
    return table


def literal(text: str) -> Text:
    """Text of others is text: square brackets in it are not markup, and no escape sequence leaves it."""
    from rich.text import Text

    return Text(terminal(text))


def fit_unit(result: Result) -> str:
    """Unit of the residual: the response's for records, the sensitivity's for a table."""
    if result.signals:
        return result.response_unit
    return sensitivity_unit(result.response_unit, reference_unit(result))
