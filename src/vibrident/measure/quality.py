"""Is a record fit for use? Plateaus of an overdriven channel, channels without signal, too few periods, aliasing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft

from vibrident.errors import InputError
from vibrident.measure.motion import kind_of_motion, stray_motion
from vibrident.measure.response import MeasuredResponse
from vibrident.records import BoolArray, FloatArray, Record
from vibrident.result import WarningCode

#: A run of samples at a channel's extreme is a plateau when a parabola through half as many samples on either side
#: passes it by this many times the run's own spread and the parabola's misfit …
PLATEAU_RATIO = 4.0
#: … and by this part of the channel's range (less is the flat step of a coarse generator).
LEAST_CUT = 2.5e-3
#: Shortest run that is looked at, how near the extreme it lies, samples left out beside it, points used on either side.
PLATEAU_SAMPLES, PLATEAU_TOLERANCE, PLATEAU_GUARD, MOST_POINTS = 4, 2e-3, 2, 64
#: One run of a few samples is chance, noise being what it is; so many runs, or one so long, are not.
PLATEAU_RUNS, LONG_PLATEAU = 3, 12
#: Part of the reference's power above 0.45 of the sampling rate that is taken for a missing anti-alias filter.
ALIAS_POWER = 0.01
FEWEST_PERIODS = 2.0
#: A tone is heard above this many standard deviations of its amplitude.
SILENT_SIGMA = 5.0
#: A sine may come with this much other motion that the sensor answers, over the power of its tone: noise that it feels.
MOST_STRAY = 5.0


@dataclass(frozen=True)
class Finding:
    """One doubt about the data."""

    code: WarningCode
    message: str


def screen(records: Sequence[Record]) -> tuple[tuple[Record, ...], tuple[Finding, ...]]:
    """Mark samples that must not be used, leave out dead records, and say what was found.

    Raises:
        InputError: no record is left.
    """
    kept, findings = [], []
    for record in records:
        dead = _dead(record)
        if dead:
            findings.append(Finding("dead_channel", f"{record.name}: {dead}; the record is left out."))
            continue
        record, clipped = _without_plateaus(record)
        findings += clipped
        if record.mask.sum() < 8:
            findings.append(Finding("clipped", f"{record.name}: nothing usable is left; the record is left out."))
            continue
        findings += _aliasing(record)
        kept.append(record)
    if not kept:
        raise InputError(
            "No record can be used.",
            expected="at least one record in which both channels carry a signal",
            found="; ".join(f.message for f in findings),
            where="records",
            remedy="check the columns of [reference] and [response] with `vibrident inspect`",
        )
    return tuple(kept), tuple(findings)


def _dead(record: Record) -> str:
    """Why the record holds no signal at all; empty where it does."""
    channels = [("response", record.response)]
    if record.reference is not None:
        channels.insert(0, ("reference", record.reference))
    for label, values in channels:
        values = np.asarray(values)[record.mask]
        if values.size == 0 or np.ptp(values) == 0.0:
            return f"the {label} channel never changes"
    return ""


def _without_plateaus(record: Record) -> tuple[Record, list[Finding]]:
    findings = []
    channels = [("response", record.response)]
    if record.reference is not None:
        channels.insert(0, ("reference", record.reference))
    for label, values in channels:
        bad = plateaus(np.asarray(values), record.mask)
        if bad.any():
            level = float(np.median(np.asarray(values)[bad]))
            count = int(np.sum(bad & record.mask))
            record = record.without(bad, f"{label} clipped near {level:.6g}")
            findings.append(
                Finding(
                    "clipped",
                    f"{record.name}: the {label} channel stays on a plateau near {level:.6g}; {count} of "
                    f"{record.samples} samples are left out of the fit.",
                )
            )
    return record, findings


def plateaus(values: FloatArray, valid: BoolArray) -> BoolArray:
    """Samples on a plateau at either extreme, with a guard of two samples around; shape (samples,).

    A free signal turns round at its extreme as the samples on both sides foretell; a clipped one stays flat where
    they lead further, and one that is thrown to a rail lies where they do not lead at all. The comparison needs no
    full scale, and neither a slow sine's flat top, nor coarse quantisation, nor the rest before a shock looks
    clipped.
    """
    bad = np.zeros(values.shape, dtype=bool)
    rest = float(np.median(values[valid])) if valid.any() else 0.0
    for _ in range(4):
        good = valid & ~bad
        if good.sum() < 8:
            break
        found = np.zeros_like(bad)
        low, high = float(values[good].min()), float(values[good].max())
        tolerance = PLATEAU_TOLERANCE * (high - low)
        for at_extreme in (good & (values >= high - tolerance), good & (values <= low + tolerance)):
            level = float(np.median(values[at_extreme]))
            if abs(level - rest) < 0.05 * (high - low):
                continue
            if _is_rail(values, at_extreme, LEAST_CUT * (high - low)):
                found |= at_extreme  # every sample on a rail counts, also a single one
        if not found.any():
            break
        for shift in range(1, PLATEAU_GUARD + 1):
            bad[shift:] |= found[:-shift]
            bad[:-shift] |= found[shift:]
        bad |= found
    return bad


def _is_rail(values: FloatArray, at_extreme: BoolArray, least: float) -> bool:
    """Whether the longest runs at an extreme are plateaus: one long one, or PLATEAU_RUNS of them."""
    runs = sorted(_runs_of(at_extreme), key=lambda run: run[0] - run[1])[:PLATEAU_RUNS]
    for count, (first, last) in enumerate(runs, start=1):
        if not _is_plateau(values, first, last, least):
            return False
        if last - first + 1 >= LONG_PLATEAU or count == PLATEAU_RUNS:
            return True
    return False


def _is_plateau(values: FloatArray, first: int, last: int, least: float) -> bool:
    """Whether the samples on both sides lead past the run by more than ``least``; see :func:`plateaus`."""
    length = last - first + 1
    inside = values[first : last + 1]
    stretch = max(3, length // 2)
    stride = max(1, stretch // MOST_POINTS)
    before = values[max(0, first - stretch) : first][::-stride][::-1]
    after = values[last + 1 : last + 1 + stretch : stride]
    if before.size < 3 or after.size < 3:
        return False
    times = np.concatenate(
        [-1.0 - stride * np.arange(before.size)[::-1], length + stride * np.arange(after.size)]
    ) - 0.5 * (length - 1)
    scaled = times / times[-1]
    basis = np.stack([np.ones_like(scaled), scaled, scaled**2], axis=1)
    sides = np.concatenate([before, after])
    coefficients, *_ = np.linalg.lstsq(basis, sides, rcond=None)
    misfit = float(np.sqrt(np.mean((sides - basis @ coefficients) ** 2)))
    passed = abs(float(coefficients[0] - np.median(inside)))
    if passed <= max(PLATEAU_RATIO * float(np.ptp(inside)), PLATEAU_RATIO * misfit, least):
        return False
    return passed > _resolution(values)


def _resolution(values: FloatArray) -> float:
    """Smallest step between values that occur: the quantisation, where there is one."""
    steps = np.diff(np.unique(values[:: max(1, values.size // 20000)]))
    return float(np.min(steps)) if steps.size else 0.0


def _runs_of(flags: BoolArray) -> list[tuple[int, int]]:
    """First and last index of every run of at least PLATEAU_SAMPLES."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    starts, ends = edges[::2], edges[1::2]
    long = ends - starts >= PLATEAU_SAMPLES
    return [(int(a), int(b) - 1) for a, b in zip(starts[long], ends[long], strict=True)]


