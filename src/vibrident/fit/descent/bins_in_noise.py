"""Records at their bins, weighted by the noise that their residual shows."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import FloatArray, Record
from vibrident.fit.bins import BinsAt, RecordBins
from vibrident.fit.descent.sandwich import width
from vibrident.fit.descent.weighting import is_steep
from vibrident.fit.information import inverse_where_shown
from vibrident.fit.noise.motion import MotionOf, through_of
from vibrident.fit.noise.spectrum import NoiseSpectrum, noise_spectra
from vibrident.fit.noise.tones import with_tones
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import in_blocks, power_of


def together(lines: Sequence[RecordBins] | Sequence[Record]) -> list[slice]:
    """Group records in their order: many short ones whose noise is read at once, or one long one."""
    ends: list[int] = []
    begin = 0
    samples = 0
    for number, record in enumerate(lines):
        if number > begin and samples + record.samples > 1 << 17:  # beyond, memory counts
            ends.append(number)
            begin = number
            samples = 0
        samples += record.samples
    return [slice(*pair) for pair in itertools.pairwise([0, *ends, len(lines)])]


@dataclass(frozen=True, eq=False)
class Weighed:
    """A record at its bins, weighted by the noise that its residual shows.

    Attributes:
        record: the bins.
        spectrum: of the noise.
        nuisances: columns beside the parameters'.
        rest: what the best nuisances leave of the residual, shape (bins,).
        jacobian: at the most likely motion, shape (p, bins).
        of_noise: part of the information that noise of the reference makes up, shape (p, p).
        weight: of each bin, shape (bins,).
    """

    record: RecordBins
    spectrum: NoiseSpectrum
    nuisances: BinsAt
    rest: ComplexArray
    jacobian: ComplexArray
    of_noise: FloatArray
    weight: FloatArray

    @classmethod
    def at(
        cls,
        lines: Sequence[RecordBins],
        motions: Sequence[MotionOf],
        spectra: list[NoiseSpectrum],
    ) -> list[Weighed]:
        """Weigh records by their noise, read again where more than offset and drift hides in it.

        Args:
            lines: the records.
            motions: what a model says of them.
            spectra: noise of their residuals; the list is emptied, as of long records a copy counts.
        """
        tones = [spectrum.tones for spectrum in spectra]
        every = list(zip(lines, spectra, strict=True))
        nuisances = [nuisances_of(*pair) for pair in every]
        more = any(tones) or any(_with_edges(*pair) for pair in every)
        del every
        if not more:
            rests = [record.residual for record in lines]
            noises = list(spectra)
            spectra.clear()
        else:
            rests = [_left(record, columns, spectra.pop(0)) for record, columns in zip(lines, nuisances, strict=True)]
            used = [record.where_used(rest) for record, rest in zip(lines, rests, strict=True)]
            noises = spectra_of(lines, motions, used)
        parts = zip(lines, tones, nuisances, rests, noises, strict=True)
        return [cls._weighed(*each) for each in parts]

    @classmethod
    def _weighed(
        cls,
        record: RecordBins,
        tones: tuple[float, ...],
        nuisances: BinsAt,
        rest: ComplexArray,
        noise: NoiseSpectrum,
    ) -> Weighed:
        spectrum = replace(noise, tones=with_tones(tones, noise.tones))
        counts = record.one_sided * spectrum.excited
        weight = counts / (max(record.samples, 1) * spectrum.psd)
        jacobian = record.jacobian
        of_noise = np.zeros((len(jacobian), len(jacobian)))
        if spectrum.input_noise > 0 and record.model is not None:
            turns = np.stack(list(record.model.jacobian()))
            jacobian = jacobian + turns * likelier(record, spectrum, rest)
            passed = spectrum.input_noise_at * record.model.power()
            beside = np.maximum(spectrum.psd - passed, 0.0)
            alone = counts * spectrum.input_noise_at * beside / spectrum.psd**2
            of_noise = products(lambda part: (turns[:, part],), alone)
        return cls(record, spectrum, nuisances, rest, jacobian, of_noise, weight)


def around(record: RecordBins) -> int:
    """Return the number of bins on either side of each that are averaged for the covariance."""
    return width(record.samples, 1 / 128)


def likelier(record: RecordBins, spectrum: NoiseSpectrum, rest: ComplexArray) -> ComplexArray:
    """Return what the most likely motion has beyond the reference, σx² H* R/S, shape (bins,)."""
    assert record.model is not None
    share = spectrum.input_noise_at * np.conj(record.model.through())
    return np.asarray(share * rest / spectrum.psd)


def _left(record: RecordBins, nuisances: BinsAt, spectrum: NoiseSpectrum) -> ComplexArray:
    """Return what the best nuisances leave of the residual, shape (bins,)."""
    weight = record.one_sided / (max(record.samples, 1) * spectrum.psd)
    rest = record.residual.copy()
    sums = products(lambda part: (nuisances(part), rest[None, part]), weight)
    amounts = inverse_where_shown(sums[:-1, :-1]) @ sums[:-1, -1]
    for part in in_blocks(len(rest)):
        rest[part] -= amounts @ nuisances(part)
    return rest


def nuisances_of(record: RecordBins, spectrum: NoiseSpectrum) -> BinsAt:
    """Return what makes the columns beside the parameters'."""
    return record.nuisances(edges=_with_edges(record, spectrum), tones=spectrum.tones)


