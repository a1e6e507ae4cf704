"""Summary of a fleet for the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from vibrident.lab.fleet.coordinator import Outcome
from vibrident.lab.fleet.row import FAILED, IDENTIFIED, REFUSED
from vibrident.lab.fleet.table import Tally
from vibrident.show import words
from vibrident.show.media.console import on_console, written
from vibrident.show.views import Column, Sentence, Table, columns

if TYPE_CHECKING:
    from rich.console import Group


def summary(outcome: Outcome) -> Group:
    """Return the counts by status and warning, the rate, and the files."""
    from rich.console import Group

    return Group(on_console(*overview(outcome)), written(outcome.files))


def overview(outcome: Outcome) -> tuple[Table, Sentence]:
    """Return rows by status and warning, and the rate."""
    total = max(outcome.tally.rows, 1)
    rows = tuple(
        (what, str(count), f"{100 * count / total:.4g} %") for what, count in _lines(outcome.tally)
    )
    table = Table(
        (Column(""), *columns("calibrations", "share", kind="number")), rows, title="Fleet"
    )
    return table, Sentence(_rate(outcome))


def _lines(tally: Tally) -> Iterator[tuple[str, int]]:
    yield "identified", tally.statuses[IDENTIFIED]
    if tally.doubtful:
        yield "  with a doubt", tally.doubtful
    for code, count in tally.warnings.most_common():
        yield f"    {code}: {words.explain(code).title}", count
    yield "refused", tally.statuses[REFUSED]
    yield "failed", tally.statuses[FAILED]


def _rate(outcome: Outcome) -> str:
    reused = outcome.tally.rows - outcome.computed
    note = f"; {reused} were there, or are the same as others" if reused > 0 else ""
    if not outcome.computed:
        return "Nothing was left to compute."
    rate = outcome.computed / max(outcome.seconds, 1e-9)
    return f"Computed {outcome.computed} in {outcome.seconds:.3g} s, {rate:.3g} a second{note}."
