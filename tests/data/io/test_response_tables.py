"""Response tables: what the file states is applied; a contradiction is refused; nothing is a silent factor."""

import contextlib
import math

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import vibrident
from vibrident.base.errors import InputError
from vibrident.data.io import read
from vibrident.data.io.calibration_file import read_calibration_file
from vibrident.data.io.columns import Channel, ColumnFile
from vibrident.data.io.formats.csv import CsvFile
from vibrident.data.io.guess import guess_columns
from vibrident.data.io.table_file import read_table, table_response_unit
from vibrident.data.io.units import split_unit

G = 9.80665
F = np.geomspace(12.0, 900.0, 23)
COLUMNS = {
    "m": "frequency = 1\nmagnitude = 2\n",
    "mp": "frequency = 1\nmagnitude = 2\nphase = 3\n",
    "mpuu": "frequency = 1\nmagnitude = 2\nphase = 3\nmagnitude_uncertainty = 4\nphase_uncertainty = 5\n",
    "ri": "frequency = 1\nreal = 2\nimaginary = 3\n",
}


def write(folder, header, rows, keys, sections="", delimiter=";"):
    lines = [header, *(delimiter.join(repr(float(value)) for value in row) for row in rows)]
    (folder / "t.csv").write_text("\n".join(lines) + "\n")
    (folder / "c.toml").write_text(f'{sections}[table]\nfile = "t.csv"\n{COLUMNS.get(keys, keys)}')
    return folder / "c.toml"


def first(folder, header, row, keys, sections=""):
    """Return the table of one row, twice."""
    return read(write(folder, header, [row, row], keys, sections)).table


#: As written → response unit per SI unit of the reference, for volts per acceleration; derived by hand.
SENSITIVITIES = {
    "V/(m/s²)": 1.0, "mV/g": 1e-3 / G, "mV/(m/s^2)": 1e-3, "mV/ms⁻²": 1e-3, "V·s²/m": 1.0, "V s^2/m": 1.0,
    "µV/(mm/s²)": 1e-3, "mV": 1e-3, "V per g": 1 / G, "mV/gn": 1e-3 / G, "V/(m·s⁻²)": 1.0, "mV.s2/m": 1e-3,
    "kV/(km/s²)": 1.0, "Volt/g": 1 / G,
}  # fmt: skip
LEVELS = {
    "dB": 1.0, "dB re 1 V/(m/s²)": 1.0, "dBV/(m/s²)": 1.0, "dB ref 1 mV/g": 1e-3 / G, "dB re. 10 µV/(m/s²)": 1e-5,
    "dB (re 1 mV/(m/s²))": 1e-3, "dBmV/g": 1e-3 / G,
}  # fmt: skip
FREQUENCIES = {
    "f": 1.0, "f [Hz]": 1.0, "Frequency (kHz)": 1e3, "freq_MHz": 1e6, "omega": 0.5 / math.pi, "ω": 0.5 / math.pi,
    "w": 0.5 / math.pi, "ω (rad/s)": 0.5 / math.pi, "omega in krad/s": 500 / math.pi, "n / rpm": 1 / 60, "f/kHz": 1e3,
    "omega (1/s)": 0.5 / math.pi, "w_rad_s": 0.5 / math.pi, "f (mHz)": 1e-3, "kHz": 1e3, "f (deg/s)": 1 / 360,
}  # fmt: skip
PHASES = {
    "phi": 180 / math.pi, "phi [deg]": 180 / math.pi, "phi (°)": 180 / math.pi, "Phase (Grad)": 180 / math.pi,
    "phi_rad": 1.0, "phi in rad": 1.0, "phi [mrad]": 1e3, "phi / gon": 200 / math.pi,
}  # fmt: skip
PLACES = ("S [{}]", "S ({})", "S in {}", "S / ({})", "|S| [{}]")


