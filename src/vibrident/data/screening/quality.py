"""Screen records: clipped and dead channels, wild and lost samples, repeated blocks, aliasing."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy import fft

from vibrident.base.amounts import amount
from vibrident.base.errors import InputError
from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import STATIONARY_EXCITATIONS, BoolArray, FloatArray, Record
from vibrident.data.records.basis import runs_of_true
from vibrident.data.screening.answers import PredictedResponse
from vibrident.data.screening.channel import ChannelSamples
from vibrident.data.screening.clipping import find_clipped
from vibrident.data.screening.decays import is_sustained
from vibrident.data.screening.gaps import lost_samples
from vibrident.data.screening.held import is_stairs
from vibrident.data.screening.repeats import repeated_block
from vibrident.data.screening.wild import (
    MAX_RUN_SAMPLES,
    MAX_SHORT_RUN_SAMPLES,
    PredictedChannel,
    find_breaks,
    find_motion,
)

#: Part of half the sampling rate above which no anti-alias filter leaves any power …
ALIAS_BAND = 0.9
#: … and share of the reference's power there from which on aliasing is reported.
MIN_ALIAS_POWER = 0.01
#: Samples on either side that an interpolation of the reference uses.
REACH = 40
#: A record that lost samples is used if at least this share of it is intact over REACH samples on
#: either side …
MIN_INTACT_SHARE = 0.05
#: … and at least this number of samples.
MIN_INTACT_SAMPLES = 128
#: A shock is where both channels exceed this share of their largest size: their half width.
MIN_SHOCK_SIZE = 0.5
#: Stationary motions; others may end within the record.
STEADY = ("sine", *STATIONARY_EXCITATIONS)
#: Motions throughout which the response follows the reference linearly.
LINEAR = (*STEADY, "sweep")


@dataclass(frozen=True)
class ScreeningFinding:
    """Finding of a screening: a warning code and its message."""

    code: WarningCode
    message: str


def screen(
    records: Sequence[Record], units: Mapping[str, str] | None = None
) -> tuple[tuple[Record, ...], tuple[ScreeningFinding, ...]]:
    """Mark samples that must not be used, leave out dead records, and return the findings.

    Args:
        records: as read.
        units: of the channels ``reference`` and ``response``, for the messages.

    Raises:
        InputError: no record is left.
    """
    usable = []
    findings = []
    for record in records:
        dead = _dead_reason(record)
        if dead:
            findings.append(
                ScreeningFinding("dead_channel", f"{record.name}: {dead}; the record is left out.")
            )
            continue
        record, spoilt = _mask_spoilt_samples(record, units or {})
        findings += spoilt
        if record.mask.sum() < 8 or (spoilt and _is_too_broken(record)):
            text = (
                f"{record.name}: too little is left between the samples left out; "
                "the record is left out."
            )
            findings.append(ScreeningFinding(spoilt[0].code if spoilt else "dead_channel", text))
            continue
        findings += _aliasing_findings(record)
        usable.append(record)
    return _require_records(usable, findings)


def without_steady_decays(
    records: Sequence[Record],
) -> tuple[tuple[Record, ...], tuple[ScreeningFinding, ...]]:
    """Return the records without stated free decays that do not die away, and the findings.

    Raises:
        InputError: no record is left.
    """
    steady = [r for r in records if r.excitation == "decay" and is_sustained(r.response, r.mask)]
    text = (
        "the response does not die away, it is as large at the end as throughout; "
        "the record is left out."
    )
    findings = [ScreeningFinding("dead_channel", f"{record.name}: {text}") for record in steady]
    return _require_records([record for record in records if record not in steady], findings)


def _require_records(
    records: Sequence[Record], findings: Sequence[ScreeningFinding]
) -> tuple[tuple[Record, ...], tuple[ScreeningFinding, ...]]:
    """Return the records and findings, or refuse if there are no records.

    Raises:
        InputError: there are none.
    """
    if not records:
        raise InputError(
            "No record can be used.",
            expected="at least one record in which both channels carry a signal, of a decay one "
            "that dies away",
            found="; ".join(f.message for f in findings),
            where="records",
            remedy="check the excitation, and the columns of [reference] and [response] with "
            "⟦command = inspect⟧",
        )
    return tuple(records), tuple(findings)


def _dead_reason(record: Record) -> str:
    """Return the reason why the record holds no signal; empty if it holds one."""
    for label, values, _ in _channels(record):
        used = values if record.mask.all() else values[record.mask]
        if used.size == 0 or np.ptp(used) == 0.0:
            return f"the {label} channel never changes"
    return ""


def _is_too_broken(record: Record) -> bool:
    """Return whether losses leave too little of the reference to interpolate it.

    Never so for a sine or a decay, whose reference is not interpolated.
    """
    if record.excitation in ("sine", "decay"):
        return False
    bad = np.concatenate([[0], np.cumsum(~record.reference_mask)])
    intact = (
        int(np.sum(bad[2 * REACH :] == bad[: -2 * REACH]))
        if bad.size > 2 * REACH
        else record.samples
    )
    return intact < max(
        MIN_INTACT_SHARE * record.samples, min(MIN_INTACT_SAMPLES, 0.5 * record.samples)
    )


def _channels(record: Record) -> list[tuple[str, FloatArray, float | None]]:
    """Return the label, samples and full scale of each channel that there is."""
    channels = [("response", record.response, record.response_full_scale)]
    if record.reference is not None:
        channels.insert(0, ("reference", record.reference, record.reference_full_scale))
    return channels


def _mask_spoilt_samples(
    record: Record, units: Mapping[str, str]
) -> tuple[Record, list[ScreeningFinding]]:
    """Return the record without clipped, lost, copied and wild samples, and the findings.

    Only the response is marked where the reference is sound.
    """
    findings = []
    samples = _samples_by_channel(record)
    for label, _, full_scale in _channels(record):
        if label == "reference" and record.optical is not None:
            # It was computed: the optical signals show the converter's limits and losses.
            continue
        samples = _samples_by_channel(record, samples)
        bad, rails = find_clipped(samples[label], full_scale)
        if bad.any():
            levels = " and ".join(amount(level, units.get(label, "1"), 6) for level in rails)
            observation = f"the {label} channel is clipped at {levels}"
            record, finding = _mask_samples(
                record, label, bad, "clipped", observation, f"{label} clipped at {levels}"
            )
            findings.append(finding)
        samples = _samples_by_channel(record, samples)
        bad = lost_samples(samples[label])
        if bad.any():
            stretches = int(np.sum(np.diff(bad.astype(int)) > 0))
            first = float(np.argmax(bad)) / record.sampling_rate_hz
            often = _frequency_words(stretches)
            observation = (
                f"the {label} channel stands still {often}at {first:.4g} s, as where a recorder "
                "lost samples"
            )
            record, finding = _mask_samples(
                record, label, bad, "dead_channel", observation, f"{label} stands still"
            )
            findings.append(finding)
    samples = _samples_by_channel(record, samples)
    record, copied = _mask_copied_block(record, samples)
    findings += copied
    for longest in _longest_runs(record):
        samples = _samples_by_channel(record, samples)
        channels = {
            label: PredictedChannel.from_samples(channel, longest)
            for label, channel in samples.items()
        }
        for label, bad in reversed(_find_wild_samples(record, channels).items()):
            record, finding = _mask_samples(
                record,
                label,
                bad,
                "dead_channel",
                _wild_observation(record, label, bad),
                f"{label} wild",
            )
            findings.append(finding)
    record, broken = _keep_unbroken_part(record, channels)
    return record, findings + broken


def _longest_runs(record: Record) -> tuple[int, ...]:
    """Return the longest runs of wild samples to look for, one after the other.

    In a shock a long run is wild where the reference rests alone, a short one amidst the motion
    too.
    """
    if record.reference is None or record.excitation not in (*LINEAR, "shock"):
        return (MAX_SHORT_RUN_SAMPLES,)
    if record.excitation == "shock":
        return MAX_RUN_SAMPLES, MAX_SHORT_RUN_SAMPLES
    return (MAX_RUN_SAMPLES,)


def _is_linear(record: Record, channels: Mapping[str, PredictedChannel]) -> bool:
    """Return whether the motion goes on throughout the record; a drive in stairs does not."""
    return record.excitation in LINEAR and not (
        record.reference is not None and is_stairs(record.reference[~channels["reference"].wild])
    )


def _wild_observation(record: Record, label: str, bad: BoolArray) -> str:
    """Describe the wild samples of a channel for a finding."""
    begins, ends = runs_of_true(bad)
    most = int(np.max(ends - begins))
    what = (
        "a single sample far off its neighbours"
        if most == 1
        else f"up to {most} samples far off those around them"
    )
    often = _frequency_words(begins.size)
    first_s = float(begins[0]) / record.sampling_rate_hz
    return (
        f"the {label} channel has {what} {often}at {first_s:.6g} s, as where a recorder or a "
        "contact fails"
    )


def _frequency_words(number: int) -> str:
    return "" if number == 1 else f"{number} times, first "


def _samples_by_channel(
    record: Record, earlier: Mapping[str, ChannelSamples] | None = None
) -> dict[str, ChannelSamples]:
    """Return each channel's samples to look at: those ``earlier`` where none was marked since."""
    channels = dict[str, ChannelSamples]()
    for label, values, _ in _channels(record):
        channel = earlier.get(label) if earlier else None
        if channel is None or not np.array_equal(channel.valid, record.mask):
            channel = ChannelSamples(values, record.mask)
        channels[label] = channel
    return channels


