"""What is shown of a sensor's history, on pages and on a terminal, made from its document alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from vibrident.history import figures, tables
from vibrident.present.numbers import sensor_name
from vibrident.present.views import Block, Document, Section, document, section


def report(life: Mapping[str, Any]) -> Document:
    """The content of the page."""
    return document(f"History of {sensor_name(life['sensor'])}", (), sections(life))


def sections(life: Mapping[str, Any]) -> list[Section]:
    """The parts of the page, for other pages too."""
    name = tables.quantity_name(life)
    return [
        section("values", f"History of the {name}", figures.values(life), tables.calibrations(life)),
        section("drift", "Drift", tables.drift(life), *tables.series(life)),
        section("due", "Next calibration", tables.due(life)),
        section("control", "Control charts", figures.control(life), tables.control(life)),
        section("events", "Events", tables.events(life)),
    ]


def printed(life: Mapping[str, Any]) -> tuple[Block | None, ...]:
    """The same for a terminal, with a chart of letters in place of pictures."""
    title = f"{sensor_name(life['sensor'])}: {tables.quantity_name(life)}"
    calibrations, events = replace(tables.calibrations(life), title=title), tables.events(life)
    return (
        calibrations,
        tables.chart(life),
        *tables.series(life),
        tables.drift(life),
        tables.control(life),
        tables.due(life),
        None if events is None else replace(events, title="Events"),
    )
