"""Free decays alone: natural frequency and damping ratio at the Cramér–Rao bound, whatever stands around the motion.

The truth is integrated by the matrix exponential of the oscillator's own state space, sample by sample, which shares
nothing with the closed forms that are fitted.
"""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench.adversary.cases import BY_NAME
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.special import chdtri
from tests.support.real_data import real_data

import vibrident
from vibrident import Calibration, InputError, KnownResponse, Record
from vibrident.base.errors import ModelError
from vibrident.data.known import DigitalFilter
from vibrident.fit.decay.examine import examine

RATE = 2000.0


def swing(natural_hz, damping, samples, *, output=0, before=0.0, rate=RATE, stiffening=0.0):
    """Response after a release: displacement (output 0) or velocity (1); ``before`` samples of rest, held aside."""
    wn = 2 * np.pi * natural_hz
    parts = 1 if stiffening == 0.0 else 20
    step = functools.cache(lambda w, time: expm(np.array([[0.0, 1.0], [-w * w, -2 * damping * wn]]) * time))
    state, series = np.array([1.0, 0.0]), []
    late = int(np.ceil(before))
    series += [state[output]] * late
    for count in range(late, samples):
        time = (late - before) / rate if count == late else 1.0 / rate
        for _ in range(parts):
            w = wn * np.sqrt(1.0 + stiffening * (state[0] ** 2 + (state[1] / wn) ** 2))
            state = step(w, time / parts) @ state
        series.append(state[output] / (wn if output else 1.0))
    return np.array(series)


def decays(*series, rate=RATE, model="accelerometer"):
    records = tuple(Record(f"d{i}", None, one, rate, excitation="decay") for i, one in enumerate(series))
    return Calibration(records=records, model=model)


def information(natural_hz, damping, samples, sigma, output):
    """Fisher information about (ln fn, δ), with initial state and offset eliminated, by plain differences.

    Without the first sample, which the fit leaves out because the release may lie within it.
    """

    def motion(log_shift, damping_shift, start):
        wn = 2 * np.pi * natural_hz * np.exp(log_shift)
        a = np.array([[0.0, 1.0], [-wn * wn, -2 * (damping + damping_shift) * wn]])
        step, states = expm(a / RATE), [np.array(start)]
        for _ in range(samples - 1):
            states.append(step @ states[-1])
        return np.array(states)[:, output] / (2 * np.pi * natural_hz if output else 1.0)

    h, wn = 1e-5, 2 * np.pi * natural_hz
    columns = [(motion(h, 0, [1, 0]) - motion(-h, 0, [1, 0])) / (2 * h)]
    columns += [(motion(0, h, [1, 0]) - motion(0, -h, [1, 0])) / (2 * h)]
    beside = np.stack([motion(0, 0, [1, 0]), motion(0, 0, [0, wn]), np.ones(samples)], axis=1)[1:]
    q, _ = np.linalg.qr(beside)
    slopes = np.stack(columns, axis=1)[1:]
    slopes -= q @ (q.T @ slopes)
    return slopes.T @ slopes / sigma**2


CASES = [  # natural frequency, damping ratio, samples, output
    (50.0, 0.003, 1500, 0),
    (50.0, 0.2, 600, 1),
    (20.0, 0.7, 600, 0),
    (20.0, 2.5, 1500, 1),
]


@pytest.mark.draws(3, 6)
@pytest.mark.parametrize(("natural_hz", "damping", "samples", "output"), CASES)
def test_at_the_cramer_rao_bound_and_covered(natural_hz, damping, samples, output, draws):
    model = ("accelerometer", "velocity-pickup")[output]
    clean = swing(natural_hz, damping, samples, output=output)
    sigma = 1e-3 * np.max(np.abs(clean))
    bound = np.sqrt(np.diag(np.linalg.inv(information(natural_hz, damping, samples, sigma, output))))
    off, over = [], []
    for seed in range(draws):
        noise = sigma * np.random.default_rng(seed).normal(size=samples)
        result = vibrident.identify(decays(clean + noise + 0.3, model=model))
        frequency, ratio = (result.parameters[n] for n in ("natural_frequency", "damping_ratio"))
        stated = np.array([frequency.standard_uncertainty / frequency.value, ratio.standard_uncertainty])
        assert np.all(stated > 0.9 * bound)
        over.append(stated / bound)
        off.append([np.log(frequency.value / natural_hz) / stated[0], (ratio.value - damping) / stated[1]])
        assert result.fit.adequate
        assert set(result.warning_codes) == set()
    assert np.all(np.median(over, axis=0) < 1.1)
    assert np.sum(np.square(off)) < chdtri(2 * draws, 2e-3)
    assert np.max(np.abs(off)) < 4.0


