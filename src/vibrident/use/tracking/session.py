"""Track a sensor at a source: chunks in, estimates and alarms out; faulty chunks are counted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from vibrident.base.fields import Fields, NamedTexts
from vibrident.data.records import Calibration, FloatArray, Quantity, Record
from vibrident.data.sources.kinds.calibration_records import chunks_of
from vibrident.data.sources.source import Chunk
from vibrident.fit.response.sine_fit import tone_frequency
from vibrident.result import Result
from vibrident.use.tracking import EVERY_S
from vibrident.use.tracking.causes import CAUSE_SAMPLES, Cause, find_cause
from vibrident.use.tracking.effects import CarriedEffects
from vibrident.use.tracking.known import known_effects, without_known
from vibrident.use.tracking.reference_noise import ReferenceNoise, estimate_reference_noise
from vibrident.use.tracking.state import CERTAIN_IN_U, Alarm, TrackedEstimate, TrackerSettings
from vibrident.use.tracking.tracker import Tracker

MAX_ROWS_OF_RECORDS = 100  # rows of records that are shorter than as many times EVERY_S
#: Largest offset of a chunk that still follows the one before, in sampling intervals.
MAX_CHUNK_OFFSET_INTERVALS = 0.5


@dataclass(frozen=True)
class Trouble:
    """Samples with a fault."""

    what: str  # ``lost``, ``late`` or ``doubled``
    time_s: float
    samples: int


@dataclass(eq=False)
class TrackingSession:
    """A sensor that is tracked at a source."""

    tracker: Tracker
    every: int  # samples a row
    units: NamedTexts  # unit of each parameter
    cause: Cause  # departure from the model, since the alarm that it explained
    effects: CarriedEffects  # of the calibration that the session began with
    samples: int = 0  # taken so far
    samples_to_row: int = 0  # until the next row
    started: bool = False
    troubles: list[Trouble] = field(default_factory=list)  # with the chunks so far
    alarms: list[Alarm] = field(default_factory=list)  # so far
    # alarms whose cause is looked for in the samples after them
    waiting_alarms: list[Alarm] = field(default_factory=list)
    # samples after the first of these alarms, each of shape (2, samples)
    samples_after: list[FloatArray] = field(default_factory=list)

    @classmethod
    def from_result(
        cls,
        result: Result,
        rate_hz: float,
        quantity: Quantity,
        every_s: float,
        settings: TrackerSettings,
    ) -> TrackingSession:
        """Begin a session with an identified sensor.

        Args:
            result: of an identification, with the uncertainty of every parameter.
            rate_hz: samples per second.
            quantity: of the reference.
            every_s: time between rows, s.
            settings: of the tracking.

        Raises:
            InputError: the result lacks a gain or an uncertainty.
            ModelError: its model has no state space.
        """
        sensor = result.to_sensor("tracking")
        sensor.require_uncertainty()
        settings = replace(settings, model_error=float(result.settings.get("model_error", 0.0)))
        tracker = Tracker(
            sensor.model, sensor.values, sensor.covariance, rate_hz, quantity, settings
        )
        units = {name: result.parameters[name].unit for name in sensor.model.parameter_names}
        every = max(1, round(every_s * rate_hz))
        reference = np.zeros(tracker.network.parameters)
        reference[tracker.network.gain] = settings.reference_uncertainty
        effects = CarriedEffects.from_result(result, sensor.covariance, reference)
        return cls(
            tracker, every, units, Cause(None, "", tracker.values), effects, samples_to_row=every
        )

    @classmethod
    def from_records(
        cls,
        result: Result,
        data: Calibration,
        settings: TrackerSettings,
        every_s: float | None = None,
    ) -> tuple[TrackingSession, Iterator[Chunk]]:
        """Begin a session with the records of a calibration, and return their samples with it.

        Known responses of the channels are taken out; their uncertainty is carried.

        Args:
            result: of an identification, with the uncertainty of every parameter.
            data: records in the order of time.
            settings: of the tracking.
            every_s: time between rows, s; None: a hundredth of the records, 1 s at most.

        Raises:
            InputError: the records cannot be tracked, or as of :meth:`from_result`.
            ModelError: as of :meth:`from_result`.
        """
        data.require_response(result.response_unit, "A table has no samples to track a sensor by.")
        data = without_known(data)
        rate_hz = data.records[0].sampling_rate_hz
        block_s = settings.block / rate_hz
        length_s = sum(record.duration_s for record in data.records)
        every_s = every_s or max(block_s, min(EVERY_S, length_s / MAX_ROWS_OF_RECORDS))
        session = cls.from_result(result, rate_hz, data.quantity, every_s, settings)
        rows, moves = known_effects(data, result.to_sensor())
        session.effects = replace(session.effects, channel_rows=rows, channel_moves=moves)
        return session, chunks_of(data)

    @property
    def changing(self) -> tuple[float, float] | None:
        """Return time and detection of a change that is certain but not named yet, s."""
        if self.waiting_alarms:
            return self.waiting_alarms[0].time_s, self.waiting_alarms[0].detected_s
        return self.tracker.changing

    def take(self, chunk: Chunk) -> list[TrackedEstimate]:
        """Take samples and return the rows that they complete."""
        reference, response = self._align(chunk)
        rows = []
        while len(response):
            count = min(self.samples_to_row, len(response))
            self.tracker.feed(reference[:count], response[:count])
            self._keep_samples(reference[:count], response[:count])
            reference = reference[count:]
            response = response[count:]
            self.samples += count
            self.samples_to_row -= count
            if not self.samples_to_row:
                rows.append(self.read())
                self.samples_to_row = self.every
        return rows

    def finish(self) -> list[TrackedEstimate]:
        """End the session and return a last row."""
        self._end_run()
        return [self.read()]

    def _keep_samples(self, reference: FloatArray, response: FloatArray) -> None:
        """Keep the samples after an alarm until they suffice to find its cause."""
        if self.waiting_alarms:
            self.samples_after.append(np.stack([reference, response]))
        self._collect_alarms()
        if sum(samples.shape[1] for samples in self.samples_after) >= CAUSE_SAMPLES:
            self._report_alarms()

    def _collect_alarms(self) -> None:
        self.waiting_alarms += self.tracker.alarms
        self.tracker.alarms.clear()
        if not (self.changing or self.cause.code):
            self.cause = Cause(None, "", self.tracker.values)

    def _end_run(self) -> None:
        """End the run of samples."""
        self.tracker.finish()
        self._collect_alarms()
        self._report_alarms()

    def _report_alarms(self) -> None:
        """Report the cause of the waiting alarms once, and alarms without a cause as they are."""
        net = self.tracker.network
        cause = None
        alarms = self.waiting_alarms
        before = self.cause
        samples = np.zeros((2, 0))
        if self.samples_after:
            samples = np.concatenate(self.samples_after, axis=1)
        self.waiting_alarms = []
        self.samples_after = []
        if samples.shape[1] >= self.tracker.settings.block and np.isfinite(samples).all():
            cause = find_cause(
                net.model, samples[0], samples[1], 1.0 / net.interval_s, net.quantity
            )
        explained = [alarm for alarm in alarms if cause and cause.explains(alarm, before)]
        if cause and explained:
            if cause.code != before.code:
                self.alarms.append(replace(explained[0], what=cause.words))
            self.cause = cause
        for alarm in alarms:
            if alarm not in explained and not before.ends_with(alarm):
                self.alarms.append(alarm)
                if alarm.parameter in self.cause.values:
                    self.cause.values[alarm.parameter] = alarm.after

    def _align(self, chunk: Chunk) -> tuple[FloatArray, FloatArray]:
        """Return the new samples of a chunk; begin a run where it does not follow the last."""
        interval_s = self.tracker.network.interval_s
        expected_s = self.tracker.next_sample_s
        start_s = expected_s if chunk.start_s is None else chunk.start_s
        offset = (start_s - expected_s) / interval_s  # samples
        tolerance = MAX_CHUNK_OFFSET_INTERVALS + CERTAIN_IN_U * chunk.clock_s / interval_s
        repeated = 0
        if not self.started or chunk.separate:
            self._begin_run(start_s if not self.started or offset > 0.0 else expected_s, chunk)
            self.started = True
        elif offset > tolerance:
            self.troubles.append(Trouble("lost", expected_s, round(offset)))
            self._begin_run(start_s, chunk)
        elif offset < -tolerance:
            repeated = min(round(-offset), len(chunk.response))
            fault = "late" if repeated == len(chunk.response) else "doubled"
            self.troubles.append(Trouble(fault, start_s, repeated))
        reference = np.asarray(chunk.reference[repeated:], dtype=float)
        return reference, np.asarray(chunk.response[repeated:], dtype=float)

    def _begin_run(self, start_s: float, chunk: Chunk) -> None:
        """End the run of samples, and begin one with a chunk."""
        self._end_run()
        self.tracker.begin(start_s, self._tone_hz(chunk))

    def _tone_hz(self, chunk: Chunk) -> float | None:
        """Return the frequency of a sine, from its samples where it is not stated."""
        if not chunk.sine or chunk.tone_hz is not None:
            return chunk.tone_hz
        good = np.isfinite(chunk.reference) & np.isfinite(chunk.response)
        rate = 1.0 / self.tracker.network.interval_s
        return tone_frequency(
            Record(
                "tone",
                np.where(good, chunk.reference, 0.0),
                np.where(good, chunk.response, 0.0),
                rate,
                valid=good,
            )
        )

    def document(self) -> Fields:
        """Return the plain values of ``track.json``."""
        read = self.read()
        net = self.tracker.network
        counts = {
            what: sum(t.samples for t in self.troubles if t.what == what)
            for what in ("lost", "late", "doubled")
        }
        return {
            "model": net.model.name,
            "time_s": read.time_s,
            "parameters": {
                name: {
                    "value": read.values[name],
                    "unit": self.units[name],
                    "standard_uncertainty": u,
                }
                for name, u in read.uncertainty.items()
            },
            "alarms": [alarm.as_document() for alarm in self.alarms],
            "changing": dict(zip(("time_s", "detected_s"), self.changing or (), strict=False))
            or None,
            "cause": vars(self.cause) if self.cause.code else None,
            "samples": {"taken": self.samples, **counts},
            "troubles": [vars(trouble) for trouble in self.troubles],
            "false_alarms_per_day": self.tracker.settings.false_alarms_per_day,
            "drift_per_year": self.tracker.settings.drift_per_year,
            "noise": self.tracker.noise,
            "reference_noise": self._noise_document(read),
        }

    def read(self) -> TrackedEstimate:
        """Return the estimate now, with the stated effects of the calibration."""
        return self.effects.added(self.learned())

    def learned(self) -> TrackedEstimate:
        """Return the estimate now, corrected for white noise of the reference where possible.

        The stated effects of the calibration are not in it.
        """
        read = self.tracker.read()
        noise = self.reference_noise
        return noise.corrected(read) if noise and noise.corrects else read

    @property
    def reference_noise(self) -> ReferenceNoise | None:
        """Return the white noise of the reference, or None if it is not significant."""
        noise = estimate_reference_noise(self.tracker) if self.tracker.noise else None
        return noise if noise and noise.certain else None

    def _noise_document(self, read: TrackedEstimate) -> Fields | None:
        """Return the entry on the reference's noise in ``track.json``, or None.

        It has rms and u, the shifts of parameters above their u, and whether they are corrected.
        """
        if not (noise := self.reference_noise):
            return None
        shifts = zip(read.values, noise.shift.tolist(), strict=True)
        moves = {name: shift for name, shift in shifts if abs(shift) > read.uncertainty[name]}
        rms = noise.variance**0.5
        return {"value": rms, "u": 0.5 * noise.u / rms, "moves": moves, "corrected": noise.corrects}
