"""Acceleration from a measured response, with a stated band and the uncertainty of every sample.

    â = L/H(θ̂) · (response − offset)

Its uncertainty has an origin for each entry of ``ORIGINS``; see ``components`` and ``background``.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from vibrident.base.brief import brief
from vibrident.base.errors import InputError
from vibrident.base.memory import in_one_thread
from vibrident.data.io import GivenCalibration, as_calibration
from vibrident.data.records import Calibration, FloatArray, Quantity, Record
from vibrident.data.screening import ScreeningFinding
from vibrident.physics.models.slopes import ComplexArray
from vibrident.result.loading import GivenResult, as_result
from vibrident.use.correction.background import (
    check_ends,
    measure_background,
    starts_in_motion,
    with_rest_prepended,
)
from vibrident.use.correction.band import (
    BINS_PER_OCTAVE,
    MIN_EDGE_PERIODS,
    AccelerationSpectrum,
    PassBand,
    choose_band,
    highest_frequency,
    measure_content,
    motion_share,
    stated_band,
)
from vibrident.use.correction.chain import MeasuringChain
from vibrident.use.correction.compensation import Compensation
from vibrident.use.correction.components import (
    removed_deviation,
    uncertainty_components,
    unknown_samples,
)
from vibrident.use.correction.peak import (
    Peak,
    ReferenceAgreement,
    ReferenceMotion,
    compare_with_reference,
    find_peak,
    reference_in_band,
)
from vibrident.use.correction.quiet import (
    Baseline,
    bridged_response,
    estimate_baseline,
    rest_to_borrow,
    screened_by_response,
)

BAND_ROUNDS = 2  # of the choice of the band; the first improves the part of the record with motion
TOP_OF_PEAK = 0.5  # a shock's top is above this part of its peak
MAX_NARROWER_OCTAVES = 3.0  # by which bands for the top are narrower
MIN_HIDDEN_SHARE = 0.1  # of a peak, in which hidden content is reported
MAX_EXTRAPOLATION = 1.5  # band over the highest calibrated frequency; more is reported
#: Warnings of the result that concern every sample.
INHERITED_WARNINGS = ("lack_of_fit", "weakly_determined", "nonlinear")
ORIGINS = ("noise", "model", "band", "offset", "ends", "background")


@dataclass(frozen=True, eq=False)
class Correction:
    """Record with its acceleration."""

    record: Record  # as screened: clipped samples are marked invalid
    acceleration: FloatArray  # shape (samples,), m/s²; NaN where clipped samples leave it unknown
    standard_uncertainty: FloatArray  # shape (samples,), m/s²
    components: Mapping[str, FloatArray]  # origin to standard uncertainty, each of shape (samples,)
    band: PassBand  # what was restored
    bound: float  # upper bound of the removed part (Eichstädt), m/s²
    baseline: Baseline  # rest, offset and noise of the response
    peak: Peak | None  # None if it lies among samples that are not known
    # the reference as acceleration in the same band, shape (samples,); None if absent
    reference: FloatArray | None
    agreement: ReferenceAgreement | None  # with the reference; None if absent
    # number of integrations; zero for a sensor that responds to constant acceleration
    integrated_from_rest: int
    findings: tuple[ScreeningFinding, ...] = ()  # of its ends and its parts at rest

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class Corrections:
    """Corrections of several records."""

    corrections: tuple[Correction, ...]  # one a record, in order, without those left out
    findings: tuple[ScreeningFinding, ...]  # doubts about the data
    unit: str  # of the acceleration
    model: str  # the sensor's
    motion: str = "acceleration"  # the restored quantity: acceleration, or the drive

    __repr__ = brief


@in_one_thread
def correct(
    result: GivenResult,
    records: GivenCalibration | Sequence[Record],
    *,
    band_hz: tuple[float, float] | None = None,
    noise: float | None = None,
) -> Corrections:
    """Restore the acceleration from the measured response of records.

    Args:
        result: of an identification, or the path of its ``result.json``; its parameters, their
            uncertainties and correlation are used.
        records: a calibration, the path of a calibration file, or records alone; a reference is
            used for comparison only, and the known response of ``[response]`` is removed with the
            sensor's. Records without a reference have the excitation ``decay``.
        band_hz: lowest and highest frequency to restore; None: chosen for each record from its
            noise and its motion. The low-pass falls to zero over the octave above the highest.
        noise: standard deviation of white noise of the response, response unit; None: from the
            records.

    Raises:
        InputError: the model has no linear inverse, the units differ, or a record or the band
            cannot be used.

    Examples:
        >>> import vibrident
        >>> hz = [100, 300, 650, 1000]
        >>> calibration = vibrident.simulate(frequencies_hz=hz, samples=2000, response_noise=1e-3)
        >>> result = vibrident.identify(calibration)
        >>> shock = vibrident.simulate("paper", "shock", samples=4000, response_noise=1e-3, seed=2)
        >>> restored = vibrident.correct(result, shock).corrections[0]
        >>> restored.acceleration.shape, restored.standard_uncertainty.shape
        ((4000,), (4000,))
    """
    result = as_result(result)
    result.require_linear()
    sensor = result.to_sensor("a correction")
    sensor.require_uncertainty()
    quantity: Quantity = "acceleration"
    recorded_unit = result.response_unit
    reference_known = channel = None
    if isinstance(records, str | os.PathLike):
        records = as_calibration(records)
    if isinstance(records, Calibration):
        records.require_response(result.response_unit, "A table holds no response in time.")
        quantity = records.quantity
        selected = records.records
        recorded_unit = records.units["response"]
        reference_known = records.reference_known_response
        channel = records.response_known_response
    else:
        selected = tuple(records)
    if noise is not None and not (np.isfinite(noise) and noise >= 0):
        raise InputError(
            "The noise is not usable.",
            expected="a standard deviation in the response unit, 0 or above",
            found=repr(noise),
            where="⟦correct.noise⟧",
            remedy="correct it, or leave it to be estimated",
        )
    usable, findings = screened_by_response(selected, recorded_unit)
    unit = sensor.input_unit
    correction = partial(
        _correct_record,
        chain=MeasuringChain(sensor, channel),
        motion=ReferenceMotion(quantity, reference_known),
        band_hz=band_hz,
        noise=noise,
        unit=unit,
    )
    corrections = tuple(_correct_from_rest(record, correction) for record in usable)
    calibrated_hz = tuple(result.response.frequency_hz.tolist())
    all_findings = [
        ScreeningFinding(warning.code, f"The result carries a warning: {warning.message}")
        for warning in result.warnings
        if warning.code in INHERITED_WARNINGS
    ]
    all_findings += findings
    for corrected in corrections:
        all_findings += _findings(corrected, findings, calibrated_hz)
    return Corrections(corrections, tuple(all_findings), unit, result.model, sensor.quantity)


def _correct_from_rest(record: Record, correction: Callable[[Record], Correction]) -> Correction:
    """Correct one record, with the rest at its end prepended if it begins in motion."""
    borrowed = rest_to_borrow(record)
    if borrowed == 0:
        return correction(record)
    longer = correction(with_rest_prepended(record, borrowed))
    peak = longer.peak and replace(
        longer.peak, time_s=longer.peak.time_s - borrowed / record.sampling_rate_hz
    )
    return replace(
        longer,
        record=record,
        acceleration=longer.acceleration[borrowed:],
        standard_uncertainty=longer.standard_uncertainty[borrowed:],
        components={name: series[borrowed:] for name, series in longer.components.items()},
        peak=peak,
        reference=None if longer.reference is None else longer.reference[borrowed:],
        findings=(starts_in_motion(record.name), *longer.findings),
    )


def _correct_record(
    record: Record,
    chain: MeasuringChain,
    motion: ReferenceMotion,
    band_hz: tuple[float, float] | None,
    noise: float | None,
    unit: str,
) -> Correction:
    baseline = estimate_baseline(record, noise)
    values = bridged_response(record) - baseline.offset
    restored = _restore(record, values, baseline, chain, band_hz)
    compensation = restored.compensation
    band = compensation.band
    components = uncertainty_components(
        values, record.mask, restored.spectrum, compensation, restored.content
    )
    background = measure_background(
        record, values, restored.acceleration, components, band, baseline, unit
    )
    components["background"] = background.deviation
    findings = [*check_ends(record, values, baseline), *background.findings]
    unknown = unknown_samples(record, compensation)
    hidden = float(np.max(np.abs(restored.acceleration[unknown]), initial=0.0))
    acceleration = np.where(unknown, np.nan, restored.acceleration)
    components = {name: np.where(unknown, np.nan, series) for name, series in components.items()}
    u = np.sqrt(sum(series**2 for series in components.values()))
    integrated = restored.spectrum * compensation.after_integration
    peak = find_peak(acceleration, integrated, compensation, components)
    if peak is not None and hidden > abs(peak.value):
        peak = None
    reference = reference_in_band(record, motion, compensation)
    agreement = None
    if reference is not None:
        agreement = compare_with_reference(record, motion, acceleration, components, reference)
    elif record.reference is not None and motion.response is not None:
        text = (
            f"{record.name}: the motion is not compared with the reference, whose known response "
            f"does not cover {0.5 * band.low_hz:.4g} to {band.stop_hz:.4g} Hz."
        )
        findings.append(ScreeningFinding("band_sensitive", text))
    return Correction(
        record,
        acceleration,
        np.asarray(u),
        components,
        band,
        restored.content.bound(band),
        baseline,
        peak,
        reference,
        agreement,
        compensation.integrations,
        tuple(findings),
    )


class _Restoration(NamedTuple):
    """A record's acceleration in a band."""

    compensation: Compensation
    content: AccelerationSpectrum  # of the motion
    spectrum: ComplexArray  # of the response, at the lines of the compensation
    acceleration: FloatArray  # shape (samples,)


