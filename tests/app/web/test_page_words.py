"""Messages on the page are in its own words: no flag, no variable, no command of a shell."""

import ast
import re
import signal

import pytest
from tests.support.serving import alone
from tests.support.sources import modules, tree

from vibrident.app.web import sandboxed
from vibrident.app.web.form.description import describe_guess
from vibrident.app.web.words import page_word
from vibrident.app.web.worker import StoppedError, Worker
from vibrident.base.errors import InputError
from vibrident.data.io.guess import guess_columns

SHELL = re.compile(r"--[a-z]|VIBRIDENT_|pip install|vibrident (?:identify|inspect|serve|export|report)|\bshell\b")
PARTS = ("expected", "found", "where", "remedy")


def messages():
    """The texts of every error that the page can show, but for what is filled in."""
    for module in modules():
        if module.startswith(("vibrident.app.cli", "vibrident.lab", "vibrident.paper", "vibrident.app.workflow")):
            continue
        if module == "vibrident.app.web.server":  # before there is a page
            continue
        for node in ast.walk(tree(module)):
            if not isinstance(node, ast.Call):
                continue
            parts = {one.arg: text(one.value) for one in node.keywords if one.arg in PARTS}
            if "remedy" in parts:
                yield module, parts


def text(node) -> str:
    """The constant parts of a text."""
    if (isinstance(node, ast.Name) and node.id == "VARIABLE") or (
        isinstance(node, ast.Attribute) and node.attr == "VARIABLE"
    ):
        return "VIBRIDENT_MEMORY_MB"
    if isinstance(node, ast.Constant):
        return str(node.value)
    return "".join(text(child) for child in ast.iter_child_nodes(node))


def test_no_message_has_words_of_a_shell():
    found = list(messages())
    assert sum("⟦" in "".join(parts.values()) for _, parts in found) > 30
    shown = [(module, str(InputError("", **parts).in_words(page_word()))) for module, parts in found]
    assert [(module, words) for module, words in shown if SHELL.search(words)] == []


def test_a_process_that_was_killed_is_told_of_by_its_signal(tmp_path):
    with pytest.raises(StoppedError) as caught:
        alone(Worker().run(signal.raise_signal, 9, folder=tmp_path))
    assert caught.value.found == "a process that ended with signal 9, SIGKILL"
    assert "repeat it" in caught.value.remedy


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("Resp [3]", "V"),
        ("Resp (CH 2)", "V"),
        ("Resp [Ch2] [mV]", "mV"),
        ("Resp (ai0)", "V"),
        ("Resp [mV]", "mV"),
        ("Resp (#4)", "V"),
    ],
)
def test_a_channel_number_in_brackets_is_no_unit(tmp_path, name, unit):
    (tmp_path / "a.csv").write_text(f"time,ref [m/s^2],{name}\n0,1,2\n1,2,3\n")
    assert guess_columns(tmp_path / "a.csv").document["response"]["unit"] == unit


def test_every_file_is_examined_when_it_is_dropped(tmp_path):
    rows = "".join(f"{i / 100},{i % 7},{i % 5}\n" for i in range(50))
    (tmp_path / "a.csv").write_text("time,reference,response\n" + rows)
    (tmp_path / "b.csv").write_text("time,reference,response\n" + rows.replace("0.2,6,0", "0.2,6,NaN"))
    (tmp_path / "c.csv").write_text("time,reference,out\n" + rows)
    given = describe_guess(guess_columns(tmp_path / "a.csv"))
    assert sandboxed.find_faults(given, tmp_path, ["a.csv"]) == []
    nan, header = sandboxed.find_faults(given, tmp_path, ["a.csv", "b.csv", "c.csv"])
    assert "not a number" in nan["problem"]
    assert "b.csv, line 22" in nan["where"]
    assert "c.csv" in header["where"]
