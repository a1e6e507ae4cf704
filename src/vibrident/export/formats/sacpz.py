"""SAC poles and zeros, written by ObsPy from the StationXML.

They lead from ground displacement in metres to the response.
"""

from __future__ import annotations

import io
from pathlib import Path

from vibrident.base.escaping import sac_comment
from vibrident.export.form import Format, Options
from vibrident.export.formats import stationxml
from vibrident.export.seismic import caveats, described
from vibrident.export.sensor import ExportedSensor, identity


def write(sensor: ExportedSensor, folder: Path, options: Options) -> list[Path]:
    """Write ``NAME.sacpz``: comments, then ObsPy's lines for the channel."""
    stream = io.StringIO()
    stationxml.build(sensor, options).write(stream, format="SACPZ")
    _, approximations = described(sensor)
    notes = [*identity(sensor), "this format holds no uncertainties; those above are comments"]
    notes += [*approximations, *caveats(sensor)]
    comments = "".join(f"* {sac_comment(note)}\n" for note in notes)
    path = folder / f"{options.name}.sacpz"
    path.write_text(comments + stream.getvalue(), encoding="utf-8")
    return [path]


SACPZ = Format(
    name="sacpz",
    title="SAC poles and zeros",
    write=write,
    contents="poles, zeros, constant, with seven digits",
    cannot_hold="uncertainty (comments only)",
    options=("channel",),
    extra="seismic",
)
