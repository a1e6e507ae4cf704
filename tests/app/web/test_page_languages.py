"""The page in its languages: every sentence by one function, whole catalogues, the choice of a language."""

from __future__ import annotations

import ast
import re
from string import Formatter

import pytest
from tests.support.page_words import shown_sentences, unsaid, with_values
from tests.support.sample_results import table2
from tests.support.serving import WAIT_MS, upload
from tests.support.sources import ROOT, modules, tree

from vibrident.app.web import sandboxed
from vibrident.app.web.form.certify import ENTRY_NAMES as CERTIFICATE_ENTRIES
from vibrident.app.web.form.description import ENTRIES, ENTRY_NAMES, KEYS, SECTIONS
from vibrident.app.web.language import COOKIE, LANGUAGES, LOCALES, catalogue, choose_language, language
from vibrident.data.io.certificate import CertificateSection
from vibrident.data.io.keys import keys_of
from vibrident.export.form import OPTIONS
from vibrident.export.registry import EXPORTS
from vibrident.fit.registry import ESTIMATORS
from vibrident.physics.naming import in_words, parameter_names
from vibrident.show.language import from_english

OTHERS = ("de", "zh")
#: Literals that are read by nobody on the page, or stand in the English message of an error.
UNSAID = {
    "vibrident.app.web.confinement": ("import vibrident",),
    "vibrident.app.web.authentication": ("<!doctype html>", "Sign in at the proxy", "Sign in first."),
    "vibrident.app.web.guard": (
        *("The page is not known", "The files are too large", "The server takes as many"),
        "The length of the request",
    ),
    "vibrident.app.web.form.description": (
        *("columns and units", "Reference and response are", "Both photodetector signals"),
        *("A tabulated response is", " is empty.", "the file of a record that differs"),
    ),
    "vibrident.app.web.form.entries": ("dense outlined stack-label",),
    "vibrident.app.web.tasks": ("vibrident identify",),
    "vibrident.app.web.user": ("the identification", "the task"),
    "vibrident.app.web.language": ("English", "Deutsch"),
    "vibrident.app.web.sandboxed": (" characters more", "entered by "),
    "vibrident.app.web.outcome": ("the page",),
    "vibrident.app.web.tools": ("identify first, or", " or above"),
    "vibrident.app.web.words": ("(in Python or", "the ", "ask whoever runs", "` (on the command line)"),
}
#: Sentences that are put together elsewhere, and from what.
MADE_OF_PARTS = {
    "no warnings.": ("no warnings",),
    "{count} warning, explained below.": ("{}, explained below",),
    "{count} warnings, explained below.": ("{}, explained below",),
    "The model is adequate for these data;": ("The model is adequate for these data",),
    "The model does not describe the data;": ("The model does not describe the data",),
    "{count} finding that moves no parameter by its u:": ("that {} no parameter by its u", "moves"),
    "{count} findings that move no parameter by its u:": ("that {} no parameter by its u", "move"),
    "{count} finding without a warning:": ("without a warning",),
    "{count} findings without a warning:": ("without a warning",),
    "model − measured, U (k = 2)": ("model − measured", "{}, U (k = 2)"),
    "First signal": ("First", "{} signal"),
    "Second signal": ("Second", "{} signal"),
    "Restored acceleration": ("Restored {}", "acceleration"),
    "Restored velocity": ("Restored {}", "velocity"),
    "Fit ({names} in {unit})": (" (RMSE, MAE in {})",),
    "The server was stopped during the identification.": (
        "The server was stopped during {}.",
        "the identification",
    ),
    "The server was stopped during the task.": ("The server was stopped during {}.", "the task"),
}


def elsewhere() -> set[str]:
    """What the page says of others, by the words of files, methods and formats."""
    keys = [*SECTIONS.values(), *KEYS.values(), *(key for each in ENTRIES.values() for key in each)]
    certificate = keys_of(CertificateSection).values()
    keys += [key for each in certificate if each.section for key in keys_of(each.section).values()]
    found = {key.title for key in keys}
    found |= {words for key in [*keys, *certificate] for words in key.options.values()}
    found |= {one.title for registry in (ESTIMATORS, EXPORTS) for one in registry.all().values()}
    found |= {option.label for option in OPTIONS.values()} | {in_words(name) for name in parameter_names()}
    things = [*ENTRY_NAMES.values(), *CERTIFICATE_ENTRIES.values()]
    found |= {"expected", "found", "where", "remedy", "band"} | {name.lower() for name in things}
    return {text for text in found if re.search("[A-Za-z]{2}", text)}


def written() -> set[str]:
    """Every text of the package, with {} for what is filled in."""
    found = set()
    for module in modules():
        for node in ast.walk(tree(module)):
            if isinstance(node, ast.JoinedStr):
                parts = (part.value if isinstance(part, ast.Constant) else "{}" for part in node.values)
                found.add("".join(map(str, parts)))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.add(re.sub(r"\{\w*\}|⟦[^⟧]*⟧", "{}", node.value))
    return found


def test_no_sentence_of_the_page_is_said_past_the_function():
    allowed = [(module, text) for module, texts in UNSAID.items() for text in texts]
    left = [
        one
        for one in unsaid()
        if not any(one.startswith(f"{module},") and f": {text!r}"[:-1] in one for module, text in allowed)
    ]
    assert left == []


def test_the_script_of_the_page_has_no_words():
    script = (ROOT / "src/vibrident/app/web/page.js").read_text(encoding="utf-8")
    assert re.findall(r"'[A-Z][a-z]+[ a-z]*'|aria-label', '", script) == []


