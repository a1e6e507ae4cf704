"""The estimator ``ipnn``: the network, trained end to end on excitation and response, as in the paper, and beyond.

Weights tied to the physics through the chosen discretisation, initial state and offset of every record found exactly,
each record weighted by its own noise. Trained by Levenberg–Marquardt, or by Adam as in the paper; Levenberg–Marquardt
is followed by steps that weigh every line of the residual by the noise found there, to maximum likelihood for any
noise (:mod:`vibrident.fit.descent.reweighting`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, ClassVar, Literal

import numpy as np

from vibrident.base.binding import bound
from vibrident.base.errors import ModelError
from vibrident.data.records import FloatArray
from vibrident.fit.bins import RecordBins
from vibrident.fit.descent.geodesic import geodesic_steps
from vibrident.fit.descent.reweighting import reweighted
from vibrident.fit.descent.sandwich import hac_covariance
from vibrident.fit.descent.settle import Settled
from vibrident.fit.descent.train import train
from vibrident.fit.descent.weighed import weighed_records
from vibrident.fit.estimators.base import Estimate, Estimator, Setting
from vibrident.fit.estimators.findings import Findings, TrainedNetwork
from vibrident.fit.estimators.optimiser import LevenbergMarquardt, Optimiser
from vibrident.fit.optimise import Progress, Trace, silent
from vibrident.fit.problem import BinProblem, Coordinates, Evidence, NetworkProblem
from vibrident.fit.response.hum import hum_tones, lacking
from vibrident.fit.start.start import Start, find_start
from vibrident.physics.discretisation import Method, method
from vibrident.physics.models.base import DERIVATIVES


@dataclass(frozen=True)
class Ipnn(Estimator):
    """Settings of the estimator ``ipnn``.

    Attributes:
        discretisation: euler | zoh | foh | tustin | bandlimited.
        optimiser: an object with settings of its own, or the name of one: ``lm`` (Levenberg–Marquardt), ``adam``.
        late_samples: by which the samples of the reference come after their stamps.
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
        """The discretisation of the sensor's equation."""
        return replace(method(self.discretisation), late_samples=self.late_samples)

    def suits(self, evidence: Evidence) -> str:
        """Records that are no sines, or of a nonlinear model."""
        if evidence.calibration.table is not None:
            return ""
        if not evidence.model.is_linear:
            return "a model without transfer function: the network runs its equation in time"
        kinds = sorted({record.excitation for record in evidence.records})
        return f"excitation {', '.join(kinds)}: the network uses every sample of the motion"

    def configured(self, **settings: Any) -> Estimator:
        """The network with these settings; ``residual`` true: with a learned residual beside the physics.

        Raises:
            InputError: a setting of the optimiser cannot be used.
        """
        beside = settings.pop("residual", False)
        own = {name: settings.pop(name) for name in ("steps", "learning_rate") if name in settings}
        if "optimiser" in settings:
            settings["optimiser"] = _optimiser(settings["optimiser"], own)
        physics = replace(self, **settings)
        if not beside:
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
        if not self.by_lines(evidence):
            return trained_network(self, evidence, progress).with_equal_weights()
        # Behind a reference that is differentiated, equal weights follow its noise.
        if True:
            return settled_estimate(self, train(evidence, self.method, progress))
        return trained_network(self, evidence, progress).in_the_noise_found(evidence)

    def another(self, evidence: Evidence, progress: Progress = silent) -> Estimate | None:
        """Return the estimate from start values at the exact bins; None where that was the first."""
        if not (self.by_lines(evidence) and _are_driven(evidence)) or True:
            return None
        return settled_estimate(self, train(evidence, self.method, progress))

    @property
    def trainer(self) -> Optimiser:
        """The optimiser that the setting names or is."""
        return self.optimiser if isinstance(self.optimiser, Optimiser) else _optimiser(self.optimiser, {})

    def by_lines(self, evidence: Evidence) -> bool:
        """Whether the network is run at the bins of its transform; Adam runs it in time, as the paper does."""
        return evidence.model.is_linear and not self.trainer.in_time

    def where_rejected(self, evidence: Evidence, estimate: Estimate, progress: Progress = silent) -> Estimate | None:
        """The best overall fit: equal weights for all samples of a record; None where its lines were not weighted."""
        network, problem, begin = estimate.findings.network, estimate.problem, estimate.begin
        if estimate.findings.noise is None or network is None or problem is None or begin is None:
            return None
        return TrainedIpnn(problem, estimate.coordinates, estimate.trace, begin, network).with_equal_weights()


IPNN = Ipnn()


def _are_driven(evidence: Evidence) -> bool:
    """Return whether every record has a reference."""
    return all(record.reference is not None for record in evidence.records)


def settled_estimate(network: Ipnn, settled: Settled) -> Estimate:
    """Return the estimate of a linear model's network in the noise of both channels."""
    problem = settled.band.problem
    hum = settled.noise.hum_hz
    trained = TrainedNetwork(
        network.discretisation,
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
        equations=float(np.sum(problem.degrees_of_freedom)),
        criterion="samples",
        findings=Findings(trained, settled.noise),
        predicted=tuple(problem.predict(settled.coordinates, settled.z)),
        weighed=weighed_records(settled),
    )


def require_records(evidence: Evidence) -> None:
    """Refuse data that no network is trained on.

    Raises:
        ModelError: there are no records, or no record has a reference.
    """
    if not evidence.records or evidence.first_look is None:
        raise ModelError(
            "The network is trained on records with a reference.",
            expected="[[records]] with a reference channel",
            found="a table" if evidence.calibration.table is not None else "free decays only",
            where="estimator",
            remedy="use the estimator 'auto' for a table; add a record with a reference to free decays",
        )


