"""The last step of training: every line of the network's residual is weighted by its own noise.

Training weighs the samples of a record alike, which is right for white noise of the response. Under coloured noise, or
noise of the reference channel itself, that estimate scatters more than necessary, and the latter biases the gain
low. From there, steps weighted by the noise lead to maximum likelihood (Pintelon & Schoukens 2012,
ch. 9; one such step is efficient already, Le Cam 1956). At the lines f of the record's transform, with R the residual,
S its spectrum (:mod:`vibrident.fit.noise.spectrum`), ∂H the model's slopes and X the reference,

    Σ_f Re(∂H* X̂* R) / S = 0,    X̂ = X + σx² H* R / S,

where X̂ is the reference corrected by the response: its error is not correlated with R, so noise of the reference
leaves no bias. The part of the information from the noise itself, ∂H* ∂H σx² σy² / S², is subtracted.

Initial states, offset and drift of every segment, and tones of the mains, are nuisance parameters. Where S is steep,
the part that the slopes of initial states could imitate is removed too: the edges of a record leak over all bins, and
at bins with little noise that would count as information.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.base.memory import give_back_after
from vibrident.base.tails import chi2_tail
from vibrident.data.records import FloatArray
from vibrident.fit.bins import RecordBins
from vibrident.fit.descent.iterate import (
    FARTHEST,
    SETTLED,
    SHARE,
    Iterate,
    beside_hum,
    equal,
    equal_cost,
    iterate_at,
    products,
)
from vibrident.fit.descent.optimise import Bent
from vibrident.fit.descent.sandwich import sandwich, width
from vibrident.fit.noise.found import SpectralNoise, doubtful
from vibrident.fit.noise.motion import NEAREST, motion_of
from vibrident.fit.noise.spectrum import DOUBT, NoiseSpectrum
from vibrident.fit.problem import Coordinates, NetworkProblem
from vibrident.fit.response.response import ComplexArray

#: Evaluations of the network at most, straight on and along a valley.
EVALUATIONS, ALONG_A_VALLEY = 16, 30
#: The step, in standard deviations, beyond which the last iterate is no optimum.
ASTRAY = 0.3
#: Largest step, over the coordinate or one, for which the linearisation is valid.
LONGEST = 3.0
#: If it does not, it is damped, by this factor more after each further one, which doubles each time …
DAMPED, MORE_DAMPED, LESS_DAMPED = 1.0, 4.0, 0.2
#: … up to this.
MOST_DAMPED = 1e12
#: A descent that comes no closer by this factor in more steps than these in a row does not arrive.
CLOSER, MOST_SLOW = 0.97, 3
#: The steps are halved where one leaves more than this part of the way.
BACK = 0.7
#: Weights by noise are not used if the model does not explain the data: the sum of squares grows by this factor …
COSTLIER = 2.0
#: … or the shift of the estimate has a probability below this under equal weights.
DIFFERENT = 1e-6


@dataclass(frozen=True)
class Reweighted:
    """The estimate weighted by the noise.

    Attributes:
        z: the optimum, shape (p,).
        covariance: of z, including the uncertainty of noise of the reference, shape (p, p).
        degrees_of_freedom: behind the noise spectra.
        normal: the network at ``z``.
        noise: of the reference, and hum.
    """

    z: FloatArray
    covariance: FloatArray
    degrees_of_freedom: float
    noise: SpectralNoise


def reweighted(
    problem: NetworkProblem,
    coordinates: Coordinates,
    z: FloatArray,
    noise: FloatArray,
    start: FloatArray | None = None,
    bent: Bent | None = None,
) -> Reweighted | None:
    """Go from the optimum of equal weights to that of the noise as it is; None where the misfit is no noise.

    Args:
        problem: the records.
        coordinates: the map from z to parameters.
        z: the optimum of equal weights, shape (p,).
        noise: standard deviation by which each record was weighted, shape (records,).
        start: where to begin in place of ``z``, shape (p,). Where parameters trade against each other along a curved
            valley, noise of the reference draws equal weights so far that no step leads back.
        bent: where a damped step leads to if not straight on.
    """
    lines = problem.lines(z, coordinates, noise)
    cost, motions = equal_cost(lines), [motion_of(record) for record in lines]
    spectra = beside_hum(lines, motions)
    # What equal weights say is needed only where the way leads on from here, or begins elsewhere.
    first, alike = tuple(spectra), None
    if start is not None:
        alike = _spread(lines, spectra), _equal_information(lines)
        lines = problem.lines(start, coordinates, noise)
        if not equal_cost(lines) <= FARTHEST * cost:
            return None
        motions = [motion_of(record) for record in lines]
        spectra = beside_hum(lines, motions)
    here = iterate_at(lines, motions, spectra, z if start is None else start)
    del motions, spectra  # of a long record each copy counts
    if here is None or here.astray(lines):
        return None
    if here.end is None and alike is None:
        alike = _spread(lines, first), _equal_information(lines)
    evaluate = functools.partial(problem.lines, coordinates=coordinates, noise=noise)
    here = _down(here, lines, evaluate, COSTLIER * cost, bent)
    end = here.end
    if here.astray(lines) or (end is None and not here.far <= ASTRAY):
        return None
    if lines[0].z is not here.z:
        lines = problem.lines(here.z, coordinates, noise)
    end = here.z if end is None else end
    if alike is not None and not here.seen and _improbable(end - z, equal_cost(lines) - cost, *alike):
        return None  # noise of the reference alone draws equal weights aside
    inverse, covariance, spectra = here.inverse, here.covariance, here.spectra
    pulls = [inverse @ _draw(record, spectrum) / DOUBT for record, spectrum in zip(lines, spectra, strict=True)]
    covariance = covariance + np.sum([np.outer(pull, pull) for pull in pulls], axis=0)
    give_back_after(max(record.samples for record in lines))
    untold = np.array([pull for pull, spectrum in zip(pulls, spectra, strict=True) if not spectrum.free])
    untold = untold.reshape(-1, len(z))
    return Reweighted(
        end,
        covariance,
        sum(4.0 * (width(record.samples, SHARE) - NEAREST) for record in lines),
        SpectralNoise(
            np.sqrt([spectrum.input_noise for spectrum in spectra]) * noise,
            doubtful(untold, covariance),
            tuple(
                tuple(place * given.sampling_rate_hz / max(record.samples, 1) for place in spectrum.tones)
                for given, record, spectrum in zip(problem.records, lines, spectra, strict=True)
            ),
            untold,
        ),
    )


def _down(
    here: Iterate,
    lines: list[RecordBins],
    evaluate: Callable[[FloatArray], list[RecordBins]],
    most: float,
    bent: Bent | None,
) -> Iterate:
    """The last iterate of a descent; ``lines`` hold the records at the last iterate that was tried."""
    damping, part, rejected, slow, least = 0.0, 1.0, 0, 0, here.far
    for _ in range((EVALUATIONS if bent is None else ALONG_A_VALLEY) - 1):
        if (
            here.end is not None
            or here.far <= SETTLED
            or not np.isfinite(here.far)
            or damping > MOST_DAMPED
            or slow > MOST_SLOW
        ):
            break
        trial, there = here.ahead(damping, bent, part), None
        if np.all(np.abs(trial - here.z) <= LONGEST * np.maximum(np.abs(here.z), 1.0)):
            lines.clear()  # of long records they are most of the memory
            lines += evaluate(trial)
            give_back_after(max(record.samples for record in lines))
            if here.leads_to(lines, most):
                there = iterate_at(lines, [motion_of(record) for record in lines], list(here.spectra), trial, SETTLED)
        if there is None:
            damping = max(DAMPED, damping * MORE_DAMPED * 2.0**rejected)
            rejected += 1
        else:
            slow, least = slow + 1 if there.far > CLOSER * least else 0, min(least, there.far)
            if damping == 0.0 and there.far > BACK * here.far:
                part *= 0.5  # the noise as read at either end leads back to the other
            here, rejected = there, 0
            if here.astray(lines):
                break
            damping = damping * LESS_DAMPED if damping > DAMPED else 0.0
    return here


def _equal_information(lines: Sequence[RecordBins]) -> FloatArray:
    def slopes_of(record: RecordBins) -> Callable[[slice], list[ComplexArray]]:
        return lambda part: [record.jacobian[:, part]]

    return np.sum([products(slopes_of(record), equal(record)) for record in lines], axis=0)


def _improbable(shift: FloatArray, more: float, spread: FloatArray, information: FloatArray) -> bool:
    """Whether equal weights would end so far from the optimum by chance in fewer than one of a million cases.

    By the shift, and by what it costs: along a curved valley it is far for little.

    Args:
        shift: of the coordinates, shape (p,).
        more: sum of squares with equal weights, beyond its least.
        spread: covariance of the estimate with equal weights, shape (p, p).
        information: with equal weights, shape (p, p).
    """
    far = float(shift @ np.linalg.pinv(spread, hermitian=True) @ shift)
    # More than each part of the sum: the largest part times a sum of p squares.
    largest = float(np.max(np.abs(np.linalg.eigvals(information @ spread))))
    return chi2_tail(len(shift), far) < DIFFERENT and chi2_tail(len(shift), more / largest) < DIFFERENT


def _spread(lines: list[RecordBins], spectra: Sequence[NoiseSpectrum]) -> FloatArray:
    """Covariance of the estimate with equal weights in the noise that is there."""
    levels = [spectrum.psd for spectrum in spectra]
    return sandwich([(record.jacobian, equal(record), level) for record, level in zip(lines, levels, strict=True)])


def _draw(record: RecordBins, spectrum: NoiseSpectrum) -> FloatArray:
    """Pull of noise of the reference that may be left (95 %) at each coordinate, Σ weight Re ∂H* H σx², shape (p,)."""
    if record.model is None:
        return np.zeros(len(record.z))
    weighted = record.model.through() * (record.one_sided * spectrum.excited * spectrum.doubt() / spectrum.psd)
    return np.array([float(np.vdot(slope, weighted).real) for slope in record.model.jacobian()])
