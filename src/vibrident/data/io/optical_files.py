"""Turn photodetector signals in files into records with a displacement as reference."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.effects import SystematicEffect
from vibrident.data.interferometer import alignment
from vibrident.data.interferometer.carrier import (
    MAX_LEAST_BAND,
    MAX_LEAST_BAND_OF_SHOCK,
    mix_down,
    without_residual_carrier,
)
from vibrident.data.interferometer.choice import EllipseChoice, carrier_choice, choose
from vibrident.data.interferometer.demodulation import Demodulated, demodulate
from vibrident.data.interferometer.effects import effects
from vibrident.data.interferometer.rough import at_needed_rate, highest_frequency, rough_frequency
from vibrident.data.interferometer.setting import (
    FloatArray,
    Interferometer,
    SampledSignals,
    signals_in_memory,
)
from vibrident.data.interferometer.summary import OpticalFinding
from vibrident.data.interferometer.survey import Survey, survey
from vibrident.data.io.alignment import REPAIR
from vibrident.data.io.calibration_file import CalibrationFile
from vibrident.data.io.clocks import ChannelClock, ClockReader, require_even
from vibrident.data.io.columns import ColumnFile
from vibrident.data.io.header_units import response_conversion
from vibrident.data.io.optical_effects import cyclic_errors, remaining_covariances, stated_effects
from vibrident.data.io.optical_motion import (
    clock_findings,
    power_share_outside,
    require_motion,
    require_pulse,
)
from vibrident.data.io.reader import open_columns, sha256
from vibrident.data.io.record_files import (
    RecordRequest,
    clock_reader,
    missing_rate,
    named_requests,
    read_record,
    scaled_limit,
)
from vibrident.data.io.sampling import SAME_RATE, cut
from vibrident.data.io.sections import InterferometerSection
from vibrident.data.records import Provenance, Quantity, Record

#: Samples of filtered signals that are kept in memory, of all records together.
MAX_SAMPLES_IN_MEMORY = 1 << 23
#: Optical signals may begin this far from the response, in samples of it; 1 % is a phase error of
#: 0.7° at a fifth of the rate.
MAX_APART_SAMPLES = 0.01
#: A shock is kept at a rate that leaves at most this share of its response's power to the ends of
#: the record.
MAX_SHARE_OUTSIDE = 2e-3
#: Of the thinning from one trial to the next, until that holds.
THINNING_RATIO = 0.8


@dataclass(frozen=True, eq=False)
class _OpticalRecord:
    """Signals of a record before demodulation.

    ``sampled_together``: whether the optical signals and the response share their samples.
    """

    request: RecordRequest
    name: str
    optical: SampledSignals
    response: SampledSignals
    step: str  # the response's, for the history
    clock: ChannelClock
    sampled_together: bool
    doubts: tuple[OpticalFinding, ...]
    carrier_hz: float | None = None
    factor: float = 1.0  # of the response's unit, before scale


class OpticalRecords(NamedTuple):
    """Records whose reference is an interferometer's signals, with their unit and effects."""

    records: tuple[Record, ...]
    quantity: Quantity
    unit: str
    effects: tuple[SystematicEffect, ...]


