"""Calibration that the benchmarks share: the sensor of Table 2, the paper's excitation."""

from __future__ import annotations

import functools

from vibrident.data.records import Calibration
from vibrident.physics.models import SensorModel, parse
from vibrident.physics.simulation import SENSORS, Motion, simulate
from vibrident.physics.simulation.scheme import Take

SENSOR = SENSORS["paper"]
#: The parameters that are identified, in the order of the table's columns.
PARAMETERS = ("sensitivity", "natural_frequency", "damping_ratio")
COLUMNS = "S0 · natural frequency · damping ratio"
RATE_HZ = 51200.0
SAMPLES = 16000
RESPONSE_NOISE = 0.01  # white noise of the response channel as a fraction of each record's rms
FELT_DB = 20.0
SEED = 20251113


def model() -> SensorModel:
    """Return the model of the sensor."""
    return parse(SENSOR.model)


@functools.lru_cache(maxsize=2)
def paper_truth(
    rate_hz: float = RATE_HZ, samples: int = SAMPLES
) -> tuple[Calibration, tuple[Motion, ...]]:
    """Simulate 21 one-third-octave sines, 10 to 1000 Hz at 1 g, in noise 20 dB below.

    Args:
        rate_hz: samples per second; the noise reaches 0.4 of it.
        samples: of every record.

    Returns:
        The calibration without channel noise, and the motions of its records.
    """
    takes: list[Take] = []
    shape = {"sampling_rate_hz": rate_hz, "samples": samples}
    calibration = simulate(SENSOR, excitation_snr_db=FELT_DB, seed=SEED, keep_takes=takes, **shape)
    return calibration, tuple(take.motion for take in takes)


def relative_errors(values: dict[str, float]) -> dict[str, float]:
    """Found over true, less one, for each parameter."""
    return {name: values[name] / SENSOR.parameters[name] - 1.0 for name in PARAMETERS}