def _restore(
    record: Record,
    values: FloatArray,
    baseline: Baseline,
    chain: MeasuringChain,
    band_hz: tuple[float, float] | None,
) -> _Restoration:
    """Restore the acceleration; the band is chosen by it in a few rounds, unless it is stated.

    ``values``: response without offset, shape (samples,).
    """
    rate = record.sampling_rate_hz
    highest, why = highest_frequency(chain, rate)
    known_from_hz = chain.known_from_hz
    low_edge = known_from_hz > 0.0 or (chain.zeros_at_rest > 0 and baseline.rest_samples == 0)
    edges = {"low_edge": low_edge, "known_from_hz": known_from_hz}
    event = motion_share(values)
    for _ in range(BAND_ROUNDS):
        content = measure_content(values, rate, chain, baseline, event, highest)
        if band_hz is None:
            band = choose_band(content, rate, highest, **edges)
        else:
            band = stated_band(band_hz, highest, why, **edges)
        compensation = Compensation.from_baseline(chain, band, rate, record.samples, baseline)
        compensation = compensation.with_better_ends(values)
        spectrum = compensation.spectrum(values)
        acceleration = compensation.restored(spectrum)
        event = motion_share(acceleration)
    if band_hz is None and record.excitation == "shock":
        compensation = _narrow_for_peak(values, acceleration, compensation, content)
        spectrum = compensation.spectrum(values)
        acceleration = compensation.restored(spectrum)
    return _Restoration(compensation, content, spectrum, acceleration)


