"""The uncertainty budget: what each systematic contribution does to a parameter (GUM 5.1, type B).

A contribution changes the measured response by a known pattern over frequency, with one unknown
factor:

| kind | change of log H for one unit | standard uncertainty |
|---|---|---|
| gain | 1 | relative (voltmeter, amplifier, reference) |
| timing | −2πjf | s (skew between the channels) |
| phase | −j | rad |
| mounting | (f/f₀)² | relative, at f₀ = ``frequency_hz`` (stiff mount, far below resonance) |
| clock | −f ∂ log H/∂f | relative (sampling rate) |
| ellipse, cyclic | tabulated by the interferometer's signals | relative |
| gain, phase with a table or a band | tabulated by the calibration file | relative, rad: largest |
| mass ratio | ∂ log H/∂μ of a mounting that is fitted | of μ |
| rounding | tabulated by the records and their converters' steps | relative |

The fit answers to it as to any other deviation: dz = (AᵀA)⁻¹ Aᵀ b. It is common to all points, so
more data do not reduce it.

Effects also explain deviations. Along the pattern d_k(f) of each acts one unknown factor a_k, whose
prior is N(0, 1) in units of its standard uncertainty. The deviations from the right model then have
the covariance Σ = Σ_noise + Σ_k d_k d_kᵀ, and the test of adequacy is the χ² in that metric. It is
computed as the least sum of the squares of the weighted deviations and of the a_k, over the
parameters and the a_k (the two are the same, Woodbury), with the model as it is, so that an effect
may be large beside the noise. A pattern that the parameters can follow explains nothing, and
nothing changes. The a_k are judged by themselves too, as many points would hide one of six: with S
= DᵀD of the part of the patterns that no parameter follows, the covariance of the estimated a_k is
S(1 + S)⁻¹.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import Calibration, FloatArray, Quantity, SystematicEffect
from vibrident.fit.information import inverse_normal
from vibrident.fit.problem import Coordinates
from vibrident.fit.response.verdict import probability
from vibrident.fit.uncertainty.linearised import Linearised, log_slopes
from vibrident.fit.uncertainty.parameters import deviations, reference_direction
from vibrident.physics.models import with_number_moved
from vibrident.result import MeasuredCurve

MASS_RATIO_STEP = 1e-5  # of the central difference
DATA = "data"  # kind of a row of type A
#: Weighted deviations, from z and a change of log H at each point.
Weighted = Callable[[FloatArray, np.ndarray], FloatArray]


@dataclass(frozen=True, eq=False)
class BudgetRow:
    """A row of the uncertainty budget: one contribution."""

    source: str  # of the contribution
    kind: str  # as in the module's table; ``data`` for the type A part
    standard_uncertainty: float | None  # of the effect, in ``unit``; None for the type A part
    unit: str  # of that
    degrees_of_freedom: float  # behind it; infinite where it is taken as known
    covariance: FloatArray  # what it adds to the covariance of z, shape (p, p)


def rows_of_effects(effects: Sequence[SystematicEffect], linear: Linearised) -> list[BudgetRow]:
    """Return a row for each source of systematic effects: the fit's linear answer to it."""
    rows: list[BudgetRow] = []
    for effect in effects:
        shift = shift_of_effect(effect, linear)
        row = row_of_effect(effect, np.outer(shift, shift))
        if (
            rows
            and effect.pattern
            and (rows[-1].source, rows[-1].kind) == (effect.source, effect.kind)
        ):
            previous = rows.pop()  # parts of one source
            uncertainties = previous.standard_uncertainty or 0.0, effect.standard_uncertainty
            # Bands of one source differ; their largest uncertainty is stated.
            u = float(np.hypot(*uncertainties) if effect.kind == "rounding" else max(uncertainties))
            covariance = previous.covariance + row.covariance
            row = replace(row, standard_uncertainty=u, covariance=covariance)
        rows.append(row)
    return rows


def row_of_effect(effect: SystematicEffect, covariance: FloatArray) -> BudgetRow:
    """Return the row of an effect that adds ``covariance``, shape (p, p), to that of z."""
    freedom = effect.degrees_of_freedom
    return BudgetRow(
        effect.source, effect.kind, effect.standard_uncertainty, effect.unit, freedom, covariance
    )


