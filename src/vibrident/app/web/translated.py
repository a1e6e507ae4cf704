"""Translate tables, sentences and charts of results into the page's language.

What the engine says, such as the message of a warning, stays as it is where no catalogue has it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar

from vibrident.app.web.language import Language, phrase
from vibrident.show.formulas import Mixed
from vibrident.show.media import html
from vibrident.show.media.charts import Chart
from vibrident.show.media.charts import charts as drawn
from vibrident.show.views import (
    Axis,
    Beside,
    Block,
    Column,
    Doubt,
    Facts,
    Figure,
    Folded,
    Panel,
    Sentence,
    Series,
    Stack,
    Table,
)

_T = TypeVar("_T", bound=str)


def fragment(language: Language, *blocks: Block) -> str:
    """Return blocks as HTML."""
    return html.fragment(*(translated(language, block) for block in blocks))


def charts(language: Language, figure: Figure) -> list[tuple[str, Chart]]:
    """Return the name and the chart of each stack of a figure."""
    named_charts = drawn(_figure(language, figure))
    for _, chart in named_charts:
        if language.comma:
            chart["layout"]["separators"] = ",\N{NARROW NO-BREAK SPACE}"
        for menu in chart["layout"].get("updatemenus", ()):
            for button in menu["buttons"]:
                button["label"] = language(button["label"])
    return named_charts


def translated(language: Language, block: Block) -> Block:
    """Return a block in a language."""
    if language.code == "en":
        return block
    match block:
        case Table():
            return _table(language, block)
        case Sentence():
            words = {
                name: _translate(language, getattr(block, name)) for name in ("text", "lead", "end")
            }
            return replace(block, **words)
        case Doubt():
            meaning = _translate(language, block.meaning)
            action = _translate(language, block.action)
            title = _translate(language, block.title)
            remedy = _translate(language, block.remedy)
            return replace(block, title=title, meaning=meaning, action=action, remedy=remedy)
        case Facts():
            rows = tuple(
                (_translate(language, a), b and _translate(language, b)) for a, b in block.rows
            )
            return replace(block, rows=rows, title=_translate(language, block.title))
        case Folded():
            blocks = tuple(translated(language, inner) for inner in block.blocks)
            return Folded(_translate(language, block.summary), blocks)
        case Beside():
            return Beside(tuple(translated(language, inner) for inner in block.blocks))
        case Figure():
            return _figure(language, block)
    return block


def _table(language: Language, table: Table) -> Table:
    heads = tuple(_head(language, column) for column in table.columns)
    numeric = [column.kind != "text" for column in table.columns]
    rows = tuple(
        tuple(
            _cell(language, cell)
            if not number or language.translation(cell)
            else _number(language, cell)
            for cell, number in zip(row, numeric, strict=True)
        )
        for row in table.rows
    )
    return replace(
        table,
        columns=heads,
        rows=rows,
        lead=tuple(_translate(language, text) for text in table.lead),
        notes=tuple(_translate(language, text) for text in table.notes),
        title=_translate(language, table.title),
        groups={number: _translate(language, words) for number, words in table.groups.items()},
    )


def _number(language: Language, cell: _T) -> _T:
    return type(cell)(language.number(cell))


def _head(language: Language, column: Column) -> Column:
    """Return the head of a column; foreign words, such as the name of a result, stay."""
    return replace(column, title=_cell(language, column.title))


def _cell(language: Language, text: _T) -> _T:
    """Return a cell in the language if its words are ours, or remarks of these; else unchanged."""
    items = [language.translation(item) for item in text.split(", ")]
    translation = language.translation(text) or ", ".join(item or "" for item in items)
    if language.translation(text) is None and None in items:
        translation = text if any(c.isalpha() for c in text) else language.number(text)
    return type(text)(translation)


def _translate(language: Language, text: _T) -> _T:
    return type(text)(language(text)) if text else text


def _figure(language: Language, figure: Figure) -> Figure:
    if language.code == "en":
        return figure
    words = {
        name: _translate(language, getattr(figure, name)) for name in ("title", "caption", "note")
    }
    return replace(
        figure, stacks=tuple(_stack(language, stack) for stack in figure.stacks), **words
    )


def _stack(language: Language, stack: Stack) -> Stack:
    name, line, below = stack.title.partition("\n")
    title = f"{name}{line}{_translate(language, below)}"
    return replace(
        stack, panels=tuple(_panel(language, panel) for panel in stack.panels), title=title
    )


def _panel(language: Language, panel: Panel) -> Panel:
    return replace(
        panel,
        x=_axis(language, panel.x),
        y=_axis(language, panel.y),
        series=tuple(_series(language, line) for line in panel.series),
        title=_translate(language, panel.title),
        marks=tuple((x, _translate(language, words)) for x, words in panel.marks),
        empty=_translate(language, panel.empty),
    )


def _axis(language: Language, axis: Axis) -> Axis:
    """Return an axis; its label has a line for the quantity and one for the unit."""
    label = _translate(language, axis.label)
    if label == axis.label:
        label = type(label)("\n".join(_line(language, line) for line in axis.label.split("\n")))
    ticks = tuple((tick, language.number(name)) for tick, name in axis.ticks)
    return replace(axis, label=label, ticks=ticks)


def _line(language: Language, line: str) -> str:
    unit = line.removeprefix("in ")
    return language(line) if unit == line else language(phrase("in {unit}"), unit=unit)


def _series(language: Language, series: Series) -> Series:
    texts: Any = tuple(type(text)(language.number(text)) for text in series.texts)
    is_ours = not isinstance(series.label, Mixed)
    label = _translate(language, series.label) if is_ours else series.label
    band = _translate(language, series.band)
    return replace(series, label=label, band=band, texts=texts)
