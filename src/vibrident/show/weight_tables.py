"""Tabulate the weights of a network as the paper's Table 1 does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibrident.result import Result
from vibrident.show.numbers import (
    plain,
)
from vibrident.show.tables import leaf, spoken_key
from vibrident.show.views import Table, columns

# rows of the table of measured points; more are thinned evenly, and the report says so


def weights(result: Result, between: str = "; ") -> Table | None:
    """Return the network's weights as the paper's Table 1; ``between``: separates matrix rows."""
    if not result.weights:
        return None
    rows = tuple(
        (
            row.name,
            row.layer,
            row.meaning,
            between.join(f"[{'  '.join(numbers)}]" for numbers in row.numbers),
        )
        for row in weight_rows(result.weights)
    )
    single = {
        key: value
        for key, value in result.weights.items()
        if not isinstance(value, Mapping | list | tuple)
    }
    other_weights = ", ".join(f"{spoken_key(key)} {leaf(value)}" for key, value in single.items())
    notes = (
        "Each row of a matrix in brackets.",
        *((f"Of the network: {other_weights}.",) if other_weights else ()),
    )
    return Table(columns("weight", "layer", "is (paper, Table 1)", "value"), rows, notes=notes)


@dataclass(frozen=True)
class WeightRow:
    """A weight for print."""

    name: str  # W1 … W4
    layer: str  # which neurons it connects
    meaning: str  # what it is of the physics, under forward Euler at least
    numbers: tuple[tuple[str, ...], ...]  # rows of the matrix as text


def weight_rows(weights: Mapping[str, Any], digits: int = 6) -> list[WeightRow]:
    """Return W1 to W4 in the order of the paper's Table 1, as far as the result holds them."""
    rows = []
    for name, entry in (
        (name, weights[name]) for name in ("W1", "W2", "W3", "W4") if name in weights
    ):
        matrix = np.atleast_2d(np.array(entry["value"], dtype=float)).tolist()
        numbers = tuple(tuple(plain(value, digits) for value in row) for row in matrix)
        rows.append(WeightRow(name, entry["layer"], entry["meaning"], numbers))
    return rows