@pytest.mark.parametrize("code", OTHERS)
def test_a_catalogue_has_what_is_said_and_nothing_else(code):
    own, of_certificates = catalogue(code), from_english(code)
    wanted = (shown_sentences() - with_values() - {*own["made"]}) | elsewhere()
    missing = {text for text in wanted if language(code).translation(text) is None}
    assert missing == set()
    assert {*own["said"]} - shown_sentences() - elsewhere() == set()
    assert {*own["said"]} & {*own["made"]} == set()
    assert with_values() - {*own["made"]} == set()
    repeated = {text for part in own.values() for text in part if of_certificates.get(text) == part[text]}
    assert repeated == set()


@pytest.mark.parametrize("code", OTHERS)
def test_what_is_made_elsewhere_is_made_there(code):
    lines = {line for text in written() for line in (text, *text.split("\n"))}
    own = {*catalogue(code)["made"]}
    keys = {key: re.sub(r"\{\w+\}", "{}", key) for key in own - {*MADE_OF_PARTS}}
    assert {key for key, text in keys.items() if text not in lines} == set()
    assert {*MADE_OF_PARTS} <= own
    assert {part for parts in MADE_OF_PARTS.values() for part in parts} <= lines


@pytest.mark.parametrize("code", OTHERS)
@pytest.mark.parametrize("part", ["said", "made"])
def test_the_values_of_a_sentence_are_those_of_its_key(code, part):
    def names(text: str) -> list[str]:
        return sorted({name for _, name, _, _ in Formatter().parse(text) if name})

    pairs = catalogue(code)[part].items()
    assert [key for key, text in pairs if names(key) != names(text) or not text.strip()] == []


@pytest.mark.parametrize("code", OTHERS)
def test_a_finished_sentence_is_said_as_its_template_is(code):
    """Sentences that the server keeps, or that other rooms make, are known by their words."""
    speak = language(code)
    for key, text in catalogue(code)["made"].items():
        values = {name: "7" for _, name, _, _ in Formatter().parse(key) if name}
        if key != "in {unit}" and values:
            assert speak(key.format(**values)) == text.format(**values), key
    assert speak("nobody has a word for this") == "nobody has a word for this"


def test_numbers_have_a_comma_in_german_and_names_keep_their_point():
    speak = language("de")
    assert speak("{limit} and {file}".replace(" and ", " "), limit="0.5", file="1.5_V.csv") == "0,5 1.5_V.csv"
    assert speak("Iteration 3 of at most 20, cost 1.25") == "Iteration 3 von höchstens 20, Zielfunktion 1,25"
    assert language("zh").number("0.5") == language("en").number("0.5") == "0.5"


@pytest.mark.parametrize(
    ("cookie", "accepted", "code"),
    [
        ("", "", "en"),
        ("", "zh-CN,zh;q=0.9,en;q=0.8", "zh"),
        ("", "fr,de-AT;q=0.5,en;q=0.4", "de"),
        ("", "en;q=0.4, de;q=0.5", "de"),
        ("", "de;q=0, zh;q=0.1", "zh"),
        ("", "fr;q=x,,;;=,", "en"),
        ("zh", "de", "zh"),
        ("../etc", "de", "de"),
    ],
)
def test_the_language_is_what_was_chosen_else_what_the_browser_accepts(cookie, accepted, code):
    assert choose_language({COOKIE: cookie}, accepted) == code


@pytest.mark.parametrize("code", OTHERS)
def test_a_result_is_shown_in_the_language(tmp_path, code):
    path = table2().save(tmp_path / "result.json")
    english, other = sandboxed.read_outcome(path), sandboxed.read_outcome(path, code)
    plain = [re.sub(r"<[^>]+>", " ", one["verdict"] + one["parameters"]) for one in (english, other)]
    words = [set(re.findall(r"\b(?:the|of|and|value|unit|damping|interval|with)\b", text)) for text in plain]
    assert words[0] > words[1] == set()
    digits = [re.sub(r"\D", "", one["parameters"].partition("</table>")[0]) for one in (english, other)]
    assert digits[0] == digits[1]
    titles = [[title for title, _, _ in one["charts"]] for one in (english, other)]
    assert not {*titles[0]} & {*titles[1]}
    separated = [b'"separators":",' in drawn for _, drawn, _ in other["charts"]]
    assert all(separated) if code == "de" else not any(separated)


@pytest.mark.slow
def test_the_page_speaks_the_browsers_language_until_another_is_chosen(browser, server, sound, tmp_path):
    (tmp_path / "a.csv").write_text(
        "time,reference,response\n" + "".join(f"{i / 100},{i % 7},{i % 5}\n" for i in range(50))
    )
    context = browser.new_context(locale="de-DE", reduced_motion="reduce")
    page = context.new_page()
    page.goto(server.address)
    page.locator("#data-title").get_by_text("Daten").wait_for()
    assert page.locator("html").get_attribute("lang") == LOCALES["de"]
    upload(page, tmp_path / "a.csv", table2().save(tmp_path / "earlier.json"))
    page.locator("#columns .js-plotly-plot").wait_for(timeout=WAIT_MS)
    page.locator("#result .js-plotly-plot").first.wait_for(timeout=WAIT_MS)
    sound(page, "german")
    page.get_by_label("Sprache", exact=True).first.select_option("zh")
    page.locator("html[lang=zh-CN]").wait_for(timeout=WAIT_MS)
    page.locator("#data-title").get_by_text(language("zh")("Data")).wait_for(timeout=WAIT_MS)
    page.locator("#result .js-plotly-plot").first.wait_for(timeout=WAIT_MS)  # nothing is lost
    sound(page, "chinese")
    other = context.new_page()
    other.goto(server.address)
    other.locator("html[lang=zh-CN]").wait_for(timeout=WAIT_MS)
    assert other.locator("#language option").all_inner_texts() == [*LANGUAGES.values()]
    context.close()
