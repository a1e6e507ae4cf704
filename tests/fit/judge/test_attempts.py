"""A fit that ended beside its optimum goes on from the other optima of its start."""

from dataclasses import replace

import numpy as np
import pytest
from bench.adversary.cases import BY_NAME

from vibrident import identify
from vibrident.data.records import Calibration, Record
from vibrident.fit.estimators import Estimate
from vibrident.fit.estimators.findings import Findings, TrainedNetwork
from vibrident.fit.judge import attempts
from vibrident.fit.judge.adequacy import Judgement
from vibrident.fit.optimise import Trace, silent
from vibrident.fit.problem import Coordinates, Evidence
from vibrident.fit.response import measure_bands
from vibrident.fit.start.start import Start
from vibrident.fit.uncertainty.adequacy import Adequacy
from vibrident.fit.uncertainty.explained import Shares
from vibrident.physics.models import parse
from vibrident.physics.simulation import simulate

FIRST, SECOND = ({"sensitivity": 1.0, "natural_frequency": hz, "damping_ratio": 0.1} for hz in (100.0, 300.0))


ELSEWHERE = Start(FIRST, (90.0,), 100, (FIRST,), ((SECOND, 95.0),))


def fitted(values, weights, chi2_reduced, adequate=True):
    coordinates = Coordinates.at(parse("accelerometer"), values, (1.0, 50.0))
    trace = Trace("levenberg-marquardt", True, "converged", (1.0,), coordinates.first[None])
    estimate = Estimate(
        "ipnn", coordinates, coordinates.first, 1e-6 * np.eye(3), 100.0, trace,
        begin=replace(ELSEWHERE, values=values, path=(values,)),
        findings=Findings(TrainedNetwork("bandlimited", "levenberg-marquardt", 4, np.ones(1), weights=weights)),
    )  # fmt: skip
    points = Adequacy(np.ones(50), np.ones(50, complex), np.ones(50), ("r",) * 50, chi2_reduced, 97, adequate=adequate)
    return estimate, Judgement(points, "")


class Rejected:
    """An estimator whose fits are all rejected."""

    def __init__(self, others=((SECOND, 95.0),)):
        self.others, self.starts = others, []

    def fit(self, evidence, progress):
        self.starts.append(evidence.start)
        found = fitted(FIRST, "white", 50.0, adequate=False)[0]
        return replace(found, begin=replace(ELSEWHERE, others=self.others))

    def where_rejected(self, evidence, estimate, progress):
        return None

    def another(self, evidence, progress):
        return None


def chosen(monkeypatch, first, second):
    def once(evidence, *_):
        return second if evidence.start == SECOND else first

    monkeypatch.setattr(attempts, "_once", once)
    evidence = Evidence(None, parse("accelerometer"), (), None, None, ())  # type: ignore[arg-type]
    found = attempts.Fitted.of(evidence, None, silent)  # type: ignore[arg-type]
    return next(one for one in (first, second) if one[0] is found.estimate)


def test_a_fit_of_equal_weights_gives_way_to_one_that_reached_its_optimum_in_the_noise(monkeypatch):
    """Equal weights that were kept say that noise drew them aside, or that they followed a line of it."""
    white, reached = fitted(FIRST, "white", 1.0), fitted(SECOND, "spectrum", 1.0)
    assert chosen(monkeypatch, white, reached) is reached
    assert chosen(monkeypatch, white, fitted(SECOND, "spectrum", 1.5)) is white
    assert chosen(monkeypatch, white, fitted(SECOND, "white", 0.8)) is white
    assert chosen(monkeypatch, fitted(FIRST, "spectrum", 1.0), reached) is not reached


