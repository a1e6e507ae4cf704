"""The network with a learned residual beside its physics.

First the physics alone. Then small networks beside it (:mod:`vibrident.physics.network.residual`), trained together
with the physics on a part of the data and judged on the rest: one is kept only if it predicts data that it has not seen
significantly better than the physics alone. Otherwise its share is zero and the estimate is that of the physics alone,
bit by bit. What is kept is trained once more on all data, physics and network together, so that the parameters'
covariance includes their correlation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from vibrident.base.backend import jnp
from vibrident.base.errors import ModelError, NotConverged
from vibrident.data.records import FloatArray
from vibrident.fit.descent.sandwich import hac_covariance
from vibrident.fit.estimators.base import Estimate, Estimator
from vibrident.fit.estimators.findings import Findings, LearnedShare
from vibrident.fit.optimise import Progress, Trace, levenberg_marquardt, silent
from vibrident.fit.problem import BinProblem, Coordinates, Evidence, Local
from vibrident.fit.problem.network_problem import require_rational
from vibrident.fit.problem.time_domain import TimeProblem, evaluate
from vibrident.fit.registry import ESTIMATORS
from vibrident.physics.models import SensorModel
from vibrident.physics.network.residual import STRUCTURES, initial_weights, with_residual
from vibrident.physics.network.sensitivity import Normal

#: Steps over which squared residuals are summed to be compared, and fewest such blocks held out.
BLOCK, FEWEST_BLOCKS = 32, 16
#: Deviation of a weight from where it begins, in coordinates, that costs as much as one standard deviation of noise:
#: enough to keep apart what the data cannot, too little to move what they can.
PRIOR = {
    "memory_frequency": 1.0,
    "memory_damping": 0.5,
    "memory_weight": 0.3,
    "odd_weight": 3.0,
    "odd_slope": 1.0,
    "even_weight": 3.0,
    "even_slope": 1.0,
}


@dataclass(frozen=True)
class ResidualIpnn(Estimator):
    """Settings of the estimator ``ipnn`` with a learned residual.

    Attributes:
        physics: the network without; its weights tied.
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
            ModelError: the physics cannot have a network beside it, or there are no records with a reference.
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
        physics = _Candidate.physics(plain, evidence)
        parts = _held_out(physics.problem)
        if parts is None:
            return _without(plain, "too little data to hold a part out", {})
        trained = physics.trained(parts, progress)
        before = trained.residuals(~parts)
        tried: dict[tuple[str, ...], _Judged] = {}
        for structure in self.structures:
            if len(structure) > 1 and not _both_needed(
                [tried[(part,)] for part in structure if (part,) in tried]
            ):
                continue
            tried[structure] = _judged(structure, trained, parts, before, progress)
        shown = {"+".join(s): j.shown for s, j in tried.items()}
        kept = [(structure, judged) for structure, judged in tried.items() if judged.kept]
        if not kept:
            return _without(
                plain, "no network predicts held-out data better than the physics alone", shown
            )
        # A larger network must leave 80 % or less of what the smaller one left (mean square).
        best = min(kept, key=lambda pair: pair[1].left * 0.8 ** (2 - len(pair[0])))
        whole = best[1].candidate.trained(np.ones(parts.shape, dtype=bool), progress, 1e-3)
        return _with(plain, physics.problem, best[0], whole, shown)


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A network and the state of its training."""

    problem: TimeProblem
    coordinates: Coordinates
    z: FloatArray
    noise: FloatArray
    trace: Trace | None = None

    @classmethod
    def physics(cls, plain: Estimate, evidence: Evidence) -> _Candidate:
        values, network = plain.coordinates.values(plain.z), plain.findings.network
        assert network is not None
        step = plain.findings.method
        require_rational(evidence.model)
        problem = TimeProblem.build(
            evidence.records, evidence.model, step, evidence.quantity, values
        )
        return cls(problem, plain.coordinates, np.asarray(plain.z), network.noise)

    def args(self, lanes: np.ndarray) -> tuple[Any, ...]:
        """Arguments of the residual over the lanes chosen, shape (M,)."""
        whole, *others = self.problem.data
        data = (whole._replace(weight=whole.weight * lanes), *others)
        return (
            self.coordinates,
            self.problem.layout,
            data,
            jnp.asarray(self.problem.by_lane(self.noise)),
        )

    def normal(self, lanes: np.ndarray) -> Normal:
        """Normal equations at z over the lanes chosen."""
        return evaluate(jnp.asarray(self.z), *self.args(lanes))

    def residuals(self, lanes: np.ndarray) -> FloatArray:
        """Residual, zero outside the lanes chosen, shape (L, M); initial states and offsets are those of all lanes."""
        problem = self.problem
        left = np.asarray(problem.lanes.response) - np.asarray(
            self.normal(np.ones_like(lanes)).response
        )
        return left * np.asarray(problem.lanes.weight) * lanes

    def trained(self, lanes: np.ndarray, progress: Progress, tolerance: float = 0.1) -> _Candidate:
        """Trained on the lanes chosen, from z, noise refreshed between rounds; ``tolerance``: that of a trial."""
        now, beside = (
            self,
            (jnp.asarray(self.coordinates.first), jnp.asarray(_prior(self.coordinates))),
        )
        for _ in range(2):
            args = (now.args(lanes), *beside)
            trace = levenberg_marquardt(
                _penalised, now.z, args, tolerance=tolerance, most=30, progress=progress
            )
            now = replace(now, z=trace.last, trace=trace)
            now = replace(now, noise=_noise(now, lanes))
        return now


@dataclass(frozen=True, eq=False)
class _Judged:
    """A trained candidate, and what it takes and leaves of the held-out squared residual, over the physics' noise."""

    candidate: _Candidate
    gain: float
    left: float
    kept: bool
    shown: Mapping[str, Any]


