"""What the tones of records say of these: too few periods, other motion, channels that do not show the tone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.data.screening import Finding
from vibrident.fit.response.motion import kind_of_motion, stray_motion
from vibrident.fit.response.response import MeasuredResponse

#: Fewest periods of a tone in a record.
FEWEST_PERIODS = 2.0
#: A tone is significant above this many standard deviations of its amplitude.
SILENT_SIGMA = 5.0
#: Largest power of other motion (vibration noise) beside a sine, over the power of its tone.
MOST_STRAY = 5.0


def short_records(records: Sequence[Record], frequencies_hz: FloatArray) -> list[Finding]:
    """Sine records that hold fewer than two periods."""
    findings = []
    for record, frequency in zip(records, frequencies_hz, strict=True):
        periods = frequency * record.mask.sum() / record.sampling_rate_hz
        if periods < FEWEST_PERIODS:
            text = f"{record.name}: only {periods:.2g} periods of {frequency:.4g} Hz."
            findings.append(Finding("short_record", text))
    return findings


def refuse_other_motion(records: Sequence[Record], tones: MeasuredResponse) -> None:
    """Refuse a record that is said to be a sine, though its sensor answers far more other motion.

    Raises:
        InputError: there is one.
    """
    samples = np.array([record.mask.sum() for record in records])
    rest = (
        np.abs(tones.line_reference[:, 0]) ** 2 * samples / 2.0
    )  # twice the mean square beside the tone
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


def nothing_in_common(records: Sequence[Record]) -> list[Finding]:
    """Records whose response and reference have nothing in common, while others' have."""
    return [
        Finding(
            "dead_channel",
            f"{record.name}: response and reference have nothing in common; the record is left out. Is a channel dead, "
            "or are they of two measurements?",
        )
        for record in records
    ]


def silent_channels(tones: MeasuredResponse) -> list[Finding]:
    """A channel in which no record shows its tone above the noise: the wrong column, or a dead channel."""
    return [
        Finding(
            "dead_channel",
            f"The {label} channel shows the tone above its noise in none of the records.",
        )
        for label, heard in zip(("reference", "response"), _heard(tones), strict=True)
        if not heard.any()
    ]


def silent_records(tones: MeasuredResponse) -> list[int]:
    """Sine records of which one channel does not show the tone above its noise: what ``tones.record`` calls them."""
    return tones.record[~np.all(_heard(tones), axis=0)].tolist()


def _heard(tones: MeasuredResponse) -> BoolArray:
    """Whether reference and response show the tone of each record above their noise, shape (2, tones)."""
    channels = (tones.reference, tones.line_reference), (tones.response, tones.line_response)
    noise = [
        np.sqrt(np.sum(np.abs(lines) ** 2, axis=1) / np.sum(tones.line_weight, axis=1))
        for _, lines in channels
    ]
    return np.array(
        [np.abs(tone) > SILENT_SIGMA * own for (tone, _), own in zip(channels, noise, strict=True)]
    )
