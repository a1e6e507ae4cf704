"""What of a time residual is coherent with the predicted response, by narrow bands."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy import fft
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from vibrident.base.fft_lengths import fast_below
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.data.records.basis import distinct, span_of
from vibrident.fit.response.alignment import MOST_CUT, TINY
from vibrident.fit.response.bands import LEAST_POWER, LINES_IN_BAND, band_edges, power_and_coherence
from vibrident.fit.response.response import LEAST_DEVIATION, ComplexArray
from vibrident.fit.response.transform import MOST_KEPT, hann, power_of, transforms, waves

#: Stretches of time, half of each the next one's too, that tell how noise changes.
STRETCHES = 15
#: A band moves steadily where its power is spread over this part of them; that of a sweep is in one or two.
STEADY = 0.25
#: Groups of the lines of a stretch.
GROUPS = 16
#: A group is without motion below this part of the residual's power.
STILL = 0.1
#: Fewer groups without motion tell nothing.
FEWEST_STILL = 3
#: A band of which less than this part stays under a window holds what leaks over from others, residual and
#: prediction alike: both begin and end in the middle of a motion.
OWN_POWER = 0.8
#: Square of the correlation of a line under the window (Hann) with the next on either side, both together.
NEXT = 2.0 * (2.0 / 3.0) ** 2
#: The same with the one after the next.
AFTER = 2.0 * (1.0 / 6.0) ** 2
#: Chance that such a band has nothing in common with the response.
IN_COMMON = 1e-4
#: Part of the record at either end whose power says how much leaks …
ENDS = 1.0 / 64.0
#: … which counts above this part of a band's power.
LEAKED = 0.02
#: A band is not used if noise of the reference makes up more than this part of the prediction.
MOST_SHARED = 0.3


def coherent_remainder(
    record: Record,
    predicted: FloatArray,
    through: FloatArray | None = None,
    hum_hz: Sequence[float] = (),
    least: FloatArray | None = None,
) -> tuple[FloatArray, NDArray[np.complex128], FloatArray, FloatArray] | None:
    """What of a time residual is coherent with the predicted response, by narrow bands.

    With E and Ŷ the spectra of residual and prediction, ρ = Σ E Ŷ*/Σ |Ŷ|² is the relative error of the model's response
    in the band; the rest of E gives its deviation.

    Args:
        record: measured response.
        predicted: shape (samples,), NaN where it is not defined.
        through: variance, a sample, of noise of the reference channel itself, after the model's |H|², at
            the spectral lines of the record, shape (samples // 2 + 1,). Such noise is in E and in Ŷ, with opposite
            signs; it is allowed for, and bands that hold little else are left out.
        hum_hz: tones that are known not to come from the motion; they are removed from the residual.
        least: variance, a sample, that no noise is believed to be below, at the lines as ``through``.

    Returns:
        Frequencies, ρ, standard deviation of the real part of ρ, degrees of freedom; each of shape (bands,). None
        where no band holds enough of the response.
    """
    used = record.mask & np.isfinite(predicted)
    if used.sum() < 8 * LINES_IN_BAND:
        return None
    n, rate = record.samples, record.sampling_rate_hz
    left = _without(np.where(used, record.response - predicted, 0.0), used, hum_hz, rate)
    # No window: white noise then has independent lines, whenever in the record the motion passes a band.
    motion = np.where(used, predicted - np.mean(predicted[used]), 0.0)
    spectra = transforms((motion, left))
    edges = band_edges(n, rate).astype(int)
    there, even, steady = noise_where_bands_move(left, motion, used, edges)
    totals = np.add.reduceat(power_of(spectra[0])[: edges[-1]], edges[:-1])
    strongest = float(np.max(totals / np.diff(edges)))
    leaking = steady & _leaking(motion, used, totals, edges)
    if np.any(leaking):
        little = _leaves_little(record.response, used, edges)
        series = _faded(motion, used), _faded(left, used)
        del motion, left  # of a long record each copy counts
        faded = transforms(series)
        del series
        stays = np.add.reduceat(power_of(faded[0])[: edges[-1]], edges[:-1])
        common = _in_common(faded[0], faded[1], edges)
        leaking &= (stays < OWN_POWER * totals) & (common | little)
        totals = np.where(leaking, np.where(common, stays, 0.0), totals)
        np.copyto(spectra[:, : edges[-1]], faded[:, : edges[-1]], where=_each_line(leaking, edges))
        del faded
    spectrum, error = spectra[:, : edges[-1]]
    lines, count, whole = np.diff(edges), float(used.sum()), float(np.mean(used))

    def sums(values: Any) -> Any:
        return np.add.reduceat(values[: edges[-1]], edges[:-1])

    shared = np.zeros(len(lines)) if through is None else count * sums(through)
    kept = (totals > LEAST_POWER * strongest * lines) & (shared <= MOST_SHARED * totals)
    total = np.where(kept, totals, 1.0)
    rho = (sums(np.conj(spectrum) * error) + shared) / total
    error -= _each_line(np.where(kept & (shared == 0.0), rho, 0.0), edges) * spectrum
    rest = sums(power_of(error))
    alike = np.where(leaking, _alike(lines), 1.0)
    freedom = 2.0 * np.maximum(lines * whole * even - np.where(leaking, 2.0, 1.0), 1.0)
    floor = LEAST_DEVIATION**2 * strongest * lines / total  # relative to the record's strongest band
    if least is not None:
        floor = np.maximum(floor, count * sums(least) / lines / total / 2.0)
    # Of the band's noise so much is what ρ took: as much as there is while the band moves.
    variance = there * alike * rest / np.maximum(lines - alike * there, 1.0) / total / 2.0
    variance = np.maximum(variance, floor)
    kept &= variance <= 0.25
    if not kept.any():
        return None
    moved = power_of(spectrum)
    centre = sums(np.arange(moved.size) * moved) / total * rate / n
    return centre[kept], rho[kept], np.sqrt(variance[kept]), freedom[kept]


def _each_line(bands: NDArray[Any], edges: NDArray[np.int_]) -> NDArray[Any]:
    """What bands hold, at each of the lines up to the last band's end; zero before the first band."""
    return np.concatenate([np.zeros(edges[0], bands.dtype), np.repeat(bands, np.diff(edges))])


def noise_where_bands_move(
    left: FloatArray, motion: FloatArray, used: BoolArray, edges: NDArray[np.int_]
) -> tuple[FloatArray, float, BoolArray]:
    """Noise power while each band moves, over its mean over the record, how even the noise is, and which move steadily.

    A sweep passes a band in a moment; where noise grows within the record, that moment is not as noisy as the rest.
    The noise of a stretch of time is read where there is no motion, so that no misfit counts; one where all moves.

    Args:
        left: residual, zero where not used, shape (samples,).
        motion: predicted response, zero where not used, shape (samples,).
        used: shape (samples,).
        edges: first line of each band and the end of the last, shape (bands + 1,).

    Returns:
        The ratio, shape (bands,); the independent lines among those of a band, as a part: lines of noise that changes
        with time are alike; and the bands that move all along the record, shape (bands,), not in passing as in a sweep.
    """
    span = span_of(used)
    length = fast_below(2 * ((span.stop - span.start) // (STRETCHES + 1)), MOST_CUT)
    window, last = hann(length), int(0.45 * length)
    groups = distinct(np.linspace(1, last, GROUPS + 1).astype(int))
    first = np.minimum(edges[:-1] * length // left.size, last - 1)
    end = np.maximum(-(-edges[1:] * length // left.size), first + 1)
    noise, moves = np.zeros((STRETCHES, len(groups) - 1)), np.zeros((STRETCHES, len(first)))
    still = np.zeros(noise.shape, dtype=bool)
    begins = span.start + np.arange(STRETCHES) * length // 2
    counts = np.concatenate([[0], np.cumsum(used)])
    whole = np.maximum((counts[begins + length] - counts[begins]) / length, 1e-9)[:, None]
    together = STRETCHES if left.size <= MOST_KEPT else 1  # of a long record each copy counts
    for row in range(0, STRETCHES, together):
        some = slice(row, row + together)
        parts = [window * sliding_window_view(one, length)[begins[some]] for one in (left, motion)]
        own, moving = (power_of(np.asarray(fft.rfft(part), dtype=complex)) for part in parts)
        noise[some] = np.add.reduceat(own[:, :last], groups[:-1], axis=1) / whole[some]
        still[some] = np.add.reduceat(moving[:, :last], groups[:-1], axis=1) < STILL * noise[some]
        total = np.cumsum(np.pad(moving, ((0, 0), (1, 0))), axis=1)
        moves[some] = total[:, end] - total[:, first]
    steady = np.sum(moves, axis=0) ** 2 > STEADY * STRETCHES * np.sum(moves**2, axis=0)
    kept = still.all(axis=0)
    if kept.sum() < FEWEST_STILL:
        return np.ones(len(first)), 1.0, steady
    level = np.median(noise[:, kept] / np.maximum(np.mean(noise[:, kept], axis=0), 1e-300), axis=1)
    # A stretch alone tells its noise to a quarter: over five it changes smoothly.
    level = np.convolve(np.pad(level, 2, mode="reflect", reflect_type="odd"), np.full(5, 0.2), mode="valid")
    level = np.maximum(level, 1e-300)
    shares = moves / np.maximum(np.sum(moves, axis=0), 1e-300)
    found = level @ shares / max(float(np.mean(level)), 1e-300)
    even = float(np.mean(level)) ** 2 / float(np.mean(level**2))
    return np.where(found > 0.0, np.clip(found, 1.0 / STRETCHES, STRETCHES), 1.0), even, steady


def _leaking(motion: FloatArray, used: BoolArray, totals: FloatArray, edges: NDArray[np.int_]) -> BoolArray:
    """Bands that may hold hardly more than what leaks over from others, shape (bands,).

    A record that begins and ends in the middle of a motion cuts its tones off: each leaks over all lines, as 1/d² at a
    distance of d. Such a band fits whatever the model, as residual and prediction leak alike.

    Args:
        motion: prediction, zero where not used, shape (samples,).
        used: shape (samples,).
        totals: its power in each band, shape (bands,).
        edges: first line of each band and the end of the last, shape (bands + 1,).
    """
    own, width = motion[span_of(used)], max(int(ENDS * motion.size), 1)
    cut = 0.5 * float(np.mean(own[:width] ** 2) + np.mean(own[-width:] ** 2)) / max(float(np.mean(own**2)), TINY)
    leaked = 0.5 * cut * _passed_on(tuple(edges.tolist())) @ (totals / np.diff(edges)) / np.pi**2
    return leaked > LEAKED * totals


def _faded(series: FloatArray, used: BoolArray) -> FloatArray:
    """A series under a window by which nothing leaks far, of the same power where it is steady."""
    span, faded = span_of(used), np.zeros(series.size)
    faded[span] = np.sqrt(8.0 / 3.0) * hann(span.stop - span.start) * series[span]
    return faded


def _leaves_little(response: FloatArray, used: BoolArray, edges: NDArray[np.int_]) -> BoolArray:
    """Bands of which the window leaves little of the response, too, shape (bands,).

    A wrong prediction may have nothing of its own where the response moves.
    """
    centred = np.where(used, response - np.mean(response[used]), 0.0)
    stays, whole = (
        np.add.reduceat(power_of(transforms((part,))[0, : edges[-1]]), edges[:-1])
        for part in (_faded(centred, used), centred)
    )
    return np.asarray(stays < OWN_POWER * whole)


def _in_common(motion: ComplexArray, error: ComplexArray, edges: NDArray[np.int_]) -> BoolArray:
    """Bands in which prediction and response agree by more than chance, under the window; shape (bands,).

    Without motion the prediction holds noise of the reference alone, of which the response knows nothing.
    """
    apart = 1.0 - np.minimum(power_and_coherence(motion, motion + error, edges)[1], 1.0)
    lines = np.diff(edges)
    return apart ** np.maximum(lines / _alike(lines) - 1.0, 0.0) < IN_COMMON


def _alike(lines: Any) -> Any:
    """Lines under the window that say as much as one without it."""
    return 1.0 + NEXT * (1.0 - 1.0 / lines) + AFTER * (1.0 - 2.0 / lines)


@functools.lru_cache(maxsize=8)
def _passed_on(edges: tuple[int, ...]) -> FloatArray:
    """∫∫ dk dl/(k − l)² over the lines of each band and each other, those next to each other a line apart."""
    low, high = np.array(edges[:-1], dtype=float)[:, None], np.array(edges[1:], dtype=float)[:, None]
    above = low >= high.T  # the one is above the other
    gap = np.where(above, low - high.T, low.T - high) + 1.0
    far = np.where(above, high - low.T, high.T - low) + 1.0
    both = (np.abs(low - low.T) + 1.0) * (np.abs(high - high.T) + 1.0)
    return np.where(np.eye(low.size, dtype=bool), 0.0, np.log(both / np.maximum(gap * far, 1.0)))


def _without(residual: FloatArray, used: BoolArray, hum_hz: Sequence[float], rate: float) -> FloatArray:
    """The residual, zero where not used, without a straight line, and these tones, as the fit has them.

    Each tone may drift a little in size and phase, as one of inexact frequency does.
    """
    line = np.stack([np.ones(used.size), np.linspace(-1.0, 1.0, used.size)])
    line *= used

    def levelled(rows: FloatArray) -> FloatArray:
        return np.asarray(rows - np.linalg.solve(line @ line.T, line @ rows.T).T @ line)

    left = levelled(residual)
    if not len(hum_hz):
        return left
    tones = levelled(waves(np.multiply(hum_hz, used.size / rate), used.size) * used)
    return left - np.linalg.lstsq(tones.T, left, rcond=1e-9)[0] @ tones
