"""Hold a calibration: records or a table, and the meaning of their channels, validated."""

from __future__ import annotations

import functools
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vibrident.base.amounts import pretty
from vibrident.base.binding import bound
from vibrident.base.brief import brief
from vibrident.base.errors import InputError, unknown
from vibrident.data.effects import Capability, SystematicEffect
from vibrident.data.known import KnownResponse, Mounting, refuse_known
from vibrident.data.records.basis import (
    QUANTITIES,
    REFERENCE_UNITS,
    USUAL_MODEL,
    Excitation,
    FloatArray,
    Quantity,
)
from vibrident.data.records.record import Record, ResponseTable


@dataclass(frozen=True, eq=False)
class Calibration:
    """Calibration of one sensor: records or a table, and the meaning of their channels.

    Attributes:
        records: the recordings; empty if there is a table.
        table: the tabulated response; None if there are records.
        model: name of the sensor model, such as "accelerometer+delay".
        quantity: quantity that the reference channel measures.
        reference_unit: unit of the reference after scaling.
        reference_standard_uncertainty: relative; systematic, by the calibration of the reference.
        response_unit: unit of the response after scaling.
        effects: further systematic contributions to the uncertainty.
        sensor: free text for reports (manufacturer, type, serial_number, …).
        source: path of the calibration file; empty for data made in memory.
        certificate: further data of a certificate (customer, laboratory, conditions, …); keys as in
            the calibration file, plain values, dates as ISO text.
        capabilities: smallest expanded uncertainties of the sensitivity that may be stated.
        reference_known_response: known response of the reference channel. Records then hold the
            output of that channel, and a table the response per unit of that output; ``quantity``
            and ``reference_unit`` are those of the motion.
        response_known_response: known response of the response channel; ``response_unit`` is that
            of the sensor's output.
        mounting: known properties of the sensor's mounting. If its frequency is known, its effect
            is removed from the data with the known response of the reference.

    Raises:
        InputError: neither or both of records and table are given, or the quantity is unknown.

    Examples:
        >>> import numpy as np
        >>> import vibrident
        >>> time = np.arange(4000) / 51200.0
        >>> motion = np.array([9.8 * np.sin(2 * np.pi * hz * time) for hz in (160.0, 400.0)])
        >>> calibration = vibrident.Calibration.from_arrays(motion, 0.1 * motion, 51200.0)
        >>> [record.name for record in calibration.records]
        ['record 1', 'record 2']
    """

    records: tuple[Record, ...] = ()
    table: ResponseTable | None = None
    model: str = USUAL_MODEL
    quantity: Quantity = "acceleration"
    reference_unit: str = ""
    reference_standard_uncertainty: float = 0.0
    response_unit: str = "V"
    sensor: Mapping[str, str] = field(default_factory=dict)
    source: str = ""
    certificate: Mapping[str, Any] = field(default_factory=dict)
    effects: tuple[SystematicEffect, ...] = ()
    capabilities: tuple[Capability, ...] = ()
    reference_known_response: KnownResponse | None = None
    response_known_response: KnownResponse | None = None
    mounting: Mounting | None = None

    __repr__ = brief

    def __post_init__(self) -> None:
        where = self.source or "calibration in memory"
        if bool(self.records) == (self.table is not None):
            raise InputError(
                "A calibration needs either records or a table.",
                expected="one of the two",
                found="both" if self.records else "neither",
                where=where,
                remedy="give [[records]] or [table]",
            )
        if self.quantity not in QUANTITIES:
            raise unknown("The reference quantity is not known.", self.quantity, QUANTITIES, where)
        # NumPy's string type is no static argument
        object.__setattr__(self, "quantity", str(self.quantity))
        object.__setattr__(self, "records", tuple(self.records))
        object.__setattr__(
            self, "reference_unit", self.reference_unit or REFERENCE_UNITS[self.quantity]
        )
        object.__setattr__(self, "sensor", MappingProxyType(dict(self.sensor)))
        object.__setattr__(self, "certificate", MappingProxyType(dict(self.certificate)))

    def __reduce__(self) -> tuple[object, ...]:
        # Views of mappings cannot be pickled for another process.
        values = {attribute.name: getattr(self, attribute.name) for attribute in fields(self)}
        values |= {"sensor": dict(self.sensor), "certificate": dict(self.certificate)}
        return functools.partial(Calibration, **values), ()

    def within(self, band_hz: tuple[float, float] | None) -> Calibration:
        """Return the calibration restricted to a band.

        Args:
            band_hz: lowest and highest frequency, Hz, both included; None: no restriction.

        Raises:
            InputError: the band is not valid, or no point of a table is in it.
        """
        if band_hz is None:
            return self
        low, high = map(float, band_hz)
        if not 0.0 < low < high:
            raise InputError(
                "The limits of the band are not usable.",
                expected="two positive numbers, the lower one first",
                found=f"{low:g} and {high:g}",
                where="⟦identify.band_hz⟧",
                remedy="give ⟦identify.band_hz = (LOW, HIGH)⟧ in Hz",
            )
        if self.table is not None:
            return replace(self, table=self.table.within((low, high)))
        records = tuple(replace(record, band_hz=(low, high)) for record in self.records)
        return replace(self, records=records)

    @classmethod
    def from_arrays(
        cls,
        reference: ArrayLike | Sequence[ArrayLike] | None,
        response: ArrayLike | Sequence[ArrayLike],
        sampling_rate_hz: float | Sequence[float],
        *,
        quantity: Quantity = "acceleration",
        excitation: Excitation | Sequence[Excitation] = "sine",
        names: Sequence[str] = (),
        **more: Any,
    ) -> Calibration:
        """Build a calibration from arrays.

        Args:
            reference: motion or drive in the SI unit of ``quantity``: shape (samples,) for one
                record, or (records, samples), or a sequence of arrays of any lengths; None for free
                decays.
            response: response of the sensor, in the same shape.
            sampling_rate_hz: samples per second, for all records or one number for each.
            quantity: quantity of the reference.
            excitation: kind of motion, for all records or one for each.
            names: of the records; by default ``record 1``, ….
            more: further fields of a calibration, such as ``model``, ``response_unit``, ``sensor``,
                ``effects`` and ``reference_known_response``.

        Raises:
            InputError: the arguments are of different numbers of records, or a record cannot be
                used.
        """
        responses = _split_records(response)
        count = len(responses)
        columns: dict[str, Sequence[Any]] = {
            "reference": [None] * count if reference is None else _split_records(reference),
            "sampling_rate_hz": _repeat(sampling_rate_hz, count),
            "excitation": _repeat(excitation, count),
            "name": names or [f"record {number}" for number in range(1, count + 1)],
        }
        for label, column in columns.items():
            if len(column) != count:
                raise InputError(
                    f"There is not one {label} a record.",
                    expected=f"{count}, as many as there are responses",
                    found=f"{len(column)}",
                    where="arrays of a calibration",
                    remedy="give one for each record, in the same order",
                )
        rows = zip(responses, *columns.values(), strict=True)
        records = [
            Record(str(name), reference, response, float(rate_hz), motion)
            for response, reference, rate_hz, motion, name in rows
        ]
        return cls(tuple(records), quantity=quantity, **more)

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write a calibration file and its data files, and return the path of the calibration file.

        Args:
            folder: created if missing; files of the same names are replaced, others stay.

        Returns:
            The path of ``calibration.toml``, which :func:`vibrident.read` reads back exactly.

        Raises:
            InputError: the folder cannot be written, or a record leaves samples out, which CSV
                cannot represent.
        """
        return bound("write_calibration")(folder, self)

    @property
    def units(self) -> dict[str, str]:
        """Return the unit of each channel's values, by its label."""
        channel_units = {name: chain.channel_unit for name, chain in self.known_responses.items()}
        return {"reference": self.reference_unit, "response": self.response_unit} | channel_units

    @property
    def known_responses(self) -> dict[str, KnownResponse]:
        """Return the known responses of channels by their labels; empty if none is stated.

        That of the reference leads to the motion of the sensor's housing where the mounting is
        known.
        """
        reference = self.reference_known_response
        if self.mounting is not None and self.mounting.is_known:
            coupling = replace(self.mounting.response, channel_unit=self.reference_unit)
            reference = coupling if reference is None else reference.times(coupling)
        by_channel = {"reference": reference, "response": self.response_known_response}
        return {name: chain for name, chain in by_channel.items() if chain is not None}

    def refuse_known_responses(self, what: str) -> None:
        """Refuse a calibration with known responses, which ``what`` cannot take out of the data."""
        by_channel: dict[str, object] = dict(self.known_responses)
        if self.mounting is not None and self.mounting.is_known:
            by_channel["mounting"] = self.mounting
            if self.reference_known_response is None:
                del by_channel["reference"]
        refuse_known(by_channel, what, self.source or "calibration in memory")

    def require_response(self, unit: str, without_records: str) -> None:
        """Check that there are records, and that their response is in the unit of a result.

        Args:
            unit: unit of the response of the result that is applied to the records.
            without_records: message where the calibration holds a table.

        Raises:
            InputError: the calibration holds a table, or the unit differs.
        """
        where = self.source or "calibration in memory"
        if self.table is not None:
            raise InputError(
                without_records,
                expected="a calibration with [[records]]",
                found="[table]",
                where=where,
                remedy="give a calibration file with records",
            )
        if self.response_unit != unit:
            raise InputError(
                "The response is not in the unit of the result.",
                expected=f'[response] unit = "{unit}", the unit of the result',
                found=f'unit = "{self.response_unit}"',
                where=f"{where}, [response]",
                remedy="set unit, and scale so that file values times scale are in that unit",
            )