def read_optical(calibration: CalibrationFile, folder: Path, where: str) -> OpticalRecords:
    """Read records whose reference is an interferometer's signals; arguments as `named_parts`.

    Raises:
        InputError: a file cannot be used, or the signals cannot be followed.
    """
    section = calibration.interferometer
    assert section is not None
    setting = section.setting
    requests = named_requests(calibration, folder, where)
    opened = [
        _open(request, name, calibration, section, folder)
        for request, name in requests
        if request.entry.excitation != "decay"
    ]
    # Report the doubt once: the rate is that of all records.
    doubted = next((raw.name for raw in opened if raw.doubts), "")
    opened = [raw if raw.name == doubted else replace(raw, doubts=()) for raw in opened]
    opened, surveys, choices = _with_ellipses(opened, setting)
    moving = any(raw.request.entry.excitation != "sine" for raw in opened)
    results = [
        _record(raw, survey, choice, setting, calibration, folder, moving=moving)
        for raw, survey, choice in zip(opened, surveys, choices, strict=True)
    ]
    errors = cyclic_errors([demodulated for demodulated, _ in results], setting)
    for index, error in enumerate(errors):
        if error is not None:
            raw = opened[index]
            demodulated = results[index][0]
            if demodulated.carrier is not None:
                signals = without_residual_carrier(raw.optical, demodulated.carrier)
                raw = replace(raw, optical=signals, carrier_hz=demodulated.summary.carrier_hz)
            choice = replace(choices[index], error=error.waves)
            results[index] = _record(
                raw, surveys[index], choice, setting, calibration, folder, moving=moving
            )
    records = {raw.name: record for raw, (_, record) in zip(opened, results, strict=True)}
    ordered = [
        records.get(name) or read_record(request, name, calibration, folder, "m").record
        for request, name in requests
    ]
    answers = [demodulated.answer for demodulated, _ in results]
    all_effects = (
        *stated_effects(setting),
        *(effects(answers, remaining_covariances(errors, answers, setting)) if results else ()),
    )
    kind: tuple[Quantity, str] = ("acceleration", "m/s^2") if moving else ("displacement", "m")
    return OpticalRecords(tuple(ordered), *kind, all_effects)


def _with_ellipses(
    opened: Sequence[_OpticalRecord], setting: Interferometer
) -> tuple[list[_OpticalRecord], list[Survey], list[EllipseChoice]]:
    """Return the records with their surveys and ellipses.

    Signals of a small motion are filtered to a lower rate, which removes noise.
    """
    opened = _loaded(opened)
    surveys = [_survey_of(raw) for raw in opened]
    if setting.kind == "heterodyne":
        return (
            opened,
            surveys,
            [carrier_choice(survey, index) for index, survey in enumerate(surveys)],
        )
    lower_rate = [
        None if survey.covers_fringe else at_needed_rate(raw.optical)
        for raw, survey in zip(opened, surveys, strict=True)
    ]
    filtered = _loaded(
        [
            replace(raw, optical=to) if to else raw
            for raw, to in zip(opened, lower_rate, strict=True)
        ]
    )
    surveys = [
        survey if raw is before else replace(_survey_of(raw), at_limit=survey.at_limit)
        for raw, before, survey in zip(filtered, opened, surveys, strict=True)
    ]
    return filtered, surveys, choose(surveys, [raw.name for raw in opened])


def _loaded(opened: Sequence[_OpticalRecord]) -> list[_OpticalRecord]:
    """Return the records with filtered signals in memory, as many as have room."""
    room = MAX_SAMPLES_IN_MEMORY
    loaded = []
    for raw in opened:
        signals = raw.optical
        if signals.first_s > 0.0 and signals.samples <= room:
            with _errors_located(raw):
                values = signals.block(0, signals.samples)
            raw = replace(raw, optical=signals_in_memory(values, signals.rate_hz, signals.first_s))
            room -= signals.samples
        loaded.append(raw)
    return loaded


def _survey_of(raw: _OpticalRecord) -> Survey:
    with _errors_located(raw):
        return survey(raw.optical)


@contextmanager
def _errors_located(raw: _OpticalRecord) -> Iterator[None]:
    """Add the record's place in the calibration file to errors."""
    try:
        yield
    except InputError as error:
        raise error.within(raw.request.where) from None


