"""A certificate is issued with what is given after the fit, in four languages; what is missing makes it a draft."""

import io
import re
import string
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pypdf
import pytest
import typst
from tests.support import shell
from tests.support.certified import certified, written
from tests.support.exported import paper
from tests.support.lives import calibrated
from tests.support.printed import PROGRAM_WORDS, assert_rounded, factor_to
from tests.support.sample_results import table2, table_only, troubled

import vibrident
import vibrident.show
from vibrident.base.errors import InputError
from vibrident.data.io.certificate import CertificateSection, certificate_data, certificate_section
from vibrident.show import certificate, certificate_decisions, report
from vibrident.show import certificate_tables as parts
from vibrident.show.issue import REQUIRED, form, issued, missing
from vibrident.show.language import Translator
from vibrident.show.media import pdf
from vibrident.show.numbers import percent, sensitivity_scale
from vibrident.use.conformity import accepted, judge_requirements, probability_of_conformance, ratio_uncertainty

pytestmark = pytest.mark.usefixtures("unpainted")
FOLDER = Path(vibrident.show.__file__).parent / "languages"
LANGUAGES = ("en", "de", "fr", "zh")
WHOLE = """
[sensor]
serial_number = 4712
[certificate]
number = "2026-7"
laboratory = "L"
laboratory_address = "A"
place = "laboratory"
customer = "C"
customer_address = "B"
date_of_calibration = 2026-03-01
date_of_issue = 2026-03-02
procedure = "ISO 16063-11, method 3"
traceability = "to the SI"
temperature_c = 23.0
approved_by = "H"
"""
JUDGED = """
decision_rule = "guarded"
[[certificate.requirements]]
quantity = "natural_frequency"
low = 600.0
high = 700.0
source = "data sheet"
[[certificate.requirements]]
quantity = "sensitivity_deviation"
low = -5.0
high = 5.0
from_hz = 40.0
to_hz = 200.0
"""


def full(result):
    return replace(result, uncertainty={"covers": ["noise", "gain", "phase"]})


def file(folder, text=WHOLE, name="certificate.toml"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def pages(content):
    """Return the text of each page; a font has one glyph for a hyphen and for that of a broken word."""
    read = (page.extract_text() for page in pypdf.PdfReader(io.BytesIO(content)).pages)
    return [" ".join(text.split()).replace("\N{SOFT HYPHEN}", "-") for text in read]


def texts(code):
    return tomllib.loads((FOLDER / f"{code}.toml").read_text(encoding="utf-8"))


def fields(text):
    return sorted(name for _, name, _, _ in string.Formatter().parse(text) if name)


@pytest.mark.parametrize("code", LANGUAGES[1:])
def test_every_language_has_all_the_words(code):
    english, other = texts("en"), texts(code)
    assert set(other) == set(english)
    for section in set(english) - {"known"}:
        assert list(other[section]) == list(english[section])
        for key, text in english[section].items():
            assert fields(other[section][key]) == fields(text), key
    assert set(other["known"]) == set(texts("de")["known"])


def test_the_form_has_every_entry_once():
    keys = [entry.key for entry in form()]
    assert sorted(keys) == sorted(CertificateSection.model_fields)
    assert {entry.key for entry in form() if entry.required} == set(REQUIRED)
    assert certificate_section({"number": "1", "remarks": "x"}, "form") == {"number": "1", "remarks": ["x"]}
    with pytest.raises(InputError, match="logo"):
        certificate_section({"logo": "/etc/passwd"}, "form")


def test_what_is_missing_makes_a_draft_of_every_page(tmp_path):
    lacking, _ = issued(full(table2()), [])
    found = pages(report.content(lacking, "pdf"))
    assert all("DRAFT" in page for page in found)
    assert "Certificate number, Laboratory" in found[0]
    whole, _ = issued(full(table2()), [file(tmp_path)])
    assert missing(whole) == ()
    assert not [page for page in pages(report.content(whole, "pdf")) if "DRAFT" in page]
    amended = replace(whole, certificate={**whole.certificate, "replaces": "2026-6"})
    assert missing(amended) == ("changes",)


def test_a_later_file_replaces_what_an_earlier_one_states(tmp_path):
    job = file(tmp_path, '[certificate]\nnumber = "2026-8"\nreplaces = "2026-7"\nchanges = "The number."\n', "job.toml")
    result, _ = issued(full(table2()), [file(tmp_path), job])
    assert (result.certificate["number"], result.certificate["laboratory"]) == ("2026-8", "L")
    assert result.sensor["serial_number"] == "4712"
    first = pages(report.content(result, "pdf"))[0]
    assert "Replaces certificate 2026-7" in first
    assert "The number." in first


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[certificate]\nnumbr = "1"\n', "number"),
        ('[certificate]\nlogo = "none.svg"\n', "none.svg"),
        ('[certificate]\nlanguage = "it"\n', "en"),
        ('[[certificate.requirements]]\nquantity = "delay"\n', "low or high"),
        ('[[certificate.requirements]]\nquantity = "delay"\nlow = 7\nhigh = 5\n', "at most high"),
        ("[certificate]\ntemperature_c = true\n", "a finite number"),
    ],
)
def test_a_bad_certificate_file_is_refused(tmp_path, text, said):
    with pytest.raises(InputError) as error:
        certificate_data([file(tmp_path, text)])
    assert said in str(error.value)
    assert "certificate.toml" in str(error.value)


