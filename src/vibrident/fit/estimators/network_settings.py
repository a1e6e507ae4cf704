"""Settings of the network's training: light, so that a help text can name them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal


@dataclass(frozen=True)
class NetworkSettings:
    """Settings of the estimator ``ipnn``.

    Attributes:
        discretisation: euler | zoh | foh | tustin | bandlimited.
        optimiser: ``lm`` (Levenberg–Marquardt) or ``adam``.
        learning_rate: of Adam.
        steps: of Adam.
        weights: ``tied`` to the physics, or ``free`` and read back; see :mod:`vibrident.fit.estimators.free`.
        reading: of free weights: ``eigenvalues``, or the paper's ``elements``.
    """

    name: ClassVar[str] = "ipnn"

    discretisation: str = "bandlimited"
    optimiser: Literal["lm", "adam"] = "lm"
    learning_rate: float = 0.001
    steps: int = 1500
    weights: Literal["tied", "free"] = "tied"
    reading: Literal["eigenvalues", "elements"] = "eigenvalues"