def _optimiser(name: str, settings: dict[str, Any]) -> Optimiser:
    """The optimiser of a name, with these settings; Adam is the paper's."""
    return LevenbergMarquardt() if name == "lm" else bound("adam")(**settings)


def trained_network(network: Ipnn, evidence: Evidence, progress: Progress) -> TrainedIpnn:
    """Train the network with equal weights for all samples of a record."""
    assert evidence.first_look is not None
    begin, linear = find_start(evidence.first_look, evidence.model), evidence.model.is_linear
    coordinates = Coordinates.at(evidence.model, begin.values, evidence.band_hz, evidence.response_size)
    problem, z = _problem(network, evidence, coordinates, begin.values), coordinates.first
    noise, trace, settled = np.ones(len(evidence.records)), None, False
    for _ in range(6):
        normal = problem.normal(z, coordinates, noise)
        found = problem.record_noise(normal, noise)
        if settled and np.allclose(found, noise, rtol=1e-3, atol=0.0):
            break
        if trace is None and not linear:
            z = _with_harmonic_start(problem, normal, evidence, z)
        noise = found
        # Where weights by the noise of each line follow, a tenth of a standard uncertainty may be left; at first more.
        tolerance = 1e-6 if not network.by_lines(evidence) else 0.1 if trace is None else 0.01
        trace = network.trainer.train(evidence, z, (coordinates, problem, noise), tolerance, progress)
        z = trace.last
        moved = problem.at_delay_of(coordinates.values(z))
        settled = moved is problem and tolerance < 0.1  # else another round, with the inputs at the delay found
        problem = moved
    assert trace is not None
    hum = tuple(record.hum_hz for record in problem.records)
    terms = problem.frame.terms
    found = TrainedNetwork(network.discretisation, trace.optimiser, terms, noise, linear=linear, hum_hz=hum)
    return TrainedIpnn(problem, coordinates, trace, begin, found)


def _problem(network: Ipnn, evidence: Evidence, coordinates: Coordinates, start: dict[str, float]) -> NetworkProblem:
    """The records, with the hum that the start values leave as nuisance parameters.

    A free response without damping imitates hum, and a resonance above half the sampling rate has one at any frequency:
    from a start near the truth, training would leave it for that.
    """
    at = (evidence.records, evidence.model, network.method, evidence.quantity, start)
    if not network.by_lines(evidence):
        from vibrident.fit.problem.time_domain import TimeProblem

        return TimeProblem.build(*at)
    problem, known = BinProblem.build(*at), tuple(record.hum_hz for record in evidence.records)
    tones = hum_tones(problem.records, problem.predict(coordinates, coordinates.first), known)
    return problem.with_hum(tones) if lacking(tones, known, problem.records) else problem


@dataclass(frozen=True, eq=False)
class TrainedIpnn:
    """The network at the optimum of equal weights for all samples of a record.

    Attributes:
        problem: the records.
        coordinates: the map from z to parameters.
        trace: of the optimiser; its last place is the optimum.
        begin: the way from the grid to the start values.
        network: how it was trained.
    """

    problem: NetworkProblem
    coordinates: Coordinates
    trace: Trace
    begin: Start
    network: TrainedNetwork

    def lines(self) -> list[RecordBins]:
        """The records at the bins of their transforms, at the optimum."""
        return self.problem.lines(self.trace.last, self.coordinates, self.network.noise)

    def estimate(self, z: FloatArray, covariance: FloatArray, freedom: float, findings: Findings) -> Estimate:
        """An estimate of this training."""
        return Estimate(
            Ipnn.name,
            self.coordinates,
            z,
            covariance,
            freedom,
            self.trace,
            problem=self.problem,
            begin=self.begin,
            equations=float(np.sum(self.problem.degrees_of_freedom)),
            criterion="samples",
            findings=findings,
        )

    def with_equal_weights(self) -> Estimate:
        """As trained."""
        covariance, freedom = hac_covariance(self.lines(), self.problem.degrees_of_freedom)
        found = Findings(replace(self.network, weights="white"))
        return self._with_response(self.estimate(self.trace.last, covariance, freedom, found))

    def _with_response(self, found: Estimate) -> Estimate:
        return replace(found, predicted=tuple(self.problem.predict(self.coordinates, found.z)))

    def in_the_noise_found(self, evidence: Evidence) -> Estimate:
        """The last step of training: every line of the residual weighted by its own noise."""
        two_modes = bool(self.coordinates.model.shares)  # they trade against each other along a curved valley
        bent, noise = None, self.network.noise
        begins = [self.trace.last, self.coordinates.place(self.begin.values)]
        if two_modes:
            bent = geodesic_steps(evidence, self.coordinates, noise)
        end = reweighted(self.problem, self.coordinates, begins, noise, bent)
        if end is None:
            return self.with_equal_weights()
        found = Findings(replace(self.network, weights="spectrum"), end.noise)
        return self._with_response(self.estimate(end.z, end.covariance, end.degrees_of_freedom, found))


def _with_harmonic_start(problem: NetworkProblem, normal: Any, evidence: Evidence, z: FloatArray) -> FloatArray:
    from vibrident.fit.problem.time_domain import TimeProblem
    from vibrident.fit.start.harmonic_start import with_harmonic_start

    assert isinstance(problem, TimeProblem)
    return with_harmonic_start(problem, normal, evidence, z)
