"""Input motion, channel codes and refusals of both seismological formats."""

from __future__ import annotations

import re

from vibrident.base.errors import InputError
from vibrident.data.records import is_motion
from vibrident.export.approximation import approximate
from vibrident.export.form import Options
from vibrident.export.poles_zeros import PolesZeros
from vibrident.export.sensor import ExportedSensor
from vibrident.show.numbers import reference_quantity

#: Units in the spelling of SEED and StationXML, if different.
_SPELLING = {"m/s^2": "M/S**2", "m/s": "M/S", "m": "M", "counts": "count"}
#: Of network, station, location and channel: those of FDSN.
_CODES = re.compile(r"([A-Z0-9]{1,8})\.([A-Z0-9-]{1,8})\.([A-Z0-9-]{0,8})\.([A-Z0-9]{3})")


def codes(sensor: ExportedSensor, options: Options) -> tuple[str, str, str, str]:
    """Return the codes of network, station, location and channel.

    By default they are of the test network XX and no direction.

    Raises:
        InputError: the codes cannot be read.
    """
    kind = "HH1" if sensor.model.core.output == "velocity" else "HN1"
    text = options.channel or f"XX.SENS..{kind}"
    match = _CODES.fullmatch(text)
    if not match:
        raise InputError(
            "The channel's codes cannot be read.",
            expected=(
                "NET.STA.LOC.CHA in capitals and digits, LOC may be empty, such as XX.SENS..HHZ"
            ),
            found=repr(text),
            where="⟦export.channel⟧",
            remedy="state four codes, such as XX.SENS.00.HHZ, or leave ⟦export.channel⟧ out",
        )
    network, station, location, channel = match.groups()
    return network, station, location, channel


def described(sensor: ExportedSensor) -> tuple[PolesZeros, list[str]]:
    """Return poles and zeros from acceleration to response, and the approximations.

    Raises:
        InputError: the reference was a drive, or the sensor has no form in poles and zeros.
    """
    if not is_motion(sensor.quantity):
        raise InputError(
            f"A response to a {sensor.quantity} cannot be described as one to ground motion.",
            expected="a calibration against acceleration, velocity or displacement",
            found=f"reference quantity {sensor.quantity!r} ({sensor.input_unit})",
            where="result.json, reference",
            remedy="choose another format, such as csv or c, or calibrate against motion",
        )
    return approximate(sensor)


def unit(name: str) -> str:
    """Return a unit as SEED spells it."""
    return _SPELLING.get(name, name)


def caveats(sensor: ExportedSensor) -> list[str]:
    """Return the limits of the description by poles and zeros."""
    lines = [
        "poles and zeros hold neither the correlation of the parameters nor the uncertainty of the "
        "response over frequency: see result.json"
    ]
    if (reference := reference_quantity(sensor.result)) != "acceleration":
        lines.append(f"calibrated against {reference}; converted by powers of s, exactly")
    return lines
