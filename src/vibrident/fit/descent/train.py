"""Training of the network over records, from data to estimate: motion and noise, start, descent."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.errors import InputError, NotConverged
from vibrident.data.records import FloatArray
from vibrident.fit.descent.in_noise import iterate
from vibrident.fit.descent.likelihoods import mean_minus_two_log_likelihood
from vibrident.fit.descent.rivals import with_rivals
from vibrident.fit.descent.settle import (
    MAX_START_COST,
    NO_FIT,
    START_TOLERANCE,
    Descended,
    Settled,
    descend,
    in_own_noise,
    settle,
)
from vibrident.fit.descent.weighting import SegmentNoise, Weighting
from vibrident.fit.noise.averages import averaged_bins, mean_around
from vibrident.fit.noise.spectrum import NoiseSpectrum
from vibrident.fit.optimise import NOT_FINITE, Progress, Trace
from vibrident.fit.problem import Coordinates, Evidence
from vibrident.fit.problem.band import Band
from vibrident.fit.problem.bin_problem import BinProblem
from vibrident.fit.response.transform import power_of
from vibrident.fit.start.at_bins import candidates
from vibrident.fit.start.delay import rough_delay
from vibrident.fit.start.motion_and_noise import (
    MotionAndNoise,
    estimate_motion_and_noise,
    loud_bins,
)
from vibrident.physics.discretisation import Method
from vibrident.physics.models import SensorModel

#: Starts that descend: of a model whose parameters are few and free …
FEW_STARTS = 2
#: … and of others.
STARTS = 4
#: Share of the response's power that a fit must explain for its model to be at fault at all.
MIN_EXPLAINED_SHARE = 0.5
#: V for each number above which a model does not explain the records.
MAX_EXPLAINED_COST = 30.0
#: A delay at which motion is heard in less than this fraction of the bins of another is tried last.
MIN_HEARD_FRACTION = 0.5
#: Starts that settle, of all that compete in their own noise.
MAX_SETTLED = 4
#: Searches in the noise of an estimate, each in that of the last …
SEARCHES_IN_OWN_NOISE = 5
#: … while −2 log of the likelihood of each number falls by more.
MIN_GAIN = 1e-3
#: Rounds that estimate the relative error of such a model.
MODEL_ERROR_ROUNDS = 2


def train(evidence: Evidence, method: Method, progress: Progress) -> Settled:
    """Return the estimate of a linear model, whose network is trained on the records.

    Args:
        evidence: the records.
        method: the discretisation.
        progress: called after each iteration.

    Raises:
        InputError: no record is long enough.
        NotConverged: no start leads to a finite fit.
    """
    best: _Descents | None = None
    reason: Exception = NotConverged(NOT_FINITE)
    for band, observed in _observations(evidence, method):
        try:
            descents = _Descents.at(evidence, _Survey(band, observed), progress)
        except NO_FIT as error:
            reason = error  # at this delay; another may lead to a fit
            continue
        if best is None or descents.rank < best.rank:
            best = descents
        if not best.explains_little and best.cost_per_number < MAX_START_COST:
            break
    if best is None:
        raise reason
    return best.settled(evidence, progress)


def train_anew(evidence: Evidence, method: Method, progress: Progress) -> Settled:
    """Return the likeliest estimate of all starts, each in the noise that is read at it.

    Noise that is known without a model may be far too high, as beside a resonance narrower than a
    bin: a wrong place then seems to explain the records. Here the places of the grid at all delays
    compete, and the ends of descents from them; the grid is searched again in the noise at the
    likeliest. Arguments and errors are those of :func:`train`.
    """
    candidates: list[tuple[float, Descended, _Descents]] = []
    for band, observed in _observations(evidence, method, well_heard=True):
        survey = _Survey(band, observed)
        weighting = _without_model(band, observed)
        starts = survey.places
        try:
            ends = _descended(evidence, survey, weighting, starts, progress, all_starts=True)
        except NO_FIT:
            ends = []
        descents = _Descents(survey, weighting, ends)
        for end in [*ends, *descents.undescended(evidence, starts)]:
            try:
                _, in_own = in_own_noise(end, observed)
            except NO_FIT:
                continue
            score = mean_minus_two_log_likelihood(in_own.at.groups)
            candidates.append((score, end, descents))
    candidates.sort(key=lambda candidate: candidate[0])
    settled: list[tuple[Settled, _Descents]] = []
    for _, end, descents in candidates[:MAX_SETTLED]:
        try:
            estimate = settle(end, descents.survey.observed, descents.weighting, progress)
        except NO_FIT:
            continue
        settled.append((estimate, descents))
    if not settled:
        raise NotConverged(NOT_FINITE)
    best, descents = min(settled, key=lambda pair: mean_minus_two_log_likelihood(pair[0].places))
    return _searched_in_own_noise(evidence, best, descents, progress)


def _searched_in_own_noise(
    evidence: Evidence, best: Settled, descents: _Descents, progress: Progress
) -> Settled:
    """Return the likeliest estimate of searches, each in the noise that the last one left.

    V in the noise that is read at a place, with the logarithm of that noise, bounds −2 log of the
    likelihood of any other place from above: where V is lower, the likelihood is higher (majorise
    and minimise; Hunter & Lange 2004).
    """
    observed = descents.survey.observed
    factor_values = descents.survey.band.problem.frame.factor_values
    score = mean_minus_two_log_likelihood(best.places)
    weighting = best.weighting
    band = best.band
    likeliest: Descended | None = None
    for _ in range(SEARCHES_IN_OWN_NOISE):
        band = band.at_factors_of(factor_values)
        weighting = weighting.in_all_bins()
        moved = observed.moved(descents.survey.band, band)
        survey = _Survey(band, replace(moved, weights=_weights(band, weighting)))
        try:
            ends = _descended(evidence, survey, weighting, survey.places, progress, all_starts=True)
            noises = [in_own_noise(end, observed) for end in ends]
        except NO_FIT:
            break
        scores = [mean_minus_two_log_likelihood(end.at.groups) for _, end in noises]
        place = int(np.argmin(scores))
        if not scores[place] < score - MIN_GAIN:
            break
        arrived = likeliest is not None and likeliest.squared_distance(ends[place].values) < 1.0
        weighting, likeliest = noises[place]
        if arrived:
            break
        score = scores[place]
        band = likeliest.band
    if likeliest is None:
        return best
    try:
        estimate = settle(likeliest, observed, weighting, progress)
    except NO_FIT:
        return best
    return min(best, estimate, key=lambda settled: mean_minus_two_log_likelihood(settled.places))


def _observations(
    evidence: Evidence, method: Method, *, well_heard: bool = False
) -> Iterator[tuple[Band, MotionAndNoise]]:
    """Yield the band with its motion and noise; with a delay, at none and at the likeliest two.

    The shorter delay comes first: a long one leaves out the samples that could refute it. Last
    comes a delay at which motion is heard in few bins, unless only ``well_heard`` ones are tried.
    """
    model = evidence.model
    start = evidence.start or _neutral_values(evidence)

    def problem_at(values: Mapping[str, float], top_hz: float) -> BinProblem:
        records = evidence.records
        return BinProblem.build(records, model, method, evidence.quantity, values, top_hz)

    # A look projects out whatever is smooth in frequency times the reference, errors of the inputs
    # included. It shows up to which frequency the inputs of the fit must be accurate.
    look = Band(problem_at(start, 0.0), np.inf)
    observed = estimate_motion_and_noise(look)
    looks = {float(look.problem.frame.delay_s): (start, look, observed)}
    if model.has_delay and evidence.start is None:
        for masks in ([observed.heard_in(group) for group in look.groups], loud_bins(look)):
            delay_s = rough_delay(look, masks, observed.band_hz[1])
            if delay_s not in looks:
                values = _with_delay(model, start, delay_s)
                delayed = Band(problem_at(values, 0.0), np.inf)
                looks[delay_s] = values, delayed, estimate_motion_and_noise(delayed)
    largest = max(observed.count for _, _, observed in looks.values())
    frame = look.problem.frame
    unknowns = len(model.parameters) + frame.order * len(look.problem.segments)

    def is_hardly_heard(delay_s: float) -> bool:
        return looks[delay_s][2].count < MIN_HEARD_FRACTION * largest

    for delay_s in sorted(looks, key=lambda delay_s: (is_hardly_heard(delay_s), abs(delay_s))):
        if well_heard and is_hardly_heard(delay_s):
            break
        values, look, observed = looks[delay_s]
        if 2.0 * largest <= unknowns:  # of two numbers a bin
            observed = observed.heard_everywhere(look)
        top_hz = observed.band_hz[1]
        if np.isinf(look.problem.frame.top_hz):
            yield look.within(top_hz), observed
            continue
        band = Band(problem_at(values, top_hz), top_hz)
        yield band, observed.moved(look, band)


@dataclass(frozen=True, eq=False)
class _Survey:
    """Segments, with motion and noise before any model.

    Attributes:
        band: the segments.
        observed: motion and noise.
    """

    band: Band
    observed: MotionAndNoise

    @functools.cached_property
    def places(self) -> list[dict[str, float]]:
        """Return the best places of the grid; more where parameters may trade."""
        model = self.band.model
        stated = any(spec.start is not None for spec in model.parameters)
        has_add_ons = len(model.parameters) > len(model.core.parameters)
        count = STARTS if stated or model.has_delay or has_add_ons else FEW_STARTS
        return [candidate.values for candidate in candidates(self.band, self.observed, count)]

    def at(self, evidence: Evidence, values: dict[str, float]) -> tuple[Band, Coordinates]:
        """Return the segments at the delay of start values, and the coordinates near these.

        Raises:
            InputError: the delay leaves no samples.
        """
        band_hz = self.observed.band_hz
        coordinates = Coordinates.at(evidence.model, values, band_hz, evidence.response_size)
        return self.band.at_delay_of(values).at_ringing_of(values), coordinates

    def starts(self, evidence: Evidence) -> Iterator[dict[str, float]]:
        """Yield start values, the likeliest first: those known, and the places of the grid."""
        if evidence.start is not None:
            yield dict(evidence.start)
        yield from self.places


@dataclass(frozen=True, eq=False)
class _Descents:
    """Descents from start values in the noise that is known without a model.

    Attributes:
        survey: the segments, with motion and noise before any model.
        weighting: the noise.
        ends: of the descents.
    """

    survey: _Survey
    weighting: Weighting
    ends: list[Descended]

    @classmethod
    def at(cls, evidence: Evidence, survey: _Survey, progress: Progress) -> _Descents:
        """Return the descents from the start values of a survey.

        Where none explains the records, more begin in a search with a model error.
        """
        weighting = _without_model(survey.band, survey.observed)
        starts = survey.starts(evidence)
        descents = cls(survey, weighting, _descended(evidence, survey, weighting, starts, progress))
        explains = descents.cost_per_number < MAX_START_COST
        if explains or evidence.is_trial or evidence.start is not None:
            return descents
        return descents._repeated(evidence, progress)

    @property
    def count(self) -> float:
        """Return the count of numbers that show motion."""
        return 2.0 * self.survey.observed.count

    @property
    def best(self) -> Descended:
        """Return the likeliest descent."""
        return min(self.ends, key=lambda end: end.score)

    @property
    def cost_per_number(self) -> float:
        """Return V of the best for each number that shows motion."""
        return self.best.at.cost / self.count if self.count else np.inf

    @property
    def explains_little(self) -> bool:
        """Return whether the best leaves most of the response, free motion apart, as noise.

        Two transients have a smooth ratio, whatever their origin: a wrong delay hears motion, too.
        """
        return self.best.explained < MIN_EXPLAINED_SHARE

    @property
    def rank(self) -> tuple[bool, float]:
        """Return what orders the descents at several delays, the best first."""
        return self.explains_little, self.cost_per_number

    def _repeated(self, evidence: Evidence, progress: Progress) -> _Descents:
        """Return these descents and more of a search at the delay of the best, with a model error.

        Bins of very little noise mislead a model that does not suit them: they count for less.
        """
        # A factor that is zero at a frequency carries no information there on other values.
        band = self.best.band.at_factors_of(self.survey.band.problem.frame.factor_values)
        observed = estimate_motion_and_noise(band)
        wider = with_model_error(_without_model(band, observed), self.best, self.count)
        survey = _Survey(band, replace(observed, weights=_weights(band, wider)))
        rough_ends = _descended(evidence, survey, wider, survey.places, progress, all_starts=True)
        ends = _descended(
            evidence,
            self.survey,
            self.weighting,
            _different(rough_ends),
            progress,
            all_starts=True,
        )
        return replace(self, ends=[*self.ends, *ends])

    def settled(self, evidence: Evidence, progress: Progress) -> Settled:
        """Return the estimate; with a model error where no descent explains the records."""
        explains = self.cost_per_number < MAX_EXPLAINED_COST
        descents = self
        for _ in range(0 if explains else MODEL_ERROR_ROUNDS):
            best = descents.best
            wider = with_model_error(self.weighting, best, self.count)
            ends = _descended(evidence, self.survey, wider, [best.values], progress)
            descents = replace(self, ends=ends)
        observed = self.survey.observed
        best = settle(descents.best, observed, self.weighting, progress, explains=explains)
        if not explains:
            return best
        rivals = [end for end in descents.ends if end is not descents.best]
        return with_rivals(best, rivals, observed, progress)

    def undescended(
        self, evidence: Evidence, places: Sequence[dict[str, float]]
    ) -> Iterator[Descended]:
        """Yield places as ends of descents of no step."""
        for values in places:
            try:
                band, coordinates = self.survey.at(evidence, values)
            except InputError:
                continue
            z = coordinates.first
            point = iterate(band, coordinates, self.weighting.of_groups(band), z)
            if point.groups:
                trace = Trace("", True, "", (point.cost,), z[None])
                yield Descended(band, coordinates, trace, point)


def _weights(band: Band, weighting: Weighting) -> dict[int, FloatArray]:
    """Return the weights of the bins of each segment in a noise, shape (K,) each."""
    weights: dict[int, FloatArray] = {}
    for group, noise in zip(band.groups, weighting.of_groups(band), strict=True):
        rows = group.grid.counts * noise.excited / noise.response
        weights |= zip(group.segments, rows, strict=True)
    return weights


def with_model_error(weighting: Weighting, end: Descended, squares: float) -> Weighting:
    """Return the noise with a relative error of the model added, the same at all bins.

    It is as large as the deviations of a descent demand (Mandel & Paule 1970), so that bins of very
    little noise do not dominate where no model suits.

    Args:
        weighting: the noise.
        end: of a descent.
        squares: target of the weighted sum of squares.
    """
    rows: list[tuple[int, SegmentNoise, FloatArray, FloatArray]] = []
    for place in end.at.groups:
        grid = place.group.grid
        response = power_of(place.group.response) / place.group.count[:, None]
        residual = power_of(place.rows.residual) / place.group.count[:, None]
        squares_left = residual * grid.counts * grid.samples
        smooth = mean_around(response, averaged_bins(response.shape[1]), 0)
        for row, number in enumerate(place.group.segments):
            noise = weighting.of_segment(number)
            psd, _, _, excited = noise.at_bins(grid)
            zeros = np.zeros_like(psd)
            spectrum = replace(noise.spectrum, psd=psd, excited=excited, input_noise_at=zeros)
            response_noise = SegmentNoise(spectrum, zeros, grid.samples)
            rows.append((number, response_noise, smooth[row], squares_left[row]))

    def wider_psd(noise: SegmentNoise, power: FloatArray, error: float) -> FloatArray:
        return noise.spectrum.psd + error * power

    def total(error: float) -> float:
        return sum(
            float(np.sum(squares * noise.spectrum.excited / wider_psd(noise, power, error)))
            for _, noise, power, squares in rows
        )

    low = np.log(1e-30)
    high = 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if total(float(np.exp(middle))) > squares else (low, middle)
    error = float(np.exp(high))
    return Weighting(
        {
            number: replace(
                noise, spectrum=replace(noise.spectrum, psd=wider_psd(noise, power, error))
            )
            for number, noise, power, _ in rows
        }
    )


def _neutral_values(evidence: Evidence) -> dict[str, float]:
    """Return values at which the inputs suit any place of the grid."""
    rate_hz = max(record.sampling_rate_hz for record in evidence.records)
    values = {}
    for spec in evidence.model.parameters:
        typical = {"log": 0.5 * rate_hz, "positive": 1.0, "gain": 1.0, "duration": 1.0 / rate_hz}
        values[spec.name] = typical.get(spec.kind or "", 0.0) if spec.start is None else spec.start
    return values


def _with_delay(
    model: SensorModel, values: Mapping[str, float], delay_s: float
) -> dict[str, float]:
    """Return values with another delay."""
    delayed = dict(values)
    for spec in model.parameters:
        if spec.kind == "time":
            delayed[spec.name] = delay_s
    return delayed


def _descended(
    evidence: Evidence,
    survey: _Survey,
    weighting: Weighting,
    starts: Iterable[dict[str, float]],
    progress: Progress,
    *,
    all_starts: bool = False,
) -> list[Descended]:
    """Return the ends of descents from starts in a noise.

    Unless ``all_starts``, up to one that explains everything, or to the values that are known where
    these lead to a misfit; of two modes several starts may explain, unless values are known.
    """
    all_starts = all_starts or (evidence.start is None and bool(evidence.model.shares))
    ends: list[Descended] = []
    reason: Exception = NotConverged(NOT_FINITE)
    numbers = 2.0 * survey.observed.count
    for values in starts:
        try:
            band, coordinates = survey.at(evidence, values)
            end = descend(
                band,
                coordinates,
                coordinates.first,
                weighting,
                START_TOLERANCE,
                progress,
                max_cost=MAX_EXPLAINED_COST * numbers,
            )
        except NO_FIT as error:
            reason = error
            continue
        ends.append(end)
        cost = end.at.cost / numbers if numbers else np.inf
        is_misfit = evidence.start is not None and cost >= MAX_EXPLAINED_COST
        if not all_starts and (cost < MAX_START_COST or is_misfit):
            break
    if not ends:
        raise reason
    return ends


def _different(ends: Sequence[Descended]) -> list[dict[str, float]]:
    """Return the values at the ends of descents, the best first, each bottom once."""
    chosen: list[Descended] = []
    for end in sorted(ends, key=lambda descended: descended.score):
        if not any(better.is_at(end.values) for better in chosen):
            chosen.append(end)
    return [end.values for end in chosen]


def _without_model(band: Band, observed: MotionAndNoise) -> Weighting:
    """Return the noise that is known without a model."""
    segments: dict[int, SegmentNoise] = {}
    for group in band.groups:
        share = 1.0 / group.count[:, None]
        levels = observed.levels_in(group)
        weights = observed.shown_in(group) * (group.grid.samples * share)
        floors = band.problem.noise_floor[band.owners(group)] ** 2
        psd = np.maximum(levels.total * share, floors[:, None])
        reference = levels.reference * share
        zeros = np.broadcast_to(0.0, psd.shape)
        for row, number in enumerate(group.segments):
            input_noise = float(np.mean(reference[row]))
            spectrum = NoiseSpectrum(
                psd[row], input_noise, reference[row], zeros[row], weights[row], group.grid.tones
            )
            segments[number] = SegmentNoise(spectrum, levels.passed[row], group.grid.samples)
    return Weighting(segments)
