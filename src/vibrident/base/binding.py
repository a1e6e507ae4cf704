"""Bind functions of later packages to names, for methods such as ``result.plot()``.

The package's ``__init__`` binds them, as it binds the public names, so that no subpackage imports
one that depends on it.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable
from typing import Any

_ADDRESSES: dict[str, str] = {}


def bind(**addresses: str) -> None:
    """Bind names to functions, given as "module:function".

    A module is loaded when its function is first called.
    """
    _ADDRESSES.update(addresses)


def bound(name: str) -> Callable[..., Any]:
    """Return the function that a name is bound to."""
    return pkgutil.resolve_name(_ADDRESSES[name])
