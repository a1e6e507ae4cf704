"""Entries of a form, made from the keys of a file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from nicegui import ui

from vibrident.app.web import frame
from vibrident.data.io.keys import Key

PLAIN = "dense outlined stack-label"  # the style of all entries


def entry(
    key: Key, value: Any, *, label: str = "", options: Mapping[Any, str] | None = None
) -> Any:
    """Return an element to fill a key in; ``label`` and ``options`` go before the key's own.

    ``value``: what is in it, None for nothing; ``options``: value → words.
    """
    label, kind, usual = label or key.label, key.kind, key.default
    options = options if options is not None else key.options if kind == "choice" else None
    if options is not None:
        stated = value is not None or None in options or usual not in options
        chosen = value if stated else usual
        if chosen is not None and chosen not in options:
            options = {**options, chosen: f"{chosen} (not in this file)"}
        element = ui.select(dict(options), value=chosen, label=label)
        return element.props(f"{PLAIN} options-dense")
    if kind == "flag":
        return ui.checkbox(label, value=bool(value))
    if kind in ("number", "whole"):
        shown = None if value is None else value * key.in_form[1]
        usual = f"{usual:g}" if isinstance(usual, int | float) else ""
        element = ui.number(label, value=shown, placeholder=usual, format="%.12g")
        return element.props(f"{PLAIN} step=any")
    text = "\n".join(value) if isinstance(value, list) else "" if value is None else str(value)
    if kind in ("lines", "paragraphs"):
        return ui.textarea(label, value=text).props(f"{PLAIN} autogrow rows=1")
    hint = "name, or number from 1" if kind == "column" else ""
    element = ui.input(label, value=text, placeholder=hint)
    return element.props(f"{PLAIN} type=date" if kind == "date" else PLAIN)


def filled(key: Key, entered: Any) -> Any:
    """Return what is in the element of a key as its file holds it; None for nothing."""
    value = entered.strip() if isinstance(entered, str) else entered
    if value in (None, "", []):
        return None
    if key.kind == "paragraphs":
        return [line for line in value.split("\n") if line.strip()]
    if key.kind == "column" and isinstance(value, str) and value.isdecimal() and len(value) < 9:
        return int(value)
    if key.kind == "whole":
        return int(value) if float(value).is_integer() else value
    return float(value) / key.in_form[1] if key.kind == "number" else value


class Rows:
    """Entries of several keys each, with a button for one more."""

    def __init__(
        self,
        name: str,
        keys: Sequence[Key],
        values: Sequence[Mapping[str, Any]],
        *,
        options: Mapping[str, Mapping[Any, str]] | None = None,
        on_change: Callable[[], Any] = lambda: None,
    ) -> None:
        self.name, self.options, self.on_change = name, options or {}, on_change
        self.keys = {key.name: key for key in keys}
        self.rows: list[dict[str, Any]] = []
        self.place = ui.element("div").classes("w-full")
        for value in values:
            self.add(value)
        ui.button(f"Add {name.lower()}", on_click=lambda: self.add({})).props("outline")

    def add(self, value: Mapping[str, Any]) -> None:
        """Add a row."""
        row: dict[str, Any] = {}
        number = len(self.rows) + 1
        with self.place, frame.group(f"{self.name} {number}", 0):
            for name, key in self.keys.items():
                row[name] = entry(key, value.get(name), options=self.options.get(name))
                row[name].on_value_change(lambda: self.on_change())
            button = ui.button(icon="close", on_click=partial(self._remove, row))
            button.props("flat round size=sm").props["aria-label"] = (
                f"remove {self.name.lower()} {number}"
            )
        self.rows.append(row)

    def _remove(self, row: dict[str, Any]) -> None:
        self.rows.remove(row)
        next(iter(row.values())).parent_slot.parent.delete()
        self.on_change()

    @property
    def value(self) -> list[dict[str, Any]]:
        """The rows that are filled in."""
        found = [{n: filled(self.keys[n], e.value) for n, e in row.items()} for row in self.rows]
        stated = [
            {n: v for n, v in row.items() if v not in (None, self.keys[n].default)} for row in found
        ]
        return [row for row in stated if row]