@st.composite
def representations(draw):
    """Draw a response, its values as a table has them, header and keys."""
    sensitivity = draw(st.floats(1e-4, 10.0)) * draw(st.sampled_from([1, -1]))
    resonance, damping = draw(st.floats(50.0, 2000.0)), draw(st.floats(0.005, 0.9))
    ratio = F / resonance
    response = sensitivity / (1 - ratio**2 + 2j * damping * ratio)
    frequency = draw(st.sampled_from(sorted(FREQUENCIES)))
    place, gain = draw(st.sampled_from(PLACES)), draw(st.sampled_from([1.0, 0.125, 7.0]))
    way = draw(st.sampled_from(["linear", "level", "parts", "complex"]))
    axis, stored = F / FREQUENCIES[frequency], response / gain
    unit = draw(st.sampled_from(sorted(LEVELS if way == "level" else SENSITIVITIES)))
    head = place.format(unit)
    if way == "complex":
        return response, frequency, (F, stored.real, stored.imag), "complex", gain, ";"
    if way == "parts":
        part = stored / SENSITIVITIES[unit]
        header, columns, keys = (frequency, head, head.replace("S", "T")), (axis, part.real, part.imag), "ri"
    else:
        size = abs(stored) / (LEVELS if way == "level" else SENSITIVITIES)[unit]
        size = 20 * np.log10(size) if way == "level" else size
        phase = draw(st.sampled_from(sorted(PHASES)))
        angle = np.angle(stored)
        turns = draw(st.sampled_from(["wrapped", "unwrapped", "jumps"]))
        angle = np.unwrap(angle) if turns == "unwrapped" else angle
        angle = angle + 2 * np.pi * (np.arange(F.size) % 5 - 2) if turns == "jumps" else angle
        header, columns, keys = (frequency, head, phase), (axis, size, angle * PHASES[phase]), "mp"
    delimiter = draw(st.sampled_from([";", "\t", ","]))
    return response, delimiter.join(header), columns, keys, gain, delimiter


@given(representations())
def test_a_response_is_the_same_however_it_is_written(tmp_path_factory, drawn):
    response, header, columns, keys, gain, delimiter = drawn
    folder = tmp_path_factory.mktemp("t")
    sections = f"[response]\nscale = {gain!r}\n"
    if keys == "complex":
        with h5py.File(folder / "t.h5", "w") as file:
            for name, values in zip(("frequency", "real", "imag"), columns, strict=True):
                file[f"H.{name}"] = values
        path = folder / "c.toml"
        path.write_text(f'{sections}[table]\nfile = "t.h5"\ncomplex = "H"\n')
    else:
        path = write(folder, header, zip(*columns, strict=True), keys, sections, delimiter)
    table = read(path).table
    np.testing.assert_allclose(table.frequency_hz, F, rtol=1e-9)
    np.testing.assert_allclose(table.magnitude * np.exp(1j * table.phase_rad), response, rtol=1e-9)


@pytest.mark.parametrize("turns", ["unwrapped", "jumps"])
def test_turns_of_the_phase_change_no_result(tmp_path, turns):
    ratio = F / 310.0
    response = 0.01 / (1 - ratio**2 + 0.1j * ratio) * np.exp(-2j * np.pi * F * 4e-3)
    angle = np.angle(response)
    other = np.unwrap(angle) if turns == "unwrapped" else angle + 2 * np.pi * (np.arange(F.size) % 3)
    results = []
    for phase in (angle, other):
        path = write(tmp_path, "f;S;phi [deg]", zip(F, abs(response), np.rad2deg(phase), strict=True), "mp")
        results.append(vibrident.identify(path, "accelerometer+delay"))
    for name, parameter in results[0].parameters.items():
        assert results[1].parameters[name].value == pytest.approx(parameter.value, rel=1e-6)


class StatedFile(ColumnFile):
    """Three columns of a format that states units in fields of their own."""

    def __init__(self, path, units, names=("f", "S", "phi")):
        super().__init__(path, [Channel(n, unit=u) for n, u in zip(names, units, strict=True)], {})

    def load(self, positions):
        return tuple(np.array([[10.0, 20.0], [2.0, 3.0], [4.0, 5.0]][position]) for position in positions)


