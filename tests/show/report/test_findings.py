"""What departs from a fit is shown in every medium, and nothing where nothing departs."""

import io
from dataclasses import replace

import pypdf
import pytest
from tests.support.report_page import read
from tests.support.sample_results import table2

from vibrident.result import Finding, ResultWarning
from vibrident.show import findings, report, terminal

pytestmark = pytest.mark.usefixtures("unpainted")
NASTY = "<b>a|b</b> [bold]#x"


def finding(code="drift", record="100_Hz.csv", time_s=None, probability=3.2e-9, in_u=0.31, said="The response drifts."):
    """One that moves the damping ratio, and the sensitivity by half as much of its u."""
    parameters = table2().parameters
    impact = {"sensitivity": 0.5 * in_u, "damping_ratio": -in_u}
    impact = {name: size * parameters[name].standard_uncertainty for name, size in impact.items()}
    where = "" if record is None else f"{record}: "
    message = f"{where}{said} Without it the damping ratio would be 0.2 in place of 0.1 ({in_u} u)."
    return Finding(code, record, time_s, probability, impact, message)


def departing(*found):
    return replace(table2(), findings=found)


BOTH = departing(finding(time_s=1.25), finding("nonlinear", None, None, 0.0, 0.6, "The sensor adds harmonics."))


def flat(text):
    return " ".join(text.split())


def test_the_table_says_what_where_how_probable_and_how_far():
    table = findings.table(BOTH)
    assert table.header == ("what", "record", "time / s", "probability", "largest impact")
    assert table.rows == (
        ("The response drifts.", "100_Hz.csv", "1.25", "3·10⁻⁹", "0.31 u of the damping ratio"),
        ("The sensor adds harmonics.", "all", "", "<1·10⁻⁹⁹", "0.6 u of the damping ratio"),
    )
    assert "time / s" not in findings.table(departing(finding())).header


def test_a_long_table_is_cut_and_says_so():
    many = [finding(record=f"{i}.csv") for i in range(findings.MAX_TABLE_ROWS + 7)]
    table = findings.table(departing(*many))
    assert len(table.rows) == findings.MAX_TABLE_ROWS
    assert table.notes[0] == "and 7 more, listed in result.json"


def test_without_a_stated_u_there_is_no_impact():
    result = departing(replace(finding(), impact={"unheard_of": 1.0}))
    assert findings.table(result).rows[0][-1] == "no u is stated"
    assert "1 finding without a warning:" in terminal.text(result)


def test_the_summary_names_them_in_one_paragraph():
    text = flat(terminal.text(BOTH))
    assert text.endswith(
        "2 findings that move no parameter by its u: 100_Hz.csv: The response drifts (0.31 u of the damping ratio). "
        "The sensor adds harmonics (0.6 u of the damping ratio)."
    )
    assert "probability" not in text


def test_the_summary_says_alike_ones_once():
    text = flat(terminal.text(departing(*(finding(record=f"{i}.csv", in_u=0.1 * i) for i in range(1, 5)))))
    assert "4 findings that move no parameter by its u: 4.csv: The response drifts (0.4 u of" in text
    assert text.endswith(", and 3 more like it.")
    codes = ("drift", "nonlinear", "regimes", "clipped", "aliasing")
    text = flat(terminal.text(departing(*(finding(code) for code in codes))))
    assert text.endswith("And 2 more kinds.")


def test_the_summary_does_not_repeat_what_a_warning_says():
    first = BOTH.findings[0]
    result = replace(BOTH, warnings=(ResultWarning(first.code, first.message),))
    text = flat(terminal.text(result))
    assert text.count("The response drifts.") == 1
    assert "1 finding that moves no parameter by its u: The sensor adds" in text
    result = replace(result, findings=(first,))
    assert "finding" not in terminal.text(result)
    assert len(findings.table(result).rows) == 1


def test_one_that_moves_a_parameter_by_its_u_is_not_belittled():
    text = terminal.text(departing(finding(in_u=3.0)))
    assert "1 finding without a warning:" in text
    assert "no parameter" not in text


@pytest.mark.parametrize("form", ["html", "md", "pdf"])
def test_every_report_has_the_table(form):
    content = report.content(BOTH, form)
    if form == "html":
        assert read(BOTH).table("what", "record", "time / s")[0][1] == "100_Hz.csv"
        assert b'id="findings"' in content
    elif form == "md":
        text = content.decode()
        assert "## Warnings\n\nNone.\n\n## Findings\n\n| what | record |" in text
        assert "| The response drifts. | 100\\_Hz.csv | 1.25 | 3·10⁻⁹ | 0.31 u of the damping ratio |" in text
    else:
        text = flat(" ".join(page.extract_text() for page in pypdf.PdfReader(io.BytesIO(content)).pages))
        assert "Findings what record time / s probability largest impact The response drifts. 100_Hz.csv" in text


def test_a_notebook_has_the_line_and_the_table():
    html = BOTH._repr_html_()
    assert "2 findings that move no parameter by its u:" in html
    assert "<summary>Findings (2)</summary>" in html


def test_nothing_is_said_where_nothing_departs():
    clean = table2()
    assert findings.describe_findings(clean) == ()
    assert findings.table(clean) is None
    texts = (terminal.text(clean), report.render(clean), report.content(clean, "html").decode(), clean._repr_html_())
    assert not any("Finding" in text or "a finding" in text for text in texts)


def test_text_of_others_is_text():
    result = departing(finding(record=NASTY, said=NASTY))
    assert NASTY in flat(terminal.text(result))
    for text in (report.content(result, "html").decode(), result._repr_html_()):
        assert "<b>a|b" not in text
        assert "&lt;b&gt;a|b" in text
    rows = [line for line in report.render(result).splitlines() if "3·10⁻⁹" in line]
    assert "<b>" not in rows[0]
    assert rows[0].replace("\\|", "").count("|") == 5  # four columns
    assert report.content(result, "pdf").startswith(b"%PDF")
