"""The network over records, from data to estimate: look, start, descent and noise."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from vibrident.base.errors import InputError, NotConverged
from vibrident.data.records import FloatArray
from vibrident.fit.descent.settle import (
    ENOUGH,
    ROUGH,
    Descended,
    Settled,
    descend,
    settle,
)
from vibrident.fit.descent.weighting import Weighting, brought
from vibrident.fit.group.band import Band
from vibrident.fit.noise.motion import lines_around
from vibrident.fit.noise.spectrum import NoiseSpectrum
from vibrident.fit.optimise import NOT_FINITE, Progress
from vibrident.fit.problem import Coordinates, Evidence
from vibrident.fit.problem.bin_problem import BinProblem
from vibrident.fit.response.transform import mean_around, power_of
from vibrident.fit.start.at_bins import candidates, rough_delay
from vibrident.fit.start.look import Look, look_at, loud_bins
from vibrident.physics.discretisation import Method
from vibrident.physics.models import SensorModel

#: Starts that go down: of a model whose parameters are few and free, and of others.
FEW_STARTS = 2
STARTS = 4
#: V over the number of numbers above which a model does not explain the records.
MISFIT = 30.0
#: Part of the loud bins in which motion is heard, if no delay hides it from the look.
MOSTLY = 0.5
#: Rounds in which the relative error of such a model is found.
MODEL_ERROR_ROUNDS = 2


def train(evidence: Evidence, method: Method, progress: Progress) -> Settled:
    """Train the network of a linear model.

    Raises:
        InputError: no record is long enough.
        NotConverged: no start leads to a finite fit.
    """
    model = evidence.model
    start = evidence.start or _before(evidence)
    problem = BinProblem.build(evidence.records, model, method, evidence.quantity, start)
    band = Band(problem, np.inf)
    look = look_at(band)
    if model.has_delay and evidence.start is None:
        band, look = _at_rough_delay(evidence, method, start, band, look)
    band = band.within(look.band_hz[1])
    weighting = _without_model(band, look)
    count = 2.0 * look.count
    started = evidence.start is not None
    known = [dict(evidence.start)] if started else []
    some = _candidates(band, look)
    ends = _descended(evidence, band, look, weighting, itertools.chain(known, some), progress)
    if not started and _least(ends).at.cost > ENOUGH * count:
        # Bins of very little noise lead a model that does not suit them astray: they are told less.
        best = _least(ends)
        here = best.band
        there = look_at(here)
        wider = with_model_error(_without_model(here, there), best, count)
        more = _candidates(here, replace(there, weights=_weights(here, wider)))
        rough = _descended(evidence, here, there, wider, more, progress, every=True)
        begins = [end.coordinates.values(end.z) for end in rough]
        ends += _descended(evidence, band, look, weighting, begins, progress, every=True)
    explains = _least(ends).at.cost < MISFIT * count
    if not explains:
        for _ in range(MODEL_ERROR_ROUNDS):
            best = _least(ends)
            wider = with_model_error(weighting, best, count)
            begins = [best.coordinates.values(best.z), *known, *_candidates(band, look)]
            ends = _descended(evidence, band, look, wider, begins, progress, every=True)
    return settle(ends, look, weighting, progress, explains=explains)


def _at_rough_delay(
    evidence: Evidence, method: Method, start: Mapping[str, float], band: Band, look: Look
) -> tuple[Band, Look]:
    """Return the band with inputs at a delay at which most motion is heard, and the look there."""
    model = evidence.model
    loud = loud_bins(band)
    masks = [{number: heard for number, (_, heard) in look.heard.items()}]
    if look.count < MOSTLY * sum(np.sum(each) for each in loud.values()):
        masks.append(loud)
    best = band, look
    most = 0.0
    for mask in masks:
        late = rough_delay(band, mask, look.band_hz[1])
        values = _with_delay(model, start, late)
        problem = BinProblem.build(evidence.records, model, method, evidence.quantity, values)
        here = Band(problem, np.inf)
        there = look_at(here)
        if there.count > most:
            best = here, there
            most = there.count
    return best


def _candidates(band: Band, look: Look) -> Iterator[dict[str, float]]:
    """Yield places of the grid; those of a model whose parameters may trade are more."""
    model = band.model
    more = model.has_delay or len(model.parameters) > len(model.core.parameters)
    for candidate in candidates(band, look, STARTS if more else FEW_STARTS):
        yield candidate.values


def _weights(band: Band, weighting: Weighting) -> dict[int, FloatArray]:
    """Return the weights of each segment's bins in a noise, shape (K,) each."""
    weights: dict[int, FloatArray] = {}
    for group, noise in zip(band.groups, weighting.of_groups(band), strict=True):
        rows = group.grid.counts * noise.excited / noise.response
        weights |= zip(group.segments, rows, strict=True)
    return weights


