"""A motion that goes on is said to be none that dies away; one that does is never said so, however slow or weak."""

from __future__ import annotations

import numpy as np
import pytest

from vibrident.base.errors import InputError
from vibrident.data.records import FloatArray, Record
from vibrident.data.screening.decays import is_sustained
from vibrident.data.screening.quality import without_steady_decays

N = 8000
T = np.arange(N)


def tones(rng: np.random.Generator, count: int) -> FloatArray:
    """Steady tones far enough apart not to beat slowly."""
    angles = np.exp(rng.uniform(np.log(0.06), np.log(0.15))) * 2.0 ** np.arange(count)
    return np.sum([np.sin(angle * T + rng.uniform(0.0, 6.3)) for angle in angles], axis=0)


@pytest.mark.parametrize("count", [0, 1, 2, 4])
@pytest.mark.parametrize("noise", [0.0, 0.01, 1.0])
def test_steady_tones_and_noise_go_on(count: int, noise: float, rng: np.random.Generator) -> None:
    said = 0
    for _ in range(20):
        values = tones(rng, count) + noise * rng.standard_normal(N) if count else rng.standard_normal(N)
        said += is_sustained(values + 3.0, np.ones(N, dtype=bool))
    assert said >= 19


@pytest.mark.parametrize("growth", [3.0, 5.0])
def test_a_motion_that_grows_goes_on(growth: float, rng: np.random.Generator) -> None:
    """It was fitted for eighty seconds, at a damping of zero."""
    said = 0
    for _ in range(20):
        values = np.exp(growth * T / N) * tones(rng, 1) + 0.01 * rng.standard_normal(N)
        said += is_sustained(values, np.ones(N, dtype=bool))
    assert said >= 14


SWELLING = {
    "beats": lambda rng: np.sin(0.03 * T) + 0.8 * np.sin(0.032 * T + rng.uniform(0.0, 6.3)),
    "a modulated tone": lambda rng: np.sin(0.08 * T) * (1.0 + 0.4 * np.cos(0.002 * T + rng.uniform(0.0, 6.3))),
    "noise in a band": lambda rng: np.convolve(rng.standard_normal(N + 399), np.sin(np.arange(400) * 0.1), "valid"),
}


@pytest.mark.parametrize("motion", SWELLING.values(), ids=SWELLING)
def test_what_swells_again_goes_on(motion, rng: np.random.Generator) -> None:
    """Each was an adequate free decay of damping zero, or fitted for half a minute."""
    said = 0
    for _ in range(20):
        said += is_sustained(motion(rng) + 0.01 * rng.standard_normal(N), np.ones(N, dtype=bool))
    assert said >= 17


def test_two_modes_that_beat_as_they_die_away_do_not_go_on(rng: np.random.Generator) -> None:
    for _ in range(20):
        beating = np.sin(0.3 * T) + np.sin(0.305 * T + rng.uniform(0.0, 6.3))
        assert not is_sustained(np.exp(-2.5 * T / N) * beating + 1e-3 * rng.standard_normal(N), np.ones(N, dtype=bool))


@pytest.mark.parametrize("lives", [0.01, 0.1, 1.0, 10.0])
@pytest.mark.parametrize("noise", [1e-4, 0.1])
@pytest.mark.parametrize("begins", [0, 1500])
def test_what_dies_away_does_not_go_on(lives: float, noise: float, begins: int, rng: np.random.Generator) -> None:
    """Amplitudes that fall by e within 1 % to ten times the record, released at once or later."""
    for _ in range(20):
        since = np.maximum(T - begins, 0)
        free = np.exp(-since / (lives * N)) * np.sin(rng.uniform(0.05, 2.0) * T + rng.uniform(0.0, 6.3))
        values = np.where(begins <= T, free, 0.0) + noise * rng.standard_normal(N)
        assert not is_sustained(values, np.ones(N, dtype=bool))


def test_a_weak_line_that_dies_away_under_noise_does_not_go_on(rng: np.random.Generator) -> None:
    """The power of all is noise alone: the line's shows it."""
    for _ in range(20):
        free = np.exp(-2.0 * T / N) * np.sin(0.3 * T)
        assert not is_sustained(free + 1.5 * rng.standard_normal(N), np.ones(N, dtype=bool))


def test_a_record_that_goes_on_is_left_out_and_said(rng: np.random.Generator) -> None:
    steady = Record("steady", None, tones(rng, 2) + 0.1 * rng.standard_normal(N), 1e3, "decay")
    free = Record("free", None, np.exp(-T / 800.0) * np.sin(0.3 * T), 1e3, "decay")
    kept, (said,) = without_steady_decays([steady, free])
    assert [record.name for record in kept] == ["free"]
    assert "does not die away" in said.message
    with pytest.raises(InputError, match="does not die away"):
        without_steady_decays([steady])
