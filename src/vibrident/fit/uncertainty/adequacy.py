"""Does the model explain the data? Deviations at the excited frequencies against their uncertainty.

With n complex points and p parameters, Σ |Y − H X|²/σ² is χ² with 2 n − p degrees of freedom when the model is
right. For motion that is not a sine the points are narrow bands: the part of the time residual that is coherent
with the predicted response, against the part that is not. The model is rejected below a probability of 10⁻³.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from vibrident.base.fft_lengths import fast_below
from vibrident.base.tails import f_tail
from vibrident.data.records import FloatArray, Record
from vibrident.data.records.basis import span_of
from vibrident.fit.response.alignment import MOST_CUT
from vibrident.fit.response.remainder import coherent_remainder
from vibrident.fit.response.response import ComplexArray, MeasuredResponse
from vibrident.fit.response.rounding import rounding_variance
from vibrident.fit.response.transform import line_frequencies, reference_colour
from vibrident.fit.response.verdict import REJECTION, as_chi2, chance_of, shrunk

if TYPE_CHECKING:
    from vibrident.fit.decay.beside import DecayDeviation


@dataclass(frozen=True, eq=False)
class Adequacy:
    """Points to compare, and the verdict."""

    frequency_hz: FloatArray  # shape (n,)
    measured: ComplexArray  # measured complex sensitivity, shape (n,)
    relative_deviation: FloatArray  # standard deviation of its real part over its size, shape (n,)
    record: tuple[str, ...]  # name of the record of each point
    chi2_reduced: float | None  # None where nothing is known of the points' uncertainty
    degrees_of_freedom: int  # 2 n − p (n − p for magnitudes)
    adequate: bool  # the verdict
    phase_deviation: FloatArray | None = None  # of the measured phase, rad, shape (n,); None: the relative deviation
    chance: float = 1.0  # that a right model deviates as much
    decays: float = 0.0  # χ² of the free decays among the records

    @property
    def as_data(self) -> tuple[Any, ...]:
        """The points as the data of a :class:`FrequencyProblem`, with a reference of one."""
        size = np.abs(self.measured)
        return self.frequency_hz, np.ones(len(size), complex), self.measured, self.relative_deviation * size

    @property
    def birge(self) -> float:
        """√(χ²/ν), at least one: the factor on the uncertainties that the deviations demand (Birge 1932)."""
        return float(np.sqrt(max(self.chi2_reduced or 0.0, 1.0)))


@dataclass(frozen=True, eq=False)
class Points:
    """Squared weighted deviations at n points, of two real parts each, over a noise estimate of ``freedom``."""

    frequency_hz: FloatArray
    measured: ComplexArray
    relative_deviation: FloatArray
    record: tuple[str, ...]
    squares: FloatArray
    freedom: FloatArray


def tone_points(
    tones: MeasuredResponse, response: Callable[[FloatArray], ComplexArray], names: Sequence[str]
) -> Points:
    """Points of sine records with these names; ``response``: the model's complex sensitivity over frequency."""
    deviation = tones.error_deviation(response)
    error = np.abs(tones.response - response(tones.frequency_hz) * tones.reference) ** 2 / deviation**2
    relative = deviation / np.maximum(np.abs(tones.response), np.finfo(float).tiny)
    owners = tuple(names[int(i)] for i in tones.record)
    return Points(tones.frequency_hz, tones.ratio, relative, owners, error, tones.degrees_of_freedom)


def band_points(
    whole: Record,
    prediction: FloatArray,
    response: Callable[[FloatArray], ComplexArray],
    reference_noise: float = 0.0,
    hum_hz: Sequence[float] = (),
) -> Points | None:
    """Points of a record that is no sine: what of the residual is coherent with the prediction, band by band.

    ``prediction``: predicted response, NaN where it is not defined; ``response``: the model's complex sensitivity over
    frequency; ``reference_noise``: standard deviation of the noise of the reference channel itself; ``hum_hz``: tones
    of the response that do not come from the motion. None where no band holds enough of the response.
    """
    record, series = _where_used(whole, prediction)

    def gain_squares() -> FloatArray:
        return np.abs(response(line_frequencies(record.samples, record.sampling_rate_hz))) ** 2

    through = None
    if reference_noise > 0.0:
        through = reference_noise**2 * reference_colour(record, record.samples) * gain_squares()
    found = coherent_remainder(record, series, through, hum_hz, rounding_variance(record, gain_squares))
    if found is None:
        return None
    frequency, remainder, deviation, freedom = found
    squares = np.abs(remainder) ** 2 / deviation**2
    relative = deviation / np.abs(1.0 + remainder)
    names = (record.name,) * len(frequency)
    return Points(frequency, response(frequency) * (1.0 + remainder), relative, names, squares, freedom)


def _where_used(record: Record, predicted: FloatArray) -> tuple[Record, FloatArray]:
    """From the first sample that counts to the last, where these are a part of the record.

    Lines of a record of which only a part is used are alike, and tell less of the noise than their number.
    """
    assert record.reference is not None
    whole = span_of(record.mask & np.isfinite(predicted))
    samples = whole.stop - whole.start
    if not 0 < samples <= 0.9 * record.samples:  # then lines next to each other have a correlation of sinc 0.9 = 0.1
        return record, predicted
    span = slice(whole.start, whole.start + fast_below(samples, MOST_CUT))
    kept = replace(
        record,
        reference=record.reference[span],
        response=record.response[span],
        valid=record.mask[span],
        reference_valid=record.reference_mask[span],
    )
    return kept, predicted[span]


def assess(parts: Sequence[Points], parameters: int, decays: Sequence[DecayDeviation] = ()) -> Adequacy:
    """Join points and free decays and judge.

    Without points, or with no more of them than parameters, the model cannot be tested.
    """
    if not parts:
        return Adequacy(np.zeros(0), np.zeros(0, complex), np.zeros(0), (), None, 0, adequate=False)
    squares = np.concatenate([p.squares for p in parts])
    freedom = np.concatenate([p.freedom for p in parts])
    free = sum(decay.parts.chi2 for decay in decays)
    chi2 = float(squares @ shrunk(freedom)) + free
    degrees = 2 * len(squares) - parameters + sum(decay.parts.degrees for decay in decays)
    chance = chance_of(as_chi2(squares, freedom), degrees, free)
    return Adequacy(
        np.concatenate([p.frequency_hz for p in parts]),
        np.concatenate([p.measured for p in parts]),
        np.concatenate([p.relative_deviation for p in parts]),
        tuple(name for p in parts for name in p.record),
        chi2 / degrees if degrees > 0 else None,
        degrees,
        degrees > 0 and chance >= REJECTION,
        chance=chance,
        decays=free,
    )


def looks_random(residual: FloatArray) -> bool:
    """Whether residuals in order of frequency scatter without pattern, where no uncertainty was stated.

    Random ones are taken to follow a polynomial with a probability of 1e-5; their lag-one correlation exceeds four
    standard deviations with one of 3e-5.
    """
    n = len(residual)
    power = float(np.sum(residual**2))
    if n < 8 or power == 0.0:
        return True
    lagged = float(np.sum(residual[1:] * residual[:-1])) / power
    # With few points that correlation has little power; an F test with a short polynomial has more.
    terms = min(6, n // 4)
    basis, _ = np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, n), terms - 1))
    smooth = float(np.sum((basis.T @ residual) ** 2))
    rest = max(power - smooth, np.finfo(float).eps * power)
    pattern = f_tail(terms, n - terms, smooth / terms / (rest / (n - terms))) < 1e-5
    return lagged * np.sqrt(n) < 4.0 and not pattern
