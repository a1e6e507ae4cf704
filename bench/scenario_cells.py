"""The cells of the scenario matrix: what is simulated, identified and compared in each."""

from __future__ import annotations

import functools
import itertools
import warnings
from dataclasses import dataclass, replace

import numpy as np

from vibrident import identify
from vibrident.base.errors import VibridentError
from vibrident.data.records import Calibration
from vibrident.physics.models import parse
from vibrident.physics.simulation import (
    ChannelNoise,
    HalfSineShock,
    Sensor,
    sensor_named,
    simulate,
    with_noise,
)

SENSORS = ("paper", "piezo", "seismometer", "inverted")
EXCITATIONS = ("sine", "multisine", "sweep", "random", "shock", "mixed")
#: Each noise by its letter in the issue: what it is, and the noise of both channels. ``a`` is felt,
#: and known.
NOISES: dict[str, tuple[str, dict]] = {
    "a": ("felt by the sensor, 20 dB", {}),
    "b": ("on the reference, 1 %", {"reference_noise": 0.01}),
    "c": ("on the response, 1 %", {"response_noise": 0.01}),
    "d": ("on both, 1 %", {"reference_noise": 0.01, "response_noise": 0.01}),
    "e": ("coloured: white 0.3 %, 1/f and hum 0.5 %", {
        "response_noise": ChannelNoise(white=0.003, flicker=0.005, hum=0.005)
    }),
    "f": ("white 0.5 %, offset and drift 5 %", {
        "response_noise": ChannelNoise(white=0.005, offset=0.05, drift=0.05)
    }),
}  # fmt: skip
SAMPLES = 8000
SEED = 1
#: Of noise that the sensor feels nothing is random in the answer but rounding: a few runs show it.
FELT_RUNS = 4
FLAGS = (
    "lack_of_fit",
    "reference_noise",
    "band_sensitive",
    "nonlinear",
    "weakly_determined",
    "estimators_disagree",
)


@dataclass(frozen=True)
class Cell:
    """Cell of a sensor, excitation and noise."""

    sensor: str
    excitation: str
    noise: str

    @property
    def name(self) -> str:
        """Return the name for tables and the command line."""
        return f"{self.sensor}/{self.excitation}/{self.noise}"

    def runs(self, requested: int) -> int:
        """Return how many runs it needs where so many are asked for."""
        return min(requested, FELT_RUNS) if self.noise == "a" else requested

    def calibration(self, run: int) -> Calibration:
        """Return the calibration of this run."""
        if self.noise == "a":
            return truth(self.sensor, self.excitation, felt_seed=run + 1)
        seed = np.random.SeedSequence(SEED, spawn_key=(run,))
        return with_noise(truth(self.sensor, self.excitation), **NOISES[self.noise][1], seed=seed)


CELLS = tuple(Cell(*names) for names in itertools.product(SENSORS, EXCITATIONS, NOISES))


@functools.lru_cache(maxsize=4)
def truth(
    name: str, excitation: str, felt_seed: int | None = None, moved: tuple[str, float] | None = None
) -> Calibration:
    """Return the calibration without noise; ``moved``: a parameter changed by a relative step."""
    sensor = sensor_named(name)
    if moved is not None:
        key, step = moved
        values = dict(sensor.parameters) | {key: sensor.parameters[key] * (1.0 + step)}
        sensor = replace(sensor, parameters=values)
    more = {} if felt_seed is None else {"excitation_snr_db": 20.0}
    return _motion(
        sensor,
        excitation,
        float(sensor_named(name).parameters["natural_frequency"]),
        felt_seed or SEED,
        more,
    )


def _motion(sensor: Sensor, excitation: str, natural: float, seed: int, more: dict) -> Calibration:
    shape = {"sampling_rate_hz": 40.0 * natural, "samples": SAMPLES, "seed": seed, **more}
    tones = (natural * np.geomspace(0.05, 1.6, 12)).tolist()
    if excitation == "sine":
        return simulate(sensor, "sine", frequencies_hz=tones, start="steady", **shape)
    if excitation == "multisine":
        lines = (natural * np.geomspace(0.03, 3.0, 30)).tolist()
        return simulate(sensor, "multisine", frequencies_hz=lines, repeats=2, start="rest", **shape)
    if excitation == "shock":
        # The pulse's length must not move with the parameter that is moved for the bound.
        pulse = HalfSineShock(sensor.amplitude, 1.0 / natural, 0.1 * SAMPLES / (40.0 * natural))
        return simulate(sensor, [pulse], repeats=4, start="rest", **shape)
    if excitation == "mixed":
        sines = simulate(sensor, "sine", frequencies_hz=tones[::3], start="steady", **shape)
        slow = shape | {"sampling_rate_hz": 25.0 * natural, "samples": 5000}
        random = simulate(
            sensor, "random", frequencies_hz=[0.03 * natural, 3.0 * natural], start="rest", **slow
        )
        return replace(sines, records=(*sines.records, *random.records))
    ends = [0.03 * natural, 3.0 * natural]
    return simulate(sensor, excitation, frequencies_hz=ends, repeats=2, start="rest", **shape)


def block(name: str, runs: range) -> dict:
    """Identify some runs of a cell: relative errors and u, coverage and warnings."""
    cell = next(cell for cell in CELLS if cell.name == name)
    sensor = sensor_named(cell.sensor)
    names = parse(sensor.model).parameter_names
    line: dict = {"error": [], "u": [], "covered": [], "flags": []}
    failed = 0
    for run in runs:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                result = identify(cell.calibration(run))
        except VibridentError:
            failed += 1
            continue
        estimates = [result.parameters[key] for key in names]
        true = [sensor.parameters[key] for key in names]
        line["error"].append([(p.value - t) / abs(t) for p, t in zip(estimates, true, strict=True)])
        line["u"].append(
            [p.standard_uncertainty / abs(t) for p, t in zip(estimates, true, strict=True)]
        )
        line["covered"].append(
            [
                p.interval_95[0] <= t <= p.interval_95[1]
                for p, t in zip(estimates, true, strict=True)
            ]
        )
        line["flags"].append([code for code in result.warning_codes if code in FLAGS])
    return line | {"failed": failed}