def _mask_copied_block(
    record: Record, channels: Mapping[str, ChannelSamples]
) -> tuple[Record, list[ScreeningFinding]]:
    """Return the record without the copy of a block that was written twice, and the findings."""
    candidates = {label: repeated_block(channel) for label, channel in channels.items()}
    blocks = {label: block for label, block in candidates.items() if block is not None}
    if not blocks:
        return record, []
    findings = []
    times = len(set(blocks.values())) == 1 and len(blocks) == len(_channels(record))
    for label, block in list(blocks.items())[: 1 if times else None]:
        bad = np.zeros(record.samples, dtype=bool)
        bad[block.second : block.second + block.length] = True
        channel_words = "both channels" if times else f"the {label} channel"
        if times and record.excitation in STEADY:
            before = block.second >= record.samples - block.second - block.length
            bad[block.second :] |= before
            bad[: block.second] |= not before
        first_s, second_s = (at / record.sampling_rate_hz for at in (block.first, block.second))
        observation = (
            f"{block.length} samples of {channel_words} at {first_s:.6g} s return at "
            f"{second_s:.6g} s, as where a recorder writes a buffer twice"
        )
        label, code = ("both", "clock_suspect") if times else (label, "dead_channel")
        record, finding = _mask_samples(
            record, label, bad, code, observation, f"{channel_words} repeated"
        )
        findings.append(finding)
    return record, findings


def _keep_unbroken_part(
    record: Record, channels: Mapping[str, PredictedChannel]
) -> tuple[Record, list[ScreeningFinding]]:
    """Return the longest part of a steady motion in which no time was lost, and the finding.

    ``channels``: the record's channels as predicted before; computed anew where samples were
    marked since.
    """
    if record.reference is None or record.excitation not in STEADY:
        return record, []
    valid = record.mask & record.reference_mask
    if not all(np.array_equal(valid, channel.valid) for channel in channels.values()):
        channels = {
            label: PredictedChannel.from_samples(ChannelSamples(values, valid))
            for label, values, _ in _channels(record)
        }
    break_index = find_breaks(**channels)
    if break_index.size and is_stairs(record.reference):
        return record, []
    if break_index.size:
        answers = PredictedResponse.all_from_channels(**channels)
        break_index = break_index[
            [all(answer.breaks_off(int(index)) for answer in answers) for index in break_index]
        ]
    if break_index.size == 0:
        return record, []
    edges = np.concatenate([[0], break_index, [record.samples]])
    longest = int(np.argmax(np.diff(edges)))
    outside = np.ones(record.samples, dtype=bool)
    # Which of the samples at a break is the last, or the first, is not known.
    outside[
        edges[longest] + 2 * (longest > 0) : edges[longest + 1] - 2 * (longest < break_index.size)
    ] = False
    times = ", ".join(f"{index / record.sampling_rate_hz:.6g}" for index in break_index)
    observation = (
        f"both channels break off at {times} s and go on elsewhere, as where a recorder lost time; "
        "only the longest unbroken part is used"
    )
    record, finding = _mask_samples(
        record, "both", outside, "clock_suspect", observation, "the longest part without lost time"
    )
    return record, [finding]


