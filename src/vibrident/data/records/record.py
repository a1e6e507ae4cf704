"""One recording of reference and response, and a tabulated response. Validated."""

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
    """

    frequency_hz: FloatArray
    magnitude: FloatArray
    phase_rad: FloatArray | None = None
    magnitude_uncertainty: FloatArray | None = None
    phase_uncertainty_rad: FloatArray | None = None
    provenance: Provenance = field(default_factory=Provenance)

    __repr__ = brief

    def within(self, band_hz: tuple[float, float]) -> ResponseTable:
        """Return the points in a band, both ends included.

        Raises:
            InputError: no point is in it.
        """
        kept = in_band(self.frequency_hz, band_hz)
        if not np.any(kept):
            raise nothing_in_band(
                band_hz, self.frequency_hz, f"table {self.provenance.file or 'in memory'!r}"
            )
        columns = {
            name: None if (column := getattr(self, name)) is None else column[kept]
            for name in (
                "frequency_hz",
                "magnitude",
                "phase_rad",
                "magnitude_uncertainty",
                "phase_uncertainty_rad",
            )
        }
        step = f"{int(np.sum(kept))} of {kept.size} points: {band_hz[0]:g} to {band_hz[1]:g} Hz"
        return replace(self, **columns, provenance=self.provenance.then(step))

    def __post_init__(self) -> None:
        positive = {"frequency_hz", "magnitude", "magnitude_uncertainty", "phase_uncertainty_rad"}
        shape = np.shape(self.frequency_hz)
        where = f"table {self.provenance.file or 'in memory'!r}"
        for label in (
            "frequency_hz",
            "magnitude",
            "phase_rad",
            "magnitude_uncertainty",
            "phase_uncertainty_rad",
        ):
            values = getattr(self, label)
            if values is None:
                continue
            values = frozen(values)
            if values.ndim != 1 or values.shape != shape or values.size == 0:
                raise InputError(
                    f"Column {label} does not fit the table.",
                    expected=f"one dimension, {shape[0] if shape else 'at least 1'} points",
                    found=f"shape {values.shape}",
                    where=where,
                    remedy="give every column the same number of rows",
                )
            bad = np.flatnonzero(
                ~np.isfinite(values) | ((values <= 0) if label in positive else False)
            )
            if bad.size:
                raise InputError(
                    f"Column {label} holds values that cannot be used.",
                    expected="finite numbers" + (" above zero" if label in positive else ""),
                    found=f"{values[bad[0]]} in data row {bad[0] + 1}",
                    where=where,
                    remedy="repair or remove that row",
                )
            check_size(f"Column {label}", values, where)
            object.__setattr__(self, label, values)

    @property
    def points(self) -> int:
        """Return the number of rows."""
        return int(self.frequency_hz.shape[0])

    @property
    def response(self) -> NDArray[np.complex128]:
        """Return the complex response, shape (points,); real and positive where the table has no phase."""
        if self.phase_rad is None:
            return self.magnitude.astype(np.complex128)
        return np.asarray(self.magnitude * np.exp(1j * self.phase_rad), dtype=np.complex128)


@dataclass(frozen=True, eq=False)
class Record:
    """One simultaneous recording of the reference and the response, equally spaced in time.

    Attributes:
        name: short name for tables and messages (the file name, usually).
        reference: shape (samples,), in the SI unit of the calibration's reference quantity; None
            for a free decay.
        response: shape (samples,), in the calibration's response unit.
        sampling_rate_hz: samples per second.
        excitation: kind of motion.
        frequency_hz: start value for a sine's frequency; None where it is to be found in the data.
        valid: shape (samples,), False where a sample must be left out of every fit (clipped, say).
        reference_valid: shape (samples,), where the reference may be used as the sensor's input,
            though the response is not valid there; None: as ``valid``.
        start_time_s: time of the first sample on the file's own clock.
        reference_full_scale, response_full_scale: largest magnitude a channel can hold, in its
            unit; None if unknown.
        provenance: file, hash and history.
        reference_noise_order: the reference's own noise grows with this power of frequency (in
            power): 4 for an acceleration that was made of a displacement with white noise; 0 for
            white noise.
        optical: what the signals of an interferometer said, from which the reference was made; None
            for others.
        hum_hz: tones of the response that no motion causes; unknowns of every fit to the record.
        circumstances: run, mounting, axis and temperature, as far as stated.
        band_hz: lowest and highest frequency that a fit takes from the record; None: all.

    Raises:
        InputError: the arrays are not one-dimensional, differ in length, are shorter than 8 samples
            or hold a value that is not finite, or the sampling rate is not a positive number.
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
        response = frozen(self.response)
        channels = {"response": response}
        if self.reference is not None:
            channels["reference"] = frozen(self.reference)
        for label, values in channels.items():
            _check_channel(label, values, response.shape, where)
            object.__setattr__(self, label, values)
        if self.frequency_hz is not None and not 0 < self.frequency_hz < self.sampling_rate_hz / 2:
            raise InputError(
                "The frequency of a sine record is outside the band that its sampling rate can "
                "show.",
                expected=f"0 < frequency_hz < {self.sampling_rate_hz / 2:g} (half the sampling rate)",
                found=f"{self.frequency_hz:g} Hz",
                where=where,
                remedy="correct frequency_hz or rate_hz",
            )
        valid = (
            np.ones(response.shape, dtype=bool)
            if self.valid is None
            else np.array(self.valid, dtype=bool)
        )
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

    def holds(self, frequency_hz: FloatArray) -> BoolArray:
        """Return which frequencies are in the band of the record, of their shape."""
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
        """Return some consecutive samples as a record; ``step``: for the provenance."""
        return replace(
            self,
            reference=None if self.reference is None else self.reference[span],
            response=self.response[span],
            valid=self.mask[span],
            reference_valid=None if self.reference_valid is None else self.reference_valid[span],
            start_time_s=self.start_time_s + span.start * self.sampling_interval_s,
            provenance=self.provenance.then(step),
        )

    def without(self, bad: BoolArray, reason: str) -> Record:
        """Return the record with the samples in ``bad`` (shape (samples,)) marked as not valid."""
        reference = None if self.reference_valid is None else self.reference_valid & ~bad
        return replace(self.without_response(bad, reason), reference_valid=reference)

    def without_response(self, bad: BoolArray, reason: str) -> Record:
        """Return the same where the reference is still the sensor's input."""
        provenance = self.provenance.then(
            f"{int(np.sum(bad & self.mask))} samples left out: {reason}"
        )
        return replace(
            self, valid=self.mask & ~bad, reference_valid=self.reference_mask, provenance=provenance
        )

    def with_response(self, response: FloatArray, reason: str) -> Record:
        """Return the record with another response, shape (samples,), and what was done to it."""
        return replace(self, response=response, provenance=self.provenance.then(reason))


#: Relative width of the edge of a band: a frequency may miss it in the last digits.
EDGE = 1e-9


def in_band(frequency_hz: FloatArray, band_hz: tuple[float, float] | None) -> BoolArray:
    """Return which frequencies are in a band, both ends included; all without one."""
    if band_hz is None:
        return np.ones(frequency_hz.shape, dtype=bool)
    low, high = band_hz
    return (frequency_hz >= low * (1.0 - EDGE)) & (frequency_hz <= high * (1.0 + EDGE))


def nothing_in_band(
    band_hz: tuple[float, float], frequency_hz: FloatArray, where: str
) -> InputError:
    """Return the error of a band without data."""
    there = (
        f"{np.min(frequency_hz):g} to {np.max(frequency_hz):g} Hz" if frequency_hz.size else "none"
    )
    return InputError(
        "No data are in the band.",
        expected=f"data from {band_hz[0]:g} to {band_hz[1]:g} Hz",
        found=there,
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
    check_size(f"The {label} channel", values, where)
