"""A Gauss–Newton iterate of the weighted least squares: information, gradient and sum of squares of all records there.

Formulas and their source: :mod:`vibrident.fit.descent.reweighting`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from vibrident.data.records import FloatArray, Record
from vibrident.fit.bins import BinsAt, RecordBins
from vibrident.fit.descent.sandwich import width
from vibrident.fit.descent.weighting import is_steep
from vibrident.fit.information import SMALLEST, inverse_where_shown, sandwich_covariance
from vibrident.fit.noise.motion import NEAREST, MotionOf, through_of
from vibrident.fit.noise.spectrum import NoiseSpectrum, noise_spectra
from vibrident.fit.noise.tones import with_tones
from vibrident.fit.optimise import Bent
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import in_blocks, mean_around, power_of


class _Share(NamedTuple):
    """The contribution of one record."""

    information: FloatArray  # of the lines about z, shape (p, p)
    of_noise: FloatArray  # the part of it that the noise of the reference makes up, shape (p, p)
    gradient: FloatArray  # shape (p,)
    cost: float  # weighted sum of squares of the residual
    variance: (
        FloatArray  # of the gradient, by the residual's own spectrum, shape (p, p); zero where it is not asked for
    )


@dataclass(frozen=True, eq=False)
class Iterate:
    """Coordinates, and the step from there weighted by the noise."""

    z: FloatArray  # shape (p,)
    spectra: tuple[NoiseSpectrum, ...]  # of the records, as read there
    inverse: FloatArray  # of the information less that of the noise, shape (p, p)
    gradient: FloatArray  # shape (p,)
    covariance: FloatArray  # of the estimate, shape (p, p)
    cost: float  # weighted sum of squares
    read_at: FloatArray  # the step behind which the spectra were read, shape (p,)

    @property
    def far(self) -> float:
        """Length of the full step, in standard deviations."""
        return self._length(self.inverse @ self.gradient)

    def _length(self, step: FloatArray) -> float:
        return float(np.max(np.abs(step) / np.sqrt(np.maximum(np.diag(self.covariance), 1e-300))))

    @property
    def end(self) -> FloatArray | None:
        """Where the step leads, shape (p,), if that is the optimum without another evaluation of the network.

        It is if the step is short, and straight: its length in standard deviations times that in coordinates is small;
        and if the noise is the response's alone (that of the reference moves with the network), was read near the end,
        where it leads a tenth of that further, and weighs the lines as they scatter, by the variances.
        """
        step = self.inverse @ self.gradient
        straight = self.is_short and self.far * float(np.max(np.abs(step))) <= 3e-4
        straight &= not self.seen and bool(np.all(np.diag(self.covariance) <= 2.0 * np.diag(self.inverse)))
        return self.z + step if straight and self._length(step - self.read_at) <= 0.2 else None

    @property
    def is_short(self) -> bool:
        """Whether the full step is one standard deviation long, or less."""
        return self.far <= 1.0

    def ahead(self, damping: float, bent: Bent | None, part: float = 1.0) -> FloatArray:
        """The end of a step, shape (p,): a part of the way straight on, or along the valley where that leads up."""
        if damping == 0.0:
            return self.z + part * (self.inverse @ self.gradient)
        step = np.linalg.solve(np.linalg.inv(self.inverse) + damping * np.eye(len(self.z)), self.gradient)
        return self.z + step if bent is None else bent(self.z, np.asarray(step, dtype=float), damping)

    @property
    def seen(self) -> bool:
        """Whether noise of the reference is seen."""
        return any(spectrum.input_noise > 0 for spectrum in self.spectra)

    def astray(self, lines: Sequence[RecordBins]) -> bool:
        """Whether what the step would leave is no noise to weigh by, but mostly misfit.

        The noise is read from what has nothing in common with the motion: the sum of squares is about the number of
        samples where there is nothing else.
        """
        left = self.cost - float(self.gradient @ self.inverse @ self.gradient)
        return not left <= 2.0 * sum(record.count for record in lines)

    def leads_to(self, lines: Sequence[RecordBins]) -> bool:
        """Whether a step to where these lines were evaluated leads down.

        A long one does where the sum of squares in the weighting of this iterate is less.
        """
        return self.is_short or sum(_cost(*pair, self.z) for pair in zip(lines, self.spectra, strict=True)) < self.cost


def iterate_at(
    lines: Sequence[RecordBins],
    motions: Sequence[MotionOf],
    spectra: list[NoiseSpectrum],
    z: FloatArray,
    settled: float | None = None,
) -> Iterate | None:
    """Information and gradient at ``z``, shape (p,); None where a direction is not known, or a residual not finite.

    Args:
        lines: of the records, at ``z``.
        motions: what the model says of them.
        spectra: as read before; the list is emptied, because of long records each copy counts.
        z: where.
        settled: where the step is no longer, in standard deviations, the noise is not read again behind it; None: it
            is, as ``spectra`` are of another place.
    """
    if not finite(lines):
        return None
    step = np.zeros(len(z))
    for last in (False, True):
        shares, read = list[_Share](), list[NoiseSpectrum]()
        final, read_at = settled is not None or last, step
        for some in together(lines):
            before = [spectra.pop(0) for _ in lines[some]]
            weighed = Weighed.at(lines[some], motions[some], step, before, known=not final)
            while weighed:
                own = weighed.pop(0)
                read.append(own.spectrum)
                shares.append(own.share(varies=final))
        spectra = read
        whole, of_noise, gradient, cost, variance = (np.sum(parts, axis=0) for parts in zip(*shares, strict=True))
        if not _known(whole):
            return None
        root = _inverse_root(whole - of_noise, whole)
        inverse = root @ root.T
        step = inverse @ gradient
        if final:
            covariance = sandwich_covariance(root, variance, whole)
            place = Iterate(z, tuple(spectra), inverse, gradient, covariance, float(cost), read_at)
            if settled is None or last or place.far <= settled:
                return place
    return None


def finite(lines: Sequence[RecordBins]) -> bool:
    """Whether the sums of squares of the residuals are finite."""
    with np.errstate(all="ignore"):
        return all(np.isfinite(np.linalg.norm(record.residual)) for record in lines)


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

    def share(self, *, varies: bool) -> _Share:
        """What the record says: the Jacobian projected onto what is no nuisance column, J − N β, in sums alone.

        ``varies``: whether the variance of the gradient is asked for.
        """
        record, p = self.record, len(self.jacobian)
        sums = products(
            lambda part: (self.nuisances(part), self.jacobian[:, part], record.residual[None, part]), self.weight
        )
        m = len(sums) - p - 1
        share = inverse_where_shown(sums[:m, :m]) @ sums[:m, m:]
        freed = sums[m:, m:] - sums[:m, m:].T @ share
        variance, imitated = np.zeros((p, p)), share[:, :p]
        if varies:
            level = self.spectrum.psd
            power = power_of(self.rest) / max(record.count, 1.0) / level
            local = np.maximum(mean_around(power, around(record), NEAREST), record.floor / level)
            weight = self.weight * self.spectrum.excited * local
            loud = products(lambda part: (self.nuisances(part), self.jacobian[:, part]), weight)
            both = imitated.T @ loud[:m, m:]
            variance = loud[m:, m:] - both - both.T + imitated.T @ loud[:m, :m] @ imitated
        return _Share(freed[:p, :p], self.of_noise, freed[:p, p], float(freed[p, p]), variance)


def around(record: RecordBins) -> int:
    """Lines on either side of each that are averaged for the covariance."""
    return width(record.samples, 1 / 128)


def likelier(record: RecordBins, spectrum: NoiseSpectrum, rest: ComplexArray) -> ComplexArray:
    """What the most likely motion has beyond the reference, X̂ − X = σx² H* R/S, shape (lines,)."""
    assert record.model is not None
    return np.asarray(spectrum.input_noise_at * np.conj(record.model.through()) * rest / spectrum.psd)


def _cost(record: RecordBins, spectrum: NoiseSpectrum, z: FloatArray) -> float:
    """Weighted sum of squares of a record's residual, by the noise as read at ``z``, shape (p,).

    Noise of the reference passes the sensor as it is where the record was evaluated; a tenth of the level here is sure.
    """
    level = spectrum.psd
    if spectrum.input_noise > 0 and record.model is not None:
        more = record.model.power() - power_of(record.model.at(z))
        level = np.maximum(level + spectrum.input_noise_at * more, 0.1 * level)
    weight = record.one_sided * spectrum.excited / (max(record.samples, 1) * level)
    nuisances = nuisances_of(record, spectrum)
    sums = products(lambda part: (nuisances(part), record.residual[None, part]), weight)
    return float(sums[-1, -1] - sums[:-1, -1] @ inverse_where_shown(sums[:-1, :-1]) @ sums[:-1, -1])


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


def _known(information: FloatArray) -> bool:
    """Whether every direction is known, and not lost in rounding."""
    size = np.diag(information)
    if not (np.all(np.isfinite(information)) and np.all(size > 1e-12)):
        return False
    return float(np.linalg.eigvalsh(information / np.sqrt(np.outer(size, size)))[0]) > -0.5 * SMALLEST


def _inverse_root(information: FloatArray, whole: FloatArray) -> FloatArray:
    """L, shape (p, p), of the inverse L Lᵀ of the information, which is not let fall below a fifth of the whole."""
    scale = np.sqrt(np.maximum(np.diag(whole), np.finfo(float).tiny))
    base = whole / np.outer(scale, scale) + 1e-12 * np.eye(len(scale))
    whitening = np.linalg.inv(np.linalg.cholesky(base))
    values, rotation = np.linalg.eigh(whitening @ (information / np.outer(scale, scale)) @ whitening.T)
    return (whitening.T @ rotation) / np.sqrt(np.maximum(values, 0.2)) / scale[:, None]
