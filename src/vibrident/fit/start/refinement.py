"""Descent of start values at the coarse bins, by few evaluations of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from vibrident.base.errors import NotConverged
from vibrident.data.records import FloatArray
from vibrident.fit.group.network import Step, evaluate, products
from vibrident.fit.optimise import levenberg_marquardt
from vibrident.fit.problem.band import Band
from vibrident.fit.problem.coordinates import Coordinates
from vibrident.fit.problem.frequency_domain import Local
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.start.coarse import CoarseRows
from vibrident.fit.start.grid_search import StartCandidate

#: Decrease of the cost that is not worth a step.
TOLERANCE = 0.5
MAX_EVALUATIONS = 15


def refined(
    band: Band,
    band_hz: tuple[float, float],
    rows: Sequence[CoarseRows],
    front: Sequence[StartCandidate],
) -> list[StartCandidate]:
    """Return where candidates descend to at the coarse bins, the best first.

    Args:
        band: the network.
        band_hz: lowest and highest frequency of the motion.
        rows: the coarse bins.
        front: the candidates.
    """
    ends = [_descended(band, band_hz, rows, candidate) for candidate in front]
    return sorted(ends, key=lambda candidate: candidate.cost)


def _descended(
    band: Band, band_hz: tuple[float, float], rows: Sequence[CoarseRows], candidate: StartCandidate
) -> StartCandidate:
    """Return where a candidate descends to, with the response turned by its delay."""
    model = band.model
    delay_s = float(band.problem.frame.delay_s)
    times = [spec.name for spec in model.parameters if spec.kind == "time"]
    excess_s = sum(candidate.values[name] for name in times) - (delay_s if times else 0.0)
    start = candidate.values | dict.fromkeys(times, delay_s)
    coordinates = Coordinates.at(model, start, band_hz)
    turned = [
        replace(
            coarse,
            bins=replace(
                coarse.bins,
                response=coarse.bins.response * np.exp(2j * np.pi * excess_s * coarse.frequency_hz),
            ),
        )
        for coarse in rows
    ]

    def objective(z: FloatArray, _: None) -> Local:
        return _local(band, turned, coordinates, z)

    try:
        trace = levenberg_marquardt(
            objective, coordinates.first, None, tolerance=TOLERANCE, max_evaluations=MAX_EVALUATIONS
        )
    except (NotConverged, np.linalg.LinAlgError):
        return candidate
    values = coordinates.values(trace.last)
    return StartCandidate(
        trace.costs[-1], values | {name: values[name] + excess_s for name in times}
    )


def _local(
    band: Band, all_rows: Sequence[CoarseRows], coordinates: Coordinates, z: FloatArray
) -> Local:
    """Return the weighted sum of squares at the coarse bins, its gradient and matrix."""
    values = coordinates.values(z)
    slopes = coordinates.slopes(z)[:, None]
    delay_s = band.problem.frame.delay_s
    factor_values = {name: values[name] for name in band.model.factor_names}
    trained = replace(band.problem.trained, factor_values=factor_values)
    matrix = np.zeros((len(z), len(z)))
    gradient = np.zeros(len(z))
    cost = 0.0
    with np.errstate(all="ignore"):
        for coarse in all_rows:
            rows = _with_factors(band, coarse, values)
            step = Step(*trained.with_slopes(values, *rows.bins.step, delay_s))
            if not np.all(np.isfinite(step.transfer.denominator)):
                return Local(matrix, gradient, np.inf)
            evaluated = evaluate(rows.bins, step, rows.weight)
            root = np.sqrt(rows.weight)[:, None]
            jacobian = (evaluated.jacobian * slopes * root).swapaxes(0, 1).reshape(len(z), -1)
            residual = (evaluated.residual[:, None] * root).reshape(1, -1)
            matrix += products(jacobian, jacobian)
            gradient += products(jacobian, residual)[:, 0]
            cost += float(products(residual, residual)[0, 0])
    return Local(matrix, gradient, cost)


def _with_factors(band: Band, rows: CoarseRows, values: Mapping[str, float]) -> CoarseRows:
    """Return rows with inputs filtered by the factors of ``values``, as if the motion recurred."""
    frame = band.problem.frame
    if not frame.factor_values:
        return rows
    unfiltered = rows.bins.inputs[:, : frame.terms]
    factors = _relative_factors(band, rows, values)
    inputs = np.concatenate([unfiltered * factor[:, None] for factor in factors], axis=1)
    return replace(rows, bins=replace(rows.bins, inputs=inputs))


def _relative_factors(
    band: Band, rows: CoarseRows, values: Mapping[str, float]
) -> list[ComplexArray]:
    """Return factors and their slopes over the factors of the inputs, shape (R, K) each."""
    frame = band.problem.frame
    inverse = 1.0 / frame.model.factors(frame.factor_values, rows.frequency_hz)
    slopes = frame.model.factor_slopes(values, rows.frequency_hz)
    factors = [frame.model.factors(values, rows.frequency_hz)]
    factors += [slopes[name] for name in frame.factor_values]
    return [inverse * factor for factor in factors]
