import math

import numpy as np
import pytest
from tests.support.sample_results import calibration_mixed, calibration_records

from vibrident.base.amounts import pretty, scaled
from vibrident.show import curves, data_figures
from vibrident.show import numbers as units
from vibrident.show.curves import continuous
from vibrident.show.media import fonts


@pytest.mark.parametrize(
    ("unit", "size", "factor", "text"),
    [
        ("V/(m/s^2)", 0.104, 1e3, "mV/(m/s²)"),
        ("mV/(m/s^2)", 0.104, 1e3, "µV/(m/s²)"),
        ("mV/(m/s^2)", 4e4, 1e-3, "V/(m/s²)"),
        ("C/(m/s^2)", 1.2e-11, 1e12, "pC/(m/s²)"),
        ("V/(m/s)", 27.7, 1.0, "V/(m/s)"),
        ("V/m", 1.7e6, 1e-6, "MV/m"),
        ("s", 1.24e-5, 1e6, "µs"),
        ("s", 1200.0, 1.0, "s"),
        ("Hz", 0.475, 1.0, "Hz"),
        ("Hz", 4096.0, 1.0, "Hz"),
        ("Hz", 51200.0, 1e-3, "kHz"),
        ("rad/s", 4096.0, 1.0, "rad/s"),
        ("1/V^2", 1e-8, 1.0, "1/V²"),
        ("m^2", 1e-8, 1.0, "m²"),
        ("count", 1e9, 1.0, "count"),
        ("1", 0.182, 1.0, "1"),
        ("", 0.182, 1.0, "1"),
        ("V", 0.0, 1.0, "V"),
        ("V", math.nan, 1.0, "V"),
    ],
)
def test_prefixes(unit, size, factor, text):
    scale = scaled(unit, size)
    assert scale.unit == text
    assert scale.factor == pytest.approx(factor, rel=1e-12)


def test_pretty_keeps_parentheses():
    assert pretty("V/(m/s^2)") == "V/(m/s²)"
    assert pretty("V*s^(-2)") == "V·s⁻²"
    assert units.sensitivity_unit("V", "m/s^2") == "V/(m/s^2)"
    assert units.sensitivity_unit("V", "m") == "V/m"
    assert units.sensitivity_unit("count", "drive unit") == "count/(drive unit)"


def test_nominal_names_are_iso_266():
    exact = [10 ** (n / 10) for n in range(10, 21)]
    names = [units.nominal_frequency(f) for f in exact]
    assert names == ["10", "12.5", "16", "20", "25", "31.5", "40", "50", "63", "80", "100"]
    assert units.nominal_frequency(160.0) == "160"  # its value; the exact one is 158.49 Hz
    assert units.nominal_frequency(155.0) is None
    assert units.nominal_frequency(0.1) == "0.1"
    assert units.frequency_text(10**3.1) == "1250 Hz"
    assert units.frequency_text(160.0) == "160 Hz"


def test_spread_has_both_ends():
    assert curves.spread(3, 6) == [0, 1, 2]
    assert curves.spread(21, 6) == [0, 4, 8, 12, 16, 20]
    assert curves.spread(0, 6) == []


def test_excerpt_shows_what_is_left_out():
    records = calibration_records().records
    for record in records:
        part = data_figures.excerpt(record)
        shown = record.time_s[part]
        assert shown.size >= 8
        if not record.mask.all():
            assert not record.mask[part].all()
    assert data_figures.sine_frequency(records[2]) == pytest.approx(80.0, abs=5.0)


def test_excerpt_of_a_shock_is_the_shock():
    shock = calibration_mixed().records[0]
    part = data_figures.excerpt(shock)
    assert part.start <= np.argmax(shock.reference) < part.stop
    assert part.stop - part.start < shock.samples / 4


def test_envelope_keeps_the_peaks():
    rng = np.random.default_rng(0)
    time, values = np.arange(100_003.0), rng.normal(size=100_003)
    thin_time, thin = curves.envelope(time, values, bins=500)
    assert thin.size <= 2 * 500 + 500
    assert (thin.min(), thin.max()) == (values.min(), values.max())
    assert np.all(np.diff(thin_time) >= 0)


def test_continuous_phase_starts_in_the_principal_range():
    np.testing.assert_allclose(continuous(np.array([170.0, -170.0, -100.0])), [170.0, 190.0, 260.0])
    np.testing.assert_allclose(continuous(np.array([-180.0, 170.0])), [180.0, 170.0])
    np.testing.assert_allclose(continuous(np.array([np.nan, 350.0, 10.0])), [np.nan, -10.0, 10.0])


def test_unknown_characters_become_boxes():
    assert fonts.printable("Brüel\n µ²") == "Brüel µ²"
    assert fonts.printable("a\U000e0041b") == "a□b"
