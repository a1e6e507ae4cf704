"""The response of a linear sensor's network in time, in NumPy: what records foretell once the parameters are known.

What belongs to a record and not to the sensor, the initial state and the offset of each unbroken run, is fitted to the
run's own response by least squares. Long records are taken in blocks, whose inputs are made when needed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from vibrident.discretize import Method, Weights
from vibrident.discretize.unrolled import free_rows, respond
from vibrident.errors import InputError, ModelError
from vibrident.information import inverse_where_known
from vibrident.lines import Trained, seen_by_network, unbroken
from vibrident.models import SensorModel
from vibrident.records import BoolArray, FloatArray, Quantity, Record

#: Steps a block, and samples beyond either end of it that its inputs may need.
BLOCK, MARGIN = 1 << 16, 256
#: Rounds in which what the normal equations lost in rounding is fitted again.
ROUNDS = 2


def trained_network(
    model: SensorModel, method: Method, quantity: Quantity, values: Mapping[str, float], intervals_s: Sequence[float]
) -> Trained:
    """The network of a linear sensor near these values, at these sampling intervals.

    Raises:
        ModelError: the model is no rational function.
    """
    if not model.has_network:
        raise ModelError(
            "This model has no network: it is not a rational function.",
            expected="a model without 'boxcar'",
            found=repr(model.name),
            where="estimator 'ipnn'",
            remedy="use the estimator 'ml', with sine records or a table",
        )
    system, damping = model.rational(values, quantity), values["damping_ratio"]
    pole = damping + np.sqrt(damping * damping - 1.0) if damping > 1.0 else 1.0
    direct = len(system.numerator) >= len(system.denominator)  # the response then contains the reference itself
    fastest = 2.0 * np.pi * values["natural_frequency"] * pole
    return Trained(model, method, quantity, max(method.terms(fastest * ts, direct=direct) for ts in intervals_s))


def response_in_time(
    records: Sequence[Record], model: SensorModel, method: Method, quantity: Quantity, values: Mapping[str, float]
) -> tuple[FloatArray, ...]:
    """Response of every record, shape (samples,) each, NaN where the network gives none.

    Args:
        records: at least one; one without reference is a free decay, its input is zero.
        model: the sensor model, linear.
        method: the discretisation.
        quantity: what the reference is.
        values: of the parameters.

    Raises:
        InputError: no record is long enough.
        ModelError: the model has no network.
    """
    trained = trained_network(model, method, quantity, values, sorted({r.sampling_interval_s for r in records}))
    found = tuple(np.full(record.samples, np.nan) for record in records)
    delay = float(model.delay_s(values)) if model.has_delay else 0.0
    known: dict[tuple[float, float], Weights] = {}
    for record, series in zip(records, found, strict=True):
        reference, valid = seen_by_network(record, centred=True)
        late = delay * record.sampling_rate_hz
        step = method.filters(valid, trained.terms, late)
        at = (record.sampling_interval_s, float(step.fraction))
        weights = known.setdefault(at, trained.weights(dict(values), *at, delay))
        for run in unbroken(step.usable):
            if np.sum(record.mask[run]) > _fewest(trained):
                series[run] = _of_run(record, run, weights, _blocks(reference, valid, run, trained, late))
    if not any(np.isfinite(series).any() for series in found):
        raise InputError(
            "No record is long enough for the network.",
            expected=f"more than {_fewest(trained)} samples that can be used after interpolation",
            found=f"{max(r.samples for r in records)} samples in the longest record",
            where="records",
            remedy="use longer records, or the estimator 'ml'",
        )
    return found


def _fewest(trained: Trained) -> int:
    return 2 * (trained.order + 1)


def _blocks(
    reference: FloatArray, valid: BoolArray, run: slice, trained: Trained, late: float
) -> Iterator[tuple[slice, FloatArray]]:
    """Parts of a run, and the inputs of their steps, shape (steps, q)."""
    margin = MARGIN + int(np.ceil(abs(late)))
    for start in range(run.start, run.stop, BLOCK):
        part = slice(start, min(start + BLOCK, run.stop))
        around = slice(max(start - margin, 0), part.stop + margin)
        if len(reference) <= BLOCK:
            around = slice(0, None)
        made = trained.method.inputs(reference[around], valid[around], trained.terms, late)
        yield part, made.coefficients[start - around.start :][: part.stop - start]


def _of_run(record: Record, run: slice, weights: Weights, blocks: Iterator[tuple[slice, FloatArray]]) -> FloatArray:
    """The response over a run: from rest, and what the best initial state and offset add."""
    order, measured, used = len(weights.output), record.response[run], record.mask[run]
    found, state = np.empty(len(measured)), np.zeros(order)
    for part, inputs in blocks:
        found[part.start - run.start : part.stop - run.start], state = respond(weights, inputs, state)
    gram = np.zeros((order + 1, order + 1))
    for part, columns in _free(weights, len(found)):
        gram += columns.T @ (columns * used[part, None])
    inverse = inverse_where_known(gram)
    for _ in range(ROUNDS):
        moments = np.zeros(order + 1)
        for part, columns in _free(weights, len(found)):
            moments += columns.T @ np.where(used[part], measured[part] - found[part], 0.0)
        for part, columns in _free(weights, len(found)):
            found[part] += columns @ (inverse @ moments)
    return found


def _free(weights: Weights, steps: int) -> Iterator[tuple[slice, FloatArray]]:
    """What an initial state and an offset add to the response, shape (steps, n + 1), block by block."""
    rows, power = free_rows(weights, min(steps, BLOCK))
    carry = np.eye(len(weights.output))
    for begin in range(0, steps, BLOCK):
        own = rows[: steps - begin] @ carry
        yield slice(begin, begin + len(own)), np.concatenate([own, np.ones((len(own), 1))], axis=1)
        carry = power @ carry
