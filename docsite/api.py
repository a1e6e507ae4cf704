"""What ``import vibrident`` offers, for mkdocstrings to fill from the docstrings."""

from __future__ import annotations

import inspect
from pathlib import Path

import vibrident

STABILITY = Path(__file__).parent / "pages" / "stability.md"
_OPTIONS = "    options:\n      heading_level: 3\n"


def api() -> str:
    """Return the page: every public name from where it is defined, and what stays as it is."""
    groups: dict[str, list[str]] = {"Functions": [], "Classes": [], "Errors": []}
    for name in vibrident.__all__:
        value = getattr(vibrident, name)
        if inspect.isfunction(value):
            groups["Functions"].append(_entry(name, value))
        elif inspect.isclass(value):
            groups["Errors" if issubclass(value, Exception) else "Classes"].append(
                _entry(name, value)
            )
    parts = [
        "# Python interface",
        "All of these are names of `vibrident` itself: `vibrident.read`, and so on.",
    ]
    for title, entries in groups.items():
        parts += [f"## {title}", *entries]
    parts.append(STABILITY.read_text(encoding="utf-8").rstrip())
    return "\n\n".join(parts) + "\n"


def _entry(name: str, value: object) -> str:
    """Return the directive for a name, from where its value is defined."""
    identifier = f"{value.__module__}.{value.__qualname__}"  # type: ignore[attr-defined]
    heading = "" if identifier.endswith(f".{name}") else f"      heading: {name}\n"
    return f"::: {identifier}\n{_OPTIONS}{heading}"
