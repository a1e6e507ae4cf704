"""The fit of long records from the fits of their stretches.

With ẑ_i the estimate of a stretch and C_i its covariance by noise, the estimate of all is

    ẑ = (Σ C_i⁻¹)⁻¹ Σ C_i⁻¹ ẑ_i,

as efficient as one fit of all (the sums of their information and scores, to first order in the
uncertainty of a stretch). Sums are in the order of time, so they do not depend on who computed
what. That the sensor is one is tested by Q = Σ (ẑ_i − ẑ)ᵀ C_i⁻¹ (ẑ_i − ẑ), which is χ² with
(m − 1) P degrees of freedom for m stretches; that the model explains them by their points, pooled
by frequency: there the noise is that of all stretches together.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibrident.base.amounts import amount, plain
from vibrident.base.fields import Fields
from vibrident.data.records import FloatArray
from vibrident.fit.information import inverse_normal
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.judge.document import Uncertainty, budget_of, document
from vibrident.fit.judge.measured import metrics
from vibrident.fit.judge.misfit import describe_misfit
from vibrident.fit.response.verdict import REJECTION, probability
from vibrident.fit.uncertainty.adequacy import Points, assess
from vibrident.fit.uncertainty.explained import Shares
from vibrident.fit.uncertainty.parameters import deviations, parameter_units
from vibrident.physics.naming import in_words
from vibrident.result import Finding, Result, ResultWarning
from vibrident.use.stretches.stretch import RefusedStretch, StretchFit, StretchOutcome

DIGITS = 7  # of values in words


@dataclass(frozen=True, eq=False)
class PooledEstimate:
    """Estimate of all stretches.

    Attributes:
        z: coordinates, shape (P,).
        covariance: of these by noise, shape (P, P).
        weights: of each stretch, shape (m, P, P); their sum is one.
        chi2: Q.
        degrees_of_freedom: of Q.
        worst: index of the stretch that is furthest from the others, and of its parameter that is.
    """

    z: FloatArray
    covariance: FloatArray
    weights: FloatArray
    chi2: float
    degrees_of_freedom: int
    worst: tuple[int, int]

    @classmethod
    def from_stretches(cls, estimates: FloatArray, covariances: FloatArray) -> PooledEstimate:
        """Return the estimate by those of stretches.

        Args:
            estimates: their coordinates, shape (m, P).
            covariances: of these, shape (m, P, P).
        """
        information = inverse_normal(covariances)
        covariance = inverse_normal(np.sum(information, axis=0))
        weights = covariance @ information
        origin = estimates[0]
        z = origin + np.sum((weights @ (estimates - origin)[:, :, None])[..., 0], axis=0)
        away = estimates - z
        squares = np.einsum("ip,ipq,iq->i", away, information, away)
        deviation = np.sqrt(np.maximum(np.diagonal(covariances, axis1=1, axis2=2), 1e-300))
        furthest = int(np.argmax(squares))
        parameter = int(np.argmax(np.abs(away[furthest]) / deviation[furthest]))
        degrees = (len(estimates) - 1) * estimates.shape[1]
        chi2 = float(np.sum(squares))
        return cls(z, covariance, weights, chi2, degrees, (furthest, parameter))

    @property
    def chance(self) -> float:
        """Return the chance that noise moves the stretches as far apart."""
        return probability(self.chi2, self.degrees_of_freedom)

    @property
    def is_one_sensor(self) -> bool:
        """Return whether noise explains the differences of the stretches."""
        return self.chance >= REJECTION

    @property
    def birge(self) -> float:
        """Return √(Q/ν), at least one."""
        ratio = self.chi2 / max(self.degrees_of_freedom, 1)
        return float(np.sqrt(max(ratio, 1.0)))


def pooled_result(
    first: Fitted, outcomes: Sequence[StretchOutcome], uncertainty: Uncertainty
) -> Result:
    """Return the result of long records.

    Args:
        first: the fit of the first of the stretches that were used.
        outcomes: of all stretches, in order.
        uncertainty: what the uncertainties cover.
    """
    used = [outcome for outcome in outcomes if isinstance(outcome, StretchFit)]
    pooled = PooledEstimate.from_stretches(*_estimates(first, used))
    widened = 1.0 if pooled.is_one_sensor or uncertainty == "noise" else pooled.birge
    estimate = replace(
        first.estimate,
        z=pooled.z,
        covariance=widened**2 * pooled.covariance,
        degrees_of_freedom=sum(fit.degrees_of_freedom for fit in used),
    )
    fitted = replace(
        first,
        evidence=replace(first.evidence, findings=()),
        estimate=estimate,
        departures=(),
        reports=(),
    )
    fitted = _judge(fitted, used)
    result = document(fitted, budget_of(fitted, uncertainty))
    findings = _findings(used)
    warnings = [*result.warnings, *_warnings(used, {finding.code for finding in findings})]
    if not pooled.is_one_sensor:
        warnings.append(_change_warning(fitted, used, pooled, widened))
    refused = [outcome for outcome in outcomes if isinstance(outcome, RefusedStretch)]
    if refused:
        warnings.append(_refusal_warning(refused, len(outcomes)))
    settings = {**result.settings, "stretches": _settings(fitted, used, pooled, len(outcomes))}
    return replace(
        result,
        fit=metrics(np.sum([fit.sums for fit in used], axis=0), fitted),
        findings=tuple(findings),
        warnings=tuple(warnings),
        settings=settings,
        provenance={**result.provenance, "files": _files(used)},
    )


def _estimates(first: Fitted, used: Sequence[StretchFit]) -> tuple[FloatArray, FloatArray]:
    """Return estimates and covariances in the coordinates of the first, (m, P) and (m, P, P)."""
    coordinates = first.estimate.coordinates
    names = first.evidence.model.parameter_names
    points = []
    covariances = []
    for fit in used:
        z = coordinates.place(dict(zip(names, fit.values.tolist(), strict=True)))
        slopes = coordinates.slopes(z)
        inverse = np.divide(1.0, slopes, out=np.zeros_like(slopes), where=slopes != 0.0)
        points.append(z)
        covariances.append(fit.covariance * np.outer(inverse, inverse))
    return np.array(points), np.array(covariances)


def _judge(fitted: Fitted, used: Sequence[StretchFit]) -> Fitted:
    """Return a fit judged by the points of all stretches."""
    points = _pooled_points(used, fitted.response)
    adequacy = assess(points, len(fitted.estimate.z))
    shares_by_fit = np.array([fit.shares for fit in used])
    explained, coherent = np.average(
        shares_by_fit[:, :2], axis=0, weights=[f.sums[3] for f in used]
    )
    shares = Shares(float(explained), float(coherent), float(np.sum(shares_by_fit[:, 2])))
    lack_of_fit = describe_misfit(adequacy, points, fitted.response)
    if shares.lacking:
        lack_of_fit = str(shares) if adequacy.adequate else f"{lack_of_fit} {shares}"
        adequacy = replace(adequacy, adequate=False)
    judgement = replace(
        fitted.judgement,
        adequacy=adequacy,
        lack_of_fit=lack_of_fit,
        birge=adequacy.birge,
        points=tuple(points),
        shares=shares,
    )
    return replace(fitted, judgement=judgement)


def _pooled_points(used: Sequence[StretchFit], response: Any) -> list[Points]:
    """Return the points of all stretches as means at the frequencies of those of most points.

    What is averaged is the ratio of measured and model response, so that places that differ a
    little do not matter.
    """
    grid = max((fit.frequency_hz for fit in used), key=len)
    grid = grid[np.argsort(grid, kind="stable")]
    if not len(grid):
        return []
    ratio = np.zeros(len(grid), complex)
    weight = np.zeros(len(grid))
    freedom = np.zeros(len(grid))
    edges = np.log(grid[:-1] * grid[1:]) / 2.0
    for fit in used:
        if not len(fit.frequency_hz):
            continue
        index = np.searchsorted(edges, np.log(fit.frequency_hz))
        of_model = fit.measured / response(fit.frequency_hz)
        weights = (np.abs(of_model) * fit.relative_deviation) ** -2.0
        np.add.at(ratio, index, weights * of_model)
        np.add.at(weight, index, weights)
        np.add.at(freedom, index, fit.freedom)
    occupied = weight > 0.0
    ratio = ratio[occupied] / weight[occupied]
    weight = weight[occupied]
    hz = grid[occupied]
    deviation = weight**-0.5 / np.abs(ratio)
    squares = np.abs(ratio - 1.0) ** 2 * weight
    name = used[0].records[0] if len(used) == 1 else f"{len(used)} stretches"
    measured = response(hz) * ratio
    return [Points(hz, measured, deviation, (name,) * len(hz), squares, freedom[occupied])]


def _findings(used: Sequence[StretchFit]) -> list[Finding]:
    """Return the departures that are significant among all stretches, with their impact on all."""
    count = len(used)
    return [
        replace(
            finding,
            probability=finding.probability * count,
            impact={name: size / count for name, size in finding.impact.items()},
        )
        for fit in used
        for finding in fit.findings
        if finding.probability * count < REJECTION
    ]


def _warnings(used: Sequence[StretchFit], significant: set[str]) -> list[ResultWarning]:
    """Return one warning of each code, with the number of stretches that have it.

    Args:
        used: the stretches.
        significant: codes of departures that are significant among all stretches.
    """
    departures = {finding.code for fit in used for finding in fit.findings}
    firsts: dict[str, ResultWarning] = {}
    counts: Counter[str] = Counter()
    for fit in used:
        of_code = {warning.code: warning for warning in reversed(fit.warnings)}
        for code, warning in of_code.items():
            if code not in departures or code in significant:
                firsts.setdefault(code, warning)
                counts[code] += 1
    return [
        replace(first, message=f"{first.message} So in {counts[code]} of {len(used)} stretches.")
        for code, first in firsts.items()
    ]


def _change_warning(
    fitted: Fitted, used: Sequence[StretchFit], pooled: PooledEstimate, widened: float
) -> ResultWarning:
    """Return the warning of a sensor that is not the same all along."""
    stretch, parameter = pooled.worst
    model = fitted.evidence.model
    name = model.parameter_names[parameter]
    unit = parameter_units(model, fitted.evidence.calibration)[name]
    worst, mean = (
        amount(float(value), unit, DIGITS)
        for value in (used[stretch].values[parameter], fitted.values[name])
    )
    text = (
        f"The sensor is not the same all along: its estimates by {len(used)} stretches differ by "
        f"more than noise explains (χ² = {plain(pooled.chi2, 4)}, {pooled.degrees_of_freedom} "
        f"degrees of freedom). Most at {used[stretch].records[0]}: {in_words(name)} {worst}, where "
        f"all together give {mean}."
    )
    if widened > 1.0:
        text += f" The uncertainties are enlarged by the Birge ratio, {plain(widened, 3)}."
    return ResultWarning("regimes", text)


def _refusal_warning(refused: Sequence[RefusedStretch], count: int) -> ResultWarning:
    """Return the warning of stretches that could not be used."""
    text = (
        f"{len(refused)} of {count} stretches of the records could not be used and are left out. "
        f"The first: {refused[0].reason}"
    )
    return ResultWarning("dead_channel", text)


def _settings(
    fitted: Fitted, used: Sequence[StretchFit], pooled: PooledEstimate, count: int
) -> Fields:
    """Return the values of each stretch over time, and how well they agree."""
    rows = []
    for fit in used:
        values = dict(zip(fitted.values, fit.values.tolist(), strict=True))
        u = zip(fitted.values, deviations(fit.covariance).tolist(), strict=True)
        row = {"record": fit.records[0], "from_s": fit.begin_s, "to_s": fit.end_s}
        rows.append(row | values | {f"{name}_u": deviation for name, deviation in u})
    return {
        "count": count,
        "used": len(used),
        "chi2": pooled.chi2,
        "degrees_of_freedom": pooled.degrees_of_freedom,
        "probability": pooled.chance,
        "values": rows,
    }


def _files(used: Sequence[StretchFit]) -> list[Fields]:
    """Return each data file once, with the history of the first stretch of it."""
    files: dict[tuple[str, str], list[str]] = {}
    counts: Counter[tuple[str, str]] = Counter()
    for fit in used:
        for name, digest, history in fit.files:
            files.setdefault((name, digest), list(history))
            counts[name, digest] += 1
    return [
        {
            "file": name,
            "sha256": digest,
            "history": [*history, f"the first of {counts[name, digest]} stretches"],
        }
        for (name, digest), history in files.items()
    ]
