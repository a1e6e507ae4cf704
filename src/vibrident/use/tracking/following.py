"""Follow a sensor after its calibration: through records, or block by block as samples come."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from vibrident.base.brief import brief
from vibrident.base.errors import InputError
from vibrident.base.fields import Fields, GivenFields
from vibrident.base.memory import in_one_thread
from vibrident.data.io import GivenCalibration, as_calibration
from vibrident.data.records import Quantity
from vibrident.data.sources.source import Chunk
from vibrident.result import Result
from vibrident.result.loading import GivenResult, as_result
from vibrident.use.tracking import DRIFT_PER_YEAR, EVERY_S, FALSE_ALARMS_PER_DAY
from vibrident.use.tracking.outcome import tracked_result
from vibrident.use.tracking.session import TrackingSession
from vibrident.use.tracking.state import Alarm, TrackedEstimate, TrackerSettings

if TYPE_CHECKING:
    from pandas import DataFrame


class SensorTracker:
    """An identified sensor whose parameters follow the samples as they come.

    Args:
        result: of an identification, or the path of its ``result.json``; it states the uncertainty
            of every parameter.
        sampling_rate_hz: samples per second.
        quantity: what the reference is: acceleration, velocity, displacement or drive.
        every_s: time between estimates, s.
        false_alarms_per_day: expected of noise alone, in a day of motion.
        drift_per_year: random walk of the parameters in a year, relative, one for all or one each,
            by which their uncertainties grow where nothing is seen.
        reference_uncertainty: relative standard uncertainty of the reference, systematic.

    Raises:
        InputError: the result lacks a gain or an uncertainty, or a setting cannot be used.
        ModelError: its model has no state space.

    Examples:
        >>> import vibrident
        >>> first, later = (
        ...     vibrident.simulate("paper", "random", samples=4000, response_noise=0.01, seed=seed)
        ...     for seed in (1, 2)
        ... )
        >>> record = later.records[0]
        >>> tracker = vibrident.SensorTracker(vibrident.identify(first), record.sampling_rate_hz)
        >>> estimates = tracker.feed(record.reference, record.response)
        >>> round(tracker.finish().values["sensitivity"], 3)
        0.104
    """

    def __init__(
        self,
        result: GivenResult,
        sampling_rate_hz: float,
        *,
        quantity: Quantity = "acceleration",
        every_s: float = EVERY_S,
        false_alarms_per_day: float = FALSE_ALARMS_PER_DAY,
        drift_per_year: float | tuple[float, ...] = DRIFT_PER_YEAR,
        reference_uncertainty: float = 0.0,
    ) -> None:
        self._start = as_result(result)
        _require_positive(
            sampling_rate_hz=sampling_rate_hz,
            every_s=every_s,
            false_alarms_per_day=false_alarms_per_day,
        )
        settings = TrackerSettings(false_alarms_per_day, drift_per_year, reference_uncertainty)
        self._session = TrackingSession.from_result(
            self._start, sampling_rate_hz, quantity, every_s, settings
        )

    def __repr__(self) -> str:
        session = self._session
        counts = f"{session.samples} samples, {len(session.alarms)} alarms"
        return f"<SensorTracker of {self._start.model}: {counts}>"

    def feed(
        self,
        reference: ArrayLike,
        response: ArrayLike,
        *,
        start_s: float | None = None,
        new_record: bool = False,
    ) -> list[TrackedEstimate]:
        """Take samples, and return the estimates that are complete with them.

        Args:
            reference: in the SI unit of the quantity, shape (samples,); NaN for a missing sample.
            response: in the response unit of the result, alike.
            start_s: time of the first sample, s; None: they follow those before.
            new_record: whether the samples are a record of their own, which follows no other.

        Raises:
            InputError: the two have different shapes.
        """
        channels = [np.asarray(channel, dtype=float) for channel in (reference, response)]
        if channels[0].ndim != 1 or channels[0].shape != channels[1].shape:
            raise InputError(
                "The samples cannot be tracked.",
                expected="reference and response of one shape, (samples,)",
                found=f"shapes {channels[0].shape} and {channels[1].shape}",
                where="SensorTracker.feed",
                remedy="give as many samples of the one as of the other",
            )
        return self._session.take(Chunk(*channels, start_s=start_s, separate=new_record))

    def finish(self) -> TrackedEstimate:
        """Return the last estimate, as no samples follow that the present ones would wait for."""
        return self._session.finish()[-1]

    def read(self) -> TrackedEstimate:
        """Return what is known now: values, uncertainties and covariance."""
        return self._session.read()

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """Return the changes of the sensor so far, in the order of their detection."""
        return tuple(self._session.alarms)

    def to_dict(self) -> dict[str, Any]:
        """Return what ``track.json`` says: plain values."""
        return self._session.document()

    def to_result(self) -> Result:
        """Return the sensor as it is now, for report, correction, export and history."""
        return tracked_result(self._start, self._session)


@dataclass(frozen=True, eq=False)
class Tracking:
    """A sensor followed through records.

    Attributes:
        estimates: what was known, a row an interval, and at the end.
        alarms: changes of the sensor, in the order of their detection.
        result: the sensor at the end, for report, correction, export and history.
        document: what ``track.json`` says: plain values.
    """

    estimates: tuple[TrackedEstimate, ...]
    alarms: tuple[Alarm, ...]
    result: Result
    document: GivenFields

    __repr__ = brief

    def to_dataframe(self) -> DataFrame:
        """Return a row an estimate, with the columns of ``track.csv``."""
        import pandas as pd

        rows = []
        for estimate in self.estimates:
            row: Fields = {"time_s": estimate.time_s}
            for name, value in estimate.values.items():
                row |= {name: value, f"{name}_u": estimate.uncertainty[name]}
            rows.append(
                {**row, "innovation": estimate.innovation, "excited": " ".join(estimate.excited)}
            )
        return pd.DataFrame(rows)


@in_one_thread
def track(
    result: GivenResult,
    calibration: GivenCalibration,
    *,
    every_s: float | None = None,
    false_alarms_per_day: float = FALSE_ALARMS_PER_DAY,
    drift_per_year: float | tuple[float, ...] = DRIFT_PER_YEAR,
) -> Tracking:
    """Follow a sensor through the records of a calibration, and say when it changed.

    Args:
        result: of an identification, or the path of its ``result.json``: the sensor at the start.
        calibration: records in the order of time, of one sampling rate, each with a reference; or
            the path of a calibration file. Known responses of its channels are taken out.
        every_s: time between estimates, s; None: a hundredth of the records, 1 s at most.
        false_alarms_per_day: expected of noise alone, in a day of motion.
        drift_per_year: random walk of the parameters in a year, relative, one for all or one each.

    Raises:
        InputError: the records cannot be tracked, or are in another unit than the result's.
        ModelError: the model of the result has no state space.

    Examples:
        >>> import vibrident
        >>> first, later = (
        ...     vibrident.simulate("paper", "random", samples=4000, response_noise=0.01, seed=seed)
        ...     for seed in (1, 2)
        ... )
        >>> tracking = vibrident.track(vibrident.identify(first), later)
        >>> tracking.alarms
        ()
        >>> tracking.result.estimator
        'tracked'
    """
    start = as_result(result)
    data = as_calibration(calibration)
    _require_positive(every_s=every_s or EVERY_S, false_alarms_per_day=false_alarms_per_day)
    reference_uncertainty = data.reference_standard_uncertainty
    settings = TrackerSettings(false_alarms_per_day, drift_per_year, reference_uncertainty)
    session, chunks = TrackingSession.from_records(start, data, settings, every_s)
    estimates = [estimate for chunk in chunks for estimate in session.take(chunk)]
    estimates += session.finish()
    outcome = tracked_result(start, session)
    return Tracking(tuple(estimates), tuple(session.alarms), outcome, session.document())


def _require_positive(**settings: float) -> None:
    for name, value in settings.items():
        if not (np.isfinite(value) and value > 0):
            raise InputError(
                f"The setting {name} cannot be used.",
                expected="a finite number above 0",
                found=repr(value),
                where="SensorTracker",
                remedy=f"give {name} a number above 0, or leave it out",
            )