def _aliasing(record: Record) -> list[Finding]:
    if record.reference is None:
        return []
    values = np.where(record.mask, np.asarray(record.reference) - np.asarray(record.reference)[record.mask].mean(), 0.0)
    power = np.abs(np.asarray(fft.rfft(values * np.hanning(record.samples)))) ** 2
    total = float(power.sum())
    above = float(power[int(0.9 * power.shape[0]) :].sum())
    if total > 0 and above > ALIAS_POWER * total:
        return [
            Finding(
                "aliasing",
                f"{record.name}: {100 * above / total:.0f} % of the reference's power lies above 0.45 of the sampling "
                "rate, where no anti-alias filter leaves any; content above half the rate would look the same.",
            )
        ]
    return []


def short_records(records: Sequence[Record], frequencies_hz: FloatArray) -> list[Finding]:
    """Sine records that hold fewer than two periods."""
    findings = []
    for record, frequency in zip(records, frequencies_hz, strict=True):
        periods = frequency * record.mask.sum() / record.sampling_rate_hz
        if periods < FEWEST_PERIODS:
            findings.append(
                Finding("short_record", f"{record.name}: only {periods:.2g} periods of {frequency:.4g} Hz.")
            )
    return findings


def refuse_other_motion(records: Sequence[Record], tones: MeasuredResponse) -> None:
    """Refuse a record that is said to be a sine, though its sensor answers far more other motion.

    Raises:
        InputError: there is one.
    """
    samples = np.array([record.mask.sum() for record in records])
    rest = np.abs(tones.line_reference[:, 0]) ** 2 * samples / 2.0  # twice the mean square beside the tone
    for index in np.flatnonzero(rest > MOST_STRAY * np.abs(tones.reference) ** 2).tolist():
        record, frequency = records[index], float(tones.frequency_hz[index])
        likely = kind_of_motion(np.asarray(record.reference)[record.mask])
        if likely == "shock":
            found = "motion in a small part of the record"
        elif frequency * samples[index] / record.sampling_rate_hz < FEWEST_PERIODS:
            continue  # what is short may look like anything
        else:
            stray = stray_motion(record, frequency)
            if stray < MOST_STRAY:
                continue
            found = f"the sensor answers {stray:.2g} times as much other motion as at {frequency:.4g} Hz"
        other = "random" if likely == "sine" else likely
        raise InputError(
            "The motion of this record is no sine.",
            expected='excitation = "sine" for motion at one frequency',
            found=found,
            where=record.name,
            remedy=f'write excitation = "{other}", or cut the record to the tone',
        )


def silent_channels(tones: MeasuredResponse) -> list[Finding]:
    """A channel in which no record shows its tone above the noise: the wrong column, or a dead channel."""
    findings = []
    for label, amplitude, lines in (
        ("reference", tones.reference, tones.line_reference),
        ("response", tones.response, tones.line_response),
    ):
        noise = np.sqrt(np.sum(np.abs(lines) ** 2, axis=1) / np.sum(tones.line_weight, axis=1))
        heard = np.abs(amplitude) > SILENT_SIGMA * noise
        if not heard.any():
            findings.append(
                Finding("dead_channel", f"The {label} channel shows the tone above its noise in none of the records.")
            )
    return findings
