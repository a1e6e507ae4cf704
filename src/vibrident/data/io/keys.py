"""The keys of a file, each stated once as a field, for errors, forms and documentation."""

from __future__ import annotations

import typing
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

from pydantic import BaseModel, Field
from pydantic.fields import FieldInfo

#: A form shows ``basic`` keys first and ``more`` in a part that opens; ``expert`` ones are for the
#: file alone.
Level = Literal["basic", "more", "expert"]


@dataclass(frozen=True)
class Shown:
    """Mark of a type that does not say by itself how it is asked for; ``kind`` as of a key."""

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
    """
    more = {"unit": unit, "level": level, "about": about, "words": [*words]}
    extra: Any = more | {"in_form": [*(in_form or (unit, 1.0))]}
    return Field(default, title=label, json_schema_extra=extra)


basic = partial(key, level="basic")
expert = partial(key, level="expert")


@dataclass(frozen=True)
class Key:
    """A key as its field states it."""

    name: str
    field: FieldInfo

    @property
    def title(self) -> str:
        """Return what a form calls it."""
        return self.field.title or self.name.replace("_", " ").capitalize()

    @property
    def label(self) -> str:
        """Return what a form calls it, with the unit in which it asks."""
        return self.labelled(self.title)

    def labelled(self, words: str) -> str:
        """Return the words with the unit in which a form asks for it."""
        unit, _ = self.stated("in_form") or ("", 1.0)
        return f"{words}, {unit}" if unit else words

    def stated(self, what: str) -> Any:
        """Return ``unit``, ``level``, ``about`` or ``words`` of the field."""
        more = self.field.json_schema_extra
        return more.get(what) if isinstance(more, dict) else None

    @property
    def section(self) -> type[BaseModel] | None:
        """Return the section that it holds, be it optional or one of a list."""
        return section_of(self.field.annotation)

    @property
    def choices(self) -> tuple[Any, ...]:
        """Return the values that it may have; empty where they cannot be listed."""
        parts = _parts(self.field.annotation)
        return next((typing.get_args(p) for p in parts if typing.get_origin(p) is Literal), ())

    @property
    def options(self) -> dict[Any, str]:
        """Return choice → what a form calls it; None first where it may be left out."""
        choices = [choice for choice in self.choices if choice != ""]
        words = self.stated("words") or [str(choice) for choice in choices]
        options = dict(zip(reversed([None, *choices]), reversed(words), strict=False))
        absent = {} if self.field.default else {None: options.pop(None, "not stated")}
        return absent | dict(reversed(options.items()))

    @property
    def kind(self) -> str:
        """Return how a form asks for it: choice, number, text, …; ``entries`` for a list."""
        parts = [*self.field.metadata, *_parts(self.field.annotation)]
        several = any(typing.get_origin(part) is list for part in parts)
        marked = next((part.kind for part in parts if isinstance(part, Shown)), None)
        if marked is not None:
            return marked
        if self.section is not None:
            return "entries" if several else "section"
        if self.choices:
            return "choice"
        if several:
            return "paragraphs"
        kinds = {float: "number", bool: "flag", str: "text", int: "whole"}
        return next((kind for each, kind in kinds.items() if each in parts), "text")

    @property
    def expected(self) -> str:
        """Return what the key takes: its own description, that of its type, or its choices."""
        marks = (part for part in _parts(self.field.annotation) if isinstance(part, FieldInfo))
        described = self.field.description or next(filter(None, (m.description for m in marks)), "")
        if described or self.section is None:
            return described or " | ".join(map(str, filter(None, self.choices)))
        heading = bracketed(self.name, self.field)
        several = self.kind == "entries"
        return f"one or more {heading}, in double brackets" if several else f"a section {heading}"


def keys_of(section: type[BaseModel]) -> dict[str, Key]:
    """Return the keys of a section by their names, in order."""
    return {name: Key(name, field) for name, field in section.model_fields.items()}


def section_of(annotation: Any) -> type[BaseModel] | None:
    """Return the section that an annotation holds, be it optional or one of a list."""
    sections = (p for p in _parts(annotation) if isinstance(p, type) and issubclass(p, BaseModel))
    return next(sections, None)


def bracketed(name: str, field: FieldInfo) -> str:
    """Return the heading of a section: in double brackets where there may be several."""
    return f"[[{name}]]" if typing.get_origin(field.annotation) is list else f"[{name}]"


def _parts(annotation: Any) -> Iterator[Any]:
    """Yield what an annotation is made of, from the outside: types, choices, marks."""
    yield annotation
    yield from getattr(annotation, "__metadata__", ())
    for argument in typing.get_args(annotation):
        yield from _parts(argument)
