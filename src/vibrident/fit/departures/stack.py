"""The groups that the score tests use: records of one length and rate, side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy import fft

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.departures.group import WhitenedGroup, harmonics_of
from vibrident.fit.departures.rows import orthonormal, rank_of, without
from vibrident.fit.departures.signals import BAND_OVER_HIGHEST, Signals, most_likely
from vibrident.fit.departures.sums import Errors
from vibrident.fit.noise.reading import DOUBT_DEVIATIONS
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.rounding import TRIALS
from vibrident.fit.response.transform import power_of
from vibrident.fit.uncertainty.steps import converter_steps, rounding_in_residual

#: Samples of the motion in time for each bin of the band: products of three signals alias behind
#: the motion alone.
OVERSAMPLING = 4.0 - 2.0 / BAND_OVER_HIGHEST

#: Relative change of the response by one u of each stated effect, shape (K, bins).
EffectsOf = Callable[[Signals], ComplexArray]


class _Stack(NamedTuple):
    """Signals of R records at K bins, side by side.

    Attributes:
        level: power of the noise, a sample, shape (R, K).
        counted: bins that count, shape (R, K).
        gain: of a bin that makes noise white, zero where it does not count, shape (R, K).
        predicted: response to the reference, shape (R, K).
        transfer: of the sensor, zero where a bin does not count, shape (R, K).
    """

    level: FloatArray
    counted: BoolArray
    gain: FloatArray
    predicted: ComplexArray
    transfer: ComplexArray

    @classmethod
    def from_signals(cls, signals: Sequence[Signals], bins_used: slice) -> _Stack:
        """Stack records of one length and rate at these bins."""
        level = np.stack([member.level[bins_used] for member in signals])
        counted = np.stack([member.counted[bins_used] for member in signals])
        gain = np.where(counted, np.sqrt(2.0 / signals[0].used.size / level), 0.0)
        predicted = np.stack([member.predicted[bins_used] for member in signals])
        transfer = np.where(
            counted,
            np.stack([member.transfer[bins_used] for member in signals]),
            0.0,
        )
        return cls(level, counted, gain, predicted, transfer)

    def whiten(self, columns: ComplexArray) -> FloatArray:
        """Return columns by bins, shape (R, m, K), as whitened rows, shape (R, m, 2 K)."""
        return np.ascontiguousarray(columns * self.gain[:, None]).view(float)

    def likely_motion(
        self, signals: Sequence[Signals], residual: FloatArray, bins_used: slice
    ) -> ComplexArray:
        """Return the response to the most likely motion, shape (R, K).

        ``residual``: whitened, free of what is no noise, shape (R, 2 K).
        """
        noise = np.divide(
            residual.view(complex),
            self.gain,
            out=np.zeros_like(self.predicted),
            where=self.gain > 0.0,
        )
        count = np.array([[float(member.used.sum())] for member in signals])
        share = self._share([member.spectrum.input_noise_at[bins_used] for member in signals])
        return most_likely(self.predicted, noise, share, self.level * count) * self.counted

    def input_share(self, signals: Sequence[Signals], bins_used: slice) -> FloatArray:
        """Return the part of the noise that may be the reference's (95 %), 0 … 1, shape (R, K)."""
        spectra = [member.spectrum for member in signals]
        largest = [(spectrum.input_noise_at + spectrum.doubt)[bins_used] for spectrum in spectra]
        return np.minimum(self._share(largest), 1.0)

    def _share(self, input_noise: Sequence[FloatArray]) -> FloatArray:
        """Return the part of the noise that noise of the reference makes, shape (R, K).

        ``input_noise``: σx² of each record, shape (K,).
        """
        return np.stack(input_noise) * power_of(self.transfer) / self.level


def group_of(
    signals: Sequence[Signals],
    numbers: Sequence[int],
    effects_of: EffectsOf,
    departing: ComplexArray | None = None,
) -> WhitenedGroup:
    """Return records of one length and rate side by side.

    Args:
        signals: of the records.
        numbers: of each record among those of the fit.
        effects_of: makes what stated effects do to a response.
        departing: columns of departures that are known, shape (R, m, K); None without any.
    """
    bins = max(member.last_bin for member in signals) if departing is None else departing.shape[2]
    bins_used = slice(1, bins + 1)
    stack = _Stack.from_signals(signals, bins_used)
    basis = orthonormal(
        stack.whiten(_pad_columns([member.nuisance[:, bins_used] for member in signals]))
    )
    residual = without(
        stack.whiten(np.stack([member.residual[None, bins_used] for member in signals])),
        basis,
    )
    noise = residual
    if departing is not None:
        noise = without(residual, orthonormal(without(stack.whiten(departing), basis)))
    likely = stack.likely_motion(signals, noise[:, 0], bins_used)
    slopes = np.stack([member.jacobian[:, bins_used] for member in signals])
    pull = _pull_of(signals)
    used = np.stack([member.used for member in signals])
    turns = np.array([np.nan if member.turns is None else member.turns for member in signals])
    harmonics = np.zeros((len(signals), 0, 2, bins), dtype=complex)
    if not np.isnan(turns).any():
        harmonics = harmonics_of(turns, used, bins)
    tone = None
    if pull is None:
        jacobian = without(stack.whiten(slopes * (likely != 0.0)[:, None]), basis)
    else:  # the points of the sine hold what its tone says
        jacobian = np.zeros((len(signals), pull.shape[1], 2 * bins))
        tone = without(stack.whiten(slopes), basis)
    counts = np.array(
        [np.sum(member.one_sided[bins_used]) * member.used.mean() for member in signals]
    )

    def errors_of(places: Sequence[int]) -> Errors:
        chosen = [signals[place] for place in places]
        return _errors(chosen, effects_of, likely[places], stack.gain[places])

    def again(columns: ComplexArray) -> WhitenedGroup:
        signals_beside = [
            member.in_noise_beside(departing_columns)
            for member, departing_columns in zip(signals, columns, strict=True)
        ]
        return group_of(signals_beside, numbers, effects_of, columns)

    return WhitenedGroup(
        records=tuple(member.record for member in signals),
        numbers=np.array(numbers),
        begin_s=np.array(
            [member.span.start / member.record.sampling_rate_hz for member in signals]
        ),
        used=used,
        turns=turns,
        harmonics=harmonics,
        predicted=stack.predicted,
        likely=likely,
        motion=_motion_in_time(signals, likely, bins_used.stop),
        input_share=stack.input_share(signals, bins_used),
        transfer=stack.transfer,
        slopes=slopes,
        gain=stack.gain,
        basis=basis,
        residual=residual[:, 0],
        jacobian=jacobian,
        tone=tone,
        pull=pull,
        freedom=counts - rank_of(basis),
        errors_of=errors_of,
        again=again,
    )


