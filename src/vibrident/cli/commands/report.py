"""``vibrident report``: a report from a result alone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from vibrident.cli import options
from vibrident.cli.console import out
from vibrident.cli.folder import written_whole
from vibrident.cli.results import load_result
from vibrident.errors import InputError


def report(
    results: Annotated[
        list[Path], typer.Argument(metavar="RESULT...", help="result.json, one or more.", show_default=False)
    ],
    folder: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="Folder for report.md and pictures; with several results a subfolder each.",
            show_default="beside each result",
        ),
    ] = None,
    form: Annotated[str, typer.Option("--format", metavar="md", help="Form of the report: Markdown.")] = "md",
) -> None:
    """Write a report with pictures. It needs the result alone, neither the data nor JAX."""
    _check_form(form)
    from vibrident import terminal
    from vibrident.report import write_report

    loaded = [(path, load_result(path)) for path in results]
    written: list[Path] = []
    if folder is None:
        for path, result in loaded:
            with written_whole(path.parent) as output:
                write_report(result, output.path)
            written += output.files
    else:
        names = [""] if len(loaded) == 1 else _distinct([path for path, _ in loaded])
        with written_whole(folder) as output:
            for name, (_, result) in zip(names, loaded, strict=True):
                write_report(result, output.path / name)
        written = output.files
    out().print(terminal.written_lines([file for file in written if file.suffix == ".md"]), crop=False)


def _check_form(form: str) -> None:
    if form not in options.FORMATS:
        raise InputError(
            f"Reports in the form {form!r} do not exist in this version.",
            expected=" | ".join(options.FORMATS),
            found=repr(form),
            where="--format",
            remedy="write Markdown and convert it, with pandoc say",
        )


def _distinct(paths: list[Path]) -> list[str]:
    """A folder name for each result: its own folder's where the files are all called alike, else the file's."""
    alike = len({path.stem for path in paths}) == 1
    names = [(path.resolve().parent.name or "result") if alike else path.stem for path in paths]
    return [f"{name}-{names[: i + 1].count(name)}" if names.count(name) > 1 else name for i, name in enumerate(names)]
