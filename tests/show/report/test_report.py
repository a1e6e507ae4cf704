import json
import re
from dataclasses import replace

import pytest
from tests.support.sample_results import SAMPLES, pickup, table2, table_only, troubled
from tests.support.sources import ROOT

from vibrident.base.settings import python_word, rendered
from vibrident.base.warning_kinds import WARNINGS
from vibrident.physics.naming import parameter_name
from vibrident.result import WARNING_CODES, Result
from vibrident.show import report, words
from vibrident.show.plots import PICTURES


@pytest.mark.parametrize("sample", SAMPLES)
def test_report_holds_every_parameter_and_warning(sample):
    result = SAMPLES[sample]()
    text = report.render(result)
    for name in result.parameters:
        assert f"| {parameter_name(name).words} |" in text
    for warning in result.warnings:
        assert f"(`{warning.code}`)" in text
        assert words.explain(warning.code).meaning in text
        assert rendered(words.explain(warning.code).action, python_word) in text
        assert warning.message.replace("_", "\\_") in text
    for metric in words.METRICS.values():
        assert f"| {metric.label} |" in text
    assert "coverage factor" in text
    assert "None." in text or result.warnings


@pytest.mark.parametrize("sample", SAMPLES)
def test_report_from_json_is_the_same(sample):
    result = SAMPLES[sample]()
    assert report.render(Result.from_dict(json.loads(result.to_json()))) == report.render(result)


@pytest.mark.parametrize("sample", SAMPLES)
def test_tables_are_whole(sample):
    """Every row of a table has as many cells as its header."""
    width = None
    for line in report.render(SAMPLES[sample]()).splitlines():
        if not line.startswith("|"):
            width = None
            continue
        cells = len(re.findall(r"(?<!\\)\|", line)) - 1
        assert width in (None, cells)
        width = cells


def test_every_code_is_explained_and_none_else():
    assert set(WARNINGS) == set(WARNING_CODES)
    assert len({w.meaning for w in WARNINGS.values()}) == len(WARNING_CODES)
    page = (ROOT / "docs" / "warnings.md").read_text(encoding="utf-8")
    assert all(f"\n| *`{code}`*<!-- warnings/{code}.md --> |" in page for code in WARNINGS)
    assert words.explain("from_the_future").title == "from_the_future"


def test_report_states_conventions_and_g():
    text = report.render(table2())
    assert "lag is negative" in text
    assert "the sensitivity is 1.0203 V/g" in text
    assert "Phase" not in report.render(table_only())
    assert "V/g" not in report.render(pickup())


def test_long_tables_are_thinned():
    text = report.render(SAMPLES["dense_points"]())
    assert "Every 20th of 4000 points" in text
    assert len(text.splitlines()) < 500


def test_a_report_links_what_it_drew(tmp_path):
    (tmp_path / "signals.png").write_bytes(b"left by an earlier result")
    path = report.write(table_only(), "md", tmp_path)
    text = path.read_text(encoding="utf-8")
    assert path.name == "report.md"
    assert re.findall(r"\(<(.*?)>\)", text) == ["sensitivity.png", "deviation.png", "residuals.png"]
    assert all((tmp_path / link).is_file() for link in re.findall(r"\(<(.*?)>\)", text))


def test_links_are_file_names(tmp_path):
    for name in PICTURES:
        (tmp_path / f"{name}.png").touch()
    text = report.render(troubled(), pictures=tmp_path)
    assert set(re.findall(r"\(<(.*?)>\)", text)) == {f"{name}.png" for name in PICTURES}
    assert "](<" not in report.render(troubled())


def test_a_result_without_a_budget_has_no_empty_one():
    result = table2()
    settings = {key: value for key, value in result.settings.items() if "budget" not in key}
    assert "Uncertainty budget" not in report.render(replace(result, settings=settings))


def test_a_history_that_all_files_share_is_said_once():
    """Of 21 records made alike the same line stood 21 times."""
    files = [{"file": f"{i}.csv", "sha256": f"{i:064x}", "history": ["response: × 2 → V"]} for i in range(21)]
    result = table2()
    text = report.render(replace(result, provenance={**result.provenance, "files": files}))
    assert text.count("response: × 2 → V") == 1
    other = [*files[:-1], {**files[-1], "history": ["cut"]}]
    text = report.render(replace(result, provenance={**result.provenance, "files": other}))
    assert text.count("response: × 2 → V") == 20


def test_foreign_text_stays_text():
    text = report.render(pickup())
    assert "\\$1 & \\$2 \\| " in text  # GitHub takes what stands between dollars for a formula


def test_the_budget_and_the_settings_are_tables():
    row = {"source": "noise", "type": "A", "kind": "data", "unit": "", "contributions": {"sensitivity": 3.456e-6}}
    settings = {"uncertainty_budget": [row], "start": {"sensitivity": 0.1040031}, "coverage_factor": 1.96136873162}
    text = report.render(replace(table2(), settings=settings))
    assert "| noise | A | data | – | – | 0.0035 |" in text
    assert "| start · sensitivity | 0.104003 |" in text
    assert "| coverage factor | 1.96137 |" in text
    assert "\n- " not in text.partition("## Settings")[2]
