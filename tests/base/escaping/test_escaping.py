"""Text of others is text in every export and rendering: code, markup and terminals do not depend on it."""

from __future__ import annotations

import ast
import csv
import io
import json
import re
import shutil
import subprocess
import zipfile
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st
from markdown_it import MarkdownIt
from rich.console import Console
from tests.support.exported import paper
from tests.support.hostile import STRINGS, with_text
from tests.support.sample_results import table2

from vibrident.base import escaping
from vibrident.base.errors import InputError
from vibrident.data.io.writer import record_files
from vibrident.export import export
from vibrident.export.form import Options
from vibrident.export.formats.fmu import slave
from vibrident.export.sensor import read_sensor
from vibrident.show import methods, plots, terminal
from vibrident.show.media import html
from vibrident.show.media.console import on_console
from vibrident.show.report import content
from vibrident.show.rows import table_of

XML_BANNED = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")
ALL = "\n".join(STRINGS)
TEXTS = [text for text in STRINGS if text.strip()]


def made_of(text):
    """A small result of an accelerometer with signals, every text of others being this one, units but of the gain."""
    return with_text(table2(), text)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Files of a format by text: the same sensor, first with harmless texts."""

    def write(form, texts=TEXTS, unit=None, **options):
        made = {}
        for number, text in enumerate(["harmless", *texts]):
            folder = tmp_path_factory.mktemp(f"{form}{number}")
            made[text] = export(with_text(paper(), text, unit), form, folder, **options)
        return made

    return write


def code_of_c(text):
    """What a compiler sees: trigraphs, spliced lines and comments gone (C99 5.1.1.2)."""
    trigraphs = zip("=(/)'<!>-", "#[\\]^{|}~", strict=True)
    for third, meant in trigraphs:
        text = text.replace(f"??{third}", meant)
    return re.sub(r"/\*.*?\*/|//[^\n]*", " ", re.sub(r"\\\s*?\n", "", text), flags=re.DOTALL)


def test_c_code_does_not_depend_on_the_text_in_its_comments(written):
    made = written("c", rate_hz=51200.0)
    for k in (0, 1):
        assert len({code_of_c(files[k].read_text("utf-8")) for files in made.values()}) == 1
    if shutil.which("gcc"):
        flags = ("-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-fsyntax-only")
        sources = [str(files[1]) for files in made.values()]
        subprocess.run(["gcc", *flags, *sources], check=True, capture_output=True)
        trigraphs = ("-trigraphs", "-Wtrigraphs", "-Wcomment")
        subprocess.run(["gcc", *flags, *trigraphs, *sources], check=True, capture_output=True)


@given(st.text(alphabet=st.sampled_from("*/\\?\n\r '\"@x\ud800"), max_size=30))
def test_any_text_is_one_comment_of_c(text):
    assert code_of_c(f"/* {escaping.c_comment(text)} */ int x;").split() == ["int", "x;"]
    assert code_of_c(f"/*\n * {escaping.c_comment(text)}\n */ int x;").split() == ["int", "x;"]


@given(st.text(max_size=60))
def test_any_text_becomes_what_can_be_seen(text):
    assert not re.search(f"{XML_BANNED.pattern}|\n", escaping.one_line(text))
    escaping.one_line(text).encode()
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]", escaping.terminal(text))


def test_the_fmus_code_and_description_do_not_depend_on_the_text(written):
    shapes = set()
    for text in ["harmless", *TEXTS]:
        made = slave(read_sensor(with_text(paper(), text)), Options(rate_hz=51200.0))
        made.encode()
        tree = ast.parse(made)
        shapes.add(tuple(type(node).__name__ for node in ast.walk(tree)))
        assert not [n.value for n in ast.walk(tree) if isinstance(n, ast.Constant) and XML_BANNED.search(str(n.value))]
    assert len(shapes) == 1
    (path,) = written("fmu", [ALL], rate_hz=51200.0)[ALL]
    with zipfile.ZipFile(path) as archive:
        ElementTree.fromstring(archive.read("modelDescription.xml"))


@pytest.mark.parametrize("name", ["none", "true", "real", "lead", "int", "fmi2Slave", "x" * 41])
def test_names_that_languages_know_make_code_all_the_same(name, tmp_path):
    made = slave(read_sensor(paper()), Options(rate_hz=51200.0, name=name))
    classes = [node.name for node in ast.parse(made).body if isinstance(node, ast.ClassDef)]
    assert made.count(f"class {classes[0]}(Fmi2Slave)") == len(classes) == 1
    _, source = export(paper(), "c", tmp_path, rate_hz=51200.0, name=name)
    if shutil.which("gcc"):
        subprocess.run(["gcc", "-std=c99", "-Wall", "-Werror", "-fsyntax-only", str(source)], check=True)


@pytest.mark.parametrize("name", ["con", "NUL", "com1", "../x", "a b", "x\n", "1a", "ſ", ""])
def test_names_that_are_none_are_refused(name, tmp_path):
    with pytest.raises(InputError):
        export(paper(), "csv", tmp_path, name=name)


def test_the_digital_certificate_has_the_same_elements_whatever_the_text(written):
    options = {"unit": "V", "country": "DE"}
    shapes = {}
    for text, files in written("dcc", **options).items():
        root = ElementTree.fromstring(files[0].read_bytes())
        tags = [element.tag for element in root.iter()]
        shapes[text] = len(tags) - tags.count("{https://ptb.de/dcc}content")  # one content a line
    assert len(set(shapes.values())) == 1


def test_stationxml_and_sacpz_do_not_depend_on_the_text(written):
    texts = [*TEXTS[::3], ALL]
    tags = set()
    for files in written("stationxml", texts).values():
        tags.add(tuple(element.tag for element in ElementTree.fromstring(files[0].read_bytes()).iter()))
    assert len(tags) == 1
    made = written("sacpz")
    assert len({re.sub(r"(?m)^\*.*\n", "", f[0].read_text("utf-8")) for f in made.values()}) == 1
    assert len({f[0].read_text("utf-8").count("\n") for f in made.values()}) == 1


def test_no_cell_of_a_csv_file_is_a_formula(written):
    for files in written("csv").values():
        for path in files:
            rows = list(csv.reader(io.StringIO(path.read_text("utf-8"), newline="")))
            assert len({len(row) for row in rows}) == 1
            for cell in (cell for row in rows for cell in row if cell.startswith(tuple("=+-@\t\r"))):
                float(cell)


def test_markdown_has_the_same_structure_whatever_the_text():
    reader = MarkdownIt("commonmark").enable(["table", "strikethrough"])

    def shape(text):
        tokens = reader.parse(content(made_of(text), "md").decode())
        inline = {child.type for token in tokens for child in token.children or ()}
        return [token.type for token in tokens if token.type not in ("text", "inline")], inline

    blocks, inline = shape("harmless")
    for text in TEXTS:
        found, kinds = shape(text)
        assert found == blocks, text
        assert kinds <= inline | {"softbreak"}, text
    assert "http://" not in content(made_of(ALL), "md").decode()


class Tags(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.seen, self.attributes = [], set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.seen.append(tag)
        self.attributes |= {name for name, _ in attrs}


def strings_of(value):
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            yield from strings_of(item)


def test_the_page_and_its_charts_have_the_same_structure_whatever_the_text(monkeypatch):
    monkeypatch.setattr(html, "_plotly", lambda: "")
    harmless = Tags(content(made_of("harmless"), "html").decode())
    for text in (text for text in TEXTS if set(text) & set('<&{%"')):
        made = content(made_of(text), "html").decode()
        tags = Tags(made)
        assert tags.seen == harmless.seen, text
        assert tags.attributes <= harmless.attributes
        figures = json.loads(re.search(r'id="figures">(.*?)</script>', made, re.DOTALL)[1])
        for words in strings_of(figures):
            assert set(re.findall(r"<[^>]*>?", words)) <= {"<br>", "<extra>", "</extra>"}, text
            assert set(re.findall(r"%\{[^}]*\}", words)) <= set(TEMPLATES), text


TEMPLATES = ("%{text}", "%{customdata}", "%{x}", "%{y:+.3g}", "%{x:.6g}", "%{x:.2f}", "%{y}", "%{y:.4g}")


@pytest.mark.usefixtures("unpainted")
def test_certificate_and_comparison_are_set_whatever_the_text():
    for text in (ALL, *TEXTS[::10]):
        assert content(made_of(text), "pdf").startswith(b"%PDF")
    other = replace(made_of(ALL), certificate={"date_of_calibration": "2024-01-01"})
    assert content([made_of(ALL), other], "pdf", [ALL, TEXTS[0]]).startswith(b"%PDF")
    Tags(content([made_of(ALL), other], "html", [ALL, TEXTS[0]]).decode())


def test_pictures_hold_text_as_text(tmp_path):
    for path in plots.save_all(made_of(" ".join(STRINGS[:20])), tmp_path, ("svg",)):
        kinds = {element.tag.rpartition("}")[2] for element in ElementTree.parse(path).iter()}
        assert not kinds & {"a", "script", "foreignObject"}


def test_a_terminal_gets_no_sequence_and_no_markup_of_others():
    for text in TEXTS:
        stream = io.StringIO()
        console = Console(file=stream, force_terminal=True, width=200, color_system="standard")
        result = made_of(text)
        console.print(terminal.summary(result, [f"out/{text}"]))
        console.print(on_console(*methods.compared([result, result], [text, "other"])))
        console.print(on_console(table_of([{"record": text, text: 1.0}] * 3, text)))
        console.print(on_console(*methods.models({text: result, "other": result}, {})))
        rest = re.sub(r"\x1b\[[0-9;]*m", "", stream.getvalue())
        assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e]", rest), text
        assert "stolen.example" not in re.findall(r"\x1b\]8[^\x1b]*", stream.getvalue())


def test_files_of_records_stay_in_their_folder_and_every_system_takes_them():
    names = record_files([*STRINGS, *STRINGS])
    assert len({name.casefold() for name in names}) == len(names)
    for name in names:
        assert re.fullmatch(r"[\w+][\w.+-]{0,150}\.csv", name)
        assert not re.match(r"(con|prn|aux|nul|com\d|lpt\d)\.", name, re.IGNORECASE)


def test_only_renderers_escape_what_is_shown():
    """A view model holds text as it is: escaped once, where its medium is known."""
    folder = Path(html.__file__).parent
    escaping_ones = {
        path.stem for path in folder.glob("*.py") if "vibrident.base.escaping" in path.read_text(encoding="utf-8")
    }
    assert escaping_ones == {"charts", "console", "html", "markdown", "pdf"}
