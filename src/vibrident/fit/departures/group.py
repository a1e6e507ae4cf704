"""Records of one length and rate at the estimate, side by side, at the bins of their band.

Everything above the band (one and a half times the highest frequency of the motion, and the
harmonics of a tone) is left out. Whitened rows hold real and imaginary parts of the bins in turn,
shape (…, 2 K), so that their products are those of white samples. In time, the band alone is a
record at a lower rate.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy import fft
from numpy.typing import NDArray

from vibrident.base.fft_lengths import fast_length
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.fit.bins.exponentials import wave_bins
from vibrident.fit.departures.rows import LOST, in_time, orthonormal, rank_of, without
from vibrident.fit.departures.sums import MIN_UNFOLLOWED, Errors, ExactSums, RecordInformation, Sums
from vibrident.fit.information import inverse_where_shown
from vibrident.fit.response.response import MIN_RELATIVE_DEVIATION, ComplexArray
from vibrident.fit.response.tones import HARMONICS
from vibrident.physics.discretisation.inputs import USABLE_BAND

#: Blocks of a record in time, between which it may change.
BLOCKS = 32
#: Stretches of a record over which its noise may change.
MAX_STRETCHES = 16
MIN_STRETCH_SAMPLES = 128


@dataclass(frozen=True, eq=False)
class WhitenedGroup:
    """R records, or pieces of long ones, at K bins.

    Signals are by their bins, in the unit of the response; whitened rows are free of the nuisance
    columns.

    Attributes:
        records: the records.
        numbers: of the records among those of the fit, shape (R,).
        begin_s: time of the first sample, shape (R,).
        used: samples that count, shape (R, n).
        turns: of a sine from sample to sample, NaN for other motion, shape (R,).
        harmonics: cosine and sine of the harmonics of each tone, shape (R, orders, 2, K); no orders
            where one of the records is of other motion.
        predicted: response to the reference as it was recorded, shape (R, K).
        likely: response to the most likely motion that recurs with the record, shape (R, K).
        motion: response to the most likely motion in time, free motion included, shape (R, L).
        input_share: part of the noise that may be the reference's (95 %), 0 … 1, shape (R, K).
        transfer: of the sensor, shape (R, K).
        slopes: of the response with the coordinates, shape (R, P, K).
        gain: of a bin that makes noise white, zero where it does not count, shape (R, K).
        basis: orthonormal nuisance rows, zero where a record has fewer, shape (R, q, 2 K).
        residual: whitened, shape (R, 2 K).
        jacobian: of the response with the coordinates, whitened, shape (R, P, 2 K); zero where a
            record has a tone.
        tone: slopes with the amplitude and phase of a record's own tone, whitened, shape (R, 2, 2
            K); None where the coordinates themselves are fitted.
        pull: of the coordinates by that amplitude and phase, shape (R, P, 2); None likewise.
        freedom: degrees of freedom of the residual, shape (R,).
        errors_of: makes whitened errors of known covariance of these records, not free of the
            nuisance columns.
        again: makes the group in the noise beside columns of each record, shape (R, m, K).
    """

    records: tuple[Record, ...]
    numbers: NDArray[np.int_]
    begin_s: FloatArray
    used: BoolArray
    turns: FloatArray
    harmonics: ComplexArray
    predicted: ComplexArray
    likely: ComplexArray
    motion: FloatArray
    input_share: FloatArray
    transfer: ComplexArray
    slopes: ComplexArray
    gain: FloatArray
    basis: FloatArray
    residual: FloatArray
    jacobian: FloatArray
    tone: FloatArray | None
    pull: FloatArray | None
    freedom: FloatArray
    errors_of: Callable[[Sequence[int]], Errors]
    again: Callable[[ComplexArray], WhitenedGroup]

    @property
    def rate_hz(self) -> float:
        """Return the sampling rate."""
        return self.records[0].sampling_rate_hz

    @property
    def samples(self) -> int:
        """Return the number of samples n of a record."""
        return int(self.used.shape[1])

    @property
    def bins(self) -> int:
        """Return the number of bins K."""
        return int(self.gain.shape[1])

    @property
    def radians(self) -> FloatArray:
        """Return the angle from sample to sample at the bins, shape (K,)."""
        return np.asarray(2.0 * np.pi / self.samples * np.arange(1, self.bins + 1), dtype=float)

    @property
    def hz(self) -> FloatArray:
        """Return the frequencies of the bins, shape (K,)."""
        return self.radians * (self.rate_hz / (2.0 * np.pi))

    @property
    def time_s(self) -> FloatArray:
        """Return the times of the motion, shape (R, L)."""
        step = self.samples // self.motion.shape[1]
        return self.begin_s[:, None] + np.arange(self.motion.shape[1]) * (step / self.rate_hz)

    @functools.cached_property
    def reference(self) -> FloatArray:
        """Return the most likely motion at the sensor's input in time, shape (R, L)."""
        return self.series(
            np.divide(
                self.likely, self.transfer, out=np.zeros_like(self.likely), where=self.transfer != 0
            )
        )

    @property
    def noise_power(self) -> FloatArray:
        """Return the mean square of a sample of the noise at each bin, shape (R, K)."""
        squares = self.gain**2
        return np.divide(2.0 / self.samples, squares, out=np.zeros_like(squares), where=squares > 0)

    def series(self, bins: ComplexArray) -> FloatArray:
        """Return signals in time from their bins, shape (…, L)."""
        length = self.motion.shape[1]
        return in_time(bins, length) * (length / self.samples)

    def bins_of(self, signals: FloatArray) -> ComplexArray:
        """Return the bins of signals in time where the records are used, shape (…, m, K).

        The signals have all samples or those of the motion.
        """
        step = self.samples // signals.shape[-1]
        if self.used.all():
            return np.asarray(fft.rfft(signals, axis=-1)[..., 1 : self.bins + 1]) * step
        used = self.used[:, None, ::step] if signals.ndim == 3 else self.used[:, ::step]
        return np.asarray(fft.rfft(signals * used, axis=-1)[..., 1 : self.bins + 1]) * step

    def through(self, signals: FloatArray) -> ComplexArray:
        """Return the bins of the sensor's response to signals at its input, shape (R, m, K).

        The signals are in time.
        """
        return self.bins_of(signals) * self.transfer[:, None]

    @property
    def gain_and_time(self) -> ComplexArray:
        """Return the motion and its slope with time in samples, shape (R, 2, K).

        They are what a gain and a time shift add to the response.
        """
        return np.stack([self.likely, 1j * self.radians * self.likely], axis=1)

    def whiten(self, columns: ComplexArray, out: FloatArray | None = None) -> FloatArray:
        """Return columns by bins, shape (R or 1, m, K), as whitened rows, shape (R, m, 2 K).

        The rows are not free of nuisances.
        """
        rows = (
            np.empty((len(self.records), columns.shape[-2], 2 * self.bins)) if out is None else out
        )
        np.multiply(columns, self.gain[:, None], out=rows.view(complex))
        return rows

    def freed(self, rows: FloatArray) -> FloatArray:
        """Return whitened rows, shape (R, m, 2 K), less their nuisance columns.

        Rows of which only rounding remains are zero.
        """
        return without(rows, self.nuisance_rows)

    @property
    def length(self) -> int:
        """Return the number of samples of whitened rows in time: blocks of one length."""
        return BLOCKS * fast_length(-(-2 * (self.bins + 1) // BLOCKS))

    def whitened_in_time(self, rows: FloatArray) -> FloatArray:
        """Return whitened rows in time, with the same products, shape (…, length)."""
        return in_time(np.ascontiguousarray(rows).view(complex), self.length) * np.sqrt(
            0.5 * self.length
        )

    def whitened_at_bins(self, rows: FloatArray) -> FloatArray:
        """Return whitened rows in time at the bins, shape (…, 2 K).

        It is the inverse of :meth:`whitened_in_time`.
        """
        bins = fft.rfft(rows, axis=-1)[..., 1 : self.bins + 1] * np.sqrt(2.0 / self.length)
        return np.ascontiguousarray(bins).view(float)

    @functools.cached_property
    def comparison_in_time(self) -> FloatArray:
        """Return all rows that columns are compared with in time, shape (R, …, length)."""
        return self.whitened_in_time(self.comparison_rows)

    @functools.cached_property
    def levels(self) -> FloatArray:
        """Return the power of the noise over its mean in stretches, shape (R, stretches)."""
        squares = self.comparison_in_time[:, self.nuisance_rows.shape[1]] ** 2
        place = np.arange(self.length) * self.samples // self.length
        used = np.asarray(self.used[:, place], dtype=float)
        stretches = int(np.clip(np.min(used.sum(axis=1)) // MIN_STRETCH_SAMPLES, 1, MAX_STRETCHES))
        edges = np.linspace(0, self.length, stretches + 1).astype(int)
        power, number = (
            np.add.reduceat(values, edges[:-1], axis=1) for values in (squares * used, used)
        )
        mean = power.sum(axis=1, keepdims=True) / np.maximum(number.sum(axis=1, keepdims=True), 1.0)
        level = power / np.maximum(number, 1.0) / np.maximum(mean, 1e-300)
        return np.maximum(np.where(number > 0.5 * np.diff(edges), level, 1.0), 1e-3)

    @functools.cached_property
    def profile(self) -> FloatArray:
        """Return the power of the noise over its mean in time, shape (R, length)."""
        edges = np.linspace(0, self.length, self.levels.shape[1] + 1)
        middle = 0.5 * (edges[1:] + edges[:-1])
        return np.stack([np.interp(np.arange(self.length), middle, level) for level in self.levels])

    @functools.cached_property
    def nuisance_rows(self) -> FloatArray:
        """Return orthonormal rows that whitened columns are freed from, shape (R, q, 2 K).

        The tone's are among them.
        """
        return (
            self.basis
            if self.tone is None
            else np.concatenate([self.basis, orthonormal(self.tone)], axis=1)
        )

    @functools.cached_property
    def residual_beside_tone(self) -> FloatArray:
        """Return the residual without what the tone makes of it, shape (R, 2 K)."""
        return (
            self.residual
            if self.tone is None
            else without(self.residual[:, None], self.nuisance_rows)[:, 0]
        )

    @functools.cached_property
    def tone_pull(self) -> FloatArray | None:
        """Return rows whose products are shifts of the coordinates, shape (R, P, 2 K).

        With them a column moves the coordinates through the tone's parameters, which were fitted
        beside the tone's harmonics; None without a tone.
        """
        if self.tone is None or self.pull is None:
            return None
        waves = self.harmonics.reshape(len(self.records), -1, self.bins)
        harmonic_rows = orthonormal(without(self.whiten(waves), self.basis))
        tone = without(self.tone, harmonic_rows)
        return self.pull @ inverse_where_shown(tone @ tone.mT) @ tone

    @functools.cached_property
    def comparison_rows(self) -> FloatArray:
        """Return all rows that columns are compared with, shape (R, q + 1 + P, 2 K).

        The last P are the Jacobian, or, of tones, those that shift the coordinates.
        """
        last_rows = self.jacobian if self.tone_pull is None else self.tone_pull
        residual = self.residual_beside_tone[:, None]
        return np.concatenate([self.nuisance_rows, residual, last_rows], axis=1)

    def sums(self, rows: FloatArray) -> Sums:
        """Return the sums of whitened rows of places, shape (R, places, m, 2 K)."""
        count = rows.shape[1] * rows.shape[2]
        products = rows.reshape(len(rows), count, -1) @ self.comparison_rows.mT
        return self.sums_of_products(products.reshape(*rows.shape[:3], -1), rows @ rows.mT)

    def sums_of_products(self, products: FloatArray, gram: FloatArray) -> Sums:
        """Return the sums from the products of rows with :attr:`comparison_rows` and each other."""
        nuisances = self.nuisance_rows.shape[1]
        shared = products[..., :nuisances]
        power = np.diagonal(gram, axis1=-2, axis2=-1)
        gram = gram - shared @ shared.mT
        remains = (np.diagonal(gram, axis1=-2, axis2=-1) > LOST * power).astype(float)
        gram *= remains[..., None] * remains[..., None, :]
        last = products[..., nuisances + 1 :] * remains[..., None]
        zeros = np.zeros_like(last)
        cross, shift = (last, zeros) if self.tone_pull is None else (zeros, last)
        least = MIN_UNFOLLOWED * np.diagonal(gram, axis1=-2, axis2=-1)
        return Sums(products[..., nuisances] * remains, gram, cross, shift, least)

    def exact_sums(self, rows: FloatArray, doubt: FloatArray | None) -> ExactSums:
        """Return sums of whitened rows, shape (R, m, 2 K), and their covariance.

        ``doubt``: what they have in common with an error of the reference's noise, shape (R, m);
        None: they are linear in the motion.
        """
        freed_rows = self.freed(rows)
        signals = self.whitened_in_time(freed_rows)
        weighted_signals = signals * self.profile[:, None]
        common = freed_rows @ self.errors.rows.mT
        if doubt is not None:
            common[..., -1] = doubt
        sums = self.sums(rows[:, None]).at((slice(None), 0))
        spread = weighted_signals @ signals.mT
        cross_spread = weighted_signals @ self.jacobian_in_time.mT
        return ExactSums(
            **vars(sums), spread=spread, cross_spread=cross_spread, common=common, steps=self.steps
        )

    @functools.cached_property
    def errors(self) -> Errors:
        """Return whitened errors of known covariance, free of the nuisance columns."""
        return self.errors_of(range(len(self.records))).freed(self.freed)

    @functools.cached_property
    def steps(self) -> FloatArray:
        """Return the power of the errors of converters and interpolation, whitened, shape (R,)."""
        motion = self.freed(self.whiten(self.gain_and_time[:, :1]))
        powers = [np.einsum("rmi,rmi->r", rows, rows) for rows in (self.errors.rounding, motion)]
        return powers[0] + MIN_RELATIVE_DEVIATION**2 * powers[1]

    @functools.cached_property
    def jacobian_in_time(self) -> FloatArray:
        """Return the whitened Jacobian in time, shape (R, P, length)."""
        last_rows = self.comparison_in_time[:, self.nuisance_rows.shape[1] + 1 :]
        return last_rows if self.tone_pull is None else np.zeros_like(last_rows)

    @functools.cached_property
    def information(self) -> RecordInformation:
        """Return what the records say of the coordinates."""
        jacobian = self.jacobian
        normal = jacobian @ jacobian.mT
        optimum = np.zeros(jacobian.shape[:2])
        if self.tone_pull is not None:
            optimum = (self.tone_pull @ self.residual[..., None])[..., 0]
        return RecordInformation(
            normal,
            inverse_where_shown(normal),
            (jacobian @ self.residual_beside_tone[..., None])[..., 0],
            np.einsum("ri,ri->r", self.residual_beside_tone, self.residual_beside_tone),
            self.freedom - (0 if self.tone is None else self.tone.shape[1]),
            optimum,
            np.min(self.levels, axis=1),
        )

    @functools.cached_property
    def spread(self) -> tuple[FloatArray, FloatArray]:
        """Return the covariance of J e by the noise's profile, and J times the known errors.

        Their shapes are (R, P, P) and (R, P, E).
        """
        signals = self.jacobian_in_time
        return (signals * self.profile[:, None]) @ signals.mT, self.jacobian @ self.errors.rows.mT

    def subset(self, numbers: Sequence[int]) -> WhitenedGroup:
        """Return the group of these of its records."""
        positions = list(numbers)
        errors_of = self.errors_of
        arrays = {attribute.name: getattr(self, attribute.name) for attribute in fields(self)}
        return replace(
            self,
            **{
                name: value[positions]
                for name, value in arrays.items()
                if isinstance(value, np.ndarray)
            },
            records=tuple(self.records[number] for number in positions),
            errors_of=lambda subset: errors_of([positions[number] for number in subset]),
        )

    def with_nuisances(self, rows: FloatArray) -> WhitenedGroup:
        """Return the group with more nuisance columns: whitened rows, shape (R, m, 2 K)."""
        added = orthonormal(without(rows, self.basis))
        return replace(
            self,
            basis=np.concatenate([self.basis, added], axis=1),
            residual=without(self.residual[:, None], added)[:, 0],
            jacobian=without(self.jacobian, added),
            tone=None if self.tone is None else without(self.tone, added),
            freedom=self.freedom - rank_of(added),
        )


def harmonics_of(turns: FloatArray, used: BoolArray, bins: int) -> ComplexArray:
    """Return cosine and sine of the harmonics of tones, shape (R, orders, 2, bins).

    They are as the fits of the tones have them; those above the band that samples tell are zero.

    Args:
        turns: of the tones from sample to sample, shape (R,).
        used: samples that count, shape (R, n).
        bins: number of bins, from 1 on.
    """
    turns = turns[:, None] * np.arange(2, HARMONICS + 1)
    step = np.where(turns < USABLE_BAND, 2.0 * np.pi * turns, 0.0)
    exponents = 1j * np.concatenate([step, -step], axis=1)
    both = [
        wave_bins(of_record, used_of_record, bins + 1)[:, 1:]
        for of_record, used_of_record in zip(exponents, used, strict=True)
    ]
    ahead, behind = np.split(np.stack(both), 2, axis=1)
    waves = np.stack([ahead + behind, (ahead - behind) / 1j], axis=2)
    return 0.5 * waves * (turns < USABLE_BAND)[:, :, None, None]
