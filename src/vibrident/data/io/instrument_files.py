"""Responses of seismic instruments: StationXML and RESP (by obspy), and SACPZ.

The transfer function is the product of the stages', each of its own gain at its own frequency (SEED
manual 2.4, appendix C). A symmetric digital filter has no delay, as recorders stamp its middle
(evalresp); others have theirs, less the correction that the file states.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.io.columns import library
from vibrident.data.known import (
    DigitalFilter,
    KnownResponse,
    RationalResponse,
    Shape,
    Tabulated,
    flat_gain,
)
from vibrident.data.records import FloatArray

_ZEROS_AND_POLES = re.compile(r"^\s*(ZEROS|POLES|CONSTANT)\s+(\S+)", re.IGNORECASE)
_UNIT = re.compile(r"^\s*\*+\s*(INPUT|OUTPUT)\s+UNITS?\s*:\s*(\S+)", re.IGNORECASE)
_RESP = re.compile(r"^B05\dF\d\d", re.MULTILINE)
#: Characters at the head of a file that tell its kind.
_HEAD = 20_000
_UNITS = {"M": "m", "M/S": "m/s", "M/S**2": "m/s^2", "COUNTS": "counts", "COUNT": "counts"}
_UNITS |= {"NM": "nm", "NM/S": "nm/s", "NM/S**2": "nm/s^2"}


def is_instrument_file(path: Path) -> bool:
    """Tell whether a file is StationXML, RESP or SACPZ, by its head; InputError if unreadable."""
    head = _text(path)[:_HEAD]
    return _is_inventory(head) or _is_sacpz(head)


def read_instrument(path: Path, channel: str | None, time: str | None) -> tuple[KnownResponse, str]:
    """Read the response of a channel; return its unit, too, such as counts/(m/s).

    Args:
        path: of the file.
        channel: its code, such as BHZ or GR.FUR..BHZ; None where the file has one.
        time: a date within the epoch; None where there is one.

    Raises:
        InputError: the file cannot be read, or holds several responses, or one that is not linear.
    """
    text = _text(path)
    if not _is_inventory(text[:_HEAD]):
        return _read_sacpz(text, path)
    obspy = library("obspy", "seismic", path)
    try:
        inventory = obspy.read_inventory(str(path))
        moment = None if time is None else obspy.UTCDateTime(time)
    except Exception as error:  # obspy raises whatever its parsers do
        raise _refused(path, "a response that obspy reads", str(error)[:200]) from error
    response = _one_response(inventory, channel, moment, path)
    return _known_response(response, path)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        problem = "The file of a known response cannot be read."
        raise InputError(
            problem,
            expected="a file",
            found=error.strerror or str(error),
            where=str(path),
            remedy="correct its name; it is relative to the calibration file",
        ) from error


def _is_inventory(head: str) -> bool:
    return "FDSNStationXML" in head or _RESP.search(head) is not None


def _is_sacpz(head: str) -> bool:
    words = {m[1].upper() for line in head.splitlines() if (m := _ZEROS_AND_POLES.match(line))}
    return {"POLES", "CONSTANT"} <= words or {"ZEROS", "CONSTANT"} <= words


def _read_sacpz(text: str, path: Path) -> tuple[KnownResponse, str]:
    roots: dict[str, list[complex]] = {"ZEROS": [], "POLES": []}
    counts = {"ZEROS": 0, "POLES": 0}
    constant = 1.0
    current = ""
    units = {"INPUT": "m", "OUTPUT": "counts"}
    try:
        for line in text.splitlines():
            if match := _UNIT.match(line):
                units[match[1].upper()] = _plain(match[2])
            elif match := _ZEROS_AND_POLES.match(line):
                current = match[1].upper()
                if current == "CONSTANT":
                    constant = float(match[2])
                else:
                    counts[current] = int(match[2])
            elif current in roots and (numbers := line.split()) and not line.startswith("*"):
                roots[current].append(complex(float(numbers[0]), float(numbers[1])))
    except (ValueError, IndexError) as error:
        raise _refused(path, "ZEROS, POLES and CONSTANT with numbers", str(error)[:200]) from error
    for name, listed in roots.items():  # those that are not listed lie at the origin
        listed += [0j] * (counts[name] - len(listed))
    response = KnownResponse.from_poles(roots["POLES"], roots["ZEROS"], constant)
    return response, f"{units['OUTPUT']}/({units['INPUT']})"


def _one_response(inventory: Any, channel: str | None, moment: Any, path: Path) -> Any:
    """Return the only response that the file has for a channel and a time."""
    responses = []
    channels = [
        (net, station, candidate) for net in inventory for station in net for candidate in station
    ]
    for network, station, candidate in channels:
        code = f"{network.code}.{station.code}.{candidate.location_code}.{candidate.code}"
        is_asked_for = channel in (None, code, candidate.code) and candidate.is_active(moment)
        if is_asked_for and candidate.response is not None:
            epoch = "" if candidate.start_date is None else f" from {candidate.start_date.date}"
            responses.append((f"{code}{epoch}", candidate.response))
    if len(responses) != 1:
        remedy = "name one by channel, and its epoch by time"
        names = ", ".join(name for name, _ in responses[:8]) or "none"
        raise _refused(path, "one response", f"{len(responses)}: {names}", remedy)
    return responses[0][1]


def _known_response(response: Any, path: Path) -> tuple[KnownResponse, str]:
    """Return the response of all stages, else of the sensitivity alone, and its unit."""
    stages = response.response_stages
    sensitivity = response.instrument_sensitivity
    if not stages and sensitivity is None:
        raise _refused(path, "stages, or a sensitivity", "neither")
    shapes: list[Shape] = [shape for stage in stages for shape in _shapes(stage, path)]
    shapes = shapes or [flat_gain(sensitivity.value)]
    first, last = (stages[0], stages[-1]) if stages else (sensitivity, sensitivity)
    unit = f"{_plain(last.output_units)}/({_plain(first.input_units)})"
    return KnownResponse(tuple(shapes), band_hz=(0.0, min(s.top_hz for s in shapes))), unit


def _shapes(stage: Any, path: Path) -> list[Shape]:
    """Return the shapes of a stage: its filter, and the gain that it has at its own frequency."""
    gain = 1.0 if stage.stage_gain is None else float(stage.stage_gain)
    shape = _filter(stage, path)
    if shape is None:
        return [flat_gain(gain)]
    at = stage.stage_gain_frequency
    size = 0.0 if at is None else float(np.abs(shape.at(np.array(float(at)))))
    return [shape, flat_gain(gain / size if size > 0.0 and math.isfinite(size) else gain)]


def _filter(stage: Any, path: Path) -> Shape | None:
    """Return the filter of a stage; None where it has a gain alone."""
    kind = type(stage).__name__
    rate_hz = stage.decimation_input_sample_rate
    if kind == "PolesZerosResponseStage":
        return _poles(stage, rate_hz)
    if kind == "FIRResponseStage":
        taps = np.array([float(c) for c in stage.coefficients])
        mirrored = {"ODD": taps[-2::-1], "EVEN": taps[::-1]}.get(stage.symmetry, taps[:0])
        return _digital(stage, np.concatenate([taps, mirrored]), np.ones(1))
    if kind == "CoefficientsTypeResponseStage":
        taps, below = (
            np.array([float(c) for c in coefficients])
            for coefficients in (stage.numerator, stage.denominator)
        )
        none = not taps.size or not rate_hz
        return None if none else _digital(stage, taps, below if below.size else np.ones(1))
    if kind == "ResponseListResponseStage":
        listed = [
            (float(e.frequency), float(e.amplitude), float(e.phase))
            for e in stage.response_list_elements
        ]
        hz, size, degrees = np.array(listed).T
        return Tabulated(hz, size, np.deg2rad(degrees))
    if kind == "ResponseStage":
        return None
    raise _refused(path, "stages that are linear", kind)


def _digital(stage: Any, taps: FloatArray, below: FloatArray) -> DigitalFilter:
    """Return a digital filter, at the stamps of the recorder: of a symmetric one, of its middle."""
    rate_hz = float(stage.decimation_input_sample_rate)
    advance_s = float(stage.decimation_correction or 0.0)
    if below.size == 1 and np.allclose(
        taps, taps[::-1], rtol=0.0, atol=1e-9 * np.max(np.abs(taps))
    ):
        advance_s = 0.5 * (taps.size - 1) / rate_hz
    return DigitalFilter(taps, below, rate_hz, advance_s)


def _poles(stage: Any, rate_hz: Any) -> Shape:
    poles, zeros = (
        np.array([complex(r) for r in roots], dtype=complex) for roots in (stage.poles, stage.zeros)
    )
    factor = float(stage.normalization_factor or 1.0)
    kind = stage.pz_transfer_function_type
    if kind == "DIGITAL (Z-TRANSFORM)":
        later = max(poles.size - zeros.size, 0)
        top = np.concatenate([np.zeros(later), factor * np.real(np.poly(zeros)).astype(float)])
        return DigitalFilter(top, np.real(np.poly(poles)).astype(float), float(rate_hz))
    if kind == "LAPLACE (HERTZ)":
        turn = 2.0 * np.pi
        factor *= turn ** (poles.size - zeros.size)
        poles = turn * poles
        zeros = turn * zeros
    return RationalResponse(poles.astype(complex), zeros.astype(complex), factor)


def _plain(unit: str | None) -> str:
    text = (unit or "1").strip()
    return _UNITS.get(text.upper(), text)


def _refused(path: Path, expected: str, value: str, remedy: str = "") -> InputError:
    return InputError(
        "The response of an instrument cannot be taken from its file.",
        expected=expected,
        found=value,
        where=str(path),
        remedy=remedy or "correct the file, or give poles and zeros",
    )
