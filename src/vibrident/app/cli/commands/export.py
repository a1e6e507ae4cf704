"""``vibrident export``: a result in another program's format."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from vibrident.app.cli import options
from vibrident.app.cli.console import show_written
from vibrident.app.cli.options import choice, flag, option
from vibrident.app.workflow.folder import written_whole
from vibrident.export.registry import EXPORTS


def export(
    result: Path = options.RESULT_FILE,
    form: str = choice("--format", EXPORTS.names, "Format to write.", ..., "{exports}", False),
    folder: Path | None = option(
        "--out", "DIR", "Folder for the files.", default="beside the result"
    ),
    rate: float | None = options.rate(
        "--rate", "Sampling rate of {exports: rate_hz}.", "the network's, where there is one"
    ),
    band: str | None = option(
        "--band", "LOW:HIGH", "Band of use in Hz.", default="that of the data"
    ),
    without: str | None = option(
        "--without",
        "NAMES",
        "Leave out {add-ons apart}, if a format cannot hold them; the file states the error.",
        callback=options.listed("--without", options.not_rational),
    ),
    name: str = option("--name", "NAME", "Name of files and functions.", "sensor"),
    schema: Path | None = option(
        "--schema", "XSD", "{exports: schema}: validate against this schema."
    ),
    country: str | None = option(
        "--country", "XX", "{exports: country}: ISO 3166-1 code of the laboratory's country."
    ),
    certificate: list[Path] | None = options.CERTIFICATE_FILES,
    channel: str | None = option(
        "--channel", "NET.STA.LOC.CHA", "{exports: channel}: codes of the channel."
    ),
    online: bool = flag(
        "--online", help="{exports: online}: the tracker (learner, detector, corrector)."
    ),
) -> None:
    """Write a result in another program's format, from the result alone.

    What a format cannot hold is stated in the file, or refused with the reason.
    """
    limits = options.band(band)
    is_given = {
        "rate_hz": rate is not None,
        "schema": schema is not None,
        "country": country is not None,
        "channel": channel is not None,
        "online": online,
    }
    _refuse_unused(form, is_given)
    from vibrident.export import export as run

    with written_whole(result.parent if folder is None else folder) as output:
        run(
            result,
            form,
            output.path,
            rate_hz=rate,
            band_hz=limits,
            without=list(without or ()),
            name=name,
            certificate=certificate or (),
            schema=schema,
            country=country,
            channel=channel,
            online=online,
        )
    show_written(output.files)


def _refuse_unused(form: str, is_given: Mapping[str, bool]) -> None:
    """Refuse options that the format does not take; ``is_given``: by name of the export's."""
    for name, is_set in is_given.items():
        if name not in EXPORTS[form].options:
            flag_name = f"--{name.removesuffix('_hz')}"
            options.refuse_unused({flag_name: is_set}, f"--format {options.formats_with(name)}")
