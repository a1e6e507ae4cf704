"""The true parameters behind a simulated calibration, as ``truth.json``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibrident.workflow.folder import write_json

if TYPE_CHECKING:
    from vibrident.records import Calibration
    from vibrident.simulation import Sensor


def true_values(sensor: Sensor) -> dict[str, float]:
    """Name to true value of every estimated and derived parameter."""
    from vibrident.models import parse

    derived = parse(sensor.model).derived(sensor.parameters)
    return {**sensor.parameters, **{quantity.name: float(quantity.value(sensor.parameters)) for quantity in derived}}


def write_truth(path: Path, sensor: Sensor, calibration: Calibration, seed: int, **more: Any) -> None:
    """Write the true values of a calibration's sensor with their units, and what else is true of it."""
    import vibrident.backend  # noqa: F401  configures JAX before other imports of it
    from vibrident.comparison import TRUTH_SCHEMA
    from vibrident.models import parse
    from vibrident.uncertainty.parameters import unit_fields

    model = parse(sensor.model)
    units = {quantity.name: quantity.unit for quantity in (*model.parameters, *model.derived(sensor.parameters))}
    fields = unit_fields(calibration)
    document = {
        "schema": TRUTH_SCHEMA,
        "sensor": sensor.name,
        "model": sensor.model,
        "seed": seed,
        "parameters": {
            name: {"value": value, "unit": units[name].format(**fields)} for name, value in true_values(sensor).items()
        },
    }
    write_json(path, document | more)