def shift_of_effect(effect: SystematicEffect, linear: Linearised) -> FloatArray:
    """Return how far one standard uncertainty of the effect moves z, shape (p,)."""
    u = effect.standard_uncertainty
    if effect.kind == "gain" and not effect.pattern:
        # Exact, even if the data do not determine the other parameters.
        return reference_direction(linear.z, linear.coordinates.model, u)
    if not linear.matrix.size:
        # Free decays: all frequencies scale with the clock, and nothing else reaches them.
        specs = linear.coordinates.model.parameters
        return np.array(
            [u if effect.kind == "clock" and spec.kind == "log" else 0.0 for spec in specs]
        )
    change = pattern(effect, linear, linear.frequency_hz)
    return u * linear.shift(linear.rows_of(change[:, None])[:, 0])


def pattern(
    effect: SystematicEffect, linear: Linearised | Place | None, frequency: FloatArray
) -> NDArray[Any]:
    """Return the change of log H for one unit of the effect, complex, shape (m,).

    ``linear`` is for the kind clock alone.
    """
    if effect.pattern:
        table_hz, real, imaginary = np.array(effect.pattern).T
        return np.interp(frequency, table_hz, real) + 1j * np.interp(frequency, table_hz, imaginary)
    if effect.kind == "gain":
        return np.ones(len(frequency), dtype=complex)
    if effect.kind == "timing":
        return -2j * np.pi * frequency
    if effect.kind == "phase":
        return np.full(len(frequency), -1j)
    if effect.kind == "mounting":
        return (frequency / float(effect.frequency_hz or 1.0)) ** 2 + 0j
    assert linear is not None
    if effect.kind == "mass ratio":
        return _change_by_mass_ratio(linear, frequency)
    sensor = linear.coordinates, linear.z, linear.quantity
    step = 1e-5  # relative, of the central difference
    ahead, _ = log_slopes(*sensor, frequency * (1.0 + step))
    behind, _ = log_slopes(*sensor, frequency * (1.0 - step))
    return -np.log(ahead / behind) / (2.0 * step)


def _change_by_mass_ratio(linear: Linearised | Place, frequency: FloatArray) -> NDArray[Any]:
    """Return ∂ log H/∂μ of a model with a mounting, complex, shape (m,)."""
    coordinates = linear.coordinates
    values = coordinates.values(linear.z)
    responses = [
        with_number_moved(coordinates.model, step).frequency_response(values, frequency)
        for step in (-MASS_RATIO_STEP, MASS_RATIO_STEP)
    ]
    return np.asarray(np.log(responses[1] / responses[0]) / (2.0 * MASS_RATIO_STEP))


def effective_degrees_of_freedom(rows: Sequence[BudgetRow]) -> FloatArray:
    """Return those of each coordinate by Welch–Satterthwaite (GUM G.4.1), shape (p,)."""
    variances = np.stack([np.diag(row.covariance) for row in rows])
    shares = variances / np.maximum(np.sum(variances, axis=0), 1e-300)
    freedom = np.array([row.degrees_of_freedom for row in rows])
    reciprocal = np.sum(shares**2 / freedom[:, None], axis=0)
    return np.where(reciprocal > 0, 1.0 / np.maximum(reciprocal, 1e-300), np.inf)


def effects_of(calibration: Calibration) -> list[SystematicEffect]:
    """Return the stated effects: the reference, known responses of channels, then the others."""
    relative = calibration.reference_standard_uncertainty
    reference = (
        [SystematicEffect("calibration of the reference", "gain", relative)] if relative > 0 else []
    )
    known_responses = calibration.known_responses.values()
    known = [effect for response in known_responses for effect in response.effects]
    mounting = calibration.mounting
    if mounting is not None and not mounting.is_known and mounting.mass_ratio_uncertainty > 0.0:
        u = mounting.mass_ratio_uncertainty
        known.append(SystematicEffect("mass ratio of the mounting", "mass ratio", u))
    return [*reference, *known, *calibration.effects]


def covered_kinds(kinds: set[str]) -> list[str]:
    """Return which of ``noise``, ``gain`` and ``phase`` rows of these kinds cover."""
    covering_kinds = {"noise": {DATA}, "gain": {"gain"}, "phase": {"phase", "timing"}}
    return [name for name, covering in covering_kinds.items() if kinds & covering]