@pytest.mark.parametrize("where", ["field", "name"])
@pytest.mark.parametrize(
    ("unit", "stated", "result"),
    [
        ("", "", 2.0),
        ("-", "", 2.0),
        ("mV/g", "", 2e-3 / G),
        ("mV/g", '[response]\nunit = "V"\n', 2e-3 / G),
        ("mV/g", '[response]\nunit = "mV"\n', 2 / G),
        ("mV/g", "[response]\nscale = 0.5\n", 1e-3 / G),
        ("mV/g", f"[response]\nscale = {1e-3 / G}\n", "remove scale under [response]"),
        ("mV/g", "[response]\nscale = 0.001\n", "remove scale under [response]"),
        ("mV/g", "[reference]\nscale = 9.81\n", "remove scale under [reference]"),
        ("V/(m/s^2)", "[reference]\nscale = 9.81\n", "remove scale under [reference]"),
        ("mV", "[reference]\nscale = 9.80665\n", 2e-3 / G),
        ("mV/g", '[response]\nunit = "pC"\n', 'set unit = "V"'),
        ("mV/g", '[response]\nunit = "pC"\nscale = 3.0\n', 6e-3 / G),
        ("mV/g", '[reference]\nquantity = "velocity"\n', 'quantity = "acceleration"'),
        ("V/(mm/s)", '[reference]\nquantity = "velocity"\n', 2e3),
        ("mm/V", '[reference]\nquantity = "drive"\nunit = "V"\n[response]\nunit = "m"\n', 2e-3),
        ("V/(m/s)", "", 'quantity = "velocity"'),
        ("V/m/s^2", "", "V/(m/s²)"),
        ("Hz", "", "V/(m/s²)"),
        ("g", "", "g/g"),
        ("dB re 1 mV/g", "", 10**0.1 * 1e-3 / G),
        ("dB re max", "", "dB re 1 V/(m/s²)"),
        ("dBm", "", "dB re 1 V/(m/s²)"),
        ("%", "", "not relative"),
        ("10^-3 V/g", "", "multiply the column by it"),
        ("mV/g rms", "", "such as mV/g"),
    ],
)
def test_the_unit_of_a_magnitude(tmp_path, monkeypatch, where, unit, stated, result):
    name = f"S [{unit}]" if unit and where == "name" else "S"
    path = write(tmp_path, f"f;{name}", [(10.0, 2.0)], "m", stated)
    if where == "field":
        fake = StatedFile(tmp_path / "t.csv", ("Hz", unit, ""))
        monkeypatch.setattr("vibrident.data.io.table_file.open_columns", lambda _: fake)
    calibration = read_calibration_file(path)
    if isinstance(result, float):
        assert read_table(calibration, tmp_path, "c.toml").magnitude[0] == pytest.approx(result, rel=1e-12)
        return
    with pytest.raises(InputError) as caught:
        read_table(calibration, tmp_path, "c.toml")
    assert result in caught.value.remedy


@given(
    st.sampled_from(sorted(SENSITIVITIES)),
    st.sampled_from([("", 1.0), ("V", 1.0), ("mV", 1e-3), ("µV", 1e-6)]),
    st.sampled_from([1.0, 1e-3, 1 / G, 1e-3 / G, 0.25]),
    st.sampled_from([1.0, G, 9.81, 1e-3, 4.0]),
)
def test_a_factor_is_applied_once_or_the_scale_refused(tmp_path_factory, unit, stated, scale, per):
    folder = tmp_path_factory.mktemp("t")
    name, volts = stated
    response = f"[response]\nscale = {scale!r}\n" + (f'unit = "{name}"\n' if name else "")
    path = write(folder, f"f;S [{unit}]", [(1.0, 2.0)], "m", f"{response}[reference]\nscale = {per!r}\n")
    factor = SENSITIVITIES[unit] / volts
    converts = any(math.isclose(s, factor, rel_tol=1e-3) for s in (scale, scale / per) if s != 1.0)
    calibration = read_calibration_file(path)
    if converts:
        with pytest.raises(InputError, match="contradicts") as caught:
            read_table(calibration, folder, "")
        assert "remove scale" in caught.value.remedy
        return
    with contextlib.suppress(InputError):  # a part of the factor may be refused, too
        value = read_table(calibration, folder, "").magnitude[0]
        assert value == pytest.approx(2 * factor * scale / per, rel=1e-12)


