"""Fifty drawn certificates say in PDF, DCC and HTML what result.json says, in their language and in no other."""

from __future__ import annotations

import io
import json
import re
import tomllib
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from unittest.mock import MagicMock, patch

import numpy as np
import pypdf
import pytest
import typst
from lxml import etree
from tests.support.lives import STATED
from tests.support.printed import PROGRAM_WORDS, assert_rounded, factor_to
from tests.support.sample_results import pickup, table2, table_only

import vibrident.show
from vibrident.export import export
from vibrident.physics.naming import parameter_name
from vibrident.result import Curve, MeasuredCurve, Result
from vibrident.show import certificate_decisions, document, report, tables
from vibrident.show import certificate_tables as parts
from vibrident.show.certificate import certificate
from vibrident.show.certified import certified, raised_to_measured, stated_parameters
from vibrident.show.issue import Issue, missing
from vibrident.show.language import Translator
from vibrident.show.media import html, pdf
from vibrident.show.numbers import sensitivity_scale
from vibrident.show.views import Figure, Folded

pytestmark = pytest.mark.usefixtures("unpainted")
FOLDER = Path(vibrident.show.__file__).parent / "languages"
LANGUAGES = ("en", "de", "fr", "zh")
SPACE = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
COUNT = 50
QUICK = 12  # sensors and languages are met after twelve
#: Pictures of a report, which take long and say nothing in words.
DRAWN = ("sensitivity", "deviation", "signals", "residuals", "training")


@dataclass(frozen=True)
class Drawn:
    """A certificate to be issued."""

    result: Result
    issue: Issue
    say: Translator


