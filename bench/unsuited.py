"""Time and outcome of `identify` for data that do not suit the model, against data that do.

One record of random motion each, twelve ways of not suiting. Ratios of computing times taken in
turn in one process.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from tests.support.random_record import RATE_HZ, SAMPLES, Real, answered

from bench.figures import Figure, Options, Section, steps
from vibrident import Calibration, Record, VibridentError, identify

NOISE = 1e-3
GAIN = 0.1
NATURAL_HZ = 1200.0
DAMPING = 0.2
#: Most that data which do not suit may take, in units of those that do.
MAX_TIME_RATIO = 3.0
#: Rounds of runs.
ROUNDS = 8


def _s(hz: Real) -> NDArray[np.complex128]:
    return 2j * np.pi * hz


def _sensor(
    hz: Real, natural_hz: float = NATURAL_HZ, damping: float = DAMPING
) -> NDArray[np.complex128]:
    w = 2.0 * np.pi * natural_hz
    return np.asarray(GAIN * w**2 / (_s(hz) ** 2 + 2.0 * damping * w * _s(hz) + w**2))


def _channels(
    transfer: Callable[[Real], NDArray[np.complex128]],
    rng: np.random.Generator,
    noise: float = NOISE,
) -> tuple[Real, Real]:
    """Reference of rms one, and response of rms GAIN with noise."""
    u, y = answered(transfer, rng)
    return u / np.std(u), y / np.std(y) * GAIN + noise * GAIN * rng.normal(size=SAMPLES)


def _calibration(u: Real, y: Real, quantity: str = "acceleration") -> Calibration:
    record = Record("random", u, y, RATE_HZ, "random")  # type: ignore[arg-type]
    return Calibration(
        records=(record,),
        model="accelerometer",
        quantity=quantity,  # type: ignore[arg-type]
    )


def suited(rng: np.random.Generator) -> Calibration:
    """Nothing is wrong."""
    return _calibration(*_channels(_sensor, rng))


def _delayed(rng: np.random.Generator) -> Calibration:
    return _calibration(*_channels(lambda hz: _sensor(hz) * np.exp(-_s(hz) * 1.7 / RATE_HZ), rng))


def _high_pass(rng: np.random.Generator) -> Calibration:
    return _calibration(
        *_channels(lambda hz: _sensor(hz) * _s(hz) / (_s(hz) + 2.0 * np.pi * 60.0), rng)
    )


def _second_mode(rng: np.random.Generator) -> Calibration:
    return _calibration(*_channels(lambda hz: _sensor(hz) + 0.1 * _sensor(hz, 2600.0, 0.03), rng))


def _wrong_quantity(rng: np.random.Generator) -> Calibration:
    return _calibration(*_channels(lambda hz: _sensor(hz) * _s(hz), rng))


def _wrong_pairing(rng: np.random.Generator) -> Calibration:
    return _calibration(_channels(_sensor, rng)[0], _channels(_sensor, rng)[1])


def _spring(rng: np.random.Generator) -> Calibration:
    u, y = _channels(_sensor, rng)
    lines = (
        np.fft.rfft((y / np.max(np.abs(y))) ** 3)
        * _sensor(np.fft.rfftfreq(SAMPLES, 1.0 / RATE_HZ))
        / GAIN
    )
    return _calibration(u, y - 0.05 * np.max(np.abs(y)) * np.fft.irfft(lines, SAMPLES))


def _saturated(rng: np.random.Generator) -> Calibration:
    u, y = _channels(_sensor, rng)
    top = 0.8 * np.max(np.abs(y))
    return _calibration(u, top * np.tanh(y / top))


def _half_clipped(rng: np.random.Generator) -> Calibration:
    u, y = _channels(_sensor, rng)
    return _calibration(u, np.minimum(y, 0.3 * np.max(y)))


def _noise_alone(rng: np.random.Generator) -> Calibration:
    return _calibration(_channels(_sensor, rng)[0], rng.normal(size=SAMPLES))


def _two_sensors(rng: np.random.Generator) -> Calibration:
    """Return two geophones side by side, one the reference of the other, far above resonance."""
    u, y = _channels(lambda hz: np.ones(hz.size, complex), rng)
    return _calibration(u + NOISE * rng.normal(size=SAMPLES), y, "velocity")


def _another_kind(rng: np.random.Generator) -> Calibration:
    """Return a low-pass of first order."""
    return _calibration(*_channels(lambda hz: GAIN / (1.0 + _s(hz) / (2.0 * np.pi * 300.0)), rng))


def _held(rng: np.random.Generator) -> Calibration:
    """Return an electrical resonator whose input is held between samples, up to half the rate."""
    from scipy.signal import cont2discrete, lfilter

    w = 2.0 * np.pi * NATURAL_HZ
    top, below, _ = cont2discrete(
        ([GAIN * w**2], [1.0, 2.0 * DAMPING * w, w**2]), 1.0 / RATE_HZ, "zoh"
    )
    u = rng.normal(size=SAMPLES)
    y = lfilter(top[0], below, u)
    least_ratios = _calibration(u, y + NOISE * np.std(y) * rng.normal(size=SAMPLES), "drive")
    return replace(least_ratios, reference_unit="V")


UNSUITED: Mapping[str, Callable[[np.random.Generator], Calibration]] = {
    "missing delay": _delayed,
    "missing high-pass": _high_pass,
    "missing second mode": _second_mode,
    "wrong quantity": _wrong_quantity,
    "wrong pairing": _wrong_pairing,
    "spring": _spring,
    "saturation": _saturated,
    "half clipped": _half_clipped,
    "noise alone": _noise_alone,
    "two sensors": _two_sensors,
    "another kind of sensor": _another_kind,
    "held input": _held,
}


def spent(make: Callable[[np.random.Generator], Calibration], seed: int = 1) -> tuple[float, str]:
    """Computing time of an identification, s, and what it said; a Python warning is an error."""
    calibration = make(np.random.default_rng(seed))
    begin = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            outcome = ", ".join(identify(calibration).warning_codes)
        except VibridentError as error:
            outcome = f"refused: {error}".splitlines()[0]
    return time.process_time() - begin, outcome


def measure(options: Options) -> Section:
    """Measure each kind over what suits, by the least of some runs of either, in turn."""
    spent(suited)  # loads what is loaded once
    least = dict.fromkeys(UNSUITED, np.inf)
    base = np.inf
    for _ in steps("unsuited", range(1 if options.quick else ROUNDS)):
        base = min(base, spent(suited)[0])
        least = {name: min(least[name], spent(make)[0]) for name, make in UNSUITED.items()}
    least_ratios = {name: least[name] / base for name in least}
    figures = (Figure("over data that suit", least_ratios, high=MAX_TIME_RATIO),)
    return Section("unsuited", f"Data that do not suit the model, {SAMPLES} samples", figures)
