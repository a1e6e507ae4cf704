"""Compute the network's weights W1…W4 from the physics, by a discretisation.

The paper's layer (eq. 6) takes state x_k and inputs c_k to the new state and the output:

    x_{k+1} = W3 x_k + W1 c_k
    y_k     = W2 x_{k+1} + W4 c_k.

Any exact or approximate step with x_{k+1} = Φ x_k + Γ c_k and y_k = C x_k + D c_k has this form
with W3 = Φ, W1 = Γ, W2 = C Φ⁻¹, W4 = D − C Φ⁻¹ Γ (Table 1 for Euler). :class:`Weights` stores Φ, Γ
and the output read from the old state, C and D, which never needs Φ⁻¹ (near singular for a stiff
sensor); ``table`` gives W1…W4.

A delay τ = (n − f) Ts moves the output inside the step: y(t_k + f Ts) needs only the step's own
inputs. The output weights hold its fraction f, the alignment of the records its whole samples n.
(The band-limited method interpolates the inputs at the expected delay; f is then near zero.)

Zero-, first-order hold and the band-limited step share one matrix exponential (Van Loan 1978): with
g(x)ᵀ = (P_0, …, P_{q−1})(2x − 1) = g(0)ᵀ e^{F x},

    exp [[A Ts, Ts B g(0)ᵀ], [0, F]] = [[Φ, Γ], [0, e^F]].
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from vibrident.base.errors import ModelError, unknown
from vibrident.data.records import BoolArray, FloatArray
from vibrident.physics.discretisation.inputs import (
    MAX_TERMS,
    USABLE_BAND,
    StepFilters,
    StepInputs,
    band_limited_filters,
    band_limited_inputs,
    sampled_filters,
    sampled_inputs,
    terms_needed,
)
from vibrident.physics.models.base import array_library
from vibrident.physics.models.state_space import StateSpace

#: Terms of the exponential's Taylor series.
TAYLOR_TERMS = 18
#: Layer and formula of each weight.
MEANING = {
    "W1": ("input → hidden", "Γ (Euler: Ts B)"),
    "W2": ("hidden → output", "C Φ⁻¹ (Euler: C (I + Ts A)⁻¹)"),
    "W3": ("feedback hidden → hidden", "Φ (Euler: I + Ts A)"),
    "W4": ("feedforward input → output", "D − C Φ⁻¹ Γ (Euler: D − C (I + Ts A)⁻¹ Ts B)"),
}


def expm(matrix: Any) -> Any:
    """Return exp(matrix), shape (n, n); of JAX arrays, with forward derivatives.

    Scaling, Taylor series, squaring (Higham 2009, sec. 2). The norm is brought below one half,
    where 18 terms are exact to rounding; each squaring doubles the error, so for the norms used
    here (up to 10⁴) the result is good to about 1e-12. SciPy's own takes 0.2 s to load. JAX's
    compiles five Padé approximants with their solves, several seconds with derivatives; here the
    loops are rolled up.
    """
    if array_library(matrix) is np:
        return _expm(matrix)
    from vibrident.base.backend import jnp, lax

    norm = jnp.max(jnp.sum(jnp.abs(lax.stop_gradient(matrix)), axis=0))
    squarings = jnp.maximum(0, jnp.ceil(jnp.log2(jnp.maximum(norm, 1e-300))) + 1).astype(int)
    scaled = matrix * 0.5**squarings
    unit = jnp.eye(matrix.shape[0])

    def horner(step: Any, series: Any) -> Any:
        return unit + scaled @ series / (TAYLOR_TERMS - step)

    series = lax.fori_loop(0, TAYLOR_TERMS, horner, unit)
    return lax.fori_loop(0, squarings, lambda _, power: power @ power, series)


def _expm(matrix: Any) -> Any:
    """Return exp(matrix) of one matrix or of many, shape (…, n, n), each with its own scaling."""
    norm = np.max(np.sum(np.abs(matrix), axis=-2), axis=-1)
    finite = np.isfinite(norm)
    if not np.all(finite):
        matrix = np.where(finite[..., None, None], matrix, np.nan)
    squarings = np.ceil(np.log2(np.where(finite, np.maximum(norm, 1e-300), 1.0))) + 1.0
    squarings = np.maximum(squarings, 0.0)
    scaled = matrix * 0.5 ** squarings[..., None, None]
    unit = np.eye(matrix.shape[-1])
    power = unit
    for terms in range(TAYLOR_TERMS, 0, -1):
        power = unit + scaled @ power / terms
    for squared in range(int(np.max(squarings, initial=0.0))):
        unfinished = squarings > squared
        if np.all(unfinished):
            power = power @ power
        else:
            power[unfinished] = power[unfinished] @ power[unfinished]
    return power


class Weights(NamedTuple):
    """Weights of a step of the network.

    Attributes:
        transition: Φ = W3, shape (n, n).
        drive: Γ = W1, shape (n, q).
        output: C at the read-out instant, shape (n,).
        feedthrough: D at the read-out instant, shape (q,).
    """

    transition: Any
    drive: Any
    output: Any
    feedthrough: Any

    def table(self) -> dict[str, Any]:
        """Return W1…W4 of the paper's Table 1: hidden states updated first, then read out."""
        xp = array_library(*self)
        back = xp.linalg.solve(self.transition.T, self.output)  # C Φ⁻¹
        return {
            "W1": self.drive,
            "W2": back,
            "W3": self.transition,
            "W4": self.feedthrough - back @ self.drive,
        }


