"""The uncertainty budget: what each systematic contribution does to each parameter (GUM 5.1, type B).

A contribution changes the measured response by a known pattern over frequency, with one unknown factor:

| kind | change of log H for one unit | standard uncertainty |
|---|---|---|
| gain | 1 | relative (voltmeter, amplifier, reference) |
| timing | −2πjf | s (skew between the channels) |
| phase | −j | rad |
| mounting | (f/f₀)² | relative, at f₀ = ``frequency_hz`` (a stiff mount well below its resonance) |
| clock | −f ∂ log H/∂f | relative (sampling rate) |
| ellipse, cyclic | tabulated by the interferometer's signals | relative |
| gain, phase with a table or a band | tabulated by the calibration file | relative, rad: the largest |
| rounding | tabulated by the records and their converters' steps | relative |

The fit answers to it as to any other deviation: dz = (AᵀA)⁻¹ Aᵀ b. It is common to all points, so more data do not
reduce it.

Effects also explain deviations. Along the pattern d_k(f) of each acts one unknown factor a_k, whose prior is N(0, 1)
in units of its standard uncertainty. The deviations from the right model then have the covariance
Σ = Σ_noise + Σ_k d_k d_kᵀ, and the test of adequacy is the χ² in that metric. It is computed as the least sum of the
squares of the weighted deviations and of the a_k, over the parameters and the a_k (the two are the same, Woodbury),
with the model as it is, so that an effect may be large beside the noise. A pattern that the parameters can follow
explains nothing, and nothing changes. The a_k are judged by themselves too, as many points would hide one of six: with
S = DᵀD of the part of the patterns that no parameter follows, the covariance of the estimated a_k is S(1 + S)⁻¹.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import Calibration, FloatArray, Quantity, SystematicEffect
from vibrident.fit.problem import Coordinates
from vibrident.fit.response.verdict import probability
from vibrident.fit.uncertainty.linearised import Linearised, log_slopes
from vibrident.fit.uncertainty.parameters import deviations, reference_direction
from vibrident.result import MeasuredCurve

DATA = "data"  # kind of a row of type A
Weighted = Callable[
    [FloatArray, np.ndarray], FloatArray
]  # of z and a change of log H at each point


@dataclass(frozen=True, eq=False)
class BudgetRow:
    """A row of the budget."""

    source: str  # of the contribution
    kind: str  # as in the module's table; ``data`` for the type A part
    standard_uncertainty: float | None  # of the effect, in ``unit``; None for the type A part
    unit: str  # of that
    degrees_of_freedom: float  # behind it; infinite where it is taken as known
    covariance: FloatArray  # what it adds to the covariance of z, shape (p, p)


def rows_of_effects(effects: Sequence[SystematicEffect], linear: Linearised) -> list[BudgetRow]:
    """A row for each systematic effect, as the fit, linearised at the estimate, answers to it."""
    rows: list[BudgetRow] = []
    for effect in effects:
        shift = shift_of_effect(effect, linear)
        row = row_of_effect(effect, np.outer(shift, shift))
        if (
            rows
            and effect.pattern
            and (rows[-1].source, rows[-1].kind) == (effect.source, effect.kind)
        ):
            before = rows.pop()  # parts of one source
            sizes = before.standard_uncertainty or 0.0, effect.standard_uncertainty
            u = float(
                np.hypot(*sizes) if effect.kind == "rounding" else max(sizes)
            )  # of the bands of a source
            row = replace(
                row, standard_uncertainty=u, covariance=before.covariance + row.covariance
            )
        rows.append(row)
    return rows


def row_of_effect(effect: SystematicEffect, covariance: FloatArray) -> BudgetRow:
    """The row of an effect that adds ``covariance``, shape (p, p)."""
    freedom = effect.degrees_of_freedom
    return BudgetRow(
        effect.source, effect.kind, effect.standard_uncertainty, effect.unit, freedom, covariance
    )


def shift_of_effect(effect: SystematicEffect, linear: Linearised) -> FloatArray:
    """What one standard uncertainty of the effect does to z, shape (p,)."""
    u = effect.standard_uncertainty
    if (
        effect.kind == "gain" and not effect.pattern
    ):  # exact, even if the data do not determine the other parameters
        return reference_direction(linear.z, linear.coordinates.model, u)
    if (
        not linear.matrix.size
    ):  # free decays: all frequencies scale with the clock, and nothing else reaches them
        specs = linear.coordinates.model.parameters
        return np.array(
            [u if effect.kind == "clock" and spec.kind == "log" else 0.0 for spec in specs]
        )
    change = pattern(effect, linear, linear.frequency_hz)
    part = np.where(linear.is_phase, np.imag(change), np.real(change))
    return u * linear.shift(part * linear.weight)


def pattern(
    effect: SystematicEffect, linear: Linearised | Place | None, frequency: FloatArray
) -> NDArray[Any]:
    """Change of log H for one unit of the effect, complex, shape (m,); ``linear`` is for a clock alone."""
    if effect.pattern:
        at, real, imaginary = np.array(effect.pattern).T
        return np.interp(frequency, at, real) + 1j * np.interp(frequency, at, imaginary)
    if effect.kind == "gain":
        return np.ones(len(frequency), dtype=complex)
    if effect.kind == "timing":
        return -2j * np.pi * frequency
    if effect.kind == "phase":
        return np.full(len(frequency), -1j)
    if effect.kind == "mounting":
        return (frequency / float(effect.frequency_hz or 1.0)) ** 2 + 0j
    assert linear is not None
    sensor = linear.coordinates, linear.z, linear.quantity
    step = 1e-5  # relative, of the central difference
    ahead, _ = log_slopes(*sensor, frequency * (1.0 + step))
    behind, _ = log_slopes(*sensor, frequency * (1.0 - step))
    return -np.log(ahead / behind) / (2.0 * step)


def effective_degrees_of_freedom(rows: Sequence[BudgetRow]) -> FloatArray:
    """Of each coordinate, by the Welch–Satterthwaite formula (GUM G.4.1), shape (p,)."""
    variances = np.stack([np.diag(row.covariance) for row in rows])
    shares = variances / np.maximum(np.sum(variances, axis=0), 1e-300)
    freedom = np.array([row.degrees_of_freedom for row in rows])
    divided = np.sum(shares**2 / freedom[:, None], axis=0)
    return np.where(divided > 0, 1.0 / np.maximum(divided, 1e-300), np.inf)


def effects_of(calibration: Calibration) -> list[SystematicEffect]:
    """The systematic effects stated, the calibration of the reference first."""
    relative = calibration.reference_standard_uncertainty
    reference = (
        [SystematicEffect("calibration of the reference", "gain", relative)] if relative > 0 else []
    )
    return [*reference, *calibration.effects]


def covered_kinds(kinds: set[str]) -> list[str]:
    """Return which of ``noise``, ``gain`` and ``phase`` rows of these kinds cover."""
    parts = {"noise": {DATA}, "gain": {"gain"}, "phase": {"phase", "timing"}}
    return [name for name, covering in parts.items() if kinds & covering]


def as_settings(
    rows: Sequence[BudgetRow], names: Sequence[str], slopes: FloatArray
) -> list[dict[str, Any]]:
    """The budget as plain values: the contribution of each row to each parameter's standard uncertainty, in its unit.

    ``rows``: the budget; ``slopes``: ∂parameter/∂z, shape (p,).
    """
    return [
        {
            "source": row.source,
            "type": "A" if row.kind == DATA else "B",
            "kind": row.kind,
            "standard_uncertainty": row.standard_uncertainty,
            "unit": row.unit,
            "degrees_of_freedom": row.degrees_of_freedom
            if np.isfinite(row.degrees_of_freedom)
            else None,
            "contributions": dict(
                zip(names, (deviations(row.covariance) * np.abs(slopes)).tolist(), strict=True)
            ),
        }
        for row in rows
    ]


@dataclass(frozen=True, eq=False)
class Explained:
    """What effects explain."""

    amounts: FloatArray  # a_k of each effect, in its standard uncertainties, shape (K,)
    left: FloatArray  # weighted deviations beside them
    chi2: float  # what is left of Σ squares, the a_k counted in
    probability: float  # of a_k at least as large


class Place(NamedTuple):
    """Where a fit stands: its coordinates, their values, shape (p,), and the quantity of the reference."""

    coordinates: Coordinates
    z: FloatArray
    quantity: Quantity


def patterns(
    effects: Sequence[SystematicEffect], linear: Linearised | Place, frequency_hz: FloatArray
) -> np.ndarray:
    """Change of log H by one standard uncertainty of each effect, complex, shape (n, K)."""
    columns = [e.standard_uncertainty * pattern(e, linear, frequency_hz) for e in effects]
    return np.stack(columns, axis=1) if columns else np.zeros((len(frequency_hz), 0), complex)


def explain(
    weighted: Weighted,
    effects: Sequence[SystematicEffect],
    shape: np.ndarray,
    linear: Linearised,
    covariance: FloatArray,
) -> Explained | None:
    """Fit the effects beside the parameters; None where that leads to another optimum than the estimate.

    ``weighted``: the deviations over their noise; ``effects``: K of them; ``shape``: their patterns at the points,
    shape (n, K); ``linear``: the fit, linearised at the estimate; ``covariance``: of the estimate, by noise, shape (p,
    p).
    """
    from scipy.optimize import least_squares  # slow to load

    z = linear.z
    p = len(linear.z)

    def residual(x: FloatArray) -> FloatArray:
        return np.concatenate([weighted(z + x[:p], shape @ x[p:]), x[p:]])

    with np.errstate(all="ignore"):
        found = least_squares(
            residual, np.zeros(p + shape.shape[1]), jac="3-point", max_nfev=60, xtol=1e-10
        )
    shift = found.x[:p]
    amounts = found.x[p:]
    moved = np.stack([shift_of_effect(e, linear) for e in effects], axis=1)
    moved = moved * np.maximum(np.abs(amounts), 1.0)
    # Beyond five standard deviations is another optimum.
    allowed = 5.0 * np.sqrt(np.maximum(np.diag(covariance), 0.0) + np.sum(moved**2, axis=1)) + 1e-9
    if not np.all(np.isfinite(found.x)) or np.any(np.abs(shift) > allowed):
        return None
    jacobian = found.jac[: -shape.shape[1]]
    stated = np.array(
        [effect.kind != "rounding" for effect in effects]
    )  # of the others the size is no claim
    beside = np.concatenate([np.ones(p, dtype=bool), ~stated])
    chance = _chance(amounts[stated], jacobian[:, beside], jacobian[:, ~beside])
    return Explained(amounts, found.fun[: -len(amounts)], float(2.0 * found.cost), chance)


def _chance(amounts: FloatArray, slopes: FloatArray, effects: FloatArray) -> float:
    """Probability of a_k at least as large where the stated uncertainties are right."""
    basis = _basis(slopes)
    free = effects - basis @ (basis.T @ effects)
    values, vectors = np.linalg.eigh(free.T @ free)
    seen = values > 1e-3  # the part by which the data reduce the prior variance of a_k
    chi2 = float(np.sum((vectors.T @ amounts)[seen] ** 2 * (1.0 + values[seen]) / values[seen]))
    return probability(chi2, int(seen.sum()))


def _basis(matrix: FloatArray) -> FloatArray:
    """Orthonormal basis of the columns of a matrix."""
    left, size, _ = np.linalg.svd(matrix, full_matrices=False)
    return left[:, size > 1e-9 * max(float(size.max(initial=0.0)), 1e-300)]


def deviation_uncertainty(
    linear: Linearised, shape: np.ndarray, scatter: float = 1.0
) -> FloatArray:
    """Standard uncertainty of the deviation between the points and a model that was fitted to them.

    The model follows the points: noise by the leverage of each, and of an effect all that its parameters can imitate.
    What it does not follow is left: (1 − h) of the noise's variance, and the rest of each pattern.

    ``linear``: m rows, magnitudes first, phases (if any) after them; ``shape``: patterns of the effects at the n
    points, shape (n, K); ``scatter``: standard deviation of the noise in units of the rows' weights.

    Returns:
        Of log H, shape (m,): relative for magnitudes, rad for phases; NaN for a point that any value would fit.
    """
    repeats = len(linear.frequency_hz) // max(len(shape), 1)
    rows = np.tile(shape, (repeats, 1))
    part = np.where(linear.is_phase[:, None], np.imag(rows), np.real(rows)) * linear.weight[:, None]
    basis = _basis(linear.matrix)
    noise = 1.0 - np.sum(basis**2, axis=1)
    effect = np.sum((part - basis @ (basis.T @ part)) ** 2, axis=1)
    variance = np.where(noise > 1e-6, scatter**2 * noise + effect, np.nan)
    return np.sqrt(variance) / linear.weight


def point_budget(
    measured: MeasuredCurve, effects: Sequence[SystematicEffect], linear: Linearised
) -> dict[str, Any] | None:
    """Standard uncertainties by source at each point, evenly spread over 200 of more; None without effects.

    Returns:
        ``frequency_hz`` and, by source, ``magnitude`` (in the unit of the magnitude) and ``phase_deg`` of ``sources``,
        whose root sum of squares is the uncertainty of the point before any floor.
    """
    if not effects or not len(measured.frequency_hz):
        return None
    total = len(measured.frequency_hz)
    chosen = np.unique(np.linspace(0, total - 1, min(total, 200)).astype(int))
    f = measured.frequency_hz[chosen]
    size = np.abs(measured.magnitude[chosen])
    shape = patterns(effects, linear, f)
    noise = {
        "magnitude": measured.magnitude_noise[chosen].tolist(),
        "phase_deg": measured.phase_deg_noise[chosen].tolist(),
    }
    sources = [{"source": "noise", "type": "A", **noise}]
    for name in dict.fromkeys(effect.source for effect in effects):
        own = shape[:, [effect.source == name for effect in effects]]
        gain, turn = (np.sqrt(np.sum(part**2, axis=1)) for part in (np.real(own), np.imag(own)))
        both = {"magnitude": (size * gain).tolist(), "phase_deg": np.rad2deg(turn).tolist()}
        sources.append({"source": name, "type": "B", **both})
    return {"frequency_hz": f.tolist(), "sources": sources}
