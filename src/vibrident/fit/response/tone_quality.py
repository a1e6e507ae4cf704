"""Checks of records by their tones: too few periods, other motion, channels without the tone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.data.screening import ScreeningFinding
from vibrident.fit.response.motion import kind_of_motion, stray_motion
from vibrident.fit.response.response import MeasuredResponse

#: Fewest periods of a tone in a record.
MIN_PERIODS = 2.0
#: A tone is significant above this many standard deviations of its amplitude.
MIN_TONE_DEVIATIONS = 5.0
#: Largest power of other motion (vibration noise) over the power of the tone of a sine.
MAX_STRAY_POWER = 5.0


def short_records(records: Sequence[Record], frequencies_hz: FloatArray) -> list[ScreeningFinding]:
    """Return a finding for each sine record of fewer than two periods."""
    findings = []
    for record, frequency in zip(records, frequencies_hz, strict=True):
        periods = frequency * record.mask.sum() / record.sampling_rate_hz
        if periods < MIN_PERIODS:
            text = f"{record.name}: only {periods:.2g} periods of {frequency:.4g} Hz."
            findings.append(ScreeningFinding("short_record", text))
    return findings


def refuse_other_motion(records: Sequence[Record], tones: MeasuredResponse) -> None:
    """Refuse a record declared as a sine whose sensor answers far more to other motion.

    Raises:
        InputError: there is one.
    """
    samples = np.array([record.mask.sum() for record in records])
    # Twice the mean square beside the tone.
    residual_power = np.abs(tones.line_reference[:, 0]) ** 2 * samples / 2.0
    for index in np.flatnonzero(
        residual_power > MAX_STRAY_POWER * np.abs(tones.reference) ** 2
    ).tolist():
        record = records[index]
        frequency = float(tones.frequency_hz[index])
        likely = kind_of_motion(np.asarray(record.reference)[record.mask])
        if likely == "shock":
            observation = "motion in a small part of the record"
        elif frequency * samples[index] / record.sampling_rate_hz < MIN_PERIODS:
            continue  # a short record may look like anything
        else:
            stray = stray_motion(record, frequency)
            if stray < MAX_STRAY_POWER:
                continue
            observation = (
                f"the sensor answers {stray:.2g} times as much other motion "
                f"as at {frequency:.4g} Hz"
            )
        excitation = "random" if likely == "sine" else likely
        raise InputError(
            "The motion of this record is no sine.",
            expected='excitation = "sine" for motion at one frequency',
            found=observation,
            where=record.name,
            remedy=f'write excitation = "{excitation}", or cut the record to the tone',
        )


def uncorrelated_channels(records: Sequence[Record]) -> list[ScreeningFinding]:
    """Return a finding for each of these records, whose channels are uncorrelated."""
    return [
        ScreeningFinding(
            "dead_channel",
            f"{record.name}: response and reference have nothing in common; the record is left "
            "out. Is a channel dead, or are they of two measurements?",
        )
        for record in records
    ]


def silent_channels(tones: MeasuredResponse) -> list[ScreeningFinding]:
    """Return a finding for each channel in which no record shows its tone above the noise.

    The channel is dead, or its column is wrong.
    """
    return [
        ScreeningFinding(
            "dead_channel",
            f"The {label} channel shows the tone above its noise in none of the records.",
        )
        for label, shown in zip(("reference", "response"), _tone_shown(tones), strict=True)
        if not shown.any()
    ]


def silent_records(tones: MeasuredResponse) -> list[int]:
    """Return the numbers of sine records with a channel without its tone, of ``tones.record``."""
    return tones.record[~np.all(_tone_shown(tones), axis=0)].tolist()


def _tone_shown(tones: MeasuredResponse) -> BoolArray:
    """Return whether each channel shows each tone above its noise, shape (2, tones)."""
    channels = (tones.reference, tones.line_reference), (tones.response, tones.line_response)
    count = np.sum(tones.line_weight, axis=1)
    return np.array(
        [
            np.abs(tone) > MIN_TONE_DEVIATIONS * np.sqrt(np.sum(np.abs(lines) ** 2, axis=1) / count)
            for tone, lines in channels
        ]
    )