@dataclass(frozen=True)
class Method:
    """A discretisation.

    Attributes:
        name: as in settings and on the command line.
        order: order of convergence for smooth signals; None if it is faster than any power.
        fixed_terms: inputs a step; None if the sensor's stiffness decides.
        step: (system, sampling interval, fraction f, terms) → Weights.
        late_samples: delay of the input's samples behind their time stamps, in samples.
    """

    name: str
    order: int | None
    fixed_terms: int | None
    step: Callable[[StateSpace, Any, Any, int], Weights]
    late_samples: float = 0.0

    @property
    def is_exact(self) -> bool:
        """Return whether a step has no error for inputs of the course that the method supposes.

        They are held, joined by lines, or band-limited between the samples. Such a ``step`` takes
        many systems at once, along a leading axis.
        """
        return self.step is _exponential_step

    @property
    def is_band_limited(self) -> bool:
        """Return whether the method supposes band-limited inputs."""
        return self.fixed_terms is None

    def terms(self, rate_times_step: float, direct: bool = False, band: float = USABLE_BAND) -> int:
        """Return the number of inputs a step for a sensor with |λ| Ts = ``rate_times_step``.

        Args:
            rate_times_step: |λ| Ts of the sensor's fastest rate.
            direct: whether the response contains the input itself, which no sensor smooths.
            band: highest frequency at which inputs must be accurate, over the sampling rate.
        """
        if self.fixed_terms is not None:
            return self.fixed_terms
        return MAX_TERMS if direct else terms_needed(rate_times_step, band)

    def inputs(
        self, samples: FloatArray, valid: BoolArray, terms: int, delay_samples: float = 0.0
    ) -> StepInputs:
        """Return the inputs of the network, made from samples.

        The arguments are those of :mod:`vibrident.physics.discretisation.inputs`.
        """
        make = band_limited_inputs if self.fixed_terms is None else sampled_inputs
        return make(samples, valid, terms, delay_samples + self.late_samples)

    def filters(
        self,
        valid: BoolArray,
        terms: int,
        delay_samples: float = 0.0,
        band: float = USABLE_BAND,
    ) -> StepFilters:
        """Return the filters from samples to inputs of the network.

        ``band`` is as of :meth:`terms`.
        """
        delay_samples = delay_samples + self.late_samples
        if self.fixed_terms is None:
            return band_limited_filters(valid, terms, delay_samples, band)
        return sampled_filters(valid, terms, delay_samples)

    def weights(
        self, system: StateSpace, sampling_interval_s: Any, fraction: Any, terms: int
    ) -> Weights:
        """Return the weights of one step; ``fraction`` f, in [0, 1]: where the output is read."""
        if len(system.d) > 1 and self.fixed_terms is not None:
            raise ModelError(
                "This discretisation cannot represent the derivative of the reference "
                "that the response contains.",
                expected="discretisation 'bandlimited', or the estimator 'ml'",
                found=f"discretisation {self.name!r}",
                where="velocity pickup with a displacement reference",
                remedy="leave the discretisation at its default",
            )
        return self.step(system, sampling_interval_s, fraction, terms)


@functools.lru_cache(maxsize=8)
def legendre_shift(terms: int) -> np.ndarray:
    """Return F with d/dx P_j(2x − 1) = Σ_k P_k(2x − 1) F[k, j]; do not write to it."""
    shift = np.zeros((terms, terms))
    for j in range(terms):
        shift[j - 1 :: -2, j] = 2.0 * (2.0 * np.arange(j - 1, -1, -2) + 1.0) if j else 0.0
    return shift