@pytest.mark.parametrize(("times", "again"), [(1.5, False), (3.0, True)])
def test_what_is_fitted_again_begins_elsewhere(monkeypatch, times, again):
    """A shock that no model fits took four times as long: every start led back to the same misfit."""
    made = simulate(("accelerometer", FIRST), "random", samples=1000, seed=1)
    judgement = replace(
        fitted(FIRST, "white", 50.0, adequate=False)[1], predicted=tuple(r.response for r in made.records)
    )
    monkeypatch.setattr(attempts, "judged", lambda *_: judgement)
    evidence = Evidence(made, parse("accelerometer"), made.records, None, measure_bands(made.records), ())
    other = {**FIRST, "natural_frequency": times * FIRST["natural_frequency"]}
    monkeypatch.setattr(attempts, "_weighed_start", lambda *_: other)
    monkeypatch.setattr(attempts, "_searched_again", lambda best: None)
    estimator = Rejected(others=())
    attempts.Fitted.of(evidence, estimator, silent)  # type: ignore[arg-type]
    assert estimator.starts == ([None, other] if again else [None])


def test_noise_of_the_reference_does_not_lead_shocks_to_a_resonance_at_infinity():
    """Σ Y X*/Σ |X|² of bands that hold nothing else is drawn to zero: of four shocks with 2 % of it the model was
    rejected, at 60 kHz where the resonance is at 600 Hz."""
    rng, rate, n = np.random.default_rng(5), 1000.0, 600
    time_s, relative = np.arange(n) / rate, np.fft.rfftfreq(4 * n, 1.0 / rate) / 600.0
    response = 2.0 / (1.0 - relative**2 + 0.2j * relative)
    made = []
    for number, width_s in enumerate(rng.uniform(0.006, 0.009, 4)):
        reference = np.exp(-0.5 * ((time_s - 0.2) / width_s) ** 2)
        output = np.fft.irfft(response * np.fft.rfft(reference, 4 * n), 4 * n)[:n]
        reference, output = (v + u * v.std() * rng.normal(size=n) for v, u in ((reference, 0.02), (output, 1e-3)))
        made.append(Record(f"shock-{number}", reference, output, rate, "shock"))
    result = identify(Calibration(records=tuple(made), model="accelerometer"))
    found = result.parameters["natural_frequency"]
    assert found.standard_uncertainty is not None
    assert abs(found.value - 600.0) < 4.0 * found.standard_uncertainty
    assert result.fit.adequate


@pytest.mark.parametrize("left", [0.3, 0.9])
def test_a_fit_that_leaves_most_of_the_response_is_no_better_for_the_few_bands_it_is_tested_in(monkeypatch, left):
    """Eight shocks whose reference was displacement, said to be acceleration: of 87 % of the response's power left, and
    rejected in 44 bands, it went to 99 % left, adequate in 12, and 276 standard uncertainties from the truth."""
    made = simulate(("accelerometer", FIRST), "random", samples=1000, seed=1)
    bands = measure_bands(made.records)
    evidence = Evidence(made, parse("accelerometer"), made.records, None, bands, ())
    estimate, judgement = fitted(SECOND, "spectrum", 0.6)
    other = estimate, replace(judgement, shares=Shares(1.0 - left, 1.0, 100.0))
    monkeypatch.setattr(attempts, "judged", lambda *_: other[1])
    best = attempts.Fitted(evidence, *fitted(FIRST, "white", 9.0, adequate=False), Rejected(), silent)  # type: ignore[arg-type]
    assert (attempts._tried(SECOND, best) is best) == (left > 0.5)


@pytest.mark.parametrize(
    ("name", "seed"), [("clean/in-light/multisine/8 bit", 27), ("clean/pickup-in-light/multisine/8 bit", 28)]
)
def test_a_displacement_of_eight_bits_leads_to_the_resonance_that_its_steps_hide(name, seed):
    """The steps of the reference, which the sensor's model raises with the square of the frequency, draw equal weights
    to a third of the natural frequency, and to a hundredth of the sensitivity."""
    trial = BY_NAME[name].trial(seed)
    result = identify(trial.calibration(), model=trial.model)
    assert set(result.warning_codes) <= {"weakly_determined"}
    for parameter in ("natural_frequency", "damping_ratio"):
        found = result.parameters[parameter]
        assert found.standard_uncertainty is not None
        assert abs(found.value - trial.truth[parameter]) < 4.0 * found.standard_uncertainty
