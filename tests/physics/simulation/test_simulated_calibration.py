"""``simulate`` from end to end: what the records are, what a seed means, and what is refused."""

from dataclasses import dataclass

import numpy as np
import pytest

from vibrident.base.errors import InputError, ModelError
from vibrident.data.records import STANDARD_GRAVITY
from vibrident.physics.models import parse
from vibrident.physics.simulation import (
    SENSORS,
    ChannelNoise,
    Decay,
    HalfSineShock,
    Sensor,
    Sine,
    Sweep,
    exact_response,
    simulate,
    with_noise,
)

PAPER = SENSORS["paper"]


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


def samples_of(calibration):
    return b"".join(
        r.response.tobytes() + (r.reference.tobytes() if r.reference is not None else b"") for r in calibration.records
    )


def test_the_paper_by_default():
    calibration = simulate()
    assert len(calibration.records) == 21
    assert [r.name for r in calibration.records[:4]] == ["10 Hz", "12.5 Hz", "16 Hz", "20 Hz"]
    assert {(r.samples, r.sampling_rate_hz, r.excitation) for r in calibration.records} == {(16000, 51200.0, "sine")}
    assert (calibration.model, calibration.quantity, calibration.reference_unit) == (
        "accelerometer",
        "acceleration",
        "m/s^2",
    )
    record = calibration.records[12]
    assert record.frequency_hz == 10.0**2.2
    t = record.time_s
    np.testing.assert_allclose(record.reference, STANDARD_GRAVITY * np.sin(2 * np.pi * 10.0**2.2 * t), atol=1e-10)
    assert any("natural_frequency" in step for step in record.provenance.history)


def test_table_2_of_the_paper():
    """f0 = 630 Hz, S0 = 1020 mV/g, δ = 0.182; K = S0 ωn² = 1.745e6 mV/mm and ωn = 4096.4 rad/s."""
    derived = {d.name: d.value(PAPER.parameters) for d in parse(PAPER.model).derived(PAPER.parameters)}
    assert derived["resonance_frequency"] == pytest.approx(630.0, rel=1e-12)
    assert derived["natural_angular_frequency"] == pytest.approx(4096.4, abs=0.05)
    assert derived["conversion_coefficient"] == pytest.approx(1.745e6, rel=5e-4)  # V/m is mV/mm
    assert PAPER.parameters["sensitivity"] * STANDARD_GRAVITY == pytest.approx(1.02, rel=1e-14)


def test_the_response_is_the_exact_one():
    record = simulate(start="steady").records[20]
    expected = exact_response(
        parse(PAPER.model),
        PAPER.parameters,
        Sine(1000.0, STANDARD_GRAVITY, -np.pi / 2),
        sampling_rate_hz=51200.0,
        samples=16000,
        start="steady",
    )
    np.testing.assert_array_equal(record.response, expected)
    gain = abs(parse(PAPER.model).frequency_response(PAPER.parameters, np.array([1000.0]))[0])
    whole_periods = record.response[: 12 * 256]  # 256 samples are 5 periods
    assert rms(whole_periods) == pytest.approx(gain * STANDARD_GRAVITY / np.sqrt(2), rel=1e-11)


def test_inverted_is_the_negative():
    plain, inverted = simulate(samples=100), simulate("inverted", samples=100)
    for a, b in zip(plain.records, inverted.records, strict=True):
        np.testing.assert_array_equal(a.response, -b.response)
        np.testing.assert_array_equal(a.reference, b.reference)


def test_snr_is_as_asked():
    """20 dB: noise rms a tenth of the sine's, within 0.5 % on average of 21 records; the sensor answers it."""
    clean, noisy = simulate(seed=3), simulate(excitation_snr_db=20.0, seed=3)
    ratio = [
        rms(b.reference - a.reference) / rms(a.reference) for a, b in zip(clean.records, noisy.records, strict=True)
    ]
    assert np.mean(ratio) == pytest.approx(0.1, rel=0.005)
    for a, b in zip(clean.records, noisy.records, strict=True):
        assert rms(b.response - a.response) > 0.01 * rms(a.response)
    assert "felt by the sensor" in noisy.records[0].provenance.history[1]