def _least(ends: Sequence[Descended]) -> Descended:
    """Return the descent that leaves least."""
    return min(ends, key=lambda end: end.at.cost)


def with_model_error(weighting: Weighting, end: Descended, squares: float) -> Weighting:
    """Return the noise with a relative error of the model, the same at all bins, on top.

    It is as large as the deviations of a descent demand (Mandel & Paule 1970), so that bins of
    very little noise do not rule where no model suits.

    Args:
        weighting: the noise.
        end: where a descent ended.
        squares: what the weighted sum of squares should be.
    """
    samples = dict(weighting.samples)
    powers: dict[int, FloatArray] = {}
    residuals: dict[int, FloatArray] = {}
    for at in end.at.groups:
        response = power_of(at.group.response) / at.group.count[:, None]
        rest = power_of(at.rows.residual) / at.group.count[:, None]
        for row, number in enumerate(at.group.segments):
            width = lines_around(response[row])
            powers[number] = mean_around(response[row], width, 0)
            residuals[number] = rest[row] * at.group.grid.counts * at.group.grid.samples

    def total(error: float) -> float:
        return sum(
            float(np.sum(rest * spectra[number].excited / (spectra[number].psd + error * powers[number])))
            for number, rest in residuals.items()
        )

    spectra = dict(weighting.spectra)
    for at in end.at.groups:
        for number in at.group.segments:
            spectrum = spectra[number]
            psd = brought(spectrum.psd, weighting.samples[number], at.group.grid)
            excited = brought(spectrum.excited, weighting.samples[number], at.group.grid)
            spectra[number] = replace(spectrum, psd=psd, excited=excited)
            samples[number] = at.group.grid.samples
    low, high = np.log(1e-30), 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if total(float(np.exp(middle))) > squares else (low, middle)
    error = float(np.exp(high))
    wider = {
        number: replace(spectrum, psd=spectrum.psd + error * powers[number]) for number, spectrum in spectra.items()
    }
    nothing = {number: np.zeros_like(own.psd) for number, own in wider.items()}
    wider = {number: replace(own, input_noise_at=nothing[number]) for number, own in wider.items()}
    return Weighting(wider, nothing, samples)


def _before(evidence: Evidence) -> dict[str, float]:
    """Return values with which inputs suit any place of the grid."""
    rate_hz = max(record.sampling_rate_hz for record in evidence.records)
    values = {}
    for spec in evidence.model.parameters:
        typical = {"log": 0.5 * rate_hz, "positive": 1.0, "gain": 1.0, "duration": 1.0 / rate_hz}
        values[spec.name] = typical.get(spec.kind, 0.0)
    return values


def _with_delay(model: SensorModel, values: Mapping[str, float], late_s: float) -> dict[str, float]:
    moved = dict(values)
    for spec in model.parameters:
        if spec.kind == "time":
            moved[spec.name] = late_s
    return moved


def _descended(
    evidence: Evidence,
    band: Band,
    look: Look,
    weighting: Weighting,
    starts: Iterable[dict[str, float]],
    progress: Progress,
    *,
    every: bool = False,
) -> list[Descended]:
    """Return where the starts lead in a noise; unless ``every``, up to one that explains all."""
    ends: list[Descended] = []
    reason: Exception = NotConverged(NOT_FINITE)
    count = look.count
    for values in starts:
        coordinates = Coordinates.at(evidence.model, values, look.band_hz, evidence.response_size)
        try:
            here = band.at_delay_of(values).beside_ringing(values)
            end = descend(here, coordinates, coordinates.first, weighting, ROUGH, progress)
        except (NotConverged, InputError, np.linalg.LinAlgError) as error:
            reason = error
            continue
        ends.append(end)
        if not every and end.at.cost < ENOUGH * 2.0 * count:
            break
    if not ends:
        raise reason
    return ends


def _without_model(band: Band, look: Look) -> Weighting:
    """Return the noise that is known without a model."""
    spectra: dict[int, NoiseSpectrum] = {}
    passed: dict[int, FloatArray] = {}
    samples: dict[int, int] = {}
    for group in band.groups:
        levels = look.levels_in(group) / group.count[:, None]
        every = look.shown_in(group) * (group.grid.samples / group.count[:, None])
        floors = band.problem.noise_floor[band.owners(group)] ** 2
        for row, number in enumerate(group.segments):
            psd = np.maximum(levels[row], floors[row])
            nothing = np.broadcast_to(0.0, psd.shape)
            excited = every[row]
            spectra[number] = NoiseSpectrum(
                psd, 0.0, nothing, lambda nothing=nothing: nothing, excited, group.grid.tones
            )
            passed[number] = nothing
            samples[number] = group.grid.samples
    return Weighting(spectra, passed, samples)
