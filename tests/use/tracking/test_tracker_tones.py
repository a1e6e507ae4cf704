"""Tones in recursive Fourier form: as good as a batch, blind to harmonics; and the seismometer of the shared data."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2
from tests.support.random_record import RATE_HZ, TRUTH
from tests.support.real_data import calibration_beside_data, seismometer, seismometer_once
from tests.support.tracked import answered, fed, motion, tracker, transfer

import vibrident
from vibrident import Calibration
from vibrident.data.sources.kinds.calibration_records import chunks_of
from vibrident.use.tracking.outcome import tracked_result
from vibrident.use.tracking.reference_noise import estimate_reference_noise
from vibrident.use.tracking.session import TrackingSession
from vibrident.use.tracking.state import TrackerSettings

NAMES = tuple(TRUTH)
TONES_HZ = np.geomspace(41.0, 3900.0, 10)


def sines(rng, values=TRUTH, samples=8000, harmonics=0.0):
    """Sine records with noise of 1 % in both channels."""
    t = np.arange(samples) / RATE_HZ
    pairs = []
    for f in TONES_HZ:
        phase = rng.random() * 2.0 * np.pi
        u = np.sin(2.0 * np.pi * f * t + phase)
        y = np.imag(transfer(np.array([f]), values)[0] * np.exp(1j * (2.0 * np.pi * f * t + phase)))
        y = y + harmonics * np.sin(4.0 * np.pi * f * t + phase) * np.std(y)
        noise = 0.01 * rng.normal(size=(2, samples)) * [[np.std(u)], [np.std(y)]]
        pairs.append((u + noise[0], y + noise[1]))
    return Calibration.from_arrays(*map(list, zip(*pairs, strict=True)), RATE_HZ, excitation="sine")


def tracked(result, calibration):
    session = TrackingSession.from_result(
        result, calibration.records[0].sampling_rate_hz, calibration.quantity, 1.0, TrackerSettings()
    )
    for chunk in chunks_of(calibration):
        session.take(chunk)
    session.finish()
    return session


@pytest.fixture(scope="module")
def certificate():
    return vibrident.identify(sines(np.random.default_rng(99), samples=800), model="accelerometer")


@pytest.mark.draws(3, 100)
def test_tones_are_taken_as_by_a_batch_whatever_their_harmonics(certificate, draws):
    """Against `identify` of the same records with the certificate as what was known before.

    Each tone's first periods are lost to the tracker: of half as many samples it is a little further apart.
    """
    z, apart = [], []
    c0 = certificate.to_sensor().covariance
    start = np.array([certificate.parameters[name].value for name in NAMES])
    for seed in range(draws):
        calibration = sines(np.random.default_rng(seed), harmonics=0.05)
        session = tracked(certificate, calibration)
        assert not session.alarms
        found = session.tracker.read()
        values, u = (np.array([each[name] for name in NAMES]) for each in (found.values, found.uncertainty))
        batch = vibrident.identify(calibration, model="accelerometer")
        new = np.array([batch.parameters[name].value for name in NAMES])
        information = [np.linalg.inv(c) for c in (c0, batch.to_sensor().covariance)]
        both = np.linalg.solve(sum(information), information[0] @ start + information[1] @ new)
        apart.append((values - both) / u)
        z.append((values - np.array(list(TRUTH.values()))) / u)
    assert np.all(np.std(apart, axis=0) < 0.46)  # it then adds a tenth to the scatter
    assert np.all(np.sum(np.array(z) ** 2, axis=0) < chi2.ppf(1 - 1e-4 / 3, draws))
    assert np.all(np.sum(np.array(z) ** 2, axis=0) > chi2.ppf(1e-4 / 3, draws))


def test_a_change_between_tones_is_an_alarm(certificate):
    moved = tracked(certificate, sines(np.random.default_rng(1), {**TRUTH, "sensitivity": 0.11}))
    assert [alarm.what for alarm in moved.alarms] == ["gain"]
    assert moved.tracker.read().values["sensitivity"] == pytest.approx(0.11, rel=0.005)


@pytest.mark.parametrize("pickup", ["laser", "coil"])
@pytest.mark.quick("coil")
def test_the_seismometer_stays_within_the_intervals_of_its_certificate(pickup, tmp_path, tmp_path_factory):
    result = seismometer_once(pickup, tmp_path_factory)
    session = tracked(result, seismometer(pickup, tmp_path))
    assert not session.alarms
    end = tracked_result(result, session)
    for name in session.tracker.network.model.parameter_names:
        low, high = result.parameters[name].interval_95
        assert low < end.parameters[name].value < high


def test_a_shock_that_its_model_does_not_suit_is_a_doubt(tmp_path):
    """PTB's accelerometer has further resonances: a change is seen, not told what within a shock, and that is said."""
    calibration = vibrident.read(calibration_beside_data("ptb-shock.toml", "ptb-shock", tmp_path))
    result = vibrident.identify(calibration)
    session = tracked(result, calibration)
    end = tracked_result(result, session)
    (record,) = calibration.records
    peak_s = float(np.argmax(np.abs(record.reference))) / record.sampling_rate_hz
    assert session.document()["changing"]["time_s"] == pytest.approx(peak_s, abs=2e-4)
    assert end.warning_codes == ("regimes",)
    for name in session.tracker.network.model.parameter_names:
        off = abs(end.parameters[name].value - result.parameters[name].value)
        assert off <= 2.0 * end.parameters[name].standard_uncertainty


@pytest.mark.parametrize("size", [0.0, 0.05])
@pytest.mark.draws(4, 10)
def test_noise_of_the_reference_is_told_and_taken_out(size, draws):
    """A response with as much noise as 1 %; the gain is then less by about the square of ``size``."""
    z, off = [], []
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        u = motion("random", 60000, rng)
        y = answered(u)
        y += 0.01 * np.std(y) * rng.normal(size=len(y))
        one = fed(tracker(None, u=0.1), u + size * rng.normal(size=len(u)), y)
        found, read = estimate_reference_noise(one), one.read()
        assert found is not None
        z.append((found.variance - size**2) / found.u)
        assert found.corrects == (size > 0.0)
        assert (found.shift[0] < -2.0 * read.uncertainty["sensitivity"]) == (size > 0.0)
        if size > 0.0:
            read = found.corrected(read)
        off.append([(read.values[name] - TRUTH[name]) / read.uncertainty[name] for name in NAMES])
    assert np.sum(np.array(z) ** 2) < chi2.ppf(1 - 1e-4, draws)
    assert np.all(np.sum(np.array(off) ** 2, axis=0) < chi2.ppf(1 - 1e-4 / 3, draws))


def test_a_residual_of_another_colour_is_not_taken_for_noise_of_the_reference(rng):
    from scipy.signal import lfilter

    u = motion("random", 60000, rng)
    y = answered(u)
    red = lfilter([1.0], [1.0, -0.95], rng.normal(size=2 * len(y)))[len(y) :]
    one = fed(tracker(None, u=0.1), u, y + 0.01 * np.std(y) * red / np.std(red))
    found = estimate_reference_noise(one)
    assert found is None or not found.corrects
