"""The estimator ``ipnn``: the network, trained on excitation and response.

As in the paper, its weights are tied to the physics through the chosen discretisation. Initial
states and offset of every record are solved for exactly. The network of a linear sensor is trained
at the bins of the band, in the noise of both channels (:mod:`vibrident.fit.descent.train`). For a
nonlinear sensor, and with the paper's Adam, it runs in time, each record weighted by its noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, ClassVar, Literal

import numpy as np

from vibrident.base.binding import bound
from vibrident.base.errors import ModelError, NotConverged
from vibrident.fit.descent.sandwich import hac_covariance
from vibrident.fit.descent.settle import InNoise, Settled
from vibrident.fit.descent.train import train, train_anew
from vibrident.fit.estimators.base import Estimate, Estimator, Setting
from vibrident.fit.estimators.findings import Findings, TrainedNetwork
from vibrident.fit.estimators.optimiser import LevenbergMarquardt, Optimiser
from vibrident.fit.optimise import Progress, silent
from vibrident.fit.problem import Coordinates, Evidence
from vibrident.fit.start.start import find_start
from vibrident.physics.discretisation import Method, method

#: Rounds of noise and training in time.
MAX_ROUNDS = 6
#: Decrease of the cost that ends a training in time.
MIN_DECREASE = 1e-6


@dataclass(frozen=True)
class Ipnn(Estimator):
    """Settings of the network estimator: the sensor's state-space model, unrolled and trained.

    Attributes:
        discretisation: euler | zoh | foh | tustin | bandlimited.
        optimiser: an object with settings of its own, or the name of one: ``lm``
            (Levenberg–Marquardt), ``adam``.
        late_samples: delay of the reference's samples after their time stamps.

    Examples:
        >>> import vibrident
        >>> hz = [100, 300, 650, 1000]
        >>> calibration = vibrident.simulate(frequencies_hz=hz, samples=2000, response_noise=1e-3)
        >>> euler = vibrident.Ipnn(discretisation="euler")
        >>> vibrident.identify(calibration, estimator=euler).settings["discretisation"]
        'euler'
    """

    name: ClassVar[str] = "ipnn"
    title: ClassVar[str] = "the physics-informed network"
    rank: ClassVar[int] = 3
    settings: ClassVar[Mapping[str, Setting]] = MappingProxyType(
        {
            "discretisation": Setting(),
            "optimiser": Setting(default="lm"),
            "steps": Setting(needs=("optimiser", "adam")),
            "learning_rate": Setting(needs=("optimiser", "adam")),
            "residual": Setting(),
        }
    )
    trains_network: ClassVar[bool] = True
    is_tied: ClassVar[bool] = True  # whether the weights of the network follow from the physics

    discretisation: str = "bandlimited"
    optimiser: Optimiser | Literal["lm", "adam"] = "lm"
    late_samples: float = 0.0

    @property
    def method(self) -> Method:
        """Return the discretisation of the sensor's equation."""
        return replace(method(self.discretisation), late_samples=self.late_samples)

    def suits(self, evidence: Evidence) -> str:
        """Return the reason to choose the network: motion that is no sine, or a nonlinear model."""
        if evidence.calibration.table is not None:
            return ""
        if not evidence.model.is_linear:
            return "a model without transfer function: the network runs its equation in time"
        kinds = sorted({record.excitation for record in evidence.records})
        return f"excitation {', '.join(kinds)}: the network uses every sample of the motion"

    def configured(self, **settings: Any) -> Estimator:
        """Return the network with these settings.

        ``residual`` true: with a learned residual beside the physics.

        Raises:
            InputError: a setting of the optimiser cannot be used.
        """
        has_residual = settings.pop("residual", False)
        optimiser_settings = {
            name: settings.pop(name) for name in ("steps", "learning_rate") if name in settings
        }
        if "optimiser" in settings:
            settings["optimiser"] = _optimiser_named(settings["optimiser"], optimiser_settings)
        physics = replace(self, **settings)
        if not has_residual:
            return physics
        from vibrident.fit.estimators.residual_network import ResidualIpnn

        return ResidualIpnn(physics=physics)

    def fit(self, evidence: Evidence, progress: Progress = silent) -> Estimate:
        """Train the network.

        Raises:
            ModelError: there are no records, or no record has a reference.
            InputError: no record is long enough.
        """
        require_records(evidence)
        if self.in_band(evidence):
            return settled_estimate(train(evidence, self.method, progress))
        return trained_in_time(self, evidence, progress)

    def where_rejected(
        self, evidence: Evidence, estimate: Estimate, progress: Progress = silent
    ) -> Estimate | None:
        """Return the estimate of all starts, each in its own noise.

        None of a network in time, and where the noise known without a model is below the misfit:
        then the model is at fault, and no start.
        """
        if not (self.is_tied and self.in_band(evidence)) or evidence.start is not None:
            return None
        if estimate.in_noise is None or not estimate.in_noise.explains:
            return None
        try:
            return settled_estimate(train_anew(evidence, self.method, progress))
        except NotConverged:  # the first estimate stands
            return None

    @property
    def trainer(self) -> Optimiser:
        """Return the optimiser that the setting names or is."""
        return (
            self.optimiser
            if isinstance(self.optimiser, Optimiser)
            else _optimiser_named(self.optimiser, {})
        )

    def in_band(self, evidence: Evidence) -> bool:
        """Return whether the network is run at bins; Adam runs it in time, as the paper does."""
        return evidence.model.is_linear and not self.trainer.in_time


