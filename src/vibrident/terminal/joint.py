"""What the terminal shows of a joint fit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from vibrident.naming import parameter_name, scaled
from vibrident.present.numbers import NONE, concise, plain
from vibrident.result import Result
from vibrident.terminal.tables import literal, titled

if TYPE_CHECKING:
    from rich.console import Group


def joint_table(result: Result) -> Group:
    """What calibrations that were fitted together share: the joint values, each one's own, and the verdict on these.

    Args:
        result: of any of them; its settings hold what is shown.
    """
    from rich.console import Group
    from rich.text import Text

    joint = result.settings["joint"]
    labels = [one["file"] for one in joint["calibrations"]]
    table = titled(f"Joint fit of {len(labels)} calibrations: value(u in its last digits)", "shared")
    table.add_column("unit", no_wrap=True)
    for label in ("joint", *(f"{label} alone" for label in labels), "p"):
        table.add_column(literal(label), justify="right", overflow="fold")
    for row in joint["shared"]:
        scale = scaled(row["unit"], abs(row["joint"]["value"]))
        numbers = [row["joint"], *(row["separate"].get(label) for label in labels)]
        cells = [NONE if n is None else _concise(n, scale.factor) for n in numbers]
        unit = "" if scale.unit == "1" else scale.unit
        name = parameter_name(row["name"]).words
        table.add_row(*(literal(cell) for cell in (name, unit, *cells, plain(row["probability"], 2))))
    table.caption = "p: chance of a difference at least as large between calibrations that agree"
    parts: list[Any] = [table]
    unused = [one["file"] for one in joint["calibrations"] if not one["own_fit_used"]]
    if unused:
        parts.append(literal(f"Of no use alone, the joint fit explains it better: {', '.join(unused)}."))
    whole = joint["consistency"]
    line = Text(
        f"The calibrations by themselves: chi² = {plain(whole['chi2'], 4)} (ν = {whole['degrees_of_freedom']}), "
        f"p = {plain(whole['probability'], 2)}: "
    )
    parts.append(line.append("consistent", "green") if whole["consistent"] else line.append("inconsistent", "bold red"))
    return Group(*parts, Text(""))


def _concise(number: Mapping[str, Any], factor: float) -> str:
    u = number["standard_uncertainty"]
    return concise(number["value"] * factor, None if u is None else u * factor)