def as_settings(
    rows: Sequence[BudgetRow], names: Sequence[str], slopes: FloatArray
) -> list[dict[str, Any]]:
    """Return the budget as plain values: what each row contributes to each parameter's u.

    Contributions are in the parameter's unit. ``rows``: the budget; ``slopes``: ∂parameter/∂z,
    shape (p,).
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
    """Amounts of effects that explain deviations, and what deviations remain."""

    amounts: FloatArray  # a_k of each effect, in its standard uncertainties, shape (K,)
    uncertainties: FloatArray  # of the a_k, by the prior and the data, shape (K,)
    residual: FloatArray  # weighted deviations that the effects do not explain
    chi2: float  # Σ squares of these and of the a_k
    probability: float  # of a_k at least as large


class Place(NamedTuple):
    """Coordinates of a model, their values z, shape (p,), and the quantity of the reference."""

    coordinates: Coordinates
    z: FloatArray
    quantity: Quantity


def patterns(
    effects: Sequence[SystematicEffect],
    linear: Linearised | Place | None,
    frequency_hz: FloatArray,
) -> np.ndarray:
    """Return the change of log H by one u of each effect, complex, shape (n, K).

    ``linear``: as of :func:`pattern`.
    """
    columns = [e.standard_uncertainty * pattern(e, linear, frequency_hz) for e in effects]
    return np.stack(columns, axis=1) if columns else np.zeros((len(frequency_hz), 0), complex)


def explain(
    weighted: Weighted,
    effects: Sequence[SystematicEffect],
    shape: np.ndarray,
    linear: Linearised,
    covariance: FloatArray | None,
    corrected: FloatArray,
) -> Explained | None:
    """Fit the effects beside the parameters; None where that leads to another optimum.

    Args:
        weighted: the deviations over their noise.
        effects: K of them.
        shape: their patterns at the points, shape (n, K).
        linear: the fit, linearised at the estimate.
        covariance: of the estimate, by noise, shape (p, p); None: any optimum will do.
        corrected: amounts of the effects that the data are corrected for, shape (K,).
    """
    from scipy.optimize import least_squares  # slow to load

    z = linear.z
    parameters = len(linear.z)

    def residual(x: FloatArray) -> FloatArray:
        change = x[parameters:]
        return np.concatenate([weighted(z + x[:parameters], shape @ change), corrected + change])

    begin = np.zeros(parameters + shape.shape[1])
    # Slopes to one side: damping is mirrored at zero.
    with np.errstate(all="ignore"):
        solution = least_squares(residual, begin, jac="2-point", max_nfev=60, xtol=1e-10)
    if not np.all(np.isfinite(solution.x)):
        return None
    amounts = corrected + solution.x[parameters:]
    if covariance is not None and _is_far(solution.x, effects, linear, covariance):
        return None
    jacobian = solution.jac[: -shape.shape[1]]
    # The size of rounding is no claim.
    stated = np.array([effect.kind != "rounding" for effect in effects])
    free_columns = np.concatenate([np.ones(parameters, dtype=bool), ~stated])
    probability_of_amounts = _probability_of_amounts(
        amounts[stated], jacobian[:, free_columns], jacobian[:, ~free_columns]
    )
    by_effects = _unfollowed(jacobian[:, :parameters], jacobian[:, parameters:])
    return Explained(
        amounts,
        deviations(inverse_normal(np.eye(len(amounts)) + by_effects.T @ by_effects)),
        solution.fun[: -len(amounts)],
        float(2.0 * solution.cost),
        probability_of_amounts,
    )


def _is_far(
    change: FloatArray,
    effects: Sequence[SystematicEffect],
    linear: Linearised,
    covariance: FloatArray,
) -> bool:
    """Return whether the parameters moved by more than five standard deviations.

    ``change``: of the parameters, then of the amounts, shape (p + K,).
    """
    shift, amounts = np.split(change, [len(linear.z)])
    by_effects = np.stack([shift_of_effect(effect, linear) for effect in effects], axis=1)
    by_effects = by_effects * np.maximum(np.abs(amounts), 1.0)
    variance = np.maximum(np.diag(covariance), 0.0) + np.sum(by_effects**2, axis=1)
    return bool(np.any(np.abs(shift) > 5.0 * np.sqrt(variance) + 1e-9))


def _probability_of_amounts(amounts: FloatArray, slopes: FloatArray, effects: FloatArray) -> float:
    """Return the probability of a_k at least as large where the stated uncertainties are right.

    ``slopes``: weighted ∂deviation/∂z and of unjudged effects, ``effects``: ∂deviation/∂a_k, one
    row a deviation.
    """
    unfollowed = _unfollowed(slopes, effects)
    values, vectors = np.linalg.eigh(unfollowed.T @ unfollowed)
    determined = values > 1e-3  # S: by S/(1 + S) the data reduce the prior variance of a_k
    chi2 = float(
        np.sum(
            (vectors.T @ amounts)[determined] ** 2 * (1.0 + values[determined]) / values[determined]
        )
    )
    return probability(chi2, int(determined.sum()))


def _unfollowed(slopes: FloatArray, effects: FloatArray) -> FloatArray:
    """Return what of the effects' columns those of the slopes cannot follow."""
    basis = _basis(slopes)
    return effects - basis @ (basis.T @ effects)


