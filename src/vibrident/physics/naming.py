"""Names of parameters in words and symbols, for messages, tables and pictures."""

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
    """Return the specification of a parameter or derived quantity, or None where no model has it.

    Returns:
        ``vibrident.physics.models.base.ParameterSpec`` or ``Derived``.
    """
    for element in MODELS.one_by_one():
        for quantity in (*element.parameters, *getattr(element, "derived", ())):
            if quantity.name == name:
                return quantity
    return None


def parameter_names() -> tuple[str, ...]:
    """Return the names of all parameters of all models, gains first, then of derived quantities."""
    elements = list(MODELS.one_by_one())
    parameters = [spec for element in elements for spec in element.parameters]
    names = [spec.name for spec in sorted(parameters, key=lambda spec: spec.kind != "gain")]
    names += [quantity.name for element in elements for quantity in getattr(element, "derived", ())]
    return tuple(dict.fromkeys(names))


def is_gain(name: str) -> bool:
    """Return whether the response is proportional to this parameter."""
    return getattr(described(name), "kind", "") == "gain"


def is_derived(name: str) -> bool:
    """Return whether this quantity follows from the parameters of its model."""
    specification = described(name)
    return specification is not None and not hasattr(specification, "kind")


def parameter_name(name: str) -> Name:
    """Return words and symbol of a parameter; its name with spaces where its model is not known."""
    specification = described(name)
    if specification is None:
        return Name(name.replace("_", " "), "")
    return Name(specification.words or name.replace("_", " "), specification.symbol)


def in_words(name: str) -> str:
    """Return a parameter in words, for a sentence."""
    return parameter_name(name).words
