"""Short representations: what an object holds, without the numbers of its arrays."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

MOST = 1000  # most characters of a representation
MOST_A_FIELD = 160  # most characters of one field of it


class _Short(reprlib.Repr):
    """The standard library's, with arrays by their shape and mappings by what they hold."""

    def repr1(self, x: Any, level: int) -> str:
        """Return one value, ``level`` levels deep at most."""
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


def brief(self: Any) -> str:
    """``__repr__`` for a dataclass: every field that holds something, each cut short."""
    parts = []
    for each in fields(self):
        value = getattr(self, each.name)
        empty = value is None or (isinstance(value, str | tuple | Mapping) and not value)
        if each.repr and not empty:
            text = _short.repr(value)
            parts.append(
                f"{each.name}={text if len(text) <= MOST_A_FIELD else text[: MOST_A_FIELD - 1] + '…'}"
            )
    text = f"{type(self).__name__}({', '.join(parts)})"
    return text if len(text) <= MOST else text[: MOST - 2] + "…)"
