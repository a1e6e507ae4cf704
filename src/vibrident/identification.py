"""The main path: calibration → evidence → estimate → uncertainty → result."""

from __future__ import annotations

import datetime
import functools
import platform
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from vibrident import __version__
from vibrident.assemble import Judgement, fit_of_signals, fit_of_table
from vibrident.attempts import fitted_and_judged, judged
from vibrident.decay import decays_alone, identify_decays, require_plain
from vibrident.estimators import AUTO, Estimate, Estimator, choose
from vibrident.estimators.optimise import Progress, silent
from vibrident.measure import Finding
from vibrident.measure.drift import without_drift
from vibrident.measure.hum import without_hum
from vibrident.models import SensorModel, parse
from vibrident.naming import in_words
from vibrident.problem import Evidence
from vibrident.records import Calibration, FloatArray
from vibrident.registry import ESTIMATORS
from vibrident.result import Result, ResultWarning, Training
from vibrident.scrutiny import linearised, second_thoughts
from vibrident.systematic import all_effects, covered, measured, seen
from vibrident.uncertainty import correlation, curve, doubts, parameter_table
from vibrident.uncertainty.budget import (
    DATA,
    Row,
    as_settings,
    effective_degrees_of_freedom,
    rows_of_effects,
)
from vibrident.uncertainty.curve import frequencies, with_resonances
from vibrident.uncertainty.linearised import Linearised
from vibrident.uncertainty.parameters import coverage_factor, unit_fields

Uncertainty = Literal["auto", "noise", "inflated"]
#: Rounds in which hum is told from what the fit before took of it.
HUM_ROUNDS = 3
#: Shown iterations of the optimiser in a result.
MOST_TRACE = 400


if TYPE_CHECKING:
    from vibrident.uncertainty.posterior import Sampling


def identify(
    calibration: Calibration,
    model: str | None = None,
    estimator: str | Estimator = AUTO,
    *,
    uncertainty: Uncertainty = "auto",
    posterior: Sampling | None = None,
    progress: Progress = silent,
) -> Result:
    """Identify a sensor from its calibration.

    Args:
        calibration: from :func:`vibrident.read`, :func:`vibrident.simulate` or made by hand.
        model: name of the sensor model; None takes the calibration's.
        estimator: ``auto``, a name, or an estimator object with settings of its own, such as
            ``Ipnn(discretisation="euler", optimiser="adam")``.
        uncertainty: what the uncertainties cover. ``noise``: the noise, or the stated uncertainty, of the data alone.
            ``inflated``: where the deviations from the model are larger than that, the misfit too: sine records under
            ``ml`` get a relative model error, all else is scaled by √(χ²/dof) (Birge ratio). ``auto``: ``inflated`` for
            records whose model is rejected (with the warning ``lack_of_fit``), ``noise`` otherwise; the stated
            uncertainties of a table are never scaled unasked.
        posterior: settings for sampling the parameters' posterior distribution, which ``settings.posterior`` then
            sums up; for the estimator ``ml``, with the extra ``bayes``. None: not sampled.
        progress: called after each iteration of the optimiser.

    Returns:
        The result; its warnings are empty for a clean calibration of an adequate model.

    Raises:
        InputError: the data cannot be used.
        ModelError: model, estimator and data do not fit together.
        NotConverged: no start leads to a finite fit.
    """
    if decays_alone(calibration):
        require_plain(estimator, sampled=posterior is not None)
        return identify_decays(calibration, model, inflate=uncertainty != "noise")
    begin = time.perf_counter()
    if posterior is not None:
        from vibrident.uncertainty.posterior import sampler

        sampler()  # before the fit that it would come after
    fitted = fit(calibration, model, estimator, uncertainty=uncertainty, progress=progress)
    rows = own_rows(fitted, uncertainty)
    result = document(fitted, rows)
    settings = {**result.settings, "time_s": time.perf_counter() - begin}
    if posterior is not None:
        from vibrident.uncertainty.posterior import sample_posterior

        scale = _data_scale(fitted.estimate, rows[0])
        settings["posterior"] = sample_posterior(fitted.evidence, fitted.estimate, scale, posterior)
    return replace(result, settings=settings)


