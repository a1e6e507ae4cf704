"""Translate tables, sentences and charts of results into the page's language.

What the engine says, such as the message of a warning, stays as it is where no catalogue has it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from vibrident.app.web.language import Language, phrase
from vibrident.base.errors import VibridentError
from vibrident.base.fields import Fields
from vibrident.show.formulas import Mixed
from vibrident.show.media import charts as media
from vibrident.show.media import html
from vibrident.show.views import (
    Axis,
    Block,
    Column,
    Doubt,
    Facts,
    Figure,
    Folded,
    Gallery,
    Panel,
    Sentence,
    Series,
    Stack,
    Table,
)

Chart = tuple[str, bytes, int]  # title, JSON and height in pixels
MAX_CHART_BYTES = 4_000_000  # most bytes of charts sent to the browser at once
#: View → its fields with words of ours, and with views.
_WORDS: Mapping[type, Sequence[str]] = {
    Sentence: ("text", "lead", "end"),
    Doubt: ("title", "meaning", "action", "remedy"),
    Facts: ("rows", "title"),
    Folded: ("summary", "blocks"),
    Gallery: ("blocks",),
    Figure: ("title", "caption", "note", "stacks"),
    Stack: ("panels",),
    Panel: ("x", "y", "series", "title", "marks", "empty"),
    Series: ("band",),
    Table: ("columns", "lead", "notes", "title", "groups"),
}
_T = TypeVar("_T")
_Text = TypeVar("_Text", bound=str)


def fragment(language: Language, *blocks: Block) -> str:
    """Return blocks as HTML."""
    return html.fragment(*translated(language, blocks))


def charts(language: Language, *figures: Figure | None) -> list[Chart]:
    """Return the chart of each stack of figures, without those that are None."""
    drawn = []
    for figure in filter(None, figures):
        for name, chart in media.charts(translated(language, figure)):
            layout = chart["layout"]
            if language.comma:
                layout["separators"] = ",\N{NARROW NO-BREAK SPACE}"
            for menu in layout.get("updatemenus", ()):
                for button in menu["buttons"]:
                    button["label"] = language(button["label"])
            try:
                text = json.dumps(chart, separators=(",", ":"), allow_nan=False)
            except ValueError as error:
                raise VibridentError("NaN or infinity cannot be drawn.") from error
            drawn.append((name or language(figure.title), text.encode(), layout["height"]))
    return drawn


def fitting(drawn: Sequence[Chart], max_bytes: int) -> tuple[list[Chart], int]:
    """Return the charts that fit the limit, and the bytes left; negative if one did not fit."""
    charts = []
    for chart in drawn:
        max_bytes -= len(chart[1])
        if max_bytes < 0:
            break
        charts.append(chart)
    return charts, max_bytes


def translated(language: Language, shown: _T) -> _T:
    """Return words, a view, or several of them, in a language."""
    if language.code == "en" or not shown:
        return shown
    match shown:
        case str():
            return type(shown)(language(shown))
        case tuple():
            return type(shown)(translated(language, item) for item in shown)
        case dict():
            return type(shown)((key, translated(language, item)) for key, item in shown.items())
    words: Fields = {
        name: translated(language, getattr(shown, name)) for name in _WORDS.get(type(shown), ())
    }
    match shown:
        case Table():
            numeric = [column.kind != "text" for column in shown.columns]
            words["rows"] = tuple(
                tuple(map(_cell, [language] * len(row), row, numeric)) for row in shown.rows
            )
        case Column():
            words["title"] = _cell(language, shown.title)
        case Stack():
            name, line, below = shown.title.partition("\n")
            words["title"] = f"{name}{line}{translated(language, below)}"
        case Axis():
            words["label"] = _label(language, shown.label)
            words["ticks"] = tuple((tick, language.number(name)) for tick, name in shown.ticks)
        case Series():
            if not isinstance(shown.label, Mixed):
                words["label"] = translated(language, shown.label)
            words["texts"] = tuple(_number(language, text) for text in shown.texts)
    return replace(shown, **words) if words else shown  # type: ignore[type-var]


def _number(language: Language, text: _Text) -> _Text:
    return type(text)(language.number(text))


def _cell(language: Language, text: _Text, is_number: bool = False) -> _Text:
    """Return a cell in the language if its words are ours, or remarks of these; else unchanged.

    Foreign words, such as the name of a result, stay.
    """
    in_language = language.translation(text)
    if is_number and not in_language:
        return _number(language, text)
    items = [language.translation(item) for item in text.split(", ")]
    if in_language is None and None in items:
        return text if any(c.isalpha() for c in text) else _number(language, text)
    return type(text)(in_language or ", ".join(item or "" for item in items))


def _label(language: Language, label: _Text) -> _Text:
    """Return the label of an axis, which has a line for the quantity and one for the unit."""
    in_language = translated(language, label)
    if in_language != label:
        return in_language
    lines = []
    for line in label.split("\n"):
        unit = line.removeprefix("in ")
        in_unit = language(line) if unit == line else language(phrase("in {unit}"), unit=unit)
        lines.append(in_unit)
    return type(label)("\n".join(lines))
