"""What is stated about parameters: coverage factors, intervals, units, doubts; and when a model is refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import stdtr

import vibrident
from vibrident.data.records import Calibration, Record, ResponseTable
from vibrident.fit.problem import Coordinates
from vibrident.fit.response.verdict import probability
from vibrident.fit.uncertainty import correlation, curve, parameter_table, weakly_determined, with_reference
from vibrident.fit.uncertainty.adequacy import Points, assess, looks_random
from vibrident.fit.uncertainty.curve import frequencies
from vibrident.fit.uncertainty.parameters import coverage_factor, unit_fields
from vibrident.physics.models import parse
from vibrident.physics.simulation import simulate
from vibrident.result import Correlation

P = {"sensitivity": 0.104, "natural_frequency": 652.0, "damping_ratio": 0.182}
MODEL = parse("accelerometer")
UNITS = {"response": "V", "reference": "m/s^2", "reference_integrated": "m/s", "conversion": "V/m"}


def coordinates(p=None, name="accelerometer"):
    return Coordinates.at(parse(name), p or P, (10.0, 1000.0))


@pytest.mark.parametrize(
    ("freedom", "k"),
    [
        (1, 12.7062),
        (2, 4.3027),
        (5, 2.5706),
        (10, 2.2281),
        (30, 2.0423),
        (100, 1.9840),
        (1e6, 1.9600),
        (np.inf, 1.9600),
    ],
)
def test_coverage_factors_are_students(freedom, k):
    """GUM table G.2, 95 %."""
    assert coverage_factor(freedom) == pytest.approx(k, abs=6e-5)


def test_intervals_by_kind():
    """Gain: symmetric, sign kept. Natural frequency: symmetric in its logarithm. Damping: ends at zero. k = t(ν)."""
    p = {"sensitivity": -0.104, "natural_frequency": 652.0, "damping_ratio": 0.01}
    c = coordinates(p)
    covariance = np.diag([0.01, 0.02, 0.02]) ** 2
    table = parameter_table(c, c.first, covariance, 10, UNITS, {"damping_ratio": "x"})
    k = coverage_factor(10)
    gain, natural, damping = (table[n] for n in p)
    assert gain.value == -0.104
    assert gain.standard_uncertainty == pytest.approx(1.04e-3, rel=1e-12)
    assert gain.interval_95 == pytest.approx((-0.104 - k * 1.04e-3, -0.104 + k * 1.04e-3), rel=1e-12)
    assert natural.standard_uncertainty == pytest.approx(13.04, rel=1e-12)
    assert natural.interval_95 == pytest.approx((652 * np.exp(-0.02 * k), 652 * np.exp(0.02 * k)), rel=1e-12)
    assert damping.interval_95 == pytest.approx((0.0, 0.01 + 0.02 * k * np.hypot(1.0, 0.01)))  # sinh z
    assert (gain.identifiable, damping.identifiable) == (True, False)
    assert not table["resonance_frequency"].identifiable
    assert table["natural_angular_frequency"].identifiable
    assert [table[n].unit for n in p] == ["V/(m/s^2)", "Hz", "1"]
    assert table["conversion_coefficient"].unit == "V/m"
    assert table["conversion_coefficient"].derived
    assert not gain.derived


def test_derived_uncertainties_against_plain_monte_carlo(rng):
    """Correlated parameters at a few per mille: propagated u within 1 % of the scatter of 40 000 draws (SE 0.35 %)."""
    c = coordinates()
    root = np.array([[2e-3, 0, 0], [1e-3, 1e-3, 0], [-4e-4, 3e-4, 5e-4]])
    covariance = root @ root.T
    table = parameter_table(c, c.first, covariance, np.inf, UNITS, {})
    z = c.first + rng.standard_normal((40000, 3)) @ root.T
    drawn = (0.104 * z[:, 0], 652 * np.exp(z[:, 1]), np.sinh(z[:, 2]))
    values = dict(zip(("sensitivity", "natural_frequency", "damping_ratio"), drawn, strict=True))
    for quantity in MODEL.derived(P):
        scatter = np.std(quantity.value(values))
        assert table[quantity.name].standard_uncertainty == pytest.approx(scatter, rel=0.0105)
        assert table[quantity.name].value == pytest.approx(quantity.value(P), rel=1e-12)
        low, high = table[quantity.name].interval_95
        inside = np.mean((quantity.value(values) > low) & (quantity.value(values) < high))
        assert inside == pytest.approx(0.95, abs=3 * np.sqrt(0.95 * 0.05 / 40000) + 0.002)
    frequency = frequencies((10.0, 1000.0))[::20]
    band = curve(c, c.first, covariance, "acceleration", frequency)
    drawn = np.stack(
        [MODEL.frequency_response({k: v[i] for k, v in values.items()}, frequency) for i in range(0, 40000, 10)]
    )
    assert np.std(np.abs(drawn), axis=0) / band.magnitude_uncertainty == pytest.approx(
        np.ones(len(frequency)), abs=3 / np.sqrt(8000) + 0.005
    )
    assert np.rad2deg(np.std(np.angle(drawn), axis=0)) / band.phase_deg_uncertainty == pytest.approx(
        np.ones(len(frequency)), abs=3 / np.sqrt(8000) + 0.005
    )
    assert band.magnitude == pytest.approx(np.abs(MODEL.frequency_response(P, frequency)), rel=1e-12)


def test_the_references_own_uncertainty_is_a_common_factor_on_the_gain():
    c = coordinates()
    covariance = np.diag([1e-3, 2e-3, 3e-3]) ** 2
    z = np.array([1.2, 0.0, 0.182])
    with_it = with_reference(covariance, z, MODEL, 0.005)
    np.testing.assert_allclose(with_it - covariance, np.diag([(0.005 * 1.2) ** 2, 0, 0]), atol=1e-18)
    table = parameter_table(c, z, with_it, np.inf, UNITS, {})
    gain = table["sensitivity"]
    assert gain.standard_uncertainty / gain.value == pytest.approx(np.hypot(1e-3 / 1.2, 0.005), rel=1e-12)
    assert with_reference(covariance, z, MODEL, 0.0) is covariance


def test_correlation_has_ones_on_its_diagonal():
    root = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 0.0]])
    found = correlation(MODEL, root @ root.T)
    assert isinstance(found, Correlation)
    np.testing.assert_allclose(found.matrix, [[1, 0.6, 0], [0.6, 1, 0], [0, 0, 1]], atol=1e-15)


def test_units_follow_the_channels():
    record = Record("r", np.arange(10.0), np.arange(10.0), 1.0)
    assert unit_fields(Calibration((record,)))["reference"] == "m/s^2"
    drive = unit_fields(Calibration((record,), quantity="drive", reference_unit="A", response_unit="m"))
    assert drive == {
        "response": "m",
        "reference": "A",
        "reference_integrated": "A s",
        "conversion": "m/((A) s^2)",
    }


# What the data do not determine


def test_far_below_resonance_damping_and_resonance_are_weak():
    """Tones up to a twentieth of fn: the gain is known, fn and δ are not, and the result says so."""
    calibration = simulate(
        ("accelerometer", P), frequencies_hz=[5.0, 8.0, 12.0, 20.0, 32.0], sampling_rate_hz=2000.0, samples=2000,
        response_noise=0.01, start="steady", seed=3,
    )  # fmt: skip
    result = vibrident.identify(calibration)
    assert "weakly_determined" in result.warning_codes
    undetermined = {"natural_frequency", "damping_ratio", "natural_angular_frequency", "resonance_frequency"}
    assert not any(result.parameters[name].identifiable for name in undetermined & set(result.parameters))
    gain = result.parameters["sensitivity"]
    assert abs(gain.value - 0.104) < 4 * gain.standard_uncertainty
    assert gain.standard_uncertainty < 0.01 * 0.104


def test_doubts_name_the_partner():
    """A correlation of 0.9999 between two parameters known to 2 % each: they trade against each other."""
    c = coordinates()
    s = 0.02
    covariance = np.array(
        [[1e-8, 0, 0], [0, s**2, 0.9999 * s * s * 0.182], [0, 0.9999 * s * s * 0.182, (s * 0.182) ** 2]]
    )
    weak, warnings = weakly_determined(c, c.first, covariance)
    assert weak == {"natural_frequency": "damping_ratio", "damping_ratio": "natural_frequency"}
    assert [w.code for w in warnings] == ["weakly_determined"] * 2
    assert "trades against the damping ratio" in warnings[0].message
    assert weakly_determined(c, c.first, np.diag([1e-3, 1e-3, 1e-3]) ** 2) == ({}, [])
    weak, warnings = weakly_determined(c, c.first, np.diag([1e-3, 0.3, 1e-3]) ** 2)
    assert weak.keys() == {"natural_frequency"}
    assert "30 %" in warnings[0].message


def test_an_undamped_sensor_is_at_its_bound():
    """Data of δ = 0 with noise: δ within a few u of zero; where the fit ends at zero itself, at_bound."""
    frequency = np.geomspace(10, 500, 20)
    h = MODEL.frequency_response(P | {"damping_ratio": 0.0}, frequency)
    lead = np.angle(h) + 0.01 * frequency / 500  # a lead: damping would have to be negative
    table = ResponseTable(frequency, np.abs(h), lead, 0.002 * np.abs(h), np.full(20, 0.005))
    result = vibrident.identify(Calibration(table=table))
    assert result.parameters["damping_ratio"].value < 1e-4
    assert "at_bound" in result.warning_codes
    assert any("damping ratio" in w.message for w in result.warnings if w.code == "at_bound")


def test_the_search_range_is_a_bound():
    c = coordinates()
    covariance = np.diag([1e-3] * 3) ** 2
    _, warnings = weakly_determined(c, np.array([1.0, 50.0, 0.182]), covariance)
    assert [w.code for w in warnings] == ["at_bound"]
    assert "natural frequency" in warnings[0].message


# When a model is refused


def test_what_holds_for_a_frequency_at_its_bound_alone_is_named(rng):
    """A resonance far above the points: damping and length of the average are right, or named with the bound."""
    frequency, bounded = np.geomspace(0.5, 20.0, 30), 0
    for _ in range(6):
        p = {"sensitivity": 1.0, "natural_frequency": 20.0 * rng.uniform(15.0, 30.0), "damping_ratio": 0.012}
        p["boxcar_length"] = rng.uniform(0.3, 0.9) / 20.0
        h = parse("accelerometer+boxcar").frequency_response(p, frequency)
        u, turn = 4e-4 * rng.standard_normal((2, 30))
        table = ResponseTable(frequency, np.abs(h) * (1.0 + u), np.angle(h) + turn, 4e-4 * np.abs(h), np.full(30, 4e-4))
        result = vibrident.identify(Calibration(table=table, model="accelerometer+boxcar"))
        said = " ".join(w.message for w in result.warnings)
        bounded += "at_bound" in result.warning_codes
        for name, words in (("damping_ratio", "damping ratio"), ("boxcar_length", "boxcar length")):
            found = result.parameters[name]
            assert abs(found.value - p[name]) < 4.0 * (found.standard_uncertainty or np.inf) or words in said
    assert bounded >= 2


def points(rng, n, factor=1.0, freedom=np.inf):
    """Squared deviations of n complex points whose stated variances come from ``freedom`` degrees of freedom."""
    normal = factor * (rng.standard_normal(n) + 1j * rng.standard_normal(n))
    s2 = np.ones(n) if np.isinf(freedom) else rng.chisquare(freedom, n) / freedom
    ones = np.ones(n)
    return Points(ones, ones + 0j, 0.01 * ones, ("r",) * n, np.abs(normal) ** 2 / s2, np.full(n, min(freedom, 1e9)))


@pytest.mark.parametrize("freedom", [20.0, 50.0, np.inf])
def test_the_level_of_the_test(freedom, rng):
    """2000 right models of 20 points: refused at about 10⁻³ (at most 8 times: nominal 2), mean χ²/dof one."""
    verdicts = [assess([points(rng, 20, freedom=freedom)], 0) for _ in range(2000)]
    assert sum(not v.adequate for v in verdicts) <= 8
    chi2 = np.array([v.chi2_reduced for v in verdicts])
    assert chi2.mean() == pytest.approx(1.0, abs=3 * chi2.std() / np.sqrt(2000))


def test_the_power_of_the_test(rng):
    """Deviations twice as large as stated at 20 points are always found in 200 cases."""
    assert not any(assess([points(rng, 20, 2.0)], 3).adequate for _ in range(200))


def test_parts_are_joined(rng):
    joined = assess([points(rng, 5), points(rng, 7)], 3)
    assert joined.degrees_of_freedom == 2 * 12 - 3
    assert joined.frequency_hz.shape == joined.measured.shape == joined.relative_deviation.shape == (12,)


def test_the_chance_of_a_chi2():
    assert probability(0.0, 5) == 1.0
    assert probability(20.515, 5) == pytest.approx(1e-3, rel=1e-3)  # tables of χ²


def test_random_looks_random_and_a_pattern_does_not(rng):
    """White residuals are refused with probability Φ(−4) = 3e-5: none of 2000; a slow wave of the same size always."""
    assert all(looks_random(rng.standard_normal(40)) for _ in range(2000))
    wave = np.sqrt(2) * np.sin(np.linspace(0, 7, 40))
    slow = np.sqrt(2) * np.sin(np.linspace(0, 4, 24))  # of 24 points the neighbours' correlation alone does not tell
    assert not any(looks_random(slow + 0.25 * rng.standard_normal(24)) for _ in range(100))
    assert not any(looks_random(wave + 0.3 * rng.standard_normal(40)) for _ in range(100))
    assert stdtr(1e9, -4.0) < 1e-4


def calibration_of(response, noise=0.003, seed=0, n=12):
    """Sine records of a sensor with any frequency response, made in NumPy."""
    rng = np.random.default_rng(seed)
    records = []
    t = np.arange(2000) / 10e3
    for f in np.geomspace(20.0, 1500.0, n):
        h = response(np.array([f]))[0]
        turn = 5.0 * np.exp(2j * np.pi * f * t)
        y = (h * turn).real
        records.append(
            Record(f"{f:.0f} Hz", turn.real, y + noise * np.std(y) * rng.standard_normal(2000), 10e3, "sine")
        )
    return Calibration(tuple(records))


def second_mode(f):
    return MODEL.frequency_response(P, f) + 0.01 * MODEL.frequency_response(
        {"sensitivity": 0.104, "natural_frequency": 1100.0, "damping_ratio": 0.02}, f
    )


@pytest.mark.parametrize(
    ("response", "adequate"),
    [
        (lambda f: MODEL.frequency_response(P, f), True),
        (lambda f: MODEL.frequency_response(P, f) * np.exp(-2j * np.pi * f * 3e-6), False),
        (second_mode, False),
    ],
    ids=["right", "delay of 3 µs", "second mode of 1 %"],
)
@pytest.mark.quick("right", "second mode of 1 %")
def test_what_is_left_out_of_the_model_is_found(response, adequate):
    """A delay of 0.03 samples and a second mode of 1 % are refused; what is right is not."""
    result = vibrident.identify(calibration_of(response))
    assert result.fit.adequate is adequate
    assert ("lack_of_fit" in result.warning_codes) is not adequate
    if not adequate:
        message = next(w.message for w in result.warnings if w.code == "lack_of_fit")
        assert "χ²/dof" in message
        assert "Hz" in message


def test_the_delay_that_was_left_out_is_found_with_its_model():
    result = vibrident.identify(
        calibration_of(lambda f: MODEL.frequency_response(P, f) * np.exp(-2j * np.pi * f * 3e-6)),
        model="accelerometer+delay",
    )
    delay = result.parameters["delay"]
    assert result.fit.adequate
    assert abs(delay.value - 3e-6) < 4 * delay.standard_uncertainty
    assert delay.standard_uncertainty < 1e-6


def test_a_unit_has_brackets_only_where_they_are_needed():
    calibration = simulate(
        ("accelerometer", P), frequencies_hz=[100.0, 300.0, 600.0, 700.0, 900.0], samples=2000, seed=3
    )
    driven = replace(calibration, quantity="drive", reference_unit="V", response_unit="m")
    assert vibrident.identify(driven).parameters["sensitivity"].unit == "m/V"
    assert vibrident.identify(calibration).parameters["sensitivity"].unit == "V/(m/s^2)"
