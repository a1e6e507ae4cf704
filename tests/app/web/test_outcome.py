"""What the page shows of a result, as HTML."""

from dataclasses import replace

from tests.support.sample_results import table2

from vibrident.app.web import sandboxed
from vibrident.data.io.certificate import CertificateData
from vibrident.result import Finding


def test_findings_are_shown_beside_the_warnings_and_nothing_where_there_are_none(tmp_path):
    clean = table2()
    assert sandboxed.read_outcome(clean.save(tmp_path / "clean.json"))["warnings"] == ""
    u = clean.parameters["sensitivity"].standard_uncertainty
    message = "a.csv: The response <i>drifts</i>. Without it the sensitivity would be 1 V in place of 2 V (0.3 u)."
    result = replace(clean, findings=(Finding("drift", "a.csv", None, 1e-7, {"sensitivity": 0.3 * u}, message),))
    shown = sandboxed.read_outcome(result.save(tmp_path / "found.json"))["warnings"]
    assert "1 finding that moves no parameter by its u:" in shown
    assert "<summary>Findings (1)</summary>" in shown
    assert "<td>0.3 u of the sensitivity</td>" in shown
    assert "<i>" not in shown


def test_exports_state_what_was_stated_after_the_fit(tmp_path):
    path = table2().save(tmp_path / "result.json")
    words = {"number": "2026-CALS_0042", "laboratory": "L", "customer": "C", "approved_by": "A", "country": "DE"}
    stated = CertificateData({**words, "date_of_calibration": "2026-11-23"}, {"serial_number": "ACS_001"})
    made, name = sandboxed.write_export(path, tmp_path / "made", "dcc", {}, stated)
    assert name.endswith(".xml")
    assert b"2026-CALS_0042" in made
    assert b"ACS_001" in made
