"""Build the entries of a form from the keys of a file."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from typing import Any

from nicegui import events, ui

from vibrident.app.web import frame
from vibrident.app.web.form.sources import BANDS, bands_of, table_of
from vibrident.app.web.language import page_language, phrase, translate
from vibrident.base.fields import Fields, GivenFields
from vibrident.data.io.keys import Key

PLAIN = "dense outlined stack-label"  # the style of all entries


def entry(
    key: Key,
    value: Any,
    *,
    label: str = "",
    options: Mapping[Any, str] | None = None,
    unit: tuple[str, float] | None = None,
) -> Any:
    """Return an element to fill a key in; ``label``, ``options`` and ``unit`` go before its own.

    ``label`` and the words of ``options`` are in the page's language; those of the key are said in
    it here. ``value``: what is in it, None for nothing; ``options``: value → words; ``unit``: as
    ``in_form`` of a key.
    """
    label = label or page_language().label(key.label)
    kind = key.kind
    usual = key.default
    if options is None and kind == "choice":
        options = {choice: translate(words) for choice, words in key.options.items()}
    if options is not None:
        is_given = value is not None or None in options or usual not in options
        selected = value if is_given else usual
        if selected is not None and selected not in options:
            options = {
                **options,
                selected: translate("{column} (not in this file)", column=selected),
            }
        element = ui.select(dict(options), value=selected, label=label)
        return element.props(f"{PLAIN} options-dense")
    if kind == "flag":
        return ui.checkbox(label, value=bool(value))
    if kind in ("number", "whole"):
        displayed = None if value is None else value * (unit or key.in_form)[1]
        usual = f"{usual:g}" if isinstance(usual, int | float) else ""
        element = ui.number(label, value=displayed, placeholder=usual, format="%.12g")
        return element.props(f"{PLAIN} step=any")
    text = "\n".join(value) if isinstance(value, list) else "" if value is None else str(value)
    if kind in ("lines", "paragraphs"):
        return ui.textarea(label, value=text).props(f"{PLAIN} autogrow rows=1")
    hint = translate("name, or number from 1") if kind == "column" else ""
    element = ui.input(label, value=text, placeholder=hint)
    return element.props(f"{PLAIN} type=date" if kind == "date" else PLAIN)


def filled(key: Key, entered: Any, unit: tuple[str, float] | None = None) -> Any:
    """Return what is in the element of a key as its file holds it; None for nothing.

    ``unit``: in which it was asked for, as ``in_form`` of a key; None for the key's own.
    """
    value = entered.strip() if isinstance(entered, str) else entered
    if value in (None, "", []):
        return None
    if key.kind == "pairs":
        size = (unit or key.in_form)[1]
        pairs: Any = value
        return [[f, None if u is None else float(f"{u / size:.15g}")] for f, u in pairs]
    if key.kind == "paragraphs":
        return [line for line in value.split("\n") if line.strip()]
    if key.kind == "column" and isinstance(value, str) and value.isdecimal() and len(value) < 9:
        return int(value)
    if key.kind == "whole":
        return int(value) if float(value).is_integer() else value
    if key.kind == "number":
        return float(f"{float(value) / (unit or key.in_form)[1]:.15g}")  # 0.7 % is 0.007
    return value


class RowEntries:
    """Entries of several keys each, with a button for one more."""

    def __init__(
        self,
        name: str,
        keys: Sequence[Key],
        values: Sequence[GivenFields],
        *,
        options: Mapping[str, Mapping[Any, str]] | None = None,
        rare: Collection[str] = (),
        on_change: Callable[[], Any] = lambda: None,
        applies: Callable[[Key, GivenFields], bool] = Key.applies,
        to_form: Callable[[GivenFields], GivenFields] = dict,
        to_file: Callable[[GivenFields], Fields] = dict,
    ) -> None:
        """Build the rows of ``values``; each is called ``name``, in English, and its number.

        ``options``: key → value → words, before its own; ``rare``: keys that are shown where
        somebody has stated one, or wants them all; ``applies``: says whether a key has a meaning
        beside the values of the others; ``to_form``: converts an entry of the
        file to a row of the form, ``to_file``: the way back.
        """
        self.name = name
        self.options = options or {}
        self.on_change = on_change
        self.applies = applies
        noun = translate(name.lower())
        self.to_form = to_form
        self.to_file = to_file
        self.keys = {key.name: key for key in keys}
        self.rare = {key for key in rare if key in self.keys}
        self.with_all = any(self.rare & {*value} for value in values)
        self.rows: list[Fields] = []
        self.rows_element = ui.element("div").classes("w-full")
        for value in values:
            self.add(self.to_form(value))
        with frame.actions():
            frame.add_button(
                translate("Add {thing}", thing=noun), lambda: self.add(self.to_form({}))
            )
            if self.rare and not self.with_all:
                ui.checkbox(translate("By temperature"), on_change=self._reveal).props("dense")

    def offer(self, name: str, options: Mapping[Any, str]) -> None:
        """Offer other choices of a key, in all rows."""
        self.options = {**self.options, name: options}
        for row in self.rows:
            row[name].set_options(dict(options), value=row[name].value)

    def _reveal(self, event: events.ValueChangeEventArguments) -> None:
        """Show or hide the rare keys."""
        self.with_all = bool(event.value)
        for row in self.rows:
            self._fit(row)

    def add(self, value: GivenFields) -> None:
        """Add a row."""
        row: Fields = {}
        number = len(self.rows) + 1
        usual = {name: key.default for name, key in self.keys.items() if key.default is not ...}
        with self.rows_element, frame.add_group(f"{translate(self.name)} {number}", 0) as group:
            group.classes(remove="fields", add="entries-row")
            for name, key in self.keys.items():
                unit = key.asked_in({**usual, **value})
                options = self.options.get(name)
                if key.kind == "pairs":
                    row[name] = BandEntries(value.get(name) or (), unit)
                    row[name].on_change = lambda: self._edited(row)
                    continue
                row[name] = entry(key, value.get(name), options=options, unit=unit)
                row[name].classes("long" if key.kind == "text" else "")
                row[name].on_value_change(lambda: self._edited(row))
            row_name = f"{translate(self.name.lower())} {number}"
            frame.add_remove_button(partial(self._remove, row), row_name)
        self.rows.append(row)
        self._fit(row)

    def _edited(self, row: GivenFields) -> None:
        self._fit(row)
        self.on_change()

    def _fit(self, row: GivenFields) -> None:
        """Show the keys that apply beside the others, in their units."""
        entered = {name: element.value for name, element in row.items()}
        for name, key in self.keys.items():
            row[name].visible = self.applies(key, entered) and (
                self.with_all or name not in self.rare
            )
            if key.in_form_by is not None:
                _show_unit(row[name], key.asked_in(entered)[0])

    def _remove(self, row: Fields) -> None:
        self.rows.remove(row)
        next(iter(row.values())).parent_slot.parent.delete()
        self.on_change()

    @property
    def value(self) -> list[Fields]:
        """Return the rows that are filled in, with the keys that apply."""
        return [row for row in map(self.to_file, map(self._value, self.rows)) if row]

    def _value(self, row: GivenFields) -> Fields:
        entered = {name: element.value for name, element in row.items()}
        values = {}
        for name, key in self.keys.items():
            value = filled(key, entered[name], key.asked_in(entered))
            if self.applies(key, entered) and value not in (None, key.default):
                values[name] = value
        return values


def entered(elements: GivenFields, keys: Mapping[str, Key]) -> Fields:
    """Return what is filled in, by key, as a file holds it; rows for a list of entries."""
    values = {
        name: element.value
        if isinstance(element, RowEntries)
        else filled(keys[name], element.value)
        for name, element in elements.items()
    }
    return {name: value for name, value in values.items() if value not in (None, [])}


class BandEntries(RowEntries):
    """A value by frequency within a row: bands, or single frequencies, with a value each.

    ``unit``: of the values, and how many of it are one of the file's unit.
    """

    def __init__(self, table: Sequence[Sequence[float]], unit: tuple[str, float]) -> None:
        bands = [{**band, "value": band["value"] * unit[1]} for band in bands_of(table)]
        self.unit = unit[0]
        with ui.element("div").classes("by-frequency") as self.frame:
            super().__init__(phrase("Band"), BANDS, bands or [{}])

    @property
    def visible(self) -> bool:
        """Return whether it is seen."""
        return self.frame.visible

    @visible.setter
    def visible(self, is_visible: bool) -> None:
        self.frame.visible = is_visible

    @property
    def value(self) -> Any:
        """Return the table, its values in the unit in which they were asked for."""
        return table_of(super().value)

    def add(self, value: GivenFields) -> None:
        """Add a band."""
        super().add(value)
        _show_unit(self, self.unit)


def _show_unit(element: Any, unit: str) -> None:
    """Show the unit behind what is filled in; of bands, behind the value of each."""
    if isinstance(element, BandEntries):
        element.unit = unit
    for value in (
        [row["value"] for row in element.rows] if isinstance(element, BandEntries) else [element]
    ):
        value.props["suffix"] = unit
