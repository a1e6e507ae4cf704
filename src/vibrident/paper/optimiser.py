"""The paper's optimiser as one of the network's: ``Ipnn(optimiser="adam")``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from vibrident.base.errors import InputError
from vibrident.data.records import FloatArray
from vibrident.fit.estimators.optimiser import Optimiser
from vibrident.fit.optimise import Progress, Trace
from vibrident.fit.problem import Coordinates, network_objective

if TYPE_CHECKING:
    from vibrident.fit.problem.time_domain import TimeProblem


@dataclass(frozen=True)
class Adam(Optimiser):
    """Settings of Adam: ``Ipnn(optimiser=Adam(steps=600))``.

    Attributes:
        learning_rate: size of a step, in the coordinates that are near one.
        steps: number of them.

    Raises:
        InputError: the learning rate is not between 0 and 1.
    """

    learning_rate: float = 0.001
    steps: int = 1500

    def __post_init__(self) -> None:
        if not 0.0 < self.learning_rate < 1.0:
            raise InputError(
                "The learning rate is not usable.",
                expected="a number between 0 and 1",
                found=repr(self.learning_rate),
                where="⟦identify.learning_rate⟧",
                remedy="try 0.001",
            )

    def train(
        self,
        z: FloatArray,
        args: tuple[Coordinates, TimeProblem, FloatArray],
        tolerance: float,
        progress: Progress,
    ) -> Trace:
        """Take all steps; arguments as of :meth:`Optimiser.train`, of which ``tolerance`` is not used."""
        from vibrident.paper.adam import adam  # loads JAX

        rate = self.learning_rate
        steps = self.steps
        return adam(network_objective, z, args, learning_rate=rate, steps=steps, progress=progress)
