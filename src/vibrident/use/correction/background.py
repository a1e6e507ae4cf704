"""Background of a corrected record, from its parts at rest: hum, drift, a shifted zero.

A record that begins and ends at rest should end without acceleration. Acceleration there beyond the
uncertainty so far is an uncertainty of every sample.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.data.screening import ScreeningFinding
from vibrident.use.correction.band import PassBand
from vibrident.use.correction.quiet import Baseline

RECORD_PARTS = 16  # into which a record is divided
MIN_PART_SAMPLES = 16
MAX_LAST_PARTS = 4  # parts at the end that are tested for rest
#: Largest scatter about a line of a part at rest, in units of the record's largest deviation.
MAX_REST_DEVIATION = 0.05
SIGNIFICANT_DEVIATIONS = 6.0  # of a mean square, in its standard deviations
MIN_SHIFT_SHARE = 0.5  # part of the mean square that the square of a mean must be to be a shift
#: Smallest last swing of a motion that is cut off, in units of the largest deviation.
MIN_CUT_OFF_SWING = 0.01
MIN_SWING_OVER_NOISE = 5.0  # of such a motion


@dataclass(frozen=True, eq=False)
class Background:
    """Signal in addition to the motion."""

    deviation: FloatArray  # standard uncertainty of every sample by it, shape (samples,)
    findings: tuple[ScreeningFinding, ...]


def measure_background(
    record: Record,
    values: FloatArray,
    acceleration: FloatArray,
    components: Mapping[str, FloatArray],
    band: PassBand,
    baseline: Baseline,
    unit: str,
) -> Background:
    """Compare the acceleration in the record's parts at rest with its uncertainty.

    Args:
        record: the record.
        values: its response less the offset, shape (samples,).
        acceleration: shape (samples,).
        components: standard uncertainty of the acceleration by origin, each of shape (samples,).
        band: the restored band.
        baseline: rest, offset and noise.
        unit: of the acceleration.
    """
    noise = components["noise"]
    u = np.sqrt(sum(series**2 for series in components.values()))
    nothing = Background(np.zeros(values.size), ())
    if baseline.rest_samples == 0:
        return nothing
    worst = 0.0
    worst_part = slice(0, 0)
    still_parts = _still_parts(values, baseline.rest_samples, components["ends"] ** 2 < 0.5 * u**2)
    for still_part in still_parts:
        power = float(np.mean(acceleration[still_part] ** 2))
        expected = float(np.mean(u[still_part] ** 2))
        independent = max(
            1.0, 2.0 * acceleration[still_part].size * band.high_hz / record.sampling_rate_hz
        )
        excess = power - expected
        if (
            excess > expected * SIGNIFICANT_DEVIATIONS * np.sqrt(2.0 / independent)
            and excess > worst
        ):
            worst = excess
            worst_part = still_part
    if worst == 0.0:
        return nothing
    level = float(np.sqrt(np.mean(noise[worst_part] ** 2)))
    profile = noise / level if level > 0 else np.ones(values.size)
    after = acceleration[still_parts[-1]] if still_parts[-1].start > 0 else np.zeros(1)
    mean = float(np.mean(after))
    shifted = mean**2 > MIN_SHIFT_SHARE * float(np.mean(after**2))  # mains hum has no mean
    findings = (_shift(record.name, mean, unit),) if shifted else ()
    return Background(np.sqrt(worst) * profile, findings)


def _still_parts(values: FloatArray, rest_samples: int, inner: BoolArray) -> list[slice]:
    """Return the rest before the motion, and the last parts at rest together.

    Only the last parts count: motion after a shock decays, a disturbance stays.

    Args:
        values: response, shape (samples,).
        rest_samples: number of samples at rest before the motion.
        inner: samples away from the record's ends, shape (samples,).
    """
    count = max(MIN_PART_SAMPLES, values.size // RECORD_PARTS)
    largest = float(np.max(np.abs(values)))
    index = np.arange(count)
    before = [slice(0, rest_samples)] if rest_samples >= MIN_PART_SAMPLES else []
    after: list[slice] = []
    for last in range(values.size, rest_samples + count, -count):
        block = values[last - count : last]
        line = np.polyval(np.polyfit(index, block, 1), index)
        if np.std(block - line) > MAX_REST_DEVIATION * largest or len(after) == MAX_LAST_PARTS:
            break
        if inner[last - count : last].all():
            after.append(slice(last - count, last))
    return before + ([slice(after[-1].start, after[0].stop)] if after else [])


def _shift(name: str, mean: float, unit: str) -> ScreeningFinding:
    text = (
        f"{name}: the acceleration comes to {mean:.3g} {unit} on average after the motion: the "
        "response's zero has drifted or shifted since the beginning. The uncertainty of every "
        "sample holds that."
    )
    return ScreeningFinding("drift", text)


def check_ends(record: Record, values: FloatArray, baseline: Baseline) -> list[ScreeningFinding]:
    """Return the findings of a shock that does not begin and end at rest."""
    findings = []
    if record.excitation != "shock":
        return findings
    if baseline.rest_samples == 0:
        text = (
            f"{record.name}: the record begins in the middle of the motion. The motion before is "
            "unknown; near the beginning the uncertainty is a guess from the rest of the record. "
            "Record some rest before the motion."
        )
        findings.append(ScreeningFinding("short_record", text))
    block = max(MIN_PART_SAMPLES, values.size // 50)
    index = np.arange(block)
    last = values[-block:] - np.polyval(np.polyfit(index, values[-block:], 1), index)
    swing = float(np.std(last))
    if swing > max(
        MIN_CUT_OFF_SWING * float(np.max(np.abs(values))),
        MIN_SWING_OVER_NOISE * baseline.noise_deviation,
    ):
        text = (
            f"{record.name}: the record ends in the middle of the motion; near its end the "
            "uncertainty is a guess from the rest of the record. Record longer."
        )
        findings.append(ScreeningFinding("short_record", text))
    return findings


def starts_in_motion(name: str) -> ScreeningFinding:
    """Return the finding of a motion that begins with the record."""
    text = (
        f"{name}: the motion begins at the record's first sample. The sensor is taken to have been "
        "at rest before, as it is at the end. Record some rest before the motion."
    )
    return ScreeningFinding("short_record", text)


def with_rest_prepended(record: Record, samples: int) -> Record:
    """Return the record with its last samples, at rest, prepended in reverse."""

    def extended(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values[: -samples - 1 : -1], values])

    return replace(
        record,
        response=extended(record.response),
        reference=None if record.reference is None else extended(record.reference),
        valid=extended(record.mask),
        reference_valid=extended(record.reference_mask),
    )
