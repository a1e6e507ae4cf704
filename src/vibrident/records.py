"""What was measured, in physical units: records, tabulated responses, the calibration that holds them. Validated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from vibrident.effects import SystematicEffect
from vibrident.errors import InputError, unknown

if TYPE_CHECKING:
    from vibrident.interferometer.summary import OpticalSummary

Quantity = Literal["acceleration", "velocity", "displacement", "drive"]
Excitation = Literal["sine", "multisine", "sweep", "random", "shock", "decay"]
QUANTITIES: tuple[str, ...] = get_args(Quantity)
EXCITATIONS: tuple[str, ...] = get_args(Excitation)

#: SI unit of the reference channel by quantity; a drive keeps its own unit.
REFERENCE_UNITS: Mapping[str, str] = MappingProxyType(
    {"acceleration": "m/s^2", "velocity": "m/s", "displacement": "m", "drive": "drive unit"}
)

LARGEST = 1e30  # of a channel's largest value in its unit; the least is one over it
#: Standard acceleration of free fall, m/s² (CGPM 1901; ISO 80000-3).
STANDARD_GRAVITY = 9.80665
#: The sensor model of a calibration that names no model.
USUAL_MODEL = "accelerometer"

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


def _frozen(values: object) -> FloatArray:
    array = np.array(values, dtype=np.float64)  # a copy: a record does not follow its source
    array.flags.writeable = False
    return array


@dataclass(frozen=True)
class Provenance:
    """Where data came from and what was done to them.

    Attributes:
        file: file name, as given by the user; empty for data made in memory.
        sha256: hex digest of the file's bytes; empty for data made in memory.
        history: what was done, oldest first, in words.
    """

    file: str = ""
    sha256: str = ""
    history: tuple[str, ...] = ()

    def then(self, step: str) -> Provenance:
        """Return the same provenance with one more step in its history."""
        return replace(self, history=(*self.history, step))


@dataclass(frozen=True, eq=False)
class Record:
    """One simultaneous recording of the reference and the response, equally spaced in time.

    Attributes:
        name: short name for tables and messages (the file name, usually).
        reference: shape (samples,), in the SI unit of the calibration's reference quantity; None for a free decay.
        response: shape (samples,), in the calibration's response unit.
        sampling_rate_hz: samples per second.
        excitation: kind of motion.
        frequency_hz: start value for a sine's frequency; None where it is to be found in the data.
        valid: shape (samples,), False where a sample must be left out of every fit (clipped, say).
        reference_valid: shape (samples,), where the reference may be used as the sensor's input, though the response is
            not valid there; None: as ``valid``.
        start_time_s: time of the first sample on the file's own clock.
        reference_full_scale, response_full_scale: largest magnitude a channel can hold, in its unit; None if unknown.
        contradicting_rate_hz: rate by the file's own time column where that is another; None where nothing contradicts.
        provenance: file, hash and history.
        optical: what the signals of an interferometer said, from which the reference was made; None for others.

    Raises:
        InputError: the arrays are not one-dimensional, differ in length, are shorter than 8 samples or hold a
            value that is not finite, or the sampling rate is not a positive number.
    """

    name: str
    reference: FloatArray | None
    response: FloatArray
    sampling_rate_hz: float
    excitation: Excitation = "sine"
    frequency_hz: float | None = None
    valid: BoolArray | None = None
    start_time_s: float = 0.0
    provenance: Provenance = Provenance()
    reference_full_scale: float | None = None
    response_full_scale: float | None = None
    contradicting_rate_hz: float | None = None
    reference_valid: BoolArray | None = None
    optical: OpticalSummary | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        where = f"record {self.name!r}"
        if not (np.isfinite(self.sampling_rate_hz) and self.sampling_rate_hz > 0):
            raise InputError(
                "The sampling rate is not usable.",
                expected="a positive number of samples per second",
                found=f"{self.sampling_rate_hz!r}",
                where=where,
                remedy="give rate_hz or time_column under [sampling]",
            )
        if self.excitation not in EXCITATIONS:
            raise unknown("The excitation is not known.", self.excitation, EXCITATIONS, where)
        if self.reference is None and self.excitation != "decay":
            raise InputError(
                "The record has no reference channel.",
                expected="a reference for every excitation but decay",
                found=f"excitation {self.excitation!r} without reference",
                where=where,
                remedy="name the reference column, or set excitation = 'decay'",
            )
        object.__setattr__(self, "excitation", str(self.excitation))
        response = _frozen(self.response)
        channels = {"response": response}
        if self.reference is not None:
            channels["reference"] = _frozen(self.reference)
        for label, values in channels.items():
            _check_channel(label, values, response.shape, where)
            object.__setattr__(self, label, values)
        if self.frequency_hz is not None and not 0 < self.frequency_hz < self.sampling_rate_hz / 2:
            raise InputError(
                "The frequency of a sine record is outside the band that its sampling rate can show.",
                expected=f"0 < frequency_hz < {self.sampling_rate_hz / 2:g} (half the sampling rate)",
                found=f"{self.frequency_hz:g} Hz",
                where=where,
                remedy="correct frequency_hz or rate_hz",
            )
        valid = np.ones(response.shape, dtype=bool) if self.valid is None else np.array(self.valid, dtype=bool)
        if valid.shape != response.shape:
            raise InputError(
                "The mask of valid samples does not fit the record.",
                expected=f"shape {response.shape}",
                found=f"shape {valid.shape}",
                where=where,
                remedy="give one truth value a sample",
            )
        valid.flags.writeable = False
        object.__setattr__(self, "valid", valid)

    @property
    def samples(self) -> int:
        """Number of samples."""
        return int(self.response.shape[0])

    @property
    def sampling_interval_s(self) -> float:
        """Time between samples, s."""
        return 1.0 / self.sampling_rate_hz

    @property
    def duration_s(self) -> float:
        """Length of the record, s."""
        return self.samples / self.sampling_rate_hz

    @property
    def time_s(self) -> FloatArray:
        """Sample times from the record's first sample, s; shape (samples,)."""
        return np.arange(self.samples) / self.sampling_rate_hz

    @property
    def mask(self) -> BoolArray:
        """Samples that may be used; shape (samples,)."""
        assert self.valid is not None  # set in __post_init__
        return self.valid

    @property
    def reference_mask(self) -> BoolArray:
        """Samples of the reference that may be used as input; shape (samples,)."""
        return self.mask if self.reference_valid is None else self.reference_valid

    def without(self, bad: BoolArray, reason: str) -> Record:
        """Return the record with the samples in ``bad`` (shape (samples,)) marked as not valid."""
        reference = None if self.reference_valid is None else self.reference_valid & ~bad
        return replace(self.without_response(bad, reason), reference_valid=reference)

    def without_response(self, bad: BoolArray, reason: str) -> Record:
        """The same where the reference is still the sensor's input."""
        provenance = self.provenance.then(f"{int(np.sum(bad & self.mask))} samples left out: {reason}")
        return replace(self, valid=self.mask & ~bad, reference_valid=self.reference_mask, provenance=provenance)

    def with_response(self, response: FloatArray, reason: str) -> Record:
        """Return the record with another response, shape (samples,), and what was done to it."""
        return replace(self, response=response, provenance=self.provenance.then(reason))


