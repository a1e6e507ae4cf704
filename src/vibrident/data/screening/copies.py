"""Find records that hold the same samples under two names: they would count twice."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from vibrident.data.records import Calibration, FloatArray, Record

#: Begins the line of a record's history that names its copies.
COUNTED_ONCE = "counted once: the same samples as in "
#: Two forms of one number differ by less than this share of the range, as seven digits are written;
#: no channel is so quiet.
_MAX_FORMAT_ERROR = 5e-7
#: A coarser form (16 bit, few decimals) leaves rounding errors below this share of the range …
_MAX_ROUNDING_ERROR = 1e-3
#: … within half a step, so that their peak is at most √3 times their rms: noise has tails …
_MAX_PEAK_TO_RMS = 2.0
#: … and of many different sizes relative to the number of samples: steps of one converter have few.
_MIN_SHARE_OF_SIZES = 0.25
#: Samples of each record by which possible copies are found.
_PROBES = 64
#: Fewest samples by which rounding errors are told from other differences.
_MIN_SAMPLES = 200


def without_copies(records: Sequence[Record]) -> tuple[Record, ...]:
    """Return each record once, with the names of its copies in its history.

    A copy has the same excitation, rate and number of samples, and the same values but for rounding
    (another format, fewer digits). Names, files and the time of the first sample do not matter.
    Repeated measurements differ in noise and are not copies.
    """
    groups: dict[tuple[object, ...], list[int]] = {}
    for index, record in enumerate(records):
        key = (record.samples, record.sampling_rate_hz, record.excitation, record.reference is None)
        groups.setdefault(key, []).append(index)
    first_of = {copy: first for group in groups.values() for copy, first in _copies(records, group)}
    unique_records = {
        index: record for index, record in enumerate(records) if index not in first_of
    }
    for copy, first in sorted(first_of.items()):
        step = f"{COUNTED_ONCE}{records[copy].name}, which is left out"
        unique_records[first] = dataclasses.replace(
            unique_records[first], provenance=unique_records[first].provenance.then(step)
        )
    return tuple(unique_records.values())


def share_data(first: Calibration, second: Calibration) -> bool:
    """Return whether two calibrations hold the same record, or the same table."""
    if first.table is not None and second.table is not None:
        pairs = (
            (getattr(first.table, name), getattr(second.table, name))
            for name in ("frequency_hz", "magnitude")
        )
        return all(np.array_equal(values, compared) for values, compared in pairs)
    records = [*without_copies(first.records), *without_copies(second.records)]
    return len(without_copies(records)) < len(records)


def _copies(records: Sequence[Record], group: Sequence[int]) -> list[tuple[int, int]]:
    """Return pairs of a copy and its original among records of one length, as indices.

    Records are compared only if their means over a few samples nearly agree.
    """
    if len(group) == 1:
        return []
    probe_index = np.linspace(0, records[group[0]].samples - 1, _PROBES).astype(int)
    probes = np.array([records[index].response[probe_index] for index in group])
    allowed = np.array([_MAX_ROUNDING_ERROR * np.ptp(records[index].response) for index in group])
    means = probes.mean(axis=1)
    order = np.argsort(means, kind="stable")
    low, high = (
        np.searchsorted(means[order], means + side * 1.01 * allowed) for side in (-1.0, 1.0)
    )
    copies: dict[int, int] = {}
    for number, index in enumerate(group):
        candidates = order[low[number] : high[number] + 1]
        candidates = candidates[
            (candidates < number)
            & np.all(
                np.abs(probes[candidates] - probes[number]) <= allowed[candidates, None], axis=1
            )
        ]
        originals = (
            group[earlier] for earlier in np.sort(candidates) if group[earlier] not in copies
        )
        first = next(
            (first for first in originals if _is_copy(records[first], records[index])), None
        )
        if first is not None:
            copies[index] = first
    return list(copies.items())


def notes_of_copies(histories: Iterable[tuple[str, Sequence[str]]]) -> list[str]:
    """Return a sentence for each record that was left out as a copy.

    Args:
        histories: names and histories of the other records.
    """
    return [
        f"Note: {step.removeprefix(COUNTED_ONCE).partition(', which')[0]} holds the same samples "
        f"as {name} and is left out: a copy would count twice."
        for name, history in histories
        for step in history
        if step.startswith(COUNTED_ONCE)
    ]


def _is_copy(first: Record, second: Record) -> bool:
    pairs = [(first.response, second.response)]
    if first.reference is not None and second.reference is not None:
        pairs.append((first.reference, second.reference))
    return all(_same_values(first_values, second_values) for first_values, second_values in pairs)


def _same_values(first: FloatArray, second: FloatArray) -> bool:
    span = float(np.ptp(first))
    if span == 0.0:
        return False  # a channel without signal is another matter
    difference = np.abs(first - second)
    largest = float(np.max(difference))
    if largest <= _MAX_FORMAT_ERROR * span:
        return True
    if largest > _MAX_ROUNDING_ERROR * span or first.size < _MIN_SAMPLES:
        return False
    peak = largest / float(np.sqrt(np.mean(difference**2)))
    sizes = np.unique(np.round(difference / largest, 6)).size
    return peak < _MAX_PEAK_TO_RMS and sizes > _MIN_SHARE_OF_SIZES * first.size
