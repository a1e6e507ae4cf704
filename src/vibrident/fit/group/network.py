"""The network over a group at the bins of the band, with initial states and drift projected out.

The residual of a segment is

    R = Y − Σ_k b_k wᵏ U / a(w) − (z Σ_{k<n} d_k wᵏ) / a(w) − …,    w = z − 1,

where the d_k of the initial states, a drift, and tones of hum are nuisance columns N: their amounts
are least squares in the weights W (variable projection; Kaufman 1975), so nothing leaks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy import fft

from vibrident.data.records import FloatArray
from vibrident.fit.bins.transfer import DiscreteTransfer, horner
from vibrident.fit.group.group import Bins, Group
from vibrident.fit.information import inverse_where_shown
from vibrident.fit.response.response import ComplexArray


class Step(NamedTuple):
    """Transfer function of a step of the network, and its derivatives with P parameters.

    Attributes:
        transfer: the transfer function.
        slope: its derivatives in a leading axis of P; None where they are not needed.
    """

    transfer: DiscreteTransfer
    slope: DiscreteTransfer | None = None


@dataclass(frozen=True, eq=False)
class Nuisances:
    """Columns that are fitted to rows in addition to the parameters.

    Attributes:
        columns: shape (R, m, K), or (1, m, K) where all rows have the same; the n initial states
            first.
        weight: of the bins, shape (R or 1, K).
        inverse: of their products with each other, shape (R or 1, m, m).
    """

    columns: ComplexArray
    weight: FloatArray
    inverse: FloatArray

    @classmethod
    def in_weight(cls, columns: ComplexArray, weight: FloatArray) -> Nuisances:
        """Return columns prepared for a fit in a weight of the bins, shape (R or 1, K)."""
        return cls(
            columns, weight, inverse_where_shown(products(columns * weight[:, None], columns))
        )

    def of_row(self, row: int) -> ComplexArray:
        """Return the columns of a row, shape (m, K)."""
        return self.columns[min(row, len(self.columns) - 1)]

    def amounts(self, rows: ComplexArray) -> FloatArray:
        """Return the amounts that fit rows best; (R, i, K) to (R, i, m)."""
        return products(rows * self.weight[:, None], self.columns) @ self.inverse

    def imitated(self, rows: ComplexArray) -> ComplexArray:
        """Return the component of rows that the columns can imitate, shape (R, i, K)."""
        return combined(self.amounts(rows), self.columns)

    def leverage(self) -> FloatArray:
        """Return the share of the noise of each bin that the columns imitate, shape (R or 1, K)."""
        dual = combined(self.inverse, self.columns)
        squares = np.sum(dual.real * self.columns.real + dual.imag * self.columns.imag, axis=1)
        return np.asarray(np.clip(0.5 * self.weight * squares, 0.0, 1.0))  # a bin is two numbers


@dataclass(frozen=True, eq=False)
class Rows:
    """Network over a group at given parameters.

    Attributes:
        residual: measured less predicted response, nuisance columns projected out, shape (R, K).
        predicted: the network's response with its free motion, shape (R, K).
        forced: the network's response to the reference alone, shape (R, K).
        jacobian: ∂ predicted, initial states held, less what nuisance columns could imitate, shape
            (R, P, K); P is zero without slopes.
        edge_jacobian: the same of the nuisances at the edges, whose shape depends on the poles.
            Their amounts are noise, so they carry no information. P is zero where none count.
        nuisances: nuisance columns.
        amounts: of these, shape (R, m).
        order: number of states n.
    """

    residual: ComplexArray
    predicted: ComplexArray
    forced: ComplexArray
    jacobian: ComplexArray
    edge_jacobian: ComplexArray
    nuisances: Nuisances
    amounts: FloatArray
    order: int


def real_rows(rows: ComplexArray) -> FloatArray:
    """Return complex rows (…, K) as real ones (…, 2 K), whose product is Re a* b."""
    return np.ascontiguousarray(rows).view(float)


def products(rows: ComplexArray, columns: ComplexArray) -> FloatArray:
    """Return Re Σ rows* columns over bins; (…, i, K) and (…, j, K) to (…, i, j)."""
    first = real_rows(rows)
    second = first if columns is rows else real_rows(columns)
    return first @ np.swapaxes(second, -1, -2)


def combined(amounts: FloatArray, columns: ComplexArray) -> ComplexArray:
    """Return Σ_m amounts[…, m] columns[…, m, :]; (R, i, m) and (R, m, K) to (R, i, K)."""
    return (amounts @ real_rows(columns)).view(complex)


def evaluate(group: Bins, step: Step, weight: FloatArray) -> Rows:
    """Return the network over segments.

    Args:
        group: the segments.
        step: of the network.
        weight: of the bins in the sums of squares that choose the nuisance amounts, shape (R or 1,
            K).
    """
    shifted = group.shifted
    inverse = 1.0 / horner(step.transfer.denominator, shifted)
    order = len(step.transfer.denominator) - 1
    forced = _driven(group, step.transfer.numerator[None], inverse)[:, 0]
    states = _states(shifted, inverse, order)
    observed = group.observer(weight)
    columns = _nuisances(group, states, inverse)
    nuisances = Nuisances.in_weight(observed(columns), weight)
    residual = observed((group.response - forced)[:, None])[:, 0]
    amounts = nuisances.amounts(residual[:, None])
    residual -= combined(amounts, nuisances.columns)[:, 0]
    from_states, at_edges = free_motion(amounts, columns, order, group.edges)
    with_states = forced + from_states
    jacobian = np.empty((len(residual), 0, residual.shape[1]), complex)
    edge_jacobian = jacobian
    if step.slope is not None:
        relative = np.stack([horner(row, shifted) * inverse for row in step.slope.denominator], 1)
        jacobian = _driven(group, step.slope.numerator, inverse)
        jacobian -= with_states[:, None] * relative
        jacobian = observed(jacobian)
        jacobian -= nuisances.imitated(jacobian)
        # An image of a free motion that was not recorded turns quickly with its frequency, and
        # would follow the noise.
        if group.edges and not group.aliased:  # 1/a twice
            edge_jacobian = observed(-2.0 * at_edges[:, None] * relative)
            edge_jacobian -= nuisances.imitated(edge_jacobian)
    return Rows(
        residual,
        with_states + at_edges,
        forced,
        jacobian,
        edge_jacobian,
        nuisances,
        amounts[:, 0],
        order,
    )


def free_motion(
    amounts: FloatArray, columns: ComplexArray, order: int, edges: bool
) -> tuple[ComplexArray, ComplexArray]:
    """Return the free motion of the initial states, and that at the edges, shape (R, K) each.

    What leaks of the reference cancels with both.

    Args:
        amounts: of the nuisance columns, shape (R, 1, m).
        columns: the initial states first, those of the edges last, shape (R or 1, m, K).
        order: number of states.
        edges: whether there are columns of the edges.
    """
    from_states = combined(amounts[:, :, :order], columns[:, :order])[:, 0]
    if not (edges and order):
        return from_states, np.zeros_like(from_states)
    return from_states, combined(amounts[:, :, -order:], columns[:, -order:])[:, 0]


def predict(group: Group, step: Step) -> FloatArray:
    """Return the response with the best initial states and offset, without hum, shape (R, N).

    Args:
        group: complete segments.
        step: of the network.
    """
    grid = group.grid
    rows = evaluate(group, step, grid.counts[None])
    predicted = rows.predicted
    order = rows.order
    offset = np.zeros((len(predicted), 1))
    if grid.has_gaps:
        offset = rows.amounts[:, order : order + 1]
    else:
        predicted[:, 0] = group.response[:, 0]
        if min(grid.tones, default=0.0) >= 1.0:  # less than a turn does not determine its mean
            predicted[:, 0] -= rows.amounts[:, order:] @ grid.fixed_nuisances[:, 0]
    return np.asarray(fft.irfft(predicted, grid.samples)) + offset


def _nuisances(group: Bins, states: ComplexArray, inverse: ComplexArray) -> ComplexArray:
    """Return the nuisance columns of complete segments, the states first; shape (R or 1, m, K)."""
    columns = [states, group.fixed_nuisances]
    if group.edges:
        columns.append(states * inverse[:, None])
    return np.concatenate(columns, axis=1)


def _states(shifted: ComplexArray, inverse: ComplexArray, order: int) -> ComplexArray:
    """Return z wᵏ / a, shape (R or 1, n, K)."""
    columns = np.empty((len(shifted), order, shifted.shape[1]), complex)
    columns[:, :1] = ((1.0 + shifted) * inverse)[:, None]
    for power in range(1, order):
        np.multiply(columns[:, power - 1], shifted, out=columns[:, power])
    return columns


def _driven(group: Bins, numerators: FloatArray, inverse: ComplexArray) -> ComplexArray:
    """Return Σ_k wᵏ Σ_j b[p, k, j] U_j / a; numerators (P, n + 1, q) to shape (R, P, K)."""
    count, powers, terms = numerators.shape
    while powers > 1 and not np.any(numerators[:, powers - 1]):
        powers -= 1  # the response does not contain the reference itself
    flat = np.swapaxes(numerators[:, :powers], 0, 1).reshape(powers * count, terms)
    sums = (flat @ real_rows(group.inputs)).view(complex)
    driven = sums[:, -count:]
    for power in range(powers - 2, -1, -1):
        driven *= group.shifted[:, None]
        driven += sums[:, power * count : (power + 1) * count]
    return driven * inverse[:, None]
