"""The page of a sensor's history: one HTML file that holds all it shows, made from the document alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vibrident.history import figures, tables
from vibrident.plots.units import sensor_name
from vibrident.report import page
from vibrident.report.page import Page

CAPTION = (
    "Each calibration with U (k = 2), thick the part that it does not share with others; and between the blue limits, "
    "with 95 % probability, the sensor itself from the last calibration on. Green: tolerance; grey upright: repaired."
)


def sections(document: Mapping[str, Any]) -> list[tuple[str, str, Any, str]]:
    """Name and title of each section, its figure or None, and the rest of its HTML."""
    drift = page.pairs(tables.drift(document)) + page.paragraphs(tables.series(document))
    control = tables.control(document)
    due = tables.due(document)
    return [
        ("values", _title(document), figures.values(document), page.table(tables.calibrations(document))),
        ("drift", "Drift", None, drift),
        ("due", "Next calibration", None, page.pairs(due) if due else ""),
        ("control", "Control charts", figures.control(document), page.pairs(control) if control else ""),
        ("events", "Events", None, page.table(tables.events(document))),
    ]


def history_html(document: Mapping[str, Any]) -> str:
    """The page.

    Raises:
        InputError: plotly, whose script the page embeds, is not installed.
    """
    made = Page(f"History of {sensor_name(document['sensor'])}")
    captions = {"values": CAPTION, "control": "A stable sensor stays within the dashed limits; red: alarm."}
    for name, title, chart, rest in sections(document):
        made.add(name, title, made.figure(name, chart, captions.get(name, "")), rest)
    return made.html()


def _title(document: Mapping[str, Any]) -> str:
    name = tables.quantity_name(document)
    return name[:1].upper() + name[1:]