def _check_channel(label: str, values: FloatArray, shape: tuple[int, ...], where: str) -> None:
    if values.ndim != 1 or values.shape != shape:
        raise InputError(
            f"The {label} channel does not fit the record.",
            expected=f"one dimension, as long as the response ({shape[0] if shape else 0} samples)",
            found=f"shape {values.shape}",
            where=where,
            remedy="give both channels over the same samples",
        )
    if values.shape[0] < 8:
        raise InputError(
            "The record is too short.",
            expected="at least 8 samples",
            found=f"{values.shape[0]} samples",
            where=where,
            remedy="check the file and start_s / stop_s",
        )
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise InputError(
            f"The {label} channel holds values that are not numbers.",
            expected="finite numbers",
            found=f"{bad.size} not finite, the first is {values[bad[0]]} at sample {bad[0]}",
            where=where,
            remedy="repair the file or choose another part with start_s / stop_s",
        )
    _check_size(f"The {label} channel", values, where)


def _check_size(what: str, values: FloatArray, where: str) -> None:
    largest, span = float(np.max(np.abs(values))), f"a largest value between {1.0 / LARGEST:g} and {LARGEST:g}"
    if largest != 0.0 and not 1.0 / LARGEST <= largest <= LARGEST:
        text = f"{what} holds values of a size that no unit explains."
        raise InputError(text, expected=span, found=f"{largest:.3g}", where=where, remedy="correct the scale")


