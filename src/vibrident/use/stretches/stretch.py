"""A stretch of long records: a part that is fitted by itself, in memory that this bounds."""

from __future__ import annotations

import gc
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.base.errors import VibridentError
from vibrident.base.fields import NamedNumbers
from vibrident.base.memory import in_one_thread, return_freed
from vibrident.base.participants import watching
from vibrident.data.io.long_records import LongRecords, RecordSpan
from vibrident.data.records import Calibration, FloatArray
from vibrident.fit.estimators import Estimator
from vibrident.fit.identification import fit_near
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.judge.departure_report import report_departures
from vibrident.fit.judge.measured import sums_of_signals
from vibrident.fit.response.response import ComplexArray
from vibrident.physics.models import model_of
from vibrident.result import Finding, ResultWarning

#: Samples of a stretch, unless the sensor is too slow for it.
STRETCH_SAMPLES = 1 << 16

Stretch = tuple[RecordSpan, ...]


@dataclass(frozen=True, eq=False)
class FitOrder:
    """Model and settings of the fit of every stretch.

    Attributes:
        model: name of the sensor model; None: the calibration's.
        estimator: its settings.
        band_hz: that the fit takes; None: as the calibration states.
        start: values of the parameters by name, nearly right.
    """

    model: str | None
    estimator: Estimator
    band_hz: tuple[float, float] | None
    start: NamedNumbers


@dataclass(frozen=True)
class RefusedStretch:
    """Stretch that cannot be used.

    Attributes:
        stretch: the parts of records.
        reason: why, in a sentence.
    """

    stretch: Stretch
    reason: str


@dataclass(frozen=True, eq=False)
class StretchFit:
    """Summands of a stretch.

    Attributes:
        stretch: the parts of records.
        records: names of its records.
        begin_s: time of its first sample on the file's clock.
        end_s: time behind its last sample.
        values: of the parameters, shape (P,).
        covariance: of these by the noise, shape (P, P).
        degrees_of_freedom: of the noise.
        frequency_hz: of the points, shape (n,).
        measured: complex response to the reference there, shape (n,).
        relative_deviation: of its real part over its size, shape (n,).
        freedom: degrees of freedom of these, shape (n,).
        sums: as of :func:`vibrident.fit.judge.measured.sums_of_signals`, shape (4,).
        shares: of the response's power: explained, coherent, and degrees of freedom, shape (3,).
        findings: departures from the fit.
        warnings: of the data and of departures that matter.
        files: name, SHA-256 and history of the file of each record.
    """

    stretch: Stretch
    records: tuple[str, ...]
    begin_s: float
    end_s: float
    values: FloatArray
    covariance: FloatArray
    degrees_of_freedom: float
    frequency_hz: FloatArray
    measured: ComplexArray
    relative_deviation: FloatArray
    freedom: FloatArray
    sums: FloatArray
    shares: FloatArray
    findings: tuple[Finding, ...]
    warnings: tuple[ResultWarning, ...]
    files: tuple[tuple[str, str, tuple[str, ...]], ...]

    @classmethod
    def from_fit(cls, stretch: Stretch, fitted: Fitted) -> StretchFit:
        """Return the summands of a fit."""
        records = fitted.evidence.records
        estimate = fitted.estimate
        slopes = estimate.coordinates.slopes(estimate.z)
        points = fitted.judgement.points
        shares = fitted.judgement.shares
        report = report_departures(fitted, estimate.covariance)
        reports = (*fitted.reports, report)
        data = [
            ResultWarning(screening_finding.code, screening_finding.message)
            for screening_finding in fitted.evidence.findings
        ]
        return cls(
            stretch,
            records=tuple(record.name for record in records),
            begin_s=records[0].start_time_s,
            end_s=records[-1].start_time_s + records[-1].duration_s,
            values=np.array(list(fitted.values.values())),
            covariance=estimate.covariance * np.outer(slopes, slopes),
            degrees_of_freedom=float(estimate.degrees_of_freedom),
            frequency_hz=_joined([point.frequency_hz for point in points]),
            measured=_joined([point.measured for point in points]),
            relative_deviation=_joined([point.relative_deviation for point in points]),
            freedom=_joined([point.freedom for point in points]),
            sums=sums_of_signals(fitted),
            shares=np.array([shares.explained, shares.coherent, shares.freedom]),
            findings=tuple(
                finding for departure_report in reports for finding in departure_report.findings
            ),
            warnings=(
                *data,
                *(warning for departure_report in reports for warning in departure_report.warnings),
            ),
            files=tuple(
                (record.provenance.file, record.provenance.sha256, record.provenance.history)
                for record in records
            ),
        )


#: What becomes of a stretch.
StretchOutcome = StretchFit | RefusedStretch


def _joined(arrays: Sequence[np.ndarray]) -> np.ndarray:
    return np.concatenate(arrays) if len(arrays) else np.zeros(0)


def cut_into(lengths: Sequence[int], samples: int) -> list[Stretch]:
    """Return records as stretches of at most so many samples, in order.

    A longer record becomes stretches of nearly equal length; short records share one.

    Args:
        lengths: samples of each record.
        samples: most of a stretch.
    """
    stretches: list[Stretch] = []
    together: list[RecordSpan] = []
    for record, length in enumerate(lengths):
        if together and sum(piece.samples for piece in together) + length > samples:
            stretches.append(tuple(together))
            together = []
        if length <= samples:
            together.append(RecordSpan(record, 0, length))
            continue
        count = -(-length // samples)
        edges = [length * number // count for number in range(count + 1)]
        stretches += [(RecordSpan(record, edges[n], edges[n + 1]),) for n in range(count)]
    return [*stretches, tuple(together)] if together else stretches


@in_one_thread
@watching()
def fit_stretch(
    source: LongRecords | Calibration, stretch: Stretch, order: FitOrder
) -> StretchOutcome:
    """Return the summands of a stretch, or why there are none.

    Args:
        source: the records, or this stretch of them.
        stretch: its parts.
        order: what is fitted.
    """
    try:
        calibration = source if isinstance(source, Calibration) else source.calibration(stretch)
        calibration = calibration.within(order.band_hz)
        model = model_of(calibration, order.model)
        fitted = fit_near(calibration, model, order.estimator, order.start)
        return StretchFit.from_fit(stretch, fitted)
    except VibridentError as error:
        return RefusedStretch(stretch, str(error).partition("\n")[0])
    finally:
        gc.collect()  # arrays in cycles are few objects, and many bytes
        return_freed()
