"""Free decays alone → a result: natural frequency and damping ratio; no gain, and no curve.

Nothing measures what moved the mass, so sensitivity (or generator constant), delay and response over frequency stay
unknown, and the result does not have them.
"""

from __future__ import annotations

import datetime
import platform
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import Any

import numpy as np

from vibrident.base.errors import InputError, ModelError
from vibrident.base.tails import student_quantile
from vibrident.base.version import __version__
from vibrident.data.records import Calibration, FloatArray, Record
from vibrident.fit.decay.examine import Change, Decays, drifts, examine, motion_of
from vibrident.fit.screening.quality import Finding, screen
from vibrident.physics.models import CORES, SensorModel, model_of
from vibrident.physics.models.base import OSCILLATOR as NAMES
from vibrident.physics.naming import in_words
from vibrident.result import Correlation, Curve, Fit, MeasuredCurve, Parameter, Result, ResultWarning, Signal, Training

WEAK = 0.1  # a parameter is weakly determined above this relative standard uncertainty
COVERAGE = 0.95
MOST_SAMPLES = 600  # samples of an excerpt
METHOD = (
    "free decays: maximum likelihood of the free motion, each record with its own initial state, offset and noise; "
    "nothing measures the excitation, so there is no gain"
)


def identify_decays(calibration: Calibration, model: str | None = None, *, inflate: bool = True) -> Result:
    """Identify natural frequency and damping ratio from free decays.

    ``calibration``: of decays alone; ``model``: name of the sensor model; None for that of the calibration;
    ``inflate``: whether the misfit of a rejected model is in the uncertainties (Birge ratio).

    Raises:
        InputError: no record can be used, or the model has further parameters, which a decay does not determine.
    """
    begin = time.perf_counter()
    sensor = model_of(calibration, model)
    require_one_oscillator(sensor)
    records, findings = screen(calibration.records, calibration.units)
    decays = examine(records)
    data = from_data(decays, inflate=inflate)
    covariance = data.covariance + np.sum([np.zeros((2, 2)), *_clock(calibration)], axis=0)
    return document(calibration, sensor, records, findings, decays, replace(data, covariance=covariance), begin)


def require_plain(estimator: object, *, sampled: bool) -> None:
    """Refuse what is not made for decays alone.

    ``estimator``: as requested; ``sampled``: whether the posterior was requested.
    """
    if sampled or estimator not in ("auto", "ml"):
        raise ModelError(
            "The networks are trained on records with a reference; free decays alone have an estimate of their own.",
            expected="the estimator 'auto' (or 'ml'), without posterior",
            found=f"free decays only, {'a posterior' if sampled else f'estimator {estimator!r}'}",
            where="estimator",
            remedy="use the estimator 'auto'",
        )


def require_one_oscillator(model: SensorModel) -> None:
    """Refuse a model with parameters that decays alone do not determine."""
    parts = [addon for addon in model.add_ons if addon.rational is not None or addon.force is not None]
    more = [spec.name for addon in parts for spec in addon.parameters]
    if more or model.core.oscillator != NAMES:
        fitting = [core.name for core in CORES.values() if core.oscillator == NAMES]
        raise InputError(
            "Free decays alone tell one natural frequency and one damping ratio.",
            expected=f"the model {' or '.join(fitting)}",
            found=f"{model.name!r} with {', '.join(more)}" if more else repr(model.name),
            where="model",
            remedy=f"identify with {model.core.name!r}, or add records with a reference",
        )


@dataclass(frozen=True, eq=False)
class Known:
    """How well natural frequency and damping ratio are known."""

    covariance: FloatArray  # of (ln fn, δ), shape (2, 2)
    degrees_of_freedom: float  # behind it
    covers: str  # what it covers, in words


def from_data(decays: Decays, *, inflate: bool) -> Known:
    """What the decays alone say; ``inflate``: whether the misfit of a rejected model is in it (Birge ratio)."""
    birge = float(np.sqrt(max(decays.chi2 / max(decays.degrees, 1), 1.0))) if not decays.adequate and inflate else 1.0
    freedom = float(max(decays.degrees, 1)) if birge > 1.0 else decays.freedom
    covers = f"noise, scaled by the Birge ratio {birge:.3g}, as the deviations demand" if birge > 1.0 else "noise"
    return Known(decays.covariance * birge**2, freedom, covers)


