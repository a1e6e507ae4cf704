"""State space of a rational transfer function, with states scaled to keep every number near one.

The companion form in the scaled variable σ = s/w (w: the system's angular scale) has states x,
dx/d(wt), …; for an accelerometer these are V and V̇/ωn, and ``in_physical_states`` gives back the
paper's V and V̇ (eq. 4).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vibrident.physics.models.base import Rational, array_library


@dataclass(frozen=True)
class StateSpace:
    """State space ẋ = A x + B a,  y = C x + Σ_m D_m dᵐa/dtᵐ.

    Attributes:
        a: A, shape (n, n), 1/s.
        b: B, shape (n,).
        c: C, shape (n,).
        d: scalars D_0, D_1, …; empty where the system is strictly proper. D_1 and on appear where a
            velocity pickup is fed with displacement: its response then contains the derivative of
            the input.
        scale: w, rad/s.
    """

    a: Any
    b: Any
    c: Any
    d: tuple[Any, ...]
    scale: Any

    @property
    def order(self) -> int:
        """Return the number of states n."""
        return int(self.b.shape[-1])


def realise(system: Rational) -> StateSpace:
    """Return the companion realisation of ``system``; the gain sits in B, as in the paper.

    Arrays are of NumPy where every coefficient is, complex where one is; of JAX otherwise.
    Coefficients may be arrays of many systems: each array of the result gets their axis first.
    """
    xp = array_library(system.gain, system.angular_scale, *system.numerator, *system.denominator)
    order = len(system.denominator) - 1
    w = system.angular_scale
    den = [coefficient * w ** (k - order) for k, coefficient in enumerate(system.denominator[:-1])]
    remainder = [coefficient * w ** (k - order) for k, coefficient in enumerate(system.numerator)]
    direct: list[Any] = []  # quotient of the polynomial division N/D, highest power first
    while len(remainder) > order:
        lead = remainder.pop()
        direct.append(lead)
        shift = len(remainder) - order
        for k, coefficient in enumerate(den):
            remainder[shift + k] = remainder[shift + k] - lead * coefficient
    remainder += [0.0] * (order - len(remainder))
    last = -_vector(den, xp)
    drive = _vector([0.0 * w] * (order - 1) + [w * system.gain], xp)
    output = _vector(remainder, xp)
    shape = np.broadcast_shapes(last.shape[:-1], drive.shape[:-1], output.shape[:-1])
    above = xp.broadcast_to(np.eye(order)[1:], (*shape, order - 1, order))
    lowest = xp.broadcast_to(last, (*shape, order))[..., None, :]
    a = _rate(w) * xp.concatenate([above, lowest], axis=-2)
    b = xp.broadcast_to(drive, (*shape, order))
    d = tuple(system.gain * value * w ** (-m) for m, value in enumerate(reversed(direct)))
    return StateSpace(a, b, xp.broadcast_to(output, (*shape, order)), d, w)


def _vector(values: list[Any], xp: Any) -> Any:
    """Stack numbers, or arrays of many systems, along a last axis."""
    return xp.stack(xp.broadcast_arrays(*(xp.asarray(value) * 1.0 for value in values)), axis=-1)


def _rate(w: Any) -> Any:
    """Return the angular scale of one system, or of many against matrices of theirs."""
    return w[..., None, None] if getattr(w, "ndim", 0) else w


def state_scaling(system: StateSpace) -> Any:
    """Return the factors t with (paper's states) = t · (scaled states), shape (n,): 1, w, w², …."""
    return system.scale ** np.arange(system.order, dtype=float)
