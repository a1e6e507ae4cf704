"""Findings of an estimator beside the parameters.

The ``settings`` of a result are written from it once, at the end.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from vibrident.data.records import FloatArray
from vibrident.fit.noise.spectral_noise import SpectralNoise
from vibrident.physics.discretisation import Method, method

#: The curve of a nonlinear model, in words.
SMALL_SIGNAL = (
    "of the linear part: what the response comes to for small signals; "
    "measured points are brought there by the network"
)
#: The curve of an estimate with a learned residual, in words.
PHYSICS_CURVE = "of the physics without its learned residual; measured points are without it too"


@dataclass(frozen=True, eq=False)
class TrainedNetwork:
    """Training of a network, as a result states it.

    Attributes:
        discretisation: its name.
        optimiser: its name.
        inputs_per_step: of the network.
        noise: standard deviation by which each record was weighted, response unit, shape
            (records,).
        linear: whether the model has a transfer function.
        weights: of the lines of the residual: all alike (``white``), or by the ``spectrum`` of the
            noise; empty where the weights of the network are free, or a residual is learned.
        hum_hz: tones of each record that no motion causes, unknowns of the training.
        reading: how free weights were read back; empty for weights that are tied to the physics.
    """

    discretisation: str
    optimiser: str
    inputs_per_step: int
    noise: FloatArray
    linear: bool = True
    weights: Literal["white", "spectrum", ""] = ""
    hum_hz: tuple[tuple[float, ...], ...] = ()
    reading: str = ""

    def as_settings(self) -> dict[str, Any]:
        """Return the settings that a result states of the training."""
        settings: dict[str, Any] = {
            "discretisation": self.discretisation,
            "optimiser": self.optimiser,
            "inputs_per_step": self.inputs_per_step,
            "noise": self.noise.tolist(),
        }
        if any(self.hum_hz):
            settings["hum_hz"] = [list(tones) for tones in self.hum_hz]
        if not self.linear:
            settings["response_curve"] = SMALL_SIGNAL
        if self.weights:
            settings["noise_weights"] = self.weights
        if self.reading:
            settings |= {"weights": "free", "reading": self.reading}
        return settings


@dataclass(frozen=True, eq=False)
class LearnedShare:
    """A residual network beside the physics.

    Attributes:
        accepted: whether it predicts held-out data better than the physics alone.
        share: rms of its output over that of the response.
        tried: verdict on each structure.
        about: its structure, weights and shares where it is accepted, else the reason.
    """

    accepted: bool
    share: float
    tried: Mapping[str, Any]
    about: Mapping[str, Any]

    def as_settings(self) -> dict[str, Any]:
        """Return the settings that a result states of the residual network."""
        settings = {"kept": self.accepted, "share": self.share, **self.about, "tried": self.tried}
        return {
            "residual_network": settings,
            **({"response_curve": PHYSICS_CURVE} if self.accepted else {}),
        }


class Stated(Protocol):
    """An object that states itself in the settings of a result."""

    def as_settings(self) -> dict[str, Any]:
        """Return the settings that a result states."""
        ...


@dataclass(frozen=True, eq=False)
class Findings:
    """Findings of an estimator beside the parameters.

    Attributes:
        network: how it was trained; None for an estimator without one.
        noise: of the lines, where they were weighted by it.
        learned: a residual network beside the physics; None where none was asked for.
        model_error: relative error of the model beside the noise; None where the noise suffices.
        decays: free decays alone; None where there is a reference.
    """

    network: TrainedNetwork | None = None
    noise: SpectralNoise | None = None
    learned: LearnedShare | None = None
    model_error: float | None = None
    decays: Stated | None = None

    @property
    def method(self) -> Method:
        """Return the discretisation of the network; the exact one without a network."""
        return method("bandlimited" if self.network is None else self.network.discretisation)

    @property
    def hum_hz(self) -> tuple[tuple[float, ...], ...]:
        """Return the tones of each record's response that do not come from the motion.

        It is empty where none is known.
        """
        if self.noise is not None and any(self.noise.hum_hz):
            return self.noise.hum_hz
        return () if self.network is None else self.network.hum_hz

    def as_settings(self, names: Sequence[str]) -> dict[str, Any]:
        """Return the settings that a result states; ``names``: of the parameters."""
        return {
            **({} if self.network is None else self.network.as_settings()),
            **({} if self.noise is None else self.noise.as_settings(names)),
            **({} if self.learned is None else self.learned.as_settings()),
            **({} if self.model_error is None else {"model_error": self.model_error}),
            **({} if self.decays is None else self.decays.as_settings()),
        }
