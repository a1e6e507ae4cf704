"""Programs that are pages of the documentation and notebooks to download: ``notebooks/NAME.py``, run once for both.

A program has cells between ``# %%`` lines. A ``# %% [markdown]`` cell is text. Other cells are run as Jupyter does:
what they print, the value of a last expression, and figures left open are shown below them. A ``# %% [check]`` cell is
run and not shown: it holds what must be true for the text to be true, so that a story that no longer holds ends the
build.
"""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import linecache
import re
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from nbformat import NotebookNode, validate, writes
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

PROGRAMS = Path(__file__).parent / "notebooks"
_LINK = r"\]\(([a-z-]+)\.md"  # to a page beside the folder of the notebooks
_DPI = 110


def write(docs: Path) -> None:
    """Run each program, and write its page, its pictures and its notebook into ``notebooks/``."""
    folder = docs / "notebooks"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for program in sorted(PROGRAMS.glob("*.py")):
        cells = run(program)
        (folder / f"{program.stem}.md").write_text(page(cells, folder, program.stem), encoding="utf-8")
        (folder / f"{program.stem}.ipynb").write_text(notebook(cells), encoding="utf-8")


def run(program: Path) -> list[NotebookNode]:
    """The program's cells with what they gave, run in a folder of their own that is removed afterwards."""
    import matplotlib as mpl

    mpl.use("agg")
    names: dict[str, Any] = {"__name__": "notebook"}
    made = []
    with tempfile.TemporaryDirectory(prefix="vibrident-notebook-") as folder, contextlib.chdir(folder):
        for kind, cell in parts(program.read_text(encoding="utf-8")):
            if kind == "markdown":
                made.append(new_markdown_cell(re.sub(r"^# ?", "", cell, flags=re.MULTILINE)))
                continue
            name = f"<{program.name}, cell {len(made)}>"
            # As Jupyter does: the source of what a cell defines can be looked up.
            linecache.cache[name] = len(cell), None, cell.splitlines(keepends=True), name
            outputs = [*_outputs(cell, names, name)]
            if kind != "check":
                made.append(new_code_cell(cell, outputs=outputs))
    return made


def parts(text: str) -> list[tuple[str, str]]:
    """Kind (``markdown``, ``check``, or empty for code) and text of each cell."""
    found = re.findall(r"^# %%(?: \[(\w+)\])?\n(.*?)(?=^# %%|\Z)", text, re.MULTILINE | re.DOTALL)
    return [(kind, cell.strip()) for kind, cell in found]


def _outputs(cell: str, names: dict[str, Any], name: str) -> Iterator[NotebookNode]:
    tree = ast.parse(cell, name)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    said, value = io.StringIO(), None
    with contextlib.redirect_stdout(said):
        exec(compile(tree, name, "exec"), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), name, "eval"), names)
    if said.getvalue():
        yield new_output("stream", text=said.getvalue())
    if value is not None:
        as_html = getattr(value, "_repr_html_", None)
        data = {"text/plain": repr(value)} | ({"text/html": as_html()} if as_html else {})
        yield new_output("execute_result", data)
    yield from _figures()


def _figures() -> Iterator[NotebookNode]:
    """Open figures, which are closed; their titles are what a picture says where it is not seen."""
    import matplotlib.pyplot as plt

    for number in plt.get_fignums():
        figure = plt.figure(number)
        title = figure.get_suptitle() or " and ".join(filter(None, (axes.get_title() for axes in figure.axes)))
        drawn = io.BytesIO()
        figure.savefig(drawn, format="png", dpi=_DPI)
        plt.close(figure)
        yield new_output(
            "display_data", {"image/png": base64.b64encode(drawn.getvalue()).decode(), "text/plain": title}
        )


def page(cells: list[NotebookNode], folder: Path, name: str) -> str:
    """The page's Markdown; its pictures are written into the folder."""
    written, pictures = [], 0
    for cell in cells:
        if cell.cell_type == "markdown":
            written.append(re.sub(_LINK, r"](../\1.md", cell.source))
            continue
        written.append(f"```python\n{cell.source}\n```")
        for output in cell.outputs:
            data = output.get("data", {"text/plain": output.get("text", "")})
            if "image/png" in data:
                pictures += 1
                picture = f"{name}-{pictures}.png"
                (folder / picture).write_bytes(base64.b64decode(data["image/png"]))
                written.append(f"![{data['text/plain']}]({picture})")
            elif "text/html" in data:
                written.append(f'<div class="output">{data["text/html"]}</div>')
            else:
                written.append(f"```text\n{data['text/plain'].strip()}\n```")
    title, rest = written[0].split("\n", 1)
    return "\n\n".join([title, f"*[This page as a Jupyter notebook]({name}.ipynb)*", rest, *written[1:]]) + "\n"


def notebook(cells: list[NotebookNode]) -> str:
    """The same as the text of an .ipynb file; links lead to the pages of the site that it lies in."""
    made = new_notebook(cells=[NotebookNode(cell) for cell in cells])
    for number, cell in enumerate(made.cells):
        cell["id"] = f"cell-{number}"  # the same in each build
        if cell.cell_type == "markdown":
            cell["source"] = re.sub(_LINK, r"](../\1.html", cell.source)
    made.metadata["kernelspec"] = {"name": "python3", "display_name": "Python 3", "language": "python"}
    validate(made)
    return writes(made)
