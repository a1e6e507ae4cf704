"""Noise of the residual of one record at each bin, and its component from the reference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.noise.reading import GroupNoise, read_noise
from vibrident.fit.noise.residuals import Residuals
from vibrident.fit.noise.tones import RecordTones, with_shared_tones
from vibrident.fit.response.response import ComplexArray


@dataclass(frozen=True, eq=False)
class NoiseSpectrum:
    """Noise at the bins of a residual; one is white noise of unit variance.

    Attributes:
        psd: noise at each bin, shape (K,).
        input_noise: σx² if significant, in squares of the residual's unit per |H|²; else zero.
        input_noise_at: the same at each bin, with its colour and level there, shape (K,).
        doubt: σx² that may remain in addition (95 %) at each bin, shape (K,).
        excited: weight of each bin, shape (K,): zero where noise of the reference alone could
            explain the prediction.
        tones: places of tones in the residual (hum of the mains), in bins and fractions of one.
        free: whether the motion leaves bins free, in which noise of the reference would show.
        excess: by how much a tone may exceed the noise at each bin, shape (K,); None without tones.
    """

    psd: FloatArray
    input_noise: float
    input_noise_at: FloatArray
    doubt: FloatArray
    excited: FloatArray
    tones: tuple[float, ...] = ()
    free: bool = False
    excess: FloatArray | None = None

    @classmethod
    def by_record(cls, noise: GroupNoise) -> list[NoiseSpectrum]:
        """Return the noise of each record of a group."""
        rows = (
            noise.psd,
            noise.input_noise.tolist(),
            noise.input_noise_at,
            noise.doubt,
            noise.excited,
        )
        of_tones = noise.tones, noise.free.tolist(), noise.excess_by_record
        return [cls(*row) for row in zip(*rows, *of_tones, strict=True)]

    def record_tones(
        self, bin_hz: float, known: tuple[float, ...] = (), resonant: BoolArray | None = None
    ) -> RecordTones:
        """Return the tones, in bins of a width in Hz, beside those that were fitted."""
        return RecordTones(known, self.tones, self.excess, bin_hz, self.psd.size, resonant)


@dataclass(frozen=True, eq=False)
class PredictedMotion:
    """Prediction of a model for a record, for the estimation of its noise.

    Attributes:
        predicted: bins of its response, shape (K,).
        count: number of samples that are used.
        last: bins from here on do not count.
        through: g |H|², shape (K,); None where it is not known.
        colour: g, power of the reference's own noise over its mean, one or shape (K,).
        lines: bins whose remainder is the motion's, and no hum, shape (K,), in addition to lines of
            the prediction; None: no others.
    """

    predicted: ComplexArray
    count: float
    last: int
    through: FloatArray | None = None
    colour: FloatArray | float = 1.0
    lines: BoolArray | None = None


def noise_spectrum(residual: ComplexArray, motion: PredictedMotion, floor: float) -> NoiseSpectrum:
    """Return the noise of a residual, shape (K,); ``floor`` is the lower limit of its level."""
    return noise_spectra(residual[None], [motion], [floor])[0]


def noise_spectra(
    residual: ComplexArray, motions: Sequence[PredictedMotion], floors: Sequence[float]
) -> list[NoiseSpectrum]:
    """Return the noise of residuals of one length and rate.

    Args:
        residual: shape (R, K).
        motions: of each, alike in ``last``, ``through``, ``colour`` and in whether lines are known.
        floors: lower limit of the level of each.
    """
    residual = residual.copy()
    residual[:, :1] = np.abs(residual[:, 1:2])  # an offset is no noise
    first = motions[0]
    lines = [motion.lines for motion in motions if motion.lines is not None]
    rows = Residuals(
        residual,
        np.stack([motion.predicted for motion in motions]),
        np.array([motion.count for motion in motions]),
        np.asarray(floors),
        None if first.through is None else first.through[None],
        lines=np.stack(lines) if lines else None,
    )
    noise = read_noise(rows, first.last, first.colour)
    spectra = NoiseSpectrum.by_record(noise)
    tones = with_shared_tones([spectrum.record_tones(1.0) for spectrum in spectra])
    return [
        replace(spectrum, tones=places) for spectrum, places in zip(spectra, tones, strict=True)
    ]
