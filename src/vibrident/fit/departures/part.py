"""A record at the estimate, whitened: what the score tests look at."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy import fft

from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.fit.information import inverse_where_shown
from vibrident.fit.response.response import LEAST_DEVIATION, ComplexArray
from vibrident.fit.response.rounding import TRIALS
from vibrident.fit.response.tones import HARMONICS, turning
from vibrident.physics.discretisation.inputs import USABLE_BAND

#: Rounding of columns that others span, in squares; and of what is left of rows that are spanned.
ROUNDING, LOST = 1e-13, 1e-12
#: Parts of so many samples together are held; of more, each pass makes them anew: a limit of memory.
HELD = 1 << 16


@dataclass(frozen=True, eq=False)
class Own:
    """What a part says of the coordinates.

    Attributes:
        normal: J Jᵀ, shape (p, p).
        inverse: of it, shape (p, p).
        spread: J V Jᵀ, shape (p, p).
        gradient: J e, shape (p,).
        common: J times the common errors, shape (p, 2 TRIALS + K).
        chi2: sum of squares of the residual, beside parameters that are the part's alone.
        freedom: degrees of freedom of the residual.
        alone: where its own parameters would move the coordinates, shape (P,); None where these are the same.
    """

    normal: FloatArray
    inverse: FloatArray
    spread: FloatArray
    gradient: FloatArray
    common: FloatArray
    chi2: float
    freedom: float
    alone: FloatArray | None


@dataclass(frozen=True, eq=False)
class Part:
    """A record at the estimate, or a piece of a long one.

    Signals are in the unit of the response. The whitened ones are free of the nuisance parameters: initial states,
    offset, drift and hum.

    Attributes:
        record: of which it is.
        begin_s: time of the first sample.
        used: samples that count, shape (n,).
        predicted: response to the reference as it was recorded, shape (n,).
        bins: of the response to the most likely motion that recurs with the record, shape (bins,).
        motion: the response to the most likely motion, free motion included, shape (n,).
        reference: the most likely motion at the sensor's input, shape (n,).
        transfer: of the sensor at the bins, shape (bins,).
        whitening: gain at the bins that makes the noise white, zero where bins do not count, shape (bins,).
        basis: orthonormal whitened nuisance columns, shape (q, n).
        residual: whitened, shape (n,).
        jacobian: slopes of the response with the coordinates, whitened, shape (p, n).
        profile: noise power in time over its mean, shape (n,).
        rounding: whitened errors of the converters that repeat with the motion; their products sum to a covariance,
            shape (2 TRIALS, n); empty where there are none.
        effects: what one standard uncertainty of each stated systematic effect adds to the response, whitened, and, the
            last, one of the variance of the reference's noise, shape (K, n).
        doubt: part of the noise that one standard uncertainty of the reference's makes, shape (bins,).
        freedom: degrees of freedom of the residual.
        pull: shift of the fit's coordinates by those of the record, shape (P, p); None where these are the same.
        turns: of the record's sine from sample to sample; None for other motion.
        slopes: of the response with the coordinates, shape (p, bins).
        again: makes the part in the noise beside columns by their bins, shape (m, bins).
    """

    record: Record
    begin_s: float
    used: BoolArray
    predicted: FloatArray
    bins: ComplexArray
    motion: FloatArray
    reference: FloatArray
    transfer: ComplexArray
    whitening: FloatArray
    basis: FloatArray
    residual: FloatArray
    jacobian: FloatArray
    profile: FloatArray
    freedom: float
    rounding: FloatArray
    effects: FloatArray
    doubt: FloatArray
    pull: FloatArray | None = None
    turns: float | None = None
    slopes: ComplexArray | None = None
    again: Callable[[ComplexArray], Part] | None = None

    @property
    def rate_hz(self) -> float:
        """Sampling rate."""
        return self.record.sampling_rate_hz

    @property
    def samples(self) -> int:
        """Number of samples n."""
        return int(self.used.size)

    def in_common(self, rows: FloatArray, some: slice = slice(None)) -> FloatArray:
        """Products of whitened rows, shape (m, n), or some of them, with errors of which the covariance is known.

        Returns:
            Shape (m, 2 TRIALS + K): with the converters' errors, and with the effects.
        """
        found = np.zeros((len(rows), 2 * TRIALS + len(self.effects)))
        if len(self.rounding):
            found[:, : 2 * TRIALS] = rows @ self.rounding[:, some].T
        found[:, 2 * TRIALS :] = rows @ self.effects[:, some].T
        return found

    @functools.cached_property
    def steps(self) -> float:
        """Power of the converters' errors and of those of interpolation, whitened."""
        return float(np.sum(np.square(self.rounding)) + LEAST_DEVIATION**2 * np.sum(np.square(self.moved[0])))

    @property
    def radians(self) -> FloatArray:
        """Angle from sample to sample at the bins, shape (bins,); jω of the transform, in units of the rate."""
        return np.asarray(2.0 * np.pi / self.samples * np.arange(self.whitening.size), dtype=float)

    @functools.cached_property
    def changing(self) -> FloatArray:
        """What a change adds to the response, whitened: motion, its slope and the Jacobian, shape (2 + p, n).

        Of a sine, amplitude and phase say it all: shape (2, n). In time it is told from these: a jump of the response
        itself is in all bins, the quietest above all, and says no more than where exactly it is.
        """
        return self.moved if self.turns is not None else np.concatenate([self.moved, self.jacobian])

    @functools.cached_property
    def moved(self) -> FloatArray:
        """Motion and its slope, whitened: a gain and a time shift of the response, shape (2, n)."""
        return self.white(self.moved_bins)

    @property
    def moved_bins(self) -> ComplexArray:
        """The same by their bins, shape (2, bins)."""
        return np.stack([self.bins, 1j * self.radians * self.bins])

    @property
    def changing_bins(self) -> ComplexArray:
        """The same by their bins, shape (2 + p, bins) or (2, bins)."""
        assert self.slopes is not None
        return self.moved_bins if self.turns is not None else np.concatenate([self.moved_bins, self.slopes])

    @functools.cached_property
    def own(self) -> Own:
        """What the part says of the coordinates."""
        jacobian, alone = self.jacobian, None
        normal, gradient, chi2 = jacobian @ jacobian.T, jacobian @ self.residual, float(self.residual @ self.residual)
        inverse = inverse_where_shown(normal)
        if self.pull is not None:
            chi2 -= float(gradient @ inverse @ gradient)
            alone = np.asarray(self.pull @ inverse @ gradient)
        spread = (jacobian * self.profile) @ jacobian.T
        return Own(normal, inverse, spread, gradient, self.in_common(jacobian), chi2, self.freedom, alone)

    def beside(self, rows: FloatArray) -> Part:
        """The part with more nuisance columns, whitened, shape (m, n)."""
        basis = orthonormal(rows)
        return replace(
            self,
            basis=np.concatenate([self.basis, basis]),
            residual=without(self.residual[None], basis)[0],
            jacobian=without(self.jacobian, basis),
            rounding=without(self.rounding, basis),
            effects=without(self.effects, basis),
            freedom=self.freedom - len(basis),
        )

    def in_noise_beside(self, columns: Sequence[FloatArray | ComplexArray]) -> Part:
        """The part in the noise that is left beside columns, which are no nuisance parameters of it."""
        assert self.again is not None
        return self.again(np.concatenate([self._bins(each) for each in columns])) if columns else self

    def _bins(self, columns: FloatArray | ComplexArray) -> ComplexArray:
        bins = columns if np.iscomplexobj(columns) else fft.rfft(columns * self.used, axis=-1)
        return np.asarray(bins, dtype=complex)

    def white(self, columns: FloatArray | ComplexArray) -> FloatArray:
        """Signals whitened and freed from the nuisance parameters, shape (m, n).

        Args:
            columns: in time, shape (m, n), or by their bins, complex, shape (m, bins).
        """
        return self.freed(np.asarray(fft.irfft(self._bins(columns) * self.whitening, self.samples, axis=-1)))

    def freed(self, rows: FloatArray) -> FloatArray:
        """Whitened rows less what nuisance parameters make of them, shape (m, n); zero where only rounding is left."""
        return without(rows, self.basis)

    def through(self, columns: FloatArray) -> ComplexArray:
        """Bins of signals at the sensor's input, shape (m, n), as its response has them."""
        return np.asarray(fft.rfft(columns * self.used, axis=-1) * self.transfer, dtype=complex)


