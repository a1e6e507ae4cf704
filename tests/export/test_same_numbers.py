"""PDF, HTML, DCC and Excel state the numbers of result.json and of the budget, to the last digit that they print."""

import io
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pypdf
import pytest
from lxml import etree
from tests.support.certified import CERTIFICATE

import vibrident
from vibrident.data.records import Calibration, ResponseTable, SystematicEffect
from vibrident.export import export
from vibrident.result import Result
from vibrident.show import certificate_tables, document, report, setting_tables
from vibrident.show.certified import certified, raised_to_measured
from vibrident.show.media import html

SPACE = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
EFFECTS = (SystematicEffect("laser", "gain", 0.002), SystematicEffect("filter", "phase", 0.003))


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    f = np.geomspace(10.0, 2000.0, 24)
    ratio = f / 900.0
    s = 0.01 / (1 - ratio**2 + 0.1j * ratio)
    u = np.full(f.size, 1e-3)
    table = ResponseTable(f, abs(s), np.angle(s), u * abs(s), u)
    made = vibrident.identify(Calibration(table=table, effects=EFFECTS, sensor={"serial_number": "1"}))
    path = replace(made, certificate=CERTIFICATE).save(tmp_path_factory.mktemp("r") / "result.json")
    return Result.load(path)


def lists(root, name):
    """The lists of numbers of a result of a DCC, by their names."""
    found = {}
    for quantity in root.findall(f".//dcc:result[@id='{name}']//dcc:quantity", SPACE):
        values = quantity.find(".//si:valueXMLList", SPACE)
        if values is not None:
            spread = quantity.find(".//si:uncertaintyXMLList", SPACE)
            found[quantity.findtext("dcc:name/dcc:content", namespaces=SPACE)] = (
                [float(text) for text in values.text.split()],
                None if spread is None else [float(text) for text in spread.text.split()],
            )
    return found


def test_dcc(result, tmp_path):
    (path,) = export(result, "dcc", tmp_path, country="DE")
    root = etree.parse(str(path)).getroot()
    result = certified(result)
    m = result.measured
    found = lists(root, "measured")
    assert found["Frequency"][0] == m.frequency_hz.tolist()
    assert found["Magnitude"] == (m.magnitude.tolist(), (2.0 * m.magnitude_uncertainty).tolist())
    assert found["Phase, lag negative"] == (m.phase_deg.tolist(), (2.0 * m.phase_deg_uncertainty).tolist())
    budget = result.settings["uncertainty_budget"]
    for name, (values, _) in lists(root, "budget").items():
        parameter = name.removeprefix("standard uncertainty of ").removesuffix(" by source")
        assert values == [row["contributions"][parameter] for row in budget]
    for real in root.findall(".//dcc:result[@id='parameters']//si:real", SPACE):
        parameter = result.parameters[real.findtext("si:label", namespaces=SPACE)]
        assert float(real.findtext("si:value", namespaces=SPACE)) == parameter.value
        assert float(real.findtext(".//si:standardUnc", namespaces=SPACE)) == parameter.standard_uncertainty


@pytest.mark.needs("excel")
def test_excel(result, tmp_path):
    import openpyxl

    (path,) = export(result, "xlsx", tmp_path)
    result = raised_to_measured(result)
    book = openpyxl.load_workbook(path)

    def column(sheet, number):
        return [row[number] for row in book[sheet].iter_rows(min_row=2, values_only=True)]

    m = result.measured
    for number, name in enumerate(("frequency_hz", "magnitude", "phase_deg", "magnitude_uncertainty")):
        assert column("measured", number) == getattr(m, name).tolist()
    assert dict(zip(column("parameters", 0), column("parameters", 1), strict=True)) == {
        name: p.value for name, p in result.parameters.items()
    }
    assert column("parameters", 3) == [p.standard_uncertainty for p in result.parameters.values()]
    budget = result.settings["uncertainty_budget"]
    assert column("budget", 6) == [row["contributions"]["sensitivity"] for row in budget]
    assert column("point_budget", 3) == result.settings["point_budget"]["sources"][1]["magnitude"]
    np.testing.assert_allclose(column("level", 1), 20 * np.log10(m.magnitude), rtol=1e-14)


@pytest.mark.needs("report")
def test_pdf_and_html(result):
    pages = pypdf.PdfReader(io.BytesIO(report.content(result, "pdf"))).pages
    printed = {
        "pdf": " ".join(" ".join(page.extract_text() for page in pages).split()),
        "html": " ".join(re.sub(r"<[^>]+>", " ", html.printed(document.report(result))).split()),
    }
    for medium, stated in (("pdf", certified(result)), ("html", raised_to_measured(result))):
        text = printed[medium]
        tables = [certificate_tables.measured(stated), certificate_tables.parameters(stated)]
        tables += [setting_tables.budget(stated), *certificate_tables.point_budgets(stated)]
        for table in tables:
            numbers = [j for j, column in enumerate(table.columns) if column.kind == "number"]
            for row in table.rows:
                assert [row[j] for j in numbers if row[j] and row[j] not in text] == [], medium
    for row, source in zip(setting_tables.budget(result).rows, result.settings["uncertainty_budget"], strict=False):
        scaled = float(row[5]) / source["contributions"]["sensitivity"]
        assert abs(np.log10(scaled) - round(np.log10(scaled))) < 0.03  # two digits, and a prefix


def test_dcclib_reads_it_back(result, tmp_path):
    """PTB's library, where it is installed: by its rules (schematron) the certificate has no error."""
    schematron = pytest.importorskip("dcclib.validation.schematron")
    (path,) = export(result, "dcc", tmp_path, country="DE")
    rules = Path(schematron.__file__).parent / "schema" / "dcc.sch"
    found = schematron.SchematronValidator.from_file(str(rules)).validate_file(str(path))
    assert [one.text for one in found.failed_assertions if one.role == "error"] == []
