"""The delay between the channels, estimated before any model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibrident.data.records import BoolArray
from vibrident.fit.group.group import Group
from vibrident.fit.noise.averages import windowed
from vibrident.fit.problem.band import Band
from vibrident.fit.response.phase_delay import Phases, agreed_delay


def rough_delay(band: Band, heard: Sequence[BoolArray], high: float) -> float:
    """Return the delay at which the phases between the channels agree best, s.

    Args:
        band: the segments.
        heard: bins that count, of each group, shape (R, K).
        high: highest frequency of the motion, Hz.
    """
    longest = max(group.grid.samples / group.grid.rate_hz for group in band.groups)
    by_group = [_phases(*rows) for rows in zip(band.groups, heard, strict=True)]
    phases = Phases(*(np.concatenate(arrays) for arrays in zip(*by_group, strict=True)))
    return agreed_delay(phases, longest, high)


def _phases(group: Group, heard: BoolArray) -> Phases:
    """Return the phases between the channels of a group at the bins that count."""
    counts = heard[:, 1:-1]
    reference = group.inputs[:, 0]
    difference = (reference[:, :-2] - reference[:, 2:])[counts] * (0.5 / np.sqrt(0.375))
    frequency_hz = np.broadcast_to(group.grid.frequency_hz[1:-1], counts.shape)
    return Phases.between(
        (windowed(reference)[counts], difference),
        windowed(group.response)[counts],
        frequency_hz[counts],
        group.grid.rate_hz / group.grid.samples,
    )
