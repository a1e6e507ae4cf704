"""Tutorials show a result soon, fit their page, and need the public names alone."""

from __future__ import annotations

import ast
import re

import nbformat
import pytest

import vibrident
from docsite import executed, walkthrough

TUTORIALS = pytest.mark.parametrize("tutorial", sorted(executed.PROGRAMS.glob("*.py")), ids=lambda path: path.stem)
#: Lines of code before the first result; blank lines do not count.
MAX_FIRST_LINES = 10


def parts_of(tutorial) -> list[executed.Part]:
    return executed.parts(tutorial.read_text(encoding="utf-8"))


@TUTORIALS
def test_it_begins_with_a_title_and_checks_what_it_tells(tutorial):
    """``make docs`` runs the checks."""
    parts = parts_of(tutorial)
    assert parts[0].text.startswith("# # ")
    (check,) = (part.text for part in parts if part.kind == "check")
    assert len(re.findall(r"^\s*assert ", check, re.MULTILINE)) >= 3


@TUTORIALS
def test_it_shows_a_result_after_ten_lines(tutorial):
    shown = [part.text for part in parts_of(tutorial) if part.kind == ""]
    first = shown[0]
    assert len([line for line in first.splitlines() if line.strip()]) <= MAX_FIRST_LINES
    tree = ast.parse(first)
    assert isinstance(tree.body[-1], ast.Expr) or "print(" in first
    assert not [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]


@TUTORIALS
def test_no_function_stands_before_the_first_result(tutorial):
    parts = parts_of(tutorial)
    first = next(index for index, part in enumerate(parts) if part.kind == "")
    before = [ast.parse(part.text) for part in parts[:first] if part.kind == "folded"]
    nodes = [node for tree in before for node in ast.walk(tree)]
    assert not [node for node in nodes if isinstance(node, ast.FunctionDef | ast.Lambda)]


@TUTORIALS
def test_its_code_fits_the_page(tutorial):
    code = [part.text for part in parts_of(tutorial) if part.kind != "markdown"]
    assert [line for text in code for line in executed.wide_lines(text)] == []


@TUTORIALS
def test_it_needs_public_names_alone(tutorial):
    tree = ast.parse(tutorial.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            inner = [alias.name for alias in node.names if alias.name.startswith("vibrident.")]
            assert inner == []
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("vibrident"):
            assert node.module == "vibrident"
            assert {alias.name for alias in node.names} <= {*vibrident.__all__}
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "vibrident":
            assert node.attr in vibrident.__all__


def test_a_printed_line_that_is_too_wide_ends_the_build(tmp_path):
    program = tmp_path / "wide.py"
    program.write_text('# %% [markdown]\n# # Wide\n\n# %%\nprint("=" * 76)\n')
    executed.require_narrow(executed.run(program), "wide")
    program.write_text('# %% [markdown]\n# # Wide\n\n# %%\nprint("=" * 77)\n')
    with pytest.raises(ValueError, match="more than 76 characters"):
        executed.require_narrow(executed.run(program), "wide")


def test_a_folded_cell_is_run_and_opens_by_its_title(tmp_path):
    program = tmp_path / "story.py"
    program.write_text("# %% [markdown]\n# # A story\n\n# %% [folded] The data\nvalue = 6 * 7\n\n# %%\nvalue\n")
    cells = executed.run(program)
    page = executed.page(cells, tmp_path, "story")
    assert '??? note "The data"\n\n    ```python\n    value = 6 * 7\n    ```\n' in page
    assert "```text\n42\n```" in page
    notebook = nbformat.reads(executed.notebook(cells), as_version=4)
    assert notebook.cells[1].metadata["jupyter"]["source_hidden"]
    assert "jupyter" not in notebook.cells[2].metadata


def test_a_figure_as_last_value_is_a_picture(tmp_path):
    program = tmp_path / "figure.py"
    program.write_text(
        "# %% [markdown]\n# # A figure\n\n# %%\nfrom matplotlib.figure import Figure\n"
        "figure = Figure()\nfigure.suptitle('A title')\nfigure\n"
    )
    page = executed.page(executed.run(program), tmp_path, "figure")
    assert "![A title](figure-1.png)" in page


TEMPLATE = """# A page

??? note "Files"

    ```python
    from pathlib import Path

    Path("data.csv").write_text("a;b")
    Path("picture.png").write_bytes(b"drawn")
    ```

```toml title="folder/file.toml"
key = 1
```

```console
$ cat folder/file.toml
$ printf '%s\\n' "$COLUMNS" \\
    "  twenty words $(seq -s ' ' 20 60)"
```

![A picture](picture.png)
"""


def test_a_session_shows_what_its_commands_print(tmp_path):
    pictures = tmp_path / "page"
    pictures.mkdir()
    page = walkthrough.page(TEMPLATE, pictures)
    assert "$ cat folder/file.toml\nkey = 1\n" in page
    assert "\n76\n  twenty words 20 21" in page
    assert "![A picture](page/picture.png)" in page
    assert (pictures / "picture.png").read_bytes() == b"drawn"
    assert executed.wide_lines(page) == []


def test_a_command_that_fails_ends_the_build(tmp_path):
    with pytest.raises(walkthrough.subprocess.CalledProcessError):
        walkthrough.page("```console\n$ vibrident inspect nowhere.toml\n```\n", tmp_path)


@pytest.mark.parametrize("name", walkthrough.PAGES)
def test_files_and_commands_of_a_session_fit_the_page(name):
    template = (walkthrough.TEMPLATES / name).read_text(encoding="utf-8")
    blocks = re.findall(r"```\w+[^\n]*\n(.*?)```", template, re.DOTALL)
    assert [line for block in blocks for line in executed.wide_lines(block)] == []
