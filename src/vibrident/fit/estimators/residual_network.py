"""The network with a learned residual beside its physics.

The physics is trained alone first. Then small networks beside it
(:mod:`vibrident.physics.network.residual`) are trained together with the physics on a part of the
data and judged on the remainder. A network is used only if it predicts data that it has not seen
significantly better than the physics alone. Otherwise the estimate is that of the physics alone,
bit by bit. The network used is trained once more on all data, together with the physics, so that
the parameters' covariance includes their correlation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from vibrident.base.errors import ModelError, NotConverged
from vibrident.data.records import FloatArray, Record
from vibrident.fit.descent.sandwich import hac_covariance
from vibrident.fit.estimators.base import Estimate, Estimator
from vibrident.fit.estimators.findings import Findings, LearnedShare
from vibrident.fit.estimators.residual_candidate import (
    PRIOR,
    ResidualCandidate,
    beginning_network,
    prior_weights,
)
from vibrident.fit.optimise import Progress, silent
from vibrident.fit.problem import BinProblem, Evidence
from vibrident.fit.problem.time_domain import TimeProblem
from vibrident.fit.registry import ESTIMATORS
from vibrident.physics.models import SensorModel
from vibrident.physics.network.residual import STRUCTURES, with_residual

#: Steps of a block, over which squared residuals are summed and compared.
BLOCK_STEPS = 32
#: Fewest blocks that are held out.
MIN_BLOCKS = 16


@dataclass(frozen=True)
class ResidualIpnn(Estimator):
    """Settings of the estimator ``ipnn`` with a learned residual.

    Attributes:
        physics: the network without a residual; its weights are tied.
        structures: parts of the residual networks tried, in order.
    """

    name: ClassVar[str] = "ipnn"
    title: ClassVar[str] = "the physics-informed network with a learned residual"
    trains_network: ClassVar[bool] = True
    for_one_calibration: ClassVar[bool] = True

    physics: Estimator = field(default_factory=lambda: ESTIMATORS[ResidualIpnn.name])
    structures: tuple[tuple[str, ...], ...] = STRUCTURES

    def fit(self, evidence: Evidence, progress: Progress = silent) -> Estimate:
        """Train the physics, then the networks parallel to it.

        Raises:
            ModelError: the physics cannot have a network beside it, or there are no records with a
                reference.
            InputError: no record is long enough.
        """
        if not getattr(self.physics, "is_tied", True):
            raise ModelError(
                "A learned residual stands beside physics that is tied.",
                expected="a network whose weights are tied to the physics",
                found=self.physics.title,
                where="estimator 'ipnn' with a learned residual",
                remedy="leave the physics at its default",
            )
        for structure in self.structures:
            with_residual(evidence.model, structure)  # refuses before anything is trained
        plain = self.physics.fit(evidence, progress)
        physics = ResidualCandidate.physics(plain, evidence)
        train = _training_lanes(physics.problem)
        if train is None:
            return _estimate_of_physics(plain, "too little data to hold a part out", {})
        trained = physics.trained(train, progress)
        residual_of_physics = trained.residuals(~train)
        verdicts: dict[tuple[str, ...], _Verdict] = {}
        for structure in self.structures:
            if len(structure) > 1 and not _are_both_needed(
                [verdicts[(component,)] for component in structure if (component,) in verdicts]
            ):
                continue
            verdicts[structure] = _judge(structure, trained, train, residual_of_physics, progress)
        summaries = {
            "+".join(structure): verdict.summary for structure, verdict in verdicts.items()
        }
        useful = [
            (structure, verdict) for structure, verdict in verdicts.items() if verdict.is_useful
        ]
        if not useful:
            return _estimate_of_physics(
                plain, "no network predicts held-out data better than the physics alone", summaries
            )
        # A larger network must leave at most 80 % of the mean square that a smaller one leaves.
        best = min(useful, key=lambda pair: pair[1].remainder * 0.8 ** (2 - len(pair[0])))
        candidate = best[1].candidate.trained(np.ones(train.shape, dtype=bool), progress, 1e-3)
        return _estimate_with_network(plain, physics.problem, best[0], candidate, summaries)


@dataclass(frozen=True, eq=False)
class _Verdict:
    """A trained candidate, with its effect on the held-out data.

    Attributes:
        candidate: as trained.
        gain: squared residual over the physics' noise that the candidate removes.
        remainder: squared residual over the physics' noise that the candidate leaves.
        is_useful: whether the gain is worthwhile and significant.
        summary: for the settings of a result.
    """

    candidate: ResidualCandidate
    gain: float
    remainder: float
    is_useful: bool
    summary: Mapping[str, Any]


def _training_lanes(problem: TimeProblem) -> np.ndarray | None:
    """Return lanes to train on, shape (M,), None where there are too few; the others are held out.

    Of six or more records every third is held out; of fewer, every other eighth of each.
    """
    lanes = problem.lanes
    segment = np.asarray(lanes.segment)
    used = segment < len(problem.record_of_segment)
    if len(problem.records) >= 6:
        train = problem.by_lane(np.arange(len(problem.records)) % 3 != 1).astype(bool)
    else:
        train = np.ones(segment.shape, dtype=bool)
        for number in range(len(problem.record_of_segment)):
            lanes_of_segment = np.flatnonzero(segment == number)
            block_lanes = max(1, len(lanes_of_segment) // 8)
            train[lanes_of_segment] = (np.arange(len(lanes_of_segment)) // block_lanes) % 2 == 0
    held_weight = (
        np.asarray(lanes.weight)
        .reshape(-1, BLOCK_STEPS, segment.size)
        .sum(axis=1)[:, used & ~train]
    )
    return train if np.sum(held_weight > 0) >= MIN_BLOCKS and np.any(train & used) else None


def _judge(
    structure: tuple[str, ...],
    physics: ResidualCandidate,
    train: np.ndarray,
    residual_of_physics: FloatArray,
    progress: Progress,
) -> _Verdict:
    """Return the best network of a structure, trained on ``train``, with its verdict elsewhere."""
    try:
        best = beginning_network(structure, physics, train).trained(train, progress)
    except NotConverged:
        return _Verdict(physics, 0.0, np.inf, False, {"status": "not converged"})
    scale = best.problem.by_lane(best.noise)
    residual_before = residual_of_physics / scale
    residual_after = best.residuals(~train) / scale
    gain = float(np.sum(residual_before**2 - residual_after**2))
    remaining = float(np.sum(residual_after**2))
    # Where the network has learned noise alone, its prediction moves by a random δ: Σ r δ has this
    # deviation.
    products = np.sum(
        (residual_after * (residual_before - residual_after)).reshape(-1, BLOCK_STEPS, scale.size),
        axis=1,
    )
    deviation = 2.0 * float(np.sqrt(np.sum(products**2)))
    is_useful = gain > 0.05 * remaining and gain > 5.0 * deviation  # worthwhile, and significant
    summary = {
        "kept": bool(is_useful),
        "held_out_rmse_ratio": float(np.sqrt(max(remaining + gain, 0.0) / remaining))
        if remaining > 0
        else 1.0,
        "significance": gain / deviation if deviation > 0 else 0.0,
    }
    physics_noise = physics.problem.by_lane(physics.noise)
    remainder = float(np.sum((best.residuals(~train) / physics_noise) ** 2))
    gain_over_physics = float(np.sum((residual_of_physics / physics_noise) ** 2)) - remainder
    return _Verdict(best, gain_over_physics, remainder, is_useful, summary)


def _are_both_needed(single: list[_Verdict]) -> bool:
    """Return whether each part improves the fit and none makes the others superfluous.

    The best part must leave a tenth or more of the gain of each other part.
    """
    if not all(verdict.is_useful for verdict in single):
        return False
    best = min(single, key=lambda verdict: verdict.remainder)
    return all(best.remainder > 0.1 * verdict.gain for verdict in single if verdict is not best)


def _estimate_of_physics(plain: Estimate, reason: str, tried: Mapping[str, Any]) -> Estimate:
    """Return the estimate of the physics alone, untouched."""
    learned = LearnedShare(False, 0.0, tried, {"reason": reason})
    return replace(plain, findings=replace(plain.findings, learned=learned))


def _estimate_with_network(
    plain: Estimate,
    physics: TimeProblem,
    structure: tuple[str, ...],
    candidate: ResidualCandidate,
    tried: Mapping[str, Any],
) -> Estimate:
    """Return the estimate with the network beside the physics, and the share of each by record.

    The physics has to explain the records less the learned part.
    """
    assert plain.problem is not None
    count = len(plain.z)
    records = candidate.problem.records
    normal = candidate.normal(np.ones(candidate.problem.lanes.segment.shape, dtype=bool))
    lines = candidate.problem.lines(candidate.z, candidate.coordinates, candidate.noise)
    covariance, freedom = hac_covariance(
        lines, candidate.problem.degrees_of_freedom, np.diag(prior_weights(candidate.coordinates))
    )
    z = np.asarray(candidate.z)[:count]
    predicted = tuple(candidate.problem.by_record(normal.response))
    by_physics = physics.predict(plain.coordinates, z)
    added = [
        by_network - by_physics_alone
        for by_network, by_physics_alone in zip(predicted, by_physics, strict=True)
    ]
    shares = [
        _rms_share(added_series, by_network)
        for added_series, by_network in zip(added, predicted, strict=True)
    ]
    about = {
        "structure": list(structure),
        "weights": {
            name: value
            for name, value in candidate.coordinates.values(candidate.z).items()
            if name in PRIOR
        },
        "share_by_record": dict(zip([record.name for record in records], shares, strict=True)),
        "rmse": _rmse(records, predicted),
        "rmse_of_physics_alone": _rmse(records, plain.predicted or ()),
    }
    share = _rms_share(np.concatenate(added), np.concatenate(predicted))
    network = plain.findings.network
    trace = candidate.trace
    assert trace is not None
    assert network is not None
    records_of_physics = tuple(
        replace(record, response=record.response - np.nan_to_num(added_series))
        for record, added_series in zip(records, added, strict=True)
    )
    # A part of the misfit looked like noise of the reference, and has been learned since: the noise
    # of the plain fit is not stated.
    findings = Findings(
        replace(network, noise=candidate.noise, weights=""),
        learned=LearnedShare(True, share, tried, about),
    )
    problem = plain.problem.of_frame(records_of_physics, plain.problem.frame)
    in_noise = plain.in_noise
    if in_noise is not None and isinstance(problem, BinProblem):
        in_noise = replace(in_noise, band=replace(in_noise.band, problem=problem)).at_noise_of(
            z, plain.coordinates
        )
    return replace(
        plain,
        z=z,
        covariance=covariance[:count, :count],
        degrees_of_freedom=freedom,
        trace=replace(trace, coordinates=trace.coordinates[:, :count]),
        predicted=predicted,
        problem=problem,
        findings=findings,
        in_noise=in_noise,
    )


def _rms_share(added: FloatArray, predicted: FloatArray) -> float:
    """Return the rms of the network's output over that of the prediction."""
    deviation = float(np.nanstd(predicted)) if np.isfinite(predicted).any() else 0.0
    return _rms(added) / deviation if deviation > 0 else 0.0


def _rmse(records: Sequence[Record], predicted: Sequence[FloatArray]) -> float:
    """Return the root mean square of measured minus predicted responses, NaN left out."""
    pairs = zip(records, predicted, strict=True)
    return _rms(np.concatenate([record.response - series for record, series in pairs]))


def _rms(series: FloatArray) -> float:
    """Return the root mean square of a series, NaN left out."""
    return float(np.sqrt(np.nanmean(series**2)))


def saved_model(
    model: SensorModel, settings: Mapping[str, Any]
) -> tuple[SensorModel, dict[str, float]]:
    """Return the model with the residual network that a result holds, and its weights.

    A result without one gives the model itself and no weights.
    """
    saved = settings.get("residual_network") or {}
    if not saved.get("kept"):
        return model, {}
    return with_residual(model, tuple(saved["structure"])), {
        name: float(value) for name, value in saved["weights"].items()
    }
