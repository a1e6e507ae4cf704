"""State space of a rational transfer function, with states scaled to keep every number near one.

The companion form in the scaled variable σ = s/w (w: the system's angular scale) has states x, dx/d(wt), …; for an
accelerometer these are V and V̇/ωn, and ``in_physical_states`` gives back the paper's V and V̇ (eq. 4).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from vibrident.backend import jnp
from vibrident.models.base import Rational


@dataclass(frozen=True)
class StateSpace:
    """ẋ = A x + B a,  y = C x + Σ_m D_m dᵐa/dtᵐ.

    Attributes:
        a: shape (n, n), 1/s.
        b: shape (n,).
        c: shape (n,).
        d: tuple of scalars D_0, D_1, …; empty where the system is strictly proper. D_1 and on appear where a
            velocity pickup is fed with displacement: its response then contains the derivative of the input.
        scale: w, rad/s.
    """

    a: Any
    b: Any
    c: Any
    d: tuple[Any, ...]
    scale: Any

    @property
    def order(self) -> int:
        """Number of states n."""
        return int(self.b.shape[0])


def realise(system: Rational) -> StateSpace:
    """Companion realisation of ``system``; the gain sits in B, as in the paper."""
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
    a = w * jnp.stack([_row(order, i, den) for i in range(order)])
    b = jnp.zeros(order).at[-1].set(w * system.gain)
    c = jnp.stack([jnp.asarray(value, dtype=float) for value in remainder])
    d = tuple(system.gain * value * w ** (-m) for m, value in enumerate(reversed(direct)))
    return StateSpace(a, b, c, d, w)


def _row(order: int, index: int, den: list[Any]) -> Any:
    if index < order - 1:
        return jnp.eye(order)[index + 1]
    return -jnp.stack([jnp.asarray(value, dtype=float) for value in den])


def state_scaling(system: StateSpace) -> Any:
    """Factors t with (paper's states) = t · (scaled states), shape (n,): 1, w, w², …."""
    return system.scale ** jnp.arange(system.order, dtype=float)
