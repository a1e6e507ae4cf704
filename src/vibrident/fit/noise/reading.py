"""Noise of records at the bins of their band, estimated from residuals of a model.

Noise of the response, white, 1/f and 1/f², and noise σx² of the reference, which passes the model:

    S(f) = a + c/f + d/f² + σx² g(f) |H(f)|²

by likelihood, with g one for white noise and ∝ f⁴ for an acceleration derived from a displacement.
Any other shape is added as the mean of the periodogram over the bins around, relative to this. The
estimate uses the component of the residual that is locally incoherent with the motion
(:mod:`vibrident.fit.noise.projection`): a wrong model does not produce noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.group.group import in_batches
from vibrident.fit.noise.averages import averaged_bins, log_power
from vibrident.fit.noise.incoherent import incoherent_component
from vibrident.fit.noise.lines import OUTSTANDING_RATIO, level_with_lines, lines_of_motion
from vibrident.fit.noise.projection import BLOCK_BINS
from vibrident.fit.noise.residuals import Residuals
from vibrident.fit.noise.shapes import (
    DOUBT_DEVIATIONS,
    by_amounts,
    flicker_of,
    no_input_noise,
    noise_of_shapes,
)
from vibrident.fit.noise.surroundings import level_of_noise, with_resonances
from vibrident.fit.noise.tones import tone_excess, tones_of
from vibrident.fit.response.transform import MIN_SPECTRUM_SAMPLES, power_of

#: Bins count where the prediction exceeds so many times that due to noise of the reference.
FAINT_RATIO = 2.0


@dataclass(frozen=True, eq=False)
class GroupNoise:
    """Noise of R records at K bins; one is white noise of unit variance.

    Attributes:
        psd: noise at each bin, shape (R, K).
        input_noise: σx² where it is significant, in squares of the residual's unit per |H|², else
            zero, shape (R,).
        input_noise_at: the same at each bin, with its colour: its share of the level there divided
            by |H|², shape (R, K).
        doubts: a, c, and the variances of a and c and their covariance, of the remaining σx² = a +
            c/k at bin k, shape (R, 5).
        colour: power of the reference's noise over its mean, one or shape (K,).
        excited: weight of each bin, shape (R, K): zero where noise of the reference alone could
            explain the prediction.
        tones: places of tones in the residual (hum of the mains), in bins, of each record.
        free: whether motion leaves bins free, in which noise of the reference shows, shape (R,).
        excess: by how much a tone may exceed the noise at each bin, shape (R, K); None where no
            record has tones, or bins are too few to tell.
    """

    psd: FloatArray
    input_noise: FloatArray
    input_noise_at: FloatArray
    doubts: FloatArray
    colour: FloatArray | float
    excited: FloatArray
    tones: tuple[tuple[float, ...], ...]
    free: BoolArray
    excess: FloatArray | None = None

    @property
    def excess_by_record(self) -> list[FloatArray] | list[None]:
        """Return the excess of each record, shape (K,); None where it is not known."""
        return [None] * len(self.psd) if self.excess is None else list(self.excess)

    @property
    def doubt(self) -> FloatArray:
        """Return σx² that may remain beyond ``input_noise`` (95 %) at each bin, shape (R, K)."""
        flicker = flicker_of(self.psd.shape[1])
        white, pink, white_variance, pink_variance, covariance = self.doubts.T[:, :, None]
        variance = white_variance + 2.0 * covariance * flicker + pink_variance * flicker**2
        level = white + pink * flicker
        level += DOUBT_DEVIATIONS * np.sqrt(np.maximum(variance, 0.0))
        return level * self.colour


def read_noise(rows: Residuals, last: int, colour: FloatArray | float = 1.0) -> GroupNoise:
    """Return the noise of records of one length and rate.

    Args:
        rows: their residuals.
        last: bins from here on do not count.
        colour: g, power of the reference's noise over its mean, one or shape (K,).
    """
    records, bins = rows.residual.shape
    last = max(min(last, bins - 1), 1)
    few_bins = last <= BLOCK_BINS or np.max(rows.count) < MIN_SPECTRUM_SAMPLES
    read = _read_one_level if few_bins else _read
    batches = [read(rows.records(batch), last, colour) for batch in in_batches(records, bins)]
    if len(batches) == 1:
        return batches[0]
    names = "psd", "input_noise", "input_noise_at", "doubts", "excited", "free"
    arrays = {name: np.concatenate([getattr(noise, name) for noise in batches]) for name in names}
    tones = tuple(places for noise in batches for places in noise.tones)
    excesses = [
        np.zeros_like(noise.psd) if noise.excess is None else noise.excess for noise in batches
    ]
    has_excess = any(noise.excess is not None for noise in batches)
    excess = np.concatenate(excesses) if has_excess else None
    return GroupNoise(colour=colour, tones=tones, excess=excess, **arrays)


def _read_one_level(rows: Residuals, last: int, colour: FloatArray | float) -> GroupNoise:
    """Return one level for each record, all that few bins can determine."""
    shape = rows.residual.shape
    squares = np.sum(power_of(rows.residual[:, 1 : last + 1]), axis=1, keepdims=True)
    fitted = 0.0 if rows.fitted is None else rows.fitted[:, None]
    unfitted = np.maximum(last - 0.5 * fitted, 0.5)  # half a bin for each number
    level = squares / (unfitted * rows.count[:, None])
    psd = np.broadcast_to(np.maximum(level, rows.floor[:, None]), shape)
    input_noise = no_input_noise(len(psd))
    if rows.through is not None:
        input_noise.doubts[:, :1] = psd[:, :1] / np.max(rows.through, axis=1, keepdims=True)
    zeros = np.zeros(shape)
    tones = ((),) * len(psd)
    return GroupNoise(
        psd,
        input_noise.variance,
        zeros,
        input_noise.doubts,
        colour,
        zeros + 1.0,
        tones,
        input_noise.free,
    )


def _read(rows: Residuals, last: int, colour: FloatArray | float) -> GroupNoise:
    """Return the noise of records."""
    count = rows.count[:, None]
    expected = power_of(rows.predicted)
    log_expected = log_power(expected)
    log_through = None if rows.through is None else log_power(rows.through)
    width = averaged_bins(expected.shape[1])
    lines = lines_of_motion(expected, log_expected, log_through, width)
    if rows.lines is not None:
        lines |= rows.lines
    incoherent = incoherent_component(rows, log_through)
    np.divide(incoherent.power, count, out=incoherent.power)
    shape, input_noise = noise_of_shapes(rows, incoherent, log_through, last)
    relative = np.divide(incoherent.power, shape, out=incoherent.power)
    smooth = level_of_noise(relative, incoherent.freedom)
    beside_tones = rows.residual, incoherent.noise, shape * smooth * count, lines
    tones = tones_of(*beside_tones)
    has_tones = any(tones) or any(rows.tones or ())
    excess = tone_excess(*beside_tones, incoherent.freedom) if has_tones else None
    if rows.lines is None:  # harmonics of a sine leak over as many bins
        smooth = with_resonances(smooth, relative, incoherent.freedom)
    hum = relative > OUTSTANDING_RATIO * smooth
    hum &= ~lines
    psd = shape * smooth
    np.multiply(shape, relative, out=psd, where=hum)
    np.maximum(psd, rows.floor[:, None], out=psd)
    if rows.fitted is not None:
        np.maximum(psd, _least_in_enough_bins(psd[:, 1 : last + 1], rows.fitted), out=psd)
    excited = np.ones(psd.shape)
    if rows.through is not None:
        # Excess of the prediction over that due to noise of the reference.
        level = level_with_lines(expected, log_expected, width)
        level /= count
        excited -= FAINT_RATIO * psd / np.maximum(level, 1e-300)
        np.maximum(excited, 0.0, out=excited)
    smooth *= by_amounts(input_noise.amounts, psd.shape[1])
    smooth *= colour
    return GroupNoise(
        psd,
        input_noise.variance,
        smooth,
        input_noise.doubts,
        colour,
        excited,
        tones,
        input_noise.free,
        excess,
    )


def _least_in_enough_bins(psd: FloatArray, fitted: FloatArray) -> FloatArray:
    """Return the noise of the quietest bins, as many as numbers were fitted, shape (R, 1).

    Noise that is less in fewer bins shows nowhere: the fit follows these, whatever their noise.
    """
    places = np.minimum(fitted.astype(int), psd.shape[1] - 1)
    return np.take_along_axis(np.sort(psd, axis=1), places[:, None], axis=1)
