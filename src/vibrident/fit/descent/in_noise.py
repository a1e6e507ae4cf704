"""Maximum likelihood in the noise of both channels: descent and noise, in turn.

One criterion serves every motion and reference quantity (errors in variables; Pintelon & Schoukens
2012, ch. 9):

    V(z) = Σ |R|² / S(z),    S(z) = S_y + S_x |H(z)|²,

with S_y and S_x the noise of the response and of the reference. Its gradient is that at the most
likely motion X̂ = X + S_x H* R / S; damped Gauss–Newton steps have V as merit. The noise is read
from what of R is incoherent with the motion, and the descent goes on until the estimate stays.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.group.group import Group
from vibrident.fit.group.network import Nuisances, Rows, Step, combined, evaluate, products
from vibrident.fit.problem.band import Band
from vibrident.fit.problem.coordinates import Coordinates
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of
from vibrident.physics.models.slopes import response_and_slopes


@dataclass(frozen=True, eq=False)
class GroupWeights:
    """Noise of a group's bins.

    Attributes:
        response: PSD of the noise of the response, shape (R, K).
        reference: PSD of the noise of the reference, shape (R, K).
        excited: weight of each bin beside its noise, shape (R, K).
    """

    response: FloatArray
    reference: FloatArray
    excited: FloatArray

    @classmethod
    def white(cls, group: Group, variance: FloatArray) -> GroupWeights:
        """Return white noise of the response alone; ``variance``: of each segment, shape (R,)."""
        level = np.broadcast_to(variance[:, None], group.response.shape)
        return cls(level, np.zeros_like(level), np.ones_like(level))

    def psd(self, through: FloatArray) -> FloatArray:
        """Return S, shape (R, K); ``through``: |H|², shape (K,)."""
        return self.response + self.reference * through

    @property
    def has_reference(self) -> bool:
        """Whether noise of the reference counts."""
        return bool(np.any(self.reference))


@dataclass(frozen=True, eq=False)
class GroupAt:
    """A group at an iterate.

    Attributes:
        group: the group.
        rows: the network there.
        jacobian: ∂ predicted with z at the most likely motion, nuisances projected out, (R, P, K).
        through: H, shape (K,).
        turns: ∂H with z, shape (P, K).
        psd: S, shape (R, K).
        weight: of the bins, shape (R, K).
        of_noise: part of the information that noise of the reference makes up, shape (P, P).
    """

    group: Group
    rows: Rows
    jacobian: ComplexArray
    through: ComplexArray
    turns: ComplexArray
    psd: FloatArray
    weight: FloatArray
    of_noise: FloatArray

    @classmethod
    def evaluated(
        cls,
        group: Group,
        step: Step,
        weights: GroupWeights,
        response: tuple[ComplexArray, ComplexArray],
        slopes: FloatArray,
    ) -> GroupAt:
        """Evaluate a group.

        Args:
            group: the segments.
            step: the network's.
            weights: the noise.
            response: H, shape (K,), and its derivatives with z, shape (P, K).
            slopes: derivatives of the parameters with z, shape (P,).
        """
        through, turns = response
        psd = weights.psd(power_of(through))
        weight = group.grid.counts * weights.excited / psd
        rows = evaluate(group, step, weight)
        jacobian = rows.jacobian * slopes[:, None]
        of_noise = np.zeros((len(slopes), len(slopes)))
        if weights.has_reference:
            toward = weights.reference * through.conj() * rows.residual / psd  # X̂ − X
            jacobian = jacobian + turns * toward[:, None]
            jacobian -= rows.nuisances.imitated(jacobian)
            # |N|² of noise of the reference is its variance times the number of samples.
            alone = weight * group.grid.samples * weights.reference * weights.response / psd
            of_noise = products(turns * np.sum(alone, axis=0), turns)
        return cls(group, rows, jacobian, through, turns, psd, weight, of_noise)

    @property
    def numbers(self) -> FloatArray:
        """Return how many real numbers V is a sum over, each by how much it counts, shape (R,)."""
        return np.asarray(np.sum(self.weight * self.psd, axis=1)) * self.group.grid.samples

    @functools.cached_property
    def fitted_in_all_bins(self) -> tuple[ComplexArray, ComplexArray]:
        """Return residual and prediction with the nuisances that fit all bins best, shape (R, K).

        Those of the fit follow from the bins that show motion. What these do not determine of the
        initial states is no noise of the others.
        """
        rows = self.rows
        weight = self.group.grid.counts / self.psd
        columns = rows.nuisances.columns
        more = Nuisances.in_weight(columns, weight).amounts(rows.residual[:, None])
        residual = rows.residual - combined(more, columns)[:, 0]
        states = combined(more[:, :, : rows.order], columns[:, : rows.order])[:, 0]
        return residual, rows.predicted + states


def fitted_numbers(places: Sequence[GroupAt]) -> list[FloatArray]:
    """Return the count of numbers that were fitted to the segments of each group, shape (R,) each.

    Those are the amounts of a segment's nuisances, and its share of the parameters.
    """
    total = max(sum(float(np.sum(at.numbers)) for at in places), 1.0)
    return [
        at.rows.nuisances.columns.shape[1] + len(at.turns) / total * at.numbers for at in places
    ]


@dataclass(frozen=True, eq=False)
class Iterate:
    """V, its gradient and information at coordinates z.

    Attributes:
        cost: V.
        gradient: Jᵀ W R, shape (P,).
        matrix: Jᵀ W J, shape (P, P).
        of_noise: part of it that noise of the reference makes up, shape (P, P).
        groups: the groups there; empty where V is not finite.
    """

    cost: float
    gradient: FloatArray
    matrix: FloatArray
    of_noise: FloatArray
    groups: tuple[GroupAt, ...]


def places_in(
    band: Band, coordinates: Coordinates, weights: Sequence[GroupWeights], z: FloatArray
) -> Iterator[GroupAt]:
    """Yield each group at z.

    Raises:
        LinAlgError: something there is not finite.
    """
    values = coordinates.values(z)
    steps = band.steps(values, slopes=True)
    if steps is None:
        raise np.linalg.LinAlgError("The network grows beyond all numbers.")
    slopes = coordinates.slopes(z)
    responses: dict[int, tuple[ComplexArray, ComplexArray]] = {}
    for group, own in zip(band.groups, weights, strict=True):
        grid = group.grid
        if hash(grid) not in responses:
            through, turns = response_and_slopes(
                band.model, values, grid.frequency_hz, band.problem.frame.quantity
            )
            responses[hash(grid)] = through, turns * slopes[:, None]
        yield GroupAt.evaluated(group, steps[group.step], own, responses[hash(grid)], slopes)


def iterate(
    band: Band, coordinates: Coordinates, weights: Sequence[GroupWeights], z: FloatArray
) -> Iterate:
    """Evaluate all groups at z."""
    count = len(z)
    nothing = np.zeros((count, count))
    astray = Iterate(np.inf, np.zeros(count), nothing, nothing, ())
    with np.errstate(all="ignore"):
        try:
            places = tuple(places_in(band, coordinates, weights, z))
        except np.linalg.LinAlgError:
            return astray
        cost = 0.0
        gradient = np.zeros(count)
        matrix = np.zeros((count, count))
        of_noise = np.zeros((count, count))
        for at in places:
            root = np.sqrt(at.weight)
            whitened = (at.jacobian * root[:, None]).swapaxes(0, 1).reshape(count, -1)
            residual = (at.rows.residual * root).reshape(1, -1)
            cost += float(products(residual, residual)[0, 0])
            gradient += products(whitened, residual)[:, 0]
            matrix += products(whitened, whitened)
            of_noise += at.of_noise
    if not (np.isfinite(cost) and np.all(np.isfinite(matrix)) and np.all(np.isfinite(gradient))):
        return astray
    return Iterate(cost, gradient, matrix, of_noise, places)
