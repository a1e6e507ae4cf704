"""A tracker at a source: chunks in, rows and alarms out; what is wrong with the chunks is named and counted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from vibrident.data.records import FloatArray, Quantity, Record
from vibrident.data.sources.source import Chunk
from vibrident.fit.response.tones import tone_frequency
from vibrident.result import Result
from vibrident.use.tracking.reference_noise import reference_noise
from vibrident.use.tracking.state import Alarm, Estimate, Settings
from vibrident.use.tracking.tracker import Tracker

#: Longest time by which a chunk may be off and still follows, in sampling intervals.
FOLLOWS = 0.5
#: Standard uncertainties from which something is certain: of a chunk's clock beyond that, of the reference's noise.
CERTAIN = 3.0


@dataclass(frozen=True)
class Trouble:
    """Samples that are not as they should be: ``lost``, ``late`` or ``doubled``; when, and how many."""

    what: str
    time_s: float
    samples: int


@dataclass(eq=False)
class Session:
    """Tracks a sensor.

    Attributes:
        tracker: what learns.
        every: samples a row.
        units: unit of each parameter.
        samples: taken so far.
        left: samples until the next row.
        troubles: with the chunks, the first of each kind by name, and their counts.
    """

    tracker: Tracker
    every: int
    units: Mapping[str, str]
    samples: int = 0
    left: int = 0
    started: bool = False
    troubles: list[Trouble] = field(default_factory=list)

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
        return cls(tracker, every, units, left=every)

    @property
    def alarms(self) -> list[Alarm]:
        """What changed so far."""
        return self.tracker.alarms

    def take(self, chunk: Chunk) -> list[Estimate]:
        """Samples; returns the rows that are complete with them."""
        reference, response = self._placed(chunk)
        rows = []
        while len(response):
            count = min(self.left, len(response))
            self.tracker.feed(reference[:count], response[:count])
            reference, response = reference[count:], response[count:]
            self.samples += count
            self.left -= count
            if not self.left:
                rows.append(self.tracker.read())
                self.left = self.every
        return rows

    def finish(self) -> list[Estimate]:
        """No chunk follows; returns a last row."""
        self.tracker.finish()
        return [self.tracker.read()]

    def _placed(self, chunk: Chunk) -> tuple[FloatArray, FloatArray]:
        """The samples of a chunk that are new; a run begins where it does not follow the one before."""
        net, reference, response = self.tracker.network, chunk.reference, chunk.response
        expected = self.tracker.next_sample_s
        start = expected if chunk.start_s is None else chunk.start_s
        off = (start - expected) / net.interval_s
        slack = FOLLOWS + CERTAIN * chunk.clock_s / net.interval_s
        if not self.started or chunk.separate:
            begin = start if not self.started or off > 0.0 else expected
            self.tracker.begin(begin, self._tone_hz(chunk))
            self.started = True
        elif off > slack:
            self.troubles.append(Trouble("lost", expected, round(off)))
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
        read, net = self.tracker.read(), self.tracker.network
        counts = {what: sum(t.samples for t in self.troubles if t.what == what) for what in ("lost", "late", "doubled")}
        return {
            "model": net.model.name,
            "time_s": read.time_s,
            "parameters": {
                name: {"value": read.values[name], "unit": self.units[name], "standard_uncertainty": u}
                for name, u in read.uncertainty.items()
            },
            "alarms": [alarm.document() for alarm in self.alarms],
            "changing": dict(zip(("time_s", "detected_s"), self.tracker.changing or (), strict=False)) or None,
            "samples": {"taken": self.samples, **counts},
            "troubles": [vars(trouble) for trouble in self.troubles],
            "false_alarms_per_day": self.tracker.settings.false_alarms_per_day,
            "drift_per_year": self.tracker.settings.drift_per_year,
            "noise": self.tracker.noise,
            "reference_noise": self._reference_noise(read),
        }

    def _reference_noise(self, read: Estimate) -> dict[str, Any] | None:
        """Rms of the reference's noise, and the parameters that it moves by more than their u, if it is certain."""
        found = reference_noise(self.tracker) if self.tracker.noise else None
        if found is None or not found.variance > CERTAIN * found.u:
            return None
        by_name = zip(read.values, found.shift.tolist(), strict=True)
        moves = {name: shift for name, shift in by_name if abs(shift) > read.uncertainty[name]}
        return {"value": found.variance**0.5, "u": 0.5 * found.u / found.variance**0.5, "moves": moves}
