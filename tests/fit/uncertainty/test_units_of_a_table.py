"""A table read in other units than it is written in: said where the data tell, and of no table that is right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import vibrident
from vibrident.data.records import Calibration, ResponseTable
from vibrident.physics.models import parse

TRUTH = {"sensitivity": 0.1, "natural_frequency": 630.0, "damping_ratio": 0.2}
THIRD_OCTAVES = 10.0 ** (np.arange(17, 34) / 10.0)


def table(seed: int = 1, *, stated: bool = True, noise: float = 0.003, **truth: float) -> ResponseTable:
    rng = np.random.default_rng(seed)
    response = parse("accelerometer").frequency_response(TRUTH | truth, THIRD_OCTAVES)
    magnitude = np.abs(response) * (1.0 + noise * rng.standard_normal(17))
    phase = np.angle(response) + noise * rng.standard_normal(17)
    u = (noise * magnitude, np.full(17, noise)) if stated else (None, None)
    return ResponseTable(THIRD_OCTAVES, magnitude, phase, *u)


def said(made: ResponseTable, model: str = "accelerometer") -> str:
    result = vibrident.identify(Calibration(table=made, model=model))
    return " ".join(w.message for w in result.warnings if w.code == "units_suspect")


def turned(made: ResponseTable, factor: float) -> ResponseTable:
    u = made.phase_uncertainty_rad
    return replace(
        made, phase_rad=factor * made.phase_rad, phase_uncertainty_rad=None if u is None else abs(factor) * u
    )


@pytest.mark.parametrize("stated", [True, False], ids=["stated", "not stated"])
def test_phases_in_another_unit_are_named_the_right_way_round(stated: bool) -> None:
    assert 'is phase_unit "rad" right?' in said(turned(table(stated=stated), 180.0 / np.pi))
    assert 'is phase_unit "deg" right?' in said(turned(table(stated=stated), np.pi / 180.0))


def test_phases_of_the_other_sign_are_named() -> None:
    assert "sign" in said(turned(table(), -1.0))


def test_phases_that_no_model_explains_are_not_read_with_an_uncertainty_of_a_turn() -> None:
    """Degrees read as radians, of a sensor whose delay the model does not have: better no advice than a wrong one."""
    made = table()
    late = replace(made, phase_rad=made.phase_rad - 2.0 * np.pi * THIRD_OCTAVES * 3e-4)
    assert 'is phase_unit "deg" right?' not in said(turned(late, 180.0 / np.pi))


@pytest.mark.parametrize("stated", [True, False], ids=["stated", "not stated"])
def test_decibels_in_place_of_the_ratio_are_named(stated: bool) -> None:
    made = table(stated=stated, sensitivity=100.0)
    level = 20.0 * np.log10(made.magnitude)
    u = np.full(17, 0.003 * 20.0 / np.log(10.0)) if stated else None
    assert "decibels" in said(replace(made, magnitude=level, magnitude_uncertainty=u))


@pytest.mark.parametrize("stated", [True, False], ids=["stated", "not stated"])
def test_power_in_place_of_the_magnitude_is_named(stated: bool) -> None:
    made = table(stated=stated)
    power = made.magnitude**2
    assert "of power?" in said(replace(made, magnitude=power, magnitude_uncertainty=0.006 * power if stated else None))


def test_angular_frequencies_of_the_one_third_octave_series_are_named() -> None:
    made = table()
    assert "rad/s" in said(replace(made, frequency_hz=2.0 * np.pi * made.frequency_hz))


@pytest.mark.parametrize("stated", [True, False], ids=["stated", "not stated"])
@pytest.mark.draws(5, 15)
def test_tables_that_are_right_are_not_suspect(stated: bool, draws: int) -> None:
    for seed in range(draws):
        assert said(table(seed, stated=stated, noise=0.01)) == ""
    assert said(table(stated=stated, natural_frequency=2e4)) == ""


@pytest.mark.draws(10, 60)
def test_phases_near_zero_that_scatter_are_no_degrees(draws: int) -> None:
    """Far below resonance phases are noise: 57 times smaller they are nearer to any model (3 of 4 were suspect)."""
    hz = np.geomspace(10.0, 100.0, 6)
    response = parse("accelerometer").frequency_response(TRUTH | {"natural_frequency": 5000.0}, hz)
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        scatter = [3e-3, 1e-2][seed % 2]
        phase = np.angle(response) + scatter * rng.standard_normal(hz.size)
        assert said(ResponseTable(hz, np.abs(response) * (1.0 + 1e-3 * rng.standard_normal(hz.size)), phase)) == ""


@pytest.mark.parametrize("unit", [1e-9, 1e-3, 1.0])
def test_small_magnitudes_without_phase_are_no_decibels(unit):
    """As levels they would all be nearly 0 dB, which any level response fits."""
    made = table(stated=False, sensitivity=unit * TRUTH["sensitivity"])
    few = replace(made, frequency_hz=THIRD_OCTAVES[::3], magnitude=made.magnitude[::3], phase_rad=None)
    assert said(few) == ""


def test_one_point_tells_no_sign():
    """Three parameters meet two values: nothing is known of the gain's sign."""
    made = table()
    point = {name: getattr(made, name)[:1] for name in ("frequency_hz", "magnitude", "phase_rad")}
    point |= {name: getattr(made, name)[:1] for name in ("magnitude_uncertainty", "phase_uncertainty_rad")}
    point["phase_rad"] = point["phase_rad"] + np.pi
    result = vibrident.identify(Calibration(table=ResponseTable(**point), model="accelerometer"))
    assert "polarity" not in result.warning_codes
