"""Combine the known responses of a calibration file to one for each channel, in its units.

The entries of a channel are a chain from the recorder to the motion. The denominator of each unit
is the numerator of the next: ``V/pC``, then ``pC/(m/s^2)``. The chain of a reference ends at a unit
of motion; a response per velocity becomes one per acceleration by one pole at s = 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.io.calibration_file import CalibrationFile, TableSection
from vibrident.data.io.instrument_files import is_instrument_file, read_instrument
from vibrident.data.io.known_section import KnownResponseEntry
from vibrident.data.io.reader import sha256
from vibrident.data.io.table_file import read_table
from vibrident.data.io.units import QUANTITY_UNITS, factor_between, parse_unit, quantity_of
from vibrident.data.known import KnownResponse, RationalResponse, flat_gain
from vibrident.data.known.unsure import flat_effects
from vibrident.data.records import MOTIONS, REFERENCE_UNITS, is_motion

ChannelName = Literal["reference", "response"]
_TABLE_KEYS = (
    *("frequency", "magnitude", "phase", "magnitude_uncertainty", "phase_uncertainty"),
    *("phase_unit", "magnitude_unit", "coverage_factor"),
)


@dataclass(frozen=True)
class KnownChannel:
    """Known response of a channel, and the units at both ends of its chain."""

    response: KnownResponse | None
    channel_unit: str
    measured: str


def known_channel(
    document: CalibrationFile, name: ChannelName, folder: Path, where: str
) -> KnownChannel:
    """Return the known response of a channel that a calibration file states."""
    section = getattr(document, name)
    quantity = document.reference.quantity
    target = REFERENCE_UNITS[quantity] if quantity != "drive" else document.reference.unit
    if not section.known_response:
        return KnownChannel(None, section.unit, target if name == "reference" else section.unit)
    channel_unit = unit = section.unit or "V"
    chain: KnownResponse | None = None
    for number, entry in enumerate(section.known_response, start=1):
        location = f"{where}, [[{name}.known_response]] entry {number}"
        default_unit = f"{unit}/({target})" if name == "reference" and quantity != "drive" else "1"
        response, response_unit = _read_response(entry, unit, default_unit, folder, location)
        factor, unit = _factor_and_input_unit(unit, response_unit, location)
        shapes = response.shapes if factor == 1.0 else (*response.shapes, flat_gain(factor))
        response = replace(response, channel_unit=channel_unit, shapes=shapes)
        chain = response if chain is None else chain.times(response)
    assert chain is not None
    if name == "reference" and quantity != "drive":
        chain = _convert_to_motion(chain, unit, quantity, f"{where}, [[reference.known_response]]")
        unit = target
    return KnownChannel(chain, channel_unit, unit)


def as_channels(document: CalibrationFile) -> CalibrationFile:
    """Return the document by which the files are read: a reference that is known is a channel."""
    reference = document.reference
    if not reference.known_response or document.interferometer is not None:
        return document
    update = {"quantity": "drive", "unit": reference.unit or "V"}
    return document.model_copy(update={"reference": reference.model_copy(update=update)})


def known_files(document: CalibrationFile) -> list[str]:
    """Return the names of the files that state known responses."""
    sections = (document.reference, document.response)
    return [e.file for section in sections for e in section.known_response if e.file is not None]


def _read_response(
    entry: KnownResponseEntry, channel_unit: str, default_unit: str, folder: Path, where: str
) -> tuple[KnownResponse, str]:
    """Return the response of an entry and its unit, else ``default_unit``."""
    try:
        response, unit = _read_entry(entry, channel_unit, default_unit, folder, where)
    except InputError as error:
        raise (error.at(where) if error.where == "known response" else error) from None
    flat = flat_effects(
        response.source, entry.standard_uncertainty, entry.phase_standard_uncertainty
    )
    response = replace(response, effects=(*response.effects, *flat))
    if entry.file is not None:
        response = replace(response, files=((entry.file, sha256(folder / entry.file)),))
    return response, unit


def _read_entry(
    entry: KnownResponseEntry, channel_unit: str, default_unit: str, folder: Path, where: str
) -> tuple[KnownResponse, str]:
    response_unit = entry.unit or "1"
    gain = 1.0 if entry.gain is None else entry.gain
    if entry.numerator is not None:
        assert entry.rate_hz is not None  # checked with the file
        denominator = entry.denominator or [1.0]
        response = KnownResponse.from_filter(entry.numerator, denominator, rate_hz=entry.rate_hz)
        return response, response_unit
    if entry.poles is not None or entry.zeros is not None:
        poles, zeros = (
            [complex(*root) for root in roots or ()] for roots in (entry.poles, entry.zeros)
        )
        return KnownResponse.from_poles(poles, zeros, gain), response_unit
    if entry.file is None:
        corners = entry.highpass_hz or (), entry.lowpass_hz or ()
        u = entry.corner_uncertainty
        return KnownResponse.from_corners(*corners, gain, corner_uncertainty=u), response_unit
    path = folder / entry.file
    if path.suffix.lower() == ".json":
        return _read_result(path, entry, default_unit)
    if is_instrument_file(path):
        response, unit = read_instrument(path, entry.channel, entry.time)
        return replace(response, source=entry.file), entry.unit or unit
    return _read_response_table(entry, channel_unit, entry.unit or default_unit, folder, where)


def _read_result(
    path: Path, entry: KnownResponseEntry, default_unit: str
) -> tuple[KnownResponse, str]:
    """Return the response of a result's sensor, per the motion that is wanted if any is."""
    motion_unit = default_unit.partition("/")[2]
    response = KnownResponse.from_result(path, quantity_of(motion_unit))
    source = str(entry.file)
    effects = tuple(replace(effect, source=source) for effect in response.effects)
    unit = entry.unit or f"{response.channel_unit}/({motion_unit or '1'})"
    return replace(response, source=source, effects=effects), unit


