"""A calibration after screening: its records, their tones and bands, and findings."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.records import BoolArray, Calibration, Quantity, Record, SystematicEffect
from vibrident.data.records.basis import distinct
from vibrident.data.records.record import nothing_in_band
from vibrident.data.screening import ScreeningFinding, screen
from vibrident.data.screening.copies import without_copies
from vibrident.data.screening.quality import without_steady_decays
from vibrident.data.screening.rates import with_common_rates
from vibrident.fit.problem.frequency_domain import FrequencyProblem
from vibrident.fit.response import MeasuredResponse, find_tones, measure_bands
from vibrident.fit.response.bands import uncorrelated_records
from vibrident.fit.response.clock import judge_clocks
from vibrident.fit.response.clock_ratio import at_reference_clock, clock_offset
from vibrident.fit.response.correction import LogChange, table_without, with_reference_changed
from vibrident.fit.response.deconvolution import chain_of, deconvolved, without_chain
from vibrident.fit.response.tone_quality import (
    refuse_other_motion,
    short_records,
    silent_channels,
    silent_records,
    uncorrelated_channels,
)
from vibrident.physics.models import SensorModel


class EffectCorrection(NamedTuple):
    """Amount of a stated systematic effect that the records are corrected for.

    Attributes:
        amount: in standard uncertainties of the effect.
        uncertainty: standard uncertainty of the amount, by the statement and the data.
    """

    amount: float = 0.0
    uncertainty: float = 1.0


@dataclass(frozen=True, eq=False)
class Evidence:
    """Data that an estimator fits.

    Attributes:
        calibration: as read.
        model: the sensor model to identify.
        records: records that passed the screening; empty for a table.
        tones: response of the sine records at their frequencies; its ``record`` is an index into
            ``records``. None without sines.
        findings: warnings about the data.
        start: start values of the parameters, where they are known; None estimates them from the
            response.
        effects: systematic effects that remain of corrections of the records.
        clock_offset: ε, by which intervals of the response were longer than those of the reference.
        at_own_clocks: the records before they were brought to one clock; empty where they were not.
        corrections: what the records are corrected for, one of each stated effect; empty: nothing.
        is_trial: whether the data are of use only if a start explains them: none is searched for
            beside a model error.
    """

    calibration: Calibration
    model: SensorModel
    records: tuple[Record, ...]
    tones: MeasuredResponse | None
    findings: tuple[ScreeningFinding, ...]
    start: Mapping[str, float] | None = None
    effects: tuple[SystematicEffect, ...] = ()
    clock_offset: float = 0.0
    at_own_clocks: tuple[Record, ...] = ()
    corrections: tuple[EffectCorrection, ...] = ()
    is_trial: bool = False

    @classmethod
    def gather(
        cls, calibration: Calibration, model: SensorModel, known_offset: float | None = None
    ) -> Evidence:
        """Return the evidence of a calibration: screen the records and measure their response.

        ``known_offset``: ε of the clocks; None: it is searched for.

        Raises:
            InputError: no record can be used, or a record declared as a sine is not a sine.
        """
        free = bool(calibration.records) and all(
            record.excitation == "decay" for record in calibration.records
        )
        chain = None if free else chain_of(calibration)  # a channel only scales free motion
        if calibration.table is not None:
            known = calibration if chain is None else without_chain(calibration, chain)
            return cls(known, model, (), None, ())
        optical = [
            f for r in calibration.records if r.optical is not None for f in r.optical.findings
        ]
        recorded = with_common_rates(without_copies(calibration.records))
        records, findings = screen(recorded, calibration.units)
        findings = (*(ScreeningFinding(f.code, f.message) for f in optical), *findings)
        records, decay_findings = without_steady_decays(records)
        if chain is not None:
            records = tuple(deconvolved(record, chain) for record in records)
        records, clock_findings = judge_clocks(records)
        findings = (*findings, *decay_findings, *clock_findings)
        offset = clock_offset(records) if known_offset is None else known_offset
        if offset == 0.0:
            return cls._measured(calibration, model, records, findings)
        return cls(calibration, model, records, None, findings).at_clock(offset)

    def at_clock(self, offset: float) -> Evidence:
        """Return the evidence with responses brought to the clock of the reference at this ε."""
        original = self.at_own_clocks or self.records
        moved = self.with_records(tuple(at_reference_clock(record, offset) for record in original))
        return replace(moved, clock_offset=offset, at_own_clocks=original)

    def with_records(self, records: tuple[Record, ...]) -> Evidence:
        """Return the evidence with other records, measured anew, and the same findings."""
        measured = self._measured(self.calibration, self.model, records, ())
        return replace(
            measured,
            findings=self.findings,
            effects=self.effects,
            clock_offset=self.clock_offset,
            at_own_clocks=self.at_own_clocks,
            corrections=self.corrections,
        )

    def corrected(
        self,
        log_change: LogChange,
        band_hz: tuple[float, float],
        corrections: Sequence[EffectCorrection],
    ) -> Evidence:
        """Return the evidence with a change of the response moved to references, or out of a table.

        Args:
            log_change: the change of log H, from frequencies in Hz.
            band_hz: where it is known.
            corrections: what the records are corrected for then.
        """
        if self.calibration.table is not None:
            table = table_without(self.calibration.table, log_change)
            calibration = replace(self.calibration, table=table)
            return replace(self, calibration=calibration, corrections=tuple(corrections))
        records, original = (
            tuple(with_reference_changed(record, log_change, band_hz) for record in channels)
            for channels in (self.records, self.at_own_clocks)
        )
        corrected = replace(self, at_own_clocks=original, corrections=tuple(corrections))
        return corrected.with_records(records)

    @classmethod
    def _measured(
        cls,
        calibration: Calibration,
        model: SensorModel,
        records: tuple[Record, ...],
        findings: tuple[ScreeningFinding, ...],
    ) -> Evidence:
        """Return the evidence of screened records, whose tones are measured.

        Raises:
            InputError: a record declared as a sine is not a sine, or nothing lies in the bands.
        """
        sines = [i for i, r in enumerate(records) if r.excitation == "sine"]
        tones = None
        if sines:
            sine_records = [records[i] for i in sines]
            tones = find_tones(sine_records)
            tones = replace(tones, record=np.array(sines)[tones.record])
            refuse_other_motion(sine_records, tones)
            findings = (
                *findings,
                *short_records(sine_records, tones.frequency_hz),
                *silent_channels(tones),
            )
        if all(record.band_hz is None for record in records):
            return cls(calibration, model, records, tones, findings)
        return cls(calibration, model, records, tones, findings)._in_band()

    def _in_band(self) -> Evidence:
        """Return the evidence without sines outside the bands of their records.

        Raises:
            InputError: no data remain.
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
        if self.bands is not None and not self.bands.points:
            raise self._nothing_in_band()
        return self

    def _inside(self, measured: MeasuredResponse | None) -> BoolArray:
        """Return which points are in the band of their record, shape (n,)."""
        if measured is None:
            return np.zeros(0, dtype=bool)
        pairs = zip(measured.frequency_hz, measured.record, strict=True)
        return np.array(
            [bool(self.records[int(number)].covers_frequency(hz)) for hz, number in pairs],
            dtype=bool,
        )

    def _nothing_in_band(self) -> InputError:
        """Return the error that no data lie in the band of their record."""
        band_hz = next(record.band_hz for record in self.records if record.band_hz is not None)
        frequencies_hz = [
            measured.frequency_hz
            for measured in (self.tones, self._all_bands)
            if measured is not None
        ]
        return nothing_in_band(
            band_hz,
            np.concatenate(frequencies_hz),
            self.calibration.source or "calibration in memory",
        )

    def without_dead_records(self, *, sines_alone: bool) -> Evidence | None:
        """Return the evidence without records whose channels seem uncorrelated.

        None where all or none seem so. It is a suspicion only: where a sharp resonance rings on
        from motion before the record, this hides the response to the motion in it.

        ``sines_alone``: whether other records are known to move.
        """
        dead: list[int] = []
        for measured, suspects in (
            (None if sines_alone else self.bands, uncorrelated_records),
            (self.tones, silent_records),
        ):
            suspected = [] if measured is None else suspects(measured)
            if measured is not None and len(suspected) < len(distinct(measured.record)):
                dead += suspected
        if not dead:
            return None
        evidence = self.with_records(tuple(r for i, r in enumerate(self.records) if i not in dead))
        dead_findings = uncorrelated_channels([self.records[i] for i in dead])
        return replace(evidence, findings=(*self.findings, *dead_findings))

    @property
    def quantity(self) -> Quantity:
        """Return the quantity of the reference."""
        return self.calibration.quantity

    @functools.cached_property
    def bands(self) -> MeasuredResponse | None:
        """Return the response to other motion than sines, in the bands of its records.

        Its ``record`` is an index into ``records``. None without such motion.
        """
        bands = self._all_bands
        return None if bands is None else bands.at(self._inside(bands))

    @functools.cached_property
    def _all_bands(self) -> MeasuredResponse | None:
        """Return the response to other motion than sines, inside the bands of records or not."""
        bands = measure_bands([self.records[i] for i in self.broadband], self.quantity)
        return (
            None if bands is None else replace(bands, record=np.array(self.broadband)[bands.record])
        )

    @property
    def broadband(self) -> list[int]:
        """Return the records of other driven motion than sines, by index."""
        kinds = [record.excitation for record in self.records]
        return [number for number, kind in enumerate(kinds) if kind not in ("sine", "decay")]

    @property
    def only_sines(self) -> bool:
        """Return whether every record is a sine."""
        return bool(self.records) and all(r.excitation == "sine" for r in self.records)

    @functools.cached_property
    def table_points(self) -> FrequencyProblem | None:
        """Return the response of a table; None of records."""
        table = self.calibration.table
        return (
            None if table is None else FrequencyProblem.of_table(table, self.model, self.quantity)
        )

    @functools.cached_property
    def first_look(self) -> FrequencyProblem | None:
        """Return the response before any model is fitted, for start values.

        None where only free decays were recorded.
        """
        if self.table_points is not None:
            return replace(self.table_points, start=self.start)
        responses = [measured for measured in (self.tones, self.bands) if measured is not None]
        if not responses:
            return None
        measured = MeasuredResponse.join(responses)
        deviation = measured.error_deviation()
        problem = FrequencyProblem.of_measured(measured, deviation, self.model, self.quantity)
        longest_delay_s = np.inf
        if self.bands is not None and self.tones is None:
            # Phases of lines spaced by the inverse of a record's duration are ambiguous beyond
            # half of it.
            longest_delay_s = 0.5 * max(record.duration_s for record in self.records)
        return replace(problem, start=self.start, longest_delay_s=longest_delay_s)

    @property
    def band_hz(self) -> tuple[float, float]:
        """Return the lowest and highest frequency of the data."""
        if self.first_look is not None:
            return self.first_look.band_hz
        longest = max(self.records, key=lambda r: r.duration_s)
        return 1.0 / longest.duration_s, 0.4 * longest.sampling_rate_hz

    @property
    def response_size(self) -> float:
        """Return the largest distance of a response sample from its record's mean, response unit.

        One without valid samples.
        """
        responses = [record.response[record.mask] for record in self.records]
        return (
            max((float(np.max(np.abs(y - y.mean()))) for y in responses if y.size), default=0.0)
            or 1.0
        )
