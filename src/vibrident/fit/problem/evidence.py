"""A calibration made ready: fit records, the tones in them, the response by bands, and what was found on the way."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.records import BoolArray, Calibration, Quantity, Record, SystematicEffect
from vibrident.data.records.basis import distinct
from vibrident.data.records.record import nothing_in_band
from vibrident.data.screening import Finding, screen
from vibrident.data.screening.copies import without_copies
from vibrident.data.screening.quality import without_steady_decays
from vibrident.fit.problem.frequency_domain import FrequencyProblem
from vibrident.fit.response import MeasuredResponse, find_tones, measure_bands
from vibrident.fit.response.bands import uncorrelated_records
from vibrident.fit.response.clock import judge_clocks
from vibrident.fit.response.clock_ratio import at_reference_clock, clock_offset
from vibrident.fit.response.deconvolution import chain_of, deconvolved, without_chain
from vibrident.fit.response.tone_quality import (
    nothing_in_common,
    refuse_other_motion,
    short_records,
    silent_channels,
    silent_records,
)
from vibrident.physics.models import SensorModel


@dataclass(frozen=True, eq=False)
class Evidence:
    """What an estimator gets.

    Attributes:
        calibration: as read.
        model: the sensor model to identify.
        records: records that passed the screening; empty for a table.
        tones: what the sine records say at their frequencies; ``record`` counts in ``records``. None without sines.
        bands: the same for other motion with a reference; None without.
        findings: warnings about the data.
        start: values of the parameters to begin with, where they are known; found in the response otherwise.
        effects: systematic effects that remain of what was corrected in the records.
        clock_offset: ε, by which intervals of the response were longer than those of the reference.
        at_own_clocks: the records before they were brought to one clock; empty where they were not.
    """

    calibration: Calibration
    model: SensorModel
    records: tuple[Record, ...]
    tones: MeasuredResponse | None
    bands: MeasuredResponse | None
    findings: tuple[Finding, ...]
    start: Mapping[str, float] | None = None
    effects: tuple[SystematicEffect, ...] = ()
    clock_offset: float = 0.0
    at_own_clocks: tuple[Record, ...] = ()

    @classmethod
    def gather(cls, calibration: Calibration, model: SensorModel) -> Evidence:
        """Screen the records and measure their nonparametric response.

        Raises:
            InputError: no record can be used, or a record stated to be a sine is not a sine.
        """
        chain = chain_of(calibration)
        if calibration.table is not None:
            known = calibration if chain is None else without_chain(calibration, chain)
            return cls(known, model, (), None, None, ())
        optical = [
            f for r in calibration.records if r.optical is not None for f in r.optical.findings
        ]
        records, findings = screen(without_copies(calibration.records), calibration.units)
        findings = (*(Finding(f.code, f.message) for f in optical), *findings)
        records, steady = without_steady_decays(records)
        records = (
            records if chain is None else tuple(deconvolved(record, chain) for record in records)
        )
        records, more = judge_clocks(records)
        offset, findings = clock_offset(records), (*findings, *steady, *more)
        if offset == 0.0:
            return cls._measured(calibration, model, records, findings)
        return cls(calibration, model, records, None, None, findings).at_clock(offset)

    def at_clock(self, offset: float) -> Evidence:
        """Return the same with each response brought to the clock of its reference, at ε = ``offset``."""
        before = self.at_own_clocks or self.records
        moved = self.with_records(tuple(at_reference_clock(record, offset) for record in before))
        return replace(moved, clock_offset=offset, at_own_clocks=before)

    def with_records(self, records: tuple[Record, ...]) -> Evidence:
        """The same with records that were worked on; measured anew."""
        measured = self._measured(self.calibration, self.model, records, ())
        kept = {"clock_offset": self.clock_offset, "at_own_clocks": self.at_own_clocks}
        return replace(measured, findings=self.findings, effects=self.effects, **kept)

    @classmethod
    def _measured(
        cls,
        calibration: Calibration,
        model: SensorModel,
        records: tuple[Record, ...],
        findings: tuple[Finding, ...],
    ) -> Evidence:
        sines = [i for i, r in enumerate(records) if r.excitation == "sine"]
        others = [i for i, r in enumerate(records) if r.excitation not in ("sine", "decay")]
        tones, bands = (
            None,
            measure_bands([records[i] for i in others], calibration.quantity) if others else None,
        )
        if bands is not None:
            bands = replace(bands, record=np.array(others)[bands.record])
        if sines:
            some = [records[i] for i in sines]
            tones = find_tones(some)
            tones = replace(tones, record=np.array(sines)[tones.record])
            refuse_other_motion(some, tones)
            findings = (
                *findings,
                *short_records(some, tones.frequency_hz),
                *silent_channels(tones),
            )
        if all(record.band_hz is None for record in records):
            return cls(calibration, model, records, tones, bands, findings)
        return cls(calibration, model, records, tones, bands, findings)._in_band()

    def _in_band(self) -> Evidence:
        """Return the same without sines and points outside the bands of their records.

        Raises:
            InputError: nothing is left.
        """
        inside = self._inside(self.tones)
        outside = set() if self.tones is None else set(self.tones.record[~inside].tolist())
        if outside:
            records = tuple(
                record for number, record in enumerate(self.records) if number not in outside
            )
            if not records:
                raise self._nothing_in_band()
            return replace(
                self._measured(self.calibration, self.model, records, ()), findings=self.findings
            )
        bands = None if self.bands is None else self.bands.at(self._inside(self.bands))
        if bands is not None and not bands.points:
            raise self._nothing_in_band()
        return replace(self, bands=bands)

    def _inside(self, measured: MeasuredResponse | None) -> BoolArray:
        """Return which points are in the band of their record, shape (n,)."""
        if measured is None:
            return np.zeros(0, dtype=bool)
        pairs = zip(measured.frequency_hz, measured.record, strict=True)
        return np.array(
            [bool(self.records[int(number)].holds(hz)) for hz, number in pairs], dtype=bool
        )

    def _nothing_in_band(self) -> InputError:
        band_hz = next(record.band_hz for record in self.records if record.band_hz is not None)
        parts = [part.frequency_hz for part in (self.tones, self.bands) if part is not None]
        return nothing_in_band(
            band_hz, np.concatenate(parts), self.calibration.source or "calibration in memory"
        )

    def without_dead_records(self) -> Evidence | None:
        """The same without records whose channels seem to have nothing in common; None where all or none seem so.

        A suspicion only: what a sharp resonance kept from the motion before the record hides the answer to it, too.
        """
        dead: list[int] = []
        for measured, suspects in (
            (self.bands, uncorrelated_records),
            (self.tones, silent_records),
        ):
            found = [] if measured is None else suspects(measured)
            if measured is not None and len(found) < len(distinct(measured.record)):
                dead += found
        if not dead:
            return None
        left = self.with_records(tuple(r for i, r in enumerate(self.records) if i not in dead))
        return replace(
            left, findings=(*self.findings, *nothing_in_common([self.records[i] for i in dead]))
        )

    @property
    def quantity(self) -> Quantity:
        """What the reference is."""
        return self.calibration.quantity

    @property
    def only_sines(self) -> bool:
        """True where every record is a sine."""
        return bool(self.records) and all(r.excitation == "sine" for r in self.records)

    @functools.cached_property
    def first_look(self) -> FrequencyProblem | None:
        """The response before any model, for start values; None where nothing but free decays was recorded."""
        if self.calibration.table is not None:
            found = FrequencyProblem.of_table(self.calibration.table, self.model, self.quantity)
            return replace(found, start=self.start)
        parts = [measured for measured in (self.tones, self.bands) if measured is not None]
        if not parts:
            return None
        measured = MeasuredResponse.join(parts)
        deviation = measured.error_deviation()
        found = FrequencyProblem.of_measured(measured, deviation, self.model, self.quantity)
        late_s = np.inf
        if self.bands is not None and self.tones is None:
            # Lines as far apart as the inverse of a record's length repeat their phases after it: half of it is told.
            late_s = 0.5 * max(record.duration_s for record in self.records)
        return replace(found, start=self.start, longest_delay_s=late_s)

    @property
    def band_hz(self) -> tuple[float, float]:
        """Lowest and highest frequency of the data."""
        if self.first_look is not None:
            return self.first_look.band_hz
        longest = max(self.records, key=lambda r: r.duration_s)
        return 1.0 / longest.duration_s, 0.4 * longest.sampling_rate_hz

    @property
    def response_size(self) -> float:
        """Largest distance of a valid response sample from its record's mean, response unit; one without any."""
        valid = [record.response[record.mask] for record in self.records]
        return (
            max((float(np.max(np.abs(y - y.mean()))) for y in valid if y.size), default=0.0) or 1.0
        )
