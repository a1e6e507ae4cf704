"""The reference behind a factor that is not rational, and the factor's parameters trained by any motion."""

import numpy as np
import pytest
from numpy import fft

import vibrident
from vibrident.data.records import Calibration, Excitation, Quantity, Record
from vibrident.fit.group.network import evaluate
from vibrident.fit.problem.band import Band
from vibrident.fit.problem.bin_problem import BinProblem
from vibrident.physics.discretisation import method
from vibrident.physics.models import parse

RATE_HZ = 10e3
SAMPLES = 4000
TRUTH = {"sensitivity": 0.1, "natural_frequency": 600.0, "damping_ratio": 0.1, "boxcar_length": 6.3e-4}
MODEL = "accelerometer+boxcar"
DIVIDED = {"acceleration": 0, "velocity": 1, "displacement": 2}


def motion_of(kind: str, frequency_hz: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Bins of an acceleration below 2 kHz."""
    if kind == "random":
        bins = rng.normal(size=(2, frequency_hz.size))
        return (bins[0] + 1j * bins[1]) * ((frequency_hz > 20.0) & (frequency_hz < 2000.0))
    if kind == "shock":
        late = np.exp(-2j * np.pi * frequency_hz * 1.7 * SAMPLES / RATE_HZ)
        return late * np.exp(-((frequency_hz / 700.0) ** 2))
    bins = np.zeros(frequency_hz.size, dtype=complex)
    places = np.arange(1, 40) * (frequency_hz.size // 100)
    bins[places] = np.exp(2j * np.pi * rng.uniform(size=places.size))
    return bins


def recorded(kind: Excitation, quantity: Quantity, noise: float, seed: int) -> Calibration:
    """A quarter of a motion that recurs later, so that the record's ends do not meet."""
    rng = np.random.default_rng(seed)
    whole = 4 * SAMPLES
    frequency_hz = fft.rfftfreq(whole, 1.0 / RATE_HZ)
    motion = motion_of(kind, frequency_hz, rng)
    s = 2j * np.pi * np.maximum(frequency_hz, frequency_hz[1])
    response = fft.irfft(motion * parse(MODEL).frequency_response(TRUTH, frequency_hz), whole)
    motion[0] = 0.0
    reference = fft.irfft(motion / s ** DIVIDED[quantity], whole)
    part = slice(3 * SAMPLES // 2, 3 * SAMPLES // 2 + SAMPLES)
    size = np.std(response[part])
    heard = response[part] + noise * size * rng.standard_normal(SAMPLES)
    return Calibration((Record(kind, reference[part], heard, RATE_HZ, kind),), model=MODEL, quantity=quantity)


def test_the_network_behind_an_average_gives_its_response() -> None:
    """Of random motion that does not recur: within the error of the interpolation."""
    given = recorded("random", "acceleration", 0.0, 1)
    problem = BinProblem.build(given.records, parse(MODEL), method("bandlimited"), "acceleration", TRUTH)
    (group,) = Band(problem, np.inf).groups
    steps = Band(problem, np.inf).steps(TRUTH, slopes=False)
    assert steps is not None
    rows = evaluate(group, steps[group.step], group.grid.counts[None])
    left = np.sum(group.grid.counts * np.abs(rows.residual) ** 2)
    assert left < 1e-12 * np.sum(group.grid.counts * np.abs(group.response) ** 2)


def test_its_slope_is_that_of_inputs_made_anew() -> None:
    """The response's derivative with the length: by central differences of networks over the same samples."""
    given = recorded("random", "acceleration", 1e-3, 2)
    model = parse(MODEL)
    band = Band(BinProblem.build(given.records, model, method("bandlimited"), "acceleration", TRUTH), np.inf)

    def rows_at(length: float, *, slopes: bool):
        values = TRUTH | {"boxcar_length": length}
        here = band.at_factors_of(values)
        (group,) = here.groups
        steps = here.steps(values, slopes=slopes)
        assert steps is not None
        return evaluate(group, steps[group.step], group.grid.counts[None])

    length = TRUTH["boxcar_length"]
    change = 1e-4 * length
    behind, ahead = (rows_at(length + side * change, slopes=False).residual for side in (-1.0, 1.0))
    expected = (behind - ahead) / (2.0 * change)
    place = model.parameter_names.index("boxcar_length")
    slope = rows_at(length, slopes=True).jacobian[:, place]
    counted = band.groups[0].grid.counts > 0.0
    np.testing.assert_allclose(slope[:, counted], expected[:, counted], atol=1e-6 * np.max(np.abs(expected)))


@pytest.mark.parametrize("quantity", list(DIVIDED))
@pytest.mark.parametrize("kind", ["random", "shock", "multisine"])
@pytest.mark.quick("shock-acceleration", "random-displacement", "multisine-velocity")
def test_a_digital_average_is_found_by_any_motion(kind: Excitation, quantity: Quantity) -> None:
    result = vibrident.identify(recorded(kind, quantity, 1e-3, 3))
    assert result.estimator == "ipnn"
    assert not set(result.warning_codes) - {"weakly_determined"}
    for name, true in TRUTH.items():
        found = result.parameters[name]
        assert found.standard_uncertainty is not None
        assert abs(found.value - true) < 4.0 * found.standard_uncertainty, name
        assert found.standard_uncertainty < 0.02 * true, name
