"""A reference that is a sensor itself, as the cause of a misfit: its own response is in the data.

The points are then those of S/K. K is an oscillator that falls above its resonance (an
accelerometer) or below its corner (a seismometer); its natural frequency and damping are two more
unknowns.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibrident.base.amounts import plain
from vibrident.data.records import FloatArray, Quantity, is_motion
from vibrident.fit.information import inverse_where_shown
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.optimise import levenberg_marquardt
from vibrident.fit.problem import Coordinates
from vibrident.fit.problem.frequency_domain import Local
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.uncertainty.linearised import log_slopes

#: Number of natural frequencies to begin from.
PLACES = 40
#: The lowest and the highest of them, over the ends of the band.
REACH = (0.3, 2.0)
#: Damping ratios to begin from, and their limits.
DAMPINGS = (0.03, 0.15, 0.7)
MIN_DAMPING = 1e-4
MAX_DAMPING = 2.0
#: Steps of the model's coordinates at each beginning.
ROUGH_STEPS = 4
#: Decrease of −2 log of the likelihood that is not worth a step from the best of them.
TOLERANCE = 0.1
#: Deviation, in its standard deviation, from which a point counts as wild.
WILD = 3.0
#: Part of the cost of the model alone that an explanation may leave.
MAX_REMAINING_SHARE = 0.25
#: Degrees of freedom that must remain.
MIN_FREEDOM = 6


def with_reference_named(fitted: Fitted) -> Fitted:
    """Return the fit, its message with the response of the reference that would explain it."""
    text = _explanation(fitted)
    if not text:
        return fitted
    judgement = replace(fitted.judgement, lack_of_fit=f"{fitted.judgement.lack_of_fit} {text}")
    return replace(fitted, judgement=judgement)


def _explanation(fitted: Fitted) -> str:
    """Return the sentence that names the reference as the cause; empty where it is not."""
    evidence = fitted.evidence
    adequacy = fitted.judgement.adequacy
    stated = "reference" in evidence.calibration.known_responses or not is_motion(
        evidence.calibration.quantity
    )
    optical = any(record.optical is not None for record in evidence.records)
    few = 2 * len(adequacy.frequency_hz) - len(fitted.estimate.z) < MIN_FREEDOM
    if fitted.adequate or stated or optical or few or not evidence.model.is_linear:
        return ""
    oscillator = _oscillator_that_explains(fitted)
    if oscillator is None:
        return ""
    natural_hz, damping = oscillator
    return (
        "A reference with a response of its own would explain them, an oscillator of about "
        f"{plain(natural_hz, 2)} Hz with damping {plain(damping, 2)}: if it is a sensor, state its "
        "known_response under [reference]."
    )


@dataclass(frozen=True, eq=False)
class BesideOscillator:
    """Points of a fit, explained by its model and an oscillator of the reference.

    Attributes:
        coordinates: of the model.
        quantity: of the reference.
        hz: frequencies, shape (K,).
        measured: response there, shape (K,).
        deviation: its relative standard deviation, shape (K,).
        above: whether the oscillator falls above its resonance; else below its corner.
    """

    coordinates: Coordinates
    quantity: Quantity
    hz: FloatArray
    measured: ComplexArray
    deviation: FloatArray
    above: bool

    def at(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the deviations over their standard deviations, shape (2 K,), and derivatives.

        Args:
            x: the model's coordinates, and the oscillator's logarithms, shape (P + 2,).

        Returns:
            Deviations, and their derivatives with x, shape (2 K, P + 2).
        """
        response, of_model = log_slopes(self.coordinates, x[:-2], self.quantity, self.hz)
        oscillator, of_oscillator = _oscillator(self.hz, *x[-2:], above=self.above)
        slopes = _parts(np.concatenate([-of_model.T, of_oscillator]) / self.deviation)
        return _parts(np.log(self.measured * oscillator / response) / self.deviation), slopes.T

    def __call__(self, x: FloatArray, _: None = None) -> Local:
        """Return Cauchy's cost of the deviations, its gradient and curvature, for an optimiser."""
        errors, slopes = self.at(x)
        weighted = slopes / (1.0 + (errors / WILD) ** 2)[:, None]
        return Local(weighted.T @ slopes, -weighted.T @ errors, float(_cauchy(errors)))

    def best_of_grid(self, z: FloatArray, places: FloatArray) -> FloatArray:
        """Return the best of places of the oscillator, the model's coordinates being free.

        Gauss–Newton steps from z find these, with deviations weighed by Cauchy's distribution.

        Args:
            z: coordinates of the model, shape (P,).
            places: the oscillator's logarithms, shape (places, 2).

        Returns:
            Coordinates and logarithms, shape (P + 2,).
        """
        errors, slopes = self.at(np.append(z, places[0]))
        slopes = slopes[:, : len(z)]
        logs = np.log(_oscillator(self.hz, *places.T[..., None], above=self.above)[0])
        errors = errors + _parts((logs - logs[:1]) / self.deviation)
        steps = np.zeros((len(places), len(z)))
        for _ in range(ROUGH_STEPS):
            remaining = errors + steps @ slopes.T
            weighted = slopes / (1.0 + (remaining / WILD) ** 2)[..., None]
            normal = weighted.mT @ slopes
            right_side = (weighted.mT @ errors[..., None])[..., 0]
            steps = -np.einsum("kij,kj->ki", inverse_where_shown(normal), right_side)
        best = int(np.argmin(_cauchy(errors + steps @ slopes.T)))
        return np.append(z + steps[best], places[best])


