"""Strange but right data: scales, lengths, numbers of records; declared effects; files."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from bench.adversary.noise import Noise
from bench.adversary.physics import Sensor
from bench.adversary.recording import records, setting, twin
from bench.adversary.trial import Cases, Trial, calibration, truth
from vibrident.data.records import SystematicEffect

SCALES = (1e-150, 1e-30, 1e-15, 1e-12, 1e-9, 1e-6, 1e6, 1e9, 1e12, 1e15, 1e30, 1e150)
SHAPES = {
    "sine": ((3, 400), (60, 400), (4, 20_000), (12, 100), (1, 2000), (5, 1000)),
    "random": ((1, 200), (1, 1000), (60, 400), (1, 20_000), (1, 100_000), (3, 700)),
    "multisine": ((1, 400), (1, 2000), (20, 1000), (1, 20_000)),
    "sweep": ((1, 400), (1, 20_000), (10, 1000)),
    "shock": ((1, 400), (10, 1000), (1, 20_000)),
}
QUIET = Noise("0.1 %", 1e-3)


def cases() -> Cases:
    """Return the names and makers."""
    for scale, motion in itertools.product(SCALES, ("sine", "random", "shock")):
        for side in ("response", "reference"):
            yield (
                f"scale {side} {scale:g}/{motion}",
                partial(_scaled, scale, side, "in-light", motion),
            )
        yield (
            f"scale both {scale:g}/pickup/{motion}",
            partial(_scaled, scale, "both", "pickup-in-damped", motion),
        )
    for motion, shapes in SHAPES.items():
        for shape, sensor in itertools.product(shapes, ("in-light", "in-damped", "above-light")):
            yield (
                f"{shape[0]} records of {shape[1]}/{motion}/{sensor}",
                partial(_shaped, shape, sensor, motion),
            )
    for periods, sensor in itertools.product(
        (0.8, 1.2, 1.9, 2.5), ("in-light", "below-damped", "above-light")
    ):
        yield f"{periods:g} periods/{sensor}", partial(_few_periods, periods, sensor)
    for kind, motion, sensor in itertools.product(
        EFFECTS, ("sine", "random"), ("in-light", "above-light")
    ):
        yield f"declared {kind}/{motion}/{sensor}", partial(_declared, kind, motion, sensor)


def _scaled(scale: float, side: str, sensor: str, motion: str, rng: np.random.Generator) -> Trial:
    conditions = setting(sensor, rng)
    sign = np.sign(conditions.sensor.gain)
    name = next(iter(conditions.sensor.parameters))
    conditions = replace(
        conditions, sensor=twin(conditions.sensor, **{name: abs(1.0 / conditions.sensor.gain)})
    )
    factor = scale if side in ("response", "both") else 1.0 / scale
    recordings = []
    for raw in records(motion, conditions, QUIET, rng):
        response = raw.response * (scale if side != "reference" else 1.0)
        recordings.append(
            replace(
                raw,
                response=response,
                reference=raw.reference * (1.0 if side == "response" else scale),
            )
        )
    if side == "both":
        factor = 1.0
    true = twin(conditions.sensor, **{name: factor})
    assert np.sign(true.gain) == sign
    strange = not 1e-29 < scale < 1e29  # refused, as documented
    return Trial.from_recordings(recordings, true, conditions.quantity, strange=strange)


def _shaped(shape: tuple[int, int], sensor: str, motion: str, rng: np.random.Generator) -> Trial:
    conditions = setting(sensor, rng)
    recordings = records(motion, conditions, QUIET, rng, shape=shape)
    small = shape[0] * shape[1] <= 400 or (shape[0] == 1 and motion == "sine")
    few = frozenset(
        {"short_record", "weakly_determined", "at_bound", "lack_of_fit"} if small else ()
    )
    return Trial.from_recordings(
        recordings, conditions.sensor, conditions.quantity, allowed=few, strange=small
    )


def _few_periods(periods: float, sensor: str, rng: np.random.Generator) -> Trial:
    """Sines of so many periods a record."""
    conditions = setting(sensor, rng)
    recordings = []
    for i, raw in enumerate(records("sine", conditions, QUIET, rng, stated=True)):
        assert raw.frequency_hz
        length = max(16, int(periods * conditions.rate / raw.frequency_hz))
        recordings.append(replace(raw.both(lambda v, n=length: v[:n]), name=f"sine-{i}"))
    allowed = frozenset({"short_record"} if periods < 2.0 else ())
    return Trial.from_recordings(
        recordings, conditions.sensor, conditions.quantity, allowed=allowed
    )


EFFECTS = ("gain", "timing", "phase", "clock")


def _declared(kind: str, motion: str, sensor: str, rng: np.random.Generator) -> Trial:
    """Draw a systematic error from its declared uncertainty, which the statement must cover."""
    conditions = setting(sensor, rng)
    u = {"gain": 0.003, "timing": 0.05 / conditions.rate, "phase": 0.003, "clock": 1e-4}[kind]
    error = u * float(np.clip(rng.normal(), -2.0, 2.0))
    sensor_true = conditions.sensor
    apparent = {
        "gain": twin(sensor_true, sensitivity=1.0 + error),
        "timing": replace(sensor_true, parameters={**sensor_true.parameters, "delay": error}),
        "phase": Turned(sensor_true.model, sensor_true.parameters, error),
        "clock": sensor_true,
    }[kind]
    recordings = records(motion, replace(conditions, sensor=apparent), QUIET, rng)
    if kind == "clock":
        recordings = [replace(raw, rate=raw.rate * (1.0 + error)) for raw in recordings]
    effect = SystematicEffect("declared", kind, u)  # type: ignore[arg-type]
    return Trial(
        calibration(recordings, sensor_true.model, conditions.quantity, effects=(effect,)),
        sensor_true.model,
        truth(sensor_true),
    )


@dataclass(frozen=True)
class Turned(Sensor):
    """A sensor whose response is turned by the same angle at every frequency."""

    angle: float = 0.0

    def transfer(self, frequency_hz):
        """Return the response per acceleration."""
        return super().transfer(frequency_hz) * np.exp(1j * self.angle)
