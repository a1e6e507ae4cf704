"""Verdict on what the package says of a trial, against the truth."""

from __future__ import annotations

import math
import re
import time
import traceback
import warnings
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import numpy as np

from bench.adversary.trial import Trial
from vibrident import Result, VibridentError, identify
from vibrident.physics.naming import in_words

#: A parameter further from the truth than this many standard uncertainties is wrong.
MAX_DISTANCE_U = 4.0
#: Of the truth: a parameter that is wrong by more was found at another optimum.
MAX_RELATIVE_ERROR = 0.3
ROUNDING_ERROR = 1e-8  # errors below this part of the truth are rounding
#: A stated impact is true within this part of the real one, or one standard uncertainty.
IMPACT_TOLERANCE = 0.3
#: What speaks of single parameters: heeded for those that its message names.
OF_PARAMETERS = ("weakly_determined", "at_bound")
#: Derived parameters and what they are made of.
MADE_OF = {
    "natural_angular_frequency": ("natural_frequency",),
    "resonance_frequency": ("natural_frequency", "damping_ratio"),
    "conversion_coefficient": ("sensitivity", "natural_frequency"),
}
#: A weakly determined parameter is no false alarm where its stated uncertainty is above this part
#: of its value.
WEAK_UNCERTAINTY = 0.009

RIGHT = "right"
WARNED = "warned"
REFUSED = "refused"
SILENT = "silent-wrong"
ALARM = "false alarm"
TRACEBACK = "traceback"
BAD = (SILENT, ALARM, TRACEBACK)


def judged(trial: Trial) -> dict[str, Any]:
    """Class of the trial, and what led to it, as plain values."""
    begin = time.perf_counter()
    cpu = time.process_time()
    outcome: dict[str, Any] = {"cause": trial.cause, "clean": not trial.cause}
    outcome |= {"drawn": trial.drawn} if trial.drawn else {}
    try:
        with warnings.catch_warnings(record=True) as noted:
            warnings.simplefilter("always")
            result = identify(trial.calibration(), model=trial.model)
        outcome |= of_result(trial, result)
        outcome["python_warnings"] = sorted(
            {f"{w.category.__name__}: {w.message}"[:100] for w in noted}
        )
    except VibridentError as error:
        expected = bool(trial.cause) or trial.strange
        outcome |= {
            "class": REFUSED if expected else ALARM,
            "codes": ["refused"],
            "says": [str(error)[:300]],
        }
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        location = f"{where.filename.rpartition('/')[2]}:{where.lineno}"
        outcome |= {
            "class": TRACEBACK,
            "codes": [],
            "says": [f"{type(error).__name__}: {error} ({location})"[:300]],
        }
    spent = {
        "seconds": round(time.perf_counter() - begin, 2),
        "cpu": round(time.process_time() - cpu, 2),
    }
    return {**outcome, **spent}


def of_result(trial: Trial, result: Result) -> dict[str, Any]:
    """Return the class of a trial that gave a result."""
    z = distances(result, trial.truth)
    wrong = [name for name, value in z.items() if value > MAX_DISTANCE_U]
    unheeded = [name for name in wrong if not heeded(name, result)]
    alarms = [] if trial.cause else false_alarms(trial, result)
    kind = (
        SILENT if unheeded else ALARM if alarms else WARNED if result.warnings and wrong else RIGHT
    )
    fit = result.fit
    return {
        "class": kind,
        "z": {
            name: round(value, 2) if math.isfinite(value) else 1e300 for name, value in z.items()
        },
        "wrong": wrong,
        "codes": list(result.warning_codes),
        "says": [f"{w.code}: {w.message}"[:240] for w in result.warnings],
        "alarms": alarms,
        "runaway": runaway(result, trial.truth, z),
        "impact": told_impact(trial, result) if trial.cause else None,
        "chi2": fit.chi2_reduced,
        "degrees": fit.degrees_of_freedom,
        "estimator": result.estimator,
        "samples_left_out": sum(
            "left out" in step for f in result.provenance["files"] for step in f["history"]
        ),
        **({"named": bool(trial.expected & set(result.warning_codes))} if trial.expected else {}),
        **({"u_ratio": u_ratio(trial, result)} if trial.compared else {}),
    }


def runaway(result: Result, truth: Mapping[str, float], z: Mapping[str, float]) -> list[str]:
    """Return the parameters that another optimum gets wrong, relative to the truth."""
    return [
        name
        for name, distance in z.items()
        if distance > MAX_DISTANCE_U
        and name not in MADE_OF
        and math.isfinite(truth[name])
        and abs(result.parameters[name].value - truth[name]) > MAX_RELATIVE_ERROR * abs(truth[name])
    ]


def u_ratio(trial: Trial, result: Result) -> float | None:
    """Return the largest ratio of u to u from the same recordings without what is wrong."""
    if trial.sound is None:
        return None
    with suppress(VibridentError):
        sound = identify(trial.sound(), model=trial.model).parameters
        pairs = [
            (stated.standard_uncertainty, sound[name].standard_uncertainty)
            for name, stated in result.parameters.items()
            if name in trial.truth and name in sound
        ]
        ratios = [stated / without for stated, without in pairs if stated and without]
        return round(max(ratios), 3) if ratios else None
    return None


