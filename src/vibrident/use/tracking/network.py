"""Recurrent cell of the network with its forward sensitivities, over unbroken runs of samples.

With band-limited inputs c_k, the discretisation's Legendre coefficients of the reference,

    x_{k+1} = Φ x_k + Γ c_k,                     y_k = C x_k + D c_k,
    ∂x_{k+1} = Φ ∂x_k + ∂Φ x_k + ∂Γ c_k,         ∂y_k = C ∂x_k + ∂C x_k + ∂D c_k,
    M_{k+1} = Φ M_k,                              ∂y_k/∂x_0 = C M_k.

The derivatives of the weights are taken by complex step (Squire & Trapp 1998). While the weights
are constant, all of this is one linear system, which its powers run over some steps at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vibrident.base.errors import ModelError
from vibrident.base.fields import NamedNumbers
from vibrident.data.records import FloatArray, Quantity
from vibrident.physics.discretisation import Weights, method
from vibrident.physics.discretisation.inputs import HALF_WIDTH
from vibrident.physics.models import SensorModel
from vibrident.physics.models.slopes import STEP
from vibrident.physics.models.state_space import realise

STEPS_AT_ONCE = 16  # steps of the cell in one product
#: Largest factor by which a positive parameter moves at once: beyond it the linearisation fails.
MAX_STEP_FACTOR = 2.0


@dataclass(frozen=True, eq=False)
class SensorNetwork:
    """Fixed properties of a sensor's network: its model, sampling, and the filters of its inputs.

    The parameters are kept as coordinates: values over their ``scale``.
    """

    model: SensorModel  # the sensor model, linear and rational
    quantity: Quantity  # of the reference
    interval_s: float  # sampling interval, s
    terms: int  # inputs a step, q
    delay_s: float  # delay at which the inputs are interpolated, s
    scale: FloatArray  # of the parameters, shape (P,), in their units
    filters: FloatArray  # from samples of the reference to inputs, shape (q, taps)
    first: int  # sample of the first tap, counted from the step's

    @classmethod
    def from_start_values(
        cls, model: SensorModel, values: NamedNumbers, quantity: Quantity, interval_s: float
    ) -> SensorNetwork:
        """Return the network at its start values.

        Args:
            model: the sensor model, linear and rational.
            values: name → value, SI units, frequencies in Hz.
            quantity: of the reference.
            interval_s: sampling interval, s.

        Raises:
            ModelError: the model is not linear, or not rational.
        """
        if not (model.is_linear and model.has_network):
            raise ModelError(
                "This model cannot be tracked.",
                expected="a linear model with a state space, such as 'accelerometer+delay'",
                found=repr(model.name),
                where="result, model",
                remedy="identify with such a model, at the level of the motion to be tracked",
            )
        exact = method("bandlimited")
        system = model.rational(values, quantity)
        direct = len(system.numerator) > len(system.denominator) - 1
        terms = exact.terms(model.fastest(values) * interval_s, direct=direct)
        delay = float(model.delay_s(values)) if model.has_delay else 0.0
        long_record = np.ones(20 * HALF_WIDTH, dtype=bool)
        band_filters = exact.filters(long_record, terms, delay / interval_s)
        typical = 2.0 * np.pi * model.typical_frequency(values)
        scale = [
            1.0 / typical if spec.kind == "time" else abs(values[spec.name]) or 1.0
            for spec in model.parameters
        ]
        return cls(
            model,
            quantity,
            interval_s,
            terms,
            delay,
            np.array(scale),
            np.array(band_filters.filters),
            band_filters.first,
        )

    @cached_property
    def order(self) -> int:
        """Return the number of states n."""
        unit_values = dict.fromkeys(self.model.parameter_names, 1.0)
        return len(self.model.rational(unit_values, self.quantity).denominator) - 1

    @property
    def taps(self) -> int:
        """Return the number of samples of the reference that the inputs of a step need."""
        return self.filters.shape[1]

    @property
    def parameters(self) -> int:
        """Return the number of parameters P."""
        return len(self.scale)

    @property
    def nuisances(self) -> int:
        """Return the number of initial states and offset of a run, n + 1."""
        return self.order + 1

    @property
    def columns(self) -> int:
        """Return the number m of unknowns: nuisances, then parameters."""
        return self.nuisances + self.parameters

    @cached_property
    def gain(self) -> int:
        """Return the index of the gain among the parameters."""
        return self.model.parameter_names.index(self.model.gain_name)

    @cached_property
    def positive(self) -> FloatArray:
        """Return which parameters are above zero, shape (P,)."""
        return np.array(
            [spec.kind in ("log", "duration", "positive") for spec in self.model.parameters]
        )

    def moved(self, point: FloatArray, move: FloatArray) -> FloatArray:
        """Return the coordinates after a move, within the range of the model, shape (P,)."""
        return point + np.where(
            self.positive,
            np.clip(move, (1.0 / MAX_STEP_FACTOR - 1.0) * point, (MAX_STEP_FACTOR - 1.0) * point),
            move,
        )

    def weights(self, coordinates: FloatArray) -> tuple[Weights, list[Weights]]:
        """Return the weights of a step, and their derivatives by each coordinate."""
        at = self._weights(coordinates)
        slopes = []
        for index in range(self.parameters):
            moved = coordinates.astype(complex)
            moved[index] += 1j * STEP
            slopes.append(Weights(*(np.imag(weight) / STEP for weight in self._weights(moved))))
        return at, slopes

    def _weights(self, coordinates: np.ndarray) -> Weights:
        values = dict(zip(self.model.parameter_names, coordinates * self.scale, strict=True))
        system = realise(self.model.rational(values, self.quantity))
        fraction = 0.0
        if self.model.has_delay:
            fraction = (self.delay_s - self.model.delay_s(values)) / self.interval_s
        return method("bandlimited").weights(system, self.interval_s, fraction, self.terms)

    def inputs(self, reference: FloatArray, steps: int) -> FloatArray:
        """Return the inputs of ``steps`` steps, shape (steps, q).

        ``reference``: at least steps + taps − 1 samples.
        """
        needed = reference[: steps + self.taps - 1]
        return np.array(
            [np.correlate(needed, taps, "valid") for taps in self.filters], dtype=float
        ).T


@dataclass(frozen=True, eq=False)
class LinearisedCell:
    """Cell and sensitivities at one point, as a linear system s' = A s + B c, o = H s + F c.

    s: x, then ∂x of each parameter, then M by columns; o: y, its derivatives by the initial states,
    then by the parameters.
    """

    a: FloatArray  # shape (S, S)
    b: FloatArray  # shape (S, q)
    h: FloatArray  # shape (O, S)
    f: FloatArray  # shape (O, q)

    @classmethod
    def at_point(cls, network: SensorNetwork, coordinates: FloatArray) -> LinearisedCell:
        """Linearise the network at these coordinates, shape (P,)."""
        w, slopes = network.weights(coordinates)
        n = network.order
        p = network.parameters
        q = network.terms
        size = n * (1 + p + n)
        a = np.kron(np.eye(1 + p + n), w.transition)
        b = np.zeros((size, q))
        h = np.zeros((1 + n + p, size))
        f = np.zeros((1 + n + p, q))
        b[:n] = w.drive
        h[0, :n] = w.output
        f[0] = w.feedthrough
        for k, slope in enumerate(slopes):
            states = slice(n * (1 + k), n * (2 + k))
            row = 1 + n + k
            a[states, :n] = slope.transition
            b[states] = slope.drive
            h[row, :n] = slope.output
            h[row, states] = w.output
            f[row] = slope.feedthrough
        for i in range(n):
            start = n * (1 + p + i)
            h[1 + i, start : start + n] = w.output
        return cls(a, b, h, f)

    @cached_property
    def _span(self) -> tuple[list[FloatArray], FloatArray, list[FloatArray], FloatArray]:
        """Return the matrices that run the system over STEPS_AT_ONCE steps.

        Returns:
            Powers Aᵏ; free outputs, shape (STEPS_AT_ONCE·O, S); ends of k steps from inputs, each
            of shape (S, k q); forced outputs, shape (STEPS_AT_ONCE·O, STEPS_AT_ONCE·q).
        """
        size = self.a.shape[0]
        q = self.b.shape[1]
        rows = self.h.shape[0]
        powers = [np.eye(size)]
        for _ in range(STEPS_AT_ONCE):
            powers.append(self.a @ powers[-1])
        driven = [power @ self.b for power in powers[:STEPS_AT_ONCE]]
        ends = [
            np.hstack([np.zeros((size, 0)), *driven[:k][::-1]]) for k in range(STEPS_AT_ONCE + 1)
        ]
        free = np.vstack([self.h @ power for power in powers[:STEPS_AT_ONCE]])
        forced = np.zeros((STEPS_AT_ONCE * rows, STEPS_AT_ONCE * q))
        for k in range(STEPS_AT_ONCE):
            at = slice(k * rows, (k + 1) * rows)
            forced[at, k * q : (k + 1) * q] = self.f
            forced[at, : k * q] = self.h @ ends[k]
        return powers, free, ends, forced

    def run(self, state: FloatArray, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the outputs, shape (steps, O), and the state after them."""
        powers, free, ends, forced = self._span
        steps, q = inputs.shape
        rows = self.h.shape[0]
        bundles, remainder = divmod(steps, STEPS_AT_ONCE)
        bundled = np.ascontiguousarray(inputs[: bundles * STEPS_AT_ONCE]).reshape(
            bundles, STEPS_AT_ONCE * q
        )
        driven = bundled @ ends[STEPS_AT_ONCE].T
        starts = np.empty((bundles + 1, len(state)))
        starts[0] = state
        power = powers[STEPS_AT_ONCE]
        for k in range(bundles):
            starts[k + 1] = power @ starts[k] + driven[k]
        out = (bundled @ forced.T + starts[:bundles] @ free.T).reshape(
            bundles * STEPS_AT_ONCE, rows
        )
        end = starts[bundles]
        if remainder:
            last = inputs[bundles * STEPS_AT_ONCE :].ravel()
            remainder_output = (
                free[: remainder * rows] @ end + forced[: remainder * rows, : remainder * q] @ last
            )
            out = np.concatenate([out, remainder_output.reshape(remainder, rows)])
            end = powers[remainder] @ end + ends[remainder] @ last
        return out, end