def test_a_row_of_units_is_as_good(tmp_path):
    path = write(tmp_path, "f;S\nkHz;mV/g", [(10.0, 2.0)] * 4, "m")
    table = read(path).table
    assert (table.frequency_hz[0], table.magnitude[0]) == (1e4, pytest.approx(2e-3 / G))


@pytest.mark.parametrize(
    ("unit", "response"),
    [
        ("mV/g", "V"),
        ("pC/(m/s²)", "pC"),
        ("pC/ms⁻²", "pC"),
        ("V·s²/m", "V"),
        ("nC·s²/m", "C"),
        ("mA/(mm/s)", "mA"),
        ("counts/g", "counts"),
        ("(m/s²)/(m/s²)", "m/s²"),
        ("g/g", "g"),
        ("mV/V", "V"),
        ("dB re 1 pC/g", "pC"),
        ("dB", "V"),
        ("%", "V"),
        ("ch 2", "V"),
    ],
)
def test_the_unit_of_the_response_is_that_of_the_file(tmp_path, unit, response):
    path = write(tmp_path, f"f;S [{unit}]", [(1.0, 2.0)], "m")
    source = CsvFile(tmp_path / "t.csv")
    assert table_response_unit(read_calibration_file(path), source) == response
    path.write_text("[response]\nscale = 0.5\n" + path.read_text())
    assert table_response_unit(read_calibration_file(path), source) == "V"


@pytest.mark.parametrize("unit", ["pC/(m/s²)", "counts/(m/s²)", "V/(m/s²)"])
def test_a_calibration_has_the_unit_of_its_table(tmp_path, unit):
    path = write(tmp_path, f"f;S [{unit}];phi", [(1.0, 2.0, 3.0)], "mp")
    assert read(path).response_unit == unit.partition("/")[0]


@pytest.mark.parametrize(
    ("unit", "quantity", "response"),
    [
        ("mV/g", "acceleration", "V"),
        ("V/(mm/s)", "velocity", "V"),
        ("pC/(m/s²)", "acceleration", "pC"),
        ("dB re 1 mV/µm", "displacement", "V"),
        ("dB", "acceleration", "V"),
        ("mV/g rms", "acceleration", "V"),
    ],
)
def test_what_a_person_is_offered_is_the_units_meaning(tmp_path, unit, quantity, response):
    write(tmp_path, f"f;magnitude ({unit});phase", [(1.0, 2.0, 3.0)], "mp")
    guess = guess_columns(tmp_path / "t.csv")
    assert guess.is_table
    assert guess.document["reference"]["quantity"] == quantity
    assert guess.document["response"]["unit"] == response


def test_the_unit_of_the_reference_says_what_a_bare_response_is_per(tmp_path):
    path = write(tmp_path, "f;S", [(1.0, 2.0)], "m", '[reference]\nunit = "g"\n')
    assert read_table(read_calibration_file(path), tmp_path, "").magnitude[0] == pytest.approx(2 / G)
    path = write(tmp_path, "f;S [V/(m/s²)]", [(1.0, 2.0)], "m", '[reference]\nunit = "g"\n')
    with pytest.raises(InputError, match="contradicts"):
        read_table(read_calibration_file(path), tmp_path, "")


@pytest.mark.parametrize("name", ["f (V)", "f (samples)", "f [bins]", "T (s)", "f (mhz)", "freq_mhz", "f (10^3 Hz)"])
def test_a_frequency_in_another_unit_is_refused(tmp_path, name):
    with pytest.raises(InputError, match="contradicts"):
        first(tmp_path, f"{name};S", (10, 2), "m")


