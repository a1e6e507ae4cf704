"""Find the same samples under two names: they would count twice, although their noise is not independent."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from vibrident.data.records import FloatArray, Record

#: Begins the line of a record's history that names its copies.
COUNTED_ONCE = "counted once: the same samples as in "
#: Two forms of one number differ by less, as a part of the range: seven digits were kept. No channel is so quiet.
_ROUNDING = 5e-7
#: A coarser form (16 bit, few decimals) leaves rounding errors of less than this part of the range …
_MOST_ERROR = 1e-3
#: … within half a step, so no larger than √3 of their rms: noise has tails …
_MOST_PEAK = 2.0
#: … and of as many sizes as there are samples: steps of one converter have few sizes.
_LEAST_SIZES = 0.25
#: Fewest samples that tell so.
_FEWEST_SAMPLES = 200


def without_copies(records: Sequence[Record]) -> tuple[Record, ...]:
    """Return each record once, with the names of its copies in its history.

    A copy has the same excitation, rate and number of samples, and the same values but for rounding (another format,
    fewer digits). Names, files and the time of the first sample do not matter. Repeated measurements differ in noise
    and are not copies.
    """
    kept: list[Record] = []
    groups: dict[tuple[object, ...], list[int]] = {}
    for record in records:
        key = (record.samples, record.sampling_rate_hz, record.excitation, record.reference is None)
        same = groups.setdefault(key, [])
        found = next((place for place in same if _is_copy(kept[place], record)), None)
        if found is None:
            same.append(len(kept))
            kept.append(record)
        else:
            first = kept[found]
            history = first.provenance.then(f"{COUNTED_ONCE}{record.name}, which is left out")
            kept[found] = dataclasses.replace(first, provenance=history)
    return tuple(kept)


def said_of_copies(histories: Iterable[tuple[str, Sequence[str]]]) -> list[str]:
    """A sentence for each record that was left out, from names and histories of the others."""
    return [
        f"Note: {step.removeprefix(COUNTED_ONCE).partition(', which')[0]} holds the same samples as {name} and is left "
        "out: a copy would count twice."
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
    if span == 0.0 or not abs(one[0] - other[0]) <= _MOST_ERROR * span:
        return False  # the first sample tells most of them apart; a channel without signal is another matter
    difference = np.abs(one - other)
    largest = float(np.max(difference))
    if largest <= _ROUNDING * span:
        return True
    if largest > _MOST_ERROR * span or one.size < _FEWEST_SAMPLES:
        return False
    peak = largest / float(np.sqrt(np.mean(difference**2)))
    sizes = np.unique(np.round(difference / largest, 6)).size
    return peak < _MOST_PEAK and sizes > _LEAST_SIZES * one.size
