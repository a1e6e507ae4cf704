"""Units as people write them: factor to SI and dimension; what is ambiguous names none."""

import pytest

from vibrident.data.io.units import factor_between, parse_unit, quantity_of

G = 9.80665  # CGPM 1901
INCH = 0.0254
#: Text, an SI unit of the same dimension, and the factor between them.
KNOWN = [
    ("g", "m/s^2", G), ("G", "m/s^2", G), ("mg", "m/s^2", G / 1e3), ("µg", "m/s^2", G / 1e6),
    ("g_n", "m/s^2", G), ("gravity", "m/s^2", G), ("m/s²", "m/s^2", 1.0), ("m/s2", "m/s^2", 1.0),
    ("m/s/s", "m/s^2", 1.0), ("m·s⁻²", "m/s^2", 1.0), ("m s-2", "m/s^2", 1.0), ("ms^-2", "m/s^2", 1.0),
    ("meter per second squared", "m/s^2", 1.0), ("M/S2", "m/s^2", 1.0), ("m/sec²", "m/s^2", 1.0),
    ("mm/s²", "m/s^2", 1e-3), ("Gal", "m/s^2", 1e-2), ("mGal", "m/s^2", 1e-5), ("in/s²", "m/s^2", INCH),
    ("ft/s^2", "m/s^2", 12 * INCH), ("米/秒²", "m/s^2", 1.0), ("м/с²", "m/s^2", 1.0),
    ("mm/s", "m/s", 1e-3), ("in/s", "m/s", INCH), ("inch/s", "m/s", INCH), ("ips", "m/s", INCH),
    ("MM/S", "m/s", 1e-3), ("µm/s", "m/s", 1e-6), ("km/h", "m/s", 1 / 3.6),
    ("µm", "m", 1e-6), ("um", "m", 1e-6), ("microns", "m", 1e-6), ("mils", "m", 1e-3 * INCH),
    ("nm", "m", 1e-9), ("inches", "m", INCH),
    ("Volt", "V", 1.0), ("volts", "V", 1.0), ("mV", "V", 1e-3), ("Millivolt", "V", 1e-3), ("µV", "V", 1e-6),
    ("pC", "C", 1e-12), ("nA", "A", 1e-9), ("LSB", "counts", 1.0), ("Counts", "counts", 1.0),
    ("second", "s", 1.0), ("ms", "s", 1e-3), ("毫秒", "s", 1e-3), ("мкс", "s", 1e-6), ("min", "s", 60.0),
    ("kHz", "Hz", 1e3), ("MHz", "Hz", 1e6), ("mHz", "Hz", 1e-3), ("KHZ", "Hz", 1e3), ("rpm", "Hz", 1 / 60),
    ("krad/s", "rad/s", 1e3), ("mV/g", "V/(m/s²)", 1e-3 / G), ("pC/(m/s^2)", "C/(m/s^2)", 1e-12),
    ("gₙ", "m/s^2", G), ("g₀", "m/s^2", G), ("m∕s²", "m/s^2", 1.0), ("mps²", "m/s^2", 1.0), ("mmps", "m/s", 1e-3),
    ("㎷", "V", 1e-3), ("mVolts", "V", 1e-3), ("Å", "m", 1e-10),
    ("V s²/m", "V/(m/s²)", 1.0), ("V/(mm/s)", "V/(m/s)", 1e3), ("V·s/m", "V/(m/s)", 1.0),
]  # fmt: skip


@pytest.mark.parametrize(("text", "si", "factor"), KNOWN)
def test_factor_and_dimension(text, si, factor):
    assert factor_between(text, si) == pytest.approx(factor, rel=1e-12)
    for wrapped in (f"[{text}]", f" ({text}) "):
        assert factor_between(wrapped, si) == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize("text", ["MV", "ch 2", "raw", "EU", "", "-", "n/a", "10 mV", "grad", "g rms", "right", "x/s"])
def test_no_guess_is_made(text):
    assert parse_unit(text) is None


@pytest.mark.parametrize("unit", ["m/s²", "mm/s", "µm", "V", "mV/g", "pC/(m/s²)", "rad/s"])
def test_a_unit_over_itself_is_one(unit):
    parsed = parse_unit(unit)
    assert parsed is not None
    quotient = parsed.over(parsed)
    assert (quotient.factor, quotient.dimension) == (1.0, ())
    assert parsed.over(parsed).times(parsed).dimension == parsed.dimension


def test_quantity_of_a_unit():
    assert [quantity_of(unit) for unit in ("g", "in/s", "nm", "V", "?")] == [
        *("acceleration", "velocity", "displacement", None, None),
    ]