def _exponential_step(system: StateSpace, ts: Any, fraction: Any, terms: int) -> Weights:
    """Return the exact step for an input of ``terms`` Legendre terms, of one system or of many."""
    xp = array_library(system.a, system.b, ts, fraction)
    n = system.order
    batch = system.b.shape[:-1]
    start = (-1.0) ** np.arange(terms)  # P_j(−1)
    shift = legendre_shift(terms)
    size = xp.asarray(drive_size(system.b, system.scale))
    drive = (system.b / size[..., None])[..., None] * (ts * start)
    upper = xp.concatenate([system.a * ts, drive], axis=-1)
    lower = np.concatenate([np.zeros((terms, n)), shift], axis=1)
    generator = xp.concatenate([upper, xp.broadcast_to(lower, (*batch, *lower.shape))], axis=-2)
    step = expm(generator)
    if isinstance(fraction, float) and fraction == 0.0:
        output = system.c  # read at the sample itself: no second exponential
        basis = xp.broadcast_to(start, (*batch, terms))
        feedthrough = xp.zeros((*batch, terms))
    else:
        exponential = expm(generator * xp.asarray(fraction)[..., None, None])
        row = (system.c[..., None, :] @ exponential[..., :n, :])[..., 0, :]
        output = row[..., :n]
        feedthrough = size[..., None] * row[..., n:]
        basis = start @ exponential[..., n:, n:]
    for order, direct in enumerate(system.d):  # of the derivatives of the input
        if order > 0:
            basis = basis @ shift / ts
        feedthrough = feedthrough + xp.asarray(direct)[..., None] * basis
    drive = size[..., None, None] * step[..., :n, n:]
    return Weights(step[..., :n, :n], drive, output, feedthrough)


def drive_size(b: Any, rate: Any) -> Any:
    """Return a power of two that brings B to about the size of A, whose rate is given.

    A step is linear in B, which holds the gain and with it the units of both channels. A large B
    would raise the norm in the exponential, and repeated squaring would lose digits.
    """
    xp = array_library(b, rate)
    ratio = xp.max(xp.abs(b), axis=-1) / abs(rate)
    if xp is not np:
        from vibrident.base.backend import lax

        ratio = lax.stop_gradient(ratio)
    return xp.ldexp(1.0, xp.frexp(ratio)[1])


def _at_fraction(weights: Weights, fraction: Any) -> Weights:
    """Read the output between two samples by a straight line, which keeps the second order."""
    if isinstance(fraction, float) and fraction == 0.0:
        return weights
    after = weights.output @ weights.transition
    output = (1.0 - fraction) * weights.output + fraction * after
    feedthrough = weights.feedthrough + fraction * (weights.output @ weights.drive)
    return Weights(weights.transition, weights.drive, output, feedthrough)


def _direct(system: StateSpace) -> Any:
    """Return the response to the input itself; zero where the sensor smooths it."""
    return system.d[0] if system.d else 0.0


def _euler_step(system: StateSpace, ts: Any, fraction: Any, terms: int) -> Weights:
    step = Weights(
        np.eye(system.order) + ts * system.a,
        (ts * system.b)[:, None],
        system.c,
        _direct(system) * np.ones(1),
    )
    return _at_fraction(step, fraction)


def _tustin_step(system: StateSpace, ts: Any, fraction: Any, terms: int) -> Weights:
    xp = array_library(system.a, system.b, ts, fraction)
    half = 0.5 * ts * system.a
    implicit = np.eye(system.order) - half
    transition = xp.linalg.solve(implicit, np.eye(system.order) + half)
    drive = xp.linalg.solve(implicit, ts * system.b)
    zero = xp.zeros_like(drive)
    # c_0 is the mean of both ends and c_1 half their difference, so the line at f is c_0 + (2 f −
    # 1) c_1.
    feedthrough = _direct(system) * xp.stack([xp.asarray(1.0), 2.0 * xp.asarray(fraction) - 1.0])
    step = Weights(transition, xp.stack([drive, zero], axis=1), system.c, feedthrough)
    return _at_fraction(step, fraction)


METHODS: dict[str, Method] = {
    m.name: m
    for m in (
        Method("euler", 1, 1, _euler_step),
        Method("zoh", 1, 1, _exponential_step),
        Method("foh", 2, 2, _exponential_step),
        Method("tustin", 2, 2, _tustin_step),
        Method("bandlimited", None, None, _exponential_step),
    )
}


def method(name: str) -> Method:
    """Return the discretisation of that name."""
    if name not in METHODS:
        problem = f"The discretisation {name!r} is not known."
        raise unknown(problem, name, METHODS, "discretisation", kind=ModelError)
    return METHODS[name]


def weight_table(weights: Weights, state_scaling: Any | None = None) -> dict[str, dict[str, Any]]:
    """Return W1…W4 with layer and meaning, as plain lists.

    ``weights``: one set of weights (no leading axis); ``state_scaling``: factors to the paper's
    states V, V̇, …, shape (n,), from :func:`vibrident.physics.models.state_space.state_scaling`;
    None leaves the states as they are.
    """
    t = np.ones(np.shape(weights.output)[0]) if state_scaling is None else np.asarray(state_scaling)
    physical = Weights(
        transition=np.asarray(weights.transition) * t[:, None] / t[None, :],
        drive=np.asarray(weights.drive) * t[:, None],
        output=np.asarray(weights.output) / t,
        feedthrough=np.asarray(weights.feedthrough),
    )
    table = physical.table()
    return {
        name: {"layer": layer, "meaning": meaning, "value": np.asarray(table[name]).tolist()}
        for name, (layer, meaning) in MEANING.items()
    }
