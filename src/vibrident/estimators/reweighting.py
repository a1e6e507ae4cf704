"""The last step of training: every line of the network's residual is weighted by its own noise.

Training weighs the samples of a record alike, which is right for white noise of the response. Under coloured noise, or
noise of the reference channel itself, that estimate scatters more than necessary, and the latter biases the gain
low. From there, steps in the metric of the noise lead to maximum likelihood (Pintelon & Schoukens 2012,
ch. 9; one such step is efficient already, Le Cam 1956). At the lines f of the record's transform, with R the residual,
S its spectrum (:mod:`vibrident.estimators.noise_spectrum`), ∂H the model's slopes and X the reference,

    Σ_f Re(∂H* X̂* R) / S = 0,    X̂ = X + σx² H* R / S,

where X̂ is the reference corrected by the response: its error is not correlated with R, so noise of the reference
leaves no bias. The part of the information from the noise itself, ∂H* ∂H σx² σy² / S², is subtracted.

Initial states, offset and drift of every segment, and tones of the mains, are unknowns beside the parameters. Where S
is steep, the part that the slopes of initial states could imitate is removed too: the edges of a record leak over all
lines, and at lines with little noise that would count as information.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.estimators.coloured import sandwich
from vibrident.estimators.noise_spectrum import (
    DOUBT,
    NEAREST,
    TONES,
    Motion,
    NoiseSpectrum,
    noise_spectrum,
)
from vibrident.information import SMALLEST
from vibrident.lines import RecordLines
from vibrident.measure.lines import mean_around
from vibrident.measure.response import ComplexArray
from vibrident.memory import give_back
from vibrident.problem import Coordinates, LineProblem
from vibrident.records import FloatArray
from vibrident.tails import chi2_tail

#: Records longer than this return unused memory to the system at once.
LONG = 2**18
#: Evaluations of the network at most.
EVALUATIONS = 8
#: The step, in standard deviations, at which no further evaluation is needed …
SETTLED = 0.02
#: … and beyond which the last is no optimum.
ASTRAY = 0.3
#: Largest step, over the coordinate or one, for which the linearisation is valid.
FARTHEST = 3.0
#: Information of a coordinate that is not identifiable.
NOTHING_KNOWN = 1e-12
#: Weights by noise are not used if the model does not explain the data: the sum of squares grows by this factor …
COSTLIER = 2.0
#: … or the shift of the estimate has a probability below this under equal weights.
DIFFERENT = 1e-6
#: Rounds of spectrum and step at one evaluation of the network.
ROUNDS = 2
#: Lines averaged for the covariance on either side of each: this part of the spectrum …
SHARE = 1 / 128
#: … but at least so many …
FEWEST = 12
#: … and at most so many.
MOST = 200
#: Fewest samples for a spectrum.
SHORTEST = 256
#: A spectrum is steep where its least is below this part of its mean.
STEEP = 1e-2
#: Lines that a sum over lines copies at once.
AT_ONCE = 2**13
#: Lower limit of the information after that of the noise is subtracted, as a part of the whole.
LEAST_INFORMATION = 0.2


@dataclass(frozen=True)
class Reweighted:
    """The estimate in the metric of the noise.

    Attributes:
        z: the optimum, shape (p,).
        covariance: of z, including the uncertainty of noise of the reference, shape (p, p).
        degrees_of_freedom: behind the noise spectra.
        normal: the network at ``z``.
        reference_noise: standard deviation of the noise of each record's reference channel itself, SI unit of the
            reference; zero if it is not significant, shape (records,).
        doubt: part of z's standard deviation for such noise where motion leaves no line free, 0 … 1, shape (p,).
        hum_hz: tones in each record's response that do not come from the motion.
    """

    z: FloatArray
    covariance: FloatArray
    degrees_of_freedom: float
    reference_noise: FloatArray
    doubt: FloatArray
    hum_hz: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, eq=False)
class _Share:
    """The contribution of one record.

    Attributes:
        information: of the lines about z, shape (p, p).
        of_noise: the part of it that the noise of the reference makes up, shape (p, p).
        gradient: shape (p,).
        variance: of the gradient, by the residual's own spectrum, shape (p, p).
    """

    information: FloatArray
    of_noise: FloatArray
    gradient: FloatArray
    variance: FloatArray


def reweighted(problem: LineProblem, coordinates: Coordinates, z: FloatArray, noise: FloatArray) -> Reweighted | None:
    """Go from the optimum of equal weights to that of the noise as it is; None where the misfit is no noise.

    Args:
        problem: the records.
        coordinates: the map from z to parameters.
        z: the optimum of equal weights, shape (p,).
        noise: standard deviation by which each record was weighted, shape (records,).
    """
    spectra: list[NoiseSpectrum] = []
    first, cost, spread = z, np.inf, np.zeros((len(z), len(z)))
    lines: list[RecordLines] = []
    for last in range(EVALUATIONS):
        lines.clear()  # of long records they are most of the memory
        lines += problem.lines(z, coordinates, noise)
        now = sum(float(np.sum(_equal(record) * np.abs(record.residual) ** 2)) for record in lines)
        if not now <= COSTLIER * cost:
            return None
        if any(record.samples > LONG for record in lines):
            give_back()
        if last == 0:
            spectra = [_spectrum(record, record.residual) for record in lines]
            cost, spread = now, _spread(lines, spectra)
        step, shares = np.zeros(len(z)), []
        for _ in range(ROUNDS):
            shares = []
            for number, record in enumerate(lines):
                share, spectra[number] = _share(record, step, spectra[number])
                shares.append(share)
            whole = np.sum([share.information for share in shares], axis=0)
            if not _known(whole):
                return None
            inverse = _inverse(whole - np.sum([share.of_noise for share in shares], axis=0), whole)
            step = inverse @ np.sum([share.gradient for share in shares], axis=0)
        covariance = inverse @ np.sum([share.variance for share in shares], axis=0) @ inverse
        deviation = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        far = float(np.max(np.abs(step) / deviation))
        if far <= SETTLED or not np.isfinite(far):
            break
        if not np.all(np.abs(step) <= FARTHEST * np.maximum(np.abs(z), 1.0)):
            return None  # too few samples to step by
        if last < EVALUATIONS - 1:
            z = z + step
    seen = any(spectrum.passed > 0 for spectrum in spectra)  # then equal weights are drawn aside
    shift = float((z - first) @ np.linalg.pinv(spread, hermitian=True) @ (z - first))
    if not far <= ASTRAY or (not seen and chi2_tail(len(z), shift) < DIFFERENT):
        return None
    pulls = [inverse @ _draw(record, spectrum) / DOUBT for record, spectrum in zip(lines, spectra, strict=True)]
    covariance = covariance + np.sum([np.outer(pull, pull) for pull in pulls], axis=0)
    untold = [pull**2 for pull, spectrum in zip(pulls, spectra, strict=True) if not spectrum.free]
    doubt = np.sqrt(np.sum([np.zeros(len(z)), *untold], axis=0) / np.maximum(np.diag(covariance), 1e-300))
    return Reweighted(
        z,
        covariance,
        sum(4.0 * (_width(record) - NEAREST) for record in lines),
        np.sqrt([spectrum.passed for spectrum in spectra]) * noise,
        doubt,
        tuple(
            tuple(place * given.sampling_rate_hz / max(record.samples, 1) for place in spectrum.tones)
            for given, record, spectrum in zip(problem.records, lines, spectra, strict=True)
        ),
    )


def _equal(record: RecordLines) -> FloatArray:
    """Equal weights of the lines that count, shape (lines,)."""
    return record.twice / max(record.samples, 1)


def _spread(lines: list[RecordLines], spectra: list[NoiseSpectrum]) -> FloatArray:
    """Covariance of the estimate with equal weights in the noise that is there."""
    levels = [spectrum.level for spectrum in spectra]
    return sandwich([(record.slopes, _equal(record), level) for record, level in zip(lines, levels, strict=True)])


def _share(record: RecordLines, step: FloatArray, spectrum: NoiseSpectrum) -> tuple[_Share, NoiseSpectrum]:
    """What a record says, and its spectrum as read at ``step``; the gradient is that of the whole way from no step."""
    n, p = max(record.samples, 1), len(step)
    rest = record.residual - step @ record.slopes
    weight = record.twice / (n * spectrum.level)
    columns = _unknowns(record, spectrum)
    m = len(columns)
    sums = _products((columns, rest[None]), weight)
    rest -= (_inverse_of_unknowns(sums[:m, :m]) @ sums[:m, m]) @ columns
    known = spectrum
    if record.samples > LONG:
        del columns  # of a long record each copy counts
    found = _spectrum(record, record.where_used(rest))
    spectrum = replace(found, tones=(spectrum.tones + found.tones)[:TONES])
    if record.samples > LONG:
        columns = _unknowns(record, known)

    weight = record.twice * spectrum.excited / (n * spectrum.level)
    slopes, of_noise = record.slopes, np.zeros((p, p))
    if spectrum.passed > 0 and (through := record.through) is not None:
        d_through = np.stack(record.slope_of(lambda slope: slope))
        slopes = slopes + d_through * (spectrum.passed_at * np.conj(through) * rest / spectrum.level)
        beside = np.maximum(spectrum.level - spectrum.passed_at * np.abs(through) ** 2, 0.0)
        own = record.twice * spectrum.excited * spectrum.passed_at * beside / spectrum.level**2
        of_noise = _products((d_through,), own)
    power = np.abs(rest) ** 2 / max(record.count, 1.0) / spectrum.level
    del rest  # of a long record each copy counts
    local = np.maximum(mean_around(power, _width(record), NEAREST), record.floor / spectrum.level)
    # The slopes less what the unknowns can imitate, J − N β, in sums alone.
    sums = _products((columns, slopes, record.residual[None]), weight)
    share = _inverse_of_unknowns(sums[:m, :m]) @ sums[:m, m:]
    freed = sums[m:, m:] - sums[:m, m:].T @ share
    loud = _products((columns, slopes), weight * spectrum.excited * local)
    beta = share[:, :p]
    both = beta.T @ loud[:m, m:]
    variance = loud[m:, m:] - both - both.T + beta.T @ loud[:m, :m] @ beta
    return _Share(freed[:p, :p], of_noise, freed[:p, p], variance), spectrum


def _draw(record: RecordLines, spectrum: NoiseSpectrum) -> FloatArray:
    """Pull of noise of the reference that may be left (95 %) at each coordinate, Σ weight Re ∂H* H σx², shape (p,)."""
    through = record.through
    if through is None:
        return np.zeros(len(record.z))
    weighted = through * (record.twice * spectrum.excited * spectrum.doubt() / spectrum.level)
    return np.array(record.slope_of(lambda slope: float(np.real(np.vdot(slope, weighted)))))


def _unknowns(record: RecordLines, spectrum: NoiseSpectrum) -> ComplexArray:
    """Lines of what is unknown beside the parameters, shape (m, lines)."""
    steep = float(np.min(spectrum.level)) < STEEP * float(np.mean(spectrum.level))
    driven = record.response is not None  # a free decay has nothing but initial states
    return record.unknowns(edges=driven and (steep or spectrum.passed > 0), tones=spectrum.tones)


def _motion(record: RecordLines) -> Motion | None:
    """The model's prediction of the record; None if it has too few lines above the noise."""
    if record.count < SHORTEST or record.free is None:
        return None
    through = record.through
    return Motion.of(record.predicted(), record.count, None if through is None else np.abs(through) ** 2)