@pytest.mark.parametrize(
    ("name", "stated", "result"),
    [
        ("phi", "", "deg, assumed"),
        ("phi", "deg", "deg"),
        ("phi", "rad", "rad"),
        ("phi (rad)", "", "rad"),
        ("phi (rad)", "rad", "rad"),
        ("phi (mrad)", "", "mrad"),
        ("phi (rad)", "deg", None),
        ("phi_deg", "rad", None),
        ("phi (mrad)", "rad", None),
        ("phi (grad)", "", None),
        ("phi (grad)", "deg", "deg"),
        ("phi (cycles)", "", None),
        ("phi/π", "", None),
        ("phi [x pi]", "rad", None),
        ("phi (V)", "", None),
    ],
)
def test_the_unit_of_a_phase(tmp_path, name, stated, result):
    keys = COLUMNS["mp"] + (f'phase_unit = "{stated}"\n' if stated else "")
    if result is None:
        with pytest.raises(InputError, match="contradicts"):
            first(tmp_path, f"f;S;{name}", (10, 2, 30), keys)
        return
    table = first(tmp_path, f"f;S;{name}", (10, 2, 30), keys)
    per_rad = {"deg": 180 / math.pi, "rad": 1.0, "mrad": 1e3}[result.partition(",")[0]]
    assert table.phase_rad[0] == pytest.approx(30 / per_rad, rel=1e-12)
    assert any(step.startswith(f"phase read in {result}") for step in table.provenance.history)


@pytest.mark.parametrize("name", ["U (k=2) [V/(m/s²)]", "expanded uncertainty (V/(m/s²))", "u (V/(m/s²))"])
def test_a_stated_coverage_factor_divides_u(tmp_path, name):
    (tmp_path / "t.csv").write_text(f"f;S;{name}\n10;2;0.01\n20;2;0.02\n", encoding="utf-8")
    (tmp_path / "cal.toml").write_text(
        '[table]\nfile = "t.csv"\nfrequency = 1\nmagnitude = 2\nmagnitude_uncertainty = 3\ncoverage_factor = 2.0\n'
    )
    table = read(tmp_path / "cal.toml").table
    assert table is not None
    np.testing.assert_allclose(table.magnitude_uncertainty, [0.005, 0.01], rtol=1e-12)


@pytest.mark.parametrize(
    ("size", "name", "result"),
    [
        ("S", "u", 0.01),
        ("S [mV/g]", "u", 1e-5 / G),
        ("S [mV/g]", "u [V/g]", 0.01 / G),
        ("S", "u (%)", 2e-4),
        ("S [mV/g]", "u_percent", 2e-7 / G),
        ("S", "u(S) / ppm", 2e-8),
        ("S", "u (%), k = 1", 2e-4),
        ("S", "u (dB)", 2 * 0.01 * math.log(10) / 20),
        ("L (dB)", "u", 10**0.1 * 0.01 * math.log(10) / 20),
        ("L (dB re 1 mV/g)", "u (%)", 1e-4 * 10**0.1 * 1e-3 / G),
        ("L (dB re 1 mV/g)", "u (mV/g)", 1e-5 / G),
        ("S", "u [mV/g]", "its header"),
        ("S", "u_rel", "(%)"),
        ("S", "U (k=2) [V/(m/s²)]", "divide it by 2"),
        ("S", "U (V/(m/s²)), k = 2", "divide it by 2"),
        ("S", "U (k=2) (%)", "divide it by 2"),
        ("S", "Expanded uncertainty (V/(m/s²))", "divide it by"),
        ("S", "erweiterte Messunsicherheit", "divide it by"),
        ("S", "U95", "divide it by"),
        ("S", "u (k=1)", 0.01),
    ],
)
def test_the_unit_of_an_uncertainty_of_magnitude(tmp_path, size, name, result):
    def table():
        return first(tmp_path, f"f;{size};phi;{name};u phi", (10, 2, 30, 0.01, 1), "mpuu")

    if isinstance(result, float):
        assert table().magnitude_uncertainty[0] == pytest.approx(result, rel=1e-12)
        return
    with pytest.raises(InputError, match="contradicts") as caught:
        table()
    assert result in caught.value.remedy


@pytest.mark.parametrize(
    ("phase", "name", "result"),
    [
        ("phi", "u", math.radians(1)),
        ("phi (rad)", "u", 1.0),
        ("phi (°)", "u [mrad]", 1e-3),
        ("phi (rad)", "u (°)", math.radians(1)),
        ("phi", "u (deg)", math.radians(1)),
        ("phi", "u (mrad)", None),
        ("phi", "u (%)", None),
        ("phi", "U (°, k = 2)", None),
    ],
)
def test_the_unit_of_an_uncertainty_of_phase(tmp_path, phase, name, result):
    header = f"f;S;{phase};u;{name}"
    if result is None:
        with pytest.raises(InputError, match="contradicts"):
            first(tmp_path, header, (10, 2, 30, 0.01, 1), "mpuu")
        return
    assert first(tmp_path, header, (10, 2, 30, 0.01, 1), "mpuu").phase_uncertainty_rad[0] == pytest.approx(result)


