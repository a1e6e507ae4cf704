"""Weights of one step → its transfer function in z, and its slopes with the sensor's parameters.

With w = z − 1 and Ψ = Φ − I,

    C (zI − Φ)⁻¹ Γ + D = Σ_k b_k w^k / a(w),    a(w) = det(wI − Ψ),

where the b_k follow from the adjugate by Faddeev's and LeVerrier's recursion (Gantmacher 1959, ch. IV, § 5). Powers of
z − 1, not of z: where the sensor is slow against the sampling rate, all its poles are near z = 1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from vibrident.data.records import FloatArray, Quantity
from vibrident.fit.response.response import ComplexArray
from vibrident.physics.discretisation import Method, Weights
from vibrident.physics.models import SensorModel
from vibrident.physics.models.base import array_library
from vibrident.physics.models.state_space import realise

#: Imaginary step of the derivatives: its square is nothing beside one, so that they are exact to rounding.
STEP = 1e-100


class DiscreteTransfer(NamedTuple):
    """Transfer function of one step, a ratio of polynomials in w = z − 1 with ascending coefficients.

    Attributes:
        denominator: a, shape (n + 1,), the last one 1.
        numerator: b, one column an input, shape (n + 1, q).
    """

    denominator: FloatArray
    numerator: FloatArray


def transfer_of(weights: Weights) -> DiscreteTransfer:
    """Transfer function of a step with these weights, of NumPy's or JAX's arrays; complex where they are.

    Weights of many steps, with an axis of these first, give a transfer function with that axis first.
    """
    xp, order = array_library(weights.output), weights.output.shape[-1]
    unit = xp.eye(order)
    shifted = weights.transition - unit
    coefficients = [xp.ones(shifted.shape[:-2], dtype=shifted.dtype)]
    adjugate = [
        xp.broadcast_to(unit.astype(shifted.dtype), shifted.shape)
    ]  # the matrices of w^{n−1}, w^{n−2}, …
    for k in range(1, order + 1):
        product = shifted @ adjugate[-1]
        coefficients.append(-xp.trace(product, axis1=-2, axis2=-1) / k)
        adjugate.append(product + coefficients[-1][..., None, None] * unit)
    denominator = xp.stack(coefficients[::-1], axis=-1)
    output = weights.output[..., None, :]
    rows = [(output @ matrix @ weights.drive)[..., 0, :] for matrix in adjugate[order - 1 :: -1]]
    rows.append(xp.zeros_like(rows[0]))
    direct = denominator[..., None] * weights.feedthrough[..., None, :]
    return DiscreteTransfer(denominator, xp.stack(rows, axis=-2) + direct)


@dataclass(frozen=True)
class Trained:
    """A sensor model as a network of a certain step: what turns parameters into a transfer function.

    Attributes:
        model: the sensor model, linear.
        method: the discretisation.
        quantity: what the reference is.
        terms: inputs a step, q.
        factor_values: parameters of the factors that are not rational, by name, at which the
            reference was taken. The inputs' derivatives with each are inputs, too.
    """

    model: SensorModel
    method: Method
    quantity: Quantity
    terms: int
    factor_values: Mapping[str, float]

    @property
    def order(self) -> int:
        """Number of states n."""
        ones = dict.fromkeys(self.model.parameter_names, 1.0)
        return len(self.model.rational(ones, self.quantity).denominator) - 1

    def weights(
        self, values: dict[str, Any], interval_s: float, fraction: float, delay_s: float
    ) -> Weights:
        """Weights of a step; see :class:`vibrident.physics.discretisation.Weights`.

        Args:
            values: name → value of the parameters; a complex value makes the weights complex.
            interval_s: sampling interval, s.
            fraction: where in the step the output is read at the delay ``delay_s``.
            delay_s: delay for which the inputs were made, s.
        """
        system = realise(self.model.rational(values, self.quantity))
        if self.model.has_delay:
            fraction = fraction - (self.model.delay_s(values) - delay_s) / interval_s
        return self.method.weights(system, interval_s, fraction, self.terms)

    def transfer(
        self, values: dict[str, Any], interval_s: float, fraction: float, delay_s: float
    ) -> DiscreteTransfer:
        """Return the transfer function of a step; arguments as of :meth:`weights`.

        The response is linear in how far the factors' parameters are from those of the inputs.
        """
        rational = transfer_of(self.weights(values, interval_s, fraction, delay_s))
        moves = [np.asarray(values[name] - at) for name, at in self.factor_values.items()]
        if not moves:
            return rational
        slopes = [move[..., None, None] * rational.numerator for move in moves]
        return rational._replace(numerator=np.concatenate([rational.numerator, *slopes], axis=-1))

    def with_slopes(
        self, values: dict[str, float], interval_s: float, fraction: float, delay_s: float
    ) -> tuple[DiscreteTransfer, DiscreteTransfer]:
        """Return :meth:`transfer` and its derivatives with P parameters, by complex step.

        The derivatives have a leading axis of P.
        """
        places = np.array(list(values.values()), dtype=float)
        steps = STEP * np.maximum(np.abs(places), 1e-30)
        moved = np.repeat(places[:, None].astype(complex), len(places), axis=1)
        each = np.arange(len(places))
        moved[each, each] += 1j * steps
        if not self.method.takes_many:
            columns = [dict(zip(values, column.tolist(), strict=True)) for column in moved.T]
            ahead = [self.transfer(column, interval_s, fraction, delay_s) for column in columns]
            many = DiscreteTransfer(*(np.stack(parts) for parts in zip(*ahead, strict=True)))
        else:
            many = self.transfer(
                dict(zip(values, moved, strict=True)), interval_s, fraction, delay_s
            )
        per = 1.0 / steps
        slopes = DiscreteTransfer(
            np.imag(many.denominator) * per[:, None], np.imag(many.numerator) * per[:, None, None]
        )
        return DiscreteTransfer(many.denominator[0].real, many.numerator[0].real), slopes


def horner(coefficients: FloatArray, w: ComplexArray) -> ComplexArray:
    """Return the value of a polynomial with ascending coefficients, in the shape of ``w``."""
    value = np.full(w.shape, coefficients[-1], dtype=complex)
    for coefficient in coefficients[-2::-1]:
        value *= w
        value += coefficient
    return value