def _pull_of(signals: Sequence[Signals]) -> FloatArray | None:
    """Return the shift of the fit's coordinates by those of each record, shape (R, P, p).

    It is None where these are the same.
    """
    if signals[0].pull is None:
        return None
    return np.stack([member.pull for member in signals if member.pull is not None])


def _pad_columns(columns: Sequence[ComplexArray]) -> ComplexArray:
    """Return the columns of records, padded by zeros, shape (R, m, K)."""
    count = max(len(record_columns) for record_columns in columns)
    padded = np.zeros((len(columns), count, columns[0].shape[1]), dtype=complex)
    for row, record_columns in zip(padded, columns, strict=True):
        row[: len(record_columns)] = record_columns
    return padded


def _motion_in_time(signals: Sequence[Signals], likely: ComplexArray, stop: int) -> FloatArray:
    """Return the response to the most likely motion in time, free motion included, shape (R, L).

    A response that recurs with the record rings at its ends, where it jumps; what a departure makes
    of that ringing is no nuisance parameter's.
    """
    samples = signals[0].used.size
    step = max(int(samples / (OVERSAMPLING * stop)), 1)
    while samples % step:
        step -= 1
    used = np.stack([record_signals.used for record_signals in signals])
    predicted = np.stack([record_signals.predicted for record_signals in signals])
    predicted[:, 0] = 0.0
    free_motion = np.where(
        used,
        np.stack([record_signals.series for record_signals in signals])
        - fft.irfft(predicted, samples, axis=1),
        0.0,
    )
    free_motion -= np.sum(free_motion, axis=1, keepdims=True) / np.maximum(
        used.sum(axis=1, keepdims=True), 1
    )
    padded = np.zeros((len(signals), likely.shape[1] + 1), dtype=complex)
    padded[:, 1:] = likely
    recurring = fft.irfft(padded, samples // step, axis=1) / step
    return np.asarray(recurring + np.where(used, free_motion, 0.0)[:, ::step])


def _errors(
    signals: Sequence[Signals], effects_of: EffectsOf, likely: ComplexArray, gain: FloatArray
) -> Errors:
    """Return whitened errors of known covariance.

    Args:
        signals: of the records.
        effects_of: makes what stated effects do to a response.
        likely: response to the most likely motion, shape (R, K).
        gain: that makes noise white, shape (R, K).
    """
    errors_by_record = [
        _errors_of_record(record_signals, effects_of(record_signals), *likely_and_gain)
        for record_signals, *likely_and_gain in zip(signals, likely, gain, strict=True)
    ]
    return Errors(*(np.stack(arrays) for arrays in zip(*errors_by_record, strict=True)))


def _errors_of_record(
    signals: Signals, effects: ComplexArray, likely: ComplexArray, gain: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a record's errors: of converters, of effects, and doubt of the reference's noise.

    They are as in :class:`Errors`.
    """
    samples = signals.used.size
    counted = signals.counted
    bins_used = slice(1, gain.size + 1)

    def whiten(columns: ComplexArray) -> FloatArray:
        return np.ascontiguousarray(columns * gain).view(float)

    transfer = np.where(counted, signals.transfer, 0.0)
    doubt = signals.spectrum.doubt * power_of(transfer) / (DOUBT_DEVIATIONS * signals.level)
    doubt = np.minimum(doubt, 1.0)[bins_used]
    # An error ε of σx² leaves ε H* R/S of the residual R in the most likely motion: a departure
    # D = L Ŷ then has Σ L* ε |R|²/S with it, as much as with the signal ε |R|²/(S Ŷ*).
    doubtful_motion = doubt * power_of(signals.residual[bins_used])
    doubtful_motion = np.divide(
        doubtful_motion, np.conj(likely), out=np.zeros_like(likely), where=likely != 0.0
    )
    noise_level = float(np.median(signals.level[counted])) if counted.any() else 0.0
    recurring = signals.predicted.copy()
    recurring[0] = 0.0
    predicted = np.asarray(fft.irfft(recurring, samples))
    steps = converter_steps(signals.record, band_limited=signals.is_band_limited)
    errors = rounding_in_residual(
        signals.record,
        signals.span,
        predicted,
        signals.used,
        steps,
        noise_level,
        transfer,
        signals.turns,
    )
    rounding = np.zeros((2 * TRIALS, 2 * gain.size))
    if errors is not None:
        rounding = whiten(np.asarray(fft.rfft(errors * signals.used, axis=-1))[:, bins_used])
    return (
        rounding,
        whiten(np.concatenate([effects[:, bins_used] * likely, doubtful_motion[None]])),
        doubt,
    )