@pytest.mark.parametrize("unit", ["", " [mV/g]"])
def test_uncertainties_of_the_parts_are_those_of_drawn_parts(tmp_path, unit):
    """Monte Carlo: scatter of magnitude and phase of normal real and imaginary parts; 4 of its standard deviations."""
    rng = np.random.default_rng(42)
    real, imaginary, u_real, u_imaginary = -0.3, 0.4, 0.002, 0.005
    keys = COLUMNS["ri"] + "real_uncertainty = 4\nimaginary_uncertainty = 5\n"
    header = f"f;Re{unit};Im{unit};u Re;u Im{unit}"
    table = first(tmp_path, header, (10, real, imaginary, u_real, u_imaginary), keys)
    draws = 40_000
    drawn = rng.normal(real, u_real, draws) + 1j * rng.normal(imaginary, u_imaginary, draws)
    near = 4 / math.sqrt(2 * draws)
    factor = 1e-3 / G if unit else 1.0
    assert table.magnitude_uncertainty[0] == pytest.approx(np.std(abs(drawn)) * factor, rel=near)
    assert table.phase_uncertainty_rad[0] == pytest.approx(np.std(np.angle(drawn)), rel=near)
    assert any("covariance is neglected" in step for step in table.provenance.history)


def test_uncertainties_of_magnitude_and_phase_beside_parts(tmp_path):
    keys = COLUMNS["ri"] + "magnitude_uncertainty = 4\nphase_uncertainty = 5\n"
    table = first(tmp_path, "f;Re [V/g];Im [V/g];u (%);u (mrad)", (10, -3, 4, 0.1, 2), keys)
    assert table.magnitude_uncertainty[0] == pytest.approx(5e-3 / G)
    assert table.phase_uncertainty_rad[0] == pytest.approx(2e-3)


def test_a_negative_scale_turns_parts_by_half_a_turn(tmp_path):
    table = first(tmp_path, "f;Re;Im", (10, -3, 0), "ri", "[response]\nscale = -2.0\n")
    assert (table.magnitude[0], table.phase_rad[0]) == (6.0, 0.0)
    assert first(tmp_path, "f;Re;Im", (10, -3, 0), "ri").phase_rad[0] == pytest.approx(math.pi)


