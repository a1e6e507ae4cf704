"""What ``import vibrident`` offers, for mkdocstrings to fill from the docstrings."""

from __future__ import annotations

import inspect

import vibrident

_OPTIONS = "    options:\n      heading_level: 3\n"


def api() -> str:
    """Return the page: every public name from where it is defined."""
    groups: dict[str, list[str]] = {"Functions": [], "Classes": [], "Errors": []}
    for name in vibrident.__all__:
        value = getattr(vibrident, name)
        if inspect.isfunction(value):
            groups["Functions"].append(_place(value))
        elif inspect.isclass(value):
            groups["Errors" if issubclass(value, Exception) else "Classes"].append(_place(value))
    parts = ["# Python interface", "All of these are names of `vibrident` itself: `vibrident.read`, and so on."]
    for title, places in groups.items():
        parts.append(f"## {title}")
        parts += [f"::: {place}\n{_OPTIONS}" for place in places]
    return "\n\n".join(parts) + "\n"


def _place(value: object) -> str:
    return f"{value.__module__}.{value.__qualname__}"  # type: ignore[attr-defined]