@pytest.mark.draws(1, 3)
def test_rest_before_the_release_does_no_harm(draws):
    for damping, output in ((0.02, 0), (0.3, 1), (0.7, 0)):
        clean = swing(50.0, damping, 800, output=output, before=170.4)
        for seed in range(draws):
            noise = 1e-3 * np.random.default_rng(seed).normal(size=800)
            result = vibrident.identify(decays(clean + noise))
            for name, truth in (("natural_frequency", 50.0), ("damping_ratio", damping)):
                p = result.parameters[name]
                assert abs(p.value - truth) < 4.0 * p.standard_uncertainty
            assert result.fit.adequate
            assert 170 <= result.settings["decays"][0]["begins_s"] * RATE < 190


def test_several_decays_of_different_rates_share_one_oscillator():
    rng = np.random.default_rng(5)
    quick = Record("quick", None, swing(50.0, 0.05, 800) + 1e-3 * rng.normal(size=800), RATE, "decay")
    slow = swing(50.0, 0.05, 500, rate=700.0) + 5e-3 * rng.normal(size=500) - 4.0
    both = Calibration(records=(quick, Record("slow", None, slow, 700.0, "decay")))
    alone = vibrident.identify(Calibration(records=(quick,))).parameters
    together = vibrident.identify(both).parameters
    for name, truth in (("natural_frequency", 50.0), ("damping_ratio", 0.05)):
        assert together[name].standard_uncertainty < alone[name].standard_uncertainty
        assert abs(together[name].value - truth) < 4.0 * together[name].standard_uncertainty


def test_drift_and_hum_beside_a_decay():
    rng, n = np.random.default_rng(6), 1200
    k = np.arange(n)
    beside = 0.05 * k / n + 0.02 * np.cos(2 * np.pi * 0.1137 * k) + 1e-3 * rng.normal(size=n)
    result = vibrident.identify(decays(swing(50.0, 0.05, n) + beside))
    for name, truth in (("natural_frequency", 50.0), ("damping_ratio", 0.05)):
        p = result.parameters[name]
        assert abs(p.value - truth) < 4.0 * p.standard_uncertainty
    assert result.fit.adequate
    assert result.warning_codes == ("drift",)
    assert result.settings["decays"][0]["tones_hz"][0] == pytest.approx(0.1137 * RATE, rel=1e-4)


@pytest.mark.parametrize("bits", [8, 12])
def test_a_coarse_recorder_is_no_misfit(bits):
    """At rest it shows a constant, which is no noise to weigh by."""
    clean = swing(50.0, 0.05, 1500)
    step = 2.0 / 2**bits
    result = vibrident.identify(decays(step * np.round(clean / step)))
    assert result.fit.adequate
    assert result.warnings == ()
    for name, truth in (("natural_frequency", 50.0), ("damping_ratio", 0.05)):
        p = result.parameters[name]
        assert abs(p.value - truth) < 4.0 * p.standard_uncertainty


def test_a_spring_that_stiffens_is_named_with_its_change():
    series = swing(50.0, 0.01, 600, stiffening=0.02) + 1e-4 * np.random.default_rng(7).normal(size=600)
    result = vibrident.identify(decays(series))
    assert not result.fit.adequate
    assert "nonlinear" in result.warning_codes
    text = next(w.message for w in result.warnings if w.code == "nonlinear")
    assert "natural frequency" in text
    assert "at the beginning" in text


def growing(growth, damping, samples=2000):
    """A decay from one whose damping grows by this part of it to the first swing, without noise."""
    time, angular = np.arange(samples) / RATE, 2.0 * np.pi * 0.1 * RATE

    def slope(_, state):
        grown = damping * (1.0 + growth * state[0] ** 2)
        return [state[1], -angular * (angular * state[0] + 2.0 * grown * state[1])]

    return solve_ivp(slope, (0.0, time[-1]), [1.0, 0.0], "DOP853", time, rtol=1e-7, atol=1e-9).y[0]


