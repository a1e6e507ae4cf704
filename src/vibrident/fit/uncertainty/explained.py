"""Shares of the response's power: what the model explains, and what any linear sensor could.

The second is what the response has locally in common with the motion, which needs no model: of each block of bins what
no smooth response to the reference makes (:func:`vibrident.fit.noise.projection.without_common`, over its degrees of
freedom) is incoherent. A model that explains nothing may well be adequate in its own noise; this tells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy import fft

from vibrident.base.tails import f_tail
from vibrident.data.records import FloatArray
from vibrident.fit.bins.segments import shifted_lines
from vibrident.fit.descent.weighed import Weighed
from vibrident.fit.noise.projection import block_edges, without_common
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of

#: A model that explains less than this share of the response's power is not tested by it.
MIN_EXPLAINED = 0.1
#: A model may leave this share of the power …
MAX_LEFT = 0.01
#: … or this many times what is incoherent, or what chance leaves with this probability.
MAX_TIMES = 4.0
CHANCE = 1e-6


@dataclass(frozen=True)
class Shares:
    """Shares of the response's power.

    Attributes:
        explained: by the model.
        coherent: by any linear sensor.
        freedom: degrees of freedom of what is not.

    NaN is not known.
    """

    explained: float = float("nan")
    coherent: float = float("nan")
    freedom: float = 1.0

    @property
    def lacking(self) -> bool:
        """Whether the model explains much less than what is coherent, or little at all."""
        if self.explained < MIN_EXPLAINED:
            return True
        left = 1.0 - self.explained
        incoherent = 1.0 - self.coherent
        if not left > max(MAX_LEFT, MAX_TIMES * incoherent):
            return False
        ratio = left / max(incoherent, np.finfo(float).eps)
        return f_tail(self.freedom, self.freedom, ratio) <= CHANCE

    def __str__(self) -> str:
        """Return the sentence that a lacking model gets."""
        return (
            f"The model explains {100.0 * self.explained:.3g} % of the response's power, and "
            f"{100.0 * self.coherent:.3g} % of it has something in common with the motion."
        )


#: Of records without a reference.
UNKNOWN_SHARES = Shares()


def shares_of(parts: Sequence[FloatArray]) -> Shares:
    """Shares of all records together; ``parts``: of each by :func:`powers`."""
    power, left, incoherent, squares = np.sum(parts, axis=0) if len(parts) else np.zeros(4)
    if not power > 0.0:
        return UNKNOWN_SHARES
    # of exponential powers the sum of squares says how many there are (Satterthwaite 1946)
    freedom = 4.0 * incoherent**2 / max(squares, np.finfo(float).tiny)
    return Shares(
        max(1.0 - left / power, 0.0), max(1.0 - incoherent / power, 0.0), max(freedom, 1.0)
    )


def powers(bins: Weighed, reference: FloatArray, delay: float, band: slice) -> FloatArray:
    """Return power of the response in a band, of what the model leaves, of what is incoherent, and Σ of its squares.

    What noise of the reference makes of the prediction counts as not foretold, instead of twice: behind a
    displacement of eight bits it is more than the response.

    Args:
        bins: of the record.
        reference: about its mean, zero where it is not used, shape (samples,).
        delay: of the model, in samples.
        band: bins, of which line 0 is none.
    """
    lines = bins.residual.size
    samples = bins.samples
    turn = np.exp(-2j * np.pi * delay / samples * np.arange(lines))
    motion = _without_drift(np.asarray(fft.rfft(reference, samples))[:lines], samples) * turn
    response = _without_drift(bins.residual + bins.predicted, samples)
    level = np.sqrt(bins.spectrum.psd)
    rest, freedom = without_common(response[None], [motion[None]], level[None])
    begins = block_edges(lines)[:-1]
    wide = np.diff([*begins, lines])
    incoherent = power_of(rest[0])
    incoherent[1:] *= np.repeat(wide / np.maximum(np.add.reduceat(freedom[0], begins), 1.0), wide)
    left = power_of(bins.residual + _of_noise(bins) * bins.predicted)
    parts = power_of(response), left, incoherent, incoherent**2
    return np.array([np.sum(each[band]) for each in parts])


def _of_noise(bins: Weighed) -> FloatArray:
    """Return the share of a prediction, by its power in each bin, that noise of the reference makes.

    The rest is what can be foretold of the response from a noisy reference (Wiener 1949).
    """
    power = np.maximum(power_of(bins.predicted), np.finfo(float).tiny)
    return np.minimum(bins.passed_noise * bins.count / power, 1.0)


def _without_drift(lines: ComplexArray, samples: int) -> ComplexArray:
    """Lines less those of a straight drift, which leaks from the ends of the record; no offset."""
    w = shifted_lines(samples, slice(0, lines.size))
    drift = np.divide(1.0 + w, w, out=np.zeros_like(w), where=w != 0.0)
    share = float(np.vdot(drift, lines).real) / max(
        float(np.vdot(drift, drift).real), np.finfo(float).tiny
    )
    left = lines - share * drift
    left[:1] = 0.0
    return left