def _narrow_for_peak(
    values: FloatArray, acceleration: FloatArray, wide: Compensation, content: AccelerationSpectrum
) -> Compensation:
    """Return a narrower band if the peak of a shock has a smaller uncertainty in it.

    The corners at a shock's foot need a wide band, with its noise; its top does not. Bands are
    judged by the mean square of noise and removed part over the samples above half the peak.
    """
    index = int(np.argmax(np.abs(acceleration)))
    high = np.sign(acceleration[index]) * acceleration >= TOP_OF_PEAK * abs(acceleration[index])
    below = np.flatnonzero(~high)
    first = int(below[below < index][-1]) + 1 if np.any(below < index) else 0
    last = int(below[below > index][0]) if np.any(below > index) else values.size
    best = wide
    least = np.inf
    for step in range(round(MAX_NARROWER_OCTAVES * BINS_PER_OCTAVE) + 1):
        band = PassBand(
            wide.band.low_hz,
            wide.band.high_hz * 2.0 ** (-step / BINS_PER_OCTAVE),
            "least uncertainty of the shock's peak",
        )
        if band.high_hz < max(2.0 * band.low_hz, MIN_EDGE_PERIODS * wide.rate / wide.samples):
            break
        trial = replace(wide, band=band)
        noise = trial.noise_deviation[first:last]
        removed = removed_deviation(trial.spectrum(values), trial, content)[first:last]
        cost = float(np.mean(noise**2 + removed**2))
        if cost < least:
            best = trial
            least = cost
    return best


def _findings(
    correction: Correction, before: Sequence[ScreeningFinding], calibrated_hz: tuple[float, ...]
) -> list[ScreeningFinding]:
    name = correction.record.name
    findings = list(correction.findings)
    unknown = int(np.sum(~np.isfinite(correction.acceleration)))
    if unknown:
        causes = [f for f in before if f.message.startswith(f"{name}: ")]
        text = (
            f"{unknown} samples of the acceleration are unknown: samples left out lie within the "
            "filter's reach."
        )
        if correction.peak is None:
            text = f"{text[:-1]}, and the peak among them."
        findings.append(
            ScreeningFinding(causes[0].code if causes else "clipped", f"{name}: {text}")
        )
    peak = correction.peak
    if peak is not None and peak.components["band"] > MIN_HIDDEN_SHARE * abs(peak.value):
        text = (
            f"{name}: the motion has content above {correction.band.high_hz:.4g} Hz that the noise "
            "or the sampling hides; it may change the peak by "
            f"{100 * peak.components['band'] / abs(peak.value):.2g} % (k = 1)."
        )
        findings.append(ScreeningFinding("band_sensitive", text))
    if calibrated_hz and correction.band.high_hz > MAX_EXTRAPOLATION * calibrated_hz[-1]:
        text = (
            f"{name}: restored up to {correction.band.high_hz:.4g} Hz by extrapolation of the "
            f"model, which was calibrated up to {calibrated_hz[-1]:.4g} Hz."
        )
        findings.append(ScreeningFinding("band_sensitive", text))
    if _contradicts_reference(correction):
        text = (
            f"{name}: what was restored is not the motion of the reference, as zero would be "
            "nearer to it. Is it a record of another sensor, or of other units?"
        )
        findings.append(ScreeningFinding("units_suspect", text))
    return findings


def _contradicts_reference(correction: Correction) -> bool:
    """Return whether zero is nearer to the reference than the acceleration, beyond U."""
    agreement = correction.agreement
    if agreement is None or agreement.nrmse is None:
        return False
    # The agreement is of samples away from the ends.
    variance = correction.standard_uncertainty**2 - correction.components["ends"] ** 2
    expanded = 2.0 * math.sqrt(max(float(np.nanmean(variance)), 0.0))
    return agreement.nrmse > 1.0 and agreement.rmse > expanded