#: What a warning says of the parameter that a departure moves most.
IMPACT = re.compile(
    r"Without (?:it|them) the (?P<name>.+) would be "
    r"(?P<without>\S+)(?P<unit>.*) in place of (?P<stated>\S+)"
    r"(?P<same>.*) \((?P<size>[^ ()]+) u\)"
)


def told_impact(trial: Trial, result: Result) -> dict[str, Any] | None:
    """Return the parameter that the first departure moves most, by how much, and as it is said.

    Both in stated standard uncertainties. It moved from where the same recordings without what is
    wrong lead to; where there are none, from the truth. None where no departure is said, or the
    model does not explain the data.
    """
    for warning in result.warnings if result.fit.adequate else ():
        impact = IMPACT.search(warning.message)
        name = (
            None
            if impact is None
            else next((n for n in trial.truth if in_words(n) == impact["name"]), None)
        )
        stated = None if name is None else result.parameters.get(name)
        if impact is None or name is None or stated is None or not stated.standard_uncertainty:
            continue
        less = abs(float(impact["stated"])) - abs(float(impact["without"]))
        if impact["unit"] != impact["same"]:  # 999 Hz and 1.01 kHz
            less = -less
        stated_off = math.copysign(float(impact["size"]), less * stated.value)
        off = (stated.value - _without(trial, name)) / stated.standard_uncertainty
        true = abs(off - stated_off) <= max(IMPACT_TOLERANCE * abs(off), 1.0)
        return {
            "code": warning.code,
            "parameter": name,
            "off": off,
            "told": stated_off,
            "true": true,
        }
    return None


def _without(trial: Trial, name: str) -> float:
    """Return what a parameter is without what is wrong."""
    if trial.sound is not None:
        with suppress(VibridentError):
            return identify(trial.sound(), model=trial.model).parameters[name].value
    return trial.truth[name]


def distances(result: Result, truth: Mapping[str, float]) -> dict[str, float]:
    """Return the distance of each stated parameter from the truth, in u of a normal distribution.

    Where the stated uncertainty has few degrees of freedom, the distance is that of a normal
    variable as probable as Student's is.
    """
    in_u = {}
    freedom = float(result.settings.get("effective_degrees_of_freedom") or math.inf)
    for name, true in truth.items():
        parameter = result.parameters.get(name)
        if parameter is None or parameter.standard_uncertainty is None:
            continue
        error = abs(parameter.value - true)
        if math.isfinite(true) and error <= ROUNDING_ERROR * abs(true):
            in_u[name] = 0.0
        elif not parameter.standard_uncertainty > 0.0:
            in_u[name] = math.inf
        else:
            in_u[name] = as_normal(error / parameter.standard_uncertainty, freedom)
    return in_u


def as_normal(ratio: float, freedom: float) -> float:
    """Return the normal deviate as improbable as Student's."""
    if not freedom < 1e4:
        return ratio
    from scipy.stats import norm, t  # 0.3 s

    tail = float(t.sf(ratio, max(freedom, 1.0)))
    return float(norm.isf(tail)) if tail > 1e-300 else ratio


def heeded(name: str, result: Result) -> bool:
    """Return whether a warning other than of polarity would keep a person from a parameter."""
    names = (name, *MADE_OF.get(name, ()))
    for warning in result.warnings:
        if warning.code == "polarity":
            continue
        if warning.code in OF_PARAMETERS:
            text = named(warning.message)
            if any(part in text for part in names):
                return True
        else:
            return True
    return False


def named(message: str) -> str:
    """Return a message in which parameters go by their names in a result."""
    text = (
        message.replace("second-mode ", "mode2_").replace("high-pass", "highpass").replace(" ", "_")
    )
    return text.replace("mode2_damping_ratio", "mode2_damping")


def false_alarms(trial: Trial, result: Result) -> list[str]:
    """Warnings of a clean trial that are not true of it."""
    codes = []
    for warning in result.warnings:
        if warning.code in trial.allowed:
            continue
        gain = next(
            (v for k, v in trial.truth.items() if k in ("sensitivity", "generator_constant")), 1.0
        )
        if warning.code == "polarity" and gain < 0.0:
            continue
        if warning.code in OF_PARAMETERS and _weak(warning.message, result):
            continue
        codes.append(warning.code)
    return codes


def _weak(message: str, result: Result) -> bool:
    """Return whether a parameter that the message names is as uncertain as it says."""
    text = named(message)
    for name, parameter in result.parameters.items():
        u = parameter.standard_uncertainty
        if name in text and (
            u is None or name == "delay" or u > WEAK_UNCERTAINTY * abs(parameter.value)
        ):
            return True
    return False


def quiet() -> None:
    """Silence NumPy's warnings of overflows, which are no part of the verdict."""
    np.seterr(all="ignore")
