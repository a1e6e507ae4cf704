"""The acceleration behind a measured response, with a stated band and an uncertainty for every sample.

    â = L/H(θ̂) · (response − offset)

Its uncertainty has these origins, each a series over the samples:

- noise: of the response, with its spectrum, through the filter;
- model: the covariance of the parameters through ∂â/∂θ, with their correlation; and, of a model that its calibration
  rejected, a relative error as large as its deviations from the measured points;
- band: what the low-pass removes: at each instant the highest octave kept, scaled by the ratio of the spectrum beyond
  the band to that octave's (an envelope where noise hides the spectrum);
- offset: of the response, from a rest before the motion, and of its integral behind samples that were left out;
- ends: error of the record's continuation beyond its ends;
- background: acceleration at rest beyond these (hum, drift, a shifted zero).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from vibrident.base.brief import brief
from vibrident.base.errors import InputError
from vibrident.base.memory import in_one_thread
from vibrident.data.io import GivenCalibration, as_calibration
from vibrident.data.records import BoolArray, Calibration, FloatArray, Quantity, Record
from vibrident.data.screening import Finding
from vibrident.result.given import GivenResult, as_result
from vibrident.result.sensor import IdentifiedSensor
from vibrident.use.correction.background import at_the_ends, background, begins_at_once, preceded
from vibrident.use.correction.band import (
    BINS,
    LOBE_OCTAVES,
    PERIODS,
    Band,
    Content,
    choose,
    content,
    event_of,
    highest_frequency,
    stated,
    top_octave,
)
from vibrident.use.correction.compensation import Compensation
from vibrident.use.correction.peak import Agreement, Peak, agreement_with, find_peak, reference_in_band
from vibrident.use.correction.quiet import Surroundings, filled, rest_to_borrow, screened, step_behind, surroundings

LOOKS = 2  # rounds of the choice of the band; the first improves the part of the record that holds the motion
LOCAL_PERIODS = 2.0  # window over which the highest octave's power is averaged, in periods of the band's upper edge
CLEARLY = 6.0  # what is removed is seen where it exceeds the noise so many times in mean square
CORE = 0.5  # a shock's top is above this part of its peak
NARROWER = 3.0  # bands for the top are tried down to this many octaves narrower
INHERITED = ("lack_of_fit", "weakly_determined", "nonlinear")  # warnings of the result that concern every sample
ORIGINS = ("noise", "model", "band", "offset", "ends", "background")


@dataclass(frozen=True, eq=False)
class Correction:
    """One record and its acceleration."""

    record: Record  # as screened: clipped samples are marked invalid
    acceleration: FloatArray  # shape (samples,), m/s²; NaN where clipped samples leave it unknown
    standard_uncertainty: FloatArray  # shape (samples,), m/s²
    components: Mapping[str, FloatArray]  # origin to standard uncertainty, each of shape (samples,)
    band: Band  # what was restored
    bound: float  # upper bound of the removed part (Eichstädt), m/s²
    surroundings: Surroundings  # rest, offset and noise of the response
    peak: Peak | None  # None if it lies among samples that are not known
    reference: FloatArray | None  # the reference as acceleration in the same band, shape (samples,); None if absent
    agreement: Agreement | None  # with the reference; None if absent
    integrated_from_rest: int  # number of integrations; zero for a sensor that responds to constant acceleration
    findings: tuple[Finding, ...] = ()  # of its ends and its parts at rest

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class Corrections:
    """Corrections of several records."""

    corrections: tuple[Correction, ...]  # one a record, in order, without those left out
    findings: tuple[Finding, ...]  # doubts about the data
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
        result: of an identification, or the path of its ``result.json``; its parameters, their uncertainties and
            correlation are used.
        records: a calibration, the path of a calibration file, or records alone; a reference is used for comparison
            only. Records without a reference have the excitation ``decay``.
        band_hz: lowest and highest frequency to restore; None: chosen for each record from its noise and its motion.
            The low-pass falls to zero over the octave above the highest.
        noise: standard deviation of white noise of the response, response unit; None: from the records.

    Raises:
        InputError: the model has no linear inverse, the units differ, or a record or the band cannot be used.
    """
    result = as_result(result)
    result.require_linear()
    sensor = result.to_sensor("a correction")
    sensor.require_uncertainty()
    quantity: Quantity = "acceleration"
    if isinstance(records, str | os.PathLike):
        records = as_calibration(records)
    if isinstance(records, Calibration):
        records.refuse_known_responses("A correction")
        records.require_response(result.response_unit, "A table holds no response in time.")
        quantity, given = records.quantity, records.records
    else:
        given = tuple(records)
    if noise is not None and not (np.isfinite(noise) and noise >= 0):
        raise InputError(
            "The noise is not usable.",
            expected="a standard deviation in the response unit, 0 or above",
            found=repr(noise),
            where="noise",
            remedy="correct it, or leave it to be estimated",
        )
    kept, findings = screened(given, result.response_unit)
    drive = result.reference.get("quantity") == "drive"
    unit = result.reference.get("unit") or "drive unit" if drive else "m/s^2"
    correction = partial(_corrected, sensor=sensor, quantity=quantity, band_hz=band_hz, noise=noise, unit=unit)
    done = [_with_rest(record, correction) for record in kept]
    calibrated = tuple(result.response.frequency_hz.tolist())
    doubtful = [w for w in result.warnings if w.code in INHERITED]
    inherited = [Finding(w.code, f"The result carries a warning: {w.message}") for w in doubtful]
    more = [doubt for one in done for doubt in _doubts(one, findings, calibrated)]
    motion = "drive" if drive else "acceleration"
    return Corrections(tuple(done), (*inherited, *findings, *more), unit, result.model, motion)


