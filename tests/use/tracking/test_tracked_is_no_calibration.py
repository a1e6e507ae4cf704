"""A tracked result carries the effects that its calibration stated, and is certified by nobody."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.support.certified import CERTIFICATE
from tests.support.random_record import RATE_HZ, TRUTH
from tests.support.tracked import answered, motion

import vibrident
from vibrident import Calibration
from vibrident.base.errors import InputError
from vibrident.data.records import SystematicEffect
from vibrident.data.sources.kinds.calibration_records import chunks_of
from vibrident.export import export
from vibrident.result import Result
from vibrident.show import report
from vibrident.show.certificate import certificate
from vibrident.show.use_figures import tracking
from vibrident.use.tracking.outcome import tracked_result
from vibrident.use.tracking.session import TrackingSession
from vibrident.use.tracking.state import TrackerSettings

GAIN, LATE_S = 0.02, 3e-6  # stated standard uncertainties: relative, and of the time
EFFECTS = (SystematicEffect("bridge", "gain", GAIN), SystematicEffect("filter", "timing", LATE_S))
SAMPLES = 60000
REFERENCE = {**CERTIFICATE, "reference_frequency_hz": 80.0}


def records(seed: int, **more) -> Calibration:
    """Random motion with noise of 1 % in the response."""
    rng = np.random.default_rng(seed)
    u = motion("random", SAMPLES, rng)
    y = answered(u)
    y = y + 0.01 * np.std(y) * rng.normal(size=SAMPLES)
    return Calibration.from_arrays(u, y, RATE_HZ, excitation="random", **more)


@pytest.fixture(scope="module")
def calibrated() -> Result:
    named = {"sensor": {"serial_number": "4711"}}
    return vibrident.identify(records(1, effects=EFFECTS, **named), model="accelerometer+delay")


def session_of(result: Result, reference: float = 0.0) -> TrackingSession:
    settings = TrackerSettings(reference_uncertainty=reference)
    session = TrackingSession.from_result(result, RATE_HZ, "acceleration", 1.0, settings)
    for chunk in chunks_of(records(2)):
        session.take(chunk)
    session.finish()
    return session


@pytest.fixture(scope="module")
def end(calibrated):
    return tracked_result(calibrated, session_of(calibrated))


def u_of(result: Result, name: str) -> float:
    return result.parameters[name].standard_uncertainty or 0.0


def test_no_samples_leave_the_calibration(calibrated):
    session = TrackingSession.from_result(calibrated, RATE_HZ, "acceleration", 1.0, TrackerSettings(drift_per_year=0.0))
    unmoved = tracked_result(calibrated, session)
    for name in (*TRUTH, "delay"):
        assert u_of(unmoved, name) == pytest.approx(u_of(calibrated, name), rel=1e-9)


def test_samples_do_not_average_stated_effects_out(calibrated, end):
    value = end.parameters["sensitivity"].value
    assert u_of(end, "sensitivity") == pytest.approx(GAIN * value, rel=0.02)
    assert u_of(end, "delay") == pytest.approx(LATE_S, rel=0.02)
    assert u_of(end, "natural_frequency") < u_of(calibrated, "natural_frequency")


def test_the_budget_sums_to_u_and_covers_says_what_it_holds(end):
    rows = end.settings["uncertainty_budget"]
    assert [row["source"] for row in rows[1:]] == ["bridge", "filter"]
    for name in (*TRUTH, "delay"):
        parts = [row["contributions"][name] for row in rows]
        assert np.linalg.norm(parts) == pytest.approx(u_of(end, name), rel=1e-6)
    assert end.uncertainty == {"covers": ["noise", "gain", "phase"]}


def test_what_was_not_stated_is_not_covered():
    plain = vibrident.identify(records(1), model="accelerometer")
    after = tracked_result(plain, session_of(plain))
    assert after.uncertainty == {"covers": ["noise"]}


def test_the_sessions_own_reference_takes_the_place_of_the_calibrations():
    made = replace(records(1), reference_standard_uncertainty=0.02)
    result = vibrident.identify(made, model="accelerometer")
    after = tracked_result(result, session_of(result, reference=0.005))
    value = after.parameters["sensitivity"].value
    assert u_of(after, "sensitivity") == pytest.approx(0.005 * value, rel=0.02)
    rows = after.settings["uncertainty_budget"]
    parts = [row["contributions"]["sensitivity"] for row in rows]
    assert np.linalg.norm(parts) == pytest.approx(u_of(after, "sensitivity"), rel=1e-6)


@pytest.mark.parametrize("language", ["en", "de", "fr", "zh"])
def test_its_document_is_a_tracking_report(end, language):
    limits = [{"quantity": "sensitivity_deviation", "low": -1.0, "high": 1.0}]
    stated = {**REFERENCE, "language": language, "requirements": limits}
    made = certificate(replace(end, certificate=stated))
    titles = {"en": "Tracking report", "de": "Nachführbericht", "fr": "Rapport de suivi", "zh": "跟踪报告"}
    assert made.title == titles[language]
    assert not made.draft
    said = repr(made)
    for wrong in ("nan Hz", "outside the measured", "außerhalb des gemessenen", "hors de la bande", "频带之外"):
        assert wrong not in said


def test_it_is_no_digital_certificate(end, tmp_path):
    with pytest.raises(InputError, match="no calibration"):
        export(replace(end, certificate=CERTIFICATE), "dcc", tmp_path, country="DE")


@pytest.mark.needs("history")
def test_it_cannot_be_approved(end, calibrated, tmp_path):
    from vibrident.lab.history.approval import approve
    from vibrident.lab.history.entry import add_all
    from vibrident.lab.history.store import Store

    dated = [replace(result, certificate={"date_of_calibration": "2025-03-01"}) for result in (calibrated, end)]
    with Store(str(tmp_path / "h.db")) as store:
        first, second = (one.number for one in add_all(store, dated))
        assert approve(store, first) == []
        with pytest.raises(InputError, match="no calibration"):
            approve(store, second)


def test_without_motion_there_is_no_panel_of_the_innovation():
    columns = {"time_s": np.arange(3.0), "sensitivity": np.ones(3), "sensitivity_u": np.full(3, 0.1)}
    document = {"model": "accelerometer", "parameters": {"sensitivity": {"unit": "V"}}, "alarms": []}
    made = tracking({**columns, "innovation": np.full(3, np.nan)}, document, {})
    assert len(made.stacks[0].panels) == 1
    made = tracking({**columns, "innovation": np.ones(3)}, document, {})
    assert len(made.stacks[0].panels) == 2


def test_its_report_is_written(end, tmp_path):
    for form in ("html", "md"):
        assert report.write(end, form, tmp_path)