@dataclass(frozen=True, eq=False)
class Fitted:
    """A calibration with its estimate, before anything is stated of it.

    Attributes:
        evidence: the data, without drift where there was one.
        estimate: the fit.
        judgement: what the estimate says of the data.
        linear: the fit at all excited frequencies, linearised at the estimate.
        estimator: that made it.
        reason: why that one.
        drifts: what was taken out.
    """

    evidence: Evidence
    estimate: Estimate
    judgement: Judgement
    linear: Linearised
    estimator: Estimator
    reason: str
    drifts: tuple[Finding, ...] = ()

    def at(self, estimate: Estimate) -> Fitted:
        """The same data judged at another estimate."""
        judgement = judged(self.evidence, estimate)
        linear = linearised(self.evidence, estimate, judgement)
        return replace(self, estimate=estimate, judgement=judgement, linear=linear)

    def again(self, values: Mapping[str, float], progress: Progress = silent) -> Fitted:
        """The same data fitted once more, from these values of the parameters."""
        return self.at(fitted_and_judged(replace(self.evidence, start=dict(values)), self.estimator, progress)[0])


def fit(
    calibration: Calibration,
    model: str | None,
    estimator: str | Estimator,
    *,
    uncertainty: Uncertainty,
    progress: Progress,
) -> Fitted:
    """Estimate and judge; arguments and errors as :func:`identify`."""
    sensor_model = parse(model or calibration.model)
    evidence = Evidence.gather(calibration, sensor_model)
    chosen, reason = _estimator(evidence, estimator, uncertainty)
    estimate, judgement = fitted_and_judged(evidence, chosen, progress)
    records, drifts = without_drift(evidence.records, judgement.predicted, calibration.response_unit)
    if drifts:
        evidence = evidence.with_records(records)
        estimate, judgement = fitted_and_judged(evidence, chosen, progress)
    hum_seen = any(estimate.settings.get("hum_hz", ()))
    if evidence.records and sensor_model.is_linear and (hum_seen or not judgement.adequacy.adequate):
        found = _without_hum(evidence, estimate, judgement, chosen, progress)
        evidence, estimate, judgement = found or (evidence, estimate, judgement)
    linear = linearised(evidence, estimate, judgement)
    return Fitted(evidence, estimate, judgement, linear, chosen, reason, tuple(drifts))


def _without_hum(
    evidence: Evidence, estimate: Estimate, judgement: Judgement, chosen: Estimator, progress: Progress
) -> tuple[Evidence, Estimate, Judgement] | None:
    """The fit without hum, where that explains the data.

    What initial states and parameters took of it is in all lines, so that only a fit without it tells how much it is.
    """
    best = None
    for _ in range(HUM_ROUNDS):
        records, hum = without_hum(evidence.records, judgement.predicted)
        if not hum:
            break
        cleaned = evidence.with_records(records)
        estimate, judgement = fitted_and_judged(cleaned, chosen, progress)
        if not judgement.adequacy.adequate:
            break
        best = cleaned, estimate, judgement
    return best


def own_rows(fitted: Fitted, uncertainty: Uncertainty) -> list[Row]:
    """The budget of a calibration by itself: its data, then each systematic effect."""
    evidence, estimate = fitted.evidence, fitted.estimate
    covariance, freedom, scope = _scaled(evidence, estimate, fitted.judgement, uncertainty)
    effects = all_effects(evidence, fitted.judgement)
    rows = rows_of_effects(effects, estimate.coordinates, estimate.z, evidence.quantity, fitted.linear)
    return [Row(scope, DATA, None, "", freedom, covariance), *rows]


def document(fitted: Fitted, rows: Sequence[Row], more: Sequence[ResultWarning] = ()) -> Result:
    """The result of a calibration whose uncertainty consists of these rows; ``more`` warnings follow its own."""
    stated = _stated(fitted, rows)
    drifts = [ResultWarning(finding.code, finding.message) for finding in fitted.drifts]
    stated = replace(stated, warnings=[*drifts, *stated.warnings, *more])
    result = _result(fitted.evidence, fitted.estimate, fitted.judgement, stated)
    return replace(result, settings={**result.settings, "estimator_choice": fitted.reason})


def _data_scale(estimate: Estimate, data: Row) -> float:
    """Factor on the data's standard deviations that the stated covariance carries: scatter, or the Birge ratio."""
    part, whole = (float(np.trace(c)) for c in (estimate.covariance, data.covariance))
    return float(np.sqrt(whole / part)) if part > 0.0 else 1.0


