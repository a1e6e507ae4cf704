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
from vibrident.data.records import FloatArray
from vibrident.fit.bins import RecordBins
from vibrident.fit.descent.iterate import (
    Iterate,
    around,
    beside_hum,
    finite,
    iterate_at,
)
from vibrident.fit.noise.found import SpectralNoise, doubtful
from vibrident.fit.noise.motion import NEAREST, motion_of
from vibrident.fit.noise.spectrum import DOUBT, NoiseSpectrum
from vibrident.fit.optimise import Bent
from vibrident.fit.problem import Coordinates, NetworkProblem

#: Evaluations of the network at most, straight on and along a valley.
EVALUATIONS, ALONG_A_VALLEY = 16, 30
#: The step, in standard deviations, at which no further evaluation is needed.
SETTLED = 0.02
#: A step that does not lead down is damped, by this factor more after each further one, which doubles each time.
DAMPED, MORE_DAMPED, LESS_DAMPED = 1.0, 4.0, 0.2
#: A descent that comes no closer by this factor in more steps than these in a row does not arrive.
CLOSER, MOST_SLOW = 0.8, 3


@dataclass(frozen=True)
class Reweighted:
    """The estimate weighted by the noise.

    Attributes:
        z: the optimum, shape (p,).
        covariance: of z, including the uncertainty of noise of the reference, shape (p, p).
        degrees_of_freedom: behind the noise spectra.
        noise: of the reference, and hum.
    """

    z: FloatArray
    covariance: FloatArray
    degrees_of_freedom: float
    noise: SpectralNoise


def reweighted(
    problem: NetworkProblem,
    coordinates: Coordinates,
    begins: Sequence[FloatArray],
    noise: FloatArray,
    bent: Bent | None = None,
) -> Reweighted | None:
    """Go to the optimum of the noise as it is; None where that is not reached, or the misfit is no noise.

    Args:
        problem: the records.
        coordinates: the map from z to parameters.
        begins: where to begin, each of shape (p,): the optimum of equal weights; if nothing leads on from there, the
            next: noise of the reference may draw equal weights far aside.
        noise: standard deviation by which each record was weighted, shape (records,).
        bent: where a damped step leads to if not straight on.
    """
    evaluate = functools.partial(problem.lines, coordinates=coordinates, noise=noise)
    for z in begins:
        lines = _evaluated(evaluate, z)
        if not finite(lines):
            continue
        motions = [motion_of(record) for record in lines]
        here = iterate_at(lines, motions, beside_hum(lines, motions), z)
        del motions  # of a long record each copy counts
        if here is None:
            continue
        if here.astray(lines):
            return None
        here = _down(here, lines, evaluate, bent)
        if not here.astray(lines) and (here.end is not None or here.far <= 0.3):
            return _arrived(here, lines, evaluate, problem, noise)
    return None


def _arrived(
    here: Iterate,
    lines: list[RecordBins],
    evaluate: Callable[[FloatArray], list[RecordBins]],
    problem: NetworkProblem,
    noise: FloatArray,
) -> Reweighted:
    """The estimate at the last iterate; ``lines``: the records there, or where a step was tried last."""
    if lines[0].z is not here.z:
        lines = evaluate(here.z)
    spectra = here.spectra
    pulls = [here.inverse @ _draw(*pair) / DOUBT for pair in zip(lines, spectra, strict=True)]
    covariance = here.covariance + np.sum([np.outer(pull, pull) for pull in pulls], axis=0)
    give_back_after(max(record.samples for record in lines))
    untold = np.array([pull for pull, spectrum in zip(pulls, spectra, strict=True) if not spectrum.free])
    untold = untold.reshape(-1, len(here.z))
    tones = tuple(
        tuple(place * given.sampling_rate_hz / max(record.samples, 1) for place in spectrum.tones)
        for given, record, spectrum in zip(problem.records, lines, spectra, strict=True)
    )
    reference = np.sqrt([spectrum.input_noise for spectrum in spectra]) * noise
    found = SpectralNoise(reference, doubtful(untold, covariance), tones, untold)
    freedom = sum(4.0 * (around(record) - NEAREST) for record in lines)
    return Reweighted(here.z if here.end is None else here.end, covariance, freedom, found)


def _down(
    here: Iterate,
    lines: list[RecordBins],
    evaluate: Callable[[FloatArray], list[RecordBins]],
    bent: Bent | None,
) -> Iterate:
    """The last iterate of a descent; ``lines`` hold the records at the last iterate that was tried."""
    damping, part, rejected, slow, least = 0.0, 1.0, 0, 0, here.far
    for _ in range((EVALUATIONS if bent is None else ALONG_A_VALLEY) - 1):
        arrived = here.end is not None or here.far <= SETTLED
        if arrived or not np.isfinite(here.far) or slow > MOST_SLOW or here.astray(lines):
            break
        trial, there = here.ahead(damping, bent, part), None
        if np.all(np.abs(trial - here.z) <= 3.0 * np.maximum(np.abs(here.z), 1.0)):  # near enough to be linear
            lines.clear()  # of long records they are most of the memory
            lines += _evaluated(evaluate, trial)
            give_back_after(max(record.samples for record in lines))
            if finite(lines) and here.leads_to(lines):
                there = iterate_at(lines, [motion_of(record) for record in lines], list(here.spectra), trial, SETTLED)
        if there is None:
            damping = max(DAMPED, damping * MORE_DAMPED * 2.0**rejected)
            rejected, slow = rejected + 1, slow + 1
        else:
            slow, least = slow + 1 if there.far > CLOSER * least else 0, min(least, there.far)
            if damping == 0.0 and there.far > 0.7 * here.far:
                part *= 0.5  # the noise as read at either end leads back to the other
            here, rejected = there, 0
            damping = damping * LESS_DAMPED if damping > DAMPED else 0.0
    return here


def _evaluated(evaluate: Callable[[FloatArray], list[RecordBins]], z: FloatArray) -> list[RecordBins]:
    """Return the records at a place where the network need not be finite."""
    with np.errstate(all="ignore"):
        return evaluate(z)


def _draw(record: RecordBins, spectrum: NoiseSpectrum) -> FloatArray:
    """Pull of noise of the reference that may be left (95 %) at each coordinate, Σ weight Re ∂H* H σx², shape (p,)."""
    if record.model is None:
        return np.zeros(len(record.z))
    weighted = record.model.through() * (record.one_sided * spectrum.excited * spectrum.doubt() / spectrum.psd)
    return np.array([float(np.vdot(slope, weighted).real) for slope in record.model.jacobian()])
