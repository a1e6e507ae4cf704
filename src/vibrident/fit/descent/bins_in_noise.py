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
    """Records one after the other whose noise is read side by side: many short ones, or one long one."""
    ends, begin, samples = list[int](), 0, 0
    for number, record in enumerate(lines):
        if number > begin and samples + record.samples > 1 << 17:  # beyond, memory counts
            ends.append(number)
            begin, samples = number, 0
        samples += record.samples
    return [slice(*pair) for pair in itertools.pairwise([0, *ends, len(lines)])]


@dataclass(frozen=True, eq=False)
class Weighed:
    """A record's lines, weighted by the noise as read after a step.

    Attributes:
        record: the lines; the gradient is that of the whole way from no step.
        spectrum: of the noise.
        nuisances: columns beside the parameters'.
        rest: what the step and the best unknowns leave of the residual, shape (lines,).
        slopes: at the reference as the response corrects it, shape (p, lines).
        of_noise: the part of the information that noise of the reference makes up, shape (p, p).
        weight: of each line, shape (lines,).
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
        step: FloatArray,
        before: list[NoiseSpectrum],
        *,
        known: bool,
    ) -> list[Weighed]:
        """Of records, after a step, shape (p,), from the noise as read before it; the list of which is emptied.

        ``known``: that was read here; it is read again where more than offset and drift may hide in it.
        """
        tones = [own.tones for own in before]
        nuisances = [nuisances_of(*pair) for pair in zip(lines, before, strict=True)]
        if known and not any(tones) and not any(_with_edges(*pair) for pair in zip(lines, before, strict=True)):
            found, rests = list(before), [record.residual for record in lines]
            before.clear()
        else:
            rests = [_left(record, step, u, before.pop(0)) for record, u in zip(lines, nuisances, strict=True)]
            used = [record.where_used(rest) for record, rest in zip(lines, rests, strict=True)]
            found = spectra_of(lines, motions, used)
        return [cls._weighed(*each) for each in zip(lines, tones, nuisances, rests, found, strict=True)]

    @classmethod
    def _weighed(
        cls,
        record: RecordBins,
        tones: tuple[float, ...],
        nuisances: BinsAt,
        rest: ComplexArray,
        found: NoiseSpectrum,
    ) -> Weighed:
        p = len(record.jacobian)
        spectrum = replace(found, tones=with_tones(tones, found.tones))
        weight = record.one_sided * spectrum.excited / (max(record.samples, 1) * spectrum.psd)
        jacobian, of_noise = record.jacobian, np.zeros((p, p))
        if spectrum.input_noise > 0 and record.model is not None:
            d_through = np.stack(list(record.model.jacobian()))
            jacobian = jacobian + d_through * likelier(record, spectrum, rest)
            beside = np.maximum(spectrum.psd - spectrum.input_noise_at * record.model.power(), 0.0)
            own = record.one_sided * spectrum.excited * spectrum.input_noise_at * beside / spectrum.psd**2
            of_noise = products(lambda part: (d_through[:, part],), own)
        return cls(record, spectrum, nuisances, rest, jacobian, of_noise, weight)


def around(record: RecordBins) -> int:
    """Lines on either side of each that are averaged for the covariance."""
    return width(record.samples, 1 / 128)


def likelier(record: RecordBins, spectrum: NoiseSpectrum, rest: ComplexArray) -> ComplexArray:
    """What the most likely motion has beyond the reference, X̂ − X = σx² H* R/S, shape (lines,)."""
    assert record.model is not None
    return np.asarray(spectrum.input_noise_at * np.conj(record.model.through()) * rest / spectrum.psd)


def _left(record: RecordBins, step: FloatArray, nuisances: BinsAt, spectrum: NoiseSpectrum) -> ComplexArray:
    """What a step and the best nuisance parameters leave of the residual, shape (lines,)."""
    weight = record.one_sided / (max(record.samples, 1) * spectrum.psd)
    rest = record.residual - step @ record.jacobian
    sums = products(lambda part: (nuisances(part), rest[None, part]), weight)
    amounts = inverse_where_shown(sums[:-1, :-1]) @ sums[:-1, -1]
    for part in in_blocks(len(rest)):
        rest[part] -= amounts @ nuisances(part)
    return rest


def nuisances_of(record: RecordBins, spectrum: NoiseSpectrum) -> BinsAt:
    """Lines of what is unknown beside the parameters."""
    return record.nuisances(edges=_with_edges(record, spectrum), tones=spectrum.tones)


def _with_edges(record: RecordBins, spectrum: NoiseSpectrum) -> bool:
    """Whether slopes of the initial states are unknown, too; a free decay has nothing but these states."""
    return record.model is not None and (is_steep(spectrum) or record.rings_unseen)


def beside_hum(lines: Sequence[RecordBins], motions: Sequence[MotionOf]) -> list[NoiseSpectrum]:
    """The spectra of the records' residuals, with the tones that are known beside those that were found."""
    found = list[NoiseSpectrum]()
    for some in together(lines):
        found += spectra_of(lines[some], motions[some], [record.residual for record in lines[some]])
    return [replace(own, tones=with_tones(record.hum, own.tones)) for record, own in zip(lines, found, strict=True)]


def spectra_of(
    lines: Sequence[RecordBins], motions_of: Sequence[MotionOf], residuals: Sequence[ComplexArray]
) -> list[NoiseSpectrum]:
    """The spectra of residuals."""
    motions = [motion() for motion in motions_of]
    read = iter(
        noise_spectra(
            [rest for rest, motion in zip(residuals, motions, strict=True) if motion is not None],
            [motion for motion in motions if motion is not None],
            [record.floor for record, motion in zip(lines, motions, strict=True) if motion is not None],
        )
    )
    every = zip(lines, residuals, motions, strict=True)
    return [_of_few(record, rest) if motion is None else next(read) for record, rest, motion in every]


def _of_few(record: RecordBins, residual: ComplexArray) -> NoiseSpectrum:
    """The spectrum of a residual of too few lines: all of one level."""
    power = float(np.sum(record.one_sided * power_of(residual))) / max(record.samples, 1)
    level = max(power / max(record.count, 1.0), record.floor)
    through = through_of(record)
    most = 0.0 if through is None else level / float(np.max(through))
    flat, nothing, one = (np.broadcast_to(value, record.one_sided.shape) for value in (level, 0.0, 1.0))
    return NoiseSpectrum(flat, 0.0, nothing, lambda: np.broadcast_to(most * record.colour, record.one_sided.shape), one)


def products(rows: Callable[[slice], Sequence[ComplexArray]], weight: FloatArray) -> FloatArray:
    """Re Σ weight v* v over the lines for all pairs of rows; ``rows``: groups of these at some lines."""
    count, total = 0, np.zeros((1, 1))
    root = np.sqrt(weight[: len(weight) - int(np.argmax(weight[::-1] != 0.0))])  # up to the last line that counts
    for part in in_blocks(len(root)):
        groups = rows(part)
        count = sum(len(group) for group in groups)
        block = np.empty((count + (count % 4 == 3), part.stop - part.start), dtype=complex)  # BLAS is slow at 3 and 7
        block[count:] = 0.0
        at = 0
        for group in groups:
            np.multiply(group, root[part], out=block[at : at + len(group)])
            at += len(group)
        flat = block.view(float)
        total = total + flat @ flat.T
    return total[:count, :count]
