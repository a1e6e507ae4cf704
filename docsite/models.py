"""How to choose a model: written words, and the parameters from the models themselves."""

from __future__ import annotations

from docsite.tables import page, table
from vibrident.physics.models import ADD_ONS, CORES

_UNITS = {
    "{response}/({reference})": "response unit per reference unit",
    "{response}/({reference_integrated})": "response unit per reference unit, integrated (V/(m/s))",
    "{conversion}": "response unit per m",
}


def models() -> str:
    """Return the page."""
    rows = [_row(model_part, name) for name, model_part in CORES.items()]
    rows += [_row(model_part, f"+{name}") for name, model_part in ADD_ONS.items()]
    return page("models.md", table(("name", "what it is", "estimated", "derived"), rows))


def _row(model_part, name: str) -> tuple[str, str, str, str]:
    derived = getattr(model_part, "derived", ())
    return f"`{name}`", model_part.title, _listed(model_part.parameters), _listed(derived)


def _listed(specs) -> str:
    return ", ".join(f"`{spec.name}`" + _unit(spec.unit) for spec in specs)


def _unit(unit: str) -> str:
    text = _UNITS.get(unit, unit)
    return "" if text == "1" or "{" in text else f" ({text})"
