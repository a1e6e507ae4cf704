"""``vibrident reproduce``: the paper's tables and figures, its numbers beside ours."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Iterator
from pathlib import Path

from vibrident.app.cli.console import note, print_line
from vibrident.app.cli.options import flag, option
from vibrident.app.cli.progress import ProgressBar
from vibrident.app.workflow.folder import written_whole
from vibrident.base.errors import InputError


def reproduce(
    folder: Path = option(
        "--out", "DIR", "Folder for the page; other files in it stay.", Path("reproduction")
    ),
    quick: bool = flag("--quick", help="A trial of two minutes; networks are not fully trained."),
    full_range: bool = flag(
        "--full-range", help="Also 41 records from 0.1 Hz on, beside the paper's 21 from 10 Hz."
    ),
    seed: int = option("--seed", "N", "Of everything random.", 20251111, min=0),
    into: Path | None = option(
        "--into", "FILE.md", "Also put the tables between the marks of FILE.md."
    ),
) -> None:
    """Reproduce the paper: every table and figure, and further ones, on one page (Markdown and \
HTML).

    Measured records are included if VIBRIDENT_DATA names their folder. Same seed, same numbers.
    """
    from vibrident.base.process import processors
    from vibrident.paper.settings import ReproductionSettings
    from vibrident.paper.settings import quick as trial

    named = os.environ.get("VIBRIDENT_DATA")
    data = Path(named) if named else None
    full_settings = ReproductionSettings(
        seed=seed, full_range=full_range, data=data, jobs=min(2, processors())
    )
    settings = trial(seed, data, full_range=full_range) if quick else full_settings
    if into is not None:
        _read(into)  # fails now, not after twenty minutes
    with written_whole(folder) as output:
        from vibrident.paper import page
        from vibrident.paper.reproduction import reproduce as run

        done = run(settings, _stage)
        with _stage("Drawing"):
            tables = page.write(done, output.path)
        text = None if into is None else page.filled(_read(into), tables, str(into))
    if into is not None and text is not None:
        into.write_text(text, encoding="utf-8")
    for table in tables:
        if table.name in ("claims", "own"):
            print_line(f"\n{table.title}", style="bold")
            for claim, our_value, verdict, _ in table.rows:
                print_line(f"  {verdict:3}  {claim}: {our_value}")
    print_line(
        f"\nWritten in {done.seconds / 60:.1f} min: {folder / 'paper.html'}, paper.md, paper.json, "
        "pictures"
    )


def _read(document: Path) -> str:
    try:
        return document.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(
            "The document cannot be read.",
            expected="a Markdown file with marks for the tables",
            found=f"{type(error).__name__}: {error.strerror or error}",
            where=str(document),
            remedy="correct --into, or leave it out",
        ) from error


@contextlib.contextmanager
def _stage(what: str) -> Iterator[ProgressBar]:
    """Show a progress bar within the block, and print a line on stderr at its end."""
    begin = time.perf_counter()
    with ProgressBar(what) as progress:
        yield progress
    note(f"{what}: {time.perf_counter() - begin:.0f} s")
