"""Methods on the same training records, evaluated on the same test records."""

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
from vibrident.paper.training import Schedule, TrainingOutcome
from vibrident.paper.unrolled import Activation, TiedNetwork, fit, network_for, plain_model
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
    """Outcome of a method on a set of data.

    Attributes:
        name: for tables.
        weights: numbers that were fitted.
        metrics: prediction of the test records, normalised; None if the method failed.
        parameters: the sensor's, SI units; None for a method without parameters, or that failed.
        epochs: of training; None if there was none.
        converged: whether the stopping rule ended training, and not the limit.
        seconds: of fitting, compilation included; differs from run to run.
    """

    name: str
    weights: int
    metrics: Metrics | None
    parameters: dict[str, float] | None
    epochs: int | None = None
    converged: bool = True
    seconds: float = field(default=0.0, compare=False)


@dataclass(frozen=True, eq=False)
class Judge:
    """Data for all methods, and the evaluation of parameters.

    Attributes:
        recorded: reference as recorded, for the package's estimators.
        published: reference as acceleration (or drive), for all others. The same records and
            samples.
        schedule: of everything that is trained by Adam.
        seed: of everything random.
    """

    recorded: Dataset
    published: Dataset
    schedule: Schedule
    seed: int

    def row_of_predictions(
        self,
        name: str,
        weights: int,
        predicted: list[FloatArray],
        parameters: Mapping[str, float] | None,
        seconds: float,
        trained: TrainingOutcome | None = None,
    ) -> MethodResult:
        """Return a row from predictions of the test records."""
        data = self.published
        records = [data.calibration.records[i] for i in data.test]
        masks = [record.mask[scored(record)] for record in records]
        measured = [
            r.response[scored(r)][m] / data.response.unit
            for r, m in zip(records, masks, strict=True)
        ]
        metrics = Metrics.from_samples(
            np.concatenate(measured),
            np.concatenate([p[m] for p, m in zip(predicted, masks, strict=True)]),
        )
        values = (
            None if parameters is None else {key: float(value) for key, value in parameters.items()}
        )
        course = (None, True) if trained is None else (len(trained.training), trained.converged)
        return MethodResult(name, weights, metrics, values, *course, seconds)

    def row_of_parameters(
        self, name: str, weights: int, parameters: Mapping[str, float], seconds: float, **more
    ) -> MethodResult:
        """Return a row from parameters, whose exact network predicts the test records."""
        core = plain_model(self.recorded.calibration.model)
        delay_s = parameters.get("delay", 0.0)
        network = network_for(self.recorded, core, parameters, "bandlimited", delay_s=delay_s)
        values = {key: parameters[key] for key in core.parameter_names}
        predicted = network.predict(values, self.recorded.test)
        return self.row_of_predictions(name, weights, predicted, parameters, seconds, **more)


def recurrent(judge: Judge, kind: Kind) -> MethodResult:
    """Train a GRU or an LSTM."""
    begin = time.perf_counter()
    trained = fit_recurrent(judge.published, kind, judge.schedule, seed=judge.seed)
    seconds = time.perf_counter() - begin
    predicted = predict_recurrent(trained.model, judge.published, judge.published.test)
    return judge.row_of_predictions(
        NAMES[kind], trained.model.weights, predicted, None, seconds, trained
    )


def unrolled_network(
    judge: Judge,
    name: str,
    near: Mapping[str, float],
    discretisation: str,
    activation: Activation = "linear",
    progress: Progress = silent,
) -> MethodResult:
    """Train the unrolled network by Adam; ``near``: first estimate of the sensor."""
    core = plain_model(judge.published.calibration.model)
    network: TiedNetwork = network_for(judge.published, core, near, discretisation, activation)
    begin = time.perf_counter()
    fitted = fit(network, near, judge.schedule, seed=judge.seed, progress=progress)
    seconds = time.perf_counter() - begin
    predicted = network.predict(fitted.parameters, judge.published.test)
    return judge.row_of_predictions(
        name, fitted.weights, predicted, fitted.parameters, seconds, fitted.trained
    )


def estimator(judge: Judge, name: str, method: Estimator) -> MethodResult:
    """Run an estimator of the package on the training records."""
    begin = time.perf_counter()
    result = identify(judge.recorded.training_calibration, None, method)
    parameters = {key: float(p.value) for key, p in result.parameters.items() if not p.derived}
    seconds = time.perf_counter() - begin
    return judge.row_of_parameters(name, len(parameters), parameters, seconds)


def least_squares(judge: Judge, name: str, method: Callable[..., dict[str, float]]) -> MethodResult:
    """Run least squares as the paper does, without delay.

    The row has no metrics if it gives no stable oscillator.
    """
    begin = time.perf_counter()
    try:
        parameters = method(judge.published.training_calibration)
    except NotConverged:
        return MethodResult(name, 3, None, None, seconds=time.perf_counter() - begin)
    seconds = time.perf_counter() - begin
    return judge.row_of_parameters(name, len(parameters), parameters, seconds)


def pinn(judge: Judge, near: Mapping[str, float], progress: Progress = silent) -> MethodResult:
    """Train the network of time.

    Its sensor predicts the test records, which the network itself cannot.
    """
    core = plain_model(judge.published.calibration.model)
    begin = time.perf_counter()
    schedule = replace(judge.schedule, most_epochs=PINN_EPOCHS_RATIO * judge.schedule.most_epochs)
    fitted = fit_pinn(judge.published, core, near, schedule, seed=judge.seed, progress=progress)
    seconds = time.perf_counter() - begin
    return judge.row_of_parameters(
        PINN, fitted.weights, fitted.parameters, seconds, trained=fitted.trained
    )


#: Epochs of the network of time over those of the others, which take about as long.
PINN_EPOCHS_RATIO = 10

#: The methods that need no training by Adam, in the order of the tables.
CLOSED: Mapping[str, Callable[[Judge], MethodResult]] = {
    EXACT: lambda judge: estimator(judge, EXACT, Ipnn()),
    PLAIN: lambda judge: least_squares(judge, PLAIN, from_sine_fits),
    EXTREMES: lambda judge: least_squares(judge, EXTREMES, from_extremes),
    WEIGHTED: lambda judge: estimator(judge, WEIGHTED, LeastSquares()),
    LIKELIHOOD: lambda judge: estimator(judge, LIKELIHOOD, MaximumLikelihood()),
}