def _open(
    request: RecordRequest,
    name: str,
    calibration: CalibrationFile,
    section: InterferometerSection,
    folder: Path,
) -> _OpticalRecord:
    main = open_columns(folder / request.file)
    optical_file = (
        main
        if request.entry.reference_file is None
        else open_columns(folder / request.entry.reference_file)
    )
    column = calibration.response.column
    assert column is not None  # checked with the calibration file
    at = main.position_of(column, "[response] column")
    key = "[interferometer] columns"
    positions = tuple(optical_file.position_of(c, key) for c in section.columns)
    channel_positions = [at, *positions] if optical_file is main else [at]
    clock = clock_reader(request, calibration, main).clock_of(main, at, channel_positions)
    if clock is None:
        raise missing_rate(request.where)
    sampling = clock.clock
    require_even(clock, main, request.where)
    optical_hz = _optical_rate(section, calibration, optical_file, positions, clock, request)
    optical = _signals_of(optical_file, positions, optical_hz, request)
    response = _signals_of(main, (at,), sampling.rate_hz, request)
    together = abs(optical_hz / sampling.rate_hz - 1.0) < SAME_RATE
    if together and optical.samples != response.samples:
        raise InputError(
            "The optical signals and the response differ in length.",
            expected=f"{response.samples} samples, as the response has in {main.file}",
            found=f"{optical.samples} samples in {optical_file.file}",
            where=request.where,
            remedy="give both over the same samples, or rate_hz of [interferometer] if they are "
            "sampled faster",
        )
    durations_s = optical_file.length(positions[0]) / optical_hz, main.length(at) / sampling.rate_hz
    doubts = () if together else clock_findings(*durations_s, name)
    carrier_hz = section.carrier_hz
    if carrier_hz is not None:
        most = MAX_LEAST_BAND_OF_SHOCK if request.entry.excitation == "shock" else MAX_LEAST_BAND
        optical, carrier_hz = mix_down(optical, carrier_hz, sampling.rate_hz, request.where, most)
    to = calibration.response
    conversion = response_conversion(main, at, to, to.unit)
    step = f"response: {main.file}, column {at + 1} × {to.scale!r} → {to.unit}"
    return _OpticalRecord(
        request,
        name,
        optical,
        response,
        step,
        clock,
        together,
        doubts,
        carrier_hz,
        conversion.factor,
    )


def _signals_of(
    source: ColumnFile, positions: tuple[int, ...], rate_hz: float, request: RecordRequest
) -> SampledSignals:
    """Return columns of a file as signals to be read block by block.

    Values that are not finite are refused.
    """
    rows = cut(
        source.length(positions[0]),
        rate_hz,
        request.entry.start_s,
        request.entry.stop_s,
        request.where,
    )

    def block(start: int, stop: int) -> FloatArray:
        values = source.block(positions, rows.start + start, rows.start + stop)
        if not np.isfinite(np.sum(values)):
            for position, column in zip(positions, values, strict=True):
                source.require_finite(position, column, rows.start + start, REPAIR)
        return values

    return SampledSignals(rows.stop - rows.start, rate_hz, block)


def _optical_rate(
    section: InterferometerSection,
    calibration: CalibrationFile,
    optical_file: ColumnFile,
    positions: Sequence[int],
    response: ChannelClock,
    request: RecordRequest,
) -> float:
    """Return the rate of the optical signals; InputError for one that contradicts or is too low."""
    time_column = calibration.sampling.time_column if section.rate_hz is None else None
    reader = ClockReader(section.rate_hz, time_column, request.where, optical_file)
    clock = reader.clock_of(optical_file, positions[0], positions) or response
    require_even(clock, optical_file, request.where)
    sampling = response.clock
    rate_hz = clock.clock.rate_hz
    begin = sampling.start
    other_begin = clock.clock.start
    if begin is not None and other_begin is not None and begin.epoch == other_begin.epoch:
        apart_s = (other_begin.ns - begin.ns) * 1e-9
        if abs(apart_s) * sampling.rate_hz > MAX_APART_SAMPLES:
            raise InputError(
                "The channels do not begin at the same time.",
                expected="optical signals that begin with the response",
                found=f"{apart_s:+.9g} s, or {apart_s * sampling.rate_hz:+.3g} samples",
                where=f"{request.where}, for {optical_file.file}",
                remedy="export both channels over the same samples, or state delay_s without times",
            )
    if rate_hz < sampling.rate_hz * (1.0 - SAME_RATE):
        raise InputError(
            "The optical signals are sampled more slowly than the response.",
            expected=f"[interferometer] rate_hz of {sampling.rate_hz:.9g} Hz or more",
            found=f"{rate_hz:.9g} Hz",
            where=f"{request.where}, for {optical_file.file}",
            remedy="correct rate_hz of [interferometer] or of [sampling]",
        )
    return rate_hz