def document(
    calibration: Calibration,
    model: SensorModel,
    records: Sequence[Record],
    findings: Sequence[Finding],
    decays: Decays,
    known: Known,
    begin: float,
) -> Result:
    """The result of decays examined, at their values; ``begin``: when that began, by ``time.perf_counter``."""
    covariance, freedom, covers = known.covariance, known.degrees_of_freedom, known.covers
    warnings = _warnings(findings, decays, covariance, covers)
    table = parameters(model, decays.fit.natural_frequency_hz, decays.fit.damping_ratio, covariance, freedom)
    return Result(
        model=model.name,
        estimator="ml",
        settings={
            "estimator_choice": f"auto: {METHOD}",
            "uncertainty_covers": covers,
            "coverage_factor": _coverage_factor(freedom),
            "effective_degrees_of_freedom": freedom,
            "reference_standard_uncertainty": 0.0,
            "decays": _about(decays),
            "time_s": time.perf_counter() - begin,
        },
        provenance=_provenance(calibration, records),
        parameters=table,
        correlation=_correlation(covariance),
        fit=_fit(records, decays),
        response=Curve.none(),
        measured=MeasuredCurve.none(),
        warnings=warnings,
        sensor=dict(calibration.sensor),
        reference={},
        response_unit=calibration.response_unit,
        signals=_signals(records, decays, calibration.response_unit),
        training=_training(decays),
        certificate=dict(calibration.certificate),
    )


def parameters(
    model: SensorModel, natural_frequency_hz: float, damping_ratio: float, covariance: FloatArray, freedom: float
) -> dict[str, Parameter]:
    """The two estimated parameters and what follows from them alone; ``covariance`` of (ln fn, δ)."""
    k = _coverage_factor(freedom)
    u_log, u_damping = np.sqrt(np.diag(covariance))
    sure = _determined(damping_ratio, covariance)
    table = {
        NAMES[0]: _positive(natural_frequency_hz, "Hz", float(u_log), k, sure[0]),
        NAMES[1]: Parameter(
            damping_ratio,
            "1",
            float(u_damping),
            (max(0.0, damping_ratio - k * float(u_damping)), damping_ratio + k * float(u_damping)),
            sure[1],
        ),
    }

    def values(log_shift: float, damping_shift: float, gain: float = 1.0) -> dict[str, float]:
        names = dict.fromkeys(model.parameter_names, gain)
        frequency = natural_frequency_hz * np.exp(log_shift)
        return names | dict(zip(NAMES, (frequency, damping_ratio + damping_shift), strict=True))

    for derived in model.derived(values(0.0, 0.0)):
        value = float(derived.value(values(0.0, 0.0)))
        if value != float(derived.value(values(0.0, 0.0, 2.0))):
            continue  # needs the gain
        step = 1e-6
        slope = [
            np.log(derived.value(values(*up)) / derived.value(values(*down))) / (2.0 * step)
            for up, down in (((step, 0.0), (-step, 0.0)), ((0.0, step), (0.0, -step)))
        ]
        relative = float(np.sqrt(np.array(slope) @ covariance @ np.array(slope)))
        identifiable = all(known for name, known in zip(NAMES, sure, strict=True) if name in derived.needs)
        table[derived.name] = _positive(value, derived.unit, relative, k, identifiable, derived=True)
    return table


def _determined(damping_ratio: float, covariance: FloatArray) -> tuple[bool, bool]:
    """Whether natural frequency and damping ratio are known; with two real poles, both or neither."""
    u_log, u_damping = np.sqrt(np.diag(covariance))
    frequency = bool(u_log <= WEAK)
    damping = bool(u_damping <= max(WEAK * damping_ratio, 1e-12))
    return frequency, damping and (frequency or damping_ratio < 0.5)


def _positive(
    value: float, unit: str, relative: float, k: float, identifiable: bool, *, derived: bool = False
) -> Parameter:
    """A positive quantity: its interval is symmetric in the logarithm."""
    reach = float(np.exp(min(k * relative, 300.0)))
    return Parameter(value, unit, value * relative, (value / reach, value * reach), identifiable, derived)


def _coverage_factor(freedom: float) -> float:
    return float(student_quantile(min(freedom, 1e9), 0.5 + COVERAGE / 2))


def _clock(calibration: Calibration) -> list[FloatArray]:
    """What an uncertain sampling rate adds: all frequencies scale with it. Other effects leave a decay alone."""
    return [np.diag([effect.standard_uncertainty**2, 0.0]) for effect in calibration.effects if effect.kind == "clock"]


def _warnings(
    findings: Sequence[Finding], decays: Decays, covariance: FloatArray, covers: str
) -> tuple[ResultWarning, ...]:
    warnings = [ResultWarning(f.code, f.message) for f in findings]
    drifting = [s for index, s in enumerate(decays.fit.stretches) if s.drift and drifts(decays.fit, index)]
    text = "the response drifts; a straight line was fitted along with the decay."
    warnings += [ResultWarning("drift", f"{s.name}: {text}") for s in drifting]
    if not decays.adequate:
        text = (
            "One linear oscillator does not explain the free decays: the motion in stretches of time is "
            f"{np.sqrt(decays.chi2 / max(decays.degrees, 1)):.3g} times as far off as the noise explains (χ²/dof = "
            f"{decays.chi2 / max(decays.degrees, 1):.4g}, {decays.degrees} degrees of freedom). The parameters' "
            f"uncertainties cover {covers}."
        )
        warnings.append(ResultWarning("lack_of_fit", text))
    warnings += [ResultWarning("nonlinear", amplitude_words(change)) for change in decays.changes]
    sizes, values = np.sqrt(np.diag(covariance)), (1.0, decays.fit.damping_ratio)  # the first is relative
    determined = _determined(decays.fit.damping_ratio, covariance)
    for name, size, value, sure in zip(NAMES, sizes, values, determined, strict=True):
        if not sure:
            amount = f"{100 * size / value:.2g} % of its value" if value > 0.0 else f"{size:.2g} beside a value of zero"
            text = f"The data hardly determine the {in_words(name)}: standard uncertainty {amount}."
            warnings.append(ResultWarning("weakly_determined", text))
    if decays.fit.damping_ratio == 0.0:
        warnings.append(ResultWarning("at_bound", f"The {in_words(NAMES[1])} lies at its bound, zero."))
    return tuple(warnings)