def _basis(matrix: FloatArray) -> FloatArray:
    """Return an orthonormal basis of the columns of a matrix."""
    left_vectors, singular_values, _ = np.linalg.svd(matrix, full_matrices=False)
    return left_vectors[
        :, singular_values > 1e-9 * max(float(singular_values.max(initial=0.0)), 1e-300)
    ]


def deviation_uncertainty(
    linear: Linearised, shape: np.ndarray, scatter: float = 1.0
) -> FloatArray:
    """Return the standard uncertainty of the deviations of points from the model fitted to them.

    The model follows the points: noise by the leverage of each, and of an effect all that its
    parameters can imitate. What it does not follow remains: (1 − h) of the noise's variance, and
    the remainder of each pattern.

    Args:
        linear: m rows, magnitudes first, phases (if any) after them.
        shape: patterns of the effects at the n points, shape (n, K).
        scatter: standard deviation of the noise in units of the rows' weights.

    Returns:
        Of log H, shape (m,): relative for magnitudes, rad for phases; NaN for a point that any
        value would fit.
    """
    repeats = len(linear.frequency_hz) // max(len(shape), 1)
    weighted_patterns = linear.rows_of(np.tile(shape, (repeats, 1)))
    basis = _basis(linear.matrix)
    noise_share = 1.0 - np.sum(basis**2, axis=1)
    effect_variance = np.sum(
        (weighted_patterns - basis @ (basis.T @ weighted_patterns)) ** 2, axis=1
    )
    variance = np.where(noise_share > 1e-6, scatter**2 * noise_share + effect_variance, np.nan)
    return np.sqrt(variance) / linear.weight


def point_budget(
    measured: MeasuredCurve, effects: Sequence[SystematicEffect], linear: Linearised
) -> dict[str, Any] | None:
    """Return standard uncertainties by source at each point, or None without effects.

    Of more than 200 points, 200 evenly spread ones are taken.

    Returns:
        ``frequency_hz`` and, by source, ``magnitude`` (in the unit of the magnitude) and
        ``phase_deg`` of ``sources``, whose root sum of squares is the uncertainty of the point
        before any floor.
    """
    if not effects or not len(measured.frequency_hz):
        return None
    count = len(measured.frequency_hz)
    chosen = np.unique(np.linspace(0, count - 1, min(count, 200)).astype(int))
    frequency_hz = measured.frequency_hz[chosen]
    size = np.abs(measured.magnitude[chosen])
    shape = patterns(effects, linear, frequency_hz)
    noise = {
        "magnitude": measured.magnitude_noise[chosen].tolist(),
        "phase_deg": measured.phase_deg_noise[chosen].tolist(),
    }
    sources = [{"source": "noise", "type": "A", **noise}]
    for name in dict.fromkeys(effect.source for effect in effects):
        source_patterns = shape[:, [effect.source == name for effect in effects]]
        gain, phase = (
            np.sqrt(np.sum(component**2, axis=1))
            for component in (np.real(source_patterns), np.imag(source_patterns))
        )
        columns = {"magnitude": (size * gain).tolist(), "phase_deg": np.rad2deg(phase).tolist()}
        sources.append({"source": name, "type": "B", **columns})
    return {"frequency_hz": frequency_hz.tolist(), "sources": sources}
