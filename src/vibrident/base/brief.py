"""Short representations: of objects without the numbers of their arrays, and of many names."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

MAX_LENGTH = 1000  # characters of a representation
MAX_FIELD_LENGTH = 160  # characters of one field


class _Short(reprlib.Repr):
    """The standard library's class, with arrays by their shape and mappings by their items."""

    def repr1(self, x: Any, level: int) -> str:
        """Return the representation of one value, at most ``level`` levels deep."""
        if isinstance(x, np.ndarray):
            shape = "×".join(str(length) for length in x.shape)
            return f"<{shape} {x.dtype}>" if x.size > 4 else repr(x.tolist())
        if isinstance(x, Mapping):
            return self.repr_dict(dict(x), level)
        if is_dataclass(x) and level < self.maxlevel:
            return f"{type(x).__name__}(…)"
        return super().repr1(x, level)


_short = _Short()
_short.maxlevel = 3
_short.maxtuple = 4
_short.maxlist = 4
_short.maxdict = 8
_short.maxstring = _short.maxother = 80


def first_names(names: Sequence[str], most: int) -> str:
    """Return the first names, ``most`` at most, and how many others there are."""
    excess = len(names) - most
    return ", ".join(names[:most]) + (f" and {excess} more" if excess > 0 else "")


def brief(self: Any) -> str:
    """Return a representation of a dataclass: every field that is not empty, each cut short."""
    shown_fields = []
    for attribute in fields(self):
        value = getattr(self, attribute.name)
        empty = value is None or (isinstance(value, str | tuple | Mapping) and not value)
        if attribute.repr and not empty:
            text = _short.repr(value)
            if len(text) > MAX_FIELD_LENGTH:
                text = text[: MAX_FIELD_LENGTH - 1] + "…"
            shown_fields.append(f"{attribute.name}={text}")
    text = f"{type(self).__name__}({', '.join(shown_fields)})"
    return text if len(text) <= MAX_LENGTH else text[: MAX_LENGTH - 2] + "…)"