def _parts(values: Any) -> FloatArray:
    """Return real parts, then imaginary parts; those that are not finite become very large."""
    both = np.concatenate([values.real, values.imag], axis=-1)
    return np.nan_to_num(both, nan=1e9, posinf=1e9, neginf=-1e9)


def _cauchy(errors: FloatArray) -> Any:
    """Return −2 log of the likelihood of deviations by Cauchy's distribution, shape (…)."""
    return WILD**2 * np.sum(np.log1p((errors / WILD) ** 2), axis=-1)


def _oscillator_that_explains(fitted: Fitted) -> tuple[float, float] | None:
    """Return natural frequency and damping of the best oscillator, None if it explains too little.

    Points without motion are wild, so deviations are weighed by Cauchy's distribution.
    """
    coordinates = fitted.estimate.coordinates
    adequacy = fitted.judgement.adequacy
    hz = adequacy.frequency_hz
    z = fitted.estimate.z
    lowest, highest = (
        float(part * end) for part, end in zip(REACH, (hz.min(), hz.max()), strict=True)
    )
    limits = np.log([[lowest, MIN_DAMPING], [highest, MAX_DAMPING]])
    low, high = (
        np.append(np.full(len(z), sign * np.inf), limit)
        for sign, limit in zip((-1, 1), limits, strict=True)
    )
    inner_hz = np.geomspace(lowest, highest, PLACES + 2)[1:-1]
    places = np.log(list(itertools.product(inner_hz, DAMPINGS)))
    points = fitted.evidence.quantity, hz, adequacy.measured, adequacy.relative_deviation
    with np.errstate(all="ignore"):
        sides = [BesideOscillator(coordinates, *points, above) for above in (True, False)]
        begins = [side.best_of_grid(z, places) for side in sides]
        better = int(np.argmin([side(x).cost for side, x in zip(sides, begins, strict=True)]))
        best = levenberg_marquardt(
            sides[better],
            begins[better],
            None,
            moved=lambda x, step: np.clip(x + step, low, high),
            tolerance=TOLERANCE,
            max_cost=2.0 * hz.size,
        )
    ratio = adequacy.measured / fitted.response(hz)
    before = float(_cauchy(_parts(np.log(ratio) / adequacy.relative_deviation)))
    if not best.costs[-1] < MAX_REMAINING_SHARE * before:
        return None
    natural_hz, damping = np.exp(best.last[len(z) :])
    return float(natural_hz), float(damping)


def _oscillator(
    hz: FloatArray, log_hz: Any, log_damping: Any, *, above: bool
) -> tuple[ComplexArray, ComplexArray]:
    """Return K, shape (…, K), and the derivatives of ln K by its parameters' logarithms, (2, …, K).

    Args:
        hz: frequencies, shape (K,).
        log_hz: logarithm of the natural frequency, shape (…, 1) or a number.
        log_damping: the same of the damping ratio.
        above: whether K falls above its resonance, and is one below; else the other way round.
    """
    natural_hz, damping = (np.exp(np.clip(log, -60.0, 60.0)) for log in (log_hz, log_damping))
    place = hz / natural_hz
    denominator = 1.0 - place**2 + 2j * damping * place
    slopes = np.stack([2.0 * (1j * damping * place - place**2), -2j * damping * place])
    slopes = slopes / denominator
    if above:
        return 1.0 / denominator, slopes
    slopes[0] -= 2.0
    return -(place**2) / denominator, slopes