@dataclass(frozen=True, eq=False)
class Parts:
    """The parts of a fit, one after the other.

    Attributes:
        make: makes them.
        samples: of all together.
    """

    make: Callable[[], Iterable[Part]]
    samples: int

    @functools.cached_property
    def _held(self) -> list[Part] | None:
        return list(self.make()) if self.samples <= HELD else None

    def __iter__(self) -> Iterator[Part]:
        return iter(self.make() if self._held is None else self._held)

    def beside(self, rows: Callable[[int, Part], Iterable[FloatArray]]) -> Parts:
        """The parts with more nuisance columns; ``rows``: sets of these, whitened, of a part and its number."""
        return replace(
            self,
            make=lambda: (functools.reduce(Part.beside, rows(number, part), part) for number, part in enumerate(self)),
        )


def without(rows: FloatArray, basis: FloatArray) -> FloatArray:
    """Rows, shape (m, n), less their projections on orthonormal ones; zero where only rounding is left."""
    found = rows - (rows @ basis.T) @ basis
    found[np.einsum("ij,ij->i", found, found) <= LOST * np.einsum("ij,ij->i", rows, rows)] = 0.0
    return found


def harmonics_of(turns: float, samples: int) -> FloatArray:
    """Cosine and sine of the harmonics of a tone that its fit has, from the second on, shape (harmonics, 2, samples).

    ``turns``: of the tone from sample to sample.
    """
    orders = [order for order in range(2, HARMONICS + 1) if order * turns < USABLE_BAND]
    waves = np.array([turning(samples, 2.0 * np.pi * turns * order) for order in orders]).reshape(-1, samples)
    return np.stack([waves.real, waves.imag], axis=1)


def orthonormal(columns: FloatArray) -> FloatArray:
    """Orthonormal rows that span the columns, shape (q, n)."""
    size = np.linalg.norm(columns, axis=1, keepdims=True)
    unit = np.divide(columns, size, out=np.zeros_like(columns), where=size > 0.0)
    values, vectors = np.linalg.eigh(unit @ unit.T)
    kept = values > ROUNDING * max(float(values[-1]) if values.size else 0.0, 1e-300)
    return np.asarray((vectors[:, kept] / np.sqrt(values[kept])).T @ unit)
