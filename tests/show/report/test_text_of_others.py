"""Numbers and names that others gave are read back letter by letter from every document: nothing in them is typeset."""

import html
import io
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pypdf
import pytest
from markdown_it import MarkdownIt
from tests.support.certified import certified, written
from tests.support.exported import paper
from tests.support.printed import CERTIFICATE
from tests.support.sample_results import table2

from vibrident.result import ResultWarning
from vibrident.show import report
from vibrident.show.media import charts, fonts
from vibrident.show.views import Axis, Figure, Panel, Series, Stack

#: What looks like a formula, a unit, a number or markup, and is none.
IDENTIFIERS = (
    *("2026-CALS_0042", "ACS_001", "Messung_20Hz.csv", "f_n", "S_0", "E_n", "x_f_n", "f_n-2", "(S_0)", "k_3.csv"),
    *("e^{jωt}", "ν_eff", "U_first", "__init__", "*bold*", "_it_", "~~no~~", "`code`", "a|b", "[x](y)"),
    *("<b>x</b>", "&amp;", "&lt;3", "$x^2$", "#eval(1)", "\\alpha", '"quoted"', "don't--do", "a---b...", "10^-3"),
    *("m/s^2", "5*3", "100 %", "+0.0e-6", "%{x}", "https://a.b/c_0", "@label", "=SUM(A1)", "//no", "/*no*/"),
)
SHORT = IDENTIFIERS[:8]


def holding(result):
    """The result with each identifier in a row of its own wherever others give names."""
    instruments = [{"name": f"instrument {i}", "serial_number": name} for i, name in enumerate(IDENTIFIERS)]
    files = [{"file": name, "sha256": "0" * 64} for name in IDENTIFIERS]
    stated = {**CERTIFICATE, **result.certificate, "instruments": instruments, "remarks": list(IDENTIFIERS)}
    warnings = tuple(ResultWarning("clipped", name) for name in IDENTIFIERS)
    return replace(result, certificate=stated, provenance={**result.provenance, "files": files}, warnings=warnings)


def named(result, name):
    """The result with this identifier in the places that a document has once."""
    keys = ("number", "laboratory", "laboratory_address", "customer", "order_number", "traceability", "operator")
    sensor = dict.fromkeys(("manufacturer", "type", "serial_number"), name)
    return replace(result, sensor=sensor, certificate={**CERTIFICATE, **dict.fromkeys(keys, name)})


def solid(text: str) -> str:
    """Without blanks and ends of lines: a PDF breaks a long name."""
    return re.sub(r"\s", "", text)


def in_pdf(result) -> list[str]:
    return [solid(page.extract_text()) for page in pypdf.PdfReader(io.BytesIO(report.content(result, "pdf"))).pages]


class Texts(HTMLParser):
    """The texts between the tags."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.feed(re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL))

    def handle_data(self, data: str) -> None:
        self.found.append(data)


def test_there_are_forty():
    assert len(set(IDENTIFIERS)) == 40


def test_pdf():
    text = "".join(in_pdf(holding(table2())))
    tables = [f"instrument{i}{solid(name)}" for i, name in enumerate(IDENTIFIERS)]
    assert [row for row in tables if row not in text] == []
    files = [solid(name) + "0" * 64 for name in IDENTIFIERS[:30]]
    assert [row for row in files if row not in text] == []
    remarks = "".join(map(solid, IDENTIFIERS))
    assert remarks in re.sub(r"Calibrationcertificate:.*?Page\d+of\d+|Evaluatedwith.*?stated\.", "", text)


@pytest.mark.parametrize("name", SHORT)
@pytest.mark.quick("2026-CALS_0042", "f_n")
def test_pdf_has_the_number_and_the_sensor_on_every_page(name):
    pages = in_pdf(named(table2(), name))
    assert all(f"No.{name}" in page and f"{name}{name}No.{name}" in page for page in pages)
    assert all(f"{label}{name}" in pages[0] for label in ("Manufacturer", "Serialnumber", "Customer", "Ordernumber"))


def test_html():
    page = report.content(holding(table2()), "html").decode()
    body = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    cells = re.findall(r"<td[^>]*>(.*?)</td>", body, re.DOTALL)
    paragraphs = re.findall(r"<p[^>]*>(.*?)</p>", body, re.DOTALL)
    for parts in (cells, paragraphs):
        assert set(IDENTIFIERS) <= {html.unescape(part) for part in parts}


@pytest.mark.parametrize("name", SHORT)
def test_html_of_one_sensor(name):
    found = Texts(report.content(named(table2(), name), "html").decode()).found
    assert f"Calibration of {name} {name} no. {name}" in found
    assert found.count(name) >= 10


def test_markdown():
    reader = MarkdownIt("commonmark").enable(["table", "strikethrough"])
    page = reader.render(report.render(holding(table2())))
    cells = re.findall(r"<td[^>]*>(.*?)</td>", page)
    quoted = re.findall(r"<p>(.*?)</p>", "".join(re.findall(r"<blockquote>.*?</blockquote>", page, re.DOTALL)))
    for parts in (cells, quoted):
        assert set(IDENTIFIERS) <= {html.unescape(part) for part in parts}


def test_dcc(tmp_path):
    root = written(holding(certified(paper())), tmp_path)
    texts = [element.text for element in root.iter() if element.text]
    assert {name: texts.count(name) for name in IDENTIFIERS if texts.count(name) < 3} == {}


@pytest.mark.parametrize("name", IDENTIFIERS)
def test_figures(name):
    axis = Axis(name, 0.0, 1.0, ((0.5, name),))
    series = Series(np.array([0.0, 1.0]), np.array([0.0, 1.0]), label=name)
    figure = Figure("figure", name, (Stack((Panel(axis, axis, (series,), title=name),), title=name),))
    assert fonts.printable(name) == name
    ((_, chart),) = charts.charts(figure)
    layout = chart["layout"]
    said = (chart["data"][0]["name"], layout["xaxis"]["title"]["text"], layout["annotations"][0]["text"])
    assert {html.unescape(text) for text in said} == {name}