def test_band_of_excitation_noise():
    clean = simulate(samples=4000)
    noisy = simulate(samples=4000, excitation_snr_db=20.0, excitation_noise_band_hz=(0.0, 2000.0))
    extra = np.array([b.reference - a.reference for a, b in zip(clean.records, noisy.records, strict=True)])
    window = np.blackman(4000)
    spectrum = np.mean(np.abs(np.fft.rfft(window * extra)) ** 2, axis=0)
    f = np.fft.rfftfreq(4000, 1 / 51200.0)
    assert np.max(spectrum[f > 2300.0]) < 1e-6 * np.max(spectrum)


@pytest.mark.parametrize("excitation", ["sine", "multisine", "sweep", "random", "shock", "decay"])
def test_same_seed_same_bytes_other_seed_differs(excitation):
    def made(seed):
        felt = {} if excitation == "decay" else {"excitation_snr_db": 20.0}
        noises = {"reference_noise": 0.001, "response_noise": ChannelNoise(0.01, 0.01, 0.01)}
        return samples_of(simulate("paper", excitation, samples=2000, seed=seed, **felt, **noises))

    assert made(5) == made(5)
    assert made(5) != made(6)


def test_streams_do_not_depend_on_other_records():
    """The first records keep their noise when records are added or another kind of noise is turned on."""
    few = simulate(frequencies_hz=[10.0, 100.0], samples=500, response_noise=0.01, seed=4)
    many = simulate(frequencies_hz=[10.0, 100.0, 300.0], samples=500, response_noise=0.01, reference_noise=0.1, seed=4)
    for a, b in zip(few.records, many.records[:2], strict=True):
        np.testing.assert_array_equal(a.response, b.response)


def test_noise_on_a_truth_is_the_simulated_noise():
    whole = simulate(samples=500, response_noise=0.01, reference_noise=0.002, seed=8)
    truth = simulate(samples=500, seed=8)
    assert samples_of(with_noise(truth, response_noise=0.01, reference_noise=0.002, seed=8)) == samples_of(whole)
    assert with_noise(truth) is truth
    assert whole.records[0].provenance.history[-1] == "response channel: white 0.01 of the rms, seed 8"


def test_draws_over_one_truth_are_independent():
    truth = simulate(samples=2000, frequencies_hz=[100.0])
    level = 0.01 * rms(truth.records[0].response)
    draws = np.array(
        [
            with_noise(truth, response_noise=0.01, seed=s).records[0].response - truth.records[0].response
            for s in range(50)
        ]
    )
    assert rms(draws) == pytest.approx(level, rel=0.01)
    correlation = np.corrcoef(draws)[np.triu_indices(50, 1)]
    assert np.max(np.abs(correlation)) < 5 / np.sqrt(2000)
    assert np.std(correlation) == pytest.approx(1 / np.sqrt(2000), rel=0.1)


def test_white_noise_of_channels_and_records_is_independent():
    clean = simulate(samples=4000, frequencies_hz=[100.0, 200.0], repeats=2)
    noisy = with_noise(clean, reference_noise=0.1, response_noise=0.1, seed=1)
    rows = [
        getattr(b, name) - getattr(a, name)
        for a, b in zip(clean.records, noisy.records, strict=True)
        for name in ("reference", "response")
    ]
    correlation = np.corrcoef(rows)[np.triu_indices(8, 1)]
    assert np.max(np.abs(correlation)) < 4 / np.sqrt(4000)


def test_quantised_channels_say_their_full_scale():
    channel = ChannelNoise(bits=16, full_scale=20.0)
    records = simulate(samples=500, reference_noise=channel, response_noise=channel).records
    assert {(r.reference_full_scale, r.response_full_scale) for r in records} == {(20.0, 20.0)}
    codes = records[0].response / (20.0 / 2**15)
    np.testing.assert_array_equal(codes, np.rint(codes))


