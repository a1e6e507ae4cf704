"""Messages name settings by markers, and Python, the command line and the page each print their own word."""

from __future__ import annotations

import ast
import inspect
import pickle
import pkgutil
import re
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from importlib import import_module

import pytest
import typer
from tests.support.exported import paper
from tests.support.shell import run
from tests.support.sources import modules, source, tree

import vibrident
from vibrident.app.cli import commands
from vibrident.app.cli.application import app
from vibrident.app.cli.words import shell_word
from vibrident.app.web import task_work
from vibrident.app.web.tasks import TASKS
from vibrident.app.web.words import LABELS, page_word
from vibrident.app.workflow import comparison, tracked, uses
from vibrident.app.workflow.estimators import check_settings
from vibrident.app.workflow.identification import IdentifyRequest
from vibrident.base import memory
from vibrident.base.errors import InputError
from vibrident.base.process import Process
from vibrident.base.settings import MARKER, python_word, rendered
from vibrident.data.io.own_table import read_signal
from vibrident.export import export
from vibrident.export.form import OPTIONS
from vibrident.export.registry import EXPORTS
from vibrident.fit.estimators import Ipnn
from vibrident.lab.fleet import Orders, RunRequest
from vibrident.lab.history import document, entry, query
from vibrident.lab.issue import verification
from vibrident.paper.optimiser import Adam
from vibrident.show import report
from vibrident.use import planning

FLAG = re.compile(r"(?<![\w-])--[a-z][a-z-]*")
#: Options that are arguments of programs, not words of a message.
ARGUMENTS = {
    "vibrident.app.web.confinement": "bubblewrap",
    "vibrident.app.web.tasks": "the command that a task runs, with its labels",
    "vibrident.app.web.tools": "the folder of that command",
    "vibrident.app.web.state": "the command that is shown to copy",
    "vibrident.app.web.words": "where an option's name begins",
    "vibrident.base.backend": "XLA",
    "vibrident.base.settings": "where an option's name begins",
    "vibrident.show.media.html": "CSS",
}
ROOT = typer.main.get_command(app)
NOTATION = ("vibrident.base.settings", "vibrident.app.cli.options", "vibrident.app.cli.words")
ELSEWHERE = "(in Python or on the command line)"
INSTALL = "ask whoever runs the server to install a b[c]"
MEMORY = "the memory that the server may take for a file"
for _name in ("fleet", "history", "issue", "serve", "simulate", "track"):
    import_module(f"vibrident.app.cli.commands.{_name}")


_DOCUMENTED = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


@cache
def texts(module: str) -> tuple[tuple[int, str], ...]:
    """Return line and text of every string but docstrings; what is filled in is the name ``x``."""
    return tuple(_texts(module))


