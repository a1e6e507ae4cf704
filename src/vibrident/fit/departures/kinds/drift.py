"""A zero that drifts: Legendre polynomials of time up to the fifth degree."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy import fft

from vibrident.base.amounts import plain
from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import FloatArray, Record
from vibrident.fit.departures.departure import Candidate, Scale, WithoutMotion
from vibrident.fit.departures.group import WhitenedGroup
from vibrident.fit.departures.score import Score
from vibrident.fit.response.response import ComplexArray

#: Highest degree of the polynomials.
MAX_DEGREE = 5
#: Turns over the record of the nuisance tone.
NUISANCE_TURNS = 0.5


class Drift(WithoutMotion):
    """A smooth curve that the motion does not explain."""

    name: ClassVar[str] = "drift"
    code: ClassVar[WarningCode] = "drift"
    pooled: ClassVar[bool] = False
    within: ClassVar[bool] = True
    together: ClassVar[bool] = True
    nuisance: ClassVar[bool] = True

    def columns(self, group: WhitenedGroup, scale: Scale) -> Iterable[tuple[str, ComplexArray]]:
        """Yield the polynomials, as large as the largest motion.

        They are zero for records with the nuisance tone.
        """
        bins = (
            _bins_of_polynomials(group.samples)[None, :, 1 : group.bins + 1]
            if group.used.all()
            else group.bins_of(_polynomials(group.samples)[None])
        )
        has_drift = [_slow_hz(record) not in record.hum_hz for record in group.records]
        yield "", scale.motion * np.array(has_drift)[:, None, None] * bins

    def with_nuisances(self, record: Record) -> Record:
        """Return the record with a slow tone whose size changes with time as a nuisance parameter.

        The tone makes half a turn over the record. With offset and leakage it stands for all smooth
        curves.
        """
        slow_hz = _slow_hz(record)
        return (
            record
            if slow_hz in record.hum_hz
            else replace(record, hum_hz=(slow_hz, *record.hum_hz))
        )

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """Return how far the response drifts."""
        size = 100.0 * max(abs(score.known(column)) for column in range(len(score.amounts)))
        amount = f" by about {plain(size, 2)} % of its largest" if size else ""
        return f"the response drifts{amount}, which the motion does not explain"


def _slow_hz(record: Record) -> float:
    """Return the frequency of the nuisance tone."""
    return NUISANCE_TURNS / record.duration_s


@functools.lru_cache(maxsize=2)
def _bins_of_polynomials(samples: int) -> ComplexArray:
    """Return the transforms of the polynomials where all samples are used."""
    return np.asarray(fft.rfft(_polynomials(samples), axis=1), dtype=complex)


@functools.lru_cache(maxsize=2)
def _polynomials(samples: int) -> FloatArray:
    """Return Legendre polynomials of time, shape (degree, samples), without the constant."""
    time = np.linspace(-1.0, 1.0, samples)
    return np.ascontiguousarray(
        np.polynomial.legendre.legvander(time, MAX_DEGREE).T[1:], dtype=float
    )


DRIFT = Drift()
