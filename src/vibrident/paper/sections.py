"""Sections 4 and 5 of the paper: all methods on simulated and on measured data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.paper import dataset, methods
from vibrident.paper.dataset import SENSOR, Dataset
from vibrident.paper.estimators.lsm import LeastSquares
from vibrident.paper.experiment import Experiment
from vibrident.paper.methods import CLOSED, Judge, MethodResult
from vibrident.paper.metrics import CurveDeviation, curve_deviation, deviation_at_points
from vibrident.paper.settings import ReproductionSettings, Stages
from vibrident.paper.unrolled import Activation, plain_model
from vibrident.physics.models import parse
from vibrident.use.identification import identify

#: Band of the paper's 21 sines, and of its 41.
BAND_HZ = (10.0, 1000.0)
FULL_BAND_HZ = (0.1, 1000.0)
#: Networks with physics in section 4: name, discretisation, hidden layer.
TRAINED: tuple[tuple[str, str, Activation], ...] = (
    (methods.PUBLISHED, "euler", "linear"),
    (methods.TANH, "euler", "tanh"),
    (methods.EXACT_ADAM, "bandlimited", "linear"),
)
#: Methods of section 5, in the order of its table, after those trained by Adam.
IN_EXPERIMENT = (methods.EXACT, methods.PLAIN, methods.WEIGHTED, methods.LIKELIHOOD)


@dataclass(frozen=True, eq=False)
class PaperSection:
    """Results of all methods on a set of data.

    Attributes:
        title: what the data are.
        simulated: True for simulated data.
        published: the data as the paper prepares them.
        rows: one a method.
        deviations: of each method's curve, by its name: from the true curve in section 4, from the
            interferometer's points in section 5.
        points: frequencies (Hz) and magnitudes of the interferometer's points; empty in section 4.
        truth: true parameters, if known.
        band_hz: lowest and highest frequency.
    """

    title: str
    simulated: bool
    published: Dataset
    rows: tuple[MethodResult, ...]
    deviations: dict[str, CurveDeviation]
    points: tuple[FloatArray, FloatArray]
    truth: dict[str, float] | None
    band_hz: tuple[float, float]

    def row(self, name: str) -> MethodResult:
        """Return the row of that name."""
        return next(row for row in self.rows if row.name == name)


def simulated(settings: ReproductionSettings, *, full_range: bool = False) -> Judge:
    """Judge of the data of section 4."""
    data = dataset.simulate_section_4(
        seed=settings.seed,
        rate_hz=settings.rate_hz,
        samples=settings.samples,
        full_range=full_range,
    )
    return Judge(data, data, settings.schedule, settings.seed)


def simulation(judge: Judge, recurrent: Sequence[MethodResult], stages: Stages) -> PaperSection:
    """Run section 4: every method on the paper's simulated records."""
    near = _first_estimate(judge)
    rows = list(recurrent)
    for name, discretisation, activation in TRAINED:
        with stages(f"Training {name}") as progress:
            rows.append(
                methods.unrolled_network(judge, name, near, discretisation, activation, progress)
            )
    with stages("Training the PINN") as progress:
        network_of_time = methods.pinn(judge, near, progress)
    with stages("Identifying"):
        closed = [method(judge) for method in CLOSED.values()]
    rows += [closed[0], network_of_time, *closed[1:]]
    return _compare_with_truth("simulation of section 4", judge.published, rows, BAND_HZ)


def full_range(settings: ReproductionSettings, stages: Stages) -> PaperSection:
    """Run section 4 from 0.1 Hz on, by the methods that accept records of different rates."""
    with stages("Simulating 0.1 to 1000 Hz"):
        judge = simulated(settings, full_range=True)
    with stages("Identifying from 0.1 to 1000 Hz"):
        rows = [CLOSED[name](judge) for name in IN_EXPERIMENT]
    return _compare_with_truth("full range of section 4", judge.published, rows, FULL_BAND_HZ)


def experiment(
    data: Experiment, judge: Judge, recurrent: Sequence[MethodResult], stages: Stages
) -> PaperSection:
    """Run section 5: the same protocol, the interferometer's points as reference."""
    near = _first_estimate(judge)
    kind = "simulated" if data.simulated else "measured"
    rows = list(recurrent)
    with stages(f"Training {methods.PUBLISHED} ({kind})") as progress:
        rows.append(
            methods.unrolled_network(judge, methods.PUBLISHED, near, "euler", "linear", progress)
        )
    with stages(f"Identifying ({kind})"):
        rows += [CLOSED[name](judge) for name in IN_EXPERIMENT]
        points = _interferometer(data)
    core = plain_model(data.recorded.calibration.model)
    deviations = {
        row.name: deviation_at_points(core, row.parameters, *points)
        for row in rows
        if row.parameters is not None
    }
    band = (float(points[0].min()), float(points[0].max()))
    return PaperSection(
        data.title,
        data.simulated,
        data.published,
        tuple(rows),
        deviations,
        points,
        data.truth,
        band,
    )


def _first_estimate(judge: Judge) -> dict[str, float]:
    """Return a first estimate of the parameters, the same for every network.

    Training starts at a distance from it.
    """
    result = identify(judge.recorded.training_calibration, None, LeastSquares())
    core = parse(judge.recorded.calibration.model).core
    return {spec.name: float(result.parameters[spec.name].value) for spec in core.parameters}


def _compare_with_truth(
    title: str, data: Dataset, rows: Sequence[MethodResult], band_hz: tuple[float, float]
) -> PaperSection:
    model = parse(SENSOR.model)
    truth = dict(SENSOR.parameters)
    none = np.empty(0)
    deviations = {
        row.name: curve_deviation(model, row.parameters, truth, band_hz)
        for row in rows
        if row.parameters
    }
    return PaperSection(title, True, data, tuple(rows), deviations, (none, none), truth, band_hz)


def _interferometer(data: Experiment) -> tuple[FloatArray, FloatArray]:
    """Return frequencies and sensitivities from reference and response, without any model.

    V per m/s², or per unit of drive; shape (points,) each.
    """
    measured = identify(data.recorded.calibration, None, "ml").measured
    frequency = np.array(measured.frequency_hz)
    magnitude = np.array(measured.magnitude, dtype=float)
    if data.recorded.calibration.quantity == "velocity":
        magnitude = magnitude / (2.0 * np.pi * frequency)
    return frequency, magnitude
