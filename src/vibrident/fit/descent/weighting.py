"""Noise of all segments at an iterate, as weights of their bins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.bins.segments import TONE_COLUMNS
from vibrident.fit.descent.in_noise import GroupAt, GroupWeights, fitted_numbers
from vibrident.fit.group.group import Grid, Group
from vibrident.fit.noise.projection import BLOCK_BINS
from vibrident.fit.noise.reading import read_noise
from vibrident.fit.noise.residuals import Residuals
from vibrident.fit.noise.spectrum import NoiseSpectrum
from vibrident.fit.noise.tones import (
    RecordTones,
    located,
    resonant_bins,
    with_shared_tones,
    with_tones,
)
from vibrident.fit.problem.band import Band
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of, reference_colour
from vibrident.fit.start.motion_and_noise import MotionAndNoise

#: Noise is steep where some bins have less than this fraction of the mean.
MAX_STEEP_RATIO = 0.01
#: Smallest noise of the response over its sum with that of the reference.
MIN_RESPONSE = 1e-6


@dataclass(frozen=True, eq=False)
class SegmentNoise:
    """Noise of a segment.

    Attributes:
        spectrum: of the noise.
        passed: |H|² where it was estimated, shape (K,).
        samples: of the segment where it was estimated.
    """

    spectrum: NoiseSpectrum
    passed: FloatArray
    samples: int

    def spectrum_at(self, grid: Grid) -> NoiseSpectrum:
        """Return the noise at the bins of a grid."""
        names = "psd", "input_noise_at", "doubt", "excited"
        rows = {name: grid.resampled(getattr(self.spectrum, name), self.samples) for name in names}
        tones = tuple(tone * (grid.samples / self.samples) for tone in self.spectrum.tones)
        return replace(self.spectrum, tones=tones, **rows)

    def at_bins(self, grid: Grid) -> FloatArray:
        """Return noise, that of the reference, |H|² and excited at the bins of a grid, (4, K)."""
        spectrum = self.spectrum
        rows = (spectrum.psd, spectrum.input_noise_at, self.passed, spectrum.excited)
        return np.stack([grid.resampled(values, self.samples) for values in rows])


@dataclass(frozen=True, eq=False)
class Weighting:
    """Noise of every segment, by its number."""

    segments: Mapping[int, SegmentNoise]

    def of_segment(self, number: int) -> SegmentNoise:
        """Return the noise of a segment; another delay may have added one, which is as the last."""
        return self.segments[min(number, len(self.segments) - 1)]

    def in_all_bins(self) -> Weighting:
        """Return the same noise where every bin counts, as if each showed motion."""
        return Weighting(
            {
                number: replace(
                    noise,
                    spectrum=replace(noise.spectrum, excited=np.ones_like(noise.spectrum.excited)),
                )
                for number, noise in self.segments.items()
            }
        )

    def of_groups(self, band: Band) -> list[GroupWeights]:
        """Return the weights of each group."""
        weights = []
        for group in band.groups:
            rows = [self.of_segment(number).at_bins(group.grid) for number in group.segments]
            psd, reference, passed, excited = np.stack(rows, axis=1)
            response = np.maximum(psd - reference * passed, MIN_RESPONSE * psd)
            weights.append(GroupWeights(response, reference, excited))
        return weights

    def with_nuisances(self, band: Band) -> Band:
        """Return the band with tones of hum, and leakage in steep noise, as nuisances."""
        problem = band.problem
        noises = [self.of_segment(number) for number in range(len(problem.segments))]
        steep = any(is_steep(noise.spectrum) for noise in noises)
        tones = [noise.spectrum.tones for noise in noises]
        return band.with_nuisances(tones, edges=steep)


def is_steep(spectrum: NoiseSpectrum) -> bool:
    """Return whether noise is so much less in some bins that leakage into these counts."""
    lowest = float(np.min(spectrum.psd))
    return spectrum.input_noise > 0.0 or lowest < MAX_STEEP_RATIO * float(np.mean(spectrum.psd))


def read_weighting(
    band: Band, places: Sequence[GroupAt], observed: MotionAndNoise | None
) -> Weighting:
    """Return the noise of every segment from the residuals at an iterate.

    Args:
        band: the segments.
        places: the groups at the iterate.
        observed: where motion shows. Elsewhere the component of a residual that is coherent with
            the reference is noise of that. None: where the response is loud.
    """
    floors = band.problem.noise_floor**2
    segments: dict[int, SegmentNoise] = {}
    tones: dict[int, RecordTones] = {}
    for place, fitted in zip(places, fitted_numbers(places), strict=True):
        group = place.group
        squares = power_of(place.through)
        colour = _colour(band, group)
        in_all_bins = place.fitted_in_all_bins
        residual = in_all_bins.residual.copy()
        residual[:, 0] = np.abs(residual[:, 1])
        rows = Residuals(
            residual,
            in_all_bins.predicted,
            group.count,
            floors[band.owners(group)],
            fitted=fitted,
            unfitted=in_all_bins.unfitted,
            free_motion=_narrow_free_motion(place),
            tones=(group.grid.tones,) * len(residual),
        )
        if group.grid.driven:
            reference = group.inputs[:, 0]
            rows = replace(
                rows,
                through=(squares * colour)[None],
                reference=reference,
                passed=place.through * reference,
                heard=None if observed is None else observed.heard_in(group),
            )
        noise = read_noise(rows, group.grid.last - 1, colour)
        bin_hz = group.grid.rate_hz / group.grid.samples
        spectra = NoiseSpectrum.by_record(noise)
        resonant = resonant_bins(squares) if group.grid.driven else None
        for number, spectrum, known in zip(
            group.segments, spectra, _known_tones(place), strict=True
        ):
            segments[number] = SegmentNoise(spectrum, squares, group.grid.samples)
            tones[number] = spectrum.record_tones(bin_hz, known, resonant)
    shared_tones = with_shared_tones(list(tones.values()))
    for number, tones_of_segment in zip(tones, shared_tones, strict=True):
        noise = segments[number]
        spectrum = replace(noise.spectrum, tones=tones_of_segment)
        segments[number] = replace(noise, spectrum=spectrum)
    return Weighting(segments)


def _narrow_free_motion(place: GroupAt) -> ComplexArray | None:
    """Return the columns of the free motion, shape (R, n, K); None unless a block holds most of it.

    Otherwise what is smooth in frequency makes up for it nearly as well.
    """
    columns = place.rows.nuisances.columns[:, : place.rows.order]
    power = np.sum(power_of(columns), axis=(0, 1))[1:]
    if not power.size or 2.0 * np.max(
        np.add.reduceat(power, range(0, power.size, BLOCK_BINS))
    ) < np.sum(power):
        return None
    return np.broadcast_to(columns, (len(place.rows.residual), *columns.shape[1:]))


def _known_tones(place: GroupAt) -> list[tuple[float, ...]]:
    """Return where the tones of each segment are, in bins, by the phases that were fitted.

    The strongest come first; of two that have met, the weaker was none.
    """
    grid = place.group.grid
    first = place.rows.order + len(grid.fixed_nuisances) - TONE_COLUMNS * len(grid.tones)
    places: list[tuple[float, ...]] = []
    for row, amounts in enumerate(place.fitted_in_all_bins.amounts):
        columns = place.rows.nuisances.of_row(row)
        tones: list[tuple[float, float]] = []
        for number, tone in enumerate(grid.tones):
            of_tone = slice(first + TONE_COLUMNS * number, first + TONE_COLUMNS * (number + 1))
            lines = amounts[of_tone] @ columns[of_tone]
            signal = np.fft.irfft(lines, grid.samples)
            tones.append((float(np.std(signal)), located(tone, signal)))
        strongest_first = tuple(tone for _, tone in sorted(tones, reverse=True))
        places.append(with_tones((), strongest_first))
    return places


def _colour(band: Band, group: Group) -> FloatArray | float:
    """Return the power of the reference's own noise over its mean, one or shape (K,)."""
    record = band.problem.records[band.owners(group)[0]]
    colour = reference_colour(record, group.grid.samples)
    return colour[: group.grid.bins] if isinstance(colour, np.ndarray) else float(colour)
