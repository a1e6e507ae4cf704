"""Tabulated responses: with and without uncertainties and phase, few points, wrong units."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import partial

import numpy as np

from bench.adversary.recording import setting
from bench.adversary.trial import Cases, Trial, truth
from vibrident import Calibration, ResponseTable

SENSORS = (
    "in-light",
    "in-damped",
    "edge-light",
    "above-light",
    "far-light",
    "in-light+delay",
    "in-damped+highpass",
    "in-light+mode2=0.1",
    "far-light+boxcar",
    "pickup-below-damped",
)
POINTS = (1, 2, 3, 4, 6, 10, 30, 100)
WRONG = {
    "phase in degrees": lambda f, m, p: (f, m, np.degrees(p)),
    "phase in radians said to be degrees": lambda f, m, p: (f, m, np.radians(p)),
    "phase of the other sign": lambda f, m, p: (f, m, -p),
    "frequency in rad/s": lambda f, m, p: (2.0 * np.pi * f, m, p),
    "magnitude in dB": lambda f, m, p: (f, 20.0 * np.log10(m) - 20.0 * np.log10(m).min() + 1.0, p),
    "per velocity": lambda f, m, p: (f, m * 2.0 * np.pi * f, p + 0.5 * np.pi),
    "power for magnitude": lambda f, m, p: (f, m**2 / m.mean(), p),
    "one point off by 10 %": lambda f, m, p: (
        f,
        np.where(np.arange(f.size) == f.size // 2, 1.1 * m, m),
        p,
    ),
    "one phase off by 2π/3": lambda f, m, p: (
        f,
        m,
        np.where(np.arange(f.size) == f.size // 2, p + 2.1, p),
    ),
}


def cases() -> Cases:
    """Return the names and makers."""
    for sensor, points, stated, phase in itertools.product(
        SENSORS, POINTS, (True, False), (True, False)
    ):
        if (points > 10 and not stated and not phase) or (points == 100 and not stated):
            continue
        uncertain = "u" if stated else "no u"
        name = f"{sensor}/{points} points, {uncertain}, {'phase' if phase else 'no phase'}"
        yield name, partial(_maker, sensor, points, stated, phase, "")
    for sensor, wrong, stated in itertools.product(
        ("in-light", "above-light", "far-light", "in-damped"), WRONG, (True, False)
    ):
        name = f"{wrong}/{sensor}/30 points, {'u' if stated else 'no u'}"
        yield name, partial(_maker, sensor, 30, stated, True, wrong)


def _maker(
    sensor: str, count: int, stated: bool, phase: bool, wrong: str, rng: np.random.Generator
) -> Trial:
    conditions = setting(sensor, rng)
    points = count
    f = np.geomspace(*conditions.band_hz, points)
    # Of these it can be seen: the laboratory's frequencies are thirds of an octave.
    if "rad/s" in wrong:
        f = np.unique(10.0 ** (np.rint(10.0 * np.log10(f)) / 10.0))
        points = f.size
    response = conditions.sensor.transfer(f)
    u = 10.0 ** rng.uniform(-4.0, -2.0)
    magnitude = np.abs(response) * (1.0 + u * rng.normal(size=points))
    angle = np.unwrap(np.angle(response)) + u * rng.normal(size=points)
    model = conditions.sensor.model
    f, m, p = WRONG[wrong](f, magnitude, angle) if wrong else (f, magnitude, angle)
    table = {
        "magnitude_uncertainty": u * np.abs(m),
        "phase_uncertainty_rad": np.full(points, u) if phase else None,
    }

    def read_table() -> Calibration:
        columns = {"frequency_hz": f, "magnitude": m, "phase_rad": p if phase else None}
        return Calibration(table=ResponseTable(**columns, **(table if stated else {})), model=model)

    cause = wrong and f"table: {wrong}"
    few = points * (2 if phase else 1) <= len(conditions.sensor.parameters)
    allowed = {"lack_of_fit", "weakly_determined", "at_bound"} if few else set()
    trial = Trial(
        read_table,
        model,
        truth(conditions.sensor),
        cause=cause,
        allowed=frozenset(allowed),
        strange=few,
    )
    ambiguous = not phase and not wrong  # a table without phase cannot give the sign
    return replace(trial, truth=_unsigned(trial.truth)) if ambiguous else trial


def _unsigned(values):
    names = ("sensitivity", "generator_constant", "conversion_coefficient")
    return {
        name: abs(value) if name in names else value
        for name, value in values.items()
        if name != "delay"
    }
