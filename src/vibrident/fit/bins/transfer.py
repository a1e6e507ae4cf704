"""Transfer function in z of a step of the network, and its slopes with the sensor's parameters.

With w = z − 1 and Ψ = Φ − I,

    C (zI − Φ)⁻¹ Γ + D = Σ_k b_k w^k / a(w),    a(w) = det(wI − Ψ),

where the b_k follow from the adjugate by Faddeev's and LeVerrier's recursion (Gantmacher 1959, ch.
IV, § 5). Powers of z − 1, not of z: where the sensor is slow against the sampling rate, all its
poles are near z = 1.
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

#: Imaginary step of the derivatives: its square vanishes against one, so that they are exact to
#: rounding.
STEP = 1e-100


class DiscreteTransfer(NamedTuple):
    """Transfer function of one step, a ratio of ascending polynomials in w = z − 1.

    Attributes:
        denominator: a, shape (n + 1,), the last one 1.
        numerator: b, one column an input, shape (n + 1, q).
    """

    denominator: FloatArray
    numerator: FloatArray


def transfer_of(weights: Weights) -> DiscreteTransfer:
    """Return the transfer function of a step with these weights.

    The arrays are NumPy's or JAX's, and complex where the weights are. Weights of many steps, with
    an axis of these first, give a transfer function with that axis first.
    """
    xp = array_library(weights.output)
    order = weights.output.shape[-1]
    unit = xp.eye(order)
    shifted = weights.transition - unit
    coefficients = [xp.ones(shifted.shape[:-2], dtype=shifted.dtype)]
    # The matrices of w^{n−1}, w^{n−2}, …
    adjugate = [xp.broadcast_to(unit.astype(shifted.dtype), shifted.shape)]
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
    """Network of a linear sensor model for steps of a discretisation.

    Attributes:
        model: the sensor model, linear.
        method: the discretisation.
        quantity: of the reference.
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
        """Return the number of states n."""
        ones = dict.fromkeys(self.model.parameter_names, 1.0)
        return len(self.model.rational(ones, self.quantity).denominator) - 1

    def weights(
        self, values: dict[str, Any], interval_s: float, fraction: float, delay_s: float
    ) -> Weights:
        """Return the weights of a step; see :class:`vibrident.physics.discretisation.Weights`.

        Args:
            values: values of the parameters by name; a complex value makes the weights complex.
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

        The response is linear in the differences of the factors' parameters from those of the
        inputs.
        """
        rational = transfer_of(self.weights(values, interval_s, fraction, delay_s))
        changes = [np.asarray(values[name] - v) for name, v in self.factor_values.items()]
        if not changes:
            return rational
        slopes = [change[..., None, None] * rational.numerator for change in changes]
        return rational._replace(numerator=np.concatenate([rational.numerator, *slopes], axis=-1))

    def with_slopes(
        self, values: dict[str, float], interval_s: float, fraction: float, delay_s: float
    ) -> tuple[DiscreteTransfer, DiscreteTransfer]:
        """Return :meth:`transfer` and its derivatives with P parameters, by complex step.

        The derivatives have a leading axis of P.
        """
        parameters = np.array(list(values.values()), dtype=float)
        steps = STEP * np.maximum(np.abs(parameters), 1e-30)
        complex_values = np.repeat(parameters[:, None].astype(complex), len(parameters), axis=1)
        diagonal = np.arange(len(parameters))
        complex_values[diagonal, diagonal] += 1j * steps
        if not self.method.is_exact:
            columns = [
                dict(zip(values, column.tolist(), strict=True)) for column in complex_values.T
            ]
            transfers = [self.transfer(column, interval_s, fraction, delay_s) for column in columns]
            shifted = DiscreteTransfer(
                *(np.stack(arrays) for arrays in zip(*transfers, strict=True))
            )
        else:
            shifted = self.transfer(
                dict(zip(values, complex_values, strict=True)), interval_s, fraction, delay_s
            )
        inverse_step = 1.0 / steps
        slopes = DiscreteTransfer(
            np.imag(shifted.denominator) * inverse_step[:, None],
            np.imag(shifted.numerator) * inverse_step[:, None, None],
        )
        return DiscreteTransfer(shifted.denominator[0].real, shifted.numerator[0].real), slopes


def horner(coefficients: FloatArray, w: ComplexArray) -> ComplexArray:
    """Return the value of a polynomial with ascending coefficients, in the shape of ``w``."""
    value = np.full(w.shape, coefficients[-1], dtype=complex)
    for coefficient in coefficients[-2::-1]:
        value *= w
        value += coefficient
    return value
