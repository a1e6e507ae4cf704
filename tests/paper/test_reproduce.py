"""``vibrident reproduce`` from end to end on little data: what it prints obeys its own laws; the seed repeats it."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from vibrident.app.cli.application import app
from vibrident.paper import methods, page, settings
from vibrident.paper.sections import simulated
from vibrident.paper.settings import ReproductionSettings
from vibrident.paper.training import Schedule
from vibrident.show.views import Table

SMALL = ReproductionSettings(
    seed=7,
    rate_hz=25600.0,
    samples=2600,
    schedule=Schedule(patience=40, most_epochs=8),
    rates_hz=(51200.0,),
    discretisations=("euler", "bandlimited"),
    levels=(0.01,),
    draws=2,
    residual=False,
    trial=True,
)
pytestmark = pytest.mark.slow
NUMBERS = ("rmse", "mae", "mse", "r2", "rpd")


@dataclass(frozen=True)
class Run:
    folder: Path
    document: dict[str, Any]
    printed: str
    filled: str


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("reproduction")
    text = folder / "text.md"
    text.write_text(
        "Before <!-- reproduce:begin table4 -->\nold\n<!-- reproduce:end table4 --> after\n", encoding="utf-8"
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(settings, "quick", lambda seed, data, full_range: SMALL)
        patch.delenv("VIBRIDENT_DATA", raising=False)
        command = ["reproduce", "--quick", "--out", str(folder / "out"), "--into", str(text)]
        done = CliRunner().invoke(app, command, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    document = json.loads((folder / "out" / "paper.json").read_text(encoding="utf-8"))
    return Run(folder / "out", document, done.output, text.read_text(encoding="utf-8"))


def test_metrics_obey_their_laws_in_the_document(run: Run):
    rows = [row for section in run.document["sections"] for row in section["methods"]]
    assert len(rows) == 18
    for row in rows:
        m = row["metrics"]
        assert m["mae"] <= m["rmse"]
        assert m["mse"] == pytest.approx(m["rmse"] ** 2, rel=1e-12)
        assert m["r2"] == pytest.approx(1.0 - 1.0 / m["rpd"] ** 2, abs=1e-12)


def test_metrics_obey_their_laws_as_printed(run: Run):
    text = (run.folder / "paper.md").read_text(encoding="utf-8")
    checked = 0
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) != 9 or cells[0].startswith("*") or not re.match(r"\d", cells[1]):
            continue
        rmse, mae, mse, r2, rpd = (float(cell) for cell in cells[1:6])
        assert mae <= rmse
        # Six digits are printed (R²: twelve), so each number is within 5e-6 of itself.
        assert mse == pytest.approx(rmse**2, rel=1.5e-5)
        assert r2 == pytest.approx(1.0 - 1.0 / rpd**2, abs=1e-5 / rpd**2 + 5e-12)
        checked += 1
    assert checked == 18


def test_the_network_with_physics_beats_those_without_and_exact_weights_beat_euler(run: Run):
    first = run.document["sections"][0]
    rmse = {row["name"]: row["metrics"]["rmse"] for row in first["methods"]}
    assert rmse[methods.EXACT] < 0.4 * min(rmse["GRU"], rmse["LSTM"])
    assert rmse[methods.EXACT] < 1e-4 * rmse[methods.PUBLISHED]
    deviation = first["deviations_percent"]
    assert deviation[methods.EXACT]["mean"] <= 0.005
    assert abs(deviation[methods.EXACT]["at_peak"]) <= 0.02
    euler = run.document["rates"][0]
    assert 15.0 < abs(euler["peak_percent"]) < 19.0  # 17 % at 51.2 kHz
    assert euler["errors"]["damping_ratio"] == pytest.approx(0.21, abs=0.02)


def test_the_page_is_whole_and_stands_alone(run: Run):
    names = {path.name for path in run.folder.iterdir()}
    pictures = {"figure5.png", "figure6.png", "figure7.png", "figure9-simulated.png", "rates.png", "noise.png"}
    assert names == pictures | {"paper.md", "paper.html", "paper.json"}
    html = (run.folder / "paper.html").read_text(encoding="utf-8")
    assert html.count("data-figure=") == len(pictures)
    assert not re.search(r'(src|href)="(?!data:|#)', html[: html.index("<script>")])
    for title in ("Table 1", "Table 2", "Table 3", "Table 4", "Table 5", "The paper&#x27;s claims", "Our own"):
        assert title in html
    assert "1.745e+06 mV/mm" in html  # Table 2's K as equation (3) gives it, where the paper prints 1.63e6
    assert "The paper's claims" in run.printed


def test_tables_go_between_the_marks_of_a_document(run: Run):
    assert run.filled.startswith("Before <!-- reproduce:begin table4 -->\n| method |")
    assert "old" not in run.filled
    assert run.filled.endswith("<!-- reproduce:end table4 --> after\n")


def test_a_document_without_marks_is_refused_before_anything_is_run(tmp_path: Path):
    done = CliRunner().invoke(
        app, ["reproduce", "--quick", "--into", str(tmp_path / "none.md"), "--out", str(tmp_path)]
    )
    assert done.exit_code == 2
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(Exception, match="no place for the tables"):
        page.filled("nothing", [Table((), (), name="run")], "x.md")


def test_the_same_seed_gives_the_same_numbers(run: Run):
    judge = simulated(SMALL)
    before = {row["name"]: row for row in run.document["sections"][0]["methods"]}
    for row in (methods.recurrent(judge, "gru"), methods.CLOSED[methods.EXACT](judge)):
        assert row.metrics is not None
        assert {name: getattr(row.metrics, name) for name in NUMBERS} == before[row.name]["metrics"]
        assert row.parameters == before[row.name]["parameters"]
