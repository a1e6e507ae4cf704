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
| rounding | tabulated by the records and their converters' steps | relative |

The fit answers to it as to any other deviation: dz = (AᵀA)⁻¹ Aᵀ b. It is common to all points, so more data do not
reduce it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrident.problem import Coordinates
from vibrident.records import Calibration, FloatArray, Quantity, SystematicEffect
from vibrident.uncertainty.linearised import Linearised, log_slopes
from vibrident.uncertainty.parameters import reference_direction

STEP = 1e-5  # relative step of the central difference in frequency
DATA = "data"  # kind of a row of type A


@dataclass(frozen=True, eq=False)
class BudgetRow:
    """A row of the budget."""

    source: str  # of the contribution
    kind: str  # as in the module's table; ``data`` for the type A part
    standard_uncertainty: float | None  # of the effect, in ``unit``; None for the type A part
    unit: str  # of that
    degrees_of_freedom: float  # behind it; infinite where it is taken as known
    covariance: FloatArray  # what it adds to the covariance of z, shape (p, p)


def rows_of_effects(
    effects: Sequence[SystematicEffect], coordinates: Coordinates, z: FloatArray, quantity: Quantity, linear: Linearised
) -> list[BudgetRow]:
    """A row for each systematic effect.

    ``effects``: as stated in the calibration file; ``z``: the estimate, shape (p,); ``linear``: the fit, linearised at
    ``z``.
    """
    rows: list[BudgetRow] = []
    for effect in effects:
        shift = shift_of_effect(effect, coordinates, z, quantity, linear)
        rows.append(row_of_effect(effect, np.outer(shift, shift)))
        if len(rows) > 1 and effect.pattern and rows[-2].source == effect.source:  # parts of one source
            last, before = rows.pop(), rows.pop()
            u = float(np.hypot(before.standard_uncertainty or 0.0, effect.standard_uncertainty))
            rows.append(replace(last, standard_uncertainty=u, covariance=before.covariance + last.covariance))
    return rows


def row_of_effect(effect: SystematicEffect, covariance: FloatArray) -> BudgetRow:
    """The row of an effect that adds ``covariance``, shape (p, p)."""
    freedom = effect.degrees_of_freedom
    return BudgetRow(effect.source, effect.kind, effect.standard_uncertainty, effect.unit, freedom, covariance)


def shift_of_effect(
    effect: SystematicEffect, coordinates: Coordinates, z: FloatArray, quantity: Quantity, linear: Linearised
) -> FloatArray:
    """What one standard uncertainty of the effect does to z, shape (p,); arguments as :func:`rows_of_effects`."""
    u = effect.standard_uncertainty
    if effect.kind == "gain":  # exact, even if the data do not determine the other parameters
        return reference_direction(z, coordinates.model, u)
    change = pattern(effect, coordinates, z, quantity, linear.frequency_hz)
    part = np.where(linear.is_phase, np.imag(change), np.real(change))
    shift, _ = replace(linear, rest=part * linear.weight).solve()
    return u * shift


def pattern(
    effect: SystematicEffect, coordinates: Coordinates, z: FloatArray, quantity: Quantity, frequency: FloatArray
) -> NDArray[Any]:
    """Change of log H for one unit of the effect, complex, shape (m,); other arguments as :func:`rows_of_effects`."""
    if effect.kind == "gain":
        return np.ones(len(frequency), dtype=complex)
    if effect.kind == "timing":
        return -2j * np.pi * frequency
    if effect.kind == "phase":
        return np.full(len(frequency), -1j)
    if effect.kind == "mounting":
        return (frequency / float(effect.frequency_hz or 1.0)) ** 2 + 0j
    if effect.pattern:
        at, real, imaginary = np.array(effect.pattern).T
        return np.interp(frequency, at, real) + 1j * np.interp(frequency, at, imaginary)
    ahead, _ = log_slopes(coordinates, z, quantity, frequency * (1.0 + STEP))
    behind, _ = log_slopes(coordinates, z, quantity, frequency * (1.0 - STEP))
    return -np.log(ahead / behind) / (2.0 * STEP)


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
    reference = [SystematicEffect("calibration of the reference", "gain", relative)] if relative > 0 else []
    return [*reference, *calibration.effects]


def as_settings(rows: Sequence[BudgetRow], names: Sequence[str], slopes: FloatArray) -> list[dict[str, Any]]:
    """The budget as plain values: the contribution of each row to each parameter's standard uncertainty, in its unit.

    ``rows``: the budget; ``slopes``: ∂parameter/∂z, shape (p,).
    """
    table = []
    for row in rows:
        parts: Mapping[str, float] = dict(
            zip(names, (np.sqrt(np.maximum(np.diag(row.covariance), 0.0)) * np.abs(slopes)).tolist(), strict=True)
        )
        finite = np.isfinite(row.degrees_of_freedom)
        table.append(
            {
                "source": row.source,
                "type": "A" if row.kind == DATA else "B",
                "kind": row.kind,
                "standard_uncertainty": row.standard_uncertainty,
                "unit": row.unit,
                "degrees_of_freedom": float(row.degrees_of_freedom) if finite else None,
                "contributions": parts,
            }
        )
    return table