def test_the_measured_values_are_the_results():
    result = table2()
    table, points = parts.measured(result), result.measured
    factor = factor_to(sensitivity_scale(result).unit, "V/(m/s^2)")
    assert len(table.rows) == len(points.frequency_hz)
    for i, (_, f, magnitude, u, relative, *_, phase, phase_u) in enumerate(table.rows):
        assert_rounded(f, points.frequency_hz[i])
        assert_rounded(magnitude, points.magnitude[i], factor)
        assert_rounded(u, 2 * points.magnitude_uncertainty[i], factor)
        assert_rounded(relative, 200 * points.magnitude_uncertainty[i] / points.magnitude[i])
        assert_rounded(phase, points.phase_deg[i])
        assert_rounded(phase_u, 2 * points.phase_deg_uncertainty[i])


def test_the_probability_of_conformance_is_that_of_jcgm_106():
    """The examples of JCGM 106:2012, 7.3.3: breakdown voltage −5.47 V, u = 0.05 V, at most −5.40 V: 92 %."""
    assert probability_of_conformance(-5.47, 0.05, -np.inf, -5.40) == pytest.approx(0.92, abs=0.005)
    drawn = np.random.default_rng(1).normal(0.3, 1.0, 200_000)
    inside = float(np.mean((drawn > -1.0) & (drawn < 2.0)))
    assert probability_of_conformance(0.3, 1.0, -1.0, 2.0) == pytest.approx(inside, abs=0.003)


def test_the_decision_rules():
    assert accepted(1.9, 0.1, 0.0, 2.0, "simple")
    assert accepted(1.9, None, 0.0, 2.0, "simple")
    assert accepted(1.9, 0.1, 0.0, 2.0, "guarded") is False
    assert accepted(1.8, 0.1, 0.0, 2.0, "guarded")
    assert accepted(1.8, None, 0.0, 2.0, "guarded") is None


def test_conformity_is_judged_where_u_covers_the_chain(tmp_path):
    result, _ = issued(full(table2()), [file(tmp_path, WHOLE + JUDGED)])
    rule, table = certificate_decisions.conformity(result)
    assert "guarded" in rule.text
    assert [row[-1] for row in table.rows] == ["met", "not met"]
    certain = {"quantity": "natural_frequency", "low": 1.0}
    one_sided = replace(result, certificate={**result.certificate, "requirements": [certain]})
    assert certificate_decisions.conformity(one_sided)[1].rows[0][1] == "≥ 1"
    assert certificate_decisions.conformity(one_sided)[1].rows[0][5] == "> 99 %"
    scatter = replace(result, uncertainty={"covers": ["noise"]})
    (sentence,) = certificate_decisions.conformity(scatter)
    assert "No statement of conformity" in sentence.text
    unknown = replace(result, certificate={"requirements": [{"quantity": "mass", "low": 1.0}]})
    with pytest.raises(InputError, match="natural_frequency"):
        judge_requirements(unknown, None, None)