def amplitude_words(change: Change) -> str:
    """What changes with the amplitude, for a person."""
    (f0, f1), (d0, d1), (a0, a1) = change.frequency_hz, change.damping, change.amplitude
    return (
        f"{change.record}: the oscillation changes as it dies away: natural frequency {f0:.6g} Hz at the beginning "
        f"(rms {a0:.3g}) and {f1:.6g} Hz at the end (rms {a1:.3g}), {100 * (f1 / f0 - 1):+.2g} %; damping ratio "
        f"{d0:.4g} and {d1:.4g}. Spring or damping depends on the amplitude; one value for both is a mean."
    )


def _about(decays: Decays) -> list[dict[str, Any]]:
    """What ``settings["decays"]`` holds, a record each."""
    return [
        {
            "record": stretch.name,
            "begins_s": stretch.first / stretch.rate_hz,
            "samples": int(stretch.response.size),
            "noise": stretch.scale,
            "noise_order": len(stretch.noise.whitening) - 1,
            "tones_hz": list(stretch.noise.tones_hz),
            "chi2": part.chi2,
            "degrees_of_freedom": part.degrees,
        }
        for stretch, part in zip(decays.fit.stretches, decays.parts, strict=True)
    ]


def _correlation(covariance: FloatArray) -> Correlation:
    size = np.sqrt(np.diag(covariance))
    shared = float(np.clip(covariance[0, 1] / max(size[0] * size[1], 1e-300), -1.0, 1.0))
    return Correlation(NAMES, ((1.0, shared), (shared, 1.0)))


def _fit(records: Sequence[Record], decays: Decays) -> Fit:
    parts = [_compared(r, decays, i) for i, r in enumerate(records)]
    residual = np.concatenate([measured - predicted for _, measured, predicted in parts])
    response = np.concatenate([measured - measured.mean() for _, measured, _ in parts])
    mse, variance = float(np.mean(residual**2)), float(np.mean(response**2))
    ratio = float(np.sqrt(mse / variance)) if variance > 0 else float("nan")
    return Fit(
        rmse=float(np.sqrt(mse)),
        mae=float(np.mean(np.abs(residual))),
        mse=mse,
        r2=1.0 - ratio**2,
        rpd=1.0 / ratio if ratio > 0 else float("inf"),
        nrmse=ratio,
        chi2_reduced=decays.chi2 / decays.degrees if decays.degrees > 0 else None,
        degrees_of_freedom=decays.degrees,
        adequate=decays.adequate,
    )


def _compared(record: Record, decays: Decays, index: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time, measured and predicted response of the samples that count."""
    stretch = decays.fit.stretches[index]
    predicted = motion_of(decays.fit, index)
    kept = stretch.valid
    time_s = (np.arange(stretch.response.size) + stretch.first) / record.sampling_rate_hz
    return time_s[kept], stretch.response[kept], predicted[kept]


def _signals(records: Sequence[Record], decays: Decays, unit: str) -> tuple[Signal, ...]:
    signals = []
    for index, record in enumerate(records):
        time_s, measured, predicted = _compared(record, decays, index)
        rmse, deviation = float(np.sqrt(np.mean((measured - predicted) ** 2))), float(np.std(measured))
        pick = slice(0, None, max(1, -(-measured.size // MOST_SAMPLES)))
        nrmse = rmse / deviation if deviation > 0 else 0.0
        signals.append(Signal(record.name, time_s[pick], measured[pick], predicted[pick], unit, rmse, nrmse))
    return tuple(signals)


def _training(decays: Decays) -> Training:
    found = decays.fit
    rows = sum(len(x.residual) for x in found.locals)
    path: Mapping[str, tuple[float, ...]] = {
        name: tuple(point[i] for point in found.path) for i, name in enumerate(NAMES)
    }
    return Training("levenberg_marquardt", "converged", len(found.costs), tuple(c / rows for c in found.costs), path)


def _provenance(calibration: Calibration, records: Sequence[Record]) -> dict[str, Any]:
    sources = [r.provenance for r in records]
    return {
        "vibrident": __version__,
        "python": platform.python_version(),
        "libraries": {name: version(name) for name in ("numpy", "scipy")},
        "calibration_file": calibration.source,
        "files": [{"file": s.file, "sha256": s.sha256, "history": list(s.history)} for s in sources],
        "seed": None,
        "time": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }
