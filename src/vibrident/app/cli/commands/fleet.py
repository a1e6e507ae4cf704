"""``vibrident fleet``: many calibrations, one table."""

from __future__ import annotations

import logging
import time
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from vibrident.app.cli.console import DOUBTFUL, note, output_console, print_line
from vibrident.app.cli.options import argument, between, choice, flag, option
from vibrident.app.cli.progress import ProgressBar
from vibrident.app.workflow.estimators import AUTO, estimator_names
from vibrident.base.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vibrident.lab.fleet import Outcome
    from vibrident.lab.fleet.coordinator import RunProgress
    from vibrident.lab.fleets import Fleet
    from vibrident.result import Result

_MINUTE_S = 60.0
_HOUR_S = 3600.0
_LINE_S = 30.0  # seconds between progress lines if stderr is not a terminal


def fleet(
    patterns: list[str] = argument(
        "PATTERN...",
        "Calibration files; folders, for all .toml files in and below them; globs in quotes.",
    ),
    folder: Path = option(
        "--out", "DIR", "Folder for the table, the page and the parts needed to resume.", ...
    ),
    workers: int | None = option(
        "--workers", "N", "Processes on this machine.", default="all cores", min=1
    ),
    scheduler: str | None = option(
        "--scheduler",
        "ADDRESS|FILE.json",
        "A running Dask scheduler, in place of this machine's processes; extra cluster.",
    ),
    model: str | None = option("--model", "NAME", "Sensor model for all, in place of each file's."),
    estimator: str = choice(
        "--estimator",
        estimator_names,
        f"How to fit; {AUTO} chooses by the data of each.",
        AUTO,
        "{estimators}",
    ),
    resume: bool = flag(
        "--resume/--fresh", help="Resume with what is in DIR, or start afresh.", value=True
    ),
    time_limit_s: float = between(
        "--time-limit", "S", "Most seconds of one calibration.", 1e-3, 1e9, 300.0
    ),
    memory_limit_mb: float | None = between(
        "--memory-limit",
        "MB",
        "Most memory of one process, which loads some 200 MB of libraries.",
        256.0,
        1e9,
        default="its share of the machine's, 4 GB or more",
    ),
    limits: Path | None = option(
        "--limits", "FILE", "Nominal values and tolerances by type (TOML), for the page."
    ),
    results: bool = flag(
        "--results/--no-results", help="Keep whole results in DIR/results.", value=True
    ),
    store: str | None = option(
        "--store", "URL", "Add the results to this history too; see `vibrident history`."
    ),
    strict: bool = flag(
        "--strict", help="Exit with 3 if a calibration is refused, failed or doubtful."
    ),
    quiet: bool = flag("--quiet", "-q", help="Print nothing but errors."),
) -> None:
    """Identify many sensors: DIR/fleet.parquet, a row each, and DIR/fleet.html.

    The same command resumes after a stop or a crash. Existing rows are kept, unless the
    calibration's files have changed.

    Exit codes: 0 every calibration has a row; 2 bad input; 3 with --strict, a row that is refused,
    failed or doubtful.
    """
    from vibrident.lab.fleets import Fleet

    request = Fleet(
        patterns,
        folder,
        model=model,
        estimator=estimator,
        limits=limits,
        time_limit_s=time_limit_s,
        memory_limit_bytes=None if memory_limit_mb is None else int(memory_limit_mb * 1e6),
        keep_results=results,
    )
    if store is not None:
        _require_store(store, results=results)
    outcome = _run(request, workers, scheduler, resume=resume, quiet=quiet)
    if not quiet:
        _show(outcome)
    if store is not None:
        _add(store, outcome, quiet=quiet)
    if strict and outcome.tally.doubts:
        note(
            f"Strict: {outcome.tally.doubts} of {outcome.tally.rows} calibrations are refused, "
            "failed or doubtful."
        )
        raise typer.Exit(DOUBTFUL)


def _run(
    request: Fleet, workers: int | None, scheduler: str | None, *, resume: bool, quiet: bool
) -> Outcome:
    from vibrident.lab.fleet.parts import load_arrow

    load_arrow()
    # what is lost is said once, in words of our own
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with ProgressBar("Identifying") as bar:
        last_line_s = time.monotonic()

        def report(progress: RunProgress) -> None:
            """Move the bar; where there is none, print a line now and then."""
            nonlocal last_line_s
            text = _progress_text(progress)
            bar.share(f"Identifying: {text}", progress.done, progress.total)
            if not quiet and not bar.is_shown and time.monotonic() - last_line_s >= _LINE_S:
                last_line_s = time.monotonic()
                note(text)

        return request.identify(
            workers=workers, scheduler=scheduler, resume=resume, progress=report
        )


def _require_store(store: str, *, results: bool) -> None:
    """Refuse an unusable store before the work begins."""
    if not results:
        raise InputError(
            "A history keeps whole results.",
            expected="--store with whole results in DIR/results",
            found="--store with --no-results",
            where="command line",
            remedy="leave one of the two out",
        )
    from vibrident.lab.history.store import Store

    with Store(store) as opened:
        opened.begin()
        with opened.reading():
            pass


def _add(store: str, outcome: Outcome, *, quiet: bool) -> None:
    """Add each result with a serial number; existing ones stay unchanged."""
    from vibrident.app.workflow.folder import load_result
    from vibrident.lab.histories import History
    from vibrident.show.views import count

    nameless = 0

    def named() -> Iterator[Result]:
        nonlocal nameless
        for path in outcome.results():
            result = load_result(path)
            if result.sensor.get("serial_number", "").strip():
                yield result
            else:
                nameless += 1

    with ProgressBar("Adding to the history"), History(store) as history:
        new = history.add(named())
    if not quiet:
        print_line(f"Added to the history: {count(new, 'new result')}.")
    if nameless:
        clause = (
            "result states no serial number and was"
            if nameless == 1
            else "results state no serial number and were"
        )
        note(f"{nameless} {clause} not added.")


def _progress_text(progress: RunProgress) -> str:
    words = f"{progress.done} of {progress.total}"
    if not progress.workers:
        return f"{words}, waiting for workers"
    if progress.rate > 0:
        words += f", {progress.rate:.3g} a second"
    if (remaining_s := progress.left_s) is None:
        return words
    if remaining_s < 1.5 * _MINUTE_S:
        near = f"{remaining_s:.0f} s"
    elif remaining_s < 1.5 * _HOUR_S:
        near = f"{remaining_s / _MINUTE_S:.0f} min"
    else:
        near = f"{remaining_s / _HOUR_S:.1f} h"
    return f"{words}, {near} left"


def _show(outcome: Outcome) -> None:
    from vibrident.lab.fleet.summary import summary

    output_console().print(summary(outcome), crop=False)
    if outcome.left_out:
        note(
            f"{outcome.left_out} .toml files in the folders hold no section of a calibration and "
            "were left out."
        )
    for name, units in outcome.tally.units_of_parameters.items():
        if len(units) > 1:
            note(f"The unit of {name} is not the same in all rows: {', '.join(units)}.")
