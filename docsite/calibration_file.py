"""The calibration file: an example in words, and every key from the schema that checks it."""

from __future__ import annotations

import typing

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from docsite.tables import page, table
from vibrident.data.io.calibration_file import CalibrationFile

_LISTS_AS_TABLES = "[[{}]]"


def calibration_file() -> str:
    """Return the page with a table of keys for each section."""
    return page("calibration-file.md", "\n\n".join(_sections(CalibrationFile, "")))


def _sections(section: type[BaseModel], prefix: str) -> list[str]:
    parts: list[str] = []
    for name, field in section.model_fields.items():
        inner = _section_of(field.annotation)
        if inner is None:
            continue
        repeated = "list" in str(field.annotation)
        heading = (_LISTS_AS_TABLES if repeated else "[{}]").format(prefix + name)
        about = (inner.__doc__ or "").split(": ", 1)[-1].split("; see ")[0].strip()
        parts += [f"### {heading}", "" if about.startswith("[") else about[:1].upper() + about[1:], _keys(inner)]
        parts += _sections(inner, f"{prefix}{name}.")
    return parts


def _keys(section: type[BaseModel]) -> str:
    rows = [
        (f"`{name}`", _expected(field), _default(field))
        for name, field in section.model_fields.items()
        if _section_of(field.annotation) is None
    ]
    return table(("key", "value", "without it"), rows)


def _section_of(annotation: object) -> type[BaseModel] | None:
    """The section that a field holds, be it optional or one of a list."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for part in typing.get_args(annotation):
        if (inner := _section_of(part)) is not None:
            return inner
    return None


def _expected(field: FieldInfo) -> str:
    return field.description or _described(field.annotation)


def _described(annotation: object) -> str:
    """The description that stands deeper in an annotation, as in ``Annotated[…] | None``; else the choices."""
    for part in (*getattr(annotation, "__metadata__", ()), *typing.get_args(annotation)):
        if isinstance(part, FieldInfo) and part.description:
            return part.description
        if isinstance(part, str):
            return "one of " + ", ".join(f"`{choice}`" for choice in typing.get_args(annotation))
        if part is not type(None) and (text := _described(part)):
            return text
    return ""


def _default(field: FieldInfo) -> str:
    if field.default is PydanticUndefined:
        return "required"
    if field.default is None or field.default == "":
        return "–"
    return f"`{field.default!r}`".replace("'", '"')
