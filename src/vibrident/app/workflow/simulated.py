"""Write simulated calibrations as files, with the true parameters in ``truth.json``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibrident.app.workflow.folder import write_json
from vibrident.base.fields import NamedNumbers

if TYPE_CHECKING:
    from vibrident.data.records import Calibration
    from vibrident.physics.simulation import Sensor

# The demonstration: a sensor and its calibration as in the paper's section 4, at a low rate, for
# small files.
SENSOR = "paper"
SAMPLES = 4000  # of each record
SNR_DB = 20.0  # motion over the noise that the sensor measures too
RESPONSE_NOISE = 0.01  # relative to the response's rms


def write_demo(folder: Path) -> None:
    """Write the calibration of the demonstration and its truth."""
    noise = {"excitation_snr_db": SNR_DB, "response_noise": RESPONSE_NOISE}
    write(folder, SENSOR, "sine", sampling_rate_hz=12800.0, samples=SAMPLES, seed=1, **noise)


def write(folder: Path, sensor: str, excitation: str, *, seed: int, **settings: Any) -> None:
    """Write a simulated calibration and its truth into a folder.

    ``settings``: as those of ``vibrident.simulate``.
    """
    from vibrident.data.io import write_calibration
    from vibrident.physics.simulation import sensor_named
    from vibrident.physics.simulation import simulate as run

    true_sensor = sensor_named(sensor)
    calibration = run(true_sensor, excitation, seed=seed, **settings)
    write_calibration(folder, calibration)
    write_truth(folder / "truth.json", true_sensor, calibration, seed)


def true_values(sensor: Sensor) -> NamedNumbers:
    """Return name to true value of every estimated and derived parameter."""
    from vibrident.physics.models import parse

    derived = parse(sensor.model).derived(sensor.parameters)
    return {
        **sensor.parameters,
        **{quantity.name: float(quantity.value(sensor.parameters)) for quantity in derived},
    }


def write_truth(
    path: Path, sensor: Sensor, calibration: Calibration, seed: int, **more: Any
) -> None:
    """Write the true values of a calibration's sensor with their units.

    ``more``: other facts that are true of it.
    """
    from vibrident.fit.uncertainty.parameters import unit_fields
    from vibrident.physics.models import parse
    from vibrident.use.comparison import TRUTH_SCHEMA

    model = parse(sensor.model)
    units = {
        quantity.name: quantity.unit
        for quantity in (*model.parameters, *model.derived(sensor.parameters))
    }
    fields = unit_fields(calibration)
    document = {
        "schema": TRUTH_SCHEMA,
        "sensor": sensor.name,
        "model": sensor.model,
        "seed": seed,
        "parameters": {
            name: {"value": value, "unit": units[name].format(**fields)}
            for name, value in true_values(sensor).items()
        },
    }
    write_json(path, document | more)