def drawn(seed: int) -> Drawn:
    """Draw sensor, points, language, quantities, limits, amendment, adjustment and verdict."""
    rng = np.random.default_rng(seed)
    base = (table2, pickup, table_only)[seed % 3]()
    first = LANGUAGES[seed // 3 % 4]
    second = rng.choice(LANGUAGES) if rng.random() < 0.3 else first
    stated = {**STATED, **LABORATORY, "language": first, "second_language": str(second)}
    stated |= {"temperature_uncertainty_c": 0.5} if rng.random() < 0.5 else {}
    stated |= {"budget": "leave out"} if rng.random() < 0.5 else {}
    if rng.random() < 0.3:
        stated["quantities"] = ["magnitude"]
    if rng.random() < 0.3:
        stated |= {"replaces": "2025-0007", "changes": ["7"]}
    if rng.random() < 0.5:
        stated["decision_rule"] = str(rng.choice(["simple", "guarded"]))
        stated["requirements"] = [{"quantity": "natural_frequency", "low": 0.1, "high": 640.0 * rng.random()}]
        stated["requirements"] += [{"quantity": "sensitivity_deviation", "low": -9.0, "high": 9.0, "to_hz": 300.0}]
    every = int(rng.integers(2, 5))
    places = np.arange(0, base.measured.frequency_hz.size, every)
    result = replace(
        base,
        sensor={"manufacturer": "Y", "type": "Z-9", "serial_number": str(rng.integers(1, 9999)), "axis": "x"},
        certificate=stated,
        measured=scaled(base.measured, 1.0 + 0.01 * rng.normal(), places),
        response=scaled(base.response, 1.0, np.arange(0, base.response.frequency_hz.size, 5)),
        fit=replace(base.fit, adequate=bool(rng.random() > 0.15)),
        settings={"uncertainty_budget": BUDGET, "uncertainty_covers": "noise; calibration of the reference (gain)"},
        provenance={"files": [{"file": "1.csv", "sha256": "0" * 64}]},
        signals=(),
        training=None,
        weights={},
    )
    result = Result.from_dict(json.loads(result.to_json()))
    before = None
    if rng.random() < 0.4:
        values = {n: replace(p, value=p.value * (1 + 0.02 * rng.normal())) for n, p in result.parameters.items()}
        before = replace(result, parameters=values, measured=scaled(result.measured, 1.01))
    return Drawn(result, Issue(before=before), Translator.from_result(result))


LABORATORY = {
    "number": "2026-0042",
    "date_of_calibration": "2026-03-01",
    "date_of_issue": "2026-03-02",
    "approved_by": "B. H.",
    "place": "X",
    "procedure": "ISO 16063-11",
    "traceability": "SI",
}
BUDGET = [
    {
        **{"source": source, "type": "B", "kind": kind, "standard_uncertainty": u, "unit": "1"},
        **{"degrees_of_freedom": None, "contributions": {"natural_frequency": 0.01}},
    }
    for source, kind, u in (("noise", "data", None), ("calibration of the reference", "gain", 0.001))
]


def scaled(curve: Curve, factor: float, places: np.ndarray | None = None) -> Curve:
    """Return a curve with another gain, at some of its points."""
    kept = np.arange(curve.frequency_hz.size) if places is None else places
    columns = {name: each[kept] for name, each in vars(curve).items() if isinstance(each, np.ndarray) and each.size}
    for name in ("magnitude", "magnitude_uncertainty"):
        columns[name] = columns[name] * factor
    if isinstance(curve, MeasuredCurve):
        columns["record"] = tuple(curve.record[i] for i in kept)
    return replace(curve, **columns)


def numbers_of(table) -> list[tuple[str, ...]]:
    """Return the cells of a table's columns of numbers, row by row."""
    columns = [j for j, column in enumerate(table.columns) if column.kind == "number"]
    return [tuple(row[j] for j in columns) for row in table.rows]


def require_cells(table, text: str, say: Translator) -> None:
    """Every number of a table stands in a text, with the document's decimal sign."""
    cells = {say.number(cell) for row in numbers_of(table) for cell in row if cell}
    squeezed = re.sub(r"\s", "", text)
    assert [cell for cell in cells if re.sub(r"\s", "", cell) not in squeezed] == []


def require_rounded(shown: Result) -> None:
    """The printed measured values and parameters are the result's own, rounded."""
    points, unit = shown.measured, sensitivity_scale(shown).unit
    factor = factor_to(unit, shown.response_unit + "/" + ("(m/s)" if "(m/s)" in unit else "(m/s^2)"))
    for i, row in enumerate(parts.measured(shown).rows):
        assert_rounded(row[1], points.frequency_hz[i])
        assert_rounded(row[2], points.magnitude[i], factor)
        if np.isfinite(points.magnitude_uncertainty[i]):
            assert_rounded(row[3], 2 * points.magnitude_uncertainty[i], factor)
        if np.isfinite(points.phase_deg).any():
            assert_rounded(row[-2], points.phase_deg[i])
    rows = {str(row[0]): row for row in parts.parameters(shown).rows}
    for name, parameter in stated_parameters(shown).parameters.items():
        _, _, value, u, expanded, printed_unit, _ = rows[parameter_name(name).words]
        of_unit = factor_to("" if printed_unit == "1" else printed_unit, parameter.unit)
        assert_rounded(value, parameter.value, of_unit)
        assert_rounded(u, parameter.standard_uncertainty, of_unit)
        assert_rounded(expanded, 2 * parameter.standard_uncertainty, of_unit)


def require_same_in_dcc(root, shown: Result) -> None:
    """The digital certificate has every number of the result, unrounded."""
    for key, curve in (("response", shown.response), ("measured", shown.measured)):
        lists = root.findall(f".//dcc:result[@id='{key}']//si:realListXMLList", SPACE)
        values = [[float(each) for each in one.findtext("si:valueXMLList", namespaces=SPACE).split()] for one in lists]
        expected = [curve.frequency_hz, curve.magnitude]
        expected += [curve.phase_deg] if curve.phase_deg.size and np.isfinite(curve.phase_deg).all() else []
        assert values == [column.tolist() for column in expected if column.size]
    found = {}
    for real in root.findall(".//dcc:result[@id='parameters']//si:real", SPACE):
        value, u = (real.findtext(f".//si:{tag}", namespaces=SPACE) for tag in ("value", "standardUnc"))
        found[real.findtext("si:label", namespaces=SPACE)] = (float(value), float(u))
    parameters = stated_parameters(shown).parameters
    assert found == {name: (each.value, each.standard_uncertainty) for name, each in parameters.items()}


@cache
def words_of(code: str) -> frozenset[str]:
    """Return all words of a language's file."""
    texts = tomllib.loads((FOLDER / f"{code}.toml").read_text(encoding="utf-8"))
    values = " ".join(text for section in texts.values() for text in section.values())
    return frozenset(re.findall(r"[a-zà-ÿœ]{3,}", values.lower()))


@cache
def english_words() -> frozenset[str]:
    """Return the words of the English file, and the English of what other parts write."""
    known = " ".join(tomllib.loads((FOLDER / "de.toml").read_text(encoding="utf-8"))["known"])
    return words_of("en") | frozenset(re.findall(r"[a-z]{3,}", known.lower()))


def foreign(text: str, codes: tuple[str, ...]) -> list[str]:
    """Return English words in a document of other languages."""
    if "en" in codes:
        return []
    own = frozenset().union(*map(words_of, codes)) | {"csv", "iso", "jcgm", "hpa", "sha", "gum"}
    return sorted(set(re.findall(r"[a-zà-ÿœ]{3,}", text.lower())) & english_words() - own)


@pytest.mark.parametrize("seed", range(COUNT))
@pytest.mark.quick(*map(str, range(QUICK)))
def test_every_document_says_what_the_result_says(seed, tmp_path):
    one = drawn(seed)
    assert missing(one.result) == ()
    shown = certified(one.result)
    require_rounded(shown)

    text = printed(one)
    for table in (parts.measured(shown), parts.sensitivity(shown), *certificate_decisions.conformity(shown)[1:]):
        if table is not None:
            require_cells(table, text, one.say)
    if one.issue.before is not None:
        require_cells(certificate_decisions.adjustment(shown, one.issue.before), text, one.say)
    if one.result.fit.adequate:
        require_cells(parts.parameters(shown), text, one.say)
    squeezed = re.sub(r"\s", "", text)
    for _, value in parts.reference(shown, one.say).rows[1:]:
        assert re.sub(r"\s", "", str(value)) in squeezed
    assert re.findall(PROGRAM_WORDS, text) == []
    assert foreign(text, one.say.codes) == []

    (path,) = export(one.result, "dcc", tmp_path)
    root = etree.parse(str(path)).getroot()
    require_same_in_dcc(root, shown)
    said = " ".join(node.text for node in root.iterfind(".//dcc:content", SPACE) if node.text)
    assert re.findall(PROGRAM_WORDS, said) == []

    page = page_of(one.result)
    stated = raised_to_measured(one.result)
    for table in (tables.parameters(stated), parts.measured(stated)):
        require_cells(table, page, Translator("en"))
    assert re.findall(r"\[\[|⟦|calibration file", page) == []


def printed(one: Drawn) -> str:
    """Return the text of the PDF; where no font has Chinese letters, that of the document before it is set."""
    if "zh" in one.say.codes and not set(pdf._CHINESE) & set(families()):
        return " ".join(strings_of(certificate(one.result, one.issue)))
    read = pypdf.PdfReader(io.BytesIO(report.content(one.result, "pdf", issue=one.issue)))
    return " ".join(page.extract_text() for page in read.pages).replace("\N{SOFT HYPHEN}", "-")


@cache
def families() -> tuple[str, ...]:
    return tuple(typst.Fonts(include_system_fonts=True).families())


def strings_of(value) -> list[str]:
    """Return all texts of a document, its pictures left out."""
    if isinstance(value, str):
        return [value]
    if isinstance(value, tuple):
        return [text for each in value for text in strings_of(each)]
    if is_dataclass(value) and not isinstance(value, Figure):
        skipped = ("kind", "language", "second_language", "name")
        held = {f.name: getattr(value, f.name) for f in fields(value)}
        return [text for name, each in held.items() if name not in skipped for text in strings_of(each)]
    return []


def page_of(result: Result) -> str:
    """Return the text of the HTML report, without its pictures."""
    with patch.object(document, "figures", MagicMock(**{f"{name}.return_value": None for name in DRAWN})):
        whole = document.report(result)
    blocks = (
        block
        for section in (whole, *whole.sections)
        for block in getattr(section, "blocks", getattr(section, "head", ()))
    )
    flat = [inner for block in blocks for inner in (block.blocks if isinstance(block, Folded) else (block,))]
    fragment = html.fragment(*(block for block in flat if not isinstance(block, Figure)))
    return re.sub(r"<[^>]+>", " ", fragment).replace("&gt;", ">").replace("&lt;", "<")


def test_a_word_of_another_language_is_seen():
    assert foreign("Übertragungskoeffizient, U of the sensitivity", ("de",)) == ["sensitivity", "the"]
    assert foreign("Sensibilité aux fréquences nominales", ("fr",)) == []
    assert foreign("灵敏度 derived", ("zh",)) == ["derived"]
