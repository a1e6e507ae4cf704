"""Records without what their channels do to them: exactly the motion and the sensor's own output."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support.known_channels import (
    RATE_HZ,
    REFERENCE,
    SENSOR,
    Motion,
    accelerometer,
    known_reference,
    seismometer,
)

from vibrident import Calibration, InputError, KnownResponse, Record
from vibrident.fit.response.deconvolution import chain_of, deconvolved

BAND_HZ = (50.0, 12000.0)


def freed(reference, response, excitation="random", rate_hz=RATE_HZ, **known) -> Record:
    """The only record, without its channels' responses."""
    calibration = Calibration.from_arrays([reference], [response], rate_hz, excitation=excitation, **known)
    chain = chain_of(calibration)
    assert chain is not None
    return deconvolved(calibration.records[0], chain)


def place(record: Record, rate_hz: float = RATE_HZ) -> slice:
    """Which samples of the record are left."""
    begin = round(record.start_time_s * rate_hz)
    return slice(begin, begin + record.samples)


@pytest.mark.parametrize("kind", ["random", "multisine", "sweep", "shock"])
def test_a_reference_that_resonates_gives_the_motion(kind):
    motion = Motion(kind, 8192, RATE_HZ, BAND_HZ if kind != "sweep" else (50.0, 9000.0))
    record = freed(
        motion.channel(accelerometer(*REFERENCE)),
        motion.channel(),
        kind,
        reference_known_response=known_reference(),
    )
    truth = motion.channel()
    assert record.samples > 0.8 * 8192
    np.testing.assert_allclose(record.reference, truth[place(record)], atol=2e-4 * np.std(truth) + 1e-4)
    # the response is the laser's, filtered alike: no relation between the channels is left
    np.testing.assert_allclose(record.response, record.reference, atol=2e-4 * np.std(truth) + 1e-4)


def test_a_response_that_is_known_goes_to_the_other_side_and_leaves_the_response_its_noise():
    motion = Motion("random", 8192, RATE_HZ, BAND_HZ)
    taps = np.hanning(9)[1:-1] / 4.0
    known = KnownResponse.from_filter(3.0 * taps, rate_hz=RATE_HZ)
    response = motion.channel(known.value)
    record = freed(motion.channel(), response, response_known_response=known)
    np.testing.assert_allclose(record.response, record.reference, atol=2e-4 * np.std(response))
    # in the unit of the sensor's output
    assert np.std(record.response) == pytest.approx(np.std(response / 3.0), rel=0.01)


def test_a_broadband_gives_the_velocity_above_the_band_that_its_record_tells():
    motion = Motion("random", 60_000, 100.0, (0.02, 30.0))
    turn = 2.0 * np.pi / 120.0
    known = KnownResponse.from_poles(np.roots([1.0, 1.414 * turn, turn**2]), [0.0, 0.0], 1500.0)
    signal = motion.channel(seismometer(1500.0, 1.0 / 120.0, 0.707))
    record = freed(signal, motion.channel(), rate_hz=100.0, quantity="velocity", reference_known_response=known)
    assert record.band_hz is not None
    assert record.band_hz[0] < 0.1
    # at its bins the channels are alike, whatever lies below
    motions = [np.fft.rfft(channel * np.hanning(record.samples)) for channel in (record.reference, record.response)]
    hz = np.fft.rfftfreq(record.samples, 0.01)
    inside = (hz > 1.1 * record.band_hz[0]) & (hz < 25.0)
    error = np.abs(motions[0] - motions[1])[inside]
    assert np.sqrt(np.mean(error**2)) < 1e-4 * np.sqrt(np.mean(np.abs(motions[1][inside]) ** 2))


def test_a_sine_needs_one_value():
    time_s, hz = np.arange(4000) / RATE_HZ, 700.0
    value = complex(accelerometer(*REFERENCE)(np.array([hz]))[0])
    turning = np.exp(2j * np.pi * hz * time_s)
    record = freed((value * turning).real, turning.real, "sine", reference_known_response=known_reference())
    np.testing.assert_allclose(record.reference, record.response, atol=1e-5)


