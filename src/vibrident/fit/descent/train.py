"""The network over records, from data to estimate: look, start, descent and noise."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

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
from vibrident.fit.noise.averages import averaged_bins, mean_around
from vibrident.fit.noise.spectrum import NoiseSpectrum
from vibrident.fit.optimise import NOT_FINITE, Progress
from vibrident.fit.problem import Coordinates, Evidence
from vibrident.fit.problem.band import Band
from vibrident.fit.problem.bin_problem import BinProblem
from vibrident.fit.response.transform import power_of
from vibrident.fit.start.at_bins import candidates
from vibrident.fit.start.delay import rough_delay
from vibrident.fit.start.look import Look, look_at, loud_bins
from vibrident.fit.start.start import find_start
from vibrident.physics.discretisation import Method
from vibrident.physics.models import SensorModel

#: Starts that go down: of a model whose parameters are few and free, and of others.
FEW_STARTS = 2
STARTS = 4
#: V over the number of numbers above which a model does not explain the records.
MISFIT = 30.0
#: A delay at which motion is heard in less than this part of the bins of another is not tried.
MOSTLY = 0.5
#: Rounds in which the relative error of such a model is found.
MODEL_ERROR_ROUNDS = 2


def train(
    evidence: Evidence, method: Method, progress: Progress, *, level: bool = False
) -> Settled:
    """Train the network of a linear model.

    Args:
        evidence: the records.
        method: the discretisation.
        progress: called after each iteration.
        level: whether the start is sought in noise of one level in each record. What a narrow
            resonance leaves looks like noise to a model without it, wherever noise is read.

    Raises:
        InputError: no record is long enough.
        NotConverged: no start leads to a finite fit.
    """
    best: _Begun | None = None
    for band, look in _looks(evidence, method):
        seen = _Seen(band, look.levelled() if level else look)
        begun = _Begun.at(evidence, seen, progress)
        if best is None or begun.left < best.left:
            best = begun
        if best.left < ENOUGH:
            break
    assert best is not None
    return best.settled(evidence, progress)


def _looks(evidence: Evidence, method: Method) -> Iterator[tuple[Band, Look]]:
    """Yield the band of the motion and what is seen there; with a delay, at the likeliest two."""
    model = evidence.model
    start = evidence.start or _before(evidence)
    problem = BinProblem.build(evidence.records, model, method, evidence.quantity, start)
    band = Band(problem, np.inf)
    look = look_at(band)
    if not model.has_delay or evidence.start is not None:
        yield band.within(look.band_hz[1]), look
        return
    found: dict[float, tuple[Band, Look]] = {}
    for mask in ({number: heard for number, (_, heard) in look.heard.items()}, loud_bins(band)):
        late = rough_delay(band, mask, look.band_hz[1])
        if late not in found:
            values = _with_delay(model, start, late)
            problem = BinProblem.build(evidence.records, model, method, evidence.quantity, values)
            here = Band(problem, np.inf)
            found[late] = here, look_at(here)
    most = max(there.count for _, there in found.values())
    for here, there in found.values():
        if there.count >= MOSTLY * most:
            yield here.within(there.band_hz[1]), there


@dataclass(frozen=True, eq=False)
class _Seen:
    """The segments, and what they say without a model.

    Attributes:
        band: the segments.
        look: what they say.
    """

    band: Band
    look: Look

    @functools.cached_property
    def places(self) -> list[dict[str, float]]:
        """Places of the grid; those of a model whose parameters may trade are more."""
        model = self.band.model
        stated = any(spec.start is not None for spec in model.parameters)
        more = stated or model.has_delay or len(model.parameters) > len(model.core.parameters)
        return [
            each.values for each in candidates(self.band, self.look, STARTS if more else FEW_STARTS)
        ]

    def starts(self, known: Sequence[dict[str, float]]) -> Iterator[dict[str, float]]:
        """Yield values that are known, and then the places."""
        yield from known
        yield from self.places


@dataclass(frozen=True, eq=False)
class _Begun:
    """Where start values lead in the noise that is known without a model.

    Attributes:
        seen: the segments, and what they say without a model.
        weighting: the noise.
        ends: of the descents.
    """

    seen: _Seen
    weighting: Weighting
    ends: list[Descended]

    @classmethod
    def at(cls, evidence: Evidence, seen: _Seen, progress: Progress) -> _Begun:
        """Search and go down."""
        weighting = _without_model(seen.band, seen.look)
        known = [] if evidence.start is None else [dict(evidence.start)]
        starts = seen.starts(known or _in_response(evidence))
        ends = _descended(evidence, seen, weighting, starts, progress)
        begun = cls(seen, weighting, ends)
        return begun if known or begun.left < ENOUGH else begun._again(evidence, progress)

    @property
    def count(self) -> float:
        """Numbers that show motion."""
        return 2.0 * self.seen.look.count

    @property
    def best(self) -> Descended:
        """The descent that leaves least."""
        return min(self.ends, key=lambda end: end.at.cost)

    @property
    def left(self) -> float:
        """Weighted sum of squares that the best leaves, for each number that shows motion."""
        return self.best.at.cost / self.count if self.count else np.inf

    def _again(self, evidence: Evidence, progress: Progress) -> _Begun:
        """Search again at the delay found, with a model error.

        Bins of very little noise lead a model that does not suit them astray: they are told less.
        """
        # A factor that is zero at a frequency tells nothing there of other values.
        here = self.best.band.at_factors_of(self.seen.band.problem.frame.factor_values)
        there = look_at(here)
        wider = with_model_error(_without_model(here, there), self.best, self.count)
        seen = _Seen(here, replace(there, weights=_weights(here, wider)))
        rough = _descended(evidence, seen, wider, seen.places, progress, every=True)
        begins = _different(rough)
        more_ends = _descended(evidence, self.seen, self.weighting, begins, progress, every=True)
        return replace(self, ends=[*self.ends, *more_ends])

    def settled(self, evidence: Evidence, progress: Progress) -> Settled:
        """Go on to the estimate; with a model error where no descent explains the records."""
        explains = self.left < MISFIT
        begun = self
        places = [] if explains else self.seen.places
        for _ in range(0 if explains else MODEL_ERROR_ROUNDS):
            best = begun.best
            wider = with_model_error(self.weighting, best, self.count)
            begins = [best.values, *places]
            ends = _descended(evidence, self.seen, wider, begins, progress, every=True)
            begun = replace(self, ends=ends)
            places = _different(ends)[1:]
        return settle(begun.ends, self.seen.look, self.weighting, progress, explains=explains)


def _weights(band: Band, weighting: Weighting) -> dict[int, FloatArray]:
    """Return the weights of each segment's bins in a noise, shape (K,) each."""
    weights: dict[int, FloatArray] = {}
    for group, noise in zip(band.groups, weighting.of_groups(band), strict=True):
        rows = group.grid.counts * noise.excited / noise.response
        weights |= zip(group.segments, rows, strict=True)
    return weights


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
        smooth = mean_around(response, averaged_bins(response.shape[1]), 0)
        for row, number in enumerate(at.group.segments):
            powers[number] = smooth[row]
            residuals[number] = rest[row] * at.group.grid.counts * at.group.grid.samples

    def total(error: float) -> float:
        return sum(
            float(
                np.sum(
                    rest * spectra[number].excited / (spectra[number].psd + error * powers[number])
                )
            )
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
        number: replace(spectrum, psd=spectrum.psd + error * powers[number])
        for number, spectrum in spectra.items()
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
        values[spec.name] = typical.get(spec.kind or "", 0.0) if spec.start is None else spec.start
    return values


def _in_response(evidence: Evidence) -> list[dict[str, float]]:
    """Return where the nonparametric response leads a model that states start values.

    Its grid is coarse, and a descent in the logarithm of the magnitude has hardly any dead ends.
    """
    problem = evidence.first_look
    if problem is None or not any(spec.start is not None for spec in evidence.model.parameters):
        return []
    try:
        return [find_start(problem, evidence.model).values]
    except (NotConverged, np.linalg.LinAlgError):
        return []


def _with_delay(model: SensorModel, values: Mapping[str, float], late_s: float) -> dict[str, float]:
    moved = dict(values)
    for spec in model.parameters:
        if spec.kind == "time":
            moved[spec.name] = late_s
    return moved


def _descended(
    evidence: Evidence,
    seen: _Seen,
    weighting: Weighting,
    starts: Iterable[dict[str, float]],
    progress: Progress,
    *,
    every: bool = False,
) -> list[Descended]:
    """Return where the starts lead in a noise; unless ``every``, up to one that explains all."""
    ends: list[Descended] = []
    reason: Exception = NotConverged(NOT_FINITE)
    count = seen.look.count
    for values in starts:
        coordinates = Coordinates.at(
            evidence.model, values, seen.look.band_hz, evidence.response_size
        )
        try:
            here = seen.band.at_delay_of(values).beside_ringing(values)
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


def _different(ends: Sequence[Descended]) -> list[dict[str, float]]:
    """Return the values at the ends of descents, the best first, without those that are where a better one is.

    A descent ends within a step of the bottom that would lower its cost by less than its tolerance, so two that end
    at one bottom are apart by two such steps at most.
    """
    chosen: list[Descended] = []
    for end in sorted(ends, key=lambda each: each.at.cost):
        if not any(_apart(end, other) <= 4.0 * ROUGH for other in chosen):
            chosen.append(end)
    return [end.values for end in chosen]


def _apart(end: Descended, other: Descended) -> float:
    """Return the squared distance of two ends, in standard uncertainties of the other's coordinates."""
    place = other.coordinates.place
    step = place(end.values) - place(other.values)
    return float(step @ other.at.matrix @ step)


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
            spectra[number] = NoiseSpectrum(psd, 0.0, nothing, nothing, excited, group.grid.tones)
            passed[number] = nothing
            samples[number] = group.grid.samples
    return Weighting(spectra, passed, samples)
