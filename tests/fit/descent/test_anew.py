"""A rejected fit is tried again from all starts, each in its own noise."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from bench.adversary.cases import BY_NAME
from bench.adversary.judge import judged

from vibrident.base.errors import NotConverged
from vibrident.fit.descent import train as training
from vibrident.fit.descent.likelihoods import mean_minus_two_log_likelihood
from vibrident.fit.descent.rivals import with_rivals
from vibrident.fit.descent.settle import START_TOLERANCE, settle
from vibrident.fit.descent.train import train, train_anew
from vibrident.fit.optimise import silent
from vibrident.fit.problem import Evidence
from vibrident.physics.discretisation import method
from vibrident.physics.models import model_of
from vibrident.physics.simulation import simulate, with_noise

SLOW = pytest.mark.slow
SENSOR = {"sensitivity": 0.1, "natural_frequency": 652.1, "damping_ratio": 0.05, "delay": 3e-4}


def case(name, run, what, *marks):
    return pytest.param(name, run, marks=marks, id=what)


@pytest.mark.parametrize(
    ("name", "run"),
    [
        # Its first descent explained 5 % of the response, in line with the noise known before.
        case("noises/strong white, response pink/displacement/burst running", 102, "noise far too high before a model"),
        # Any two transients have a smooth ratio: motion was heard in more bins there, and 0 % was explained.
        case("quantities/acceleration/velocity-pickup+delay/shock running", 146, "a delay between two transients"),
        # A wrong place was adequate: the ringing of the right one was noise, and no parameter had an uncertainty.
        case("noises/reference white, response ar2/acceleration/shock running", 146, "ringing was noise", SLOW),
        # Without a model 89 of 2,700 bins counted: the best of all starts explained 0.14 %.
        case("clean/below-light+delay=300/sweep/growing 0.5 %", 135, "the grid is searched again", SLOW),
        # The motion of its own span was compared, not that before it: all seemed incoherent, no retry worth it.
        case("clean/below-light+delay=300/sweep/1/f 0.3 %", 141, "coherent beside a long delay", SLOW),
        # Each in its own noise, a place 60 u away was likelier by 100: it leaves more in either.
        case("quantities/displacement/accelerometer+mode2=0.1/random", 142, "optima are compared in one noise", SLOW),
        # Without a model, steep noise of the lowest bins was too low: a mode at 0.17 Hz followed it.
        case("clean/above-light+mode2=0.01/sweep/1/f 0.3 %", 135, "the end that leaves less in one noise", SLOW),
        # All places seemed to explain the bins, in noise that was far too high: the quietest came first.
        case("clean/below-light+delay=300/sweep/white 1e-6", 147, "noise far too high before the grid", SLOW),
        # The response jumps between the ends of its records: turned by a delay, no place of the grid explained it.
        case("quantities/acceleration/accelerometer+mode2=-0.1+delay/random", 147, "a delay beside jumps", SLOW),
        # No start of the grid explains it: a search with a model error leads to both modes.
        case("quantities/acceleration/accelerometer+mode2=-0.1+delay/sweep running", 148, "two modes below", SLOW),
    ],
)
def test_the_right_place_is_the_estimate(name, run):
    assert judged(BY_NAME[name].trial(run))["class"] == "right"


def delayed(samples):
    """Return two noisy records of a sensor with a delay."""
    clean = simulate(
        ("accelerometer+delay", SENSOR),
        "random",
        frequencies_hz=[20.0, 3000.0],
        sampling_rate_hz=20_000.0,
        samples=samples,
        repeats=2,
        seed=1,
    )
    return with_noise(clean, response_noise=0.01, seed=2)


def settled(calibration, trained=train):
    """Return an estimate of the network."""
    evidence = Evidence.gather(calibration, model_of(calibration, None))
    return trained(evidence, method("bandlimited"), silent)


def test_the_likelihood_for_each_number_knows_no_unit():
    """Fits at other delays leave out other samples: sums over all of them would depend on it."""
    calibration = delayed(2000)
    unit = 1e-9
    records = tuple(replace(r, response=unit * r.response) for r in calibration.records)
    plain, in_unit = (
        mean_minus_two_log_likelihood(settled(given).places)
        for given in (calibration, replace(calibration, records=records))
    )
    assert in_unit == pytest.approx(plain, abs=1e-4)


def test_a_second_descent_to_the_bottom_of_the_estimate_is_no_other_optimum():
    """What a later correction moves the estimate away from would pass for another solution."""
    calibration = delayed(2000)
    evidence = Evidence.gather(calibration, model_of(calibration, None))
    band, observed = next(training._observations(evidence, method("bandlimited")))
    survey = training._Survey(band, observed)
    weighting = training._without_model(band, observed)
    ends = training._descended(evidence, survey, weighting, [SENSOR, SENSOR], silent, all_starts=True)
    estimate = settle(ends[0], observed, weighting, silent)
    assert with_rivals(estimate, ends, observed, silent).rival_optima == ()


def test_suited_data_have_the_same_estimate_from_all_starts():
    clean = simulate("paper", "random", samples=2000, repeats=2, seed=1)
    calibration = with_noise(clean, response_noise=0.01, seed=2)
    first, again = (settled(calibration, trained) for trained in (train, train_anew))
    u = np.sqrt(np.diag(first.covariance))
    shift = first.coordinates.place(again.coordinates.values(again.z)) - first.z
    # As near as two descents that end at one bottom.
    assert np.max(np.square(shift / u)) < 4.0 * START_TOLERANCE


def test_all_starts_lead_to_the_sensor_where_samples_are_omitted_beside_a_delay():
    calibration = delayed(3000)
    records = []
    for record in calibration.records:
        valid = np.ones(record.samples, dtype=bool)
        valid[1200:1230] = False
        response = np.where(valid, record.response, 0.0)
        records.append(replace(record, response=response, valid=valid))
    again = settled(replace(calibration, records=tuple(records)), train_anew)
    u = np.sqrt(np.diag(again.covariance))
    distance = again.coordinates.place(SENSOR) - again.z
    assert np.max(np.abs(distance / u)) < 4.0


def test_a_delay_at_which_nothing_fits_ends_no_search(monkeypatch):
    """All starts of a first look grew beyond all numbers, and the right delay was not tried."""

    def descents(evidence, survey, progress):
        if survey.band == "wrong delay":
            raise NotConverged("no fit")
        return SimpleNamespace(
            cost_per_number=1.0, explains_little=False, rank=(False, 1.0), settled=lambda *_: "the estimate"
        )

    monkeypatch.setattr(training, "_observations", lambda *_: [("wrong delay", None), ("right delay", None)])
    monkeypatch.setattr(training._Descents, "at", staticmethod(descents))
    assert train(None, None, silent) == "the estimate"
