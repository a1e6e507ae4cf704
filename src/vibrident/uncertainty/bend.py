"""Is the spring bent? The score test of a cubic stiffness for motion that is not a sine.

To first order a term ωn² k3 V³ of the spring's force adds −k3 G{V³} to the response, G the sensor's response over its
gain (Volterra's third kernel at weak nonlinearity; Schetzen 1980). Such motion has no harmonics to listen for, and
what of the distortion is coherent with the motion looks like another stiffness (Bussgang 1952), so the parameters take
it and no band shows a misfit. What is left is noise to any linear model, and is looked for by its shape: in every
narrow band what a linear response could take, any complex factor with a slope over frequency, is taken out of residual
and shape alike, and one k3 is fitted to all bands.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft

from vibrident.measure.bands import band_edges
from vibrident.measure.lines import line_frequencies
from vibrident.measure.response import ComplexArray
from vibrident.records import FloatArray, Record
from vibrident.uncertainty.amplitude import LEAST, SIGNIFICANT

#: Lines that tell the noise of a band: at least so many, beyond its own where it is narrower.
NOISE_LINES = 40
#: A linear misfit may imitate the shape by chance, with any phase; a stiffness is real. The part in quadrature may be
#: this much of the real one.
MOST_QUADRATURE = 1.0 / 3.0


@dataclass(frozen=True)
class Bend:
    """A bend found.

    Attributes:
        share: rms of what it adds to the response, over the response's rms.
        sigma: k3 in standard deviations.
    """

    share: float
    sigma: float


def bend(
    records: Sequence[Record], predicted: Sequence[FloatArray], over_gain: Callable[[FloatArray], ComplexArray]
) -> Bend | None:
    """The bend of the spring, where it is beyond doubt.

    Args:
        records: not sines, with a reference.
        predicted: response of each by the linear model, NaN where there is none.
        over_gain: function from frequencies (Hz) to the sensor's response over its gain.
    """
    products, powers, shares = 0j, 0.0, []
    for record, series in zip(records, predicted, strict=True):
        used = record.mask & np.isfinite(series)
        if used.sum() < 8 * NOISE_LINES:
            continue
        motion = np.where(used, series - np.mean(series[used]), 0.0)
        residual = np.where(used, record.response - series, 0.0)
        size = float(np.sqrt(np.mean(motion[used] ** 2)))
        if size == 0.0:
            continue
        lines = line_frequencies(record.samples, record.sampling_rate_hz)
        shape = -np.asarray(over_gain(lines)) * np.asarray(fft.rfft(motion**3))
        spectra = np.stack([np.asarray(fft.rfft(residual)), np.asarray(fft.rfft(motion)), shape])
        product, power = _fitted(spectra, band_edges(record.samples, record.sampling_rate_hz).astype(int))
        products, powers = products + product, powers + power
        shares.append(float(np.sqrt(np.sum(np.abs(shape) ** 2) * 2.0 / record.samples / used.sum())) / size)
    if powers <= 0.0:
        return None
    stiffness = products.real / powers
    share, sigma = abs(stiffness) * max(shares), abs(products.real) / np.sqrt(0.5 * powers)
    if sigma < SIGNIFICANT or share < LEAST or abs(products.imag) > MOST_QUADRATURE * abs(products.real):
        return None
    return Bend(share, float(sigma))


def _fitted(spectra: ComplexArray, edges: np.ndarray) -> tuple[complex, float]:
    """Σ W* E/s² and Σ |W|²/s² over all bands; rows E, V and W of ``spectra``, s² the variance of a line of E."""
    wide = np.diff(edges)
    counts = (wide - 2).tolist()

    def sums(lines: ComplexArray | FloatArray) -> np.ndarray:
        return np.add.reduceat(lines, edges[:-1] - edges[0], axis=-1)

    def without(lines: ComplexArray, column: ComplexArray) -> ComplexArray:
        size = np.maximum(sums(np.abs(column) ** 2), np.finfo(float).tiny)
        return lines - np.repeat(sums(lines * np.conj(column)) / size, wide, axis=-1) * column

    error, motion, shape = spectra[:, edges[0] : edges[-1]]
    slope = without(np.arange(motion.size) * motion, motion)
    rest = without(without(np.stack([error, shape]), motion), slope)
    crosses, (squares, owns) = sums(np.conj(rest[1]) * rest[0]), sums(np.abs(rest) ** 2)
    product, power = 0j, 0.0
    for index, (cross, own) in enumerate(zip(crosses, owns, strict=True)):
        reach = 0
        while sum(counts[max(index - reach, 0) : index + reach + 1]) < NOISE_LINES and reach < len(counts):
            reach += 1
        near = slice(max(index - reach, 0), index + reach + 1)
        variance = sum(squares[near]) / max(sum(counts[near]), 1)
        if variance > 0.0:
            product, power = product + complex(cross) / variance, power + float(own) / variance
    return product, power