IPNN = Ipnn()


def settled_estimate(settled: Settled) -> Estimate:
    """Return the estimate of a linear model's network in the noise of both channels."""
    problem = settled.band.problem
    hum = settled.noise.hum_hz
    trained = TrainedNetwork(
        problem.frame.method.name,
        settled.trace.optimiser,
        problem.frame.terms,
        settled.deviation,
        weights="spectrum",
        hum_hz=hum,
    )
    return Estimate(
        Ipnn.name,
        settled.coordinates,
        settled.z,
        settled.covariance,
        settled.degrees_of_freedom,
        settled.trace,
        problem=problem,
        equations=max(settled.numbers, 1.0),  # 0 where nothing shows motion
        criterion="samples",
        findings=Findings(trained, settled.noise),
        predicted=tuple(problem.predict(settled.coordinates, settled.z)),
        in_noise=InNoise.of(settled),
        rival_optima=settled.rival_optima,
    )


def require_records(evidence: Evidence) -> None:
    """Refuse data that no network is trained on.

    Raises:
        ModelError: there are no records, or no record has a reference.
    """
    if all(record.reference is None for record in evidence.records):
        raise ModelError(
            "The network is trained on records with a reference.",
            expected="[[records]] with a reference channel",
            found="a table" if evidence.calibration.table is not None else "free decays only",
            where="⟦identify.estimator⟧",
            remedy="use the estimator 'auto' for a table; "
            "add a record with a reference to free decays",
        )


def _optimiser_named(name: str, settings: dict[str, Any]) -> Optimiser:
    """Return the optimiser of a name, with these settings; Adam is the paper's."""
    return LevenbergMarquardt() if name == "lm" else bound("adam")(**settings)


def trained_in_time(network: Ipnn, evidence: Evidence, progress: Progress) -> Estimate:
    """Return the estimate of a network run in time, with equal weights in each record."""
    from vibrident.fit.problem.network_problem import require_rational
    from vibrident.fit.problem.reference_offsets import with_fitted_offsets
    from vibrident.fit.problem.time_domain import TimeProblem
    from vibrident.fit.start.harmonic_start import with_harmonic_start

    assert evidence.first_look is not None
    require_rational(evidence.model)
    begin = find_start(evidence.first_look, evidence.model)
    size = evidence.response_size
    coordinates = Coordinates.at(evidence.model, begin.values, evidence.band_hz, size)
    method = network.method
    problem = TimeProblem.build(
        evidence.records, evidence.model, method, evidence.quantity, begin.values
    )
    z = coordinates.first
    noise = np.ones(len(evidence.records))
    trace = None
    settled = False
    for _ in range(MAX_ROUNDS):
        normal = problem.normal(z, coordinates, noise)
        noise_read = problem.record_noise(normal, noise)
        if settled and np.allclose(noise_read, noise, rtol=1e-3, atol=0.0):
            break
        if trace is None and not evidence.model.is_linear:
            z = with_harmonic_start(problem, normal, evidence, z)
        noise = noise_read
        args = coordinates, problem, noise
        trace = network.trainer.train(z, args, MIN_DECREASE, progress)
        z = trace.last
        moved_problem = problem.at_delay_of(coordinates.values(z))
        if not evidence.model.is_linear:
            moved_problem = with_fitted_offsets(moved_problem, z, coordinates, noise)
        settled = moved_problem is problem  # else another round, with other inputs
        problem = moved_problem
    assert trace is not None
    trained = TrainedNetwork(
        network.discretisation,
        trace.optimiser,
        problem.frame.terms,
        noise,
        linear=evidence.model.is_linear,
        weights="white",
        hum_hz=tuple(record.hum_hz for record in problem.records),
    )
    lines = problem.lines(z, coordinates, noise)
    covariance, freedom = hac_covariance(lines, problem.degrees_of_freedom)
    return Estimate(
        Ipnn.name,
        coordinates,
        z,
        covariance,
        freedom,
        trace,
        problem=problem,
        begin=begin,
        equations=float(np.sum(problem.degrees_of_freedom)),
        criterion="samples",
        findings=Findings(trained),
        predicted=tuple(problem.predict(coordinates, z)),
    )