MISTAKES = {
    "nothing": ("frequency = 1\n", "keys of one way"),
    "half": ("frequency = 1\nreal = 2\n", "keys of one way"),
    "two ways": ("frequency = 1\nmagnitude = 2\nreal = 2\nimaginary = 3\n", "keys of one way"),
    "phase of parts": (COLUMNS["ri"] + "phase = 3\n", "keys of one way"),
    "no frequency": ("magnitude = 2\n", "add frequency"),
    "parts in dB": (COLUMNS["ri"] + 'magnitude_unit = "dB"\n', "keys of one way"),
    "one of two": (COLUMNS["ri"] + "real_uncertainty = 3\n", "one of the two pairs"),
    "of parts": (COLUMNS["m"] + "real_uncertainty = 3\nimaginary_uncertainty = 3\n", "one of the two pairs"),
    "real array": ('frequency = 1\ncomplex = "Re"\n', "two columns"),
    "no array": ('frequency = 1\ncomplex = "H"\n', "two columns"),
    "zero": (COLUMNS["ri"], "remove that row"),
    "linear": (COLUMNS["m"].replace("2", "4") + 'magnitude_unit = "dB"\n', "remove magnitude_unit"),
    "too large": (COLUMNS["m"].replace("2", "5"), "remove that row"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_told_with_what_helps(tmp_path, mistake):
    keys, remedy = MISTAKES[mistake]
    with pytest.raises(InputError) as caught:
        first(tmp_path, "f;Re;Im;S [mV/g];L (dB)", (10, 0, 0, 1, 1e6), keys)
    assert remedy in caught.value.remedy


def test_the_row_at_0_hz_of_a_files_own_axis_is_left_out(tmp_path):
    with h5py.File(tmp_path / "t.h5", "w") as file:
        for name, values in {"frequency": [0.0, 1.0], "real": [0.0, 2.0], "imag": [0.0, -1.0]}.items():
            file[f"g/H.{name}"] = np.array(values)
    (tmp_path / "c.toml").write_text('[table]\nfile = "t.h5"\ncomplex = "g/H"\n')
    table = read(tmp_path / "c.toml").table
    assert (table.frequency_hz.tolist(), table.magnitude.tolist()) == ([1.0], [math.sqrt(5)])
    assert "left out: 1 row at 0 Hz" in table.provenance.history
    with h5py.File(tmp_path / "t.h5", "a") as file:
        del file["g/H.frequency"]
    with pytest.raises(InputError) as caught:
        read(tmp_path / "c.toml")
    assert "add frequency" in caught.value.remedy
    (tmp_path / "c.toml").write_text('[table]\nfile = "t.h5"\ncomplex = "g/h"\n')
    with pytest.raises(InputError) as caught:
        read(tmp_path / "c.toml")
    assert "'g/H'" in caught.value.remedy


def test_a_name_may_leave_out_the_unit_in_brackets(tmp_path):
    keys = 'frequency = "f"\nmagnitude = "S"\n'
    assert first(tmp_path, "f (kHz);S [mV/g];T", (10, 2, 3), keys).frequency_hz[0] == 1e4
    assert first(tmp_path, "f;S [mV/g];S", (10, 2, 3), keys).magnitude[0] == 3.0  # the exact name
    with pytest.raises(InputError) as caught:
        first(tmp_path, "f;S [mV/g];S (dB)", (10, 2, 3), keys)
    assert "2 or 3" in caught.value.remedy
    (tmp_path / "r.csv").write_text(
        "t [s],a (m/s²),u [V]\n" + "".join(f"{k / 1e3},{k % 7},{k % 5}\n" for k in range(99))
    )
    (tmp_path / "r.toml").write_text(
        '[reference]\ncolumn = "a"\n[response]\ncolumn = "u"\n[sampling]\ntime_column = "t"\n'
        '[[records]]\nfile = "r.csv"\nexcitation = "random"\n'
    )
    assert read(tmp_path / "r.toml").records[0].response[3] == 3.0


pieces = st.sampled_from(
    ["S", "u", "f", " ", "/", "(", ")", "[", "]", "mV", "g", "m", "s", "²", "^2", "-", "⁻", "·", "*", "dB", "re", "1",
     "1e999", "10^-3", "%", "rad", "deg", "π", "per", "in", "_", "k", "=", "2", "ω", "V", "kHz", ".", ",", "0", "{"]
)  # fmt: skip


@given(st.tuples(*[st.lists(pieces, max_size=9).map("".join)] * 5), st.sampled_from(["", "dB"]))
def test_whatever_the_header_is_a_table_is_read_or_refused(tmp_path_factory, names, unit):
    names = [f"{place}{name}" for place, name in zip("fSpuw", names, strict=True)]
    folder = tmp_path_factory.mktemp("t")
    keys = COLUMNS["mpuu"] + f'magnitude_unit = "{unit}"\n'
    with contextlib.suppress(InputError):
        table = first(folder, ";".join(names), (10, 2, 30, 0.01, 1), keys)
        assert np.all(table.magnitude > 0)


@pytest.mark.parametrize(
    ("name", "base", "unit"),
    [
        ("S [mV/(m/s²)]", "S", "mV/(m/s²)"),
        ("S in V/(m/s²)", "S", "V/(m/s²)"),
        ("S V/(m/s²)", "S", "V/(m/s²)"),
        ("u(S) / %", "u(S)", "%"),
        ("S / (V s²/m)", "S", "V s²/m"),
        ("时间（毫秒）", "时间", "毫秒"),
        ("left in x direction", "left in x direction", ""),
        ("(x)", "(x)", ""),
        ("(" * 200_000, "(" * 200_000, ""),
        ("a/" * 100_000, "a/" * 100_000, ""),
    ],
)
def test_a_name_is_split_from_its_unit(name, base, unit):
    assert split_unit(name) == (base, unit)