def _begins_s(raw: _OpticalRecord) -> float:
    start_time_s = raw.request.entry.start_time_s
    return raw.clock.begins_s if start_time_s is None else start_time_s


def _record(
    raw: _OpticalRecord,
    survey: Survey,
    choice: EllipseChoice,
    setting: Interferometer,
    calibration: CalibrationFile,
    folder: Path,
    *,
    moving: bool,
) -> tuple[Demodulated, Record]:
    entry = raw.request.entry
    sine = raw.request.entry.excitation == "sine"
    near = (entry.frequency_hz or rough_frequency(raw.optical, choice)) if sine else None
    coarse = alignment.optical_factor(raw.optical.rate_hz, raw.response.rate_hz)
    top, broken = (near, False) if near else highest_frequency(raw.optical, choice, coarse)
    if sine:
        fewest = alignment.MIN_SAMPLES_OF_SINE
    elif broken:
        fewest = alignment.MIN_SAMPLES_BESIDE_GAPS
    else:
        fewest = alignment.MIN_SAMPLES_OF_OTHERS
    every = alignment.thinning_factor(raw.response.samples, raw.response.rate_hz, top, fewest)
    least = alignment.min_thinning_factor(raw.response.rate_hz, raw.optical.rate_hz)
    every = max(every, least)

    def demodulate_every(every: int) -> tuple[Demodulated, alignment.AlignedDisplacement]:
        rate_hz = raw.response.rate_hz / every
        factor = every
        if not raw.sampled_together or raw.optical.first_s != 0.0:
            factor = alignment.optical_factor(raw.optical.rate_hz, rate_hz)
        demodulated = demodulate(
            raw.optical, setting, survey, choice, factor, raw.name, near, top, raw.carrier_hz
        )
        aligned = alignment.aligned_channels(
            demodulated, raw.optical, raw.response, every, setting.delay_s
        )
        return demodulated, aligned.accelerated if moving else aligned

    demodulated, aligned = demodulate_every(every)
    if entry.excitation == "shock":
        outside = power_share_outside(raw.response, aligned)
        while outside > MAX_SHARE_OUTSIDE and every > least:
            every = max(int(THINNING_RATIO * every), least)
            demodulated, aligned = demodulate_every(every)
            outside = power_share_outside(raw.response, aligned)
        require_pulse(aligned, outside, raw.name)
    require_motion(aligned, entry.excitation, raw.name)
    to_response = raw.factor * calibration.response.scale
    what = "acceleration in m/s²" if moving else "displacement in m"
    unsure = ""
    if setting.direction is None:
        unsure = "; the direction is not stated: the sign of x is not known"
    history = (
        raw.step,
        f"reference: {what} from the {setting.kind} signals, {raw.optical.rate_hz:.9g} Hz, "
        f"every {demodulated.factor}{unsure}",
        *raw.request.other_file(folder),
    )
    record = Record(
        name=raw.name,
        reference=aligned.displacement_m,
        response=aligned.response * to_response,
        sampling_rate_hz=aligned.rate_hz,
        excitation=entry.excitation,
        frequency_hz=entry.frequency_hz,
        valid=aligned.valid,
        start_time_s=_begins_s(raw) + raw.request.start_s + aligned.start_s,
        provenance=Provenance(raw.request.file, sha256(folder / raw.request.file), history),
        response_full_scale=scaled_limit(calibration.response.full_scale, to_response),
        reference_noise_order=4 if moving else 0,
        circumstances=entry.circumstances,
        band_hz=entry.band_hz,
        optical=replace(demodulated.summary, findings=(*raw.doubts, *demodulated.summary.findings)),
    )
    return replace(demodulated, displacement_m=np.zeros(0), valid=np.zeros(0, dtype=bool)), record