@dataclass(frozen=True, eq=False)
class _Stated:
    """What is stated of an estimate: its covariance and where that comes from, and what is doubted."""

    covariance: FloatArray
    degrees_of_freedom: float
    scope: str
    rows: list[Row]
    weak: dict[str, str]
    warnings: list[ResultWarning]


def _stated(fitted: Fitted, rows: Sequence[Row]) -> _Stated:
    evidence, estimate, judgement = fitted.evidence, fitted.estimate, fitted.judgement
    data = [row for row in rows if row.kind == DATA]
    covariance = np.sum([row.covariance for row in data], axis=0)
    total = np.sum([row.covariance for row in rows], axis=0)
    weak, warnings = doubts(estimate.coordinates, estimate.z, covariance)
    warnings += second_thoughts(evidence, estimate, judgement, covariance, total)
    warnings += _learned(estimate)
    freedom = float(np.min(effective_degrees_of_freedom(rows)))
    scope = "; ".join(dict.fromkeys(row.source for row in data))
    return _Stated(total, freedom, scope, list(rows), weak, warnings)


def _result(evidence: Evidence, estimate: Estimate, judgement: Judgement, stated: _Stated) -> Result:
    calibration, model = evidence.calibration, evidence.model
    coordinates, z, freedom = estimate.coordinates, estimate.z, stated.degrees_of_freedom
    names = model.parameter_names
    table = parameter_table(coordinates, z, stated.covariance, freedom, unit_fields(calibration), stated.weak)
    reference_hz = calibration.certificate.get("reference_frequency_hz")
    band = frequencies(evidence.band_hz, judgement.adequacy.frequency_hz.tolist(), reference_hz)
    band = with_resonances(band, model.rational(coordinates.values(z)))
    return Result(
        model=model.name,
        estimator=estimate.estimator,
        settings={
            **estimate.settings,
            "uncertainty_covers": "; ".join([stated.scope, *covered(stated.rows)]),
            **seen(judgement),
            **_optics(calibration),
            "coverage_factor": coverage_factor(freedom),
            "effective_degrees_of_freedom": freedom,
            "reference_standard_uncertainty": calibration.reference_standard_uncertainty,
            "uncertainty_budget": as_settings(stated.rows, names, coordinates.slopes(z)),
            "start": dict(zip(names, np.asarray(coordinates.start).tolist(), strict=True)),
        },
        provenance=_provenance(calibration, evidence),
        parameters=table,
        correlation=correlation(model, stated.covariance),
        fit=fit_of_table(evidence, estimate, judgement) if calibration.table else fit_of_signals(evidence, judgement),
        response=curve(coordinates, z, stated.covariance, calibration.quantity, band),
        measured=measured(evidence, estimate, judgement),
        warnings=_warnings(evidence, model, table, judgement, stated.warnings, stated.scope),
        sensor=dict(calibration.sensor),
        reference={"quantity": calibration.quantity, "unit": calibration.reference_unit},
        response_unit=calibration.response_unit,
        signals=judgement.signals,
        training=_training(estimate),
        weights=judgement.weights,
        certificate=dict(calibration.certificate),
    )


def _estimator(evidence: Evidence, asked: str | Estimator, scope: Uncertainty) -> tuple[Estimator, str]:
    if not isinstance(asked, str):
        return asked, "chosen by the user"
    chosen, reason = choose(evidence) if asked == AUTO else (ESTIMATORS[asked], "chosen by the user")
    return (chosen.for_noise_alone() if scope == "noise" else chosen), reason


def _scaled(
    evidence: Evidence, estimate: Estimate, judgement: Judgement, choice: Uncertainty
) -> tuple[np.ndarray, float, str]:
    """Covariance of z, its degrees of freedom, and in words what it covers."""
    adequacy, freedom = judgement.adequacy, estimate.degrees_of_freedom
    if judgement.scatter is not None:
        scatter = "the scatter of the points (no uncertainty was stated)"
        if adequacy.degrees_of_freedom <= 0:
            nothing = "nothing: no uncertainty is stated, and no point is left to judge the scatter by"
            return estimate.covariance * judgement.scatter**2, float("inf"), nothing
        return estimate.covariance * judgement.scatter**2, float(max(adequacy.degrees_of_freedom, 1)), scatter
    error = estimate.settings.get("model_error")
    if error is not None:
        text = f"noise and a relative model error of {100 * error:.3g} %, as large as the deviations demand"
        return estimate.covariance, freedom, text
    unasked = choice == "auto" and bool(evidence.records) and not adequacy.adequate
    if (choice == "inflated" or unasked) and judgement.birge > 1.0:
        text = f"noise, scaled by the Birge ratio {judgement.birge:.3g}, as the deviations demand"
        return estimate.covariance * judgement.birge**2, float(max(adequacy.degrees_of_freedom, 1)), text
    return estimate.covariance, freedom, "noise" if evidence.records else "stated uncertainties"


