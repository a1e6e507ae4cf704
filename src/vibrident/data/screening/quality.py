"""Screen records: clipped and dead channels, wild and lost samples, repeated blocks, aliasing."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy import fft

from vibrident.base.amounts import amount
from vibrident.base.brief import first_names
from vibrident.base.errors import InputError
from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import STATIONARY_EXCITATIONS, BoolArray, FloatArray, Record
from vibrident.data.records.basis import runs_of_true
from vibrident.data.screening.answers import PredictedResponse
from vibrident.data.screening.channel import ChannelSamples
from vibrident.data.screening.clipping import find_clipped
from vibrident.data.screening.decays import is_sustained
from vibrident.data.screening.gaps import find_lost_samples
from vibrident.data.screening.held import is_stairs
from vibrident.data.screening.repeats import repeated_block
from vibrident.data.screening.wild import (
    MAX_LONG_RUN_SAMPLES,
    MAX_RUN_SAMPLES,
    MAX_SHORT_RUN_SAMPLES,
    PredictedChannel,
    find_breaks,
    find_motion,
)

#: Part of half the sampling rate above which no anti-alias filter leaves any power.
ALIAS_BAND = 0.9
#: Share of the reference's power there from which on aliasing is reported.
MIN_ALIAS_POWER = 0.01
#: Samples on either side that an interpolation of the reference uses.
REACH = 40
#: Smallest share of a record that is intact over REACH samples on either side: with less, the
#: record is left out.
MIN_INTACT_SHARE = 0.05
#: Fewest such samples.
MIN_INTACT_SAMPLES = 128
#: A shock is where both channels exceed this share of their largest size: their half width.
MIN_SHOCK_SIZE = 0.5
#: Wild samples at an end exceed all others by this factor, as no transient does. At the end of a
#: stationary motion they need not: nothing there may be free motion, or rest.
MIN_END_PROMINENCE = 3.0
#: Stationary motions; others may end within the record.
STEADY = ("sine", *STATIONARY_EXCITATIONS)
#: Motions throughout which the response follows the reference linearly.
LINEAR = (*STEADY, "sweep")
MAX_NAMES = 5  # of records in a message


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
    left_out: dict[str, list[str]] = {}
    for record in records:
        screening = _RecordScreening(record, units or {})
        if dead := screening.dead_channel:
            reason = f"the {dead} channel never changes"
            left_out.setdefault(reason, []).append(record.name)
            findings.append(_left_out(record, reason))
            continue
        screening.mask_spoilt_samples()
        record = screening.record
        spoilt = screening.findings
        findings += spoilt
        if record.mask.sum() < 8 or (spoilt and _is_too_broken(record)):
            reason = "too little is left between the samples left out"
            left_out.setdefault(reason, []).append(record.name)
            findings.append(_left_out(record, reason, spoilt[0].code if spoilt else "dead_channel"))
            continue
        findings += _aliasing_findings(record)
        usable.append(record)
    return _require_records(usable, left_out), tuple(findings)


def _left_out(record: Record, reason: str, code: WarningCode = "dead_channel") -> ScreeningFinding:
    """Return the finding of a record that is left out."""
    return ScreeningFinding(code, f"{record.name}: {reason}; the record is left out.")


def without_steady_decays(
    records: Sequence[Record],
) -> tuple[tuple[Record, ...], tuple[ScreeningFinding, ...]]:
    """Return the records without stated free decays that do not die away, and the findings.

    Raises:
        InputError: no record is left.
    """
    steady = [r for r in records if r.excitation == "decay" and is_sustained(r.response, r.mask)]
    reason = "the response does not die away, it is as large late as early"
    findings = tuple(_left_out(record, reason) for record in steady)
    dying = [record for record in records if record not in steady]
    return _require_records(dying, {reason: [record.name for record in steady]}), findings


def _require_records(
    records: Sequence[Record], left_out: Mapping[str, Sequence[str]]
) -> tuple[Record, ...]:
    """Return the records, or refuse if there are none.

    ``left_out``: names of records by the reason why they are left out.

    Raises:
        InputError: there are none.
    """
    if not records:
        raise InputError(
            "No record can be used.",
            expected="at least one record in which both channels carry a signal, of a decay one "
            "that dies away",
            found="; ".join(
                f"{reason}: {first_names(names, MAX_NAMES)}" for reason, names in left_out.items()
            ),
            where="records",
            remedy="check the excitation, and the columns of [reference] and [response] with "
            "⟦command = inspect⟧",
        )
    return tuple(records)


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


class _RecordScreening:
    """Record under screening: it loses samples, and each loss is a finding.

    Attributes:
        record: the record without the samples that were masked so far.
        findings: a finding for each loss.
    """

    def __init__(self, record: Record, units: Mapping[str, str]) -> None:
        self.record: Record = record
        self.findings: list[ScreeningFinding] = []
        self._units = units
        self._samples: dict[str, ChannelSamples] = {}

    @property
    def dead_channel(self) -> str | None:
        """Return the label of a channel that never changes, or None."""
        channels = self._channel_samples().items()
        return next((label for label, samples in channels if samples.span == 0.0), None)

    def mask_spoilt_samples(self) -> None:
        """Mask clipped, lost, copied and wild samples, and all but the longest unbroken part."""
        for label, _, full_scale in _channels(self.record):
            # An optical reference was computed: its signals show the converter's limits and losses.
            if label != "reference" or self.record.optical is None:
                self._mask_clipped_samples(label, full_scale)
                self._mask_lost_samples(label)
        self._mask_copied_blocks()
        channels: dict[str, PredictedChannel] = {}
        for longest in _longest_runs(self.record):
            if longest > MAX_RUN_SAMPLES and not _has_longer_events(channels.values()):
                break
            channels = {
                label: PredictedChannel.from_samples(samples, longest)
                for label, samples in self._channel_samples().items()
            }
            for label, is_wild in reversed(_find_wild_samples(self.record, channels).items()):
                observation = _wild_observation(self.record, label, is_wild)
                self._mask(label, is_wild, "dead_channel", observation, f"{label} wild")
        self._keep_unbroken_part(channels)

    def _channel_samples(self) -> dict[str, ChannelSamples]:
        """Return the samples of each channel; sorted anew only where some were masked since."""
        for label, values, _ in _channels(self.record):
            samples = self._samples.get(label)
            if samples is None or samples.valid is not self.record.mask:
                self._samples[label] = ChannelSamples(values, self.record.mask)
        return self._samples

    def _mask(
        self, label: str, excluded: BoolArray, code: WarningCode, observation: str, reason: str
    ) -> None:
        """Mask samples of a channel, and record the finding.

        The reference stays in use where only the response is spoilt.

        Args:
            label: "reference", "response" or "both".
            excluded: shape (samples,).
            code: of the finding.
            observation: part of a sentence for the finding.
            reason: for the record's provenance.
        """
        record = self.record
        used = record.reference_mask if label == "reference" else record.mask
        text = (
            f"{record.name}: {observation}; {int(np.sum(excluded & used))} of {record.samples} "
            "samples are left out of the fit."
        )
        self.findings.append(ScreeningFinding(code, text))
        exclude = record.without_response if label == "response" else record.without
        self.record = exclude(excluded, reason)

    def _mask_clipped_samples(self, label: str, full_scale: float | None) -> None:
        is_clipped, rails = find_clipped(self._channel_samples()[label], full_scale)
        # The highest tread of stairs is no rail, nor the level at which the sensor rests on it.
        if is_clipped.any() and (
            full_scale is not None or not _is_in_stairs(self.record, self.record.reference_mask)
        ):
            unit = self._units.get(label, "1")
            description = "clipped at " + " and ".join(amount(level, unit, 6) for level in rails)
            observation = f"the {label} channel is {description}"
            self._mask(label, is_clipped, "clipped", observation, f"{label} {description}")

    def _mask_lost_samples(self, label: str) -> None:
        samples = self._channel_samples()
        other_channels = (channel for name, channel in samples.items() if name != label)
        is_lost = find_lost_samples(
            samples[label],
            next(other_channels, None),
            motion_goes_on=self.record.excitation in STATIONARY_EXCITATIONS,
        )
        if is_lost.any():
            begins, _ = runs_of_true(is_lost)
            first_s = float(np.argmax(is_lost)) / self.record.sampling_rate_hz
            observation = (
                f"the {label} channel stands still {_repetitions(begins.size)}at {first_s:.4g} s, "
                "as where a recorder lost samples"
            )
            self._mask(label, is_lost, "dead_channel", observation, f"{label} stands still")

    def _mask_copied_blocks(self) -> None:
        """Mask the copy of a block that was written twice.

        A steady motion with a copy of both channels is cut at the copy: its longer part remains.
        """
        record = self.record
        blocks = {
            label: block
            for label, samples in self._channel_samples().items()
            if (block := repeated_block(samples)) is not None
        }
        if not blocks:
            return
        if len(set(blocks.values())) == 1 and len(blocks) == len(_channels(record)):
            blocks = {"both": next(iter(blocks.values()))}
        for label, block in blocks.items():
            end = block.second + block.length
            is_copy = np.zeros(record.samples, dtype=bool)
            is_copy[block.second : end] = True
            if label == "both" and record.excitation in STEADY:
                first_part_is_longer = block.second >= record.samples - end
                is_copy[slice(end, None) if first_part_is_longer else slice(block.second)] = True
            name = "both channels" if label == "both" else f"the {label} channel"
            code = "clock_suspect" if label == "both" else "dead_channel"
            first_s = block.first / record.sampling_rate_hz
            second_s = block.second / record.sampling_rate_hz
            observation = (
                f"{block.length} samples of {name} at {first_s:.6g} s return at {second_s:.6g} s, "
                "as where a recorder writes a buffer twice"
            )
            self._mask(label, is_copy, code, observation, f"{name} repeated")

    def _keep_unbroken_part(self, channels: Mapping[str, PredictedChannel]) -> None:
        """Mask all but the longest part of a steady motion in which no time was lost.

        ``channels``: the channels as predicted before; predicted anew where samples were masked
        since.
        """
        record = self.record
        if record.reference is None or record.excitation not in STEADY:
            return
        valid = record.mask & record.reference_mask
        if not all(np.array_equal(valid, channel.valid) for channel in channels.values()):
            channels = {
                label: PredictedChannel.from_samples(ChannelSamples(values, valid))
                for label, values, _ in _channels(record)
            }
        breaks = find_breaks(**channels)
        if breaks.size == 0 or _is_in_stairs(record, record.reference_mask):
            return
        predictions = PredictedResponse.all_from_channels(**channels)
        breaks = breaks[
            [
                all(prediction.breaks_off(int(index)) for prediction in predictions)
                for index in breaks
            ]
        ]
        if breaks.size == 0:
            return
        # Which of the samples at a break is the last, or the first, is not known.
        begins = np.concatenate([[0], breaks + 2])
        ends = np.concatenate([breaks - 2, [record.samples]])
        longest = int(np.argmax(np.diff(breaks, prepend=0, append=record.samples)))
        excluded = np.ones(record.samples, dtype=bool)
        excluded[begins[longest] : ends[longest]] = False
        times = ", ".join(f"{index / record.sampling_rate_hz:.6g}" for index in breaks)
        observation = (
            f"both channels break off at {times} s and go on elsewhere, as where a recorder lost "
            "time; only the longest unbroken part is used"
        )
        reason = "the longest part without lost time"
        self._mask("both", excluded, "clock_suspect", observation, reason)


def _longest_runs(record: Record) -> tuple[int, ...]:
    """Return the longest runs of wild samples to look for, one after the other.

    In a shock a long run is wild only where the reference rests, a short one amidst the motion too.
    A sweep may fade in and out, which looks like a long run.
    """
    if record.reference is None or record.excitation not in (*LINEAR, "shock"):
        return (MAX_SHORT_RUN_SAMPLES,)
    if record.excitation == "shock":
        return MAX_RUN_SAMPLES, MAX_SHORT_RUN_SAMPLES
    steady = (MAX_LONG_RUN_SAMPLES,) if record.excitation in STEADY else ()
    return MAX_RUN_SAMPLES, *steady


def _has_longer_events(channels: Iterable[PredictedChannel]) -> bool:
    """Return whether an event is longer than the runs that are looked for at first."""
    return any(
        abs(event.end - event.first) > MAX_RUN_SAMPLES
        for channel in channels
        for event in channel.events
    )


def _is_in_stairs(record: Record, used: BoolArray) -> bool:
    """Return whether the used samples of the reference are in stairs."""
    return record.reference is not None and is_stairs(record.reference[used])


def _wild_observation(record: Record, label: str, is_wild: BoolArray) -> str:
    """Describe the wild samples of a channel for a finding."""
    begins, ends = runs_of_true(is_wild)
    longest = int(np.max(ends - begins))
    deviation = (
        "a single sample far off its neighbours"
        if longest == 1
        else f"up to {longest} samples far off those around them"
    )
    first_s = float(begins[0]) / record.sampling_rate_hz
    return (
        f"the {label} channel has {deviation} {_repetitions(begins.size)}at {first_s:.6g} s, "
        "as where a recorder or a contact fails"
    )


def _repetitions(count: int) -> str:
    """Return how often a finding occurs, for a sentence; empty for once."""
    return "" if count == 1 else f"{count} times, first "


def _find_wild_samples(
    record: Record, channels: Mapping[str, PredictedChannel]
) -> dict[str, BoolArray]:
    """Return the wild samples of each channel that has any.

    Where the other channel moves as oddly, the samples are motion, and so is a shock, where both
    channels are large. But in a motion that goes on, odd samples in both channels at once are wild
    where both go on as before: a sensor answers for longer. A run of more than two samples of a
    reference in stairs is a tread.
    """
    wild = {label: channel.wild.copy() for label, channel in channels.items()}
    if len(wild) == 2 and any(flags.any() for flags in wild.values()):
        # A tread of stairs may look wild, and beside wild samples anything looks like stairs.
        may_be_in_stairs = _is_in_stairs(record, record.reference_mask)
        is_in_stairs = _is_in_stairs(record, ~channels["reference"].wild)
        is_linear = record.excitation in LINEAR and not is_in_stairs
        predictions = PredictedResponse.all_from_channels(**channels)
        for label, other_channel in zip(wild, [*channels.values()][::-1], strict=True):
            if not wild[label].any():
                continue
            is_motion = find_motion(channels[label], other_channel, wild[label])
            for first, end in zip(*runs_of_true(wild[label]), strict=True):
                run = slice(first, end)
                is_shock = record.excitation == "shock" and any(
                    _is_shock(channels, wild, label, run, prediction.delay)
                    for prediction in predictions
                )
                may_be_motion = is_motion[run].any() and not (
                    is_linear and _is_wild_in_both(run, other_channel)
                )
                at_an_end = first == 0 or end == record.samples
                goes_on = end == record.samples and record.excitation in STATIONARY_EXCITATIONS
                is_prominent = channels[label].prominence(run) > MIN_END_PROMINENCE
                is_end_of_motion = at_an_end and not (is_linear and (goes_on or is_prominent))
                is_tread = (
                    label == "reference"
                    and may_be_in_stairs
                    and end - first > MAX_SHORT_RUN_SAMPLES
                )
                if (
                    is_shock
                    or is_tread
                    or may_be_motion
                    or is_end_of_motion
                    or not _is_denied(label, run, channels[label], predictions)
                ):
                    wild[label][run] = False
    return {label: flags for label, flags in wild.items() if flags.any()}


def _is_wild_in_both(run: slice, other_channel: PredictedChannel) -> bool:
    """Return whether wild samples may explain the other channel's events at the time of a run."""
    at_once = [
        event.may_be_wild
        for event in other_channel.events
        if event.first <= run.stop and run.start <= event.end
    ]
    return bool(at_once) and all(at_once)


def _is_denied(
    label: str,
    run: slice,
    channel: PredictedChannel,
    predictions: Sequence[PredictedResponse],
) -> bool:
    """Return whether a run holds wild samples that no motion explains, as all predictions say."""
    ends = (0, channel.valid.size)
    return any(
        (event.may_be_short_wild and event.first != ends[0] and event.end != ends[1])
        or all(prediction.denies(label, event) for prediction in predictions)
        for event in channel.events
        if event.wild and run.start <= event.first < run.stop
    )


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
    total = max(float(power.sum()), 0.5 * float(values @ values) * float(window @ window))
    above = float(power[int(ALIAS_BAND * power.shape[0]) :].sum())
    if above <= MIN_ALIAS_POWER * total:
        return []
    text = (
        f"{record.name}: {100 * above / total:.0f} % of the reference's power lies above 0.45 of "
        "the sampling rate, where no anti-alias filter leaves any; content above half the rate "
        "would look the same."
    )
    return [ScreeningFinding("aliasing", text)]
