"""What the data do not determine, and with which parameter it trades."""

from __future__ import annotations

import numpy as np

from vibrident.models.slopes import response_and_slopes
from vibrident.naming import in_words
from vibrident.problem import Coordinates
from vibrident.problem.coordinates import BAND_MARGIN, MARGIN_BELOW
from vibrident.records import FloatArray
from vibrident.result import ResultWarning

#: A parameter is weakly determined above this relative standard uncertainty (a delay: this many radians of phase at the
#: highest frequency) …
WEAK = 0.1
#: … or where fixing one other parameter would shrink its uncertainty by more than this factor while its own relative
#: uncertainty is above a tenth of WEAK.
TRADE = 5.0
#: Beyond this a relative standard uncertainty (of a delay: in rad) is no number to state: nothing is known.
NOTHING = 1e3
NEARER = 10.0  # a frequency at the end of its range is compared with one so many times nearer to the band
TRADED_POINTS = 50  # frequencies of the band at which one parameter is traded for others
MARGIN = 1e-3  # a parameter is at the end of its range if its relative distance from it is less than this


def doubts(
    coordinates: Coordinates, z: FloatArray, covariance: FloatArray
) -> tuple[dict[str, str], list[ResultWarning]]:
    """Names of parameters that are weakly determined (with the one each trades against), and the warnings.

    A parameter at a bound is reported as such.
    """
    model = coordinates.model
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(deviation > 0, deviation, 1.0)
    correlation = covariance / np.outer(safe, safe)
    weak: dict[str, str] = {}
    warnings = []
    values = coordinates.values(z)
    for index, spec in enumerate(model.parameters):
        if spec.kind in ("gain", "positive"):
            size = deviation[index] / max(abs(float(z[index])), 1e-300)
        else:  # the logarithm's deviation is relative; a delay's is in radians at the highest frequency
            size = deviation[index]
        others = np.abs(np.delete(correlation[index], index))
        strongest = float(others.max()) if others.size else 0.0
        trade = 1.0 / np.sqrt(max(1.0 - strongest**2, 1e-12))
        if size > NOTHING:
            weak[spec.name] = ""
            text = f"The data do not determine the {in_words(spec.name)}: no standard uncertainty can be stated."
            warnings.append(ResultWarning("weakly_determined", text))
        elif size > WEAK or (trade > TRADE and size > 0.1 * WEAK):
            names = [s.name for s in model.parameters if s.name != spec.name]
            partner = names[int(np.argmax(others))] if others.size else ""
            weak[spec.name] = partner
            relative = "rad at the highest frequency" if spec.kind == "time" else "of its value"
            traded = (
                f"; it trades against the {in_words(partner)} (correlation {strongest:.3f})" if strongest > 0.9 else ""
            )
            amount = f"{size:.2g} rad" if spec.kind == "time" else f"{100 * size:.2g} %"
            relative = relative.removeprefix("rad ")
            warnings.append(
                ResultWarning(
                    "weakly_determined",
                    f"The data hardly determine the {in_words(spec.name)}: standard uncertainty {amount} {relative}"
                    f"{traded}.",
                )
            )
    warnings += _at_bounds(coordinates, values, deviation)
    return weak | dict.fromkeys(at_end(coordinates, z), ""), warnings


def at_end(coordinates: Coordinates, z: FloatArray) -> set[str]:
    """Names of parameters at the end of the range searched: its value and u are then not determined by the data."""
    low, high = coordinates.edges
    within = (z > low + MARGIN) & (z < high - MARGIN)
    return {spec.name for spec, inside in zip(coordinates.model.parameters, within, strict=True) if not inside}


def unstated(coordinates: Coordinates, z: FloatArray, covariance: FloatArray) -> set[str]:
    """Names of parameters of which no standard uncertainty can be stated."""
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    kinds = [spec.kind for spec in coordinates.model.parameters]
    size = np.where([kind in ("gain", "positive") for kind in kinds], np.maximum(np.abs(z), 1e-300), 1.0)
    known = deviation <= NOTHING * size
    return at_end(coordinates, z) | {
        spec.name for spec, is_known in zip(coordinates.model.parameters, known, strict=True) if not is_known
    }


def _at_bounds(coordinates: Coordinates, values: dict[str, float], deviation: FloatArray) -> list[ResultWarning]:
    warnings = []
    low, high = coordinates.band_hz[0] / MARGIN_BELOW, coordinates.band_hz[1] * BAND_MARGIN
    for index, spec in enumerate(coordinates.model.parameters):
        value = values[spec.name]
        if spec.kind == "log" and not low * (1.0 + MARGIN) < value < high / (1.0 + MARGIN):
            text = f"The {in_words(spec.name)} lies at the end of the range searched, {low:.3g} to {high:.3g} Hz."
            traded = _traded(coordinates, values, deviation, index)
            text += f" What is stated of the {traded} holds for this frequency only." if traded else ""
            warnings.append(ResultWarning("at_bound", text))
        if spec.kind == "positive" and deviation[index] < NOTHING and value < 1e-6 + 0.01 * deviation[index]:
            warnings.append(ResultWarning("at_bound", f"The {in_words(spec.name)} lies at its bound, zero."))
    return warnings


def _traded(coordinates: Coordinates, values: dict[str, float], deviation: FloatArray, index: int) -> str:
    """The other parameters, in words, that a frequency nearer to the band would move by more than their u."""
    model, (low, high) = coordinates.model, np.asarray(coordinates.band_hz, dtype=float)
    name, points = model.parameter_names[index], np.geomspace(low, high, TRADED_POINTS)
    nearer = values[name] / NEARER if values[name] > high else values[name] * NEARER
    response, slopes = response_and_slopes(model, values, points)
    moved, _ = response_and_slopes(model, {**values, name: nearer}, points)
    change = np.log(moved / response)
    relative = (slopes * coordinates.slopes(coordinates.place(values))[:, None] / response).T
    relative = np.concatenate([np.real(relative), np.imag(relative)])
    others = np.flatnonzero((np.linalg.norm(relative, axis=0) > 0.0) & (np.arange(len(deviation)) != index))
    amounts, *_ = np.linalg.lstsq(relative[:, others], np.concatenate([np.real(change), np.imag(change)]), rcond=1e-12)
    names = [
        in_words(model.parameter_names[k]) for k, by in zip(others, amounts, strict=True) if abs(by) > deviation[k]
    ]
    return " and the ".join(names)
