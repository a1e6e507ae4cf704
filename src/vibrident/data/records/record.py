"""Records of reference and response, and tabulated responses, validated."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vibrident.base.brief import brief
from vibrident.base.errors import InputError, unknown
from vibrident.data.effects import Circumstances
from vibrident.data.records.basis import (
    EXCITATIONS,
    BoolArray,
    Excitation,
    FloatArray,
    Provenance,
    check_size,
    frozen,
)

if TYPE_CHECKING:
    from vibrident.data.interferometer.summary import OpticalSummary

#: Fewest samples of a record.
MIN_SAMPLES = 8
#: Relative tolerance of a band's ends: a frequency may miss them in the last digits.
EDGE_TOLERANCE = 1e-9
#: Column of a response table → whether its values are positive.
_TABLE_COLUMNS = {
    "frequency_hz": True,
    "magnitude": True,
    "phase_rad": False,
    "magnitude_uncertainty": True,
    "phase_uncertainty_rad": True,
}


@dataclass(frozen=True, eq=False)
class ResponseTable:
    """A tabulated complex response: response per unit of the reference quantity.

    Attributes:
        frequency_hz: shape (points,), positive, any order, repeats allowed.
        magnitude: shape (points,), response unit per SI unit of the reference quantity, positive.
        phase_rad: shape (points,) or None; phase of the response minus phase of the reference, lag
            negative.
        magnitude_uncertainty: standard uncertainty, same unit as magnitude, or None.
        phase_uncertainty_rad: standard uncertainty, rad, or None.
        provenance: file, hash and history.

    Raises:
        InputError: shapes differ, or a value is not finite or not positive where it must be.

    Examples:
        >>> import numpy as np
        >>> import vibrident
        >>> table = vibrident.ResponseTable(
        ...     np.array([100.0, 160.0]), np.array([0.102, 0.104]), np.deg2rad([-1.1, -1.7])
        ... )
        >>> calibration = vibrident.Calibration(table=table)
        >>> calibration.table.points
        2
    """

    frequency_hz: FloatArray
    magnitude: FloatArray
    phase_rad: FloatArray | None = None
    magnitude_uncertainty: FloatArray | None = None
    phase_uncertainty_rad: FloatArray | None = None
    provenance: Provenance = field(default_factory=Provenance)

    __repr__ = brief

    def __post_init__(self) -> None:
        points = np.size(self.frequency_hz)
        for label, is_positive in _TABLE_COLUMNS.items():
            if getattr(self, label) is not None:
                column = frozen(getattr(self, label))
                self._check_column(label, column, points, is_positive)
                object.__setattr__(self, label, column)

    @property
    def _place(self) -> str:
        """Return the table's name, for messages."""
        return f"table {self.provenance.file or 'in memory'!r}"

    def _check_column(self, label: str, column: FloatArray, points: int, is_positive: bool) -> None:
        if column.shape != (points,) or points == 0:
            raise InputError(
                f"Column {label} does not fit the table.",
                expected=f"one dimension, {points or 'at least 1'} points",
                found=f"shape {column.shape}",
                where=self._place,
                remedy="give every column the same number of rows",
            )
        bad = np.flatnonzero(~np.isfinite(column) | (is_positive & (column <= 0)))
        if bad.size:
            raise InputError(
                f"Column {label} holds values that cannot be used.",
                expected="finite numbers" + (" above zero" if is_positive else ""),
                found=f"{column[bad[0]]} in data row {bad[0] + 1}",
                where=self._place,
                remedy="repair or remove that row",
            )
        check_size(f"Column {label}", column, self._place)

    def within(self, band_hz: tuple[float, float]) -> ResponseTable:
        """Return the points in a band, both ends included.

        Raises:
            InputError: no point is in it.
        """
        is_inside = in_band(self.frequency_hz, band_hz)
        if not np.any(is_inside):
            raise nothing_in_band(band_hz, self.frequency_hz, self._place)
        columns = {
            label: column[is_inside]
            for label in _TABLE_COLUMNS
            if (column := getattr(self, label)) is not None
        }
        low_hz, high_hz = band_hz
        step = f"{np.sum(is_inside)} of {self.points} points: {low_hz:g} to {high_hz:g} Hz"
        return replace(self, **columns, provenance=self.provenance.then(step))

    @property
    def points(self) -> int:
        """Return the number of rows."""
        return int(self.frequency_hz.shape[0])

    @property
    def response(self) -> NDArray[np.complex128]:
        """Return the complex response, shape (points,); real and positive if there is no phase."""
        if self.phase_rad is None:
            return self.magnitude.astype(np.complex128)
        return np.asarray(self.magnitude * np.exp(1j * self.phase_rad), dtype=np.complex128)


