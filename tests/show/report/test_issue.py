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
from tests.support.printed import assert_rounded, factor_to
from tests.support.sample_results import table2, table_only

import vibrident.show
from vibrident.base.errors import InputError
from vibrident.data.io.certificate import CertificateSection, certificate_data, certificate_section
from vibrident.show import certificate, report
from vibrident.show import certificate_tables as parts
from vibrident.show.issue import REQUIRED, form, issued, missing
from vibrident.show.language import Say
from vibrident.show.media import pdf
from vibrident.show.numbers import sensitivity_scale
from vibrident.use.conformity import accepted, judged, probability_of_conformance

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
    return [" ".join(page.extract_text().split()) for page in pypdf.PdfReader(io.BytesIO(content)).pages]


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
    rule, table = parts.conformity(result)
    assert "guarded" in rule.text
    assert [row[-1] for row in table.rows] == ["met", "not met"]
    certain = {"quantity": "natural_frequency", "low": 1.0}
    one_sided = replace(result, certificate={**result.certificate, "requirements": [certain]})
    assert parts.conformity(one_sided)[1].rows[0][1] == "≥ 1"
    assert parts.conformity(one_sided)[1].rows[0][5] == "> 99.99 %"
    scatter = replace(result, uncertainty={"covers": ["noise"]})
    (sentence,) = parts.conformity(scatter)
    assert "No statement of conformity" in sentence.text
    unknown = replace(result, certificate={"requirements": [{"quantity": "mass", "low": 1.0}]})
    with pytest.raises(InputError, match="natural_frequency"):
        judged(unknown, None, None)


def test_before_and_after_adjustment(tmp_path):
    before = replace(
        table2(),
        parameters={n: replace(p, value=p.value * 1.01) for n, p in table2().parameters.items()},
    ).save(tmp_path / "before.json")
    result, issue = issued(full(table2()), [file(tmp_path, WHOLE + f'before = "{before.name}"\n')])
    rows = {row[0]: row for row in parts.adjustment(result, issue.before).rows}
    assert rows["natural frequency"][-1] == "−0.99 %"
    assert "Before and after adjustment" in " ".join(pages(report.content(result, "pdf", issue=issue)))


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
    numbers = {row[2] for row in parts.measured(result).rows}
    assert [number for number in numbers if number not in " ".join(found)] == []


def test_chinese_needs_a_font_and_says_so(tmp_path, monkeypatch):
    """As the second language too: without, each of its letters was an empty box."""
    second, _ = issued(full(table2()), [file(tmp_path, WHOLE + 'language = "de"\nsecond_language = "zh"\n')])
    result, _ = issued(full(table2()), [file(tmp_path, WHOLE + 'language = "zh"\n')])
    assert certificate.title(result, Say.of(result)) == "校准证书"
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
    assert shell.run("report", result, "--format", "pdf", "--certificate", given).exit_code == 0
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