def test_before_and_after_adjustment(tmp_path):
    before = replace(
        table2(),
        parameters={n: replace(p, value=p.value * 1.01) for n, p in table2().parameters.items()},
    ).save(tmp_path / "before.json")
    result, issue = issued(full(table2()), [file(tmp_path, WHOLE + f'before = "{before.name}"\n')])
    rows = {row[0]: row for row in certificate_decisions.adjustment(result, issue.before).rows}
    assert rows["natural frequency"][-2] == "−0.990 %"
    assert "Before and after adjustment" in " ".join(pages(report.content(result, "pdf", issue=issue)))


def test_what_two_calibrations_share_is_no_part_of_the_change():
    """The change of a gain by 1 % under one reference of 0.5 % is as well known as the noise of 0.1 % lets it be."""
    before, after = calibrated(), calibrated(0.101, "2020-01-02")
    magnitude, sensitivity, frequency = certificate_decisions.adjustment(after, before).rows
    for row in (magnitude, sensitivity):
        assert row[-2:] == ("+1.00 %", "0.29 %")  # 2 √2 · 0.1 % · 1.01
    assert frequency[-2:] == ("0.0 %", "1.1 %")  # 2 √2 · 20/5000
    anew = calibrated(0.101, "2020-01-02", shared={"another reference": 0.005})
    assert certificate_decisions.adjustment(anew, before).rows[1][-1] == "1.5 %"  # 2 · 1.01 √2 √(0.5² + 0.1²) %


def with_gain(result, gain, noise=0.001):
    """A result whose only stated source is a gain of one relative size, with its budget by frequency."""
    curves = {}
    for name in ("response", "measured"):
        curve = getattr(result, name)
        u = np.hypot(gain, noise) * np.abs(curve.magnitude)
        curves[name] = replace(curve, magnitude_uncertainty=u)
    f, size = result.measured.frequency_hz, np.abs(result.measured.magnitude)
    rows = [{"source": "vibrometer", "kind": "gain", "contributions": {}}]
    own = [
        {"source": "noise", "magnitude": (noise * size).tolist()},
        {"source": "vibrometer", "magnitude": (gain * size).tolist()},
    ]
    settings = {"uncertainty_budget": rows, "point_budget": {"frequency_hz": f.tolist(), "sources": own}}
    return replace(full(result), settings=settings, **curves)


@pytest.mark.parametrize("gain", [0.0, 0.002, 0.5])
def test_a_gain_that_both_values_share_cancels_in_their_deviation(gain):
    result = with_gain(table2(), gain)
    f = result.measured.frequency_hz
    base = 1.02 * float(result.measured.magnitude[12])
    asked = {"quantity": "sensitivity_deviation", "low": -5.0, "high": 5.0, "from_hz": f[3], "to_hz": f[3]}
    result = replace(result, certificate={"requirements": [asked]})
    (row,) = judge_requirements(result, float(f[12]), (base, np.hypot(gain, 0.001) * base))
    ratio = result.measured.magnitude[3] / base
    assert row.value == pytest.approx(100 * (ratio - 1))
    assert row.u == pytest.approx(100 * ratio * np.hypot(0.001, 0.001), rel=1e-6)
    bare = replace(result, settings={})  # what nobody stated as common does not cancel
    (upper,) = judge_requirements(bare, float(f[12]), (base, np.hypot(gain, 0.001) * base))
    assert upper.u == pytest.approx(100 * ratio * np.sqrt(2) * np.hypot(gain, 0.001))


def test_the_ratio_of_two_values_with_a_common_source_is_that_of_drawn_ones():
    rng = np.random.default_rng(5)
    noise, error = rng.normal(size=(2, 200_000)) * 0.003, rng.normal(size=200_000)
    ratio = (1 + 0.004 * error + noise[0]) / (1 + 0.010 * error + noise[1])
    u = ratio_uncertainty(np.hypot(0.004, 0.003), np.array([0.004]), np.hypot(0.010, 0.003), np.array([0.010]))
    assert u == pytest.approx(ratio.std(), rel=0.01)