def _with_edges(record: RecordBins, spectrum: NoiseSpectrum) -> bool:
    """Return whether slopes of the initial states are unknown; a free decay has nothing but these."""
    return record.model is not None and (is_steep(spectrum) or record.rings_unseen)


def beside_hum(lines: Sequence[RecordBins], motions: Sequence[MotionOf]) -> list[NoiseSpectrum]:
    """Read the noise of residuals; tones that are known stand beside those that it shows."""
    spectra: list[NoiseSpectrum] = []
    for some in together(lines):
        residuals = [record.residual for record in lines[some]]
        spectra += spectra_of(lines[some], motions[some], residuals)
    return [
        replace(spectrum, tones=with_tones(record.hum, spectrum.tones))
        for record, spectrum in zip(lines, spectra, strict=True)
    ]


def spectra_of(
    lines: Sequence[RecordBins], motions_of: Sequence[MotionOf], residuals: Sequence[ComplexArray]
) -> list[NoiseSpectrum]:
    """Read the noise of residuals."""
    motions = [motion() for motion in motions_of]
    every = list(zip(lines, residuals, motions, strict=True))
    told = [each for each in every if each[2] is not None]
    read = iter(
        noise_spectra(
            [residual for _, residual, _ in told],
            [motion for _, _, motion in told if motion is not None],
            [record.floor for record, _, _ in told],
        )
    )
    return [_of_few(record, residual) if motion is None else next(read) for record, residual, motion in every]


def _of_few(record: RecordBins, residual: ComplexArray) -> NoiseSpectrum:
    """Return the noise of a residual of too few bins: all of one level."""
    power = float(np.sum(record.one_sided * power_of(residual))) / max(record.samples, 1)
    level = max(power / max(record.count, 1.0), record.floor)
    through = through_of(record)
    most = 0.0 if through is None else level / float(np.max(through))
    shape = record.one_sided.shape
    flat, nothing, one = (np.broadcast_to(value, shape) for value in (level, 0.0, 1.0))
    doubt = most * record.colour
    return NoiseSpectrum(flat, 0.0, nothing, lambda: np.broadcast_to(doubt, shape), one)


def products(rows: Callable[[slice], Sequence[ComplexArray]], weight: FloatArray) -> FloatArray:
    """Return Re Σ weight v* v over bins for all pairs of rows, in blocks that stay in the cache.

    Args:
        rows: makes groups of rows at some bins.
        weight: shape (bins,).
    """
    count = 0
    total = np.zeros((1, 1))
    last = len(weight) - int(np.argmax(weight[::-1] != 0.0))  # behind the last bin that counts
    root = np.sqrt(weight[:last])
    for part in in_blocks(len(root)):
        groups = rows(part)
        count = sum(len(group) for group in groups)
        padded = count + (count % 4 == 3)  # BLAS is slow at 3 and 7
        block = np.empty((padded, part.stop - part.start), dtype=complex)
        block[count:] = 0.0
        at = 0
        for group in groups:
            np.multiply(group, root[part], out=block[at : at + len(group)])
            at += len(group)
        flat = block.view(float)
        total = total + flat @ flat.T
    return total[:count, :count]
