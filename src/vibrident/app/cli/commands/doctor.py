"""``vibrident doctor``: checks of this installation."""

from __future__ import annotations

import typer

from vibrident.app.cli.console import BAD_INPUT, err, out, say
from vibrident.app.cli.progress import Busy
from vibrident.base.escaping import terminal as printable


def doctor() -> None:
    """Check the installation: versions, arithmetic, cache, and an identification with known truth."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    from vibrident.app.doctor import examine

    with Busy("Examining"):
        checks = examine()
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for heading in ("", "check", "found"):
        table.add_column(heading, overflow="fold")
    for check in checks:
        verdict = Text("ok", "green") if check.sound else Text("FAIL", "bold red")
        text = Text(printable(check.found))
        if check.remedy:
            text.append(f"\n→ {printable(check.remedy)}", "yellow" if check.sound else "bold")
        table.add_row(verdict, Text(check.subject), text)
    out().print(table)
    if failed := [check.subject for check in checks if not check.sound]:
        err().print(f"Not fit for use: {', '.join(failed)}.", style="bold red")
        raise typer.Exit(BAD_INPUT)
    say("Fit for use.")