def _spectrum(record: RecordLines, residual: ComplexArray) -> NoiseSpectrum:
    """The spectrum of a residual."""
    motion = _motion(record)
    if motion is not None:
        return noise_spectrum(residual, motion, record.floor)
    power = float(np.sum(record.twice * np.abs(residual) ** 2)) / max(record.samples, 1)
    level = max(power / max(record.count, 1.0), record.floor)
    doubt = 0.0 if record.through is None else level / float(np.max(np.abs(record.through) ** 2))
    flat, nothing, one, left = (np.broadcast_to(value, record.twice.shape) for value in (level, 0.0, 1.0, doubt))
    return NoiseSpectrum(flat, 0.0, nothing, lambda: left, one)


def _products(groups: Sequence[ComplexArray], weight: FloatArray) -> FloatArray:
    """Re Σ weight v* v over the lines for all pairs of the rows of ``groups``, each of shape (rows, lines)."""
    count, root = sum(len(rows) for rows in groups), np.sqrt(weight)
    total = np.zeros((count, count))
    for begin in range(0, len(root), AT_ONCE):  # a block stays in the processor's cache
        part = slice(begin, begin + AT_ONCE)
        block = np.empty((count, len(root[part])), dtype=complex)
        at = 0
        for rows in groups:
            np.multiply(rows[:, part], root[part], out=block[at : at + len(rows)])
            at += len(rows)
        flat = block.view(float)
        total += flat @ flat.T
    return total