def test_repeats_are_named_and_numbered():
    calibration = simulate(frequencies_hz=[100.0, 1000.0], samples=100, repeats=2, response_noise=0.1)
    assert [r.name for r in calibration.records] == ["100 Hz", "1000 Hz", "100 Hz (2)", "1000 Hz (2)"]
    assert not np.array_equal(calibration.records[0].response, calibration.records[2].response)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.needs("network")] * (name == "cubic")) for name in SENSORS]
)
@pytest.mark.parametrize("excitation", ["sine", "multisine", "sweep", "random", "shock", "decay"])
def test_every_sensor_with_every_excitation(name, excitation):
    calibration = simulate(name, excitation, samples=2000)
    sensor = SENSORS[name]
    for record in calibration.records:
        assert record.excitation == excitation
        assert record.sampling_rate_hz == sensor.sampling_rate_hz
        assert (record.reference is None) == (excitation == "decay")
        assert np.max(np.abs(record.response)) > 0
        assert (record.frequency_hz is not None) == (excitation == "sine")


def test_levels_of_named_excitations():
    """Multisine and random carry the rms of the sine; sweep and shock its peak."""
    amplitude = 3.0
    by = {
        kind: simulate("paper", kind, amplitude=amplitude, samples=40000).records[0].reference
        for kind in ("multisine", "random", "sweep", "shock")
    }
    assert rms(by["multisine"]) == pytest.approx(amplitude / np.sqrt(2), rel=0.05)
    assert rms(by["random"]) == pytest.approx(amplitude / np.sqrt(2), rel=0.05)
    assert np.max(np.abs(by["sweep"])) == pytest.approx(amplitude, rel=1e-3)
    assert np.max(by["shock"]) == pytest.approx(amplitude, rel=1e-3)


def test_motions_of_ones_own_and_mixed():
    calibration = simulate("geophone", [Sine(20.0, 1.0), HalfSineShock(5.0, 0.1, 0.2), Decay(1.0)], samples=4000)
    assert [r.excitation for r in calibration.records] == ["sine", "shock", "decay"]


def test_a_motion_from_outside():
    """Anything with the members of ``Motion``: here Berlage's ramped sine."""

    @dataclass(frozen=True)
    class Berlage:
        kind: str = "shock"
        words: str = "Berlage pulse"
        highest_hz: float = 400.0
        breaks_s: tuple = (0.0,)

        def value(self, time_s):
            t = np.maximum(time_s, 0.0)
            return 1e5 * t**2 * np.exp(-200.0 * t) * np.sin(2 * np.pi * 100.0 * t)

    record = simulate("paper", Berlage(), samples=4000).records[0]
    gain = PAPER.parameters["sensitivity"]
    assert np.max(np.abs(record.response - gain * record.reference)) < 0.3 * np.max(np.abs(record.response))
    assert record.provenance.history[1] == "motion: Berlage pulse"


@pytest.mark.parametrize("quantity", ["velocity", "displacement"])
def test_other_reference_quantities(quantity):
    """Every sine's reference is the acceleration's over ω or ω²; units follow."""
    calibration = simulate(quantity=quantity, frequencies_hz=[100.0], samples=5120)
    power = {"velocity": 1, "displacement": 2}[quantity]
    assert rms(calibration.records[0].reference) == pytest.approx(
        STANDARD_GRAVITY / np.sqrt(2) / (2 * np.pi * 100.0) ** power, rel=1e-12
    )
    assert calibration.reference_unit == {"velocity": "m/s", "displacement": "m"}[quantity]


def test_excitation_noise_is_seen_by_a_velocity_reference():
    settings = {"frequencies_hz": [100.0], "samples": 5120, "excitation_noise_band_hz": (50.0, 5000.0), "seed": 2}
    plain = simulate(quantity="velocity", **(settings | {"excitation_noise_band_hz": None}))
    noisy = simulate(quantity="velocity", excitation_snr_db=20.0, **settings)
    assert rms(noisy.records[0].reference - plain.records[0].reference) > 1e-3 * rms(plain.records[0].reference)


