"""Expected uncertainty of a planned calibration, and the best choice of its frequencies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from vibrident.base.brief import brief
from vibrident.base.errors import InputError, unknown
from vibrident.base.fields import Fields, NamedNumbers
from vibrident.base.memory import in_one_thread
from vibrident.data.records import (
    REFERENCE_UNITS,
    STANDARD_GRAVITY,
    FloatArray,
    Quantity,
    is_motion,
)
from vibrident.fit.information import inverse_normal
from vibrident.fit.uncertainty import (
    correlation,
    curve,
    parameter_table,
    weakly_determined,
    with_reference,
)
from vibrident.fit.uncertainty.curve import with_resonances
from vibrident.fit.uncertainty.parameters import fields_of_units, sizes_of
from vibrident.result import Correlation, Curve, Parameter, Result
from vibrident.result.document import plain
from vibrident.result.loading import GivenResult, as_result
from vibrident.use.planning.design import CRITERIA, Criterion, best_points, efficiency, total
from vibrident.use.planning.inputs import (
    model_and_values,
    one_a_frequency,
    planned_frequencies,
    reference_quantity,
    require_points,
)
from vibrident.use.planning.points import (
    PlannedPoints,
    Recording,
    Subject,
    points_of_records,
    points_of_table,
    short_record_findings,
)

#: Neighbours on either side over which the noise of a result's own points is averaged: it is
#: estimated, and the choice must not favour points with a low estimate.
NEIGHBOURS = 2
CURVE_POINTS = 101  # points of the sensitivity curve
MIN_COORDINATE_SIZE = 1e-3  # of a coordinate, where its uncertainty is taken relative to it


@dataclass(frozen=True, eq=False)
class Plan:
    """Expected outcome of a planned calibration."""

    model: str  # name of the sensor model
    frequency_hz: FloatArray  # of the points, shape (n,)
    uses: tuple[int, ...]  # how often each is measured, shape (n,)
    # standard deviation of each point's sensitivity over its size, shape (n,)
    relative_deviation: FloatArray
    parameters: Mapping[str, Parameter]  # with expected standard uncertainty, estimated and derived
    correlation: Correlation  # of the estimated parameters
    response: Curve  # sensitivity curve with its uncertainty
    warnings: tuple[str, ...]  # of an identification, and doubts about the plan
    criterion: Criterion | None  # of the choice; None if all are measured
    candidates_hz: FloatArray  # from which the points were chosen
    # of the choice, relative to the best design of the same measuring time; None if all are
    # measured
    efficiency: float | None
    # standard uncertainty by parameter of as many points spread evenly over the candidates; empty
    # where all are measured
    spread: NamedNumbers
    all_points: NamedNumbers  # standard uncertainty by parameter of all candidates

    __repr__ = brief


@in_one_thread
def plan(
    sensor: GivenResult,
    parameters: Mapping[str, float] | None = None,
    *,
    frequencies_hz: Sequence[float] | FloatArray | None = None,
    amplitude: float | Sequence[float] = STANDARD_GRAVITY,
    recording: Recording | None = None,
    magnitude_uncertainty: float | Sequence[float] | None = None,
    phase_uncertainty_rad: float | Sequence[float] | None = None,
    times_as_long: float = 1.0,
    quantity: Quantity | None = None,
    reference_uncertainty: float | None = None,
    response_unit: str = "V",
    best: int | None = None,
    criterion: Criterion = "D",
    repeats: bool = False,
) -> Plan:
    """Predict the uncertainties of a calibration with sines.

    The points' uncertainty comes from ``recording`` (noise and length of records), from
    ``magnitude_uncertainty`` and ``phase_uncertainty_rad`` (a table), or, with neither, from the
    result: points as good as those of its own calibration, interpolated over frequency.

    Args:
        sensor: name of a model, or the result of an identification, or the path of its
            ``result.json``.
        parameters: of the model, SI units, frequencies in Hz; None takes the result's.
        frequencies_hz: planned, or the candidates of which ``best`` are chosen; None takes the
            result's.
        amplitude: peak of the acceleration, m/s², one or one a frequency.
        recording: how sines are recorded.
        magnitude_uncertainty: relative standard uncertainty of a tabulated magnitude, one or one a
            frequency.
        phase_uncertainty_rad: standard uncertainty of a tabulated phase; None: no phase is
            measured.
        times_as_long: with a result's own points: factor of the records' length.
        quantity: of the reference; None takes the result's, or acceleration.
        reference_uncertainty: relative, systematic: the calibration of the reference; None takes
            the result's gains.
        response_unit: for a model; a result has its own.
        best: choose so many frequencies; None: measure all.
        criterion: ``D`` (smallest ellipsoid of all parameters) or ``A`` (smallest sum of squared
            relative uncertainties; of a delay: in radians at the highest frequency).
        repeats: whether a frequency may be chosen several times.

    Raises:
        InputError: a setting cannot be used; the message says which.
        ModelError: the model is unknown.

    Examples:
        >>> import vibrident
        >>> true = {"sensitivity": 0.1, "natural_frequency": 650.0, "damping_ratio": 0.18}
        >>> plan = vibrident.plan(
        ...     "accelerometer",
        ...     true,
        ...     frequencies_hz=vibrident.one_third_octave(20.0, 1000.0),
        ...     magnitude_uncertainty=0.002,
        ...     best=3,
        ... )
        >>> len(plan.frequency_hz), plan.parameters["sensitivity"].standard_uncertainty < 0.002
        (3, True)
    """
    if not isinstance(sensor, str) or sensor.lower().endswith(".json"):
        sensor = as_result(sensor)
    model, values = model_and_values(sensor, parameters)
    source = sensor if isinstance(sensor, Result) else None
    frequency = planned_frequencies(frequencies_hz, source)
    subject = Subject(model, values, reference_quantity(quantity, source), frequency)
    peaks = one_a_frequency("amplitude", amplitude, frequency)
    magnitude, phase = (
        None if u is None else one_a_frequency(label, u, frequency)
        for label, u in (
            ("magnitude uncertainty", magnitude_uncertainty),
            ("phase uncertainty", phase_uncertainty_rad),
        )
    )
    if recording is not None and magnitude is None:
        points = points_of_records(subject, peaks, recording)
    elif magnitude is not None and recording is None:
        points = points_of_table(subject, magnitude, phase)
    else:
        points = _points_of_result(subject, source, times_as_long, twice=recording is not None)
    if criterion not in CRITERIA:
        raise unknown("The criterion is not known.", criterion, CRITERIA, "⟦plan.criterion⟧")
    require_points(
        points,
        best if best is not None else frequency.size,
        repeats=repeats,
        is_best=best is not None,
    )
    unit = source.response_unit if source is not None else response_unit
    gain, findings = _systematic_part(source)
    points = replace(points, findings=points.findings + findings)
    systematic = gain if reference_uncertainty is None else reference_uncertainty
    return _plan(points, systematic, unit, source, best, criterion, repeats)


def _plan(
    points: PlannedPoints,
    reference_uncertainty: float,
    unit: str,
    source: Result | None,
    best: int | None,
    criterion: Criterion,
    repeats: bool,
) -> Plan:
    coordinates = points.coordinates
    z = points.coordinates.first
    frequency = points.subject.frequency_hz
    count = frequency.size
    model = coordinates.model
    scale = sizes_of(coordinates.model, points.coordinates.first, MIN_COORDINATE_SIZE, ratios=True)
    uses = np.ones(count, dtype=int)
    reached_efficiency = None
    spread = {}
    if best is not None:
        uses = best_points(points.information, best, criterion, scale, repeats=repeats)
        reached_efficiency = efficiency(uses, points.information, criterion, scale)
        even = np.bincount(np.round(np.linspace(0, count - 1, best)).astype(int), minlength=count)
        spread = _deviations(points, even, reference_uncertainty)
    covariance, freedom = _covariance(points, uses)
    weak, warnings = weakly_determined(coordinates, z, covariance)
    covariance = with_reference(covariance, z, model, reference_uncertainty)
    drive = not is_motion(points.subject.quantity)
    reference = REFERENCE_UNITS[points.subject.quantity] if drive else "m/s^2"
    if drive and source is not None:
        reference = source.reference.get("unit") or reference
    fields = fields_of_units(unit, reference, drive=drive)
    table = parameter_table(coordinates, z, covariance, freedom, fields, weak)
    low = float(frequency.min())
    high = float(frequency.max())
    band = np.geomspace(low, high, CURVE_POINTS) if high > low else np.array([low])
    band = with_resonances(band, model.rational(coordinates.values(z)))
    used = np.flatnonzero(uses)
    return Plan(
        model.name,
        frequency[used],
        tuple(int(n) for n in uses[used]),
        points.relative_deviation[used],
        table,
        correlation(model, covariance),
        curve(coordinates, z, covariance, points.subject.quantity, band),
        (
            *(warning.message for warning in warnings),
            *short_record_findings(points, used),
            *points.findings,
        ),
        criterion if best is not None else None,
        frequency,
        reached_efficiency,
        spread,
        _deviations(points, np.ones(count, dtype=int), reference_uncertainty),
    )


def _systematic_part(source: Result | None) -> tuple[float, tuple[str, ...]]:
    """Return the relative u of a result's gains, and the findings of what is left out.

    The gains are common to all points.
    """
    if source is None:
        return 0.0, ()
    rows = source.settings.get("uncertainty_budget", ())
    gains = [row["standard_uncertainty"] for row in rows if row["kind"] == "gain"]
    effects = [row["source"] for row in rows if row["type"] == "B" and row["kind"] != "gain"]
    findings = (
        [f"The plan leaves out systematic effects of the calibration: {', '.join(effects)}."]
        if effects
        else []
    )
    if not source.fit.adequate:
        findings.append(
            "The calibration rejected the model: the plan is of noise alone, its misfit is left "
            "out."
        )
    return float(np.linalg.norm(gains)), tuple(findings)


def _covariance(points: PlannedPoints, uses: np.ndarray) -> tuple[FloatArray, float]:
    """Return the covariance of z and its degrees of freedom, as of the estimator ``ml``."""
    freedom = np.repeat(points.freedom, uses)
    inflation = float(np.mean(1.0 + 4.0 / freedom))  # the weights are estimated too
    return inverse_normal(total(uses, points.information)) * inflation, float(np.sum(freedom))


def _deviations(
    points: PlannedPoints, uses: np.ndarray, reference_uncertainty: float
) -> NamedNumbers:
    """Return the standard uncertainty of each estimated parameter, physical units."""
    coordinates = points.coordinates
    z = points.coordinates.first
    covariance, freedom = _covariance(points, uses)
    covariance = with_reference(covariance, z, coordinates.model, reference_uncertainty)
    table = parameter_table(
        coordinates, z, covariance, freedom, fields_of_units("1", "1", drive=True), {}
    )
    return {
        name: float(table[name].standard_uncertainty or 0.0)
        for name in coordinates.model.parameter_names
    }


def _points_of_result(
    subject: Subject, source: Result | None, times_as_long: float, *, twice: bool
) -> PlannedPoints:
    """Return points as good as those of a result."""
    if not (np.isfinite(times_as_long) and times_as_long > 0):
        raise InputError(
            "The length of the records cannot be planned with.",
            expected="a finite factor above 0",
            found=f"{times_as_long:g}",
            where="⟦plan.times_as_long⟧",
            remedy="give another number, or leave it out",
        )
    if twice or source is None or not source.measured.frequency_hz.size:
        raise InputError(
            "The uncertainty of the points is not given, or given twice.",
            expected=(
                "noise with sampling rate and samples, or uncertainties of magnitude and phase, "
                "or a result with measured points"
            ),
            found="records and a table" if twice else "none of them",
            where="⟦here⟧",
            remedy="give one of them",
        )
    magnitude, phase = _noise_of_result(source, subject, times_as_long)
    return points_of_table(subject, magnitude, phase)


def _noise_of_result(
    source: Result, subject: Subject, longer: float
) -> tuple[FloatArray, FloatArray | None]:
    """Return the noise of a result's points, smoothed, interpolated and scaled to the length.

    ``longer``: factor of the records' length. Returns the relative u of the magnitude and the u of
    the phase, rad, or None without a phase.
    """
    # Within a resonance or a high-pass the noise relative to the response falls with the gain. What
    # is smoothed is the deviation from the line log u = c + b log |H|: b is 0 of noise in
    # proportion to the response, and −1 of noise of one level.
    measured = source.measured
    frequency = subject.frequency_hz
    order = np.argsort(measured.frequency_hz, kind="stable")
    f = measured.frequency_hz[order]
    gain, planned_gain = (
        np.log(np.abs(replace(subject, frequency_hz=at).response())) for at in (f, frequency)
    )
    f = np.log(f)
    noise = measured.magnitude_noise
    phase_noise = measured.phase_deg_noise
    apart = np.isfinite(noise).any()  # else an older result, or a table
    u = ((noise if apart else measured.magnitude_uncertainty) / measured.magnitude)[order]
    u_phase = (phase_noise if apart else measured.phase_deg_uncertainty)[order]

    def at(values: FloatArray) -> FloatArray:
        good = np.isfinite(values) & (values > 0)
        if not good.any():
            return np.full(frequency.shape, np.nan)
        level = np.log(values[good])
        about = gain[good] - np.mean(gain[good])
        slope = float(np.clip(about @ level / max(about @ about, 1e-12), -1.0, 0.0))
        level = level - slope * gain[good]
        index = np.arange(level.size)
        near = np.abs(index[:, None] - index) <= NEIGHBOURS
        smooth = (near @ level) / near.sum(axis=1)
        return np.exp(
            np.interp(np.log(frequency), f[good], smooth) + slope * planned_gain
        ) / np.sqrt(longer)

    phase = at(np.deg2rad(u_phase))
    return at(u), None if np.isnan(phase).any() else phase


def plan_document(planned: Plan) -> Fields:
    """Return the plain values of ``plan.json``."""
    points = zip(
        planned.frequency_hz.tolist(),
        planned.uses,
        planned.relative_deviation.tolist(),
        strict=True,
    )
    return {
        "model": planned.model,
        "parameters": {name: asdict(parameter) for name, parameter in planned.parameters.items()},
        "correlation": asdict(planned.correlation),
        "points": [
            {"frequency_hz": f, "times": n, "relative_standard_uncertainty": u}
            for f, n, u in points
        ],
        "criterion": planned.criterion,
        "efficiency": planned.efficiency,
        "candidates_hz": planned.candidates_hz.tolist(),
        "standard_uncertainty_of_all_candidates": dict(planned.all_points),
        "standard_uncertainty_of_evenly_spread_points": dict(planned.spread),
        "response": plain(planned.response),
        "warnings": list(planned.warnings),
    }
