"""The test of adequacy: does the model explain the data within their uncertainty?

With n complex points and p parameters, Σ |Y − H X|²/σ² is χ² with 2 n − p degrees of freedom when
the model is right. For records the points are the factors of bands
(:mod:`vibrident.fit.uncertainty.factors`). The model is rejected below a probability of 10⁻³.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from vibrident.base.tails import f_tail
from vibrident.data.records import FloatArray, Record
from vibrident.fit.descent.weighted_bins import Transfer
from vibrident.fit.response.response import ComplexArray, MeasuredResponse
from vibrident.fit.response.verdict import REJECTION, as_chi2, chance_of, shrunk
from vibrident.fit.uncertainty.factors import Factors

if TYPE_CHECKING:
    from vibrident.fit.decay.deviations import DecayDeviation


@dataclass(frozen=True, eq=False)
class Adequacy:
    """The points where measurement and model are compared, and the verdict."""

    frequency_hz: FloatArray  # shape (n,)
    measured: ComplexArray  # measured complex sensitivity, shape (n,)
    relative_deviation: FloatArray  # standard deviation of its real part over its size, shape (n,)
    record: tuple[str, ...]  # name of the record of each point
    chi2_reduced: float | None  # None where nothing is known of the points' uncertainty
    degrees_of_freedom: int  # 2 n − p (n − p for magnitudes)
    adequate: bool  # the verdict
    #: Of the measured phase, rad, shape (n,); None: the relative deviation.
    phase_deviation: FloatArray | None = None
    chance: float = 1.0  # that a right model deviates as much
    decays: float = 0.0  # χ² of the free decays among the records

    @property
    def as_data(self) -> tuple[Any, ...]:
        """Return the points as the data of a :class:`FrequencyProblem` with a reference of one."""
        size = np.abs(self.measured)
        return (
            self.frequency_hz,
            np.ones(len(size), complex),
            self.measured,
            self.relative_deviation * size,
        )

    @property
    def birge(self) -> float:
        """Return √(χ²/ν), at least one: the factor on u that the deviations demand (Birge 1932)."""
        return float(np.sqrt(max(self.chi2_reduced or 0.0, 1.0)))


@dataclass(frozen=True, eq=False)
class Points:
    """Deviations of n points from the model; arrays have shape (n,)."""

    frequency_hz: FloatArray
    measured: ComplexArray  # complex sensitivity
    relative_deviation: FloatArray  # standard deviation of its real part over its size
    record: tuple[str, ...]  # name of the record of each point
    squares: FloatArray  # of the deviation's two real parts over their noise
    freedom: FloatArray  # degrees of freedom of the noise
    #: Variance over that by noise of one level, at most one; None for noise of one level.
    unweighted: FloatArray | None = None


def tone_points(tones: MeasuredResponse, response: Transfer, names: Sequence[str]) -> Points:
    """Return the points of sine records.

    ``response``: the model's complex sensitivity over frequency; ``names``: of the records, by
    index.
    """
    deviation = tones.error_deviation(response)
    squares = (
        np.abs(tones.response - response(tones.frequency_hz) * tones.reference) ** 2 / deviation**2
    )
    relative = deviation / np.maximum(np.abs(tones.response), np.finfo(float).tiny)
    record_names = tuple(names[int(i)] for i in tones.record)
    return Points(
        tones.frequency_hz, tones.ratio, relative, record_names, squares, tones.degrees_of_freedom
    )


def factor_points(factors: Factors, record: Record, samples: int, response: Transfer) -> Points:
    """Return a record's points from the factors of its bands.

    ``samples``: number of samples whose transform has the bins that the factors' places count.
    """
    frequency = factors.place * (record.sampling_rate_hz / samples)
    return Points(
        frequency,
        response(frequency) * (1.0 + factors.rho),
        factors.deviation / np.abs(1.0 + factors.rho),
        (record.name,) * len(frequency),
        factors.squares,
        factors.freedom,
        factors.unweighted,
    )


def assess(
    groups: Sequence[Points], parameters: int, decays: Sequence[DecayDeviation] = ()
) -> Adequacy:
    """Join points and free decays and judge the model by them.

    Without points, or with too few for its parameters, the model cannot be tested.
    """
    if not groups:
        return Adequacy(np.zeros(0), np.zeros(0, complex), np.zeros(0), (), None, 0, adequate=False)
    squares = np.concatenate([p.squares for p in groups])
    freedom = np.concatenate([p.freedom for p in groups])
    decay_chi2 = sum(decay.parts.chi2 for decay in decays)
    chi2 = float(squares @ shrunk(freedom)) + decay_chi2
    degrees = 2 * len(squares) - parameters + sum(decay.parts.degrees for decay in decays)
    chance = chance_of(as_chi2(squares, freedom), degrees, decay_chi2)
    return Adequacy(
        np.concatenate([p.frequency_hz for p in groups]),
        np.concatenate([p.measured for p in groups]),
        np.concatenate([p.relative_deviation for p in groups]),
        tuple(name for p in groups for name in p.record),
        chi2 / degrees if degrees > 0 else None,
        degrees,
        degrees > 0 and chance >= REJECTION,
        chance=chance,
        decays=decay_chi2,
    )


def looks_random(residual: FloatArray) -> bool:
    """Return whether residuals in order of frequency scatter without pattern.

    It is the test where no uncertainty was stated. Random residuals seem to follow a polynomial
    with a probability of 1e-5, and exceed four standard deviations of the lag-one correlation with
    one of 3e-5.
    """
    count = len(residual)
    power = float(np.sum(residual**2))
    if count < 8 or power == 0.0:
        return True
    lagged = float(np.sum(residual[1:] * residual[:-1])) / power
    # For few points an F test with a short polynomial has more power than that correlation.
    terms = min(6, count // 4)
    basis, _ = np.linalg.qr(
        np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, count), terms - 1)
    )
    smooth = float(np.sum((basis.T @ residual) ** 2))
    remainder = max(power - smooth, np.finfo(float).eps * power)
    pattern = f_tail(terms, count - terms, smooth / terms / (remainder / (count - terms))) < 1e-5
    return lagged * np.sqrt(count) < 4.0 and not pattern
