"""The form asks for known responses of the channels, and what it is told reaches calibration file and result."""

from __future__ import annotations

import json

import numpy as np
import pytest
from tests.support.known_channels import POLES, RATE_HZ, REFERENCE, SENSOR, Motion, accelerometer
from tests.support.serving import WAIT_MS, download, field, upload

from vibrident.app.web.form.description import Description, calibration_text
from vibrident.app.web.form.known import KEYS, entry_of_row, row_of_entry
from vibrident.app.web.session import PageSession, refuse_outside
from vibrident.base.errors import InputError
from vibrident.data.io.known_section import KnownResponseEntry


def test_every_key_of_the_form_is_one_of_the_file():
    assert {key.name for key in KEYS} - {"stated_as"} <= {*KnownResponseEntry.model_fields}
    corners = {"highpass_hz": [0.5], "gain": 10.0}
    assert entry_of_row(row_of_entry(corners)) == corners
    certificate = {"file": "a.csv", "magnitude_uncertainty": 4}
    assert entry_of_row(certificate) == {**certificate, "coverage_factor": 2.0}


def test_files_of_known_responses_are_no_records(tmp_path):
    session = PageSession(tmp_path, 10.0)
    for name, known in (("a.csv", False), ("certificate.csv", True), ("sensor.pz", True)):
        session.reserve_path(name, 3, is_response=known).write_text("1,2")
    assert session.files == ["a.csv"]
    assert session.known_files == ["certificate.csv", "sensor.pz"]
    again = PageSession(tmp_path, 10.0, name=session.folder.name)
    again.restore(session.state)
    assert again.files == ["a.csv"]
    chosen = Description({"reference": {"known_response": [{"file": "b.csv"}]}})
    assert chosen.pairs(["a.csv", "b.csv"]) == [("a.csv", None)]


def test_a_known_response_that_says_nothing_is_refused():
    document = {"reference": {"column": "a", "known_response": [{"gain": 2.0}]}, "response": {"column": "b"}}
    document |= {"records": {"excitation": "random"}, "sampling": {"rate_hz": 1.0}}
    with pytest.raises(InputError, match="“File” of known response 1 is empty"):
        calibration_text(Description(document), ["x.csv"])


@pytest.mark.parametrize("name", ["/etc/hostname", "../secret.csv"])
def test_a_known_response_outside_the_upload_is_refused(tmp_path, name):
    text = f'[reference]\ncolumn = 1\n[[reference.known_response]]\nfile = "{name}"\n'
    (tmp_path / "c.toml").write_text(
        text + '[response]\ncolumn = 2\n[[records]]\nfile = "a.csv"\nexcitation = "sine"\n'
    )
    with pytest.raises(InputError, match="beside the calibration file only"):
        refuse_outside(tmp_path / "c.toml")


@pytest.mark.slow
def test_a_reference_with_a_certificate_is_stated_in_the_form(visit, sound, press, tmp_path):
    motion = Motion("random", 8192, RATE_HZ, (50.0, 12000.0))
    columns = [motion.channel(accelerometer(*REFERENCE)), 10.0 * motion.channel(accelerometer(*SENSOR), noise=1e-3)]
    np.savetxt(tmp_path / "b2b.csv", np.transpose(columns), delimiter=",", header="reference,response", comments="")
    hz = np.geomspace(30.0, 20000.0, 300)
    value = accelerometer(*REFERENCE)(hz)
    rows = [hz, np.abs(value), np.rad2deg(np.angle(value)), 0.005 * np.abs(value)]
    header = "frequency / Hz,magnitude,phase / deg,U"
    np.savetxt(tmp_path / "certificate.csv", np.transpose(rows), delimiter=",", header=header, comments="")
    constant = REFERENCE[0] * (2.0 * np.pi * REFERENCE[1]) ** 2
    (tmp_path / "sensor.pz").write_text(
        "POLES 2\n" + "".join(f"{pole.real} {pole.imag}\n" for pole in POLES) + f"ZEROS 0\nCONSTANT {constant}\n"
    )
    page = visit()
    upload(page, tmp_path / "b2b.csv")
    page.locator("#columns .js-plotly-plot").wait_for(timeout=WAIT_MS)
    field(page, "Sampling rate, Hz").fill("51200")
    press(page, "#more-keys", "#columns")
    files = [str(tmp_path / name) for name in ("certificate.csv", "sensor.pz")]
    page.locator("#known-files input[type=file]").set_input_files(files)
    page.get_by_text("sensor.pz").first.wait_for(timeout=WAIT_MS)
    page.locator("#known-reference").get_by_role("button", name="Add known response").press("Enter")
    row = page.locator("#known-reference").get_by_role("group", name="Known response 1")
    row.get_by_label("File", exact=True).click()
    page.get_by_role("option", name="certificate.csv", exact=True).click()
    named = {
        "Frequency: column": "1",
        "Magnitude: column": "2",
        "Phase: column": "3",
        "U of the magnitude: column": "4",
    }
    for label, text in named.items():
        row.get_by_label(label, exact=True).fill(text)
    page.locator("#known-response").get_by_role("button", name="Add known response").press("Enter")
    other = page.locator("#known-response").get_by_role("group", name="Known response 1")
    other.get_by_label("Stated", exact=True).click()
    page.get_by_role("option", name="as corners of a conditioner", exact=True).click()
    other.get_by_label("High-pass corner, Hz").fill("0.001")
    other.get_by_label("Gain between the corners").fill("10")
    sound(page, "known")
    page.locator("#confirm").press("Enter")
    page.locator("#start").wait_for(timeout=WAIT_MS)
    page.get_by_text("The calibration file: as confirmed above").click()
    text = page.locator("#calibration-text .plain").text_content()
    assert '[[reference.known_response]]\nfile = "certificate.csv"' in text
    assert "coverage_factor = 2.0" in text
    assert "highpass_hz = [" in text
    assert text.count("[[records]]") == 1
    page.locator("#start").press("Enter")
    page.locator("#result .js-plotly-plot").first.wait_for(timeout=4 * WAIT_MS)
    result = json.loads(download(page, "json"))
    assert [known["channel"] for known in result["settings"]["known_responses"]] == ["reference", "response"]
    sensitivity = result["parameters"]["sensitivity"]
    assert sensitivity["value"] == pytest.approx(SENSOR[0], abs=3.0 * sensitivity["standard_uncertainty"])
    assert sensitivity["standard_uncertainty"] == pytest.approx(0.0025 * SENSOR[0], rel=0.05)
