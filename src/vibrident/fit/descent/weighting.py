"""The noise of all segments at an iterate, as weights of their bins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.descent.in_noise import GroupAt, GroupWeights
from vibrident.fit.group.band import Band
from vibrident.fit.noise.motion import Motion
from vibrident.fit.noise.spectrum import TONES, NoiseSpectrum, noise_spectra
from vibrident.fit.response.transform import SHORTEST, power_of, reference_colour

#: Noise is steep where some bins have so much less than the mean.
STEEP = 0.01
#: Smallest noise of the response beside that of the reference, a part of their sum.
MIN_RESPONSE = 1e-6

#: Noise of each segment, by its number.
Spectra = Mapping[int, NoiseSpectrum]


@dataclass(frozen=True, eq=False)
class Weighting:
    """Noise of every segment.

    Attributes:
        spectra: by number of the segment.
        passed: |H|² of each where it was read, by number of the segment.
        floors: lower limit of the noise's variance of each record, shape (records,).
    """

    spectra: Spectra
    passed: Mapping[int, FloatArray]

    def of_groups(self, band: Band) -> list[GroupWeights]:
        """Return the weights of each group."""
        every = []
        for group in band.groups:
            own = [self.spectra[number] for number in group.segments]
            psd = np.stack([spectrum.psd for spectrum in own])
            reference = np.stack([spectrum.input_noise_at for spectrum in own])
            passed = np.stack([self.passed[number] for number in group.segments])
            response = np.maximum(psd - reference * passed, MIN_RESPONSE * psd)
            excited = np.stack([spectrum.excited for spectrum in own])
            every.append(GroupWeights(response, reference, excited))
        return every

    def beside(self, band: Band) -> Band:
        """Return the band with tones of hum, and what leaks in steep noise, as nuisances."""
        spectra = [self.spectra[number] for number in range(len(self.spectra))]
        steep = any(is_steep(spectrum) for spectrum in spectra)
        return band.beside([spectrum.tones for spectrum in spectra], edges=steep)


def is_steep(spectrum: NoiseSpectrum) -> bool:
    """Return whether noise is so much less in some bins that what leaks into these counts."""
    least = float(np.min(spectrum.psd))
    return spectrum.input_noise > 0.0 or least < STEEP * float(np.mean(spectrum.psd))


def read_weighting(
    band: Band, places: Sequence[GroupAt], heard: Mapping[int, BoolArray]
) -> Weighting:
    """Read the noise of every segment from the residuals at an iterate.

    Args:
        band: the segments.
        places: the groups at the iterate.
        heard: bins at which motion shows, by number of the segment. Elsewhere what a residual has
            in common with the reference is noise of that.
    """
    floors = band.problem.noise_floor**2
    spectra: dict[int, NoiseSpectrum] = {}
    passed: dict[int, FloatArray] = {}
    for at in places:
        group = at.group
        squares = power_of(at.through)
        residuals = at.rows.residual.copy()
        residuals[:, 0] = np.abs(residuals[:, 1])
        last = group.grid.last - 1
        motions = []
        limits = [float(floors[owner]) for owner in band.owners(group)]
        for row, number in enumerate(group.segments):
            record = band.problem.records[band.problem.segments[number].record]
            colour = reference_colour(record, group.grid.samples)
            if not isinstance(colour, float):
                colour = colour[: group.grid.bins]
            motions.append(
                Motion.of(
                    at.rows.predicted[row].__getitem__,
                    float(group.count[row]),
                    None if record.reference is None else squares * colour,
                    colour,
                    last,
                    group.inputs[row, 0],
                    heard[number],
                )
            )
            passed[number] = squares
        if group.grid.samples < SHORTEST:
            own = [
                _of_few(at, row, motion, limit)
                for row, (motion, limit) in enumerate(zip(motions, limits, strict=True))
            ]
        else:
            own = noise_spectra(list(residuals), motions, limits)
        for number, spectrum in zip(group.segments, own, strict=True):
            known = group.grid.tones
            tones = (known + spectrum.tones)[:TONES]
            spectra[number] = replace(spectrum, tones=tones)
    return Weighting(spectra, passed)


def _of_few(at: GroupAt, row: int, motion: Motion, floor: float) -> NoiseSpectrum:
    """Return the noise of a segment of too few bins: all of one level."""
    counts = at.group.grid.counts
    power = float(counts @ power_of(at.rows.residual[row]))
    freedom = float(np.sum(counts)) * motion.count - at.rows.nuisances.shape[1]
    level = max(power / max(freedom, 1.0), floor)
    through = motion.through
    most = 0.0 if through is None else level / float(np.max(through))
    shape = counts.shape
    flat, nothing, full = (np.broadcast_to(value, shape) for value in (level, 0.0, 1.0))
    doubt = np.broadcast_to(most * motion.colour, shape)
    return NoiseSpectrum(flat, 0.0, nothing, lambda: doubt, full)
