"""The network over records, from data to estimate: look, start, descent and noise."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from vibrident.base.errors import InputError, NotConverged
from vibrident.data.records import FloatArray
from vibrident.fit.descent.optimise import NOT_FINITE, Progress
from vibrident.fit.descent.settle import (
    ENOUGH,
    ROUGH,
    Descended,
    Settled,
    descend,
    settle,
)
from vibrident.fit.descent.weighting import Weighting
from vibrident.fit.group.band import Band
from vibrident.fit.noise.spectrum import NoiseSpectrum
from vibrident.fit.problem import Coordinates, Evidence
from vibrident.fit.problem.bin_problem import BinProblem
from vibrident.fit.start.at_bins import candidates, rough_delay
from vibrident.fit.start.look import MIN_WEIGHT, Look, look_at
from vibrident.physics.discretisation import Method
from vibrident.physics.models import SensorModel

#: Starts that go down: of a model whose parameters are few and free, and of others.
FEW_STARTS = 2
STARTS = 4


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
        late = rough_delay(band, look)
        moved = _with_delay(model, start, late)
        band = Band(BinProblem.build(evidence.records, model, method, evidence.quantity, moved), np.inf)
        look = look_at(band)
    band = band.within(look.band_hz[1])
    look = look_at(band)
    weighting = _without_model(band, look)

    def starts() -> Iterator[dict[str, float]]:
        if evidence.start is not None:
            yield dict(evidence.start)
        more = model.has_delay or len(model.parameters) > len(model.core.parameters)
        for candidate in candidates(band, look, STARTS if more else FEW_STARTS):
            yield candidate.values

    ends = _descended(evidence, band, look, weighting, starts(), progress)
    return settle(ends, look, weighting, progress)


def _before(evidence: Evidence) -> dict[str, float]:
    """Return values with which inputs suit any place of the grid."""
    rate_hz = max(record.sampling_rate_hz for record in evidence.records)
    values = {}
    for spec in evidence.model.parameters:
        typical = {"log": 0.5 * rate_hz, "positive": 1.0, "gain": 1.0, "duration": 1.0 / rate_hz}
        values[spec.name] = typical.get(spec.kind, 0.0)
    return values


def _with_delay(
    model: SensorModel, values: Mapping[str, float], late_s: float
) -> dict[str, float]:
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
) -> list[Descended]:
    """Return where the starts lead in the noise that is known without a model."""
    ends: list[Descended] = []
    reason: Exception = NotConverged(NOT_FINITE)
    count = sum(float(np.sum(weight > 2.0 * MIN_WEIGHT * np.max(weight))) for weight in look.weights)
    for values in starts:
        coordinates = Coordinates.at(evidence.model, values, look.band_hz, evidence.response_size)
        try:
            here = band.at_delay_of(values)
            end = descend(here, coordinates, coordinates.first, weighting, ROUGH, progress)
        except (NotConverged, InputError, np.linalg.LinAlgError) as error:
            reason = error
            continue
        ends.append(end)
        if end.at.cost < ENOUGH * 2.0 * count:
            break
    if not ends:
        raise reason
    return ends


def _without_model(band: Band, look: Look) -> Weighting:
    """Return the noise that is known without a model."""
    spectra: dict[int, NoiseSpectrum] = {}
    passed: dict[int, FloatArray] = {}
    samples: dict[int, int] = {}
    for group, levels, weights in zip(band.groups, look.levels, look.weights, strict=True):
        counts = np.maximum(group.grid.counts, np.finfo(float).tiny)
        floors = band.problem.noise_floor[band.owners(group)] ** 2
        for row, number in enumerate(group.segments):
            psd = np.maximum(levels[row], floors[row])
            nothing = np.broadcast_to(0.0, psd.shape)
            excited = weights[row] * levels[row] / counts
            spectra[number] = NoiseSpectrum(
                psd, 0.0, nothing, lambda nothing=nothing: nothing, excited, group.grid.tones
            )
            passed[number] = nothing
            samples[number] = group.grid.samples
    return Weighting(spectra, passed, samples)
