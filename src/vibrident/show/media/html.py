"""Documents as HTML: one file that loads nothing from outside, or a fragment of a page."""

from __future__ import annotations

import base64
import importlib.util
import json
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from vibrident.base.escaping import html as escaped
from vibrident.base.extras import require
from vibrident.base.version import __version__
from vibrident.show.formulas import marked, typeset
from vibrident.show.media import charts, drawing
from vibrident.show.views import Block, Column, Document, Figure, Folded, Table

_TEMPLATES = Path(__file__).parent / "templates"
#: With this policy the browser loads nothing from outside the file.
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src "
    "data: blob:; connect-src 'none'"
)


def render(document: Document) -> str:
    """Return the complete file; plotly draws its figures when it is opened.

    Raises:
        InputError: plotly, whose script the page embeds, is not installed.
    """
    blocks = [*document.head, *(block for section in document.sections for block in section.blocks)]
    figures = {figure.name: _drawn(figure) for figure in _figures(blocks)}
    data = json.dumps(figures, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    scripts = (
        (_plotly(), (_TEMPLATES / "page.js").read_text(encoding="utf-8")) if figures else ("", "")
    )
    return _page(document, data=data.replace("<", "\\u003c"), scripts=scripts)


def printed(document: Document) -> str:
    """Return the complete file without a script: its figures are pictures."""
    return _page(document)


def _page(document: Document, data: str = "", scripts: Iterable[str] = ()) -> str:
    from markupsafe import Markup

    css = (_TEMPLATES / "page.css").read_text(encoding="utf-8")
    raw = {
        "css": Markup(css),
        "policy": Markup(_POLICY),
        "data": Markup(data),
        "scripts": list(map(Markup, scripts)),
    }
    return _template().render(document=document, version=__version__, **raw)


def fragment(*blocks: Block) -> str:
    """Return tables, sentences, warnings and pictures for a page that has its own frame."""
    return _template().render(fragment=blocks, scripts=())


@cache
def _template() -> Any:
    import jinja2
    from markupsafe import Markup

    def text(value: Any) -> Any:
        """Escape a text for HTML and typeset our own formulas; everything printed passes here."""
        if isinstance(value, Markup):
            return value
        return Markup(typeset(value, escaped, marked))

    loader = jinja2.FileSystemLoader(_TEMPLATES)
    environment = jinja2.Environment(
        loader=loader, autoescape=True, finalize=text, undefined=jinja2.StrictUndefined
    )
    environment.filters["capital"] = lambda value: value[:1].upper() + value[1:]
    environment.filters["attribute"] = lambda value: Markup(escaped(value))
    environment.filters["called"] = lambda block: Markup(escaped(_called(block)))
    environment.globals |= {
        "mark": lambda column, cell: Markup(_mark(column, cell)),
        "choices": lambda figure: (
            [name for name, _ in charts.charts(figure)] if figure.choice else []
        ),
        "caption": charts.caption,
        "picture": lambda figure: base64.b64encode(drawing.svg(figure).encode()).decode(),
    }
    return environment.get_template("document.html")


def _called(block: Block) -> str:
    """Return the accessible name of a table."""
    title = getattr(block, "title", "")
    names = (
        block.header
        if isinstance(block, Table)
        else [name for name, _ in getattr(block, "rows", ())]
    )
    return title or ", ".join([name for name in names if name][:3])


def _mark(column: Column, cell: str) -> str:
    """Return the class of a cell: number, share, or a word that must not break at hyphens."""
    if column.kind == "share":
        share = cell.partition(" ")[0]
        return (
            f' class="n share" style="--share:{share}%"'
            if share.replace(".", "").isdigit()
            else " class=n"
        )
    if column.kind == "number":
        return " class=n"
    return " class=w" if " " not in cell and len(cell) <= 24 else ""


def _figures(blocks: Iterable[Block]) -> Iterable[Figure]:
    for block in blocks:
        if isinstance(block, Figure):
            yield block
        elif isinstance(block, Folded):
            yield from _figures(block.blocks)


def _drawn(figure: Figure) -> Any:
    drawn_charts = [chart for _, chart in charts.charts(figure)]
    return drawn_charts[0] if len(drawn_charts) == 1 else drawn_charts


@cache
def _plotly() -> str:
    require(
        "plotly",
        "report",
        "The HTML report needs plotly, which is not installed.",
        "⟦report.form = 'html'⟧",
    )
    spec = importlib.util.find_spec("plotly")
    assert spec is not None
    assert spec.submodule_search_locations is not None
    # What plotly.offline.get_plotlyjs() reads, without loading plotly for it.
    folder = Path(next(iter(spec.submodule_search_locations)))
    return (
        (folder / "package_data" / "plotly.min.js")
        .read_text(encoding="utf-8")
        .replace("</script", "<\\/script")
    )
