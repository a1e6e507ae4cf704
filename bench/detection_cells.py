"""The cells of the detection study: defects that the fitted model lacks, excitation, and noise."""

from __future__ import annotations

import functools
import itertools
import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2

from vibrident import identify
from vibrident.data.records import Calibration
from vibrident.fit.response.verdict import REJECTION
from vibrident.physics.simulation import SENSORS, simulate, with_noise

FITTED = "accelerometer"
SAMPLES = 4000
SEED = 2
_PAPER = dict(SENSORS["paper"].parameters)
#: A micromechanical sensor: far below its resonance, except for the boxcar.
_MEMS = {"sensitivity": 0.1, "natural_frequency": 4000.0, "damping_ratio": 0.05}


@dataclass(frozen=True)
class Defect:
    """A property of the sensor that the fitted model lacks.

    Attributes:
        name: short name.
        title: what it is.
        model: the sensor's true model.
        sensor: its parameters without the defect.
        parameters: the defect's parameters, given its size.
        nominal: the size that must be detected.
        write: a size in words.
        band_hz: lowest and highest frequency of the sines; random and sweep go as far.
        rate_hz: samples per second.
    """

    name: str
    title: str
    model: str
    sensor: Mapping[str, float]
    parameters: Callable[[float], Mapping[str, float]]
    nominal: float
    write: Callable[[float], str]
    band_hz: tuple[float, float]
    rate_hz: float


_BAND = (30.0, 1000.0)
DEFECTS = {
    defect.name: defect
    for defect in (
        Defect(
            "mode2",
            "a second mode at 300 Hz, damping 0.02, of this gain",
            "accelerometer+mode2",
            _PAPER,
            lambda gain: {"mode2_frequency": 300.0, "mode2_damping": 0.02, "mode2_gain": gain},
            0.01,
            lambda gain: f"{100.0 * gain:.2g} %",
            _BAND,
            25_600.0,
        ),
        Defect(
            "delay",
            "a delay of the response",
            "accelerometer+delay",
            _PAPER,
            lambda delay: {"delay": delay},
            10e-6,
            lambda delay: f"{1e6 * delay:.2g} µs",
            _BAND,
            25_600.0,
        ),
        Defect(
            "cubic",
            "a spring with this third harmonic at 1 g, well below resonance",
            "accelerometer+cubic",
            _PAPER,
            # k3 A²/4 of the fundamental A, which is 1.02 V
            lambda third: {"cubic_stiffness": 4.0 * third / 1.02**2},
            0.01,
            lambda third: f"{100.0 * third:.2g} %",
            _BAND,
            25_600.0,
        ),
        Defect(
            "boxcar",
            "an average over this window, resonance at 4 kHz",
            "accelerometer+boxcar",
            _MEMS,
            lambda length: {"boxcar_length": length},
            2e-3,
            lambda length: f"{1e3 * length:.2g} ms",
            (5.0, 250.0),
            4_000.0,
        ),
    )
}
EXCITATIONS = ("sine", "random", "sweep")
NOISES = (0.01, 0.001)
#: Sizes of the curves, over the one that the χ² test should detect in 95 of 100 runs; the first is
#: none.
CURVE_PARTS = (0.0, 0.5, 0.75, 1.0, 1.5)
DETECTION_RATE = 0.95
HALVINGS = 8  # halvings of the interval in which the size of 95 % lies: to a hundredth of a decade


@dataclass(frozen=True)
class Cell:
    """Cell of a defect, excitation and noise; ``part``: of the size of 95 %, None: nominal."""

    defect: str
    excitation: str
    noise: float
    part: float | None = None

    @property
    def name(self) -> str:
        """Return the name for files and the command line."""
        size = "nominal" if self.part is None else f"{self.part:g}"
        return f"{self.defect}/{self.excitation}/{self.noise:g}/{size}"

    def runs(self, requested: int) -> int:
        """Return the requested number."""
        return requested

    @property
    def size(self) -> float:
        """Return the name of the defect."""
        nominal = DEFECTS[self.defect].nominal
        return (
            nominal
            if self.part is None
            else self.part * nominal * sized(self.defect, self.excitation, self.noise)[0]
        )


