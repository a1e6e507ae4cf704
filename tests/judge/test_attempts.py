"""A fit that ended beside its optimum goes on from the other optima of its start."""

import numpy as np

from vibrident.estimators import Estimate
from vibrident.estimators.findings import Findings, TrainedNetwork
from vibrident.estimators.optimise import Trace, silent
from vibrident.estimators.start import Start
from vibrident.judge import attempts
from vibrident.judge.adequacy import Judgement
from vibrident.models import parse
from vibrident.problem import Coordinates, Evidence
from vibrident.uncertainty.adequacy import Adequacy

FIRST, SECOND = ({"sensitivity": 1.0, "natural_frequency": hz, "damping_ratio": 0.1} for hz in (100.0, 300.0))


def fitted(values, weights, chi2_reduced):
    coordinates = Coordinates.at(parse("accelerometer"), values, (1.0, 50.0))
    trace = Trace("levenberg-marquardt", True, "converged", (1.0,), coordinates.first[None])
    estimate = Estimate(
        "ipnn", coordinates, coordinates.first, np.eye(3), 100.0, trace,
        begin=Start(values, (90.0,), 100, (values,), ((SECOND, 95.0),)),
        findings=Findings(TrainedNetwork("bandlimited", "levenberg-marquardt", 4, np.ones(1), weights=weights)),
    )  # fmt: skip
    points = Adequacy(np.ones(50), np.ones(50, complex), np.ones(50), ("r",) * 50, chi2_reduced, 97, adequate=True)
    return estimate, Judgement(points, "")


def chosen(monkeypatch, first, second):
    def once(evidence, *_):
        return second if evidence.start == SECOND else first

    monkeypatch.setattr(attempts, "_once", once)
    evidence = Evidence(None, parse("accelerometer"), (), None, None, ())  # type: ignore[arg-type]
    return attempts.fitted_and_judged(evidence, None, silent)  # type: ignore[arg-type]


def test_a_fit_of_equal_weights_gives_way_to_one_that_reached_its_optimum_in_the_noise(monkeypatch):
    """Equal weights that were kept say that noise drew them aside, or that they followed a line of it."""
    white, reached = fitted(FIRST, "white", 1.0), fitted(SECOND, "spectrum", 1.0)
    assert chosen(monkeypatch, white, reached) is reached
    assert chosen(monkeypatch, white, fitted(SECOND, "spectrum", 1.5)) is white
    assert chosen(monkeypatch, white, fitted(SECOND, "white", 0.8)) is white
    assert chosen(monkeypatch, fitted(FIRST, "spectrum", 1.0), reached) is not reached