@dataclass(frozen=True, eq=False)
class Record:
    """Reference and response of one sensor, sampled together at a constant rate.

    Attributes:
        name: short name for tables and messages (the file name, usually).
        reference: shape (samples,), in the SI unit of the calibration's reference quantity; None
            for a free decay.
        response: shape (samples,), in the calibration's response unit.
        sampling_rate_hz: samples per second.
        excitation: kind of motion.
        frequency_hz: start value for a sine's frequency; None if the data determine it.
        valid: shape (samples,), False where a sample must be left out of every fit (clipped, say).
        reference_valid: shape (samples,), True where the reference may be used as the sensor's
            input, even if the response is not valid there; None: as ``valid``.
        start_time_s: time of the first sample on the file's own clock.
        reference_full_scale, response_full_scale: largest magnitude a channel can hold, in its
            unit; None if unknown.
        provenance: file, hash and history.
        reference_noise_order: power of frequency with which the noise power of the reference grows:
            0 for white noise, 4 for an acceleration computed from a displacement with white noise.
        optical: quality of the interferometer signals that the reference was computed from; None
            for other references.
        hum_hz: frequencies of tones in the response that no motion causes; every fit to the record
            estimates them.
        circumstances: run, mounting, axis and temperature, as far as stated.
        band_hz: lowest and highest frequency that a fit uses; None: all.

    Raises:
        InputError: the arrays are not one-dimensional, differ in length, are shorter than 8 samples
            or hold a value that is not finite, or the sampling rate is not a positive number.

    Examples:
        >>> import numpy as np
        >>> import vibrident
        >>> motion = np.sin(2 * np.pi * 160.0 * np.arange(4000) / 51200.0)
        >>> record = vibrident.Record("160 Hz", motion, 0.1 * motion, 51200.0)
        >>> record.samples, record.duration_s
        (4000, 0.078125)
    """

    name: str
    reference: FloatArray | None
    response: FloatArray
    sampling_rate_hz: float
    excitation: Excitation = "sine"
    frequency_hz: float | None = None
    valid: BoolArray | None = None
    start_time_s: float = 0.0
    provenance: Provenance = field(default_factory=Provenance)
    reference_full_scale: float | None = None
    response_full_scale: float | None = None
    reference_valid: BoolArray | None = None
    reference_noise_order: int = 0
    optical: OpticalSummary | None = field(default=None, repr=False)
    hum_hz: tuple[float, ...] = ()
    circumstances: Circumstances = field(default_factory=Circumstances)
    band_hz: tuple[float, float] | None = None

    __repr__ = brief

    def __post_init__(self) -> None:
        where = f"record {self.name!r}"
        self._check_settings(where)
        object.__setattr__(self, "excitation", str(self.excitation))
        response = frozen(self.response)
        channels = {"response": response}
        if self.reference is not None:
            channels["reference"] = frozen(self.reference)
        for label, values in channels.items():
            _check_channel(label, values, response.shape, where)
            object.__setattr__(self, label, values)
        valid = np.ones(response.shape, dtype=bool)
        if self.valid is not None:
            valid = np.array(self.valid, dtype=bool)
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

    def _check_settings(self, where: str) -> None:
        """Check sampling rate, excitation and frequency; ``where`` names the record."""
        rate_hz = self.sampling_rate_hz
        if not (np.isfinite(rate_hz) and rate_hz > 0):
            raise InputError(
                "The sampling rate is not usable.",
                expected="a positive number of samples per second",
                found=f"{rate_hz!r}",
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
        if self.frequency_hz is not None and not 0 < self.frequency_hz < rate_hz / 2:
            raise InputError(
                "The frequency of a sine record is outside the band that its sampling rate can "
                "show.",
                expected=f"0 < frequency_hz < {rate_hz / 2:g} (half the sampling rate)",
                found=f"{self.frequency_hz:g} Hz",
                where=where,
                remedy="correct frequency_hz or rate_hz",
            )

    def covers_frequency(self, frequency_hz: FloatArray) -> BoolArray:
        """Return which frequencies are in the record's band; shape as ``frequency_hz``."""
        return in_band(np.asarray(frequency_hz), self.band_hz)

    @property
    def samples(self) -> int:
        """Return the number of samples."""
        return int(self.response.shape[0])

    @property
    def sampling_interval_s(self) -> float:
        """Return the time between samples, s."""
        return 1.0 / self.sampling_rate_hz

    @property
    def duration_s(self) -> float:
        """Return the length of the record, s."""
        return self.samples / self.sampling_rate_hz

    @property
    def time_s(self) -> FloatArray:
        """Return the sample times from the record's first sample, s; shape (samples,)."""
        return np.arange(self.samples) / self.sampling_rate_hz

    @property
    def mask(self) -> BoolArray:
        """Return the samples that may be used; shape (samples,)."""
        assert self.valid is not None  # set in __post_init__
        return self.valid

    @property
    def reference_mask(self) -> BoolArray:
        """Return the samples of the reference that may be used as input; shape (samples,)."""
        return self.mask if self.reference_valid is None else self.reference_valid

    def part(self, span: slice, step: str) -> Record:
        """Return a record of consecutive samples.

        Args:
            span: first sample and one more than the last.
            step: what was done, for the provenance.
        """
        return replace(
            self,
            reference=None if self.reference is None else self.reference[span],
            response=self.response[span],
            valid=self.mask[span],
            reference_valid=None if self.reference_valid is None else self.reference_valid[span],
            start_time_s=self.start_time_s + span.start * self.sampling_interval_s,
            provenance=self.provenance.then(step),
        )

    def without(self, excluded: BoolArray, reason: str) -> Record:
        """Return the record with samples marked as not valid.

        Args:
            excluded: shape (samples,).
            reason: for the provenance.
        """
        reference = None if self.reference_valid is None else self.reference_valid & ~excluded
        return replace(self.without_response(excluded, reason), reference_valid=reference)

    def without_response(self, excluded: BoolArray, reason: str) -> Record:
        """Return the record with samples marked as not valid, except as input of the sensor."""
        provenance = self.provenance.then(
            f"{int(np.sum(excluded & self.mask))} samples left out: {reason}"
        )
        return replace(
            self,
            valid=self.mask & ~excluded,
            reference_valid=self.reference_mask,
            provenance=provenance,
        )

    def with_response(self, response: FloatArray, reason: str) -> Record:
        """Return the record with another response, shape (samples,), and what was done to it."""
        return replace(self, response=response, provenance=self.provenance.then(reason))


def in_band(frequency_hz: FloatArray, band_hz: tuple[float, float] | None) -> BoolArray:
    """Return which frequencies are in a band, both ends included; all if there is no band."""
    if band_hz is None:
        return np.ones(frequency_hz.shape, dtype=bool)
    low, high = band_hz
    return (frequency_hz >= low * (1.0 - EDGE_TOLERANCE)) & (
        frequency_hz <= high * (1.0 + EDGE_TOLERANCE)
    )


def nothing_in_band(
    band_hz: tuple[float, float], frequency_hz: FloatArray, where: str
) -> InputError:
    """Return the error of a band without data."""
    available = "none"
    if frequency_hz.size:
        available = f"{np.min(frequency_hz):g} to {np.max(frequency_hz):g} Hz"
    return InputError(
        "No data are in the band.",
        expected=f"data from {band_hz[0]:g} to {band_hz[1]:g} Hz",
        found=available,
        where=where,
        remedy="give a wider ⟦identify.band_hz = (LOW, HIGH)⟧",
    )


def _check_channel(label: str, values: FloatArray, shape: tuple[int, ...], where: str) -> None:
    if values.ndim != 1 or values.shape != shape:
        raise InputError(
            f"The {label} channel does not fit the record.",
            expected=f"one dimension, as long as the response ({shape[0] if shape else 0} samples)",
            found=f"shape {values.shape}",
            where=where,
            remedy="give both channels over the same samples",
        )
    if values.shape[0] < MIN_SAMPLES:
        raise InputError(
            "The record is too short.",
            expected=f"at least {MIN_SAMPLES} samples",
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
    check_size(f"The {label} channel", values, where)
