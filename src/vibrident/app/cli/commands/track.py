"""``vibrident track``: follow a sensor's parameters with the samples, and raise alarms."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from vibrident.app.cli import options
from vibrident.app.cli.console import note, output_console, show_output, show_written
from vibrident.app.cli.options import between, flag, option
from vibrident.app.workflow.tracking import RECORDS
from vibrident.base.errors import InputError
from vibrident.base.fields import NamedTexts
from vibrident.base.progress import ProgressReporter
from vibrident.use.tracking import DRIFT_PER_YEAR, EVERY_S, FALSE_ALARMS_PER_DAY

if TYPE_CHECKING:
    from rich.live import Live

    from vibrident.use.tracking.state import TrackedEstimate


def track(
    result: Path = options.RESULT_FILE,
    calibration: Path = options.CALIBRATION_FILE,
    folder: Path = option(
        "--out", "DIR", "Folder for track.csv, track.json and the picture.", Path("vibrident-track")
    ),
    follow: bool = flag(
        "--follow", help="The record's file grows: go on as it does, and after an interruption."
    ),
    stdin: str | None = option("--stdin", "csv|float32", "Take the samples from standard input."),
    source: str | None = option(
        "--source", "NAME[=ADDRESS]", "Take them from a source of another package."
    ),
    idle: float | None = between(
        "--idle", "SECONDS", "End after so long without samples.", 0.0, 1e9, default="wait"
    ),
    every: float | None = between(
        "--every",
        "SECONDS",
        "Time between rows.",
        1e-6,
        1e9,
        default=f"{EVERY_S:g}, or a hundredth of the records",
    ),
    rate: float = between(
        "--false-alarms-per-day",
        "RATE",
        "False alarms expected in a day of motion.",
        1e-9,
        1e3,
        FALSE_ALARMS_PER_DAY,
    ),
    store: str | None = option(
        "--store",
        "URL",
        "History of the sensor, by whose random walk u grows.",
        default=f"{DRIFT_PER_YEAR:.0%} a year",
    ),
    pictures: bool = options.PICTURES,
) -> None:
    """Keep a sensor's parameters up to date, with their uncertainties, and say when the sensor \
changes.

    Takes the records of the calibration file, or samples as they come. Writes a row an interval in
    track.csv, and the end, the alarms and what was wrong with the samples in track.json, and the
    sensor as it is now in result.json, for other commands.
    """
    name, address = _one_source(follow=follow, stdin=stdin, source=source)
    from vibrident.app.workflow.tracked import track as run

    with _live_table() as progress:
        output, written = run(
            result,
            calibration,
            folder,
            source=name,
            address=address,
            idle_s=idle,
            every_s=every,
            false_alarms_per_day=rate,
            store=store,
            progress=progress,
        )
    show_output(output)
    if pictures:
        from vibrident.show import plots

        written.append(plots.save(output.figures[0], folder / "track.png"))
    show_written(written)


def _one_source(*, follow: bool, stdin: str | None, source: str | None) -> tuple[str, str]:
    """Return the name and the address of the source."""
    name, _, address = (source or "").partition("=")
    sources = [("follow", "")] if follow else []
    sources += [("stdin", stdin)] if stdin is not None else []
    sources += [(name, address)] if source else []
    if len(sources) > 1:
        raise InputError(
            "More than one source is given.",
            expected="one of --follow, --stdin, --source",
            found=", ".join(name for name, _ in sources),
            where="command line",
            remedy="leave the others out",
        )
    return sources[0] if sources else (RECORDS, "")


class LiveTable(ProgressReporter):
    """Print notes as lines, and on a terminal the sensor as a table that is renewed."""

    def __init__(self, live: Live | None) -> None:
        self._live = live

    def note(self, words: str) -> None:
        """Say a remark in a line of its own."""
        note(words)

    def estimate(self, row: TrackedEstimate, units: NamedTexts) -> None:
        """Renew the table."""
        if self._live is None:
            return
        from vibrident.app.workflow.tracked import parameter_rows
        from vibrident.show.media.console import on_console
        from vibrident.show.rows import table_of

        rows = parameter_rows(row.values, row.uncertainty, units)
        rows = [
            {**parameter_row, "excited": name in row.excited}
            for name, parameter_row in zip(row.values, rows, strict=True)
        ]
        self._live.update(on_console(table_of(rows, f"Tracked, {row.time_s:.6g} s")))


@contextlib.contextmanager
def _live_table() -> Iterator[LiveTable]:
    console = output_console()
    if not console.is_terminal:
        yield LiveTable(None)
        return
    from rich.live import Live

    with Live(console=console, transient=True, refresh_per_second=4) as live:
        yield LiveTable(live)