def _split_records(channel: ArrayLike | Sequence[ArrayLike]) -> list[Any]:
    """Return the arrays of a channel, one for each record."""
    elements = list(channel) if isinstance(channel, list | tuple) else list(np.asarray(channel))
    is_one_record = not elements or np.ndim(elements[0]) == 0
    return [channel] if is_one_record else elements


def _repeat(value: Any, count: int) -> Sequence[Any]:
    """Return a value for each record: the given ones, or a single one repeated."""
    return [value] * count if np.ndim(value) == 0 else value


def describe(calibration: Calibration) -> list[dict[str, Any]]:
    """Return a row for each record, or one row for the table; labels state the units."""
    units = calibration.units
    if calibration.table is not None:
        unit = pretty(f"{units['response']}/({units['reference']})")
        return [_table_row(calibration.table, unit)]
    return [_record_row(record, units) for record in calibration.records]


def _record_row(record: Record, units: Mapping[str, str]) -> dict[str, Any]:
    return {
        "record": record.name,
        "excitation": record.excitation,
        "frequency / Hz": record.frequency_hz,
        "samples": record.samples,
        "left out": int(np.sum(~record.mask)),
        "rate / Hz": record.sampling_rate_hz,
        "duration / s": record.duration_s,
        **_channel("reference", record.reference, units["reference"]),
        **_channel("response", record.response, units["response"]),
    }


def _channel(name: str, values: FloatArray | None, unit: str) -> dict[str, float]:
    """Return the rms of a channel's motion and its offset, by labels."""
    if values is None:
        return {}
    rms = float(np.std(values))
    offset = float(np.mean(values))
    return {f"{name} rms / {pretty(unit)}": rms, f"{name} offset / {pretty(unit)}": offset}


def _table_row(table: ResponseTable, unit: str) -> dict[str, Any]:
    return {
        "table": table.provenance.file,
        "points": table.points,
        "from / Hz": float(np.min(table.frequency_hz)),
        "to / Hz": float(np.max(table.frequency_hz)),
        f"least / {unit}": float(np.min(table.magnitude)),
        f"largest / {unit}": float(np.max(table.magnitude)),
        "phase": table.phase_rad is not None,
        "uncertainties": table.magnitude_uncertainty is not None,
    }