def test_rk4_comes_close_to_the_exact_response():
    """At 51.2 kHz, one step a sample: 2e-6 for the sines, 3e-5 with felt noise up to 0.4 fs."""
    exact, rk4 = (
        simulate(samples=1000, excitation_snr_db=20.0),
        simulate(samples=1000, excitation_snr_db=20.0, method="rk4"),
    )
    for a, b in zip(exact.records, rk4.records, strict=True):
        np.testing.assert_array_equal(a.reference, b.reference)
        assert 0 < np.max(np.abs(a.response - b.response)) < 1e-4 * np.max(np.abs(a.response))
    assert "rk4 response" in rk4.records[0].provenance.history[0]


def test_a_sensor_by_model_and_parameters():
    p = {"sensitivity": 0.1, "natural_frequency": 500.0, "damping_ratio": 1.0, "delay": 1e-5}
    calibration = simulate(("accelerometer+delay", p), samples=100)
    assert calibration.model == "accelerometer+delay"
    same = simulate(Sensor("mine", "my sensor", "accelerometer+delay", p), samples=100)
    assert samples_of(same) == samples_of(calibration)


REFUSED = [
    (lambda: simulate(frequencies_hz=[30000.0]), "above half"),
    (lambda: simulate(excitation=Sweep(10.0, 26000.0, 0.1, 1.0)), "above half"),
    (lambda: simulate(excitation=Sweep(10.0, 1000.0, 1.0, 1.0)), "does not fit"),
    (lambda: simulate(excitation=HalfSineShock(1.0, 0.01, 0.31)), "does not fit"),
    (lambda: simulate(excitation=HalfSineShock(1.0, 5e-5)), "too short"),
    (lambda: simulate(frequencies_hz=[]), "no frequencies"),
    (lambda: simulate(frequencies_hz=[-1.0]), "frequency_hz"),
    (lambda: simulate(sampling_rate_hz=0.0), "sampling_rate_hz"),
    (lambda: simulate(samples=7), "samples is not usable"),
    (lambda: simulate(samples=100.5), "samples is not usable"),
    (lambda: simulate(excitation="sinus"), "excitation"),
    (lambda: simulate(excitation=[]), "records or a table"),
    (lambda: simulate(start="soon"), "start"),
    (lambda: simulate(method="euler"), "method"),
    (lambda: simulate(quantity="jerk"), "quantity"),
    (lambda: simulate(repeats=0), "repeats"),
    (lambda: simulate(amplitude=np.inf), "amplitude"),
    (lambda: simulate(response_noise=-0.1), "white"),
    (lambda: simulate(excitation_snr_db=np.nan), "excitation_snr_db"),
    (lambda: simulate(excitation="decay", excitation_snr_db=20.0), "free decay"),
    (lambda: simulate("papre"), "sensor"),
    (
        lambda: simulate(("accelerometer", {"sensitivity": 1.0, "natural_frequency": 0.0, "damping_ratio": 0.1})),
        "natural_f",
    ),
    (
        lambda: simulate(("accelerometer", {"sensitivity": 1.0, "natural_frequency": 9.0, "damping_ratio": -0.1})),
        "damping",
    ),
    (
        lambda: simulate(
            ("accelerometer", {"sensitivity": 1.0, "natural_frequency": 100.0, "damping_ratio": 0.0}),
            frequencies_hz=[100.0],
        ),
        "undamped",
    ),
]


@pytest.mark.parametrize(("call", "problem"), REFUSED)
def test_refusals_say_what_where_and_what_to_do(call, problem):
    with pytest.raises(InputError) as caught:
        call()
    error = caught.value
    assert problem in error.problem
    assert all((error.expected, error.found, error.where, error.remedy))


def test_a_misspelt_sensor_names_the_nearest():
    with pytest.raises(InputError) as caught:
        simulate("seismometre")
    assert caught.value.remedy == "did you mean 'seismometer'?"


@pytest.mark.parametrize(
    "parameters",
    [{"sensitivity": 1.0}, {"sensitivity": 1.0, "natural_frequency": 9.0, "damping_ratio": 0.1, "delay": 0.0}],
)
def test_parameters_must_be_the_models(parameters):
    with pytest.raises(ModelError, match="not those of the model"):
        simulate(("accelerometer", parameters))