def _texts(module: str) -> Iterator[tuple[int, str]]:
    inner: set[int] = set()
    for node in ast.walk(tree(module)):
        if isinstance(node, _DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            inner.add(id(node.body[0].value))  # type: ignore[attr-defined]
        if isinstance(node, ast.JoinedStr):
            inner |= {id(part) for part in node.values}
            yield node.lineno, "".join(map(filled, node.values))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in inner:
            yield node.lineno, node.value


def filled(part: ast.expr) -> str:
    if isinstance(part, ast.Constant):
        return str(part.value)
    return memory.VARIABLE if "VARIABLE" in ast.unparse(part) else "x"


def markers() -> dict[tuple[str, str], set[str]]:
    """Name and value of each marker in a text → modules that have it."""
    found: dict[tuple[str, str], set[str]] = {}
    marked = [module for module in modules() if "⟦" in source(module) and module not in NOTATION]
    for module in marked:  # while tests are collected: to parse the others takes seconds
        for _, text in texts(module):
            assert text.count("⟦") == len(MARKER.findall(text)), (module, text)
            for marker in MARKER.findall(text):
                found.setdefault(marker, set()).add(module)
    return found


MARKERS = markers()
SETTINGS = sorted({name for name, _ in MARKERS if "." in name and not name.startswith("environment.")})
COMMANDS = sorted({value for name, value in MARKERS if name == "command"})


def keywords() -> dict[str, set[str]]:
    """First part of a setting's name → the keywords of the functions and classes that take it."""
    taking = {
        "export": [export],
        "identify": [vibrident.identify, vibrident.identify_together, Ipnn, Adam, IdentifyRequest],
        "correct": [vibrident.correct, read_signal],
        "report": [report.write],
        "plan": [vibrident.predict_mounted, vibrident.plan, vibrident.Recording],
        "fleet": [RunRequest, Orders, commands.fleet.fleet],
        "issue": [commands.issue.sign],
        "verify": [verification.verify],
        "history": [query.find, entry.rows_of, entry.add_event, document.Question, commands.history.show_sensor],
        "serve": [commands.serve.serve],
        "simulate": [commands.simulate.simulate],
        "track": [commands.track.track],
    }
    return {
        scope: {name for one in given for name in inspect.signature(one).parameters} for scope, given in taking.items()
    }


def options(scope: str) -> set[str]:
    """Every option of a command, or of the commands of a group."""
    command = ROOT.commands[scope]
    each = getattr(command, "commands", {"": command}).values()
    return {flag for one in each for parameter in one.params for flag in (*parameter.opts, *parameter.secondary_opts)}


def test_messages_of_inner_rooms_have_no_option_of_the_command_line():
    complaints = [
        f"{module}, line {line}: {text!r}"
        for module in modules()
        if not module.startswith("vibrident.app.cli") and module not in ARGUMENTS
        for line, text in texts(module)
        if FLAG.search(text)
    ]
    assert complaints == []


def test_settings_are_named_in_many_rooms():
    rooms = {module.split(".")[1] for where in MARKERS.values() for module in where}
    assert rooms >= {"app", "base", "data", "export", "fit", "lab", "result", "show", "use"}
    assert len(SETTINGS) > 30


@pytest.mark.parametrize("name", SETTINGS)
def test_every_surface_has_a_word_for_every_setting(name):
    scope, keyword = name.split(".")
    word = python_word(name, "")
    assert callable(pkgutil.resolve_name(word)) if "." in word else word == keyword
    if keyword != "x":  # of another package's estimator
        assert "." in word or keyword in keywords()[scope]
        assert shell_word(ROOT)(name, "") in options(scope)
    assert page_word()(name, "").strip("“")


@pytest.mark.parametrize("name", LABELS)
def test_every_label_of_the_page_is_of_a_setting(name):
    scope, _ = name.split(".")
    assert shell_word(ROOT)(name, "") in options(scope)


#: Task → function that takes its options by name.
TAKERS = {
    "compare": comparison.compare,
    "correct": uses.correct,
    "track": tracked.track,
    "plan": planning.plan,
    "joint": task_work._identify,
    "fleet": task_work._fleet,
}


@pytest.mark.parametrize("task", TASKS)
def test_every_option_of_a_task_is_one_that_its_function_takes(task):
    taken = {*inspect.signature(TAKERS[task]).parameters} if task in TAKERS else set()
    taken |= {"low_hz", "high_hz"} if taken & {"band_hz", "frequencies_hz"} else set()
    taken |= {"share"} if task == "joint" else set()  # a field of the request
    assert {*TASKS[task].fields} <= taken


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_that_is_named_exists(command):
    group = ROOT
    for word in command.split():
        if word in getattr(group, "commands", {}):
            group = group.commands[word]
        else:
            assert word == "SERIAL" or word == "result.json"
    assert group is not ROOT


@pytest.mark.parametrize("word", [python_word, shell_word(ROOT), page_word()])
def test_no_text_is_shown_with_a_marker(word):
    for module in modules():
        if module not in NOTATION:
            for line, text in texts(module):
                shown = rendered(text, word)
                assert "⟦" not in shown, (module, line)
                if word is python_word and module not in ARGUMENTS and ".cli" not in module:
                    assert not FLAG.search(shown), (module, line)


@pytest.mark.parametrize(
    ("marked", "python", "shell", "page"),
    [
        ("⟦export.rate_hz = HZ⟧", "rate_hz=HZ", "--rate HZ", "“Sampling rate in Hz”"),
        ("⟦export.country⟧", "country", "--country", "“Country, two letters”"),
        ("⟦export.band_hz = (LOW, HIGH)⟧", "band_hz=(LOW, HIGH)", "--band LOW:HIGH", f"“band hz” {ELSEWHERE}"),
        ("⟦export.without = ['delay']⟧", "without=['delay']", "--without delay", f"“without” delay {ELSEWHERE}"),
        ("⟦identify.share = ['a', 'b']⟧", "share=['a', 'b']", "--share a,b", f"“share” a,b {ELSEWHERE}"),
        ("⟦identify.estimator = 'ml'⟧", "estimator='ml'", "--estimator ml", "“Estimator” ml"),
        ("⟦identify.limit = 2⟧", "limit=2", "--set limit=2", f"“limit” 2 {ELSEWHERE}"),
        ("⟦fleet.fresh⟧", "fresh", "--fresh", f"“fresh” {ELSEWHERE}"),
        ("⟦serve.auth = 'a, (b)'⟧", "auth='a, (b)'", "--auth a, (b)", f"“auth” a, (b) {ELSEWHERE}"),
        ("⟦install = a b[c]⟧", "pip install 'a' 'b[c]'", "pip install 'a' 'b[c]'", INSTALL),
        ("⟦command = identify⟧", "`vibrident identify`", "`vibrident identify`", "“Identify”"),
        ("⟦command = track⟧", "`vibrident track`", "`vibrident track`", "“Track”"),
        ("⟦here⟧", "arguments", "command line", "the form"),
        ("⟦environment.VIBRIDENT_MEMORY_MB⟧", "VIBRIDENT_MEMORY_MB", "VIBRIDENT_MEMORY_MB", MEMORY),
        ("⟦a file's name⟧", "⟦a file's name⟧", "⟦a file's name⟧", "⟦a file's name⟧"),
    ],
)
def test_words(marked, python, shell, page):
    assert [rendered(marked, word) for word in (python_word, shell_word(ROOT), page_word())] == [python, shell, page]


def test_an_option_of_the_running_command_comes_first():
    assert shell_word(ROOT, "simulate")("export.folder", "") == "--out"
    assert shell_word(ROOT, "compare")("identify.model", "") == "--model"
    assert shell_word(ROOT, "history")("export.folder", "") == "--out"


def test_an_error_keeps_its_markers_and_reads_in_words_of_python():
    error = InputError("p", where="⟦export.rate_hz⟧", remedy="give ⟦export.rate_hz = HZ⟧")
    assert (error.where, error.remedy) == ("rate_hz", "give rate_hz=HZ")
    assert str(error) == "p\n  where:    rate_hz\n  remedy:   give rate_hz=HZ"
    again = pickle.loads(pickle.dumps(error.at("⟦export.form⟧")))
    assert again.in_words(shell_word(ROOT)).parts == [("where", "--format"), ("remedy", "give --rate HZ")]


def test_an_error_of_another_process_is_rendered_where_it_is_shown(tmp_path):
    with Process(folder=tmp_path) as process, pytest.raises(InputError) as caught:
        process.call(check_settings, "ml", {"steps": 3})
    assert caught.value.remedy == "add estimator='ipnn', or leave steps out"
    assert caught.value.in_words(shell_word(ROOT)).remedy == "add --estimator ipnn, or leave --steps out"


def test_advice_works_when_it_is_followed(tmp_path):
    made = replace(paper(), weights={})
    with pytest.raises(InputError, match=r"give rate_hz=HZ") as caught:
        export(made, "c", tmp_path)
    assert export(made, "c", tmp_path, rate_hz=10_000.0)
    made.save(tmp_path / "result.json")
    asked = ("export", tmp_path / "result.json", "--format", "c", "--out", tmp_path / "out")
    refused = run(*asked)
    flag = re.search(r"remedy: +give (--\S+) HZ", refused.output)
    assert flag
    assert run(*asked, flag[1], "10000").exit_code == 0
    assert "rate_hz" in EXPORTS["c"].options  # so that the page shows the field
    assert caught.value.in_words(page_word()).remedy == f"give “{OPTIONS['rate_hz'].label}”"


def test_an_option_with_another_estimator_is_followed_by_its_advice():
    with pytest.raises(InputError, match="add estimator='ipnn', or leave steps out"):
        check_settings("ml", {"steps": 3})
    check_settings("ipnn", {"steps": 3, "optimiser": "adam"})
    check_settings("ml", {"steps": None})
