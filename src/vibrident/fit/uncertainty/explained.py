"""Shares of the response's power: what the model explains, and what any linear sensor could.

The second share is at least the first, as the model is a linear sensor, and needs no model beyond
that. In each block of bins the part of the response that no smooth response to the reference makes
is incoherent (:func:`vibrident.fit.noise.projection.without_common`, over its degrees of freedom);
the remainder is coherent. A model that explains nothing may be adequate in its own noise; the
shares show it.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy import fft

from vibrident.base.tails import f_tail
from vibrident.data.records import FloatArray
from vibrident.fit.bins.segments import shifted_lines
from vibrident.fit.descent.weighted_bins import WeightedBins
from vibrident.fit.noise.lines import noise_in_prediction
from vibrident.fit.noise.projection import block_edges, without_common
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of

#: A model that explains less than this share of the response's power is not tested by it.
MIN_EXPLAINED = 0.1
#: A model may leave this share of the power unexplained …
MAX_UNEXPLAINED = 0.01
#: … or this many times the incoherent share, or as much as chance leaves with this probability.
MAX_INCOHERENT_RATIO = 4.0
MIN_PROBABILITY = 1e-6
#: A response that is incoherent over more powers than this is no ringing within some bins.
MAX_RINGING_FREEDOM = 100.0
#: A sensor that changes leaves as much incoherent with the motion as its best model leaves
#: unexplained. Where more than half of that is coherent, no change makes it half.
MIN_INCOHERENT_MISFIT = 0.5


@dataclass(frozen=True)
class Shares:
    """Shares of the response's power; NaN where not known.

    Attributes:
        explained: by the model.
        coherent: by any linear sensor, the model or one with a smooth response; never less.
        freedom: degrees of freedom of what is not coherent.
    """

    explained: float = float("nan")
    coherent: float = float("nan")
    freedom: float = 1.0

    @property
    def lacking(self) -> bool:
        """Return whether the model explains little, or much less than the coherent share."""
        if self.explained < MIN_EXPLAINED:
            return True
        unexplained = 1.0 - self.explained
        incoherent = 1.0 - self.coherent
        if not unexplained > max(MAX_UNEXPLAINED, MAX_INCOHERENT_RATIO * incoherent):
            return False
        ratio = unexplained / max(incoherent, np.finfo(float).eps)
        return f_tail(self.freedom, self.freedom, ratio) <= MIN_PROBABILITY

    @property
    def is_incoherent(self) -> bool:
        """Return whether no smooth response to the motion explains enough to be tested."""
        return self.coherent < MIN_EXPLAINED

    @property
    def may_rise(self) -> bool:
        """Return whether other parameters may explain more.

        They do not where nothing is coherent. Ringing in a resonance narrower than a bin looks
        incoherent, too, but within few bins.
        """
        return not (self.is_incoherent and self.freedom > MAX_RINGING_FREEDOM)

    @property
    def is_of_steady_sensor(self) -> bool:
        """Return whether a steady sensor can explain what the model leaves.

        Less than MIN_INCOHERENT_MISFIT of it is incoherent then. This holds for stationary motion;
        a sweep shows each frequency at another time, so that any change looks coherent.
        """
        return self.incoherent_misfit < MIN_INCOHERENT_MISFIT

    @property
    def incoherent_misfit(self) -> float:
        """Return the share of what the model leaves that no steady sensor explains."""
        return (1.0 - self.coherent) / max(1.0 - self.explained, np.finfo(float).tiny)

    def __str__(self) -> str:
        """Return the sentence on a model that explains too little."""
        return (
            f"The model explains {100.0 * self.explained:.3g} % of the response's power, and "
            f"{100.0 * self.coherent:.3g} % of it has something in common with the motion."
        )


#: Shares of records without a reference.
UNKNOWN_SHARES = Shares()


def shares_of(parts: Sequence[FloatArray]) -> Shares:
    """Return the shares of all records together; ``parts``: of each by :func:`powers`."""
    sums = np.sum(parts, axis=0) if len(parts) else np.zeros(4)
    power, unexplained, incoherent, squares = sums.tolist()
    if not power > 0.0:
        return UNKNOWN_SHARES
    # Of exponential powers the sum of squares says how many there are (Satterthwaite 1946).
    freedom = 4.0 * incoherent**2 / max(squares, np.finfo(float).tiny)
    # A resonance narrower than a block is not smooth in it, but the model explains its response.
    incoherent = min(incoherent, unexplained)
    return Shares(
        max(1.0 - unexplained / power, 0.0), max(1.0 - incoherent / power, 0.0), max(freedom, 1.0)
    )


def powers(
    bins: WeightedBins,
    reference: FloatArray,
    measured: FloatArray,
    delay: float,
    band: slice,
    *,
    where_excited: bool = False,
) -> FloatArray:
    """Return powers of the response in a band, shape (4,): the summands of :func:`shares_of`.

    They are the power of the response, of what the model leaves and of what is incoherent, and the
    squares of the last summed over the bins. A bin counts as far as its prediction is no noise of
    the reference: elsewhere nothing tells what the model explains. The part of the prediction that
    this noise makes counts as unexplained once, not twice: behind a displacement of eight bits it
    exceeds the response. A drift or hum among the nuisances is no response. But no more is
    explained than was measured, that noise apart, and no more of it is incoherent: nuisances may
    cancel a wrong prediction of any size.

    Args:
        bins: of the record.
        reference: about its mean, zero where it is not used, shape (samples,).
        measured: the response, likewise.
        delay: of the model, in samples.
        band: bins, of which line 0 is none.
        where_excited: whether only bins with motion count, as of a sine: elsewhere the fit's
            nuisance parameters may be of any size.
    """
    lines = bins.residual.size
    samples = bins.samples
    delay_phase = np.exp(-2j * np.pi * delay / samples * np.arange(lines))
    motion = _without_drift(fft.rfft(reference, samples)[:lines], samples) * delay_phase
    excited = bins.spectrum.excited > 0.5
    counted = excited if where_excited and excited.any() else np.ones_like(excited)
    response = _without_drift((bins.residual + bins.predicted) * counted, samples)
    measured_lines = _without_drift(fft.rfft(measured, samples)[:lines], samples)
    if np.sum(power_of(response[band])) > np.sum(power_of(measured_lines[band])):
        response = measured_lines * counted
    deviation = np.sqrt(bins.spectrum.psd)
    incoherent_lines, freedom = without_common(response[None], [motion[None]], deviation[None])
    begins = block_edges(lines)[:-1]
    widths = np.diff([*begins, lines])
    incoherent = power_of(incoherent_lines[0])
    incoherent[1:] *= np.repeat(
        widths / np.maximum(np.add.reduceat(freedom[0], begins), 1.0), widths
    )
    expected = power_of(bins.predicted)
    noise_share = noise_in_prediction(expected[None], (bins.passed_noise * bins.count)[None])[0]
    unexplained = power_of(bins.residual + noise_share * bins.predicted)
    measured_power = power_of(measured_lines) + noise_share * expected
    known = counted * (1.0 - noise_share)
    incoherent *= known
    bin_powers = (
        known * power_of(response),
        known * unexplained,
        incoherent,
        incoherent**2,
        known * measured_power,
    )
    sums = np.array([np.sum(bin_power[band]) for bin_power in bin_powers])
    sums[0] = min(sums[0], sums[-1])
    return sums[:-1]


def _without_drift(lines: ComplexArray, samples: int) -> ComplexArray:
    """Return the lines without offset and without a straight drift, which leaks into all lines."""
    drift, power = _drift(samples, lines.size)
    share = float(np.vdot(drift, lines).real) / power
    detrended = lines - share * drift
    detrended[:1] = 0.0
    return detrended


@functools.lru_cache(maxsize=8)
def _drift(samples: int, lines: int) -> tuple[ComplexArray, float]:
    """Return the lines of a straight drift, shape (lines,), and their power."""
    shifted = shifted_lines(samples, slice(0, lines))
    drift = np.divide(1.0 + shifted, shifted, out=np.zeros_like(shifted), where=shifted != 0.0)
    return drift, max(float(np.vdot(drift, drift).real), float(np.finfo(float).tiny))