@dataclass(frozen=True, eq=False)
class ResponseTable:
    """A tabulated complex response: response per unit of the reference quantity.

    Attributes:
        frequency_hz: shape (points,), positive, any order, repeats allowed.
        magnitude: shape (points,), response unit per SI unit of the reference quantity, positive.
        phase_rad: shape (points,) or None; phase of the response minus phase of the reference, lag negative.
        magnitude_uncertainty: standard uncertainty, same unit as magnitude, or None.
        phase_uncertainty_rad: standard uncertainty, rad, or None.
        provenance: file, hash and history.

    Raises:
        InputError: shapes differ, or a value is not finite or not positive where it must be.
    """

    frequency_hz: FloatArray
    magnitude: FloatArray
    phase_rad: FloatArray | None = None
    magnitude_uncertainty: FloatArray | None = None
    phase_uncertainty_rad: FloatArray | None = None
    provenance: Provenance = Provenance()

    def __post_init__(self) -> None:
        positive = {"frequency_hz", "magnitude", "magnitude_uncertainty", "phase_uncertainty_rad"}
        shape = np.shape(self.frequency_hz)
        where = f"table {self.provenance.file or 'in memory'!r}"
        for label in ("frequency_hz", "magnitude", "phase_rad", "magnitude_uncertainty", "phase_uncertainty_rad"):
            values = getattr(self, label)
            if values is None:
                continue
            values = _frozen(values)
            if values.ndim != 1 or values.shape != shape or values.size == 0:
                raise InputError(
                    f"Column {label} does not fit the table.",
                    expected=f"one dimension, {shape[0] if shape else 'at least 1'} points",
                    found=f"shape {values.shape}",
                    where=where,
                    remedy="give every column the same number of rows",
                )
            bad = np.flatnonzero(~np.isfinite(values) | ((values <= 0) if label in positive else False))
            if bad.size:
                raise InputError(
                    f"Column {label} holds values that cannot be used.",
                    expected="finite numbers" + (" above zero" if label in positive else ""),
                    found=f"{values[bad[0]]} in data row {bad[0] + 1}",
                    where=where,
                    remedy="repair or remove that row",
                )
            _check_size(f"Column {label}", values, where)
            object.__setattr__(self, label, values)

    @property
    def points(self) -> int:
        """Number of rows."""
        return int(self.frequency_hz.shape[0])

    @property
    def response(self) -> NDArray[np.complex128]:
        """Complex response, shape (points,); real and positive where the table has no phase."""
        if self.phase_rad is None:
            return self.magnitude.astype(np.complex128)
        return np.asarray(self.magnitude * np.exp(1j * self.phase_rad), dtype=np.complex128)


@dataclass(frozen=True, eq=False)
class Calibration:
    """All that is known of one sensor's calibration: records or a table, and what the channels mean.

    Attributes:
        records: the recordings; empty where a table is given.
        table: the tabulated response; None where records are given.
        model: name of the sensor model, such as "accelerometer+delay".
        quantity: what the reference channel gives.
        reference_unit: unit of the reference after scaling.
        reference_standard_uncertainty: relative, systematic: the calibration of the reference.
        response_unit: unit of the response after scaling.
        effects: further systematic contributions to the uncertainty.
        sensor: free text for reports (manufacturer, type, serial_number, …).
        source: path of the calibration file; empty for data made in memory.
        certificate: what a certificate needs besides the data (customer, laboratory, conditions, …), as given; keys as
            in the calibration file, plain values, dates as ISO text.

    Raises:
        InputError: neither or both of records and table are given, or the quantity is unknown.
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
        object.__setattr__(self, "quantity", str(self.quantity))  # NumPy's own strings are no static argument
        object.__setattr__(self, "records", tuple(self.records))
        object.__setattr__(self, "reference_unit", self.reference_unit or REFERENCE_UNITS[self.quantity])
        object.__setattr__(self, "sensor", MappingProxyType(dict(self.sensor)))
        object.__setattr__(self, "certificate", MappingProxyType(dict(self.certificate)))

    def __reduce__(self) -> tuple[object, ...]:  # views of mappings do not travel to another process
        own = {each.name: getattr(self, each.name) for each in fields(self)}
        return _rebuilt, (own | {"sensor": dict(self.sensor), "certificate": dict(self.certificate)},)

    def require_response(self, unit: str, without_records: str) -> None:
        """Check that there are records, and that their response is in the unit of a result that is applied to them.

        Args:
            unit: of the response of the result.
            without_records: the problem that a table is, in words.

        Raises:
            InputError: it is a table, or in another unit.
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


def _rebuilt(own: dict[str, Any]) -> Calibration:
    return Calibration(**own)
