"""Records of one length and rate at the estimate, side by side, at the bins of their band.

Everything above the band (one and a half times the highest frequency of the motion, and the harmonics
of a tone) is left out. Whitened rows hold real and imaginary parts of the bins in turn, shape (…, 2 K),
so that their products are those of white samples. In time, the band alone is a record at a lower rate.
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
from vibrident.fit.departures.sums import Errors, Exact, Own, Sums
from vibrident.fit.information import inverse_where_shown
from vibrident.fit.response.response import MIN_RELATIVE_DEVIATION, ComplexArray
from vibrident.fit.response.tones import HARMONICS
from vibrident.physics.discretisation.inputs import USABLE_BAND

#: Rounding of columns that others span, in squares; and of what is left of rows that are spanned.
ROUNDING, LOST = 1e-13, 1e-12
#: Columns of which nuisance parameters and coordinates leave less than this part, in squares, tell nothing.
WITHIN = 1e-7
#: A tone lies on a bin to this angle a sample.
ON_BIN = 1e-13
#: Blocks of a record in time, between which it may change.
BLOCKS = 32
#: Stretches of a record over which its noise may change, and the least samples of one.
STRETCHES, MIN_STRETCH = 16, 128


@dataclass(frozen=True, eq=False)
class WhitenedGroup:
    """R records, or pieces of long ones, at K bins.

    Signals are by their bins, in the unit of the response; whitened rows are free of the nuisance columns.

    Attributes:
        records: the records.
        numbers: of the records among those of the fit, shape (R,).
        begin_s: time of the first sample, shape (R,).
        used: samples that count, shape (R, n).
        turns: of a sine from sample to sample, NaN for other motion, shape (R,).
        predicted: response to the reference as it was recorded, shape (R, K).
        likely: response to the most likely motion that recurs with the record, shape (R, K).
        motion: response to the most likely motion in time, free motion included, shape (R, L).
        transfer: of the sensor, shape (R, K).
        slopes: of the response with the coordinates, shape (R, P, K).
        gain: of a bin that makes noise white, zero where it does not count, shape (R, K).
        basis: orthonormal nuisance rows, zero where a record has fewer, shape (R, q, 2 K).
        residual: whitened, shape (R, 2 K).
        jacobian: of the response with the coordinates, whitened, shape (R, P, 2 K); zero where a record has a tone.
        tone: slopes with the amplitude and phase of a record's own tone, whitened, shape (R, 2, 2 K); None where the
            coordinates themselves are fitted.
        pull: of the coordinates by that amplitude and phase, shape (R, P, 2); None likewise.
        freedom: degrees of freedom of the residual, shape (R,).
        errors_of: makes whitened errors of known covariance of these records, not free of the nuisance columns.
        again: makes the group in the noise beside columns of each record, shape (R, m, K).
    """

    records: tuple[Record, ...]
    numbers: NDArray[np.int_]
    begin_s: FloatArray
    used: BoolArray
    turns: FloatArray
    predicted: ComplexArray
    likely: ComplexArray
    motion: FloatArray
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
        """Sampling rate."""
        return self.records[0].sampling_rate_hz

    @property
    def samples(self) -> int:
        """Number of samples n of a record."""
        return int(self.used.shape[1])

    @property
    def bins(self) -> int:
        """Number of bins K."""
        return int(self.gain.shape[1])

    @property
    def radians(self) -> FloatArray:
        """Angle from sample to sample at the bins, shape (K,)."""
        return np.asarray(2.0 * np.pi / self.samples * np.arange(1, self.bins + 1), dtype=float)

    @property
    def hz(self) -> FloatArray:
        """Frequencies of the bins, shape (K,)."""
        return self.radians * (self.rate_hz / (2.0 * np.pi))

    @property
    def time_s(self) -> FloatArray:
        """Times of the motion, shape (R, L)."""
        step = self.samples // self.motion.shape[1]
        return self.begin_s[:, None] + np.arange(self.motion.shape[1]) * (step / self.rate_hz)

    @functools.cached_property
    def reference(self) -> FloatArray:
        """The most likely motion at the sensor's input in time, shape (R, L)."""
        return self.series(
            np.divide(
                self.likely, self.transfer, out=np.zeros_like(self.likely), where=self.transfer != 0
            )
        )

    def series(self, bins: ComplexArray) -> FloatArray:
        """Signals in time by their bins, shape (…, L)."""
        length = self.motion.shape[1]
        return _in_time(bins, length) * (length / self.samples)

    def bins_of(self, signals: FloatArray) -> ComplexArray:
        """Bins of signals in time, of all samples or those of the motion, where they are used; shape (…, m, K)."""
        step = self.samples // signals.shape[-1]
        if self.used.all():
            return np.asarray(fft.rfft(signals, axis=-1)[..., 1 : self.bins + 1]) * step
        used = self.used[:, None, ::step] if signals.ndim == 3 else self.used[:, ::step]
        return np.asarray(fft.rfft(signals * used, axis=-1)[..., 1 : self.bins + 1]) * step

    def through(self, signals: FloatArray) -> ComplexArray:
        """Bins of the sensor's response to signals at its input in time, shape (R, m, K)."""
        return self.bins_of(signals) * self.transfer[:, None]

    @property
    def moved(self) -> ComplexArray:
        """Motion and its slope with time in samples: a gain and a time shift of the response, shape (R, 2, K)."""
        return np.stack([self.likely, 1j * self.radians * self.likely], axis=1)

    @property
    def harmonics(self) -> ComplexArray:
        """Cosine and sine of the harmonics of each record's tone, as its fit has them, shape (R, orders, 2, K).

        Those above the band that samples tell, and of other motion, are zero.
        """
        turn = self.turns[:, None] * np.arange(2, HARMONICS + 1)
        step = np.where(turn < USABLE_BAND, 2.0 * np.pi * turn, 0.0)
        ahead, behind = self._turning(step), self._turning(-step)
        waves = np.stack([ahead + behind, (ahead - behind) / 1j], axis=2)
        return 0.5 * waves * (turn < USABLE_BAND)[:, :, None, None]

    def _turning(self, step: FloatArray) -> ComplexArray:
        """Bins of exp(j step t) where the records are used, shape (R, orders, K)."""
        if not self.used.all():
            waves = np.exp(1j * step[..., None] * np.arange(self.samples)) * self.used[:, None]
            return np.asarray(fft.fft(waves, axis=-1)[..., 1 : self.bins + 1])
        over = 1.0 - np.exp(1j * step)[..., None] * np.exp(-1j * self.radians)
        ends = np.broadcast_to(1.0 - np.exp(1j * step * self.samples)[..., None], over.shape)
        on_bin = np.abs(over) < ON_BIN
        return np.where(on_bin, self.samples, ends / np.where(on_bin, 1.0, over))

    def flat(self, columns: ComplexArray, out: FloatArray | None = None) -> FloatArray:
        """Return columns by bins, shape (R or 1, m, K), as whitened rows, shape (R, m, 2 K), not free of nuisances."""
        rows = (
            np.empty((len(self.records), columns.shape[-2], 2 * self.bins)) if out is None else out
        )
        np.multiply(columns, self.gain[:, None], out=rows.view(complex))
        return rows

    def freed(self, rows: FloatArray) -> FloatArray:
        """Whitened rows, shape (R, m, 2 K), less their nuisance columns; zero where only rounding is left."""
        return without(rows, self.free)

    @property
    def length(self) -> int:
        """Samples of whitened rows in time: blocks of one length."""
        return BLOCKS * fast_length(-(-2 * (self.bins + 1) // BLOCKS))

    def whitened_in_time(self, rows: FloatArray) -> FloatArray:
        """Whitened rows in time, with the same products, shape (…, length)."""
        return _in_time(np.ascontiguousarray(rows).view(complex), self.length) * np.sqrt(
            0.5 * self.length
        )

    def whitened_at_bins(self, rows: FloatArray) -> FloatArray:
        """The inverse of :meth:`whitened_in_time`, shape (…, 2 K)."""
        bins = fft.rfft(rows, axis=-1)[..., 1 : self.bins + 1] * np.sqrt(2.0 / self.length)
        return np.ascontiguousarray(bins).view(float)

    @functools.cached_property
    def levels(self) -> FloatArray:
        """Power of the noise over its mean in stretches of time, shape (R, stretches)."""
        squares = self.whitened_in_time(self.rest) ** 2
        place = np.arange(self.length) * self.samples // self.length
        used = np.asarray(self.used[:, place], dtype=float)
        stretches = int(np.clip(np.min(used.sum(axis=1)) // MIN_STRETCH, 1, STRETCHES))
        edges = np.linspace(0, self.length, stretches + 1).astype(int)
        power, number = (
            np.add.reduceat(part, edges[:-1], axis=1) for part in (squares * used, used)
        )
        mean = power.sum(axis=1, keepdims=True) / np.maximum(number.sum(axis=1, keepdims=True), 1.0)
        level = power / np.maximum(number, 1.0) / np.maximum(mean, 1e-300)
        return np.maximum(np.where(number > 0.5 * np.diff(edges), level, 1.0), 1e-3)

    @functools.cached_property
    def profile(self) -> FloatArray:
        """Power of the noise over its mean in time, shape (R, length)."""
        edges = np.linspace(0, self.length, self.levels.shape[1] + 1)
        middle = 0.5 * (edges[1:] + edges[:-1])
        return np.stack([np.interp(np.arange(self.length), middle, level) for level in self.levels])

    @functools.cached_property
    def free(self) -> FloatArray:
        """Orthonormal rows that whitened columns are freed from, the tone's among them, shape (R, q, 2 K)."""
        return (
            self.basis
            if self.tone is None
            else np.concatenate([self.basis, orthonormal(self.tone)], axis=1)
        )

    @functools.cached_property
    def rest(self) -> FloatArray:
        """The residual beside the tone, shape (R, 2 K)."""
        return (
            self.residual if self.tone is None else without(self.residual[:, None], self.free)[:, 0]
        )

    @functools.cached_property
    def alone(self) -> FloatArray | None:
        """Rows by the product with which a column moves the coordinates through the tone's parameters, (R, P, 2 K)."""
        if self.tone is None or self.pull is None:
            return None
        return self.pull @ inverse_where_shown(self.tone @ self.tone.mT) @ self.tone

    @functools.cached_property
    def others(self) -> FloatArray:
        """All rows that columns are compared with, shape (R, q + 1 + P (+ P), 2 K)."""
        alone = [] if self.alone is None else [self.alone]
        return np.concatenate([self.free, self.rest[:, None], self.jacobian, *alone], axis=1)

    def sums(self, rows: FloatArray) -> Sums:
        """What whitened rows of places, shape (R, places, m, 2 K), have in common with the fit."""
        count = rows.shape[1] * rows.shape[2]
        products = rows.reshape(len(rows), count, -1) @ self.others.mT
        return self.sums_of_products(products.reshape(*rows.shape[:3], -1), rows @ rows.mT)

    def sums_of_products(self, products: FloatArray, gram: FloatArray) -> Sums:
        """The same by the products of rows with :attr:`others`, and with each other."""
        first, size = self.free.shape[1], self.jacobian.shape[1]
        shared = products[..., :first]
        power = np.diagonal(gram, axis1=-2, axis2=-1)
        gram = gram - shared @ shared.mT
        kept = (np.diagonal(gram, axis1=-2, axis2=-1) > LOST * power).astype(float)
        gram *= kept[..., None] * kept[..., None, :]
        cross = products[..., first + 1 : first + 1 + size] * kept[..., None]
        shift = (
            np.zeros_like(cross) if self.alone is None else products[..., -size:] * kept[..., None]
        )
        least = WITHIN * np.diagonal(gram, axis1=-2, axis2=-1)
        return Sums(products[..., first] * kept, gram, cross, shift, least)

    def exact_sums(self, rows: FloatArray, doubt: FloatArray | None) -> Exact:
        """Return sums of whitened rows, shape (R, m, 2 K), and their covariance.

        ``doubt``: what they have in common with an error of the reference's noise, shape (R, m); None: they are linear
        in the motion.
        """
        free = self.freed(rows)
        signals = self.whitened_in_time(free)
        loud = signals * self.profile[:, None]
        common = free @ self.errors.rows.mT
        if doubt is not None:
            common[..., -1] = doubt
        sums = self.sums(rows[:, None]).at((slice(None), 0))
        spread, cross_spread = loud @ signals.mT, loud @ self._jacobian_in_time.mT
        return Exact(
            **vars(sums), spread=spread, cross_spread=cross_spread, common=common, steps=self.steps
        )

    @functools.cached_property
    def errors(self) -> Errors:
        """Whitened errors of which the covariance is known."""
        return self.errors_of(range(len(self.records))).freed(self.freed)

    @functools.cached_property
    def steps(self) -> FloatArray:
        """Power of the errors of converters and of interpolation, whitened, shape (R,)."""
        moved = self.freed(self.flat(self.moved[:, :1]))
        squares = [np.einsum("rmi,rmi->r", rows, rows) for rows in (self.errors.rounding, moved)]
        return squares[0] + MIN_RELATIVE_DEVIATION**2 * squares[1]

    @functools.cached_property
    def _jacobian_in_time(self) -> FloatArray:
        return self.whitened_in_time(self.jacobian)

    @functools.cached_property
    def own(self) -> Own:
        """What the records say of the coordinates."""
        jacobian = self.jacobian
        normal = jacobian @ jacobian.mT
        optimum = np.zeros(jacobian.shape[:2])
        if self.alone is not None:
            optimum = (self.alone @ self.residual[..., None])[..., 0]
        return Own(
            normal,
            inverse_where_shown(normal),
            (jacobian @ self.rest[..., None])[..., 0],
            np.einsum("ri,ri->r", self.rest, self.rest),
            self.freedom - (0 if self.tone is None else self.tone.shape[1]),
            optimum,
            np.min(self.levels, axis=1),
        )

    @functools.cached_property
    def spread(self) -> tuple[FloatArray, FloatArray]:
        """Covariance of J e by the noise's profile, shape (R, P, P), and J times the known errors, shape (R, P, E)."""
        signals = self._jacobian_in_time
        return (signals * self.profile[:, None]) @ signals.mT, self.jacobian @ self.errors.rows.mT

    def only(self, kept: Sequence[int]) -> WhitenedGroup:
        """Some of the records."""
        chosen, errors_of = list(kept), self.errors_of
        arrays = {each.name: getattr(self, each.name) for each in fields(self)}
        return replace(
            self,
            **{
                name: value[chosen]
                for name, value in arrays.items()
                if isinstance(value, np.ndarray)
            },
            records=tuple(self.records[number] for number in chosen),
            errors_of=lambda some: errors_of([chosen[number] for number in some]),
        )

    def beside(self, rows: FloatArray) -> WhitenedGroup:
        """The group with more nuisance columns: whitened rows, shape (R, m, 2 K)."""
        more = orthonormal(without(rows, self.basis))
        return replace(
            self,
            basis=np.concatenate([self.basis, more], axis=1),
            residual=without(self.residual[:, None], more)[:, 0],
            jacobian=without(self.jacobian, more),
            tone=None if self.tone is None else without(self.tone, more),
            freedom=self.freedom - rank_of(more),
        )


def without(rows: FloatArray, basis: FloatArray) -> FloatArray:
    """Rows, shape (R, m, i), less their projections on orthonormal ones; zero where only rounding is left."""
    left = rows - (rows @ basis.mT) @ basis
    left[np.einsum("rmi,rmi->rm", left, left) <= LOST * np.einsum("rmi,rmi->rm", rows, rows)] = 0.0
    return left


def orthonormal(columns: FloatArray) -> FloatArray:
    """Orthonormal rows that span columns, each of shape (R, m, i); zero where there are fewer."""
    size = np.sqrt(np.einsum("rmi,rmi->rm", columns, columns))
    scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
    gram = (columns @ columns.mT) * scale[..., None] * scale[..., None, :]
    values, vectors = np.linalg.eigh(gram)
    kept = values > ROUNDING * np.maximum(values[..., -1:], 1e-300)
    over = np.divide(
        1.0, np.sqrt(np.maximum(values, 1e-300)), out=np.zeros_like(values), where=kept
    )
    return (vectors * over[..., None, :]).mT * scale[..., None, :] @ columns


def rank_of(basis: FloatArray) -> FloatArray:
    """Number of rows that are not zero, shape (R,)."""
    return np.sum(np.einsum("rmi,rmi->rm", basis, basis) > 0.5, axis=1).astype(float)


def _in_time(bins: ComplexArray, length: int) -> FloatArray:
    """Signals of so many samples by their bins from the first on, shape (…, length)."""
    padded = np.zeros((*bins.shape[:-1], bins.shape[-1] + 1), dtype=complex)
    padded[..., 1:] = bins
    return np.asarray(fft.irfft(padded, length, axis=-1), dtype=float)