def _with_rest(record: Record, correction: Callable[[Record], Correction]) -> Correction:
    """One record; if its motion begins with the first sample, the rest at its end is prepended."""
    borrowed = rest_to_borrow(record)
    if borrowed == 0:
        return correction(record)
    whole = correction(preceded(record, borrowed))
    late = whole.peak and replace(whole.peak, time_s=whole.peak.time_s - borrowed / record.sampling_rate_hz)
    return replace(
        whole,
        record=record,
        acceleration=whole.acceleration[borrowed:],
        standard_uncertainty=whole.standard_uncertainty[borrowed:],
        components={name: series[borrowed:] for name, series in whole.components.items()},
        peak=late,
        reference=None if whole.reference is None else whole.reference[borrowed:],
        findings=(begins_at_once(record.name), *whole.findings),
    )


def _corrected(
    record: Record,
    sensor: IdentifiedSensor,
    quantity: Quantity,
    band_hz: tuple[float, float] | None,
    noise: float | None,
    unit: str,
) -> Correction:
    around = surroundings(record, noise)
    values, rate = filled(record) - around.offset, record.sampling_rate_hz
    highest, why = highest_frequency(sensor, rate)
    low_edge = sensor.zeros_at_rest > 0 and around.rest_samples == 0
    event = event_of(values)
    for _ in range(LOOKS):
        found = content(values, rate, sensor, around, event, highest)
        if band_hz is None:
            band = choose(found, rate, highest, low_edge=low_edge)
        else:
            band = stated(band_hz, highest, why, low_edge=low_edge)
        compensation = Compensation.of(sensor, band, rate, record.samples, around)
        spectrum = compensation.spectrum(values)
        acceleration = compensation.restored(spectrum)
        event = event_of(acceleration)
    if band_hz is None and record.excitation == "shock":
        compensation = _for_the_peak(values, acceleration, compensation, found)
        band, spectrum = compensation.band, compensation.spectrum(values)
        acceleration = compensation.restored(spectrum)
    components = _components(values, record.mask, spectrum, compensation, found)
    beside = background(record, values, acceleration, components, compensation.band, around, unit)
    components["background"] = beside.deviation
    findings = (*at_the_ends(record, values, around), *beside.findings)
    unknown = _unknown(record, compensation)
    hidden = float(np.max(np.abs(acceleration[unknown]), initial=0.0))
    acceleration = np.where(unknown, np.nan, acceleration)
    components = {name: np.where(unknown, np.nan, series) for name, series in components.items()}
    u = np.sqrt(sum(series**2 for series in components.values()))
    peak = find_peak(acceleration, spectrum * compensation.after_integration, compensation, components)
    if peak is not None and hidden > abs(peak.value):
        peak = None
    reference = reference_in_band(record, quantity, compensation)
    agreement = None if reference is None else agreement_with(record, quantity, acceleration, components, reference)
    return Correction(
        record,
        acceleration,
        np.asarray(u),
        components,
        band,
        found.bound(band),
        around,
        peak,
        reference,
        agreement,
        compensation.integrations,
        findings,
    )


