"""``vibrident doctor``: checks of this installation."""

from __future__ import annotations

import typer

from vibrident.app.cli.console import BAD_INPUT, error_console, output_console, print_line
from vibrident.app.cli.progress import ProgressBar
from vibrident.base.escaping import terminal as printable

_COLOURS = {"ok": "green", "not installed": "dim", "cannot be used": "yellow"}


def doctor() -> None:
    """Check the installation: versions, arithmetic, cache, and an identification with known \
truth."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    from vibrident.app.doctor import examine

    with ProgressBar("Examining"):
        checks = examine()
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for heading in ("", "check", "found"):
        table.add_column(heading, overflow="fold")
    for check in checks:
        colour = "bold red" if check.fatal else _COLOURS[check.verdict]
        verdict = Text(check.verdict, colour)
        text = Text(printable(check.finding))
        if check.remedy:
            text.append(f"\n→ {printable(check.remedy)}", "bold" if check.fatal else "yellow")
        table.add_row(verdict, Text(check.subject), text)
    output_console().print(table)
    if failed := [check.subject for check in checks if check.fatal]:
        error_console().print(f"Not fit for use: {', '.join(failed)}.", style="bold red")
        raise typer.Exit(BAD_INPUT)
    without = [check.subject for check in checks if check.verdict == "cannot be used"]
    print_line(f"Fit for use, without: {', '.join(without)}." if without else "Fit for use.")
