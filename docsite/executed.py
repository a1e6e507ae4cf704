"""Programs that are pages of the documentation and notebooks to download.

Each ``notebooks/NAME.py`` is run once for both.

A program has cells between ``# %%`` lines. A ``# %% [markdown]`` cell is text. Other cells are run
as Jupyter does: what they print, the value of a last expression, and open figures are shown below
them. A ``# %% [folded] Title`` cell is run and shown as its title, which opens it: it simulates the
data of a story. A ``# %% [check]`` cell is run and not shown: it asserts what the text claims, and
the build ends where that is false. A printed line too wide for the page ends the build, too.
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
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nbformat import NotebookNode, validate, writes
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PROGRAMS = Path(__file__).parent / "notebooks"
_LINK = r"\]\(([a-z-]+)\.md"  # to a page beside the folder of the notebooks
_CELL = re.compile(r"^# %%(?: \[(\w+)\](?: ([^\n]+))?)?\n(.*?)(?=^# %%|\Z)", re.M | re.S)
_DPI = 110
#: Characters of a line of code or of printed text: as many as the page shows without scrolling.
MAX_WIDTH = 76


@dataclass(frozen=True)
class Part:
    """Cell of a program: kind (``markdown``, ``check``, ``folded`` or empty), title and text."""

    kind: str
    title: str
    text: str


def write(docs: Path, names: Sequence[str] = ()) -> None:
    """Run programs, and write their pages, pictures and notebooks into ``notebooks/``.

    Args:
        docs: folder of the documentation.
        names: of the programs, whose pages of before are kept; none: all, in place of all.
    """
    folder = docs / "notebooks"
    if not names:
        shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(exist_ok=True)
    for name in names or sorted(program.stem for program in PROGRAMS.glob("*.py")):
        cells = run(PROGRAMS / f"{name}.py")
        require_narrow(cells, name)
        (folder / f"{name}.md").write_text(page(cells, folder, name), encoding="utf-8")
        (folder / f"{name}.ipynb").write_text(notebook(cells), encoding="utf-8")


def run(program: Path) -> list[NotebookNode]:
    """Run a program's cells in a temporary folder and return them with their outputs."""
    import matplotlib as mpl

    mpl.use("agg")
    names: dict[str, Any] = {"__name__": "notebook"}
    cells = []
    with (
        tempfile.TemporaryDirectory(prefix="vibrident-notebook-") as folder,
        contextlib.chdir(folder),
    ):
        for part in parts(program.read_text(encoding="utf-8")):
            if part.kind == "markdown":
                cells.append(new_markdown_cell(re.sub(r"^# ?", "", part.text, flags=re.MULTILINE)))
                continue
            name = f"<{program.name}, cell {len(cells)}>"
            # As Jupyter does: the source of what a cell defines can be looked up.
            linecache.cache[name] = len(part.text), None, part.text.splitlines(keepends=True), name
            outputs = [*_outputs(part.text, names, name)]
            if part.kind == "check":
                continue
            cell = new_code_cell(part.text, outputs=outputs)
            if part.kind == "folded":
                cell.metadata |= {"jupyter": {"source_hidden": True}, "title": part.title}
            cells.append(cell)
    return cells


def parts(text: str) -> list[Part]:
    """Return the cells of a program."""
    return [Part(kind, title, cell.strip()) for kind, title, cell in _CELL.findall(text)]


def wide_lines(text: str) -> list[str]:
    """Return the lines of code or printed text that are wider than the page."""
    return [line for line in text.splitlines() if len(line) > MAX_WIDTH]


def require_narrow(cells: list[NotebookNode], name: str) -> None:
    """Raise a ValueError where a printed line is wider than the page."""
    for output in (output for cell in cells for output in cell.get("outputs", ())):
        data = output.get("data", {"text/plain": output.get("text", "")})
        wide = wide_lines(data["text/plain"]) if data.keys() == {"text/plain"} else []
        if wide:
            raise ValueError(f"{name} prints lines of more than {MAX_WIDTH} characters: {wide}")


def _outputs(cell: str, names: dict[str, Any], name: str) -> Iterator[NotebookNode]:
    tree = ast.parse(cell, name)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed, value = io.StringIO(), None
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, name, "exec"), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), name, "eval"), names)
    if printed.getvalue():
        yield new_output("stream", text=printed.getvalue())
    if hasattr(value, "savefig"):
        yield _picture(value)
    elif value is not None:
        as_html = getattr(value, "_repr_html_", None)
        data = {"text/plain": repr(value)} | ({"text/html": as_html()} if as_html else {})
        yield new_output("execute_result", data)
    yield from _figures()


def _figures() -> Iterator[NotebookNode]:
    """Return the open figures as outputs, and close them."""
    import matplotlib.pyplot as plt

    for number in plt.get_fignums():
        figure = plt.figure(number)
        yield _picture(figure)
        plt.close(figure)


def _picture(figure: Figure) -> NotebookNode:
    """Return a figure as an output; its titles are what it says where it is not seen."""
    titles = (axes.get_title() for axes in figure.axes)
    title = figure.get_suptitle() or " and ".join(filter(None, titles))
    drawn = io.BytesIO()
    figure.savefig(drawn, format="png", dpi=_DPI)
    content = base64.b64encode(drawn.getvalue()).decode()
    return new_output("display_data", {"image/png": content, "text/plain": title})


def page(cells: list[NotebookNode], folder: Path, name: str) -> str:
    """The page's Markdown; its pictures are written into the folder."""
    written, pictures = [], 0
    for cell in cells:
        if cell.cell_type == "markdown":
            written.append(re.sub(_LINK, r"](../\1.md", cell.source))
            continue
        written.append(_shown_code(cell))
        for output in cell.outputs:
            data = output.get("data", {"text/plain": output.get("text", "")})
            if "image/png" in data:
                pictures += 1
                picture = f"{name}-{pictures}.png"
                (folder / picture).write_bytes(base64.b64decode(data["image/png"]))
                written.append(f"![{data['text/plain']}]({picture})")
            elif "text/html" in data:
                written.append(f'<div class="output">{_themed(data["text/html"])}</div>')
            else:
                written.append(f"```text\n{data['text/plain'].strip()}\n```")
    title, _, introduction = written[0].partition("\n")
    download = f"*[This page as a Jupyter notebook]({name}.ipynb)*"
    return "\n\n".join([title, download, introduction, *written[1:]]) + "\n"


def _themed(html: str) -> str:
    """Return HTML whose tables of pandas look as all tables of the site do."""
    without_style = re.sub(r"<style scoped>.*?</style>\s*", "", html, flags=re.DOTALL)
    return without_style.replace('<table border="1" class="dataframe">', "<table>")


def _shown_code(cell: NotebookNode) -> str:
    """Return a code cell's Markdown; of a folded one a box that opens."""
    code = f"```python\n{cell.source}\n```"
    if "title" not in cell.metadata:
        return code
    return f'??? note "{cell.metadata["title"]}"\n\n{textwrap.indent(code, "    ")}'


def notebook(cells: list[NotebookNode]) -> str:
    """Return the text of an .ipynb file, whose links lead to the pages of its site."""
    document = new_notebook(cells=[NotebookNode(cell) for cell in cells])
    for number, cell in enumerate(document.cells):
        cell["id"] = f"cell-{number}"  # the same in each build
        if cell.cell_type == "markdown":
            cell["source"] = re.sub(_LINK, r"](../\1.html", cell.source)
    document.metadata["kernelspec"] = {
        "name": "python3",
        "display_name": "Python 3",
        "language": "python",
    }
    validate(document)
    return writes(document)