def _for_the_peak(values: FloatArray, acceleration: FloatArray, wide: Compensation, found: Content) -> Compensation:
    """A narrower band, if the peak of a shock has a smaller uncertainty in it.

    The corners at a shock's foot need a wide band, with its noise; its top does not. Judged by the mean square of noise
    and removed part over the samples above half the peak.
    """
    index = int(np.argmax(np.abs(acceleration)))
    high = np.sign(acceleration[index]) * acceleration >= CORE * abs(acceleration[index])
    below = np.flatnonzero(~high)
    first = int(below[below < index][-1]) + 1 if np.any(below < index) else 0
    last = int(below[below > index][0]) if np.any(below > index) else values.size
    best, least = wide, np.inf
    for step in range(round(NARROWER * BINS) + 1):
        band = Band(
            wide.band.low_hz, wide.band.high_hz * 2.0 ** (-step / BINS), "least uncertainty of the shock's peak"
        )
        if band.high_hz < max(2.0 * band.low_hz, PERIODS * wide.rate / wide.samples):
            break
        trial = replace(wide, band=band)
        noise = trial.noise_deviation[first:last]
        removed = _removed(trial.spectrum(values), trial, found)[first:last]
        cost = float(np.mean(noise**2 + removed**2))
        if cost < least:
            best, least = trial, cost
    return best


def _components(
    values: FloatArray, mask: BoolArray, spectrum: np.ndarray, compensation: Compensation, found: Content
) -> dict[str, FloatArray]:
    """Standard uncertainty of every sample by origin."""
    slopes, around = compensation.restored(spectrum, compensation.slopes), compensation.around
    variance = np.einsum("ik,ij,jk->k", slopes, compensation.sensor.covariance, slopes, optimize=True)
    if around.offset_uncertainty > 0:
        constant = compensation.restored(compensation.spectrum(np.ones_like(values)))
        offset = np.abs(constant) * around.offset_uncertainty
    else:
        offset = np.zeros(values.size)
    if compensation.integrations == 1 and not mask.all():
        later = np.abs(compensation.after_integration[0]) / compensation.rate
        offset = np.hypot(offset, later * step_behind(values, mask))
    return {
        "noise": compensation.noise_deviation,
        "model": np.hypot(np.sqrt(np.maximum(variance, 0.0)), _misfit(spectrum, compensation)),
        "band": _removed(spectrum, compensation, found),
        "offset": offset,
        "ends": compensation.end_deviation(values),
    }


def _misfit(spectrum: np.ndarray, compensation: Compensation) -> FloatArray:
    """Standard uncertainty for the misfit of a rejected model: that part of the motion nearby; shape (samples,)."""
    values = compensation.restored(spectrum)
    width = max(1, round(LOCAL_PERIODS * compensation.rate / compensation.band.high_hz))
    nearby = np.sqrt(np.maximum(_running_mean(values**2, width), 0.0))
    return compensation.sensor.misfit * np.maximum(np.abs(values), nearby)