@pytest.mark.draws(2, 20)
def test_a_damping_that_grows_with_the_amplitude_is_named(rng, draws):
    """A tenth to as much again at the first swing, under noise; the same without growth is not named."""
    for growth, damping, noise in ((1.0, 0.013, 1e-3), (0.1, 0.04, 1e-3), (1.0, 0.02, 1e-2)):
        series = growing(growth, damping)
        assert examine(decays(series + noise * rng.standard_normal(series.size)).records).changes, (growth, damping)
    for damping in (0.01, 0.1):
        clean = growing(0.0, damping)
        for noise in ([1e-3, 1e-2] * 10)[:draws]:
            assert not examine(decays(clean + noise * rng.standard_normal(clean.size)).records).changes


@pytest.mark.draws(1, 8)
def test_several_decays_show_together_what_few_show_alone(rng, draws):
    """Damping that grows by 9 % to the first swing; without growth nothing is named."""
    for growth, named, times in ((0.09, True, 1), (0.0, False, draws)):
        series = growing(growth, 0.04)
        for _ in range(times):
            four = [size * series + 1e-3 * rng.standard_normal(series.size) for size in (1.0, 0.9, 0.8, 0.7)]
            assert bool(examine(decays(*four).records).changes) == named


def test_what_follows_from_two_parameters_and_nothing_else():
    noise = 1e-3 * np.random.default_rng(1).normal(size=600)
    result = vibrident.identify(decays(swing(50.0, 0.2, 600) + noise))
    assert set(result.parameters) == {
        "natural_frequency",
        "damping_ratio",
        "natural_angular_frequency",
        "resonance_frequency",
    }
    value, ratio = result.parameters["natural_frequency"].value, result.parameters["damping_ratio"].value
    assert result.parameters["resonance_frequency"].value == pytest.approx(value * np.sqrt(1 - 2 * ratio**2))
    assert result.correlation.names == ("natural_frequency", "damping_ratio")
    assert not result.has_gain
    again = vibrident.Result.from_dict(result.to_dict())
    assert again.to_dict() == result.to_dict()
    with pytest.raises(InputError, match="no gain"):
        vibrident.correct(result, decays(noise).records)
    with pytest.raises(InputError, match="no gain"):
        vibrident.predict(result, decays(noise))


def test_scale_and_rate_change_nothing():
    series = swing(50.0, 0.2, 600) + 1e-3 * np.random.default_rng(2).normal(size=600)
    plain = vibrident.identify(decays(series)).parameters
    scaled = vibrident.identify(decays(-1e9 * series, rate=1e6 * RATE)).parameters
    assert scaled["natural_frequency"].value == pytest.approx(1e6 * plain["natural_frequency"].value, rel=1e-6)
    assert scaled["damping_ratio"].value == pytest.approx(plain["damping_ratio"].value, rel=1e-6)
    u = [p["damping_ratio"].standard_uncertainty for p in (plain, scaled)]
    assert u[1] == pytest.approx(u[0], rel=1e-4)


def test_a_clock_s_uncertainty_enters_the_frequency():
    from vibrident.data.records import SystematicEffect

    series = swing(50.0, 0.2, 600) + 1e-4 * np.random.default_rng(3).normal(size=600)
    effects = (SystematicEffect("clock of the recorder", "clock", 0.01),)
    calibration = Calibration(records=decays(series).records, effects=effects)
    p = vibrident.identify(calibration).parameters
    assert p["natural_frequency"].standard_uncertainty == pytest.approx(0.01 * 50.0, rel=0.05)
    assert p["damping_ratio"].standard_uncertainty < 1e-3


def test_what_decays_alone_cannot_tell_is_refused_with_a_way_out():
    calibration = decays(swing(50.0, 0.2, 600))
    with pytest.raises(InputError, match="one natural frequency"):
        vibrident.identify(calibration, model="accelerometer+highpass")
    with pytest.raises(ModelError, match="with a reference"):
        vibrident.identify(calibration, estimator="ipnn")


@pytest.mark.slow
def test_the_real_seismometer_softens_with_amplitude():
    data = np.genfromtxt(
        Path(real_data("sm3")) / "SM3_SN001_freeperiod.csv", delimiter=",", skip_header=1, usecols=range(6)
    )
    result = vibrident.identify(decays(data[:, 4], rate=130.2083))
    p = result.parameters["natural_frequency"]
    assert p.value == pytest.approx(0.479, abs=0.003)
    assert p.standard_uncertainty > 1e-4, "noise alone would claim 3e-5"
    text = next(w.message for w in result.warnings if w.code == "nonlinear")
    assert "+1" in text, text