def _read_response_table(
    entry: KnownResponseEntry, channel_unit: str, unit: str, folder: Path, where: str
) -> tuple[KnownResponse, str]:
    """Return the response of a table, read as tabulated calibrations are."""
    numerator, _, denominator = unit.partition("/")
    if unit == "1":
        numerator = denominator = channel_unit
    quantity = quantity_of(denominator) or "drive"
    if entry.phase is None:
        raise InputError(
            "The table of a known response has no phase.",
            expected="frequency, magnitude and phase",
            found="phase not stated",
            where=where,
            remedy="add phase = …, the column that holds it",
        )
    stated_keys = {k: getattr(entry, k) for k in _TABLE_KEYS if k in entry.model_fields_set}
    document = CalibrationFile.model_validate(
        {
            "reference": {"quantity": quantity, "unit": "" if quantity != "drive" else denominator},
            "response": {"unit": numerator},
            "table": TableSection.model_validate({"file": entry.file, **stated_keys}),
        }
    )
    table = read_table(document, folder, where)
    assert table.phase_rad is not None
    response = KnownResponse.from_table(
        table.frequency_hz,
        table.magnitude,
        table.phase_rad,
        magnitude_uncertainty=table.magnitude_uncertainty,
        phase_uncertainty_rad=table.phase_uncertainty_rad,
        correlation_octaves=entry.correlation_octaves,
        source=str(entry.file),
    )
    if unit == "1":
        return response, unit
    if quantity in QUANTITY_UNITS:
        denominator = REFERENCE_UNITS[quantity]
    return response, f"{numerator}/({denominator})"


def _factor_and_input_unit(unit: str, response_unit: str, where: str) -> tuple[float, str]:
    """Return the factor to a channel's unit, and the unit of the input of the response."""
    if response_unit.strip() == "1":
        return 1.0, unit
    numerator, _, denominator = response_unit.partition("/")
    factor = factor_between(numerator, unit)
    if factor is None or not denominator:
        raise InputError(
            "The unit of a known response does not fit its channel.",
            expected=f'"1", or a multiple of {unit} per another unit, such as "{unit}/(m/s^2)"',
            found=f'unit = "{response_unit}"',
            where=where,
            remedy="correct it, or unit of the channel; entries go from the recorder to the motion",
        )
    denominator = denominator.strip()
    if denominator.startswith("(") and denominator.endswith(")"):
        denominator = denominator[1:-1]
    return factor, denominator


def _convert_to_motion(
    response: KnownResponse, unit: str, quantity: str, where: str
) -> KnownResponse:
    """Return a reference's response per SI unit of ``quantity``, from that per ``unit``."""
    stated_quantity = quantity_of(unit)
    if stated_quantity is None or is_motion(stated_quantity) != is_motion(quantity):
        raise InputError(
            "The known responses do not lead from the channel to the motion.",
            expected=f"units that end at one of motion, such as V/({REFERENCE_UNITS[quantity]})",
            found=f"an end at {unit!r}",
            where=where,
            remedy="state unit of the entries, or of [reference]",
        )
    steps = 0
    if stated_quantity in MOTIONS and quantity in MOTIONS:
        steps = MOTIONS.index(stated_quantity) - MOTIONS.index(quantity)  # K per x = K per v · s
    parsed = parse_unit(unit)
    assert parsed is not None
    if steps == 0 and math.isclose(parsed.factor, 1.0):
        return response
    poles, zeros = (np.zeros(max(count, 0), dtype=complex) for count in (steps, -steps))
    shape = RationalResponse(poles, zeros, 1.0 / parsed.factor)
    return replace(response, shapes=(*response.shapes, shape))
