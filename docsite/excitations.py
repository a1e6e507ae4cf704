"""The page on the choice of the motion, each row of its table by `vibrident plan`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from docsite.tables import page, table
from vibrident.base.amounts import plain
from vibrident.use.planning import plan
from vibrident.use.planning.calibration import Plan

SENSOR = {"sensitivity": 0.1, "natural_frequency": 1000.0, "damping_ratio": 0.05}
MAGNITUDE_U, PHASE_U_DEG = 0.005, 0.5
#: A line of broadband motion holds a part of it, and is known so many times worse than a sine.
LINE_WORSE = 4.0
#: Beyond this relative uncertainty a parameter is not determined.
NOTHING = 0.5


@dataclass(frozen=True)
class Motion:
    """A motion, the frequencies at which it moves the sensor, and what it is good for."""

    words: str
    span: str
    frequency_hz: tuple[float, ...]
    remark: str
    model: str = "accelerometer"
    worse: float = 1.0

    def planned(self) -> Plan:
        """Return the plan of its points."""
        parameters = (
            SENSOR if self.model == "accelerometer" else {"sensitivity": SENSOR["sensitivity"]}
        )
        return plan(
            self.model,
            parameters,
            frequencies_hz=self.frequency_hz,
            magnitude_uncertainty=MAGNITUDE_U * self.worse,
            phase_uncertainty_rad=math.radians(PHASE_U_DEG) * self.worse,
        )


def _thirds(low: float, high: float) -> tuple[float, ...]:
    steps = np.arange(round(10 * math.log10(low)), round(10 * math.log10(high)) + 1)
    return tuple((10.0 ** (steps / 10.0)).tolist())


def _lines(low: float, high: float, spacing: float) -> tuple[float, ...]:
    return tuple(np.arange(low, high, spacing).tolist())


MOTIONS = (
    Motion(
        "one sine (calibrator)", "0.16", (160.0,), "the sensitivity there: model `gain`", "gain"
    ),
    Motion("sines, slow shaker", "0.01 to 0.1", _thirds(10, 100), "the sensitivity, flat"),
    Motion(
        "sines to a third of fn", "0.01 to 0.3", _thirds(10, 315), "the sensitivity; fn by its rise"
    ),
    Motion("sines through resonance", "0.01 to 3", _thirds(10, 3150), "all of an oscillator"),
    Motion(
        "sines beside resonance",
        "0.6 to 1.6",
        _thirds(630, 1600),
        "fn and δ; add lower ones for the sensitivity",
    ),
    Motion(
        "sweep, random, multisine",
        "0.02 to 2",
        _lines(20, 2000, 5),
        "all parameters, and what the model lacks",
        worse=LINE_WORSE,
    ),
    Motion(
        "shock, short",
        "0.1 to 2",
        _lines(100, 2000, 20),
        "all, from few milliseconds",
        worse=LINE_WORSE,
    ),
    Motion(
        "shock, long",
        "0.02 to 0.5",
        _lines(20, 500, 20),
        "the sensitivity; fn roughly",
        worse=LINE_WORSE,
    ),
)


def excitations() -> str:
    """Return the page."""
    rows = [_row(motion) for motion in MOTIONS]
    rows.append(
        (
            "free decay, no reference",
            "1",
            "–",
            "see there",
            "see there",
            "fn and δ: [decays](decays.md)",
        )
    )
    heads = ("motion", "f / fn", "u of the sensitivity", "u of fn", "u of δ", "good for")
    assumed = (
        f"An accelerometer of damping ratio {plain(SENSOR['damping_ratio'], 2)}; sines in "
        f"one-third octaves, each known to {plain(100.0 * MAGNITUDE_U, 2)} % and "
        f"{plain(PHASE_U_DEG, 2)}°, and lines of the other motions "
        f"{plain(LINE_WORSE, 2)} times worse. *Not determined*: u is above "
        f"{plain(100.0 * NOTHING, 2)} %. "
        "The uncertainty of the reference comes on top of the sensitivity's."
    )
    return page("excitation.md", f"{table(heads, rows)}\n\n{assumed}")


def _row(motion: Motion) -> tuple[str, ...]:
    planned = motion.planned()
    return (
        motion.words,
        motion.span,
        *(_printed_uncertainty(planned, name) for name in SENSOR),
        motion.remark,
    )


def _printed_uncertainty(planned: Plan, name: str) -> str:
    """Return the relative standard uncertainty of a parameter, in percent."""
    parameter = planned.parameters.get(name)
    if parameter is None:
        return "–"
    u = parameter.standard_uncertainty
    if u is None or u > NOTHING * abs(parameter.value):
        return "not determined"
    return f"{plain(100.0 * u / abs(parameter.value), 2)} %"
