"""``vibrident export``: a result in another program's format."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from vibrident.cli import options
from vibrident.cli.console import wrote
from vibrident.registry import EXPORTS
from vibrident.workflow.folder import written_whole
from vibrident.workflow.results import load_result


def export(
    result: Annotated[
        Path, typer.Argument(metavar="RESULT", help="result.json of an identification.", show_default=False)
    ],
    form: Annotated[
        str, options.choice("--format", EXPORTS.names, "Format to write.", "{exports}", show_default=False)
    ],
    folder: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Folder for the files.", show_default="beside the result"),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(
            "--rate",
            metavar="HZ",
            help="Sampling rate of {exports: rate_hz}.",
            show_default="the network's, where there is one",
        ),
    ] = None,
    band: Annotated[
        str | None,
        typer.Option("--band", metavar="LOW:HIGH", help="Band of use in Hz.", show_default="that of the data"),
    ] = None,
    without: Annotated[
        str | None,
        typer.Option(
            "--without",
            metavar="NAMES",
            help="Leave out {add-ons apart}, if a format cannot hold them; the file states the error.",
            callback=options.listed("--without", options.not_rational),
        ),
    ] = None,
    name: Annotated[str, typer.Option("--name", metavar="NAME", help="Name of files and functions.")] = "sensor",
    schema: Annotated[
        Path | None, typer.Option("--schema", metavar="XSD", help="{exports: schema}: validate against this schema.")
    ] = None,
    country: Annotated[
        str | None,
        typer.Option(
            "--country", metavar="XX", help="{exports: country}: ISO 3166-1 code of the laboratory's country."
        ),
    ] = None,
    channel: Annotated[
        str | None,
        typer.Option("--channel", metavar="NET.STA.LOC.CHA", help="{exports: channel}: codes of the channel."),
    ] = None,
) -> None:
    """Write a result in another program's format, from the result alone.

    What a format cannot hold is stated in the file, or refused with the reason.
    """
    known = load_result(result)
    limits = options.band(band)
    from vibrident.export import export as run

    with written_whole(result.parent if folder is None else folder) as output:
        run(
            known,
            form,
            output.path,
            rate_hz=rate,
            band_hz=limits,
            without=list(without or ()),
            name=name,
            schema=schema,
            country=country,
            channel=channel,
        )
    wrote(output.files)