def _find_wild_samples(
    record: Record, channels: Mapping[str, PredictedChannel]
) -> dict[str, BoolArray]:
    """Return the wild samples of each channel that has any.

    Where the other channel moves as oddly, the samples are motion, and so is a shock, where both
    channels are large. But in a motion that goes on, one or two odd samples in both channels at
    once are wild: a sensor answers for longer.
    """
    wild = {label: channel.wild.copy() for label, channel in channels.items()}
    if len(wild) == 1 or not any(bad.any() for bad in wild.values()):
        return {label: bad for label, bad in wild.items() if bad.any()}
    linear = _is_linear(record, channels)
    answers = PredictedResponse.all_from_channels(**channels)
    for label, other_channel in zip(wild, [*channels.values()][::-1], strict=True):
        if not wild[label].any():
            continue
        moved = find_motion(channels[label], other_channel, wild[label])
        for first, end in zip(*runs_of_true(wild[label]), strict=True):
            run = slice(first, end)
            if record.excitation == "shock" and any(
                _is_shock(channels, wild, label, run, answer.delay) for answer in answers
            ):
                wild[label][first:end] = False
                continue
            at_once = [
                event.may_be_short_wild
                for event in other_channel.events
                if event.first <= end and first <= event.end
            ]
            if moved[first:end].any() and not (
                linear and end - first <= MAX_SHORT_RUN_SAMPLES and at_once and all(at_once)
            ):
                wild[label][first:end] = False
            events = [
                event
                for event in channels[label].events
                if event.wild and first <= event.first < end
            ]
            if not any(
                event.may_be_short_wild or all(answer.denies(label, event) for answer in answers)
                for event in events
            ):
                wild[label][first:end] = False
    return {label: bad for label, bad in wild.items() if bad.any()}


def _is_shock(
    channels: Mapping[str, PredictedChannel],
    wild: Mapping[str, BoolArray],
    label: str,
    run: slice,
    delay: int,
) -> bool:
    """Return whether both channels are about as large as ever in a run, or as long beside it.

    Other wild samples do not count. One or two samples are no shock that a sensor follows.

    Args:
        channels: reference and response.
        wild: their wild samples.
        label: of the channel of the run.
        run: its samples.
        delay: samples by which the response is late.
    """
    length = run.stop - run.start
    ratios = list[float]()
    for name, channel in channels.items():
        late = delay * ((name == "response") - (label == "response"))
        around = slice(max(run.start + late - length, 0), max(run.stop + late + length, 0))
        size = np.abs(channel.series)
        elsewhere = wild[name].copy()
        elsewhere[around] = False
        size[elsewhere] = 0.0
        largest = max(float(np.max(size)), np.finfo(float).tiny)
        ratios.append(float(np.max(size[around], initial=0.0)) / largest)
    return length > MAX_SHORT_RUN_SAMPLES and min(ratios) > MIN_SHOCK_SIZE


def _mask_samples(
    record: Record, label: str, bad: BoolArray, code: WarningCode, observation: str, reason: str
) -> tuple[Record, ScreeningFinding]:
    """Return the record without the ``bad`` samples, and the finding that says so.

    The reference stays in use where only the response is spoilt.
    """
    count = int(np.sum(bad & (record.reference_mask if label == "reference" else record.mask)))
    text = (
        f"{record.name}: {observation}; {count} of {record.samples} samples are left out of the "
        "fit."
    )
    remaining = (
        record.without_response(bad, reason) if label == "response" else record.without(bad, reason)
    )
    return remaining, ScreeningFinding(code, text)


@functools.lru_cache(maxsize=4)
def _window(samples: int) -> FloatArray:
    """Return Hann's window, shape (samples,)."""
    return np.hanning(samples)


def _aliasing_findings(record: Record) -> list[ScreeningFinding]:
    # The decimation of optical signals filters away what would alias.
    if record.reference is None or record.optical is not None:
        return []
    mask = record.reference_mask
    values = record.reference
    if not mask.all():  # a gap filled with zeros would be two steps
        values = np.interp(np.arange(record.samples), np.flatnonzero(mask), values[mask])
    values = values - values.mean()
    window = _window(record.samples)
    lines = fft.rfft(values * window)
    power = np.square(lines.real) + np.square(lines.imag)
    # A shock at the ends has no power under the window.
    total = max(float(power.sum()), 0.5 * float(np.sum(values**2)) * float(np.sum(window**2)))
    above = float(power[int(ALIAS_BAND * power.shape[0]) :].sum())
    if above <= MIN_ALIAS_POWER * total:
        return []
    text = (
        f"{record.name}: {100 * above / total:.0f} % of the reference's power lies above 0.45 of "
        "the sampling rate, where no anti-alias filter leaves any; content above half the rate "
        "would look the same."
    )
    return [ScreeningFinding("aliasing", text)]