def _warnings(
    evidence: Evidence,
    model: SensorModel,
    table: dict[str, Any],
    judgement: Judgement,
    doubtful: list[ResultWarning],
    scope: str,
) -> tuple[ResultWarning, ...]:
    warnings = [ResultWarning(finding.code, finding.message) for finding in evidence.findings]
    adequacy = judgement.adequacy
    if not adequacy.adequate:
        covered = f" The parameters' uncertainties cover {scope}."
        warnings.append(ResultWarning("lack_of_fit", judgement.lack_of_fit + covered))
    warnings += doubtful
    gain = table[model.gain_name]
    if gain.value < 0 and adequacy.degrees_of_freedom > 0:  # fewer equations than parameters tell no sign
        text = (
            f"The {in_words(model.gain_name)} is negative: the response moves against the reference (or a "
            "channel is wired reversed)."
        )
        warnings.append(ResultWarning("polarity", text))
    return tuple(warnings)


def _optics(calibration: Calibration) -> dict[str, Any]:
    """What an interferometer's signals said of themselves, by record."""
    found = {r.name: r.optical.as_settings() for r in calibration.records if r.optical is not None}
    return {"interferometer": found} if found else {}


def _learned(estimate: Estimate) -> list[ResultWarning]:
    """What a learned residual takes on itself is not explained by the model."""
    residual = estimate.settings.get("residual_network", {})
    if not residual.get("kept"):
        return []
    text = (
        f"The model alone does not explain the data: a learned residual carries {100 * residual['share']:.2g} % of the "
        "response (settings, residual_network). Parameters and curve are the model's own."
    )
    return [ResultWarning("lack_of_fit", text)]


def _training(estimate: Estimate) -> Training:
    """The way from the grid to the optimum: start values from the response, then the estimator's own iterations."""
    trace, begin = estimate.trace, estimate.begin
    names = estimate.coordinates.model.parameter_names
    keep = np.unique(np.linspace(0, len(trace.costs) - 1, min(len(trace.costs), MOST_TRACE)).astype(int))
    before = () if begin is None or trace.optimiser == "adam" else _shown(begin.costs, begin.equations, begin.path)
    path = [estimate.coordinates.values(trace.coordinates[i]) for i in keep]
    own = _shown([trace.costs[i] for i in keep], estimate.equations, path)
    return Training(
        optimiser=trace.optimiser,
        status=trace.status,
        iterations=len(before) + len(trace.costs),
        loss=tuple(cost for cost, _ in (*before, *own)),
        parameters={name: tuple(float(point[name]) for _, point in (*before, *own)) for name in names},
        weighting_changes=(len(before),) if before else (),
    )


def _shown(
    costs: Sequence[float], equations: float, path: Sequence[dict[str, float]]
) -> tuple[tuple[float, dict[str, float]], ...]:
    """Mean squared weighted residual and parameters at each iterate."""
    return tuple((float(cost) / equations, point) for cost, point in zip(costs, path, strict=True))


@functools.cache
def _version(library: str) -> str:
    return version(library)  # reads and parses the library's metadata


def _provenance(calibration: Calibration, evidence: Evidence) -> dict[str, Any]:
    sources = [r.provenance for r in evidence.records or calibration.records]
    if calibration.table is not None:
        sources = [calibration.table.provenance]
    libraries = ("jax", "jaxlib", "numpy", "scipy", "equinox")
    return {
        "vibrident": __version__,
        "python": platform.python_version(),
        "libraries": {name: _version(name) for name in libraries},
        "calibration_file": calibration.source,
        "files": [{"file": s.file, "sha256": s.sha256, "history": list(s.history)} for s in sources],
        "seed": None,
        "time": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }
