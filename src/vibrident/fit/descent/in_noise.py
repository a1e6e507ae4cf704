"""Likelihood of the records in the noise of both channels, and its iterates.

One criterion serves every motion and reference quantity (errors in variables; Pintelon & Schoukens
2012, ch. 9):

    V(z) = Σ |R|² / S(z),    S(z) = S_y + S_x |H(z)|²,

with S_y and S_x the noise of the response and of the reference. Its gradient is that at the most
likely motion X̂ = X + S_x H* R / S; damped Gauss–Newton steps have V as merit. The noise is
estimated from the component of R that is incoherent with the motion, and the descent goes on until
the estimate stays.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.group.group import Grid, Group
from vibrident.fit.group.network import (
    Nuisances,
    Rows,
    Step,
    combined,
    evaluate,
    free_motion,
    products,
)
from vibrident.fit.problem.band import Band
from vibrident.fit.problem.coordinates import Coordinates
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of
from vibrident.physics.models.slopes import response_and_slopes


@dataclass(frozen=True, eq=False)
class GroupWeights:
    """Noise of the bins of a group.

    Attributes:
        response: PSD of the noise of the response, shape (R, K).
        reference: PSD of the noise of the reference, shape (R, K).
        excited: weight of each bin in addition to its noise, shape (R, K).
    """

    response: FloatArray
    reference: FloatArray
    excited: FloatArray

    @classmethod
    def white(cls, group: Group, variance: FloatArray) -> GroupWeights:
        """Return white noise of the response alone.

        Args:
            group: the segments.
            variance: of each segment, shape (R,).
        """
        level = np.broadcast_to(variance[:, None], group.response.shape)
        return cls(level, np.zeros_like(level), np.ones_like(level))

    def psd(self, through: FloatArray) -> FloatArray:
        """Return S, shape (R, K), given |H|², shape (K,)."""
        return self.response + self.reference * through

    def weight(self, group: Group, psd: FloatArray) -> FloatArray:
        """Return the weights of the bins of a group, shape (R, K), given S."""
        return np.asarray(group.grid.counts * self.excited / psd)

    @property
    def has_reference(self) -> bool:
        """Return whether noise of the reference counts."""
        return bool(np.any(self.reference))


class FittedInAllBins(NamedTuple):
    """Group at an iterate, with the nuisances that fit all bins best.

    Attributes:
        residual: shape (R, K).
        predicted: shape (R, K).
        unfitted: share of the noise of each bin that the nuisances leave in the residual, (R, K).
        amounts: of the nuisances, shape (R, m).
    """

    residual: ComplexArray
    predicted: ComplexArray
    unfitted: FloatArray
    amounts: FloatArray


@dataclass(frozen=True, eq=False)
class GroupAt:
    """Group at an iterate.

    Attributes:
        group: the group.
        rows: the network there.
        jacobian: ∂ predicted with z at the most likely motion, nuisances projected out, (R, P, K).
        edge_jacobian: the same of nuisances at the edges, which are noise, shape (R, P or 0, K).
        through: H, shape (K,).
        turns: ∂H with z, shape (P, K).
        psd: S, shape (R, K).
        weight: of the bins, shape (R, K).
        noise_information: part of the information due to noise of the reference, shape (P, P).
    """

    group: Group
    rows: Rows
    jacobian: ComplexArray
    edge_jacobian: ComplexArray
    through: ComplexArray
    turns: ComplexArray
    psd: FloatArray
    weight: FloatArray
    noise_information: FloatArray

    @classmethod
    def evaluated(
        cls,
        group: Group,
        step: Step,
        weights: GroupWeights,
        response: tuple[ComplexArray, ComplexArray],
        slopes: FloatArray,
    ) -> GroupAt:
        """Return a group at an iterate.

        Args:
            group: the segments.
            step: of the network.
            weights: the noise.
            response: H, shape (K,), and its derivatives with z, shape (P, K).
            slopes: derivatives of the parameters with z, shape (P,).
        """
        through, turns = response
        psd = weights.psd(power_of(through))
        weight = weights.weight(group, psd)
        rows = evaluate(group, step, weight)
        jacobian = rows.jacobian * slopes[:, None]
        noise_information = np.zeros((len(slopes), len(slopes)))
        if weights.has_reference:
            motion_change = weights.reference * through.conj() * rows.residual / psd  # X̂ − X
            jacobian = jacobian + turns * motion_change[:, None]
            jacobian -= rows.nuisances.imitated(jacobian)
            # |N|² of noise of the reference is its variance times the number of samples.
            noise_weight = weight * group.grid.samples * weights.reference * weights.response / psd
            noise_information = products(turns * np.sum(noise_weight, axis=0), turns)
        edge_jacobian = rows.edge_jacobian
        if edge_jacobian.size:
            edge_jacobian = edge_jacobian * slopes[:, None]
        return cls(
            group,
            rows,
            jacobian,
            edge_jacobian,
            through,
            turns,
            psd,
            weight,
            noise_information,
        )

    @property
    def numbers(self) -> FloatArray:
        """Return the weighted count of real numbers that V is a sum over, shape (R,)."""
        return np.asarray(np.sum(self.weight * self.psd, axis=1)) * self.group.grid.samples

    @functools.cached_property
    def fitted_in_all_bins(self) -> FittedInAllBins:
        """Return residual and prediction with the nuisances that fit all bins best.

        Those of the fit follow from the bins that show motion. Initial states that these do not
        determine are no noise of the other bins.
        """
        rows = self.rows
        weight = self.group.grid.counts / self.psd
        observed = self.group.observer(weight)
        columns = observed(rows.nuisances.columns)
        nuisances = Nuisances.in_weight(columns, weight)
        residual = observed(rows.residual[:, None])
        amounts = nuisances.amounts(residual)
        residual = (residual - combined(amounts, columns))[:, 0]
        from_states, at_edges = free_motion(amounts, columns, rows.order, self.group.edges)
        predicted = rows.predicted + from_states + at_edges
        total = rows.amounts + amounts[:, 0]
        return FittedInAllBins(residual, predicted, 1.0 - nuisances.leverage(), total)


def fitted_numbers(places: Sequence[GroupAt]) -> list[FloatArray]:
    """Return the count of numbers that were fitted to the segments of each group, shape (R,) each.

    Those are the amounts of the nuisances of a segment, and its share of the parameters.
    """
    total = max(sum(float(np.sum(place.numbers)) for place in places), 1.0)
    return [
        place.rows.nuisances.columns.shape[1] + len(place.turns) / total * place.numbers
        for place in places
    ]


@dataclass(frozen=True, eq=False)
class Iterate:
    """V, its gradient and information at coordinates z.

    Attributes:
        cost: V.
        gradient: Jᵀ W R, J with that of the nuisances at the edges, shape (P,).
        curvature: Jᵀ W J, with them, shape (P, P).
        matrix: Jᵀ W J without them, shape (P, P).
        noise_information: part of it due to noise of the reference, shape (P, P).
        groups: the groups there; empty where V is not finite.
    """

    cost: float
    gradient: FloatArray
    curvature: FloatArray
    matrix: FloatArray
    noise_information: FloatArray
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
    responses: dict[Grid, tuple[ComplexArray, ComplexArray]] = {}
    for group, group_weights in zip(band.groups, weights, strict=True):
        grid = group.grid
        if grid not in responses:
            through, turns = response_and_slopes(
                band.model, values, grid.frequency_hz, band.problem.frame.quantity
            )
            responses[grid] = through, turns * slopes[:, None]
        yield GroupAt.evaluated(group, steps[group.step], group_weights, responses[grid], slopes)


def iterate(
    band: Band, coordinates: Coordinates, weights: Sequence[GroupWeights], z: FloatArray
) -> Iterate:
    """Return V, its gradient and information at z, with all groups there."""
    count = len(z)
    zeros = np.zeros((count, count))
    not_finite = Iterate(np.inf, np.zeros(count), zeros, zeros, zeros, ())
    with np.errstate(all="ignore"):
        try:
            places = tuple(places_in(band, coordinates, weights, z))
        except np.linalg.LinAlgError:
            return not_finite
        cost = 0.0
        gradient = np.zeros(count)
        curvature = np.zeros((count, count))
        matrix = np.zeros((count, count))
        noise_information = np.zeros((count, count))
        for place in places:
            root = np.sqrt(place.weight)
            whitened = (place.jacobian * root[:, None]).swapaxes(0, 1).reshape(count, -1)
            residual = (place.rows.residual * root).reshape(1, -1)
            cost += float(products(residual, residual)[0, 0])
            squares = products(whitened, whitened)
            matrix += squares
            if place.edge_jacobian.size:
                at_edges = (place.edge_jacobian * root[:, None]).swapaxes(0, 1).reshape(count, -1)
                whitened += at_edges
                squares = products(whitened, whitened)
            curvature += squares
            gradient += products(whitened, residual)[:, 0]
            noise_information += place.noise_information
    if not (np.isfinite(cost) and np.all(np.isfinite(matrix)) and np.all(np.isfinite(gradient))):
        return not_finite
    return Iterate(cost, gradient, curvature, matrix, noise_information, places)
