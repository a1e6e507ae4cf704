"""Coverage of what laboratories state: repeats with remounting, temperature coefficients, the matrix of three axes.

    python -m bench.laboratory [runs] [study ...]

Each study is simulated so many times (500), and the share of 95 % intervals that hold the true value is printed.
"""

from __future__ import annotations

import sys
import time

import numpy as np

import vibrident
from vibrident.data.records import Calibration, Circumstances, Record

RATE, SAMPLES = 8192.0, 512
FREQUENCIES = (160.0, 480.0, 800.0, 960.0)
TRUE = {"sensitivity": 0.1, "natural_frequency": 900.0, "damping_ratio": 0.05}
NOISE = 2e-4


def response(frequency, sensitivity, natural_frequency, damping_ratio):
    ratio = frequency / natural_frequency
    return sensitivity / (1.0 - ratio**2 + 2j * damping_ratio * ratio)


def records(rng, values, circumstances, frequencies=FREQUENCIES):
    """Sine records of a sensor with these parameters."""
    time_s, found = np.arange(SAMPLES) / RATE, []
    for f in frequencies:
        f = round(f * SAMPLES / RATE) * RATE / SAMPLES
        phase = rng.uniform(0, 2 * np.pi)
        a = 10.0 * np.cos(2 * np.pi * f * time_s + phase)
        v = np.real(10.0 * response(f, **values) * np.exp(1j * (2 * np.pi * f * time_s + phase)))
        v = v + NOISE * rng.standard_normal(SAMPLES)
        name = " ".join(str(part) for part in (f"{f:g} Hz", *vars(circumstances).values()) if part not in ("", None))
        found.append(Record(name, a, v, RATE, "sine", f, circumstances=circumstances))
    return found


def inside(parameter, true):
    low, high = parameter.interval_95
    return low <= true <= high


def repeats(rng, mountings=4, runs=2):
    """Parameters of a sensor that was mounted anew several times, each a little different."""
    made = []
    for m in range(mountings):
        drawn = {name: value * (1 + 1e-3 * rng.standard_normal()) for name, value in TRUE.items()}
        for r in range(runs):
            own = {name: value * (1 + 2e-4 * rng.standard_normal()) for name, value in drawn.items()}
            made += records(rng, own, Circumstances(run=str(r), mounting=str(m)))
    result = vibrident.identify(Calibration(tuple(made)), "accelerometer")
    return {name: inside(result.parameters[name], true) for name, true in TRUE.items()}


COEFFICIENTS = {"sensitivity": -2e-4, "natural_frequency": -5e-5, "damping_ratio": 1e-3}


def temperatures(rng, points=(-10.0, 23.0, 50.0, 80.0)):
    """Coefficients of a sensor that changes with temperature."""
    made = []
    for t in points:
        own = {name: value * (1 + COEFFICIENTS[name] * (t - 23.0)) for name, value in TRUE.items()}
        made += records(rng, own, Circumstances(temperature_c=t))
    result = vibrident.identify(Calibration(tuple(made)), "accelerometer")
    found = result.settings["temperature"]["coefficients"]
    return {
        name: found[name]["interval_95"][0] <= true <= found[name]["interval_95"][1]
        for name, true in COEFFICIENTS.items()
    }


STUDIES = {"repeats": repeats, "temperature": temperatures}


def coverage(name: str, count: int, seed: int = 1) -> dict[str, float]:
    """Share of the intervals that hold the true value, by what they are of."""
    rng = np.random.default_rng(seed)
    found = [STUDIES[name](rng) for _ in range(count)]
    return {key: float(np.mean([one[key] for one in found])) for key in found[0]}


def main(count: int, names: list[str]) -> None:
    for name in names or STUDIES:
        begin = time.perf_counter()
        shares = coverage(name, count)
        said = ", ".join(f"{key} {100 * share:.1f} %" for key, share in shares.items())
        seconds = time.perf_counter() - begin
        print(
            f"{name}: {count} simulated, 95 % intervals that hold the true value: {said} ({seconds:.0f} s)", flush=True
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 500, sys.argv[2:])
