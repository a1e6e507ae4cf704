"""What parameters are called in words: for messages, tables and pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from vibrident.physics.registry import MODELS


@dataclass(frozen=True)
class Name:
    """A parameter's name in words, and its usual symbol."""

    words: str
    symbol: str


def described(name: str) -> Any:
    """What the model says that has a parameter or derived quantity of this name; None where no model has.

    Returns:
        ``vibrident.physics.models.base.ParameterSpec`` or ``Derived``.
    """
    for part in MODELS.one_by_one():
        for quantity in (*part.parameters, *getattr(part, "derived", ())):
            if quantity.name == name:
                return quantity
    return None


def parameter_names() -> tuple[str, ...]:
    """Names of all parameters of all models, then of all derived quantities."""
    parts = list(MODELS.one_by_one())
    names = [quantity.name for part in parts for quantity in part.parameters]
    names += [quantity.name for part in parts for quantity in getattr(part, "derived", ())]
    return tuple(dict.fromkeys(names))


def is_gain(name: str) -> bool:
    """Whether the response is proportional to this parameter."""
    return getattr(described(name), "kind", "") == "gain"


def is_derived(name: str) -> bool:
    """Whether this quantity follows from the parameters of its model."""
    found = described(name)
    return found is not None and not hasattr(found, "kind")


def parameter_name(name: str) -> Name:
    """Words and symbol of a parameter; its own name with spaces where its model is not known."""
    found = described(name)
    return Name((found.words if found else "") or name.replace("_", " "), found.symbol if found else "")


def in_words(name: str) -> str:
    """A parameter in words, for a sentence."""
    return parameter_name(name).words