def _removed(spectrum: np.ndarray, compensation: Compensation, found: Content) -> FloatArray:
    """Standard uncertainty for what the low-pass, and a lower edge, removed; shape (samples,)."""
    band, around = compensation.band, compensation.around
    gain = top_octave(compensation.frequency_hz, band)
    ratio = np.where(compensation.lowpass > 0, gain / np.where(compensation.lowpass > 0, compensation.lowpass, 1.0), 0)
    octave = compensation.restored(spectrum, compensation.after_integration * ratio)
    width = max(1, round(LOCAL_PERIODS * compensation.rate / band.high_hz))
    noise = compensation.line_mean(np.abs(compensation.total * ratio) ** 2 * around.noise(compensation.frequency_hz))
    nearby = _running_mean(octave**2, width) - noise
    if around.rest_samples > 0:  # at the corners of a pulse it is larger than nearby
        turned = compensation.restored(spectrum, -1j * compensation.after_integration * ratio)
        nearby = np.maximum(nearby, 0.5 * (octave**2 + turned**2) - noise)
    local = found.ratio(band) ** 2 * np.maximum(nearby, 0.0)
    lowest, highest = 0.5 * band.low_hz, found.frequency_hz[-1]
    if found.heard.any():  # what is removed and yet stands above the noise: the end of a sweep
        highest = min(highest, 2.0**LOBE_OCTAVES * found.frequency_hz[found.heard][-1])
        local = np.maximum(local, _seen(spectrum, compensation, (band.high_hz, highest), width))
    if lowest > 0:
        period = max(1, round(compensation.rate / band.low_hz))
        local = local + _seen(spectrum, compensation, (lowest, band.low_hz), period)
    below = found.frequency_hz < band.low_hz
    lost = (1.0 - band.passed(found.frequency_hz[below])) ** 2 * found.acceleration[below] * found.lines[below]
    return np.sqrt(local + np.sum(lost) / found.event)


def _seen(spectrum: np.ndarray, compensation: Compensation, edges: tuple[float, float], width: int) -> FloatArray:
    """Mean square nearby of what is removed between two frequencies, where it exceeds the noise; shape (samples,)."""
    frequency = compensation.frequency_hz
    inside = (frequency > edges[0]) & (frequency <= edges[1])
    gain = np.zeros(frequency.shape, dtype=complex)
    gain[inside] = (1.0 - compensation.lowpass[inside]) / compensation.sensor.frequency_response(frequency[inside])
    noise = compensation.line_mean(np.abs(gain) ** 2 * compensation.around.noise(frequency))
    power = _running_mean(compensation.restored(spectrum, gain * compensation.rule) ** 2, width)
    return np.where(power > CLEARLY * noise, power, 0.0)


def _running_mean(values: FloatArray, width: int) -> FloatArray:
    """Mean of ``width`` values about each, the end values repeated."""
    total = np.cumsum(np.pad(values, (width // 2 + 1, width - 1 - width // 2), "edge"))
    return (total[width:] - total[:-width]) / width


def _unknown(record: Record, compensation: Compensation) -> BoolArray:
    """Samples that cannot be restored: invalid ones lie within the filter's reach. All later ones too if integrated
    twice, or over a gap that is not short."""
    bad = ~record.mask
    if not bad.any():
        return bad
    reach = max(1, compensation.reach)
    count = np.cumsum(np.pad(bad, (reach + 1, reach)))
    unknown = count[2 * reach + 1 :] > count[: -2 * reach - 1]
    if compensation.integrations:
        lost = bad if compensation.integrations > 1 else ~np.isfinite(step_behind(record.response, record.mask))
        unknown |= np.cumsum(lost) > 0
    return np.asarray(unknown, dtype=bool)


def _doubts(correction: Correction, before: Sequence[Finding], calibrated_hz: tuple[float, ...]) -> list[Finding]:
    name = correction.record.name
    findings = list(correction.findings)
    unknown = int(np.sum(~np.isfinite(correction.acceleration)))
    if unknown:
        causes = [f for f in before if f.message.startswith(f"{name}: ")]
        text = f"{unknown} samples of the acceleration are unknown: samples left out lie within the filter's reach."
        if correction.peak is None:
            text = f"{text[:-1]}, and the peak among them."
        findings.append(Finding(causes[0].code if causes else "clipped", f"{name}: {text}"))
    peak = correction.peak
    if peak is not None and peak.components["band"] > 0.1 * abs(peak.value):
        text = (
            f"{name}: the motion has content above {correction.band.high_hz:.4g} Hz that the noise or the sampling "
            f"hides; it may change the peak by {100 * peak.components['band'] / abs(peak.value):.2g} % (k = 1)."
        )
        findings.append(Finding("band_sensitive", text))
    if calibrated_hz and correction.band.high_hz > 1.5 * calibrated_hz[-1]:
        text = (
            f"{name}: restored up to {correction.band.high_hz:.4g} Hz by extrapolation of the model, which was "
            f"calibrated up to {calibrated_hz[-1]:.4g} Hz."
        )
        findings.append(Finding("band_sensitive", text))
    return findings
