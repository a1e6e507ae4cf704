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
        euler: what it is under forward Euler (other discretisations put their own matrices in its place).
        lines: rows of the matrix as text.
    """

    name: str
    layer: str
    euler: str
    lines: tuple[str, ...]


def weight_rows(weights: Mapping[str, Any]) -> list[WeightRow]:
    """W1 to W4 in the order of the paper's Table 1, then whatever else the result holds."""
    ordered = sorted(weights, key=lambda name: name if name in _LAYERS else "X")  # sorted() keeps the rest's order
    return [WeightRow(name, *_LAYERS.get(name, ("", "")), tuple(_lines(weights[name]))) for name in ordered]


def _lines(values: Any) -> Iterator[str]:
    if isinstance(values, Mapping):
        for key, value in values.items():
            yield f"{key}: {'; '.join(_lines(value))}"
    elif not isinstance(values, (list, tuple)):
        yield _scalar(values)
    elif any(isinstance(value, (list, tuple)) for value in values):
        for value in values:
            yield from _lines(value)
    else:
        yield "  ".join(_scalar(value) for value in values)


def _scalar(value: Any) -> str:
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return plain(float(value))
    return "–" if value is None else str(value)
