"""The certificate: every number is the result's, what is not stated is blank, and the PDF is made of exactly that."""

import io
import re
import sys
from dataclasses import replace

import numpy as np
import pypdf
import pytest
from tests.support.printed import CERTIFICATE, NUMBER, assert_rounded, factor_to, stated
from tests.support.sample_results import (
    SAMPLES,
    THIRD_OCTAVES,
    accelerometer,
    pickup,
    single_point,
    table2,
    table_only,
    troubled,
)

from vibrident.base.errors import InputError
from vibrident.base.nominal import Nominal
from vibrident.result import Curve
from vibrident.show import certificate, certificate_tables, report, words
from vibrident.show.certified import certified
from vibrident.show.numbers import sensitivity_scale
from vibrident.show.points import nominal_points, reference_point, sensitivity_at


def with_grid(result):
    """The result with the curve at the frequencies of a certificate, as ``identify`` makes it."""
    f = np.unique([*result.response.frequency_hz, *THIRD_OCTAVES])
    s = accelerometer(f)
    u = 0.001 * (1 + (f / 900) ** 2)
    phase = np.rad2deg(np.angle(s))
    curve = Curve(*(tuple(values) for values in (f, abs(s), phase, u * abs(s), np.rad2deg(u))))
    return replace(result, response=curve)


def pages(content: bytes) -> list[str]:
    return [page.extract_text() for page in pypdf.PdfReader(io.BytesIO(content)).pages]


def by_label(result) -> dict[str, str | None]:
    return {label: text for group in certificate.groups(result) for label, text in group.rows}


def test_every_sensitivity_is_the_results():
    result = with_grid(table2())
    table = certificate_tables.sensitivity(result)
    curve = result.response
    unit = re.search(r"\((.*)\)", table.header[2]).group(1)
    factor = factor_to(unit, "V/(m/s^2)")
    assert [row[0] for row in table.rows] == [
        Nominal(n, 0).name
        for n in np.array(
            [10, 12.5, 16, 20, 25, 31.5, 40, 50, 63, 80, 100, 125, 160, 200, 250, 315, 400, 500, 630, 800, 1000]
        )
    ]
    for _, frequency, magnitude, expanded, relative, phase, phase_u in table.rows:
        i = int(np.argmin(np.abs(np.array(curve.frequency_hz) - float(frequency))))
        assert_rounded(frequency, curve.frequency_hz[i])
        assert_rounded(magnitude, curve.magnitude[i], factor)
        assert_rounded(expanded, 2 * curve.magnitude_uncertainty[i], factor)
        assert_rounded(relative, 200 * curve.magnitude_uncertainty[i] / curve.magnitude[i])
        assert_rounded(phase, curve.phase_deg[i])
        assert_rounded(phase_u, 2 * curve.phase_deg_uncertainty[i])
        assert len(magnitude.partition(".")[2]) == len(expanded.partition(".")[2])


def test_every_parameter_is_the_results():
    result = table2()
    table = certificate_tables.parameters(result)
    for row, parameter in zip(table.rows, result.parameters.values(), strict=True):
        cells = dict(zip(table.header, row, strict=True))
        factor = factor_to("" if cells["unit"] == "1" else cells["unit"], parameter.unit)
        assert_rounded(cells["value"], parameter.value, factor)
        assert_rounded(cells["u"], parameter.standard_uncertainty, factor)
        assert_rounded(cells["U"], 2 * parameter.standard_uncertainty, factor)


@pytest.mark.parametrize("frequency", [11.3, 160.0, 444.0, 631.7, 999.0])
def test_between_the_curves_points_the_model_leads(frequency):
    """A curve of few points is followed to rounding, through a resonance far sharper than their distance."""
    sharp = {"s0": 0.1, "natural": 640.0, "damping": 0.004, "delay": 2e-5}
    f = np.geomspace(10, 1000, 12)
    s = accelerometer(f, **sharp)
    names = {"sensitivity": 0.1, "natural_frequency": 640.0, "damping_ratio": 0.004, "delay": 2e-5}
    made = table2()
    parameters = {name: replace(made.parameters[name], value=value) for name, value in names.items()}
    u = tuple(0.01 * abs(s))
    result = replace(
        made, parameters=parameters, response=Curve(tuple(f), tuple(abs(s)), tuple(np.rad2deg(np.angle(s))), u, u)
    )
    point = sensitivity_at(result, Nominal(frequency, frequency))
    expected = accelerometer(np.array([frequency]), **sharp)[0]
    assert point.magnitude == pytest.approx(abs(expected), rel=1e-12)
    assert point.phase_deg == pytest.approx(np.rad2deg(np.angle(expected)), abs=1e-9)


def test_nothing_outside_the_measured_band():
    result = replace(table2(), certificate={"reference_frequency_hz": 1500.0})  # the curve goes on to 2 kHz
    assert {point.nominal for point in nominal_points(result)} <= {
        f"{n:g}"
        for n in (10, 12.5, 16, 20, 25, 31.5, 40, 50, 63, 80, 100, 125, 160, 200, 250, 315, 400, 500, 630, 800, 1000)
    }
    point, why = reference_point(result)
    assert point is None
    assert "1500 Hz lies outside" in why
    (_, frequency), (_, reason) = certificate_tables.reference(result).rows
    assert frequency is None
    assert "outside" in reason
    assert sensitivity_at(result, Nominal(3000.0, 3000.0)) is None