def test_the_real_coil_over_critical_pulses():
    data = np.genfromtxt(
        Path(real_data("sm3")) / "SM3SN001_damping.csv", delimiter=",", skip_header=1, usecols=range(6)
    )
    result = vibrident.identify(decays(data[3200:, 3], rate=130.2083, model="velocity-pickup"))
    assert result.parameters["natural_frequency"].value == pytest.approx(0.476, abs=0.02)
    assert result.parameters["damping_ratio"].value == pytest.approx(0.7145, abs=0.03)


def test_noise_of_1_over_f_is_no_drift():
    """Of 0.5 % of the motion: a line may be fitted along, but nothing is said."""
    trial = BY_NAME["decay/alone 4/in-sharp/1/f 0.5 %"].trial()
    assert vibrident.identify(trial.calibration(), model=trial.model).warnings == ()


#: Channels by which a decay is recorded; each adds free motion of its own.
CHANNELS = {
    "slow corner": KnownResponse.from_corners([8.0], [300.0], 10.0),
    "two equal corners": KnownResponse.from_corners([3.0, 3.0]),
    "resonance": KnownResponse.from_poles(np.roots([1.0, 60.0, (2 * np.pi * 90.0) ** 2]), [0.0]),
    "digital filter": KnownResponse.from_filter([0.1, 0.1], [1.0, -1.5, 0.7], rate_hz=RATE),
}


def recorded(channel, natural_hz, damping, samples, rng):
    """A release after rest, integrated by a fine step through the channel's own state space; 1e-4 of noise."""
    from scipy.signal import StateSpace, lfilter, lfiltic, lsim, zpk2ss

    (shape,) = channel.shapes
    fine = 1 if isinstance(shape, DigitalFilter) else 16
    series = swing(natural_hz, damping, fine * samples, before=fine * 50.0, rate=fine * RATE)
    if fine == 1:
        held = lfiltic(shape.numerator, shape.denominator, [series[0] * shape.at(0.0).real] * 3, [series[0]] * 3)
        seen = lfilter(shape.numerator, shape.denominator, series, zi=held)[0]
    else:
        system = StateSpace(*zpk2ss(shape.zeros, shape.poles, shape.gain))
        rest = np.linalg.solve(system.A, -system.B[:, 0] * series[0])
        times = np.arange(series.size) / (fine * RATE)
        seen = lsim(system, series, times, X0=rest)[1][::fine]
    return seen + 1e-4 * np.std(seen) * rng.standard_normal(seen.size)


@pytest.mark.parametrize("name", CHANNELS)
def test_a_known_channel_adds_only_free_motion_of_its_own(name, rng):
    series = recorded(CHANNELS[name], 40.0, 0.05, 1500, rng)
    known = replace(decays(series), response_known_response=CHANNELS[name])
    result = vibrident.identify(known)
    assert result.fit.adequate
    for key, truth in (("natural_frequency", 40.0), ("damping_ratio", 0.05)):
        parameter = result.parameters[key]
        assert parameter.value == pytest.approx(truth, abs=4.0 * parameter.standard_uncertainty)
        assert parameter.standard_uncertainty < 1e-3 * truth
    assert result.settings["known_responses"][0]["channel"] == "response"


def test_a_channel_that_is_known_as_a_table_is_refused_for_decays():
    table = KnownResponse.from_table([1.0, 500.0], [1.0, 1.0], [0.0, 0.0])
    with pytest.raises(InputError, match="A table of the channel's response does not tell how a free decay passes it"):
        vibrident.identify(replace(decays(swing(40.0, 0.05, 900)), response_known_response=table))


@pytest.mark.parametrize("hum", [0.0, 0.3])
@pytest.mark.parametrize("rise", [0.0, 1.0])
def test_what_dies_away_is_found_beside_a_line_and_a_tone(hum, rise, rng):
    """The line was fitted as a slow motion, and the tone as the decay: 1,000 and 5 million u off."""
    natural, damping, samples = 150.0, 0.004, 4000
    time = np.arange(samples) / RATE
    response = swing(natural, damping, samples) + rise * time + hum * np.cos(2 * np.pi * 20.0 * time)
    result = vibrident.identify(decays(response + 1e-3 * rng.standard_normal(samples)))
    for name, true in (("natural_frequency", natural), ("damping_ratio", damping)):
        stated = result.parameters[name]
        assert abs(stated.value - true) < 4.0 * stated.standard_uncertainty
        assert stated.standard_uncertainty < 1e-2 * true
    assert result.warning_codes == (("drift",) if rise else ())