def _inverse_of_unknowns(matrix: FloatArray) -> FloatArray:
    """Inverse of a normal matrix; what several unknowns can imitate alike is left to one of them."""
    if not matrix.size:
        return matrix
    scale = np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    kept = values > SMALLEST
    return (vectors[:, kept] / values[kept]) @ vectors[:, kept].T / np.outer(scale, scale)


def _known(information: FloatArray) -> bool:
    """Whether every direction is known, and not lost in rounding."""
    size = np.diag(information)
    if not (np.all(np.isfinite(information)) and np.all(size > NOTHING_KNOWN)):
        return False
    return float(np.linalg.eigvalsh(information / np.sqrt(np.outer(size, size)))[0]) > -0.5 * SMALLEST


def _width(record: RecordLines) -> int:
    return int(np.clip(record.samples * SHARE, FEWEST, MOST))


def _inverse(information: FloatArray, whole: FloatArray) -> FloatArray:
    """Inverse of the information, which is not let fall below a part of the whole."""
    scale = np.sqrt(np.maximum(np.diag(whole), np.finfo(float).tiny))
    base = whole / np.outer(scale, scale) + 1e-12 * np.eye(len(scale))
    whitening = np.linalg.inv(np.linalg.cholesky(base))
    values, rotation = np.linalg.eigh(whitening @ (information / np.outer(scale, scale)) @ whitening.T)
    vectors = whitening.T @ rotation
    return (vectors / np.maximum(values, LEAST_INFORMATION)) @ vectors.T / np.outer(scale, scale)