def _penalised(z: Any, args: Any) -> Local:
    inner, centre, weight = args
    normal = evaluate(jnp.asarray(z), *inner)
    away = z - centre
    return Local(
        normal.matrix + jnp.diag(weight),
        normal.gradient - weight * away,
        normal.cost + jnp.sum(weight * away**2),
    )


def _prior(coordinates: Coordinates) -> FloatArray:
    """How strongly the residual's weights are drawn to where they begin; nothing for the physics."""
    return np.array([PRIOR.get(spec.name, np.inf) for spec in coordinates.model.parameters]) ** -2


def _held_out(problem: TimeProblem) -> np.ndarray | None:
    """Lanes to train on, shape (M,); the others are held out. None where there are too few.

    From six records on, every third is held out; of fewer, every other eighth of each.
    """
    lanes = problem.lanes
    segment = np.asarray(lanes.segment)
    real = segment < len(problem.record_of_segment)
    if len(problem.records) >= 6:
        train = problem.by_lane(np.arange(len(problem.records)) % 3 != 1).astype(bool)
    else:
        train = np.ones(segment.shape, dtype=bool)
        for number in range(len(problem.record_of_segment)):
            mine = np.flatnonzero(segment == number)
            size = max(1, len(mine) // 8)
            train[mine] = (np.arange(len(mine)) // size) % 2 == 0
    held = np.asarray(lanes.weight).reshape(-1, BLOCK, segment.size).sum(axis=1)[:, real & ~train]
    return train if np.sum(held > 0) >= FEWEST_BLOCKS and np.any(train & real) else None


def _noise(candidate: _Candidate, lanes: np.ndarray) -> FloatArray:
    """Noise of every record from the lanes chosen; of records without any, the mean of the others'."""
    problem = candidate.problem
    owners = problem.by_lane(np.arange(len(problem.records)), fill=-1).astype(int)
    squares = np.sum(candidate.residuals(lanes) ** 2, axis=0)
    counts = np.sum(np.asarray(problem.lanes.weight), axis=0) * lanes
    real = owners >= 0
    total = np.bincount(owners[real], weights=squares[real], minlength=len(problem.records))
    number = np.bincount(owners[real], weights=counts[real], minlength=len(problem.records))
    seen = number > 0
    size = np.array([float(np.std(r.response[r.mask])) for r in problem.records])
    relative = np.sqrt(np.sum(total[seen]) / np.sum((number * size**2)[seen]))
    own = np.sqrt(np.where(seen, total / np.maximum(number, 1.0), (relative * size) ** 2))
    return np.maximum(own, problem.noise_floor)


def _judged(
    structure: tuple[str, ...],
    physics: _Candidate,
    train: np.ndarray,
    before: FloatArray,
    progress: Progress,
) -> _Judged:
    """The best network of a structure, trained on ``train``, and its verdict on the rest."""
    try:
        best = _beginning(structure, physics, train).trained(train, progress)
    except NotConverged:
        return _Judged(physics, 0.0, np.inf, False, {"status": "not converged"})
    scale = best.problem.by_lane(best.noise)
    first, after = before / scale, best.residuals(~train) / scale
    gain, left = float(np.sum(first**2 - after**2)), float(np.sum(after**2))
    # Where the network has learned nothing but noise, its prediction moves by δ at random: Σ r δ has this deviation.
    products = np.sum((after * (first - after)).reshape(-1, BLOCK, scale.size), axis=1)
    deviation = 2.0 * float(np.sqrt(np.sum(products**2)))
    kept = gain > 0.05 * left and gain > 5.0 * deviation  # worthwhile, and significant
    shown = {
        "kept": bool(kept),
        "held_out_rmse_ratio": float(np.sqrt(max(left + gain, 0.0) / left)) if left > 0 else 1.0,
        "significance": gain / deviation if deviation > 0 else 0.0,
    }
    common = physics.problem.by_lane(physics.noise)
    remains = float(np.sum((best.residuals(~train) / common) ** 2))
    taken = float(np.sum((before / common) ** 2)) - remains
    return _Judged(best, taken, remains, kept, shown)


def _both_needed(single: list[_Judged]) -> bool:
    """Whether each part improves the fit, and the best one leaves a tenth or more of what each other one takes."""
    if not all(judged.kept for judged in single):
        return False
    best = min(single, key=lambda judged: judged.left)
    return all(best.left > 0.1 * judged.gain for judged in single if judged is not best)


def _beginning(structure: tuple[str, ...], physics: _Candidate, train: np.ndarray) -> _Candidate:
    """A network that does nothing yet, with its recurrent neurons where the physics' residual asks for them most."""
    if "memory" not in structure:
        return _beside(structure, physics, {})
    low, high = physics.coordinates.band_hz.tolist()
    highest = min(
        3.0 * high, 0.4 * max(record.sampling_rate_hz for record in physics.problem.records)
    )
    frequencies = np.geomspace(low, highest, max(2, int(np.log10(highest / low) * 24)))
    scored = []
    base = _beside(("memory",), physics, {"memory_frequency": high, "memory_damping": 0.1})
    names = base.coordinates.model.parameter_names
    for damping in (0.03, 0.2):
        for frequency in frequencies:
            z = np.array(base.z)
            z[names.index("memory_frequency")] = np.log(frequency / high)
            z[names.index("memory_damping")] = np.arcsinh(damping)
            normal = replace(base, z=z).normal(train)
            scored.append(
                (_gain(np.asarray(normal.matrix), np.asarray(normal.gradient)), frequency, damping)
            )
    _, frequency, damping = max(scored)
    return _beside(
        structure, physics, {"memory_frequency": float(frequency), "memory_damping": damping}
    )


def _gain(matrix: FloatArray, gradient: FloatArray) -> float:
    """Fall of the cost that a full step promises, physics free to follow: what it leaves counts, and that alone."""
    moved = np.diag(matrix) > 0
    scale = np.sqrt(np.diag(matrix)[moved])
    values, vectors = np.linalg.eigh(matrix[np.ix_(moved, moved)] / scale[:, None] / scale)
    pull = vectors.T @ (gradient[moved] / scale)
    return float(np.sum(pull[values > 1e-9] ** 2 / values[values > 1e-9]))


def _beside(
    structure: tuple[str, ...], physics: _Candidate, memory: Mapping[str, float]
) -> _Candidate:
    """The physics as trained, with a network beside it that does nothing yet."""
    problem, old, frame = physics.problem, physics.coordinates, physics.problem.frame
    model, size = with_residual(frame.model, structure), float(old.response_size)
    start = dict(zip(old.model.parameter_names, np.asarray(old.start).tolist(), strict=True))
    start |= initial_weights(structure, size, memory)
    values = {**start, **old.values(physics.z)}
    built = TimeProblem.build(problem.records, model, frame.method, frame.quantity, values)
    coordinates = Coordinates.at(model, start, old.band_hz, size)
    z = np.concatenate([physics.z, coordinates.first[len(physics.z) :]])
    return _Candidate(built, coordinates, z, physics.noise)


def _without(plain: Estimate, reason: str, tried: Mapping[str, Any]) -> Estimate:
    """The physics alone, untouched."""
    learned = LearnedShare(False, 0.0, tried, {"reason": reason})
    return replace(plain, findings=replace(plain.findings, learned=learned))


def _with(
    plain: Estimate,
    physics: TimeProblem,
    structure: tuple[str, ...],
    whole: _Candidate,
    tried: Mapping[str, Any],
) -> Estimate:
    """The estimate with the network beside the physics, and what each says of every record.

    What is left to be explained, of the records less what was learned, is that of both.
    """
    assert plain.problem is not None
    count, records = len(plain.z), whole.problem.records
    normal = whole.normal(np.ones(whole.problem.lanes.segment.shape, dtype=bool))
    lines = whole.problem.lines(whole.z, whole.coordinates, whole.noise)
    covariance, freedom = hac_covariance(
        lines, whole.problem.degrees_of_freedom, np.diag(_prior(whole.coordinates))
    )
    z = np.asarray(whole.z)[:count]
    predicted = tuple(whole.problem.by_record(normal.response))
    alone = physics.predict(plain.coordinates, z)
    added = [both - one for both, one in zip(predicted, alone, strict=True)]
    shares = [_share(part, both) for part, both in zip(added, predicted, strict=True)]
    about = {
        "structure": list(structure),
        "weights": {n: v for n, v in whole.coordinates.values(whole.z).items() if n in PRIOR},
        "share_by_record": dict(zip([record.name for record in records], shares, strict=True)),
        "rmse": _rms([r.response - p for r, p in zip(records, predicted, strict=True)]),
        "rmse_of_physics_alone": _rms(
            [r.response - p for r, p in zip(records, plain.predicted or (), strict=True)]
        ),
    }
    share = _share(np.concatenate(added), np.concatenate(predicted))
    network, trace = plain.findings.network, whole.trace
    assert trace is not None
    assert network is not None
    left = tuple(
        replace(r, response=r.response - np.nan_to_num(a))
        for r, a in zip(records, added, strict=True)
    )
    # What of the misfit looked like noise of the reference has been learned since: none of the plain fit's is stated.
    findings = Findings(
        replace(network, noise=whole.noise, weights=""),
        learned=LearnedShare(True, share, tried, about),
    )
    problem, in_noise = plain.problem.of_frame(left, plain.problem.frame), plain.in_noise
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


def _share(added: FloatArray, both: FloatArray) -> float:
    """Rms of what the network adds, over that of the whole."""
    size = float(np.nanstd(both)) if np.isfinite(both).any() else 0.0
    return _rms([added]) / size if size > 0 else 0.0


def _rms(residuals: list[FloatArray]) -> float:
    joined = np.concatenate(residuals)
    return float(np.sqrt(np.nanmean(joined**2)))


def saved_model(
    model: SensorModel, settings: Mapping[str, Any]
) -> tuple[SensorModel, dict[str, float]]:
    """The model with the residual network that a result holds, and its weights; the model itself without one."""
    found = settings.get("residual_network") or {}
    if not found.get("kept"):
        return model, {}
    return with_residual(model, tuple(found["structure"])), {
        n: float(v) for n, v in found["weights"].items()
    }
