"""Descent from start values to the estimate in the noise of the data."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.errors import InputError, NotConverged
from vibrident.base.tails import chi2_tail
from vibrident.data.records import FloatArray
from vibrident.fit.descent.gradient import gradient_covariance, reference_pull
from vibrident.fit.descent.in_noise import (
    GroupAt,
    GroupWeights,
    Iterate,
    fitted_numbers,
    iterate,
    places_in,
)
from vibrident.fit.descent.likelihoods import minus_two_log_likelihood
from vibrident.fit.descent.weighting import Weighting, read_weighting
from vibrident.fit.information import inverse_normal, laplace_score, sandwich_covariance
from vibrident.fit.noise.shapes import DOUBT_DEVIATIONS
from vibrident.fit.noise.spectral_noise import SpectralNoise, doubtful
from vibrident.fit.optimise import Progress, Trace, levenberg_marquardt
from vibrident.fit.problem.band import Band
from vibrident.fit.problem.bin_problem import BinProblem
from vibrident.fit.problem.coordinates import Coordinates
from vibrident.fit.problem.frequency_domain import Local
from vibrident.fit.response.transform import power_of
from vibrident.fit.start.motion_and_noise import MotionAndNoise

#: What a descent may raise that leads to no fit.
NO_FIT = NotConverged, InputError, np.linalg.LinAlgError
#: Most rounds of descent and noise …
MAX_ROUNDS = 16
#: … and of moving the inputs to the delay.
MAX_MOVES = 4
#: A delay so far from that of the inputs, in samples, moves these.
MAX_DELAY_DISTANCE = 0.25
#: The estimate stays where a round moves it by less, in standard uncertainties.
MAX_SHIFT = 0.05
#: Decrease of V that is not worth a step, while start values compete …
START_TOLERANCE = 0.1
#: … and at the end.
FINAL_TOLERANCE = 1e-3
#: V over the number of bins that count below which a start leaves nothing but noise.
MAX_START_COST = 1.5
#: V of an estimate over the least there beyond which it is rejected, in the noise without a model.
MAX_COST_RATIO = 2.0
#: Likelihood of the best place over that of another, below which the other is the estimate (Royall
#: 1997).
MAX_LIKELIHOOD_RATIO = 1e-4
#: Least fraction of the information that remains beside that of noise of the reference.
MIN_INFORMATION = 0.2


@dataclass(frozen=True, eq=False)
class Settled:
    """Estimate in the noise of the data.

    Attributes:
        band: the groups, with inputs at the delay and nuisances of the noise.
        coordinates: the map from z to parameters.
        z: the estimate, shape (P,).
        covariance: of z, shape (P, P).
        degrees_of_freedom: of the noise.
        trace: of the last descent.
        weighting: the noise of every segment.
        noise: as a result states it.
        deviation: standard deviation of each record's noise, response unit, shape (records,).
        places: the groups at the estimate.
        explains: whether the noise known without a model explains what the fit leaves.
        rival_optima: other optima in the same noise: by how much V is larger, and the parameters.
    """

    band: Band
    coordinates: Coordinates
    z: FloatArray
    covariance: FloatArray
    degrees_of_freedom: float
    trace: Trace
    weighting: Weighting
    noise: SpectralNoise
    deviation: FloatArray
    places: tuple[GroupAt, ...]
    explains: bool
    rival_optima: tuple[tuple[float, dict[str, float]], ...] = ()

    @property
    def numbers(self) -> float:
        """Return the weighted count of real numbers that V is a sum over."""
        return sum(float(np.sum(place.numbers)) for place in self.places)

    @property
    def cost(self) -> float:
        """Return V, the squares of the residual over the noise, summed over the bins."""
        return sum(float(np.sum(p.weight * power_of(p.rows.residual))) for p in self.places)

    @property
    def chance(self) -> float:
        """Return the chance that noise alone leaves as much as V."""
        return chi2_tail(self.numbers, self.cost) if self.numbers > 0.0 else 1.0


@dataclass(frozen=True, eq=False)
class InNoise:
    """Records in the noise of their estimate.

    Attributes:
        band: the groups, which are computed again if needed.
        weighting: the noise of every segment.
        explains: whether the estimate leaves only noise.
        settled: the estimate, whose groups are held; None of long records, for memory.
    """

    band: Band
    weighting: Weighting
    explains: bool
    settled: Settled | None = None

    @classmethod
    def of(cls, settled: Settled) -> InNoise:
        """Return band and noise of an estimate, without the transforms of long records."""
        band = settled.band
        problem = band.problem.idle()
        if problem is band.problem:
            return cls(band, settled.weighting, settled.explains, settled)
        return cls(replace(band, problem=problem), settled.weighting, settled.explains)

    def places(
        self, z: FloatArray, coordinates: Coordinates, *, at_all_bins_of: Band | None = None
    ) -> Iterator[GroupAt]:
        """Yield each group at z in the noise of the fit.

        Args:
            z: shape (P,).
            coordinates: of the parameters.
            at_all_bins_of: a band all of whose bins count, whether or not motion shows there; None:
                the fit's, where motion shows.
        """
        settled = None if at_all_bins_of else self.settled
        if settled and settled.coordinates is coordinates and np.array_equal(settled.z, z):
            return iter(settled.places)
        band = at_all_bins_of or self.band
        weighting = self.weighting.in_all_bins() if at_all_bins_of else self.weighting
        return places_in(band, coordinates, weighting.of_groups(band), z)

    def at_noise_of(self, z: FloatArray, coordinates: Coordinates) -> InNoise:
        """Return the records in the noise estimated at z."""
        weighting = read_weighting(self.band, tuple(self.places(z, coordinates)), None)
        return InNoise(weighting.with_nuisances(self.band), weighting, self.explains)

    def normal(self, z: FloatArray, coordinates: Coordinates) -> Local:
        """Return V, its gradient and information at z."""
        return self.likelihood().normal(z, coordinates)

    def likelihood(self) -> Likelihood:
        """Return V of the records, with their noise as it is."""
        return Likelihood(self)


@dataclass
class Objective:
    """V for an optimiser, with the last iterate.

    Attributes:
        band: the groups.
        coordinates: of the parameters.
        weights: of each group.
        last: coordinates and iterate of the last call.
    """

    band: Band
    coordinates: Coordinates
    weights: Sequence[GroupWeights]
    last: tuple[FloatArray, Iterate] | None = None

    @classmethod
    def plain(
        cls, problem: BinProblem, coordinates: Coordinates, variance: FloatArray
    ) -> Objective:
        """Return the sum of squares over all samples, as in time.

        Args:
            problem: the segments.
            coordinates: of the parameters.
            variance: of each record, shape (records,).
        """
        band = Band(problem, np.inf, full_band=True)
        return cls(
            band,
            coordinates,
            [GroupWeights.white(group, variance[band.owners(group)]) for group in band.groups],
        )

    def __call__(self, z: FloatArray, _: None = None) -> Local:
        """Return V, its gradient and information at z."""
        band = self.band.at_factors_of(self.coordinates.values(z))
        point = iterate(band, self.coordinates, self.weights, z)
        self.last = z, point
        curvature = _less_noise(point.curvature, point.noise_information)
        return Local(curvature, point.gradient, point.cost)

    def at(self, z: FloatArray) -> Iterate:
        """Return V, its gradient and its information at coordinates z, shape (P,)."""
        if self.last is None or not np.array_equal(self.last[0], z):
            self(z)
        assert self.last is not None
        return self.last[1]


@dataclass
class Likelihood:
    """V of records in the noise of an estimate, near it and far from it.

    Attributes:
        in_noise: the records.
        last: of the last call, with inputs at a delay nearby.
    """

    in_noise: InNoise
    last: Objective | None = None

    def normal(self, z: FloatArray, coordinates: Coordinates) -> Local:
        """Return V, its gradient and information at z.

        V is infinite where a delay leaves no samples.
        """
        values = coordinates.values(z)
        if self.last is None or self.last.band.problem.is_far(values, MAX_DELAY_DISTANCE):
            try:
                band = self.in_noise.band.at_delay_of(values)
            except InputError:
                return Local(np.zeros((len(z), len(z))), np.zeros(len(z)), np.inf)
            weights = self.in_noise.weighting.of_groups(band)
            self.last = Objective(band, coordinates, weights)
        return self.last(z)


def information(point: Iterate) -> FloatArray:
    """Return the information less that of the noise of the reference, at least a fifth of all."""
    return _less_noise(point.matrix, point.noise_information)


def _less_noise(matrix: FloatArray, noise_information: FloatArray) -> FloatArray:
    """Return a matrix less that of the noise of the reference, at least a fifth of all."""
    if not np.any(noise_information):
        return matrix
    scale = np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    scales = np.outer(scale, scale)
    root = np.linalg.cholesky(matrix / scales + 1e-12 * np.eye(len(scale)))
    inner = np.linalg.solve(root, np.linalg.solve(root, (matrix - noise_information) / scales).T)
    values, vectors = np.linalg.eigh(0.5 * (inner + inner.T))
    half = root @ vectors * np.sqrt(np.maximum(values, MIN_INFORMATION))
    return (half @ half.T) * scales


@dataclass(frozen=True, eq=False)
class Descended:
    """End of a descent.

    Attributes:
        band: the groups, with inputs at the delay.
        coordinates: of the parameters.
        trace: of the descent.
        at: the iterate there.
    """

    band: Band
    coordinates: Coordinates
    trace: Trace
    at: Iterate

    @property
    def z(self) -> FloatArray:
        """Return the coordinates, shape (P,)."""
        return self.trace.last

    @property
    def values(self) -> dict[str, float]:
        """Return the parameters by name."""
        return self.coordinates.values(self.z)

    @functools.cached_property
    def score(self) -> float:
        """Return V + log det(1 + JᵀWJ), −2 log of the likelihood of the data, by Laplace."""
        return float(laplace_score(self.at.cost, self.at.matrix))

    def squared_distance(self, values: Mapping[str, float]) -> float:
        """Return the squared distance of values, in standard uncertainties at this end."""
        step = self.coordinates.place(dict(values)) - self.coordinates.place(self.values)
        return float(step @ self.at.matrix @ step)

    def is_at(self, values: Mapping[str, float]) -> bool:
        """Return whether values are those of another end at the same bottom.

        A descent ends within a step of its bottom that would lower V by less than its tolerance, so
        the ends of two are apart by two such steps at most.
        """
        return self.squared_distance(values) <= 4.0 * START_TOLERANCE

    @property
    def explained(self) -> float:
        """Return the share of the response's power over its noise that the motion explains.

        Free motion counts for nothing. The share is zero where the prediction is no better than
        none.
        """
        unexplained = 0.0
        power = 0.0
        for place in self.at.groups:
            rows = place.rows
            forced = rows.forced - rows.nuisances.imitated(rows.forced[:, None])[:, 0]
            unexplained += float(np.sum(place.weight * power_of(rows.residual)))
            power += float(np.sum(place.weight * power_of(rows.residual + forced)))
        return max(1.0 - unexplained / power, 0.0) if power > 0.0 else 0.0


def descend(
    band: Band,
    coordinates: Coordinates,
    z: FloatArray,
    weighting: Weighting,
    tolerance: float,
    progress: Progress,
    *,
    max_cost: float = np.inf,
) -> Descended:
    """Return where V descends to, with the inputs moved to the delay on the way.

    ``max_cost``: V above which it is misfit, and its decreases count in proportion to it.

    Raises:
        NotConverged: V is not finite at z.
    """
    for move in range(MAX_MOVES):
        objective = Objective(band, coordinates, weighting.of_groups(band))
        trace = levenberg_marquardt(
            objective,
            z,
            None,
            moved=coordinates.moved,
            tolerance=tolerance,
            max_cost=max_cost,
            progress=progress,
        )
        z = trace.last
        end = objective.at(z)
        moved = band.at_delay_of(coordinates.values(z))
        if moved is band or move == MAX_MOVES - 1:
            break
        band = moved
    return Descended(band, coordinates, trace, end)


def settle(
    best: Descended,
    observed: MotionAndNoise,
    first: Weighting,
    progress: Progress,
    *,
    explains: bool = True,
) -> Settled:
    """Return the estimate: descents continue until noise and estimate stay.

    A wrong model produces noise where the motion is, and the weights then follow quiet bins. An
    estimate whose V is far larger in the noise known without a model is rejected, unless it is far
    likelier than the start that is left, each in its own noise.

    Args:
        best: end of a descent from start values in that noise.
        observed: motion and noise before any model.
        first: the noise known without a model.
        progress: called after each iteration.
        explains: whether ``best`` leaves only noise; if not, it is returned as it is.
    """
    coordinates = best.coordinates
    end = best
    trace = best.trace
    settled = False
    weighting = first
    rounds: list[tuple[float, Descended]] = []
    for round_number in range(MAX_ROUNDS if explains else 0):
        weighting, band = _noise_at(end, observed)
        before = end.z
        try:
            end = descend(band, coordinates, before, weighting, FINAL_TOLERANCE, progress)
        except NO_FIT:  # this noise leads out of the records
            break
        trace = trace.then(end.trace)
        deviation = np.sqrt(np.diag(inverse_normal(information(end.at))))
        shift = float(np.max(np.abs(end.z - before) / deviation))
        settled = round_number > 0 and shift < MAX_SHIFT
        if settled:
            break
        rounds.append((minus_two_log_likelihood(end.at.groups), end))
    if rounds and not settled:  # the noise at either of two places leads to the other
        _, end = min(rounds, key=lambda scored: scored[0])
    if not settled:  # else the noise is that of this estimate but for MAX_SHIFT
        weighting, end = in_own_noise(end, observed)
    if explains and not _costs_less(end, first, best):
        noise_of_best, best = in_own_noise(best, observed)
        # Steep noise is not known well without a model: what is far likelier is the estimate.
        likelihoods = [minus_two_log_likelihood(place.at.groups) for place in (best, end)]
        gain = likelihoods[0] - likelihoods[1]
        if not gain > -2.0 * np.log(MAX_LIKELIHOOD_RATIO):
            weighting = noise_of_best
            end = best
            trace = best.trace
    return _stated(end, trace, weighting, explains)


def _costs_less(end: Descended, weighting: Weighting, best: Descended) -> bool:
    """Return whether V of an estimate is below the largest over that of the best, in a noise.

    The residual as it is bounds V, which is its least in the amounts of the nuisances.
    """
    limit = MAX_COST_RATIO * best.at.cost
    band = end.band.with_nuisances(best.band.tones, edges=best.band.edges)
    weights = weighting.of_groups(band)
    if band is end.band:
        bound = 0.0
        for place, noise in zip(end.at.groups, weights, strict=True):
            weight = noise.weight(place.group, power_of(place.through))
            bound += float(np.sum(weight * power_of(place.rows.residual)))
        if bound <= limit:
            return True
    return iterate(band, end.coordinates, weights, end.z).cost <= limit


def in_own_noise(end: Descended, observed: MotionAndNoise) -> tuple[Weighting, Descended]:
    """Return the noise read at the end of a descent, and the same end in that noise."""
    weighting, band = _noise_at(end, observed)
    point = iterate(band, end.coordinates, weighting.of_groups(band), end.z)
    return weighting, replace(end, band=band, at=point)


def _noise_at(end: Descended, observed: MotionAndNoise) -> tuple[Weighting, Band]:
    """Return the noise at the end of a descent, and the band with its nuisances."""
    weighting = read_weighting(end.band, end.at.groups, observed)
    return weighting, weighting.with_nuisances(end.band).at_ringing_of(end.values)


def _stated(end: Descended, trace: Trace, weighting: Weighting, explains: bool) -> Settled:
    """Return the estimate with its covariance and the noise of each record."""
    band = end.band
    count = len(end.z)
    floors = band.problem.noise_floor**2
    inverse = inverse_normal(information(end.at))
    middle = np.zeros((count, count))
    freedom = 0.0
    pulls: list[FloatArray] = []
    doubtful_pulls: list[FloatArray] = []
    deviation = np.sqrt(floors)  # of a record without a segment
    reference = np.zeros(len(floors))
    tones: list[tuple[float, ...]] = [()] * len(floors)
    for place, fitted in zip(end.at.groups, fitted_numbers(end.at.groups), strict=True):
        grid = place.group.grid
        owners = band.owners(place.group)
        spectra = [
            weighting.of_segment(number).spectrum_at(grid) for number in place.group.segments
        ]
        group_middle, group_freedom = gradient_covariance(place, spectra, fitted, floors[owners])
        middle += group_middle
        freedom += group_freedom
        for row, spectrum in enumerate(spectra if grid.driven else []):
            pulls.append(inverse @ reference_pull(place, row, spectrum.doubt) / DOUBT_DEVIATIONS)
            if not spectrum.free:
                doubtful_pulls.append(pulls[-1])
        for spectrum, owner in zip(spectra, owners, strict=True):
            reference[owner] = max(reference[owner], np.sqrt(spectrum.input_noise))
            deviation[owner] = np.sqrt(np.mean(spectrum.psd))
            unit = grid.rate_hz / max(grid.samples, 1)
            tones[owner] = tuple(tone * unit for tone in spectrum.tones)
    values, vectors = np.linalg.eigh(inverse)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    covariance = sandwich_covariance(root, middle, end.at.matrix)
    covariance = covariance + np.sum([np.outer(pull, pull) for pull in pulls], axis=0)
    doubtful_rows = np.array(doubtful_pulls).reshape(-1, count)
    return Settled(
        band=band,
        coordinates=end.coordinates,
        z=end.z,
        covariance=covariance,
        degrees_of_freedom=freedom,
        trace=trace,
        weighting=weighting,
        noise=SpectralNoise(
            reference, doubtful(doubtful_rows, covariance), tuple(tones), doubtful_rows
        ),
        deviation=deviation,
        places=end.at.groups,
        explains=explains,
    )