def test_the_reference_frequency_of_a_seismometer():
    (_, frequency), (_, magnitude), *_ = certificate_tables.reference(pickup()).rows
    assert frequency == "1 Hz; 160 Hz lies outside the measured band; chosen as usual for seismometers"
    assert re.fullmatch(rf"{NUMBER} V/\(m/s\), U = {NUMBER} V/\(m/s\) \(k = 2\)", magnitude)


def test_what_is_not_stated_is_blank():
    found, head = by_label(table2()), certificate.letterhead(table2())
    for label in ("Customer", "Date of calibration", "Date of issue", "Mounting", "Temperature", "Procedure"):
        assert found[label] is None
    assert found["Serial number"] == "4711"
    assert (head.number, head.lines) == (None, ())
    assert certificate_tables.instruments(table2()).rows == ()
    assert [text for _, text in certificate.signatures(table2())] == [None, None]
    assert "Air pressure" not in found


def test_what_is_stated_stands_as_it_is():
    found, instruments = by_label(stated()), certificate_tables.instruments(stated())
    assert certificate.letterhead(stated()).number == "2025-0042"
    assert found["Temperature"] == "23 °C (U = 0.5 °C, k = 2)"
    assert found["Relative humidity"] == "45 %"
    assert instruments.header == ("Instrument", "Serial number")
    assert instruments.rows == (("Laser vibrometer", "12"), ("Amplifier", ""))
    further = replace(table2(), certificate={"torque": {"value": 2.0}})
    assert by_label(further)["Torque"] == "value: 2"  # made in memory, with a key of its own


def test_the_coverage_is_that_of_the_effective_degrees_of_freedom():
    few = replace(table2(), settings={"effective_degrees_of_freedom": 5.0})
    assert "90 % (Student's t with ν_eff = 5)" in certificate.statements(few)[0]
    none = replace(table2(), settings={"effective_degrees_of_freedom": None})  # infinity, as JSON has it
    assert "95 % (normal distribution, ν_eff = ∞)" in certificate.statements(none)[0]
    assert "95 % for a normal distribution" in certificate.statements(table2())[0]


@pytest.mark.usefixtures("unpainted")
def test_the_pdf_holds_the_contents_and_numbers_its_pages():
    result = with_grid(stated())
    found = pages(report.content(result, "pdf"))
    text = " ".join(" ".join(found).split())
    to_sign = certified(result)
    tables = (certificate_tables.sensitivity(to_sign), certificate_tables.parameters(to_sign))
    for table in tables:
        for row in table.rows:
            assert " ".join(cell.replace("_", "") for cell in row if cell) in text
    for _, said in certificate_tables.reference(to_sign).rows:
        assert said in text
    for key in ("number", "laboratory", "customer", "mounting", "procedure", "traceability", "operator"):
        assert CERTIFICATE[key] in text
    for number, page in enumerate(found, 1):
        assert f"Page {number} of {len(found)}" in page
        assert "No. 2025-0042" in page
    assert "Limitations of the results" not in text


@pytest.mark.usefixtures("unpainted")
def test_the_pdf_names_every_warning():
    text = " ".join(" ".join(pages(report.content(troubled(), "pdf"))).split())
    assert "Limitations of the results" in text
    for code in troubled().warning_codes:
        assert words.explain(code).title[1:] in text


@pytest.mark.parametrize("sample", SAMPLES)
def test_every_result_has_a_certificate(sample):
    assert report.content(SAMPLES[sample](), "pdf").startswith(b"%PDF")


def test_the_same_result_gives_the_same_file():
    result = stated()
    assert report.content(result, "pdf") == report.content(result, "pdf")


@pytest.mark.usefixtures("unpainted")
def test_letters_that_the_font_lacks_do_no_harm():
    result = replace(table2(), sensor={"type": "振动传感器 $x$ #let"}, certificate={"remarks": "*not bold* \\ @x"})
    text = " ".join(pages(report.content(result, "pdf")))
    assert "*not bold* \\ @x" in text
    assert "$x$ #let" in text


def test_a_point_without_phase_or_uncertainty():
    assert not any("phase" in name for name in certificate_tables.sensitivity(table_only()).header)
    assert certificate_tables.sensitivity(single_point()) is None  # 159.15 Hz is no nominal frequency
    assert sensitivity_scale(single_point()).unit == "pC/(m/s²)"


def test_without_typst_the_remedy_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "typst", None)
    with pytest.raises(InputError, match=r"vibrident\[report\]"):
        report.content(table2(), "pdf")


@pytest.mark.usefixtures("unpainted")
def test_who_signs_does_so_on_page_one():
    """Whatever the page holds: a long certificate, one with doubts, one without points."""
    files = [{"file": f"{i}.csv", "sha256": f"{i:064x}"} for i in range(30)]
    long = replace(stated(), provenance={"files": files})
    for result in (troubled(), table2(), long, single_point()):
        first, *others = pages(report.content(result, "pdf"))
        assert "Calibrated by" in first
        assert "Approved by" in first
        assert not [page for page in others if "Place and date" in page]


@pytest.mark.usefixtures("unpainted")
def test_the_measured_points_and_the_signature_share_page_one():
    result = replace(stated(), warnings=(), findings=())
    first = pages(report.content(result, "pdf"))[0]
    assert all(row[2] in first for row in certificate_tables.measured(result).rows)
