"""A tracker at a source: chunks in, rows and alarms out; what is wrong with the chunks is named and counted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from vibrident.data.records import FloatArray, Quantity, Record
from vibrident.data.sources.source import Chunk
from vibrident.fit.response.sine_fit import tone_frequency
from vibrident.result import Result
from vibrident.use.tracking.causes import LENGTH, Cause, cause
from vibrident.use.tracking.effects import CarriedEffects
from vibrident.use.tracking.reference_noise import ReferenceNoise, reference_noise
from vibrident.use.tracking.state import CERTAIN, Alarm, Estimate, Settings
from vibrident.use.tracking.tracker import Tracker

#: Longest time by which a chunk may be off and still follows, in sampling intervals.
FOLLOWS = 0.5


@dataclass(frozen=True)
class Trouble:
    """Samples that are not as they should be: ``lost``, ``late`` or ``doubled``; when, and how many."""

    what: str
    time_s: float
    samples: int


@dataclass(eq=False)
class Session:
    """Tracks a sensor."""

    tracker: Tracker  # what learns
    every: int  # samples a row
    units: Mapping[str, str]  # unit of each parameter
    cause: Cause  # what departs from the model, since an alarm that it explained
    effects: CarriedEffects  # stated of the calibration that it began with
    samples: int = 0  # taken so far
    left: int = 0  # samples until the next row
    started: bool = False
    # with the chunks, the first of each kind by name, and their counts
    troubles: list[Trouble] = field(default_factory=list)
    alarms: list[Alarm] = field(default_factory=list)  # what changed so far
    held: list[Alarm] = field(default_factory=list)  # alarms whose cause is looked for in the samples behind them
    behind: list[FloatArray] = field(default_factory=list)  # samples behind the first, each of shape (2, samples)

    @classmethod
    def of(cls, result: Result, rate_hz: float, quantity: Quantity, every_s: float, settings: Settings) -> Session:
        """From an identified sensor.

        Args:
            result: of an identification, with the uncertainty of every parameter.
            rate_hz: samples per second.
            quantity: what the reference is.
            every_s: time between rows, s.
            settings: how it is tracked.

        Raises:
            InputError: the result lacks a gain or an uncertainty.
            ModelError: its model has no state space.
        """
        sensor = result.to_sensor("tracking")
        sensor.require_uncertainty()
        settings = replace(settings, model_error=float(result.settings.get("model_error", 0.0)))
        tracker = Tracker(sensor.model, sensor.values, sensor.covariance, rate_hz, quantity, settings)
        units = {name: result.parameters[name].unit for name in sensor.model.parameter_names}
        every = max(1, round(every_s * rate_hz))
        reference = np.zeros(tracker.network.parameters)
        reference[tracker.network.gain] = settings.reference_uncertainty
        effects = CarriedEffects.of(result, sensor.covariance, reference)
        return cls(tracker, every, units, Cause(None, "", tracker.values), effects, left=every)

    @property
    def changing(self) -> tuple[float, float] | None:
        """Time of a change that is certain but not named yet, and of its detection, s."""
        return (self.held[0].time_s, self.held[0].detected_s) if self.held else self.tracker.changing

    def take(self, chunk: Chunk) -> list[Estimate]:
        """Samples; returns the rows that are complete with them."""
        reference, response = self._placed(chunk)
        rows = []
        while len(response):
            count = min(self.left, len(response))
            self.tracker.feed(reference[:count], response[:count])
            self._listen(reference[:count], response[:count])
            reference, response = reference[count:], response[count:]
            self.samples += count
            self.left -= count
            if not self.left:
                rows.append(self.read())
                self.left = self.every
        return rows

    def finish(self) -> list[Estimate]:
        """No chunk follows; returns a last row."""
        self._end_run()
        return [self.read()]

    def _listen(self, reference: FloatArray, response: FloatArray) -> None:
        """Alarms wait for samples behind them that tell their cause."""
        if self.held:
            self.behind.append(np.stack([reference, response]))
        self._hold()
        if sum(each.shape[1] for each in self.behind) >= LENGTH:
            self._explain()

    def _hold(self) -> None:
        self.held += self.tracker.alarms
        self.tracker.alarms.clear()
        if not (self.changing or self.cause.code):
            self.cause = Cause(None, "", self.tracker.values)

    def _end_run(self) -> None:
        """No sample follows those before."""
        self.tracker.finish()
        self._hold()
        self._explain()

    def _explain(self) -> None:
        """Say what was held; where it has one cause, that, once."""
        net, found, held, before = self.tracker.network, None, self.held, self.cause
        samples = np.concatenate(self.behind, axis=1) if self.behind else np.zeros((2, 0))
        self.held, self.behind = [], []
        if samples.shape[1] >= self.tracker.settings.block and np.isfinite(samples).all():
            found = cause(net.model, samples[0], samples[1], 1.0 / net.interval_s, net.quantity)
        explained = [alarm for alarm in held if found and found.explains(alarm, before)]
        if found and explained:
            if found.code != before.code:
                self.alarms.append(replace(explained[0], what=found.words))
            self.cause = found
        for alarm in held:
            if alarm not in explained and not before.left_by(alarm):
                self.alarms.append(alarm)
                if alarm.parameter in self.cause.values:
                    self.cause.values[alarm.parameter] = alarm.after

    def _placed(self, chunk: Chunk) -> tuple[FloatArray, FloatArray]:
        """The samples of a chunk that are new; a run begins where it does not follow the one before."""
        net, reference, response = self.tracker.network, chunk.reference, chunk.response
        expected = self.tracker.next_sample_s
        start = expected if chunk.start_s is None else chunk.start_s
        off = (start - expected) / net.interval_s
        slack = FOLLOWS + CERTAIN * chunk.clock_s / net.interval_s
        if not self.started or chunk.separate:
            begin = start if not self.started or off > 0.0 else expected
            self._end_run()
            self.tracker.begin(begin, self._tone_hz(chunk))
            self.started = True
        elif off > slack:
            self.troubles.append(Trouble("lost", expected, round(off)))
            self._end_run()
            self.tracker.begin(start, self._tone_hz(chunk))
        elif off < -slack:
            known = min(round(-off), len(response))
            self.troubles.append(Trouble("late" if known == len(response) else "doubled", start, known))
            reference, response = reference[known:], response[known:]
        return np.asarray(reference, dtype=float), np.asarray(response, dtype=float)

    def _tone_hz(self, chunk: Chunk) -> float | None:
        """Frequency of a sine, from its samples where it is not stated."""
        if not chunk.sine or chunk.tone_hz is not None:
            return chunk.tone_hz
        good = np.isfinite(chunk.reference) & np.isfinite(chunk.response)
        rate = 1.0 / self.tracker.network.interval_s
        return tone_frequency(
            Record("tone", np.where(good, chunk.reference, 0.0), np.where(good, chunk.response, 0.0), rate, valid=good)
        )

    def document(self) -> dict[str, Any]:
        """What ``track.json`` says: plain values."""
        read, net = self.read(), self.tracker.network
        counts = {what: sum(t.samples for t in self.troubles if t.what == what) for what in ("lost", "late", "doubled")}
        return {
            "model": net.model.name,
            "time_s": read.time_s,
            "parameters": {
                name: {"value": read.values[name], "unit": self.units[name], "standard_uncertainty": u}
                for name, u in read.uncertainty.items()
            },
            "alarms": [alarm.document() for alarm in self.alarms],
            "changing": dict(zip(("time_s", "detected_s"), self.changing or (), strict=False)) or None,
            "cause": vars(self.cause) if self.cause.code else None,
            "samples": {"taken": self.samples, **counts},
            "troubles": [vars(trouble) for trouble in self.troubles],
            "false_alarms_per_day": self.tracker.settings.false_alarms_per_day,
            "drift_per_year": self.tracker.settings.drift_per_year,
            "noise": self.tracker.noise,
            "reference_noise": self._noise_said(read),
        }

    def read(self) -> Estimate:
        """Return what is known now, with the stated effects of the calibration."""
        return self.effects.added(self.learned())

    def learned(self) -> Estimate:
        """Return what is known now, corrected for white noise of the reference where possible.

        The stated effects of the calibration are not in it.
        """
        read, noise = self.tracker.read(), self.reference_noise
        return noise.corrected(read) if noise and noise.corrects else read

    @property
    def reference_noise(self) -> ReferenceNoise | None:
        """White noise of the reference; None where it is not certain."""
        found = reference_noise(self.tracker) if self.tracker.noise else None
        return found if found and found.certain else None

    def _noise_said(self, read: Estimate) -> dict[str, Any] | None:
        """Rms of the reference's noise, what it moves by more than their u, and whether that is corrected."""
        if not (found := self.reference_noise):
            return None
        by_name = zip(read.values, found.shift.tolist(), strict=True)
        moves = {name: shift for name, shift in by_name if abs(shift) > read.uncertainty[name]}
        rms = found.variance**0.5
        return {"value": rms, "u": 0.5 * found.u / rms, "moves": moves, "corrected": found.corrects}
