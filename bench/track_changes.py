"""Time from a change to its alarm, for the four sensors of the matrix, against the possible.

Random motion from 0.03 to 3 natural frequencies at 40 samples a period of it, 1 % noise. For a step
the bound is Lorden's: ln(samples between false alarms) over the information of a sample (Lorden
1971); for a ramp it is the sample by which its information has come to that logarithm.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bench.figures import Figure, steps
from bench.scenario_cells import SENSORS
from vibrident.data.records import FloatArray
from vibrident.data.sources.source import Chunk
from vibrident.physics.models import parse
from vibrident.physics.simulation import Sensor, sensor_named
from vibrident.use.tracking.causes import Cause
from vibrident.use.tracking.effects import CarriedEffects
from vibrident.use.tracking.session import TrackingSession
from vibrident.use.tracking.state import TrackerSettings
from vibrident.use.tracking.tracker import Tracker

SAMPLES = 40000
NOISE = 0.01
PER_PERIOD = 40.0
BAND = (0.03, 3.0)
START_UNCERTAINTY = 1e-3
STEPS = ("gain 1 %", "natural frequency 5 %", "damping doubled", "second mode of 1 %")
HOUR_S = 3600.0
RAMP = 0.01
BENDS = 0.05  # part of the force at the largest response
MAX_RAMP_SAMPLES = 4e7  # samples of a ramp at most
BETWEEN = np.log(
    86400.0 / TrackerSettings().false_alarms_per_day
)  # false alarms, s, as a logarithm


class Motion:
    """A sensor in periodic random motion."""

    def __init__(self, sensor: Sensor, rng: np.random.Generator) -> None:
        self.sensor = sensor
        self.values = dict(sensor.parameters)
        self.model = parse(sensor.model)
        self.natural = float(self.values["natural_frequency"])
        self.rate_hz = PER_PERIOD * self.natural
        self.rng = rng
        self.hz = np.fft.rfftfreq(SAMPLES, 1.0 / self.rate_hz)
        inside = (self.hz > BAND[0] * self.natural) & (self.hz < BAND[1] * self.natural)
        self.lines = inside * (rng.normal(size=self.hz.size) + 1j * rng.normal(size=self.hz.size))
        self.lines /= np.std(np.fft.irfft(self.lines, SAMPLES))
        self.reference = np.fft.irfft(self.lines, SAMPLES)
        self.response = self.answer(self.values, sensor.model)
        self.sigma = NOISE * float(np.std(self.response))

    def answer(self, values: Mapping[str, float], model: str) -> FloatArray:
        """Exact steady response."""
        hz = np.where(self.hz > 0.0, self.hz, self.hz[1])
        return np.fft.irfft(self.lines * parse(model).frequency_response(values, hz), SAMPLES)

    def changed(self, what: str) -> FloatArray:
        """Return the response after a change."""
        values = dict(self.values)
        model = self.sensor.model
        gain = self.model.gain_name
        if what == STEPS[0]:
            values[gain] *= 1.01
        elif what == STEPS[1]:
            values["natural_frequency"] *= 1.05
        elif what == STEPS[2]:
            values["damping_ratio"] *= 2.0
        else:
            model += "+mode2"
            values |= {
                "mode2_frequency": 2.2 * self.natural,
                "mode2_damping": 0.03,
                "mode2_gain": 0.01,
            }
        return self.answer(values, model)

    def tracker(self) -> Tracker:
        """Start from the true values, known to 0.1 %."""
        covariance = np.diag([(START_UNCERTAINTY * value) ** 2 for value in self.values.values()])
        return Tracker(self.model, self.values, covariance, self.rate_hz)

    def noisy(self, response: FloatArray) -> FloatArray:
        """Return a response with noise."""
        return response + self.sigma * self.rng.normal(size=len(response))


def step(motion: Motion, what: str) -> float:
    """Return the samples from a step to its alarm over the bound."""
    after = motion.changed(what)
    tracked = motion.tracker()
    at = SAMPLES // 2 + int(motion.rng.integers(1024))
    before = np.arange(2 * SAMPLES) < SAMPLES + at
    tracked.feed(
        np.tile(motion.reference, 2),
        motion.noisy(np.where(before, np.tile(motion.response, 2), np.tile(after, 2))),
    )
    tracked.finish()
    late = (
        tracked.alarms[0].detected_s * motion.rate_hz - SAMPLES - at if tracked.alarms else np.inf
    )
    information = np.mean((after - motion.response) ** 2) / (2.0 * motion.sigma**2)
    return late / max(1.0, (BETWEEN + np.log(motion.rate_hz)) / information)


def ramp(motion: Motion) -> float:
    """Return the samples from the start of a ramp of the gain to its alarm, over the bound."""
    tracked = motion.tracker()
    rate = RAMP / HOUR_S / motion.rate_hz
    for _ in range(4):
        tracked.feed(motion.reference, motion.noisy(motion.response))
    samples = 0
    while not tracked.alarms and samples < MAX_RAMP_SAMPLES:
        growth = rate * (samples + np.arange(SAMPLES))
        tracked.feed(motion.reference, motion.noisy(motion.response * (1.0 + growth)))
        samples += SAMPLES
    late = tracked.alarms[0].detected_s * motion.rate_hz - 4 * SAMPLES if tracked.alarms else np.inf
    information = np.mean(motion.response**2) / (2.0 * motion.sigma**2) * rate**2 / 3.0
    return late / float(np.cbrt((BETWEEN + np.log(motion.rate_hz)) / information))


def softened(motion: Motion, level: float) -> FloatArray:
    """Return the response of a spring that softens by BENDS at the largest response, with noise."""
    hz = np.where(motion.hz > 0.0, motion.hz, motion.hz[1])
    shape = (
        motion.model.frequency_response(motion.values, hz) / motion.values[motion.model.gain_name]
    )
    most = float(np.max(np.abs(motion.response)))
    bent = np.fft.irfft(np.fft.rfft((motion.response / most) ** 3) * shape, SAMPLES) * BENDS * most
    return motion.noisy(level * motion.response + level**3 * bent)


def named() -> list[Figure]:
    """Return the alarms of a session, and their messages.

    A spring softens where the motion grows threefold, and a second mode appears.
    """
    bends = dict[str, float]()
    modes = dict[str, float]()
    causes = list[str]()
    motion = Motion(sensor_named("paper"), np.random.default_rng(0))
    session = _session(motion)
    for label, level in (("before", 1.0 / 3.0), ("after", 1.0)):
        for _ in range(4):
            session.take(Chunk(level * motion.reference, softened(motion, level)))
        session.finish()
        bends[label] = float(len(session.alarms)) - sum(bends.values())
    note = f"motion before · after it grows threefold; said: {_causes(session)}"
    for name in SENSORS:
        motion = Motion(sensor_named(name), np.random.default_rng(0))
        session = _session(motion)
        for response in [motion.response] + 4 * [motion.changed(STEPS[3])]:
            session.take(Chunk(motion.reference, motion.noisy(response)))
        session.finish()
        modes[name] = float(len(session.alarms))
        causes.append(f"{name}, {2.2 * motion.natural:.5g} Hz: {_causes(session)}")
    return [
        Figure("alarms of a spring that softens by 5 %", bends, "plain", note=note),
        Figure("alarms of a second mode of 1 %", modes, "plain", note="; ".join(causes)),
    ]


def _session(motion: Motion) -> TrackingSession:
    tracker = motion.tracker()
    count = tracker.network.parameters
    no_rows = np.zeros((0, count))
    no_effects = CarriedEffects((), no_rows, np.eye(count), np.zeros(count), (), no_rows)
    cause = Cause(None, "", motion.values)
    return TrackingSession(tracker, 1024, {}, cause, no_effects)


def _causes(session: TrackingSession) -> str:
    return ", ".join(alarm.what for alarm in session.alarms) or "nothing"


def delays(runs: int) -> list[Figure]:
    """Median over runs; a ramp, which takes long, once."""
    figures: dict[str, dict[str, float]] = {what: {} for what in (*STEPS, "ramp of 1 % an hour")}
    for name in steps("tracking changes", SENSORS):
        motions = [Motion(sensor_named(name), np.random.default_rng(seed)) for seed in range(runs)]
        for what in STEPS:
            figures[what][name] = float(np.median([step(motion, what) for motion in motions]))
        figures["ramp of 1 % an hour"][name] = ramp(motions[0])
    note = " · ".join(SENSORS)
    return [
        Figure(f"{what}: time to alarm over the bound", by_sensor, note=note)
        for what, by_sensor in figures.items()
    ]