def test_the_dust_of_rounding_is_zero():
    result = with_gain(table2(), 0.01)
    f, size = result.measured.frequency_hz, result.measured.magnitude
    asked = {"quantity": "sensitivity_deviation", "low": -1.0, "from_hz": f[5], "to_hz": f[5]}
    result = replace(result, certificate={"requirements": [asked]})
    (row,) = judge_requirements(result, float(f[5]), (float(np.nextafter(size[5], 1.0)), 1e-4))
    assert (row.value, row.u, row.probability, row.met) == (0.0, 0.0, 1.0, True)
    assert percent(100 * (0.1 / np.nextafter(0.1, 1.0) - 1)) == "0 %"
    assert percent(1e-9) == "+1.0e-9 %".replace("e-9", "·10⁻⁹")


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"date_of_receipt": "2026-03-02"}, "date_of_receipt 2026-03-02, date_of_calibration 2026-03-01"),
        ({"date_of_issue": "2026-02-28"}, "date_of_calibration 2026-03-01, date_of_issue 2026-02-28"),
        (
            {"date_of_calibration": None, "date_of_receipt": "2026-03-03"},
            "date_of_receipt 2026-03-03, date_of_issue 2026-03-02",
        ),
        ({"instruments": [{"name": "Laser", "calibrated_until": "2026-02-28"}]}, "Laser, calibrated_until 2026-02-28"),
        ({"date_of_issue": "31.3.2026"}, "31.3.2026"),
    ],
)
def test_dates_that_cannot_be_true_together_are_refused(tmp_path, more, said):
    result, _ = issued(full(paper()), [file(tmp_path)])
    wrong = replace(result, certificate={**result.certificate, "country": "DE", **more}).save(tmp_path / "r.json")
    for command in (("report", "pdf"), ("export", "dcc")):
        done = shell.run(command[0], wrong, "--format", command[1])
        if command[1] == "pdf" or more.get("date_of_calibration", "stated"):
            assert done.exit_code == 2
            assert said in " ".join(done.output.split())
    days = {"date_of_receipt": "2026-03-01", "date_of_issue": "2026-03-01"}
    valid = {**days, "instruments": [{"name": "Laser", "calibrated_until": "2026-03-01"}, "Amplifier"]}
    right = replace(result, certificate={**result.certificate, **valid}).save(tmp_path / "right.json")
    assert shell.run("report", right, "--format", "pdf").exit_code == 0


