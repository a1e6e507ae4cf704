"""A history on the terminal and as files."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from vibrident.cli.console import out, printable, wrote
from vibrident.workflow.folder import written_whole

if TYPE_CHECKING:
    from vibrident.present.views import Table

PICTURES = (".png", ".svg", ".pdf")


def print_json(content: Any) -> None:
    """One JSON document on stdout."""
    typer.echo(json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False))


def print_table(table: Table, title: str) -> None:
    """A table with its notes."""
    from vibrident.present.terminal import shown

    out().print(shown(replace(table, title=title)))


def print_pairs(title: str, rows: Sequence[tuple[str, str]]) -> None:
    """Names and texts; nothing if empty."""
    from vibrident.present.terminal import shown
    from vibrident.present.views import Facts

    if rows:
        out().print(shown(Facts(tuple(rows), title)))


def print_history(document: Mapping[str, Any]) -> None:
    """The history of one sensor."""
    from vibrident.history import tables
    from vibrident.present.numbers import sensor_name

    title = f"{sensor_name(document['sensor'])}: {tables.quantity_name(document)}"
    print_table(tables.calibrations(document), title)
    print_pairs("Each with the part of U that it does not share", tables.chart(document))
    for text in tables.series(document):
        out().print(printable(text))
    for heading, rows in _parts(document):
        print_pairs(heading, rows)
    told = tables.events(document)
    if told is not None:
        print_table(told, "Events")


def _parts(document: Mapping[str, Any]) -> Iterator[tuple[str, Sequence[tuple[str, str]]]]:
    from vibrident.history import tables

    yield "Drift", tables.drift(document)
    yield "Control charts", tables.control(document)
    yield "Next calibration", tables.due(document)


def write(document: Mapping[str, Any], target: Path) -> None:
    """Write the history of one sensor in the form that the file's ending names."""
    with written_whole(target.parent) as output:
        file = output.path / target.name
        if target.suffix.lower() in PICTURES:
            from vibrident import plots
            from vibrident.history.figures import picture

            plots.save(picture(document), file)
        elif target.suffix.lower() == ".html":
            from vibrident.history.page import history_html

            file.write_text(history_html(document), encoding="utf-8")
        else:
            file.write_text(json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n", "utf-8")
    wrote(output.files)
