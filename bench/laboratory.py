"""Coverage of the statements of laboratories: remounting, temperature, matrices of three axes.

    python -m bench.laboratory [runs] [study ...]

Each study is simulated so many times (500), and the share of 95 % intervals that hold the true
value is printed.
"""

from __future__ import annotations

import sys
import time

import numpy as np

import vibrident
from vibrident.data.io.axes_file import AxesCalibration
from vibrident.data.records import Calibration, Circumstances, Record
from vibrident.use.triaxial import sensitivity_matrix

RATE_HZ = 8192.0
SAMPLES = 512
FREQUENCIES_HZ = (160.0, 480.0, 800.0, 960.0)
TRUE = {"sensitivity": 0.1, "natural_frequency": 900.0, "damping_ratio": 0.05}
NOISE = 2e-4


def response(frequency, sensitivity, natural_frequency, damping_ratio):
    ratio = frequency / natural_frequency
    return sensitivity / (1.0 - ratio**2 + 2j * damping_ratio * ratio)


def records(rng, values, circumstances, frequencies=FREQUENCIES_HZ):
    """Sine records of a sensor with these parameters."""
    time_s = np.arange(SAMPLES) / RATE_HZ
    records_ = []
    for f in frequencies:
        f = round(f * SAMPLES / RATE_HZ) * RATE_HZ / SAMPLES
        phase = rng.uniform(0, 2 * np.pi)
        a = 10.0 * np.cos(2 * np.pi * f * time_s + phase)
        v = np.real(10.0 * response(f, **values) * np.exp(1j * (2 * np.pi * f * time_s + phase)))
        v = v + NOISE * rng.standard_normal(SAMPLES)
        name = " ".join(
            str(text)
            for text in (f"{f:g} Hz", *vars(circumstances).values())
            if text not in ("", None)
        )
        records_.append(Record(name, a, v, RATE_HZ, "sine", f, circumstances=circumstances))
    return records_


def inside(parameter, true):
    low, high = parameter.interval_95
    return low <= true <= high


def repeats(rng, mountings=4, runs=2):
    """Return the parameters of a sensor mounted anew several times, each a little different."""
    records_ = []
    for m in range(mountings):
        drawn = {name: value * (1 + 1e-3 * rng.standard_normal()) for name, value in TRUE.items()}
        for r in range(runs):
            parameters = {
                name: value * (1 + 2e-4 * rng.standard_normal()) for name, value in drawn.items()
            }
            records_ += records(rng, parameters, Circumstances(run=str(r), mounting=str(m)))
    result = vibrident.identify(Calibration(tuple(records_)), "accelerometer")
    return {name: inside(result.parameters[name], true) for name, true in TRUE.items()}


COEFFICIENTS = {"sensitivity": -2e-4, "natural_frequency": -5e-5, "damping_ratio": 1e-3}


def temperatures(rng, points=(-10.0, 23.0, 50.0, 80.0)):
    """Coefficients of a sensor that changes with temperature."""
    records_ = []
    for t in points:
        parameters = {
            name: value * (1 + COEFFICIENTS[name] * (t - 23.0)) for name, value in TRUE.items()
        }
        records_ += records(rng, parameters, Circumstances(temperature_c=t))
    result = vibrident.identify(Calibration(tuple(records_)), "accelerometer")
    coefficients = result.settings["temperature"]["coefficients"]
    return {
        name: coefficients[name]["interval_95"][0] <= true <= coefficients[name]["interval_95"][1]
        for name, true in COEFFICIENTS.items()
    }


MATRIX = np.array([[1.0, 0.012, -0.007], [0.004, 0.9, 0.02], [-0.015, 0.006, 1.1]])
OUTPUTS = ("x", "y", "z")


def axes_calibration(rng, frequencies=(80.0, 480.0), motions=False, effects=(), noise=NOISE):
    """Return records of a triaxial sensor, turned into each axis, or moved along all at once."""
    time_s = np.arange(SAMPLES) / RATE_HZ
    signals = []
    for f in (round(f * SAMPLES / RATE_HZ) * RATE_HZ / SAMPLES for f in frequencies):
        drives = (
            rng.standard_normal((5, 3)) + 1j * rng.standard_normal((5, 3))
            if motions
            else np.eye(3) * np.exp(1j)
        )
        for k, drive in enumerate(drives):
            wave = np.exp(2j * np.pi * f * time_s)
            a = np.real(10.0 * drive[:, None] * wave)
            v = np.real(10.0 * (MATRIX @ drive)[:, None] * response(f, **TRUE) * wave)
            signals.append(
                (f"{f:g} Hz {k}", f, OUTPUTS[k % 3], a, v + noise * rng.standard_normal(v.shape))
            )

    def calibration(output, motion):
        records_ = []
        for name, f, axis, a, v in signals:
            reference = a[motion] if motions else a[OUTPUTS.index(axis)]
            where = Circumstances(axis="" if motions else axis)
            records_.append(
                Record(name, reference, v[output], RATE_HZ, "sine", f, circumstances=where)
            )
        return Calibration(tuple(records_), effects=tuple(effects))

    outputs = {name: calibration(i, 0) for i, name in enumerate(OUTPUTS)}
    return AxesCalibration(
        outputs, {n: calibration(0, j) for j, n in enumerate(OUTPUTS)} if motions else {}
    )


def true_matrix(frequencies):
    """Return the complex, shape (frequencies, 3, 3)."""
    return np.array([MATRIX * response(f, **TRUE) for f in frequencies])


def triaxial(rng, motions=False):
    """Real and imaginary parts of the sensitivity matrix of a triaxial sensor."""
    figures = sensitivity_matrix(axes_calibration(rng, motions=motions))
    low, high = figures.interval_95()
    true = true_matrix(figures.frequency_hz)
    parts = np.stack([true.real, true.imag], axis=-1)
    inside = (low <= parts) & (parts <= high)
    parameters = np.eye(3, dtype=bool)
    return {
        "main": float(np.mean(inside[:, parameters])),
        "transverse": float(np.mean(inside[:, ~parameters])),
    }


def three_motions(rng):
    """Return the same, moved along all axes at once."""
    return triaxial(rng, motions=True)


STUDIES = {
    "repeats": repeats,
    "temperature": temperatures,
    "triaxial": triaxial,
    "three motions": three_motions,
}


def coverage(name: str, count: int, seed: int = 1) -> dict[str, float]:
    """Share of the intervals that hold the true value, by what they are of."""
    rng = np.random.default_rng(seed)
    figures = [STUDIES[name](rng) for _ in range(count)]
    return {key: float(np.mean([shares[key] for shares in figures])) for key in figures[0]}


def main(count: int, names: list[str]) -> None:
    for name in names or STUDIES:
        begin = time.perf_counter()
        shares = coverage(name, count)
        text = ", ".join(f"{key} {100 * share:.1f} %" for key, share in shares.items())
        seconds = time.perf_counter() - begin
        print(
            f"{name}: {count} simulated, 95 % intervals that hold the true value: {text} "
            f"({seconds:.0f} s)",
            flush=True,
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 500, sys.argv[2:])
