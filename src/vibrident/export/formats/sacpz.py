"""SAC poles and zeros: from ground displacement in metres to the response, in rad/s.

SAC's input is displacement, so the two zeros of acceleration = s² · displacement are added. ObsPy's
writer keeps seven digits; this one keeps all.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vibrident.base.escaping import sac_comment
from vibrident.export.form import Format, Options
from vibrident.export.poles_zeros import PolesZeros
from vibrident.export.seismic import caveats, codes, described, unit
from vibrident.export.sensor import ExportedSensor, identity


def write(sensor: ExportedSensor, folder: Path, options: Options) -> list[Path]:
    """Write ``NAME.sacpz``."""
    system, words = described(sensor)
    cancelled = _cancelled(
        PolesZeros(np.concatenate([np.zeros(2, complex), system.zeros]), system.poles, system.gain)
    )
    network, station, location, channel = codes(sensor, options)
    lines = [
        f"* NETWORK     : {network}",
        f"* STATION     : {station}",
        f"* LOCATION    : {location}",
        f"* CHANNEL     : {channel}",
        "* INPUT UNIT  : M",
        f"* OUTPUT UNIT : {sac_comment(unit(sensor.output_unit))}",
        *(f"* {sac_comment(line)}" for line in identity(sensor)),
        "* this format holds no uncertainties; those above are comments",
        *(f"* {sac_comment(line)}" for line in (*words, *caveats(sensor))),
        *_numbers("ZEROS", cancelled.zeros),
        *_numbers("POLES", cancelled.poles),
        f"CONSTANT {cancelled.gain!r}",
    ]
    path = folder / f"{options.name}.sacpz"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return [path]


def _cancelled(system: PolesZeros) -> PolesZeros:
    """Cancel poles at zero with zeros there."""
    places = [np.flatnonzero(roots == 0) for roots in (system.zeros, system.poles)]
    both = min(map(len, places))
    zeros = np.delete(system.zeros, places[0][:both])
    poles = np.delete(system.poles, places[1][:both])
    return PolesZeros(zeros, poles, system.gain)


def _numbers(name: str, roots: np.ndarray) -> list[str]:
    return [f"{name} {len(roots)}", *(f"{float(r.real)!r} {float(r.imag)!r}" for r in roots)]


SACPZ = Format(
    name="sacpz",
    title="SAC poles and zeros",
    write=write,
    holds="poles, zeros, constant",
    cannot_hold="uncertainty (comments only)",
    options=("channel",),
)
