"""Every method on the same training records, evaluated on the same test records."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from vibrident.base.errors import NotConverged
from vibrident.data.records import FloatArray
from vibrident.fit.estimators import Estimator, Ipnn, MaximumLikelihood
from vibrident.fit.optimise import Progress, silent
from vibrident.paper.black_box import Kind, fit_recurrent, predict_recurrent
from vibrident.paper.dataset import Dataset, scored
from vibrident.paper.estimators.lsm import LeastSquares
from vibrident.paper.least_squares import from_extremes, from_sine_fits
from vibrident.paper.metrics import Metrics
from vibrident.paper.pinn import fit_pinn
from vibrident.paper.training import Schedule, Trained
from vibrident.paper.unrolled import Activation, Network, fit, network_for, plain_model
from vibrident.use.identification import identify

# Names of the methods in the tables.
PUBLISHED = "IPNN as published (Euler, Adam)"
TANH = "IPNN, Euler, tanh, Adam"
EXACT_ADAM = "IPNN, exact weights, Adam"
EXACT = "IPNN, exact weights, Gauss–Newton"
PLAIN = "LSM, plain, from sine fits"
EXTREMES = "LSM, from largest excursions"
WEIGHTED = "LSM, weighted"
LIKELIHOOD = "ML in frequency"
PINN = "PINN (network of time)"
NAMES: Mapping[Kind, str] = {"gru": "GRU", "lstm": "LSTM"}


@dataclass(frozen=True)
class MethodResult:
    """The outcome of one method on one set of data."""

    name: str  # for tables
    weights: int  # numbers that were fitted
    metrics: Metrics | None  # prediction of the test records, normalised; None if the method failed
    # The sensor's, SI units; None for a method without parameters, or that failed.
    parameters: dict[str, float] | None
    epochs: int | None = None  # of training; None if there was none
    converged: bool = True  # whether the stopping rule ended training, and not the limit
    # Of fitting, compilation included; differs from run to run.
    seconds: float = field(default=0.0, compare=False)


@dataclass(frozen=True, eq=False)
class Judge:
    """Data for all methods, and the evaluation of parameters."""

    own: Dataset  # reference as recorded, for the package's estimators
    # Reference as acceleration (or drive), for all others. The same records and samples.
    published: Dataset
    schedule: Schedule  # of everything that is trained by Adam
    seed: int  # of everything random

    def of(
        self,
        name: str,
        weights: int,
        predicted: list[FloatArray],
        parameters: Mapping[str, float] | None,
        seconds: float,
        trained: Trained | None = None,
    ) -> MethodResult:
        """Return a row from predictions of the test records."""
        data = self.published
        records = [data.calibration.records[i] for i in data.test]
        kept = [record.mask[scored(record)] for record in records]
        measured = [
            r.response[scored(r)][m] / data.response.unit
            for r, m in zip(records, kept, strict=True)
        ]
        metrics = Metrics.of(
            np.concatenate(measured),
            np.concatenate([p[m] for p, m in zip(predicted, kept, strict=True)]),
        )
        values = (
            None if parameters is None else {key: float(value) for key, value in parameters.items()}
        )
        course = (None, True) if trained is None else (len(trained.training), trained.converged)
        return MethodResult(name, weights, metrics, values, *course, seconds)

    def sensor(
        self, name: str, weights: int, found: Mapping[str, float], seconds: float, **more
    ) -> MethodResult:
        """Return a row from parameters: the test records predicted by the exact network that has them."""
        core = plain_model(self.own.calibration.model)
        network = network_for(self.own, core, found, "bandlimited", delay_s=found.get("delay", 0.0))
        values = {key: found[key] for key in core.parameter_names}
        return self.of(
            name, weights, network.predict(values, self.own.test), found, seconds, **more
        )


def recurrent(judge: Judge, kind: Kind) -> MethodResult:
    """GRU or LSTM."""
    begin = time.perf_counter()
    trained = fit_recurrent(judge.published, kind, judge.schedule, seed=judge.seed)
    seconds = time.perf_counter() - begin
    predicted = predict_recurrent(trained.model, judge.published, judge.published.test)
    return judge.of(NAMES[kind], trained.model.weights, predicted, None, seconds, trained)


def unrolled_network(
    judge: Judge,
    name: str,
    near: Mapping[str, float],
    discretisation: str,
    activation: Activation = "linear",
    progress: Progress = silent,
) -> MethodResult:
    """Return the unrolled network under Adam; ``near`` is the first estimate of the sensor."""
    core = plain_model(judge.published.calibration.model)
    network: Network = network_for(judge.published, core, near, discretisation, activation)
    begin = time.perf_counter()
    fitted = fit(network, near, judge.schedule, seed=judge.seed, progress=progress)
    seconds = time.perf_counter() - begin
    predicted = network.predict(fitted.parameters, judge.published.test)
    return judge.of(name, fitted.weights, predicted, fitted.parameters, seconds, fitted.trained)


def estimator(judge: Judge, name: str, chosen: Estimator) -> MethodResult:
    """One of the package's estimators on the training records."""
    begin = time.perf_counter()
    result = identify(judge.own.training_calibration, None, chosen)
    found = {key: float(p.value) for key, p in result.parameters.items() if not p.derived}
    return judge.sensor(name, len(found), found, time.perf_counter() - begin)


def least_squares(judge: Judge, name: str, method: Callable[..., dict[str, float]]) -> MethodResult:
    """Return the paper's comparison, without delay; without metrics if it gives no stable oscillator."""
    begin = time.perf_counter()
    try:
        found = method(judge.published.training_calibration)
    except NotConverged:
        return MethodResult(name, 3, None, None, seconds=time.perf_counter() - begin)
    return judge.sensor(name, len(found), found, time.perf_counter() - begin)


def pinn(judge: Judge, near: Mapping[str, float], progress: Progress = silent) -> MethodResult:
    """Return the network of time; its sensor predicts the test records, which the network itself cannot."""
    core = plain_model(judge.published.calibration.model)
    begin = time.perf_counter()
    own = replace(judge.schedule, most_epochs=PINN_EPOCHS * judge.schedule.most_epochs)
    fitted = fit_pinn(judge.published, core, near, own, seed=judge.seed, progress=progress)
    seconds = time.perf_counter() - begin
    return judge.sensor(PINN, fitted.weights, fitted.parameters, seconds, trained=fitted.trained)


PINN_EPOCHS = 10  # epochs of the network of time for one of the others, which takes about as long

#: The methods that need no training by Adam, in the order of the tables.
CLOSED: Mapping[str, Callable[[Judge], MethodResult]] = {
    EXACT: lambda judge: estimator(judge, EXACT, Ipnn()),
    PLAIN: lambda judge: least_squares(judge, PLAIN, from_sine_fits),
    EXTREMES: lambda judge: least_squares(judge, EXTREMES, from_extremes),
    WEIGHTED: lambda judge: estimator(judge, WEIGHTED, LeastSquares()),
    LIKELIHOOD: lambda judge: estimator(judge, LIKELIHOOD, MaximumLikelihood()),
}
