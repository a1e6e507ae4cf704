"""The public names of ``vibrident`` with their signatures, as text: ``python -m tests.support.door`` prints it."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Iterator

import vibrident

MAX_LINE = 96  # characters of a signature in one line


def described() -> str:
    """Return the names in alphabetical order, a parameter a line, then what a class has beside its fields."""
    return "\n".join(line for name in sorted(vibrident.__all__) for line in _lines(name)) + "\n"


def _lines(name: str) -> Iterator[str]:
    value = getattr(vibrident, name)
    if inspect.isclass(value) and issubclass(value, Exception):
        yield f"{name}({value.__base__.__name__ if value.__base__ else ''})"
    elif callable(value):
        yield from _signature(name, value)
    else:
        yield name
    if inspect.isclass(value):
        for member in _members(value):
            yield f"  {member}"


def _members(value: type) -> Iterator[str]:
    """Describe what a class defines itself; fields are told by the signature of its constructor."""
    fields = {field.name for field in dataclasses.fields(value)} if dataclasses.is_dataclass(value) else set()
    for name, member in sorted(vars(value).items()):
        if name.startswith("_") or name in fields:
            continue
        if isinstance(member, classmethod | staticmethod) or inspect.isfunction(member):
            yield from _signature(f".{name}", getattr(value, name))
        else:
            yield f".{name}"


def _signature(name: str, value: Callable[..., object]) -> Iterator[str]:
    """Return the name, its parameters (a line each, where there are many), and what is returned."""
    signature = inspect.signature(value)
    parts, kind = [], None
    for parameter in signature.parameters.values():
        if parameter.kind is parameter.KEYWORD_ONLY and kind not in (parameter.KEYWORD_ONLY, parameter.VAR_POSITIONAL):
            parts.append("*")
        kind = parameter.kind
        parts.append(_printed(parameter))
    returned = signature.return_annotation
    end = ")" if returned is signature.empty else f") -> {returned}"
    line = f"{name}({', '.join(parts)}{end}"
    if len(line) <= MAX_LINE:
        yield line
        return
    yield f"{name}("
    yield from (f"    {part}," for part in parts)
    yield end


def _printed(parameter: inspect.Parameter) -> str:
    stars = {parameter.VAR_POSITIONAL: "*", parameter.VAR_KEYWORD: "**"}.get(parameter.kind, "")
    text = f"{stars}{parameter.name}"
    if parameter.annotation is not parameter.empty:
        text += f": {parameter.annotation}"
    if parameter.default is parameter.empty:
        return text
    default = parameter.default
    return f"{text} = {default.__name__ if inspect.isfunction(default) else repr(default)}"


if __name__ == "__main__":
    print(described(), end="")
