"""The network's cell with its forward sensitivities, over unbroken runs of samples.

With band-limited inputs c_k, the discretisation's Legendre coefficients of the reference,

    x_{k+1} = Φ x_k + Γ c_k,                     y_k = C x_k + D c_k,
    ∂x_{k+1} = Φ ∂x_k + ∂Φ x_k + ∂Γ c_k,         ∂y_k = C ∂x_k + ∂C x_k + ∂D c_k,
    M_{k+1} = Φ M_k,                              ∂y_k/∂x_0 = C M_k.

The derivatives of the weights are taken by complex step (Squire & Trapp 1998). As long as the weights hold, all of it
is one linear system; it is run over some steps at once by its powers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vibrident.base.errors import ModelError
from vibrident.data.records import FloatArray, Quantity
from vibrident.physics.discretisation import Weights, method
from vibrident.physics.discretisation.inputs import HALF_WIDTH
from vibrident.physics.models import SensorModel
from vibrident.physics.models.slopes import STEP
from vibrident.physics.models.state_space import realise

TAPS = 2 * HALF_WIDTH  # samples of the reference that the inputs of a step need
SPAN = 16  # steps run at once
#: Factor by which a positive parameter moves at once, at most: beyond it the linearisation says nothing.
FURTHEST = 2.0


@dataclass(frozen=True, eq=False)
class Network:
    """What is fixed of a sensor's network: its model, sampling, and the filters of its inputs.

    The parameters are kept as coordinates: values over their ``scale``.
    """

    model: SensorModel  # the sensor model, linear and rational
    quantity: Quantity  # what the reference is
    interval_s: float  # sampling interval, s
    terms: int  # inputs a step, q
    delay_s: float  # delay at which the inputs are interpolated, s
    scale: FloatArray  # of the parameters, shape (P,), in their units
    filters: FloatArray  # from samples of the reference to inputs, shape (q, TAPS)
    first: int  # sample of the first tap, counted from the step's

    @classmethod
    def of(cls, model: SensorModel, values: Mapping[str, float], quantity: Quantity, interval_s: float) -> Network:
        """The network at its start values, ``values``: name → value, SI units, frequencies in Hz.

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
        made = exact.filters(np.ones(10 * TAPS, dtype=bool), terms, delay / interval_s)
        typical = 2.0 * np.pi * model.typical_frequency(values)
        scale = [1.0 / typical if spec.kind == "time" else abs(values[spec.name]) or 1.0 for spec in model.parameters]
        return cls(model, quantity, interval_s, terms, delay, np.array(scale), np.array(made.filters), made.first)

    @cached_property
    def order(self) -> int:
        """Number of states n."""
        ones = dict.fromkeys(self.model.parameter_names, 1.0)
        return len(self.model.rational(ones, self.quantity).denominator) - 1

    @property
    def parameters(self) -> int:
        """Number of parameters P."""
        return len(self.scale)

    @property
    def nuisances(self) -> int:
        """Initial states and offset of a run, n + 1."""
        return self.order + 1

    @property
    def columns(self) -> int:
        """Unknowns: nuisances, then parameters."""
        return self.nuisances + self.parameters

    @cached_property
    def gain(self) -> int:
        """Place of the gain among the parameters."""
        return self.model.parameter_names.index(self.model.gain_name)

    @cached_property
    def positive(self) -> FloatArray:
        """Whether each parameter is above zero, shape (P,)."""
        return np.array([spec.kind in ("log", "duration", "positive") for spec in self.model.parameters])

    def moved(self, point: FloatArray, move: FloatArray) -> FloatArray:
        """Coordinates after a move, within the range of the model, shape (P,)."""
        return point + np.where(
            self.positive, np.clip(move, (1.0 / FURTHEST - 1.0) * point, (FURTHEST - 1.0) * point), move
        )

    def weights(self, coordinates: FloatArray) -> tuple[Weights, list[Weights]]:
        """Weights of a step, and their derivatives by each coordinate."""
        at = self._weights(coordinates)
        slopes = []
        for place in range(self.parameters):
            moved = coordinates.astype(complex)
            moved[place] += 1j * STEP
            slopes.append(Weights(*(np.imag(part) / STEP for part in self._weights(moved))))
        return at, slopes

    def _weights(self, coordinates: np.ndarray) -> Weights:
        values = dict(zip(self.model.parameter_names, coordinates * self.scale, strict=True))
        system = realise(self.model.rational(values, self.quantity))
        fraction = 0.0
        if self.model.has_delay:
            fraction = (self.delay_s - self.model.delay_s(values)) / self.interval_s
        return method("bandlimited").weights(system, self.interval_s, fraction, self.terms)

    def inputs(self, reference: FloatArray, steps: int) -> FloatArray:
        """Inputs of so many steps, shape (steps, q), from steps + TAPS − 1 samples of the reference."""
        needed = reference[: steps + TAPS - 1]
        return np.array([np.correlate(needed, each, "valid") for each in self.filters], dtype=float).T


