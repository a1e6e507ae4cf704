"""Levenberg–Marquardt for many least-squares problems of equal shape: one compiled program.

The steps are those of :func:`vibrident.estimators.optimise.levenberg_marquardt`, decision by decision. All problems
take a step at the same time; one that has ended is masked until the last has. So the numbers are the same to rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from vibrident.backend import arithmetic_error, jax, jnp, lax
from vibrident.batched.normal import Local, line_data, line_normal, tone_normal
from vibrident.errors import InputError, NotConverged
from vibrident.estimators.optimise import (
    AS_FORESEEN,
    ENOUGH,
    FIRST_DAMPING,
    LEAST_SHOWN,
    LESS,
    MORE,
    MOST_REJECTED,
    NOT_FINITE,
    Trace,
)
from vibrident.problem import Coordinates, FrequencyProblem, LineProblem
from vibrident.records import FloatArray

#: Largest relative error of a device's arithmetic, in the computation that faulty releases of JAX get wrong.
MOST_ERROR = 1e-12


@dataclass(frozen=True, eq=False)
class Descent:
    """A descent to be made.

    Attributes:
        shape: equal for descents that one program makes.
        data: arrays, by whose shapes too programs differ.
        start: coordinates, shape (p,).
    """

    shape: Hashable
    data: Any
    start: FloatArray

    @classmethod
    def of(
        cls,
        problem: FrequencyProblem | LineProblem,
        coordinates: Coordinates,
        noise: FloatArray | None,
        start: FloatArray,
        tolerance: float,
        most: int,
    ) -> Descent:
        """From a problem; ``noise``: standard deviation of each record, of a problem of lines."""
        around = (coordinates.start, coordinates.band_hz, coordinates.response_size)
        if isinstance(problem, FrequencyProblem):
            kind: tuple[Hashable, ...] = ("tones", problem.polar, problem.has_phase, problem.quantity)
            data: tuple[Any, ...] = (around, problem.data)
        else:
            assert noise is not None
            trained = problem.trained
            kind = ("lines", trained.method.name, trained.terms, trained.quantity)
            data = (around, line_data(problem, noise))
        data = jax.tree_util.tree_map(np.asarray, data)
        sizes = tuple(leaf.shape for leaf in jax.tree_util.tree_leaves(data))
        return cls((kind, coordinates.model, tolerance, most, sizes), data, np.asarray(start, dtype=float))


def gpu() -> Any:
    """The first GPU that JAX finds.

    Raises:
        InputError: there is none, or its arithmetic is wrong.
    """
    try:
        device = jax.devices("gpu")[0]
    except RuntimeError:
        raise InputError(
            "No GPU is here.",
            expected="a GPU that JAX can use",
            found=f"JAX {jax.__version__} with {', '.join(str(one) for one in jax.devices())}",
            where="device 'gpu'",
            remedy=f"pip install 'jax[cuda12]=={jax.__version__}' on a machine with an NVIDIA GPU, or leave the device "
            "out: the processor gives the same numbers",
        ) from None
    with jax.default_device(device):
        error = arithmetic_error()
    if error < MOST_ERROR:
        return device
    raise InputError(
        "This GPU computes wrong numbers.",
        expected=f"sums of matrix products right to {MOST_ERROR:g}",
        found=f"a relative error of {error:g}",
        where=str(device),
        remedy="leave the device out: the processor gives right numbers; update driver and JAX",
    )


def descend(descents: Sequence[Descent], device: Any) -> list[Trace]:
    """Make descents of equal shape on a device; their courses, in order.

    Raises:
        NotConverged: a cost is not finite at its start.
    """
    count = len(descents)
    padded = [*descents, *[descents[0]] * ((1 << (count - 1).bit_length()) - count)]  # few sizes: few programs
    data = jax.tree_util.tree_map(lambda *leaves: np.stack(leaves), *(one.data for one in padded))
    start = np.stack([one.start for one in padded])
    (kind, model, tolerance, most, _) = descents[0].shape  # type: ignore[misc]
    with jax.default_device(device):
        way = _program(kind, model, tolerance, most)(*jax.device_put((start, data), device))
    way = jax.tree_util.tree_map(np.asarray, way)
    return [_trace(jax.tree_util.tree_map(lambda leaf, i=i: leaf[i], way), most) for i in range(count)]


def _trace(way: _Way, most: int) -> Trace:
    if not np.isfinite(way.costs[0]):
        raise NotConverged(NOT_FINITE)
    kept = way.accepted
    status = "converged" if way.ended else f"stopped after {most} evaluations"
    costs = tuple(way.costs[kept].tolist())
    return Trace("levenberg-marquardt", bool(way.ended), status, costs, way.path[kept])


class _Point(NamedTuple):
    """Coordinates, and the problem there."""

    z: Any
    here: Local


class _Way(NamedTuple):
    """The course of a descent: whether it has ended, and each iterate, accepted or not."""

    ended: Any
    accepted: Any
    costs: Any
    path: Any


@lru_cache(maxsize=64)
def _program(kind: tuple[Any, ...], model: Any, tolerance: float, most: int) -> Callable[[Any, Any], _Way]:
    normal = tone_normal(model, *kind[1:]) if kind[0] == "tones" else line_normal(model, *kind[1:])

    def one(z: Any, data: Any) -> Any:
        found = normal(z, data)
        finite = jnp.all(jnp.isfinite(found.matrix)) & jnp.all(jnp.isfinite(found.gradient))
        return _Point(z, found._replace(cost=jnp.where(finite, found.cost, jnp.inf)))

    many = jax.vmap(one)

    def run(start: Any, data: Any) -> _Way:
        return _run(lambda z: many(z, data), start, tolerance, most)

    return jax.jit(run)


def _run(at: Callable[[Any], _Point], start: Any, tolerance: float, most: int) -> _Way:
    """All descents from their starts, shape (B, p)."""
    count, p = start.shape

    def ended(point: _Point, rejected: Any) -> Any:
        gain = jax.vmap(lambda one: _step(one, 0.0) @ one.gradient)(point.here)
        return (gain < jnp.maximum(tolerance, 1e-15 * point.here.cost)) | (rejected > MOST_REJECTED)

    def body(state: Any) -> Any:
        number, point, damping, rejected, way = state
        active = ~way.ended
        step = jax.vmap(_step)(point.here, damping)
        trial = at(point.z + step)
        gained = jax.vmap(_gained)(point.here, trial.here, step)
        begins = number == 0
        better = active & (begins | (gained >= ENOUGH))
        point = jax.tree_util.tree_map(lambda new, old: _where(better, new, old), trial, point)
        factor = jnp.where(gained > AS_FORESEEN, LESS, jnp.where(gained >= ENOUGH, 1.0, MORE))
        damping = jnp.where(active & ~begins, damping * factor, damping)
        rejected = jnp.where(better, 0, rejected + active)
        way = _Way(
            ended(point, rejected) | ~jnp.isfinite(point.here.cost),
            way.accepted.at[:, number].set(better),
            way.costs.at[:, number].set(point.here.cost),
            way.path.at[:, number].set(point.z),
        )
        return number + 1, point, damping, rejected, way

    none = jnp.zeros(count, dtype=bool)
    # The first step, from a problem without slopes, is none: it evaluates the start, in the same lines as all others.
    first = _Point(start, Local(jnp.zeros((count, p, p)), jnp.zeros((count, p)), jnp.full(count, jnp.inf)))
    way = _Way(none, jnp.zeros((count, most), bool), jnp.zeros((count, most)), jnp.zeros((count, most, p)))
    begin = (0, first, jnp.full(count, FIRST_DAMPING), none.astype(int), way)
    return lax.while_loop(lambda state: (state[0] < most) & jnp.any(~state[4].ended), body, begin)[4]


def _where(condition: Any, new: Any, old: Any) -> Any:
    return jnp.where(condition.reshape(condition.shape + (1,) * (new.ndim - 1)), new, old)


def _gained(here: Local, there: Local, step: Any) -> Any:
    """Gain of a step over that of the linear residual."""
    gained = (here.cost - there.cost) / (2.0 * step @ here.gradient - step @ here.matrix @ step)
    return jnp.where(jnp.isfinite(gained), gained, -jnp.inf)


def _step(here: Local, damping: Any) -> Any:
    """Gauss–Newton step, damped; zero along directions without influence on the residual."""
    matrix = here.matrix + damping * jnp.eye(here.gradient.shape[0])
    shown = jnp.diag(matrix)
    size = jnp.sqrt(jnp.where(shown > 0.0, shown, jnp.inf))
    values, vectors = jnp.linalg.eigh(matrix / size[:, None] / size)
    inverse = jnp.where(values > LEAST_SHOWN, 1.0 / values, 0.0)
    return (vectors * inverse) @ (vectors.T @ (here.gradient / size)) / size