_ROWS = tuple(itertools.product(DEFECTS, EXCITATIONS, NOISES))
NOMINAL = tuple(Cell(*row) for row in _ROWS)
#: Curves where 1 % of noise makes the defect hard to see; the sensors without a defect, at both
#: noises.
CURVES = tuple(
    Cell(*row, part)
    for row, part in itertools.product(_ROWS, CURVE_PARTS)
    if (row[2] == NOISES[0] and row[1] != "sweep")
    or (part == 0.0 and row[0] in ("mode2", "boxcar"))
)
CELLS = (*NOMINAL, *CURVES)


@functools.lru_cache(maxsize=8)
def truth(name: str, excitation: str, size: float) -> Calibration:
    """Return the calibration without noise."""
    defect = DEFECTS[name]
    model = defect.model
    parameters = {**defect.sensor, **defect.parameters(size)}
    if size == 0.0:
        model = FITTED
        parameters = dict(defect.sensor)
    low, high = defect.band_hz
    shape = {
        "sampling_rate_hz": defect.rate_hz,
        "samples": SAMPLES,
        "amplitude": 9.80665,
        "seed": SEED,
    }
    if excitation == "sine":
        tones = np.geomspace(low, high, 12).tolist()
        return simulate((model, parameters), "sine", frequencies_hz=tones, start="steady", **shape)
    return simulate(
        (model, parameters),
        excitation,
        frequencies_hz=[low, high],
        repeats=2,
        start="rest",
        **shape,
    )


def look(
    name: str, excitation: str, size: float, noise: float, run: int
) -> tuple[tuple[str, ...], float, int]:
    """Warnings, χ² and degrees of freedom of one run of the model that lacks the defect."""
    calibration = with_noise(truth(name, excitation, size), response_noise=noise, seed=_seed(run))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = identify(calibration, model=FITTED)
    degrees = result.fit.degrees_of_freedom
    return result.warning_codes, (result.fit.chi2_reduced or math.nan) * degrees, degrees


def _seed(run: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(SEED, spawn_key=(run,))


@functools.lru_cache(maxsize=64)
def sized(name: str, excitation: str, noise: float) -> tuple[float, float]:
    """Return the size that a χ² test should detect in 95 of 100 runs, and the nominal's λ.

    λ² is what the defect adds to χ²: the squared misfit that is left after the best fit, over the
    noise. It grows with the size, and the size sought is where it has the value that is needed. (0,
    λ) where the nominal defect adds less.
    """
    strength, degrees, clear = _added(name, excitation, noise, 1.0)
    if not clear or strength < needed(degrees):
        return 0.0, strength
    # Of the size's decimal logarithm; how λ goes with the size depends on the defect.
    low = -4.0
    high = 0.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        gain, degrees, _ = _added(name, excitation, noise, 10.0**middle)
        low, high = (low, middle) if gain > needed(degrees) else (middle, high)
    return 10.0 ** (0.5 * (low + high)), strength


def _added(
    name: str, excitation: str, noise: float, nominal_fraction: float
) -> tuple[float, float, bool]:
    """Return λ of a part of the nominal size, degrees of freedom, and whether λ is clear."""
    looks = [
        look(name, excitation, nominal_fraction * DEFECTS[name].nominal, noise, 1_000_000 + run)
        for run in range(4)
    ]
    degrees = float(np.mean([look_[2] for look_ in looks]))
    added = float(np.mean([look_[1] for look_ in looks])) - degrees
    return math.sqrt(max(added, 0.0)), degrees, added > 3.0 * math.sqrt(0.5 * degrees)


def needed(degrees: float) -> float:
    """λ at which the χ² test with these degrees of freedom rejects in 95 of 100 cases."""
    limit = float(chi2.isf(REJECTION, degrees))
    return math.sqrt(
        brentq(
            lambda power: float(ncx2.sf(limit, degrees, power)) - DETECTION_RATE,
            1e-6,
            10.0 * limit + 1e3,
        )
    )


def block(name: str, runs: range) -> dict:
    """Some runs of a cell: the warnings of each, its χ² and degrees of freedom."""
    cell = next(cell for cell in CELLS if cell.name == name)
    looks = [look(cell.defect, cell.excitation, cell.size, cell.noise, run) for run in runs]
    return {
        "size": cell.size,
        "flags": [list(flags) for flags, _, _ in looks],
        "chi2": [value for _, value, _ in looks],
        "degrees": [degrees for _, _, degrees in looks],
    }
