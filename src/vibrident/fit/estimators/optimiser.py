"""Optimisers of a network: the seam between the estimator and the descent of its residual."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from vibrident.fit.optimise import Progress, Trace, levenberg_marquardt
from vibrident.fit.problem import network_objective

if TYPE_CHECKING:
    from vibrident.data.records import FloatArray
    from vibrident.fit.problem import Coordinates
    from vibrident.fit.problem.time_domain import TimeProblem


@dataclass(frozen=True)
class Optimiser(ABC):
    """A way to train a network; its fields are its settings.

    Attributes:
        in_time: whether it runs the network in time, with equal weights for all samples of a
            record; else at the bins of its transform.
    """

    in_time: ClassVar[bool] = True

    @abstractmethod
    def train(
        self,
        z: FloatArray,
        args: tuple[Coordinates, TimeProblem, FloatArray],
        tolerance: float,
        progress: Progress,
    ) -> Trace:
        """Minimise ``network_objective`` from z.

        Args:
            z: start, shape (p,).
            args: of the objective: coordinates, problem, noise of each record.
            tolerance: of the cost, below which no more is to be gained.
            progress: called after each iteration.
        """


@dataclass(frozen=True)
class LevenbergMarquardt(Optimiser):
    """Levenberg and Marquardt's steps, at the bins of the transforms."""

    in_time: ClassVar[bool] = False

    def train(
        self,
        z: FloatArray,
        args: tuple[Coordinates, TimeProblem, FloatArray],
        tolerance: float,
        progress: Progress,
    ) -> Trace:
        """Minimise the objective; arguments as of :meth:`Optimiser.train`."""
        return levenberg_marquardt(
            network_objective, z, args, tolerance=tolerance, progress=progress
        )
