"""A certificate is filled in on the page after the fit: what is missing, what is stated, and what is remembered."""

from __future__ import annotations

import io
import zipfile
from dataclasses import replace
from pathlib import Path

import pypdf
import pytest
from tests.support.sample_results import table2
from tests.support.serving import WAIT_MS, choose, download, field, upload
from tests.support.shell import printed

LOGO = b'<svg xmlns="http://www.w3.org/2000/svg" width="40" height="20"><rect width="40" height="20"/></svg>'
STATED = {
    "Serial number *": "ACS_001",
    "Certificate number *": "2026-CALS_0042",
    "Date of issue *": "2026-11-24",
    "Date of calibration *": "2026-11-23",
    "Customer *": "C. <b>Kunde</b>",
    "Address of the customer *": "Gasse 2",
    "Temperature, °C *": "23.1",
    "Remarks": "one\ntwo",
}
#: What is in the profile, and on each certificate.
LABORATORY = {
    "Laboratory": "Labor für Schwingung",
    "Address of the laboratory": "Weg 1\n12345 Ort",
    "Approved by": "A. Berg",
    "Place": "laboratory",
    "Procedure": "ISO 16063-11, method 3",
    "Traceability": "to the SI",
}


@pytest.fixture
def results(tmp_path) -> list[Path]:
    """Two results whose U covers gain and phase too."""
    made = replace(table2(), uncertainty={"covers": ["noise", "gain", "phase"]})
    return [replace(made, provenance={"time": day}).save(tmp_path / f"{day}.json") for day in ("first", "second")]


def opened(page):
    page.locator("#lacking").wait_for(timeout=WAIT_MS)
    page.get_by_text("What the certificate states").click()
    page.locator("#save-certificate").wait_for(timeout=WAIT_MS)


def text(pdf: bytes) -> str:
    return "\n".join(sheet.extract_text() for sheet in pypdf.PdfReader(io.BytesIO(pdf)).pages)


@pytest.mark.slow
def test_a_certificate_is_filled_in_after_the_fit_and_the_laboratory_is_remembered(visit, sound, results, tmp_path):
    page = visit()
    upload(page, results[0])
    page.locator("#lacking").wait_for(timeout=WAIT_MS)
    assert "draft until these are stated: Certificate number, Laboratory" in page.locator("#lacking").inner_text()
    assert "DRAFT" in text(download(page, "pdf"))
    profile_saved(page, sound)
    opened(page)
    assert field(page, "Laboratory *").input_value() == LABORATORY["Laboratory"]
    for label, words in STATED.items():
        field(page, label).fill(words)
    page.get_by_role("button", name="Add requirement").press("Enter")
    choose(page, "Quantity", "natural frequency")
    page.get_by_role("group", name="Requirement 1").get_by_label("Low limit").fill("600")
    sound(page, "certificate")
    page.locator("#save-certificate").press("Enter")
    page.get_by_text("Saved: reports").wait_for(timeout=WAIT_MS)
    assert page.locator("#lacking").inner_text() == "Nothing is missing in the PDF."

    issued = download(page, "pdf")
    said = text(issued)
    assert "DRAFT" not in said
    for words in (*STATED.values(), *LABORATORY.values(), "Laser vibrometer", "Kalibrierschein"):
        assert all(line in said for line in words.split("\n")) or words in ("2026-11-24", "2026-11-23"), words
    (tmp_path / "certificate.toml").write_bytes(download(page, "certificate-toml"))
    (tmp_path / "logo.svg").write_bytes(LOGO)
    (tmp_path / "logo.toml").write_text('[certificate]\nlogo = "logo.svg"\n')
    both = ("--certificate", "certificate.toml", "--certificate", "logo.toml")
    printed("report", "first.json", "--format", "pdf", *both, "--out", "shell", folder=tmp_path)
    (written,) = (tmp_path / "shell").glob("*.pdf")
    assert text(written.read_bytes()) == said
    page.reload()
    opened(page)
    assert field(page, "Certificate number *").input_value() == "2026-CALS_0042"
    upload(page, results[1])
    page.get_by_text("The PDF is a draft").wait_for(timeout=WAIT_MS)
    opened(page)
    assert field(page, "Laboratory *").input_value() == LABORATORY["Laboratory"]
    assert field(page, "Certificate number *").input_value() == ""


