"""A reference that is a sensor itself, as the cause of a misfit: its own response is in the data.

The points are then those of S/K, with K an oscillator that falls above its resonance (an
accelerometer) or below its corner (a seismometer): two more unknowns, its natural frequency and
damping.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from vibrident.base.amounts import plain
from vibrident.data.records import FloatArray, is_motion
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.response.response import ComplexArray

#: Natural frequencies to begin from.
PLACES = 8
#: The lowest and the highest of them, as parts of the ends of the band.
REACH = (0.3, 2.0)
#: Damping ratios to begin from, and their limits.
DAMPINGS = (0.03, 0.7)
MIN_DAMPING = 1e-4
MAX_DAMPING = 2.0
#: Evaluations for each beginning, and for the best of them.
MAX_ROUGH_EVALUATIONS = 6
MAX_EVALUATIONS = 60
#: Beginnings that are followed to their end.
FINAL_STARTS = 2
#: Deviation, in its standard deviation, from which a point counts as wild.
WILD = 3.0
#: Part of what the model leaves that an explanation may leave.
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
    """Return the sentence that names the reference as a cause; empty where it is none."""
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


def _oscillator_that_explains(fitted: Fitted) -> tuple[float, float] | None:
    """Return natural frequency and damping of the oscillator that explains most; None of little.

    Points that nothing moves are wild, so deviations are weighed by Cauchy's distribution.
    """
    from scipy.optimize import least_squares  # slow to load

    coordinates = fitted.estimate.coordinates
    adequacy = fitted.judgement.adequacy
    hz = adequacy.frequency_hz
    quantity = fitted.evidence.quantity
    z = fitted.estimate.z
    lowest, highest = (
        float(part * end) for part, end in zip(REACH, (hz.min(), hz.max()), strict=True)
    )
    limits = np.array([[lowest, MIN_DAMPING], [highest, MAX_DAMPING]])
    bounds = [
        np.append(np.full(len(z), sign * np.inf), np.log(limit))
        for sign, limit in zip((-1, 1), limits, strict=True)
    ]
    ends = []
    for above in (True, False):

        def residual(x: FloatArray, above: bool = above) -> FloatArray:
            values = coordinates.values(x[: len(z)])
            response = np.asarray(coordinates.model.frequency_response(values, hz, quantity))
            ratio = adequacy.measured * _oscillator(hz, x[len(z) :], above=above) / response
            error = np.log(ratio) / adequacy.relative_deviation
            return np.nan_to_num(
                np.concatenate([error.real, error.imag]), nan=1e9, posinf=1e9, neginf=-1e9
            )

        def descended(
            x: FloatArray, rounds: int, residual: Callable[[FloatArray], FloatArray] = residual
        ) -> Any:
            with np.errstate(all="ignore"):
                return least_squares(
                    residual, x, loss="cauchy", f_scale=WILD, bounds=bounds, max_nfev=rounds
                )

        places = itertools.product(np.geomspace(lowest, highest, PLACES + 2)[1:-1], DAMPINGS)
        starts = [descended(np.append(z, np.log(place)), MAX_ROUGH_EVALUATIONS) for place in places]
        starts.sort(key=lambda fit: fit.cost)
        ends += [descended(fit.x, MAX_EVALUATIONS) for fit in starts[:FINAL_STARTS]]
    best = min(ends, key=lambda fit: fit.cost)
    model = np.asarray(coordinates.model.frequency_response(fitted.values, hz, quantity))
    before = np.log(adequacy.measured / model) / adequacy.relative_deviation
    parts = np.concatenate([before.real, before.imag]) / WILD
    if not best.cost < MAX_REMAINING_SHARE * 0.5 * WILD**2 * float(np.sum(np.log1p(parts**2))):
        return None
    natural_hz, damping = np.exp(best.x[len(z) :])
    return float(natural_hz), float(damping)


def _oscillator(hz: FloatArray, logarithms: FloatArray, *, above: bool) -> ComplexArray:
    """Return K by the logarithms of its parameters: one below resonance, or above its corner."""
    natural_hz, damping = np.exp(np.clip(logarithms, -60.0, 60.0))
    place = hz / natural_hz
    denominator = 1.0 - place**2 + 2j * damping * place
    return np.asarray((1.0 if above else -(place**2)) / denominator, dtype=complex)
