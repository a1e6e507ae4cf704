"""A script for Octave and MATLAB that makes the sensor's transfer function."""

from __future__ import annotations

from vibrident.export.approximation import approximate
from vibrident.export.form import Format
from vibrident.export.sensor import identity


def write(sensor, folder, options):
    """Write ``NAME.m``."""
    system, words = approximate(sensor)
    top, bottom = system.polynomials()
    path = folder / f"{options.name}.m"
    lines = [
        f"% {line}" for line in (*identity(sensor), *words)
    ]  # each is one line, whatever the result says
    lines.append(f"{options.name} = tf({list(map(float, top))}, {list(map(float, bottom))});")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return [path]


OCTAVE = Format(
    name="octave",
    title="script for Octave and MATLAB",
    write=write,
    contents="the transfer function `tf`; parameters and u as comments",
    cannot_hold="uncertainty (comments only)",
)
