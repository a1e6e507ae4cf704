"""A corrected record at rest: hum, drift, a shifted zero.

A record that begins and ends at rest should end without acceleration. Acceleration there beyond the uncertainty found
so far is an uncertainty of every sample.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.data.screening import Finding
from vibrident.use.correction.band import Band
from vibrident.use.correction.quiet import Surroundings

PARTS = 16  # parts in which a record is examined
FEWEST = 16  # fewest samples of a part
LAST_PARTS = 4  # number of them from the end
STILL = 0.05  # a part is at rest if its scatter about a line is below this part of the largest deviation
BEYOND = 6.0  # a mean square is significant beyond so many of its standard deviations
SHIFTED = 0.5  # a mean is a shift if it is this part of the mean square
CUT_OFF = 0.01  # motion is cut off if the last swing is above this part of the largest deviation
ABOVE_NOISE = 5.0  # it must also exceed this multiple of the noise


@dataclass(frozen=True, eq=False)
class Background:
    """Signal beside the motion."""

    deviation: FloatArray  # its standard uncertainty at every sample, shape (samples,)
    findings: tuple[Finding, ...]  # warnings about it


def background(
    record: Record,
    values: FloatArray,
    acceleration: FloatArray,
    components: Mapping[str, FloatArray],
    band: Band,
    around: Surroundings,
    unit: str,
) -> Background:
    """Compare the acceleration in the record's parts at rest with its uncertainty.

    ``values``: its response less the offset, shape (samples,); ``acceleration``: shape (samples,); ``components``: its
    standard uncertainty by origin, each of shape (samples,); ``band``: restored; ``around``: rest, offset and noise;
    ``unit``: of the acceleration.
    """
    noise = components["noise"]
    u = np.sqrt(sum(series**2 for series in components.values()))
    nothing = Background(np.zeros(values.size), ())
    if around.rest_samples == 0:
        return nothing
    worst, at = 0.0, slice(0, 0)
    parts = _still_parts(values, around.rest_samples, components["ends"] ** 2 < 0.5 * u**2)
    for part in parts:
        there, expected = float(np.mean(acceleration[part] ** 2)), float(np.mean(u[part] ** 2))
        independent = max(1.0, 2.0 * acceleration[part].size * band.high_hz / record.sampling_rate_hz)
        excess = there - expected
        if excess > expected * BEYOND * np.sqrt(2.0 / independent) and excess > worst:
            worst, at = excess, part
    if worst == 0.0:
        return nothing
    level = float(np.sqrt(np.mean(noise[at] ** 2)))
    profile = noise / level if level > 0 else np.ones(values.size)
    after = acceleration[parts[-1]] if parts[-1].start > 0 else np.zeros(1)
    mean = float(np.mean(after))
    shifted = mean**2 > SHIFTED * float(np.mean(after**2))  # mains hum has no mean
    findings = (_shift(record.name, mean, unit),) if shifted else ()
    return Background(np.sqrt(worst) * profile, findings)


def _still_parts(values: FloatArray, rest: int, inner: BoolArray) -> list[slice]:
    """The rest before the motion, and the last parts at rest together, with or without offset.

    Only the last: motion after a shock decays, a disturbance stays.

    ``values``: response, shape (samples,); ``rest``: samples at rest before the motion; ``inner``: away from the
    record's ends, shape (samples,).
    """
    count = max(FEWEST, values.size // PARTS)
    largest, index = float(np.max(np.abs(values))), np.arange(count)
    before = [slice(0, rest)] if rest >= FEWEST else []
    after: list[slice] = []
    for last in range(values.size, rest + count, -count):
        part = values[last - count : last]
        line = np.polyval(np.polyfit(index, part, 1), index)
        if np.std(part - line) > STILL * largest or len(after) == LAST_PARTS:
            break
        if inner[last - count : last].all():
            after.append(slice(last - count, last))
    return before + ([slice(after[-1].start, after[0].stop)] if after else [])


def _shift(name: str, mean: float, unit: str) -> Finding:
    text = (
        f"{name}: the acceleration comes to {mean:.3g} {unit} on average after the motion: the "
        "response's zero has drifted or shifted since the beginning. The uncertainty of every sample holds that."
    )
    return Finding("drift", text)


def at_the_ends(record: Record, values: FloatArray, around: Surroundings) -> list[Finding]:
    """Motion at a record's first or last sample, of a record that should begin and end at rest."""
    findings = []
    if record.excitation != "shock":
        return findings
    if around.rest_samples == 0:
        text = (
            f"{record.name}: the record begins in the middle of the motion. The motion before is unknown; near the "
            "beginning the uncertainty is a guess from the rest of the record. Record some rest before the motion."
        )
        findings.append(Finding("short_record", text))
    block = max(FEWEST, values.size // 50)
    index = np.arange(block)
    last = values[-block:] - np.polyval(np.polyfit(index, values[-block:], 1), index)
    swing = float(np.std(last))
    if swing > max(CUT_OFF * float(np.max(np.abs(values))), ABOVE_NOISE * around.noise_deviation):
        text = (
            f"{record.name}: the record ends in the middle of the motion; near its end the uncertainty is a guess from "
            "the rest of the record. Record longer."
        )
        findings.append(Finding("short_record", text))
    return findings


def begins_at_once(name: str) -> Finding:
    """The warning of a motion that begins with the record."""
    text = (
        f"{name}: the motion begins at the record's first sample. The sensor is taken to have been at rest "
        "before, as it is at the end. Record some rest before the motion."
    )
    return Finding("short_record", text)


def preceded(record: Record, samples: int) -> Record:
    """The record with its last samples, at rest, prepended in reverse."""

    def longer(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values[: -samples - 1 : -1], values])

    return replace(
        record,
        response=longer(record.response),
        reference=None if record.reference is None else longer(record.reference),
        valid=longer(record.mask),
        reference_valid=longer(record.reference_mask),
    )