def test_one_number_is_not_given_to_two_certificates(tmp_path):
    given = file(tmp_path)
    names = [full(table2(seed)).save(tmp_path / f"{seed}.json") for seed in (1, 2)]
    asked = ("report", *names, "--format", "pdf", "--certificate", given)
    done = shell.run(*asked, "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert "2026-7 for" in " ".join(done.output.split())
    assert not (tmp_path / "out").exists()
    comparison = vibrident.report(names, tmp_path / "comparison.pdf")  # it is no certificate
    assert comparison.stat().st_size > 0


@pytest.mark.parametrize(
    ("codes", "title", "last"),
    [
        (("de", "en"), "Kalibrierschein Calibration certificate", "Seite 4 von 4 / Page 4 of 4"),
        (("fr",), "Certificat", "Page"),
    ],
)
def test_a_certificate_in_other_languages(tmp_path, codes, title, last):
    more = "".join(f'{key} = "{code}"\n' for key, code in zip(("language", "second_language"), codes, strict=False))
    result, _ = issued(full(table2()), [file(tmp_path, WHOLE + more)])
    found = pages(report.content(result, "pdf"))
    assert title in found[0]
    assert last in found[-1]
    numbers = {row[2].replace(".", ",") for row in parts.measured(result).rows}
    assert [number for number in numbers if number not in " ".join(found)] == []


#: English where another language is asked for.
ENGLISH = r"\bno\.|\b(?:gain|clock|mounting|noise|data|timing|the|of|estimator|reference|derived)\b"
#: What the laboratory states itself; versions, standards and file names, whose numbers have points.
POINTS = r"to the SI|data sheet|vibrident [\d.]+|17025:2017, [\d.]+|106, [\d.]+|\d+Hz\.csv|\d\.\d+Hz|[A-Za-z]\. "


def budgeted(result):
    """A result with stated effects, findings and warnings."""
    made, budget = with_gain(result, 0.002), []
    for source, kind, size in (("noise", "data", None), ("calibration of the reference", "gain", 0.002)):
        row = {"source": source, "type": "A" if size is None else "B", "kind": kind, "standard_uncertainty": size}
        budget.append({**row, "unit": "1", "degrees_of_freedom": None, "contributions": {"sensitivity": 1.5e-4}})
    sources = made.settings["point_budget"]["sources"]
    points = [{**one, "phase_deg": [0.01] * len(one["magnitude"])} for one in sources]
    points[1]["source"] = "calibration of the reference"
    settings = {
        **made.settings,
        "uncertainty_budget": budget,
        "point_budget": {**made.settings["point_budget"], "sources": points},
        "uncertainty_covers": "noise; calibration of the reference (gain)",
        "reference_standard_uncertainty": 0.002,
    }
    return replace(made, settings=settings, warnings=troubled().warnings, findings=troubled().findings)


@pytest.mark.parametrize("code", ["en", "de", "fr"])
def test_a_customer_reads_one_language_and_no_word_of_the_program(tmp_path, code):
    more = f'language = "{code}"\ntemperature_uncertainty_c = 0.5\n' + JUDGED
    result, _ = issued(budgeted(table2()), [file(tmp_path, WHOLE + more)])
    for made in (result, replace(result, uncertainty={"covers": ["noise"]})):
        text = " ".join(pages(report.content(replace(made, warnings=()) if code == "en" else made, "pdf")))
        assert re.findall(PROGRAM_WORDS, text) == []
        if code != "en":
            left = re.findall(ENGLISH, re.sub(POINTS, "", text))
            assert [word for word in left if (word, code) != ("gain", "fr")] == []
            assert re.findall(r"\d+\.\d+", re.sub(POINTS, "", text)) == []
            assert re.search(r"\d,\d", text)


def test_two_languages_have_one_decimal_sign(tmp_path):
    for first, second, sign in (("de", "en", ","), ("en", "de", ".")):
        more = f'language = "{first}"\nsecond_language = "{second}"\n'
        result, _ = issued(budgeted(table2()), [file(tmp_path, WHOLE + more)])
        text = re.sub(POINTS, "", " ".join(pages(report.content(replace(result, warnings=(), findings=()), "pdf"))))
        assert re.findall(rf"\d[{'.,'.replace(sign, '')}]\d", text) == []


def test_budget_and_hashes_can_be_left_out(tmp_path):
    more = 'budget = "leave out"\ndata_files = "leave out"\n'
    result, _ = issued(budgeted(table2()), [file(tmp_path, WHOLE)])
    fewer, _ = issued(result, [file(tmp_path, WHOLE + more)])
    long, short = (" ".join(pages(report.content(one, "pdf"))) for one in (result, fewer))
    for said in ("Uncertainty budget", "SHA-256"):
        assert said in long
        assert said not in short
    assert "Statements" in short


def test_the_pdf_is_pdf_a_with_its_metadata(tmp_path):
    result, _ = issued(full(table2()), [file(tmp_path)])
    read = pypdf.PdfReader(io.BytesIO(report.content(result, "pdf")))
    assert b"pdfaid:part" in read.xmp_metadata.stream.get_data()
    assert read.metadata.title == "Calibration certificate 2026-7"
    assert read.metadata.author == "L"
    assert read.metadata.subject == read.metadata.title or "4712" in str(read.metadata.keywords)


@pytest.mark.parametrize(
    ("serial", "date", "name"),
    [
        ("4711", "2026-03-01", "certificate-4711-2026-03-01.pdf"),
        ("A/7: ../x", "2026-03-01", "certificate-A-7-..-x-2026-03-01.pdf"),
        ("", None, "certificate.pdf"),
        ("..", None, "certificate.pdf"),
        ("序 1", None, "certificate-序-1.pdf"),
    ],
)
def test_a_file_is_named_after_sensor_and_date(serial, date, name):
    sensor, stated = {"serial_number": serial}, {"date_of_calibration": date}
    assert report.name_of_sensor("certificate.pdf", sensor, stated) == name


def test_chinese_needs_a_font_and_says_so(tmp_path, monkeypatch):
    """As the second language too: without, each of its letters was an empty box."""
    second, _ = issued(full(table2()), [file(tmp_path, WHOLE + 'language = "de"\nsecond_language = "zh"\n')])
    result, _ = issued(full(table2()), [file(tmp_path, WHOLE + 'language = "zh"\n')])
    assert certificate.title(result, Translator.from_result(result)) == "校准证书"
    monkeypatch.setattr(pdf, "_CHINESE", ("no such font",))
    for one in (result, second):
        with pytest.raises(InputError, match="fonts"):
            report.content(one, "pdf")
    families = typst.Fonts(include_system_fonts=True).families()
    monkeypatch.undo()
    if set(families) & set(pdf._CHINESE):
        assert "校准证书" in "".join(pages(report.content(result, "pdf")))


def test_the_laboratorys_own_logo_and_template(tmp_path):
    (tmp_path / "logo.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9"/>')
    (tmp_path / "own.typ").write_text("#let doc = json(bytes(sys.inputs.document))\nOwn #doc.letterhead.number")
    (tmp_path / "bad.typ").write_text('#read("/etc/passwd")')
    result, issue = issued(full(table2()), [file(tmp_path, WHOLE + 'logo = "logo.svg"\ntemplate = "own.typ"\n')])
    assert pages(report.content(result, "pdf", issue=issue)) == ["Own 2026-7"]
    with pytest.raises(InputError, match=r"bad\.typ"):
        report.content(result, "pdf", issue=replace(issue, template=tmp_path / "bad.typ"))
    logo = replace(issue, template=None)
    assert "2026-7" in pages(report.content(result, "pdf", issue=logo))[0]
    with pytest.raises(InputError, match="logo"):
        report.content(result, "pdf", issue=replace(logo, logo=b"no picture"))


def test_the_command(tmp_path):
    result = full(paper()).save(tmp_path / "result.json")
    given = file(tmp_path, WHOLE + 'country = "DE"\n')
    reported = shell.run("report", result, "--format", "pdf", "--certificate", given)
    assert reported.exit_code == 0
    assert "of serial number 4712, as its file states" in " ".join(reported.output.split())
    assert "2026-7" in pages((tmp_path / "certificate.pdf").read_bytes())[0]
    done = shell.run("export", result, "--format", "dcc", "--certificate", given)
    assert done.exit_code == 0, done.output
    assert "2026-7" in (tmp_path / "sensor.dcc.xml").read_text()
    wrong = shell.run("report", result, "--format", "pdf", "--certificate", tmp_path / "none.toml")
    assert wrong.exit_code == 2


def test_the_digital_certificate_states_the_same(tmp_path):
    made = full(certified(paper()))
    requirement = {"quantity": "natural_frequency", "low": 1.0, "source": "data sheet"}
    more = {"requirements": [requirement], "replaces": "2025-1", "opinions": ["Fine."]}
    root = written(replace(made, certificate={**made.certificate, **more}), tmp_path)
    space = {"dcc": "https://ptb.de/dcc"}
    assert [e.text for e in root.findall(".//dcc:conformity", space)] == ["pass"]
    said = [e.text for e in root.iter() if e.text]
    assert {"2025-1", "Fine.", "Measured values"} <= set(said)
    assert any(re.search("reproduced only in full", text) for text in said)


def test_a_table_without_phase_has_a_certificate():
    heads = parts.measured(table_only()).header
    assert not [head for head in heads if "phase" in head or "°" in head]
