"""The network against the exact response: two programs that share the transfer function alone."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from vibrident.fit.problem.bin_problem import BinProblem
from vibrident.fit.problem.coordinates import Coordinates
from vibrident.physics.discretisation import method
from vibrident.physics.models import parse
from vibrident.physics.simulation import SENSORS, simulate

PAPER = SENSORS["paper"]
#: Samples left out at either end: the interpolation needs 40.
ENDS = 60


def network_error(calibration, name, parameters):
    """Largest deviation of the network with the true parameters, relative to each record's largest response."""
    model, start = parse(calibration.model), dict(parameters)
    problem = BinProblem.build(calibration.records, model, method(name), calibration.quantity, start)
    coordinates = Coordinates.at(model, start, (10.0, 1000.0))
    predicted = problem.predict(coordinates, coordinates.first)
    worst = 0.0
    for record, response in zip(calibration.records, predicted, strict=True):
        inner = slice(ENDS, -ENDS)
        assert np.all(np.isfinite(response[inner]))
        worst = max(worst, np.max(np.abs(response - record.response)[inner]) / np.max(np.abs(record.response)))
    return worst


@pytest.mark.parametrize("rate", [2560.0, 16000.0, 51200.0, 1e6])
@pytest.mark.parametrize("start", ["rest", "steady"])
def test_the_band_limited_network_is_the_truth(rate, start):
    """Sines from 10 to 1000 Hz with felt noise up to 0.4 fs at 20 dB, below 1e-6 at every rate."""
    calibration = simulate(
        frequencies_hz=[10.0, 100.0, 630.0, 1000.0],
        sampling_rate_hz=rate,
        samples=4000,
        excitation_snr_db=20.0,
        start=start,
        seed=1,
    )
    assert network_error(calibration, "bandlimited", PAPER.parameters) < 1e-6


def test_the_band_limited_network_with_a_delay():
    p = PAPER.parameters | {"delay": 43.21e-6}
    calibration = simulate(
        ("accelerometer+delay", p), frequencies_hz=[100.0, 1000.0], samples=4000, excitation_snr_db=20.0
    )
    assert network_error(calibration, "bandlimited", p) < 1e-6


@dataclass(frozen=True)
class Held:
    """What a converter without a filter puts out: every sample held until the next."""

    samples: np.ndarray
    rate_hz: float
    kind: str = "random"
    words: str = "held samples"
    highest_hz: float = 0.0
    breaks_s: tuple = field(default=())

    def value(self, time_s):
        index = np.floor(np.asarray(time_s) * self.rate_hz + 1e-9).astype(int)
        inside = (index >= 0) & (index < self.samples.size)
        return np.where(inside, self.samples[np.clip(index, 0, self.samples.size - 1)], 0.0)


def test_zoh_is_exact_for_a_held_signal(rng):
    held = Held(rng.standard_normal(2000), 16000.0)
    calibration = simulate(excitation=held, sampling_rate_hz=16000.0, samples=2000)
    assert network_error(calibration, "zoh", PAPER.parameters) < 1e-10
    assert network_error(calibration, "foh", PAPER.parameters) > 1e-3  # it is the wrong assumption