@dataclass(frozen=True, eq=False)
class Linearised:
    """The cell and its sensitivities at one point, as one linear system s' = A s + B c, o = H s + F c.

    s: x, then ∂x of each parameter, then M by columns; o: y, its derivatives by the initial states, then by the
    parameters.
    """

    a: FloatArray  # shape (S, S)
    b: FloatArray  # shape (S, q)
    h: FloatArray  # shape (O, S)
    f: FloatArray  # shape (O, q)

    @classmethod
    def at(cls, network: Network, coordinates: FloatArray) -> Linearised:
        """At these coordinates, shape (P,)."""
        w, slopes = network.weights(coordinates)
        n, p, q = network.order, network.parameters, network.terms
        size = n * (1 + p + n)
        a, b = np.kron(np.eye(1 + p + n), w.transition), np.zeros((size, q))
        h, f = np.zeros((1 + n + p, size)), np.zeros((1 + n + p, q))
        b[:n], h[0, :n], f[0] = w.drive, w.output, w.feedthrough
        for k, slope in enumerate(slopes):
            own, row = slice(n * (1 + k), n * (2 + k)), 1 + n + k
            a[own, :n], b[own] = slope.transition, slope.drive
            h[row, :n], h[row, own], f[row] = slope.output, w.output, slope.feedthrough
        for i in range(n):
            start = n * (1 + p + i)
            h[1 + i, start : start + n] = w.output
        return cls(a, b, h, f)

    @cached_property
    def _span(self) -> tuple[list[FloatArray], FloatArray, list[FloatArray], FloatArray]:
        """Aᵏ; free outputs (SPAN·O, S); ends of k steps from inputs (S, k q); forced outputs (SPAN·O, SPAN·q)."""
        size, q, rows = self.a.shape[0], self.b.shape[1], self.h.shape[0]
        powers = [np.eye(size)]
        for _ in range(SPAN):
            powers.append(self.a @ powers[-1])
        driven = [power @ self.b for power in powers[:SPAN]]
        ends = [np.hstack([np.zeros((size, 0)), *driven[:k][::-1]]) for k in range(SPAN + 1)]
        free = np.vstack([self.h @ power for power in powers[:SPAN]])
        forced = np.zeros((SPAN * rows, SPAN * q))
        for k in range(SPAN):
            at = slice(k * rows, (k + 1) * rows)
            forced[at, k * q : (k + 1) * q] = self.f
            forced[at, : k * q] = self.h @ ends[k]
        return powers, free, ends, forced

    def run(self, state: FloatArray, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Outputs, shape (steps, O), and the state after them."""
        powers, free, ends, forced = self._span
        steps, q = inputs.shape
        rows = self.h.shape[0]
        whole, rest = divmod(steps, SPAN)
        bundled = np.ascontiguousarray(inputs[: whole * SPAN]).reshape(whole, SPAN * q)
        driven = bundled @ ends[SPAN].T
        starts = np.empty((whole + 1, len(state)))
        starts[0] = state
        power = powers[SPAN]
        for k in range(whole):
            starts[k + 1] = power @ starts[k] + driven[k]
        out = (bundled @ forced.T + starts[:whole] @ free.T).reshape(whole * SPAN, rows)
        end = starts[whole]
        if rest:
            last = inputs[whole * SPAN :].ravel()
            part = free[: rest * rows] @ end + forced[: rest * rows, : rest * q] @ last
            out = np.concatenate([out, part.reshape(rest, rows)])
            end = powers[rest] @ end + ends[rest] @ last
        return out, end
