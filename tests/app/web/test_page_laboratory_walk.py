"""A laboratory head's way by keyboard: German files, sources, fit, limits, certificate; no file of keys seen."""

from __future__ import annotations

import io

import pypdf
import pytest
from tests.support.serving import WAIT_MS, choose, field, simulated, upload

FREQUENCIES = "100,160,250,400,630"
PROFILE = {
    "Laboratory": "Labor für Schwingung",
    "Address of the laboratory": "Weg 1\n12345 Ort",
    "Approved by": "A. Berg",
    "Place": "Labor",
    "Procedure": "ISO 16063-21",
    "Traceability": "auf das SI",
}
JOB = {
    "Certificate number *": "2026-0042",
    "Date of issue *": "2026-11-24",
    "Date of calibration *": "2026-11-23",
    "Customer *": "Kunde",
    "Address of the customer *": "Gasse 2",
    "Temperature, °C *": "23",
}


def german(folder):
    """Files with decimal commas, semicolons, German headers and units."""
    files = simulated(folder, "--frequencies", FREQUENCIES)
    for file in files:
        rows = file.read_text().splitlines()[1:]
        head = "Zeit [s];Bezug Beschleunigung [m/s²];Antwort Spannung [V]"
        text = "\n".join([head, *(row.replace(",", ";").replace(".", ",") for row in rows)])
        file.write_text(text + "\n", encoding="utf-8")
    return files


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.slow
def test_from_german_files_to_a_certificate_by_keyboard(visit, sound, press, tmp_path, width):
    page = visit(width, 844)
    upload(page, *german(tmp_path / "made"))
    page.locator("#confirm").wait_for(timeout=WAIT_MS)
    field(page, "Serial number").fill("4711")
    for number, (source, kind, u) in enumerate([("Laser", "gain", "0.25"), ("Wandler", "timing", "0.5")], 1):
        press(page, "#uncertainty .q-btn:not(.q-btn--round)", "#uncertainty")
        row = page.get_by_role("group", name=f"Source {number}", exact=True)
        row.get_by_label("Source", exact=True).fill(source)
        row.get_by_label("Kind").click()
        page.get_by_role("option", name=kind, exact=True).click()
        row.get_by_label("Standard uncertainty").locator("visible=true").fill(u)
    press(page, "#laboratory-data", "#laboratory")
    for label, words in PROFILE.items():
        page.locator("#laboratory").get_by_label(label, exact=True).fill(words)
    choose(page, "Decision rule", "simple")
    press(page, "#save-profile", "#laboratory")
    page.locator("#profile-said").get_by_text("Saved as").wait_for(timeout=WAIT_MS)
    sound(page, f"walk-sources-{width}")
    page.set_viewport_size({"width": width, "height": 844})
    press(page, "#confirm", "#columns")
    press(page, "#start", "#identify")
    page.locator("#lacking").wait_for(timeout=WAIT_MS)
    press(page, "#certificate", "#result")
    page.locator("#save-certificate").wait_for(timeout=WAIT_MS)
    for label, words in JOB.items():
        field(page, label).fill(words)
    assert field(page, "Laboratory *").input_value() == PROFILE["Laboratory"]
    page.get_by_role("button", name="Add requirement").press("Enter")
    choose(page, "Quantity", "natural frequency")
    page.get_by_role("group", name="Requirement 1").get_by_label("Low limit").fill("600")
    sound(page, f"walk-certificate-{width}")
    page.set_viewport_size({"width": width, "height": 844})
    press(page, "#save-certificate", '[aria-label="Requirement 1"]')
    page.locator("#lacking").get_by_text("Nothing is missing").wait_for(timeout=WAIT_MS)
    assert ".toml" not in page.locator("body").inner_text()
    assert "[[" not in page.locator("body").inner_text()
    with page.expect_download(timeout=WAIT_MS) as waiting:
        press(page, "#get-pdf", "#result")
    assert waiting.value.suggested_filename == "certificate-4711-2026-11-23.pdf"
    with open(waiting.value.path(), "rb") as file:
        said = "\n".join(sheet.extract_text() for sheet in pypdf.PdfReader(io.BytesIO(file.read())).pages)
    assert "DRAFT" not in said
    for words in ("Labor für Schwingung", "2026-0042", "Laser", "4711"):
        assert words in said
