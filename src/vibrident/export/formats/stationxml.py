"""FDSN StationXML: a channel with a stage of poles and zeros, with uncertainties, checked.

A delay becomes poles and zeros too (Padé). The Delay of a Decimation belongs to digital stages, and
readers (evalresp, ObsPy) ignore it in the response, which would give a wrong phase.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.base.errors import InputError
from vibrident.base.escaping import xml_text
from vibrident.export.form import Format, Options, library
from vibrident.export.poles_zeros import poles_zeros, uncertainties
from vibrident.export.seismic import caveats, codes, described, unit
from vibrident.export.sensor import ExportedSensor, identity
from vibrident.show.history import date_of


def write(sensor: ExportedSensor, folder: Path, options: Options) -> list[Path]:
    """Write ``NAME.station.xml``."""
    inventory = build(sensor, options)
    stream = io.BytesIO()
    try:
        inventory.write(stream, format="STATIONXML", validate=True)
    except AssertionError as error:  # ObsPy's error for text that is invalid under its schema
        raise InputError(
            "The StationXML would not be valid.",
            expected="texts and codes that FDSN StationXML allows",
            found=str(error),
            where="result.json, sensor",
            remedy="correct the sensor's texts or ⟦export.channel⟧",
        ) from error
    path = folder / f"{options.name}.station.xml"
    path.write_bytes(stream.getvalue())
    return [path]


def build(sensor: ExportedSensor, options: Options) -> Any:
    """Return ObsPy's Inventory with one channel."""
    library("obspy", "seismic")
    from obspy.core.inventory import Channel, Comment, Equipment, Inventory, Network, Site, Station

    response, words = _response(sensor)
    network, station_code, location, code = codes(sensor, options)
    named = sensor.result.sensor
    start, since = _start(sensor)
    notes = [
        *identity(sensor),
        (
            "plusError and minusError of poles and zeros are standard uncertainties (k = 1) of "
            "their parts"
        ),
        since,
        *words,
        *caveats(sensor),
        (
            "latitude, longitude, elevation and depth are unknown and given as 0; no orientation "
            "is stated"
        ),
    ]
    channel = Channel(
        code,
        location,
        *(0.0, 0.0, 0.0, 0.0),
        response=response,
        sensor=Equipment(
            type=_named_value(named, "type"),
            manufacturer=_named_value(named, "manufacturer"),
            serial_number=_named_value(named, "serial_number"),
            description=sensor.model.core.title,
        ),
        start_date=start,
        comments=[Comment(xml_text(text)) for text in notes],
    )
    station = Station(
        station_code,
        0.0,
        0.0,
        0.0,
        channels=[channel],
        site=Site(name="not stated"),
        start_date=start,
    )
    return Inventory(networks=[Network(network, stations=[station])], source="vibrident")


def _start(sensor: ExportedSensor) -> tuple[Any, str]:
    """Return the start date and its origin: the calibration's date, else that of the evaluation."""
    from obspy import UTCDateTime

    day = date_of(sensor.result)
    certificate_date = sensor.result.certificate.get("date_of_calibration")
    if day is None:
        return None, "no date of the calibration is stated: the start date is left out"
    is_stated = str(certificate_date or "")[:10] == day.isoformat()
    words = "calibration" if is_stated else "evaluation, as no date of the calibration is stated"
    return UTCDateTime(day.year, day.month, day.day), f"the start date is that of the {words}"


def _named_value(named: Mapping[str, str], key: str) -> str | None:
    return xml_text(named[key]) if named.get(key) else None


def _response(sensor: ExportedSensor) -> tuple[Any, list[str]]:
    """Return ObsPy's Response for the usual motion, normalised in the middle of the band."""
    from obspy.core.inventory.response import (
        InstrumentSensitivity,
        PolesZerosResponseStage,
        Response,
    )

    system, words = described(sensor)
    zeros = system.zeros
    quantity = "m/s^2"
    order = 0
    if sensor.model.core.output == "velocity":  # per velocity, as seismometers are stated
        zeros = np.concatenate([np.zeros(1, complex), zeros])
        quantity = "m/s"
        order = 1
    frequency = float(
        (sensor.band_hz[0] * sensor.band_hz[1]) ** 0.5
    )  # the band's middle on a logarithmic axis
    motion = (2j * np.pi * frequency) ** order
    value = complex(system.response(np.array([frequency]))[0] * motion)
    gain = float(np.copysign(abs(value), sensor.values[sensor.model.gain_name]))
    of_sensor = poles_zeros(sensor)
    u_poles = uncertainties(sensor, "poles")
    u_zeros = uncertainties(sensor, "zeros")
    units = (unit(quantity), xml_text(unit(sensor.output_unit)))
    stage = PolesZerosResponseStage(
        1,
        gain,
        frequency,
        *units,
        pz_transfer_function_type="LAPLACE (RADIANS/SECOND)",
        normalization_frequency=frequency,
        normalization_factor=system.gain / gain,
        zeros=[
            _root(z, u_zeros, k - order if 0 <= k - order < len(of_sensor.zeros) else None)
            for k, z in enumerate(zeros)
        ],
        poles=[
            _root(p, u_poles, k if k < len(of_sensor.poles) else None)
            for k, p in enumerate(system.poles)
        ],
    )
    return Response(
        instrument_sensitivity=InstrumentSensitivity(gain, frequency, *units),
        response_stages=[stage],
    ), words


def _root(root: complex, u: np.ndarray | None, index: int | None) -> Any:
    """Return a pole or zero; without uncertainty if it is not the sensor's, or none is stated."""
    from obspy.core.inventory.response import ComplexWithUncertainties

    if u is None or index is None:
        return ComplexWithUncertainties(complex(root))
    spread = complex(u[index])
    return ComplexWithUncertainties(
        complex(root), lower_uncertainty=spread, upper_uncertainty=spread
    )


STATIONXML = Format(
    name="stationxml",
    title="FDSN StationXML",
    write=write,
    contents=(
        "poles and zeros with u (`plusError`, `minusError`, k = 1), sensitivity in the middle of "
        "the band, parameters as comments"
    ),
    cannot_hold="correlation; uncertainty over frequency; place and orientation",
    options=("channel",),
    extra="seismic",
)
