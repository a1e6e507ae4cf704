"""A result whose uncertainty covers scatter alone says so in every document, and is no calibration certificate."""

import io
import re
from dataclasses import replace

import pypdf
import pytest
from tests.support.sample_results import table2, table_only

from vibrident.app.web import looks
from vibrident.show import report
from vibrident.show.media import html
from vibrident.show.terminal import text

#: What u covers, and what each document says of it.
CASES = [
    (["noise"], "U covers scatter only.", ("kind gain", "kind phase")),
    (["noise", "phase"], "U covers scatter only.", ("kind gain",)),
    (["noise", "gain"], "U of the phase covers scatter only.", ("kind phase",)),
    ([], "U covers scatter only.", ("kind gain", "kind phase")),
]
DOCUMENTS = ("page", "terminal", "report", "interactive report", "first page")


def covering(result, covers):
    return replace(result, uncertainty={"covers": covers})


def first_page(result) -> str:
    return pypdf.PdfReader(io.BytesIO(report.content(result, "pdf"))).pages[0].extract_text()


def said(result, folder) -> dict[str, str]:
    """What each document says, blanks made one."""
    found = {
        "page": looks.outcome(result.save(folder / "result.json"))["verdict"],
        "terminal": text(result),
        "report": report.render(result).replace("\\", ""),
        "interactive report": html.printed(report.document.report(result)),
        "first page": first_page(result),
    }
    return {name: re.sub(r"\s+", " ", re.sub(r"<[^>]+>|\*\*", "", words)) for name, words in found.items()}


@pytest.mark.parametrize(("covers", "sentence", "to_state"), CASES)
def test_every_document_says_scatter_only_and_what_to_state(tmp_path, covers, sentence, to_state):
    result = covering(table2(), covers)
    for name, words in said(result, tmp_path).items():
        assert sentence in words, name
        assert [kind for kind in ("kind gain", "kind phase") if kind in words] == list(to_state), name
    assert "no warnings" in said(result, tmp_path)["page"]  # nothing is wrong with the data


@pytest.mark.parametrize(("covers", "_sentence", "_to_state"), CASES)
def test_such_a_document_is_a_measurement_report(tmp_path, covers, _sentence, _to_state):
    result = covering(table2(), covers)
    assert "Measurement report" in first_page(result)
    whole = "".join(page.extract_text() for page in pypdf.PdfReader(io.BytesIO(report.content(result, "pdf"))).pages)
    assert "alibration certificate" not in whole
    assert report.write(result, "pdf", tmp_path).name == "measurement-report.pdf"
    assert looks.outcome(result.save(tmp_path / "result.json"))["pdf"][0] == "Measurement report"


@pytest.mark.parametrize(
    "result",
    [
        covering(table2(), ["noise", "gain", "phase"]),
        covering(table_only(), ["noise", "gain"]),  # it has no phase
    ],
    ids=["all", "no phase"],
)
def test_with_gain_and_phase_stated_nothing_is_said_and_it_is_a_certificate(tmp_path, result):
    assert not [name for name, words in said(result, tmp_path).items() if "scatter only" in words]
    assert "Calibration certificate" in first_page(result)
    assert report.write(result, "pdf", tmp_path).name == "certificate.pdf"


def test_decays_alone_have_neither_gain_nor_phase():
    own = {"natural_frequency", "damping_ratio"}
    result = table2()
    alone = {name: p for name, p in result.parameters.items() if name in own}
    assert "scatter only" not in text(replace(covering(result, ["noise"]), parameters=alone))
