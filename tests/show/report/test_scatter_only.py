"""A result whose uncertainty covers scatter alone says so in every document, and is no calibration certificate."""

import re
from dataclasses import replace

import pypdf
import pytest
from tests.support.sample_results import table2, table_only

from vibrident.app.web import sandboxed
from vibrident.show import report
from vibrident.show.media import html
from vibrident.show.terminal import text

pytestmark = pytest.mark.usefixtures("unpainted")
#: What u covers, and what each document says of it.
CASES = [
    (["noise"], "U covers scatter only.", ("kind gain", "kind phase")),
    (["noise", "phase"], "U covers scatter only.", ("kind gain",)),
    ([], "U covers scatter only.", ("kind gain", "kind phase")),
]


def covering(result, covers):
    return replace(result, uncertainty={"covers": covers})


def said(result, folder) -> dict[str, str]:
    """What each document says, blanks made one; and the name of the PDF."""
    shown, file = sandboxed.read_outcome(result.save(folder / "result.json")), report.write(result, "pdf", folder)
    pages = [page.extract_text() for page in pypdf.PdfReader(file).pages]
    found = {
        "page": shown["verdict"],
        "terminal": text(result),
        "report": report.render(result).replace("\\", ""),
        "interactive report": html.printed(report.document.report(result)),
        "first page": pages[0],
    }
    plain = {name: re.sub(r"\s+", " ", re.sub(r"<[^>]+>|\*\*", "", words)) for name, words in found.items()}
    return plain | {"whole PDF": "".join(pages), "its name": file.name, "its title": shown["pdf"][0]}


@pytest.mark.parametrize(("covers", "sentence", "to_state"), CASES, ids=[" and ".join(case[0]) for case in CASES])
@pytest.mark.quick("noise")
def test_every_document_says_scatter_only_and_what_to_state_and_is_a_measurement_report(
    tmp_path, covers, sentence, to_state
):
    found = said(covering(table2(), covers), tmp_path)
    for name in ("page", "terminal", "report", "interactive report", "first page"):
        assert sentence in found[name], name
        told = () if name == "first page" else to_state  # a customer has no calibration file
        assert [kind for kind in ("kind gain", "kind phase") if kind in found[name]] == list(told), name
    assert "no warnings" in found["page"]  # nothing is wrong with the data
    assert "Measurement report" in found["first page"]
    assert "alibration certificate" not in found["whole PDF"]
    assert (found["its name"], found["its title"]) == ("measurement-report.pdf", "Measurement report")


def test_with_the_gain_alone_it_is_a_certificate_without_phase(tmp_path):
    """A missing source of the phase blocks the phase alone."""
    found = said(covering(table2(), ["noise", "gain"]), tmp_path)
    for name in ("page", "terminal", "report", "interactive report"):
        assert "U of the phase covers scatter only." in found[name], name
    assert "The phase is not certified" in found["first page"]
    assert "kind phase" not in found["first page"]  # a customer has no calibration file
    assert "Calibration certificate" in found["first page"]
    assert found["its name"] == "certificate.pdf"


PHASE_ALONE = (["noise", "gain"], "U of the phase covers scatter only.", ("kind phase",))


@pytest.mark.parametrize(("covers", "sentence", "to_state"), [*CASES, PHASE_ALONE])
def test_the_sentence_is_of_what_is_not_covered(covers, sentence, to_state):
    words = re.sub(r"\s+", " ", text(covering(table2(), covers)))
    assert sentence in words
    assert [kind for kind in ("kind gain", "kind phase") if kind in words] == list(to_state)


@pytest.mark.parametrize(
    "result",
    [
        covering(table2(), ["noise", "gain", "phase"]),
        covering(table_only(), ["noise", "gain"]),  # it has no phase
    ],
    ids=["all", "no phase"],
)
def test_with_gain_and_phase_stated_nothing_is_said_and_it_is_a_certificate(tmp_path, result):
    found = said(result, tmp_path)
    assert not [name for name, words in found.items() if "scatter only" in words]
    assert "Calibration certificate" in found["first page"]
    assert found["its name"] == "certificate.pdf"


def test_decays_alone_have_neither_gain_nor_phase():
    own = {"natural_frequency", "damping_ratio"}
    result = table2()
    alone = {name: p for name, p in result.parameters.items() if name in own}
    assert "scatter only" not in text(replace(covering(result, ["noise"]), parameters=alone))
