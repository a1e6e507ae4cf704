"""The page of a sensor's history, made from its document alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vibrident.history import figures, tables
from vibrident.present.numbers import sensor_name
from vibrident.present.views import Block, Document, Facts, Section, Sentence, document, section


def shown(life: Mapping[str, Any]) -> Document:
    """The content of the page."""
    return document(f"History of {sensor_name(life['sensor'])}", (), sections(life))


def sections(life: Mapping[str, Any]) -> list[Section]:
    """The parts of the page, for other pages too."""
    return [
        section(
            "values", f"History of the {tables.quantity_name(life)}", figures.values(life), tables.calibrations(life)
        ),
        section("drift", "Drift", *_facts(tables.drift(life)), *(Sentence(text) for text in tables.series(life))),
        section("due", "Next calibration", *_facts(tables.due(life))),
        section("control", "Control charts", figures.control(life), *_facts(tables.control(life))),
        section("events", "Events", tables.events(life)),
    ]


def _facts(rows: list[tuple[str, str]]) -> list[Block]:
    return [Facts(tuple(rows))] if rows else []


def history_html(life: Mapping[str, Any]) -> str:
    """The page as HTML.

    Raises:
        InputError: plotly, whose script the page embeds, is not installed.
    """
    from vibrident.present import html

    return html.render(shown(life))
