"""Find the same samples under two names: they would count twice, although their noise is not independent."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from vibrident.data.records import FloatArray, Record

#: Begins the line of a record's history that names its copies.
COUNTED_ONCE = "counted once: the same samples as in "
#: Two forms of one number differ by less, as a part of the range: seven digits were kept. No
#: channel is so quiet.
_ROUNDING = 5e-7
#: A coarser form (16 bit, few decimals) leaves rounding errors of less than this part of the range
#: …
_MOST_ERROR = 1e-3
#: … within half a step, so no larger than √3 of their rms: noise has tails …
_MOST_PEAK = 2.0
#: … and of as many sizes as there are samples: steps of one converter have few sizes.
_LEAST_SIZES = 0.25
#: Samples by which records are found that may be copies.
_SEEN = 64
#: Fewest samples that tell so.
_FEWEST_SAMPLES = 200


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
    kept = {index: record for index, record in enumerate(records) if index not in first_of}
    for copy, first in sorted(first_of.items()):
        step = f"{COUNTED_ONCE}{records[copy].name}, which is left out"
        kept[first] = dataclasses.replace(kept[first], provenance=kept[first].provenance.then(step))
    return tuple(kept.values())


def _copies(records: Sequence[Record], group: Sequence[int]) -> list[tuple[int, int]]:
    """Return each copy among some records of one length, and the record that it is one of.

    Only those are compared whose mean over a few samples is nearly the same.
    """
    if len(group) == 1:
        return []
    places = np.linspace(0, records[group[0]].samples - 1, _SEEN).astype(int)
    seen = np.array([records[index].response[places] for index in group])
    allowed = np.array([_MOST_ERROR * np.ptp(records[index].response) for index in group])
    means = seen.mean(axis=1)
    order = np.argsort(means, kind="stable")
    low, high = (
        np.searchsorted(means[order], means + side * 1.01 * allowed) for side in (-1.0, 1.0)
    )
    copies: dict[int, int] = {}
    for place, index in enumerate(group):
        near = order[low[place] : high[place] + 1]
        near = near[
            (near < place) & np.all(np.abs(seen[near] - seen[place]) <= allowed[near, None], axis=1)
        ]
        firsts = (group[other] for other in np.sort(near) if group[other] not in copies)
        first = next((first for first in firsts if _is_copy(records[first], records[index])), None)
        if first is not None:
            copies[index] = first
    return list(copies.items())


def said_of_copies(histories: Iterable[tuple[str, Sequence[str]]]) -> list[str]:
    """A sentence for each record that was left out, from names and histories of the others."""
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
    return all(_same(one, other) for one, other in pairs)


def _same(one: FloatArray, other: FloatArray) -> bool:
    span = float(np.ptp(one))
    if span == 0.0:
        return False  # a channel without signal is another matter
    difference = np.abs(one - other)
    largest = float(np.max(difference))
    if largest <= _ROUNDING * span:
        return True
    if largest > _MOST_ERROR * span or one.size < _FEWEST_SAMPLES:
        return False
    peak = largest / float(np.sqrt(np.mean(difference**2)))
    sizes = np.unique(np.round(difference / largest, 6)).size
    return peak < _MOST_PEAK and sizes > _LEAST_SIZES * one.size
