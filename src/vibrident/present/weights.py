"""The identified weights of the network as in the paper's Table 1."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from vibrident.present.numbers import plain

_LAYERS = {
    "W1": ("input → hidden", "Ts B"),
    "W2": ("hidden → output", "C (I + Ts A)⁻¹"),
    "W3": ("feedback hidden → hidden", "I + Ts A"),
    "W4": ("feedforward input → output", "D − C (I + Ts A)⁻¹ Ts B"),
}


@dataclass(frozen=True)
class WeightRow:
    """One weight for print.

    Attributes:
        name: W1 … W4, or another name that the result holds.
        layer: which neurons it connects; empty for other names.
        meaning: what it is of the physics, under forward Euler at least.
        numbers: rows of the matrix as text.
    """

    name: str
    layer: str
    meaning: str
    numbers: tuple[tuple[str, ...], ...]


def weight_rows(weights: Mapping[str, Any], digits: int = 6) -> list[WeightRow]:
    """W1 to W4 in the order of the paper's Table 1, as far as the result holds them."""
    rows = []
    for name in _LAYERS:
        entry = weights.get(name)
        if entry is None:
            continue
        layer, euler = _LAYERS[name]
        if isinstance(entry, Mapping):
            layer, euler, entry = entry.get("layer", layer), entry.get("meaning", euler), entry.get("value", ())
        rows.append(WeightRow(name, layer, euler, tuple(_rows(entry, digits))))
    return rows


def _rows(values: Any, digits: int) -> Iterator[tuple[str, ...]]:
    if not isinstance(values, list | tuple):
        values = (values,)
    if any(isinstance(value, list | tuple) for value in values):
        for value in values:
            yield from _rows(value, digits)
    else:
        yield tuple(plain(value, digits) for value in values)
