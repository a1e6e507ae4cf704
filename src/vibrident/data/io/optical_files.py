"""Turn photodetector signals in files into records with a displacement as reference."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vibrident.base.errors import InputError
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
from vibrident.data.io.columns import ColumnFile, Positions
from vibrident.data.io.header_units import SourceColumn, response_conversion
from vibrident.data.io.optical_effects import cyclic_errors, remaining_covariances, stated_effects
from vibrident.data.io.optical_motion import (
    clock_findings,
    power_share_outside,
    require_motion,
    require_pulse,
)
from vibrident.data.io.reader import open_columns, sha256
from vibrident.data.io.record_files import (
    CalibrationData,
    RecordRequest,
    clock_reader,
    missing_rate,
    named_requests,
    read_record,
    scaled_limit,
)
from vibrident.data.io.sampling import SAME_RATE, cut
from vibrident.data.io.sections import InterferometerSection
from vibrident.data.records import Provenance, Record

#: Samples of filtered signals that are kept in memory, of all records together.
MAX_SAMPLES_IN_MEMORY = 1 << 23
#: Optical signals may begin this far from the response, in samples of it; 1 % is a phase error of
#: 0.7° at a fifth of the rate.
MAX_START_DIFFERENCE_SAMPLES = 0.01
#: A shock is kept at a rate that leaves at most this share of its response's power to the ends of
#: the record.
MAX_SHARE_OUTSIDE = 2e-3
#: Ratio of the thinning from one trial to the next, until that holds.
THINNING_RATIO = 0.8


@dataclass(frozen=True, eq=False)
class _OpticalRecord:
    """Signals of a record before demodulation.

    Attributes:
        request: file and entry of the calibration file.
        name: of the record.
        optical: two signals in quadrature.
        response: the sensor's response, in the unit of its file.
        response_factor: from that unit to the unit of the calibration, scale included.
        step: how the response was read, for the history.
        clock: of the response.
        sampled_together: whether the optical signals and the response share their samples.
        doubts: findings about the sampling rates.
        carrier_hz: of a heterodyne signal; None for others.
    """

    request: RecordRequest
    name: str
    optical: SampledSignals
    response: SampledSignals
    response_factor: float
    step: str
    clock: ChannelClock
    sampled_together: bool
    doubts: tuple[OpticalFinding, ...]
    carrier_hz: float | None = None


def read_optical(calibration: CalibrationFile, folder: Path, where: str) -> CalibrationData:
    """Read records whose reference is an interferometer's signals.

    The reference is a displacement where every record is a sine, else an acceleration.

    Args:
        calibration: the calibration file.
        folder: where relative paths start.
        where: the calibration file, for messages.

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
    doubtful = [raw for raw in opened if raw.doubts][:1]
    opened = [raw if raw in doubtful else replace(raw, doubts=()) for raw in opened]
    opened, surveys, choices = _with_ellipses(opened, setting)
    accelerated = any(raw.request.entry.excitation != "sine" for raw in opened)

    def demodulated_record(
        raw: _OpticalRecord, survey: Survey, choice: EllipseChoice
    ) -> tuple[Demodulated, Record]:
        demodulated, aligned = _demodulate_record(raw, survey, choice, setting, accelerated)
        record = _as_record(raw, demodulated, aligned, calibration, folder, accelerated)
        # The arrays of the displacement are no longer needed.
        return replace(demodulated, displacement_m=np.zeros(0), valid=np.zeros(0, bool)), record

    results = list(map(demodulated_record, opened, surveys, choices))
    errors = cyclic_errors([demodulated for demodulated, _ in results], setting)
    for index, error in enumerate(errors):
        if error is not None:
            raw = opened[index]
            demodulated, _ = results[index]
            if demodulated.carrier is not None:
                signals = without_residual_carrier(raw.optical, demodulated.carrier)
                raw = replace(raw, optical=signals, carrier_hz=demodulated.summary.carrier_hz)
            choice = replace(choices[index], error=error.waves)
            results[index] = demodulated_record(raw, surveys[index], choice)
    records = {record.name: record for _, record in results}
    answers = [demodulated.answer for demodulated, _ in results]
    all_effects = stated_effects(setting)
    if answers:
        all_effects += effects(answers, remaining_covariances(errors, answers, setting))
    return CalibrationData(
        "acceleration" if accelerated else "displacement",
        "m/s^2" if accelerated else "m",
        tuple(
            records.get(name) or read_record(request, name, calibration, folder, "m").record
            for request, name in requests
        ),
        effects=tuple(all_effects),
    )


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
            [carrier_choice(survey, i) for i, survey in enumerate(surveys)],
        )
    filtered_signals = [
        None if survey.covers_fringe else at_needed_rate(raw.optical)
        for raw, survey in zip(opened, surveys, strict=True)
    ]
    filtered = _loaded(
        [
            raw if signals is None else replace(raw, optical=signals)
            for raw, signals in zip(opened, filtered_signals, strict=True)
        ]
    )
    for index, signals in enumerate(filtered_signals):
        if signals is not None:
            at_limit = surveys[index].at_limit
            surveys[index] = replace(_survey_of(filtered[index]), at_limit=at_limit)
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
    entry = request.entry
    main = open_columns(folder / request.file)
    optical_file = main
    if entry.reference_file is not None:
        optical_file = open_columns(folder / entry.reference_file)
    column = calibration.response.column
    assert column is not None  # checked with the calibration file
    position = main.position_of(column, "[response] column")
    key = "[interferometer] columns"
    optical_positions = tuple(optical_file.position_of(c, key) for c in section.columns)
    channels = [position, *optical_positions] if optical_file is main else [position]
    clock = clock_reader(request, calibration, main).clock_of(main, position, channels)
    if clock is None:
        raise missing_rate(request.where)
    rate_hz = clock.clock.rate_hz
    require_even(clock, main, request.where)
    optical_hz = _optical_rate(
        section, calibration, optical_file, optical_positions, clock, request
    )
    optical = _signals_of(optical_file, optical_positions, optical_hz, request)
    response = _signals_of(main, (position,), rate_hz, request)
    sampled_together = abs(optical_hz / rate_hz - 1.0) < SAME_RATE
    doubts: tuple[OpticalFinding, ...] = ()
    if not sampled_together:
        optical_s = optical_file.length(optical_positions[0]) / optical_hz
        doubts = clock_findings(optical_s, main.length(position) / rate_hz, name)
    elif optical.samples != response.samples:
        raise InputError(
            "The optical signals and the response differ in length.",
            expected=f"{response.samples} samples, as the response has in {main.file}",
            found=f"{optical.samples} samples in {optical_file.file}",
            where=request.where,
            remedy="give both over the same samples, or rate_hz of [interferometer] if they are "
            "sampled faster",
        )
    carrier_hz = section.carrier_hz
    if carrier_hz is not None:
        is_shock = entry.excitation == "shock"
        max_band = MAX_LEAST_BAND_OF_SHOCK if is_shock else MAX_LEAST_BAND
        optical, carrier_hz = mix_down(optical, carrier_hz, rate_hz, request.where, max_band)
    response_section = calibration.response
    unit = response_section.unit
    scale = response_section.scale
    channel = SourceColumn(main, position, "[response]")
    conversion = response_conversion(channel, response_section, unit)
    return _OpticalRecord(
        request,
        name,
        optical,
        response,
        conversion.factor * scale,
        f"response: {main.file}, column {position + 1} × {scale!r} → {unit}",
        clock,
        sampled_together,
        doubts,
        carrier_hz,
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
    positions: Positions,
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
    start = sampling.start
    optical_start = clock.clock.start
    if start is not None and optical_start is not None and start.epoch == optical_start.epoch:
        delay_s = (optical_start.ns - start.ns) * 1e-9
        if abs(delay_s) * sampling.rate_hz > MAX_START_DIFFERENCE_SAMPLES:
            raise InputError(
                "The channels do not begin at the same time.",
                expected="optical signals that begin with the response",
                found=f"{delay_s:+.9g} s, or {delay_s * sampling.rate_hz:+.3g} samples",
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


def _demodulate_record(
    raw: _OpticalRecord,
    survey: Survey,
    choice: EllipseChoice,
    setting: Interferometer,
    accelerated: bool,
) -> tuple[Demodulated, alignment.AlignedDisplacement]:
    """Return the displacement of a record, and its motion at the instants of the response.

    The response is thinned as far as the motion allows. A shock is thinned less, until its pulse is
    far enough from the ends of the record.

    Args:
        raw: the signals.
        survey: of the signals.
        choice: of their ellipse.
        setting: of the interferometer.
        accelerated: whether the motion is an acceleration; else a displacement.

    Raises:
        InputError: the signals cannot be followed, or the motion falls into samples left out.
    """
    entry = raw.request.entry
    optical = raw.optical
    response = raw.response
    sine_hz = None
    if entry.excitation == "sine":
        sine_hz = highest_hz = entry.frequency_hz or rough_frequency(optical, choice)
        minima = alignment.MIN_SAMPLES_OF_SINE
    else:
        coarse = alignment.optical_factor(optical.rate_hz, response.rate_hz)
        highest_hz, has_gaps = highest_frequency(optical, choice, coarse)
        minima = alignment.MIN_SAMPLES_OF_OTHERS
        if has_gaps:
            minima = alignment.MIN_SAMPLES_BESIDE_GAPS

    def demodulate_every(every: int) -> tuple[Demodulated, alignment.AlignedDisplacement]:
        factor = every
        if not raw.sampled_together or optical.first_s != 0.0:
            factor = alignment.optical_factor(optical.rate_hz, response.rate_hz / every)
        demodulated = demodulate(
            optical, setting, survey, choice, factor, raw.name, sine_hz, highest_hz, raw.carrier_hz
        )
        aligned = alignment.aligned_channels(demodulated, optical, response, every, setting.delay_s)
        return demodulated, aligned.accelerated if accelerated else aligned

    min_every = alignment.min_thinning_factor(response.rate_hz, optical.rate_hz)
    every = alignment.thinning_factor(response.samples, response.rate_hz, highest_hz, minima)
    every = max(every, min_every)
    demodulated, aligned = demodulate_every(every)
    if entry.excitation == "shock":
        outside = power_share_outside(response, aligned)
        while outside > MAX_SHARE_OUTSIDE and every > min_every:
            every = max(int(THINNING_RATIO * every), min_every)
            demodulated, aligned = demodulate_every(every)
            outside = power_share_outside(response, aligned)
        require_pulse(aligned, outside, raw.name)
    require_motion(aligned, entry.excitation, raw.name)
    return demodulated, aligned


def _as_record(
    raw: _OpticalRecord,
    demodulated: Demodulated,
    aligned: alignment.AlignedDisplacement,
    calibration: CalibrationFile,
    folder: Path,
    accelerated: bool,
) -> Record:
    """Return the record of a demodulated motion and its response; arguments as above."""
    request = raw.request
    entry = request.entry
    summary = demodulated.summary
    motion = "acceleration in m/s²" if accelerated else "displacement in m"
    doubt = ""
    if summary.setting.direction is None:
        doubt = "; the direction is not stated: the sign of x is not known"
    history = (
        raw.step,
        f"reference: {motion} from the {summary.setting.kind} signals, "
        f"{raw.optical.rate_hz:.9g} Hz, every {demodulated.factor}{doubt}",
        *request.other_file(folder),
    )
    start_s = raw.clock.begins_s if entry.start_time_s is None else entry.start_time_s
    full_scale = calibration.response.full_scale
    return Record(
        name=raw.name,
        reference=aligned.displacement_m,
        response=aligned.response * raw.response_factor,
        sampling_rate_hz=aligned.rate_hz,
        excitation=entry.excitation,
        frequency_hz=entry.frequency_hz,
        valid=aligned.valid,
        start_time_s=start_s + request.start_s + aligned.start_s,
        provenance=Provenance(request.file, sha256(folder / request.file), history),
        response_full_scale=scaled_limit(full_scale, raw.response_factor),
        reference_noise_order=4 if accelerated else 0,
        circumstances=entry.circumstances,
        band_hz=entry.band_hz,
        optical=replace(summary, findings=(*raw.doubts, *summary.findings)),
    )