def test_what_is_clipped_spoils_as_far_as_the_filter_reaches_and_no_further():
    motion = Motion("random", 8192, RATE_HZ, BAND_HZ)
    signal, answer = motion.channel(accelerometer(*REFERENCE)), motion.channel()
    whole = freed(signal, answer, reference_known_response=known_reference())
    bad = np.zeros(8192, bool)
    bad[4000:4004] = True
    spoilt = np.where(bad, 0.0, signal)
    calibration = Calibration.from_arrays(
        [spoilt], [answer], RATE_HZ, excitation="random", reference_known_response=known_reference()
    )
    chain = chain_of(calibration)
    assert chain is not None
    record = deconvolved(replace(calibration.records[0], reference_valid=~bad), chain)
    lost = int(np.sum(~record.reference_mask))
    assert 4 < lost < 400
    sound = record.reference_mask
    np.testing.assert_allclose(record.reference[sound], whole.reference[sound], atol=2e-3 * np.std(signal / 0.1))


def test_a_table_is_divided_point_by_point_and_cut_to_what_is_known():
    from vibrident import ResponseTable
    from vibrident.fit.response.deconvolution import without_chain

    hz = np.geomspace(10.0, 20000.0, 40)
    sensor, reference = accelerometer(*SENSOR)(hz), accelerometer(*REFERENCE)(hz)
    known_hz = np.geomspace(30.0, 8000.0, 600)
    known_value = accelerometer(*REFERENCE)(known_hz)
    known = KnownResponse.from_table(known_hz, np.abs(known_value), np.angle(known_value))
    ratio = sensor / reference
    table = ResponseTable(hz, np.abs(ratio), np.angle(ratio), 0.01 * np.abs(ratio), np.full(40, 0.01))
    calibration = Calibration(table=table, reference_known_response=known)
    chain = chain_of(calibration)
    assert chain is not None
    done = without_chain(calibration, chain)
    inside = (hz >= 30.0) & (hz <= 8000.0)
    assert done.table is not None
    np.testing.assert_allclose(done.table.response, sensor[inside], rtol=1e-6)
    np.testing.assert_allclose(done.table.magnitude_uncertainty, 0.01 * done.table.magnitude, rtol=1e-12)
    assert chain_of(done) is None  # and it is not taken out twice


def test_a_band_beyond_the_table_gets_one_message():
    motion = Motion("random", 8192, RATE_HZ, BAND_HZ)
    known = KnownResponse.from_table([20.0, 200.0, 5000.0], [1.0] * 3, [0.0] * 3)
    calibration = Calibration.from_arrays(
        [motion.channel()], [motion.channel()], RATE_HZ, excitation="random", reference_known_response=known
    )
    chain = chain_of(calibration)
    assert chain is not None
    with pytest.raises(InputError, match="beyond what is known"):
        deconvolved(calibration.within((20.0, 6000.0)).records[0], chain)
    assert deconvolved(calibration.records[0], chain).band_hz[1] == 5000.0  # without one it is cut


def test_a_record_too_short_and_a_free_decay_are_refused_by_name():
    motion = Motion("random", 1000, 100.0, (0.02, 30.0))
    turn = 2.0 * np.pi / 120.0
    known = KnownResponse.from_poles(np.roots([1.0, 1.414 * turn, turn**2]), [0.0, 0.0], 1500.0)
    narrow = KnownResponse.from_table([0.01, 0.1, 1.0], [1.0] * 3, [0.0] * 3)
    with pytest.raises(InputError, match="too short for the known response"):
        freed(motion.channel(), motion.channel(), rate_hz=100.0, reference_known_response=known.times(narrow))
    decay = Record("free", None, motion.channel(), 100.0, "decay")
    chain = chain_of(Calibration((decay,), response_known_response=known))
    assert chain is not None
    with pytest.raises(InputError, match="free decay"):
        deconvolved(decay, chain)