def profile_saved(page, sound) -> None:
    """Fill in and save the laboratory's profile; what is not allowed is refused in words."""
    page.get_by_text("Name, address, instruments, logo").click()
    for label, words in LABORATORY.items():
        page.locator("#laboratory").get_by_label(label, exact=True).fill(words)
    page.get_by_role("button", name="Add instrument").press("Enter")
    instrument = page.get_by_role("group", name="Instrument 1")
    instrument.get_by_label("Name").fill("Laser vibrometer")
    instrument.get_by_label("Calibrated until").fill("2999-12-31")
    choose(page, "Second language", "German")
    field(page, "Country").fill("Germany")
    page.locator("#save-profile").press("Enter")
    alert = page.locator("#laboratory").get_by_role("alert")
    alert.wait_for(timeout=WAIT_MS)
    assert "two capitals (ISO 3166-1), such as DE" in alert.inner_text()
    field(page, "Country").fill("DE")
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Choose the logo").click()
    chooser.value.set_files({"name": "logo.svg", "mimeType": "image/svg+xml", "buffer": LOGO})
    page.get_by_text("The logo is here.").wait_for(timeout=WAIT_MS)
    sound(page, "laboratory")
    page.locator("#save-profile").press("Enter")
    page.locator("#profile-said").get_by_text("Saved as “Labor für Schwingung”").wait_for(timeout=WAIT_MS)


@pytest.mark.slow
def test_a_certificate_before_and_after_adjustment_is_among_everything(visit, results):
    page = visit()
    upload(page, *results)
    page.locator("#compare").wait_for(timeout=WAIT_MS)
    opened(page)
    field(page, "Certificate number *").fill("2026-CALS_0042")
    choose(page, "Before adjustment", "first")
    page.locator("#save-certificate").press("Enter")
    page.get_by_text("Saved: reports").wait_for(timeout=WAIT_MS)
    said = text(download(page, "pdf"))
    assert "Before and after adjustment" in said
    assert "DRAFT" in said
    with zipfile.ZipFile(io.BytesIO(download(page, "everything"))) as packed:
        assert text(packed.read("certificate.pdf")) == said
        assert b"2026-CALS_0042" in packed.read("certificate.toml")


@pytest.mark.slow
def test_the_laboratorys_own_template_is_chosen_and_removed(visit, results):
    """It reads no file of the server, and typst fetches nothing for it."""
    page = visit()
    upload(page, results[0])
    page.get_by_text("Name, address, instruments, logo").click(timeout=WAIT_MS)
    own = "#let doc = json(bytes(sys.inputs.document))\nOwn form of #doc.title.words"
    for template, said in (
        (own, ""),
        ('#read("/etc/passwd")', "template"),
        ('#import ("@preview" + "/a:1.0.0"): *', "Connection refused"),
    ):
        with page.expect_file_chooser() as chooser:
            page.get_by_role("button", name="Choose the template").click()
        chooser.value.set_files({"name": "own.typ", "mimeType": "text/plain", "buffer": template.encode()})
        page.get_by_text("The template is here.").wait_for(timeout=WAIT_MS)
        page.locator("#get-pdf").wait_for(timeout=WAIT_MS)
        if not said:
            assert text(download(page, "pdf")).startswith("Own form of Calibration certificate")
            continue
        page.wait_for_timeout(500)
        page.locator("#get-pdf").click()
        alert = page.get_by_role("alert").filter(has_text="own template or logo")
        alert.wait_for(timeout=WAIT_MS)
        assert said in alert.inner_text()
    page.get_by_role("button", name="Remove the template").click()
    page.get_by_text("The template is here.").wait_for(state="hidden")
    assert "DRAFT" in text(download(page, "pdf"))
