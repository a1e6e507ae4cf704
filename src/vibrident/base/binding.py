"""Functions of later rooms that methods of earlier objects call: ``result.plot()``, ``sensor.to_scipy()``.

The package's ``__init__`` binds them, as it binds the public names, so that a room knows none that
comes after it.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable
from typing import Any

_PLACES: dict[str, str] = {}


def bind(**places: str) -> None:
    """Say where functions are: name → "module:function"; a module is loaded when its function is first called."""
    _PLACES.update(places)


def bound(name: str) -> Callable[..., Any]:
    """Return the function that is bound to a name."""
    return pkgutil.resolve_name(_PLACES[name])
