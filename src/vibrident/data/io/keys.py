"""The keys of a file, each stated once as a field, for errors, forms and documentation."""

from __future__ import annotations

import typing
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

from pydantic import BaseModel, Field
from pydantic.fields import FieldInfo

#: A form shows ``basic`` keys first and ``more`` in a part that opens; ``expert`` ones are for the
#: file alone.
Level = Literal["basic", "more", "expert"]


@dataclass(frozen=True)
class FormKind:
    """Kind of form field of a type that does not imply it; ``kind`` as of a key."""

    kind: str


def key(
    label: str | None = None,
    unit: str = "",
    *,
    level: Level = "more",
    default: Any = None,
    about: str = "",
    words: Sequence[str] = (),
    in_form: tuple[str, float] | None = None,
    in_form_by: tuple[str, Mapping[str, tuple[str, float]]] | None = None,
    only: tuple[str, Sequence[str]] | None = None,
) -> Any:
    """Return the field of a key.

    Args:
        label: what a form calls it; None for the words of its name.
        unit: of its numbers, as printed.
        level: where a form shows it.
        default: the value without it; ``...`` where it must be there.
        about: a further sentence for the documentation.
        words: what a form calls each of the choices, or first their absence.
        in_form: the unit in which a form asks for it, and how many of that are one of ``unit``.
        in_form_by: the same by the value of another key of the section, which comes first.
        only: another key of the section, and its values with which this one has a meaning.
    """
    more = {"unit": unit, "level": level, "about": about, "words": [*words]}
    by = None if in_form_by is None else [in_form_by[0], dict(in_form_by[1])]
    extra: Any = more | {"in_form": [*(in_form or (unit, 1.0))], "in_form_by": by}
    extra["only"] = None if only is None else [only[0], [*only[1]]]
    return Field(default, title=label, json_schema_extra=extra)


basic = partial(key, level="basic")
expert = partial(key, level="expert")


@dataclass(frozen=True)
class Key:
    """A key as its field states it."""

    name: str
    default: Any  # the value without it; ``...`` where it is required
    kind: str  # how a form asks for it: choice, number, text, …; ``entries`` for a list of sections
    options: Mapping[Any, str]  # of a choice: value → what a form calls it, None first if optional
    section: type[BaseModel] | None  # the section that it holds, be it one of a list
    expected: str  # what it takes, in words
    title: str  # what a form calls it
    unit: str = ""
    level: str = ""
    about: str = ""
    in_form: tuple[str, float] = ("", 1.0)  # the unit in which a form asks, and its number in one
    in_form_by: tuple[str, Mapping[str, tuple[str, float]]] | None = None  # key → its value → both
    only: tuple[str, Sequence[str]] | None = None  # another key, and its values with which it holds

    def asked_in(self, row: Mapping[str, Any]) -> tuple[str, float]:
        """Return the unit in which a form asks beside the other keys, and its number in one."""
        if self.in_form_by is None:
            return self.in_form
        other_key, units = self.in_form_by
        return units.get(row.get(other_key) or "", ("", 1.0))

    def applies(self, row: Mapping[str, Any]) -> bool:
        """Return whether the key has a meaning beside the values of the others."""
        return self.only is None or row.get(self.only[0]) in self.only[1]

    @property
    def label(self) -> str:
        """Return the title with the unit in which a form asks."""
        return self.title + (f", {self.in_form[0]}" if self.in_form[0] else "")

    @property
    def heading(self) -> str:
        """Return the name of a section in brackets, double ones where there may be several."""
        return f"[[{self.name}]]" if self.kind == "entries" else f"[{self.name}]"


def keys_of(section: type[BaseModel]) -> dict[str, Key]:
    """Return the keys of a section by their names, in order."""
    return {name: _key(name, field) for name, field in section.model_fields.items()}


def _key(name: str, field: FieldInfo) -> Key:
    marks = [*field.metadata, *_type_parts(field.annotation)]
    extra: Any = field.json_schema_extra
    extra_values = dict(extra) if isinstance(extra, dict) else {}
    default = ... if field.is_required() else field.default
    section = next((p for p in marks if isinstance(p, type) and issubclass(p, BaseModel)), None)
    choices = next((typing.get_args(p) for p in marks if typing.get_origin(p) is Literal), ())
    kind = _kind(marks, section is not None, bool(choices))
    described = [mark.description for mark in marks if isinstance(mark, FieldInfo)]
    heading = f"one or more [[{name}]], in double brackets" if kind == "entries" else f"[{name}]"
    words = heading if section else " | ".join(str(choice) for choice in choices if choice)
    return Key(
        name,
        default,
        kind,
        _options(choices, extra_values.pop("words", ()), default),
        section,
        next(filter(None, (field.description, *described)), words),
        field.title or name.replace("_", " ").capitalize(),
        **extra_values,
    )


def _kind(marks: list[Any], section: bool, choices: bool) -> str:
    several = any(typing.get_origin(mark) is list for mark in marks)
    marked = next((mark.kind for mark in marks if isinstance(mark, FormKind)), None)
    if marked or choices:
        return marked or "choice"
    if several:
        return "entries" if section else "paragraphs"
    kinds = {float: "number", bool: "flag", str: "text", int: "whole"}
    plain = next((kind for key, kind in kinds.items() if key in marks), "text")
    return "section" if section else plain


def _options(choices: tuple[Any, ...], words: Sequence[str], default: Any) -> dict[Any, str]:
    """Return choice → words, these from the last; None first where it may be left out."""
    named_choices = [choice for choice in choices if choice != ""]
    words = words or [str(choice) for choice in named_choices]
    options = dict(zip([None, *named_choices][-len(words) :], words, strict=True)) if words else {}
    return options if default or None in options else {None: "not stated", **options}


def _type_parts(annotation: Any) -> Iterator[Any]:
    """Yield what an annotation is made of, from the outside: types, choices, marks."""
    yield annotation
    yield from getattr(annotation, "__metadata__", ())
    for argument in typing.get_args(annotation):
        yield from _type_parts(argument)
