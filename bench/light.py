"""Raw light to parameters: coverage, bound, false alarms and speed, against a truth of its own.

    python -m bench.light coverage --runs 500 --keep FILE    (or in pieces: --first 100 --runs 50)
    python -m bench.light alarms --runs 200 python -m bench.light faults --runs 2 --keep FILE python
    -m bench.light motions --runs 40 --keep FILE python -m bench.light speed --kind quadrature
    --samples 20000000 python -m bench.light peers            (ellipse fits of hoqi-bench, from an
    environment that holds it)

Each prints its figures; studies/interferometer.md quotes them.
"""

from __future__ import annotations

import argparse
import itertools
import json
import resource
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.light_signals import codes_of, write_long
from bench.truth import PARAMETERS
from vibrident import identify, read
from vibrident.base.errors import InputError
from vibrident.data.interferometer import ellipse, moments
from vibrident.data.interferometer.setting import Interferometer
from vibrident.data.records import FloatArray
from vibrident.physics.models import parse
from vibrident.physics.simulation import sensor_named
from vibrident.physics.simulation.optics import (
    CARRIER_RATIO,
    Optics,
    drawn,
    write_optical_calibration,
)

FREQUENCIES_HZ = (150.0, 250.0, 400.0, 630.0, 1000.0)
AMPLITUDE = 10.0
RATE_HZ = 2e5
SAMPLES = 60_000
PHASE_NOISE = 0.05
RESPONSE_NOISE = 1e-3
METRES_PER_RADIAN = 632.991e-9 / (4.0 * np.pi)
SENSOR = "paper"


def bound(times: float) -> FloatArray:
    """Cramér–Rao bound of the parameters: white noise of phase and response, known, ellipse known.

    ``times``: rate of the optical signals over that of the response.
    """
    sensor = sensor_named(SENSOR)
    model = parse(sensor.model)
    f = np.array(FREQUENCIES_HZ)
    values = {name: sensor.parameters[name] for name in PARAMETERS}

    def log_response(at: dict[str, float]) -> np.ndarray:
        return np.log(np.asarray(model.frequency_response(at, f, "displacement")))

    phase = AMPLITUDE / (2.0 * np.pi * f) ** 2 / METRES_PER_RADIAN
    # A response's noise is given over its rms; an amplitude's relative deviation is noise √(2/N)
    # over it.
    variance = (2.0 / SAMPLES) * ((PHASE_NOISE / phase) ** 2 / times + RESPONSE_NOISE**2 / 2.0)
    columns = []
    for name in PARAMETERS:
        step = 1e-6 * abs(values[name])
        up = log_response({**values, name: values[name] + step})
        down = log_response({**values, name: values[name] - step})
        columns.append((up - down) / (2.0 * step))
    rows = np.concatenate([np.real(columns), np.imag(columns)], axis=1) / np.sqrt(
        np.concatenate([variance, variance])
    )
    return np.sqrt(np.diag(np.linalg.inv(rows @ rows.T)))


def coverage(first: int, runs: int, keep: Path) -> None:
    """Measure the coverage of 95 % intervals, and u over the bound, with ellipses drawn anew.

    Each run is a line of the file ``keep``, so that a study can be made in pieces; the figures are
    those of all lines.
    """
    truth = np.array([sensor_named(SENSOR).parameters[name] for name in PARAMETERS])
    for run in range(first, first + runs):
        with tempfile.TemporaryDirectory() as folder:
            optics = drawn(Optics(noise=PHASE_NOISE, random=True), run)
            settings = {
                "sampling_rate_hz": RATE_HZ,
                "samples": SAMPLES,
                "frequencies_hz": list(FREQUENCIES_HZ),
            }
            settings |= {
                "amplitude": AMPLITUDE,
                "response_noise": RESPONSE_NOISE,
                "start": "steady",
            }
            write_optical_calibration(folder, SENSOR, "sine", optics, seed=run, **settings)
            calibration = read(Path(folder) / "calibration.toml")
            result = identify(calibration)
        optical = calibration.records[0].optical
        assert optical is not None
        estimates = [result.parameters[name] for name in PARAMETERS]
        row = {
            "run": run,
            "times": optical.rate_hz / RATE_HZ,
            "errors": [p.value - true for p, true in zip(estimates, truth, strict=True)],
            "stated": [p.standard_uncertainty for p in estimates],
            "held": [
                p.interval_95[0] <= true <= p.interval_95[1]
                for p, true in zip(estimates, truth.tolist(), strict=True)
            ],
            "warnings": list(result.warning_codes),
        }
        _append(keep, row)
    _print_coverage(keep)


def _append(keep: Path, row: dict[str, Any]) -> None:
    with keep.open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")


def _rows_of(keep: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in keep.read_text(encoding="utf-8").splitlines()]


def _print_coverage(keep: Path) -> None:
    rows = {row["run"]: row for row in _rows_of(keep)}.values()
    errors, stated, held = (
        np.array([row[key] for row in rows]) for key in ("errors", "stated", "held")
    )
    alarms = sum(bool(row["warnings"]) for row in rows)
    scaled = errors / stated
    least = bound(float(np.mean([row["times"] for row in rows])))
    figures = {
        "runs": len(rows),
        "coverage": dict(zip(PARAMETERS, np.mean(held, axis=0).tolist(), strict=True)),
        "beyond_3u": dict(
            zip(PARAMETERS, np.mean(np.abs(scaled) > 3.0, axis=0).tolist(), strict=True)
        ),
        "u_over_bound": dict(
            zip(PARAMETERS, (np.mean(stated, axis=0) / least).tolist(), strict=True)
        ),
        "scatter_over_bound": dict(
            zip(PARAMETERS, (np.std(errors, axis=0) / least).tolist(), strict=True)
        ),
        "with_a_warning": alarms,
    }
    print(json.dumps(figures), flush=True)


QUADRATURE = Interferometer("quadrature", 632.991e-9, direction=1)
HETERODYNE = Interferometer(
    "heterodyne", 632.991e-9, carrier_hz=CARRIER_RATIO * 51_200.0, direction=1
)
#: What can be wrong with the light, and the settings of it.
FAULTS: dict[str, dict[str, Any]] = {
    "clean": {},
    "8 bits": {"bits": 8},
    "short dropouts": {"dropouts": 4},
    "long dropouts": {"dropouts": 2, "dropout_s": 2e-3},
    "cyclic error": {"cyclic_rad": (0.01, 0.01, 0.01)},
    "drift": {"drift": 0.1, "carrier_drift_hz": 300.0},
    "fading": {"fading": 0.3},
    "table": {"table_m": 3e-7},
    "stated delay": {"delay_s": 1.7e-5},
    "hidden delay": {"delay_s": 1.7e-5, "hidden_delay": True},
}
#: Peak acceleration of each motion, m/s².
MOTIONS = {"sine": 10.0, "multisine": 3.0, "sweep": 3.0, "random": 3.0, "shock": 80.0}


def faults(first: int, runs: int, keep: Path) -> None:
    """Try each fault with each motion and interferometer: right, named, refused or wrong."""
    for run in range(first, first + runs):
        for setting, (fault, changes), motion in itertools.product(
            (QUADRATURE, HETERODYNE), FAULTS.items(), MOTIONS
        ):
            row = {"run": run, "kind": setting.kind, "fault": fault, "motion": motion}
            optics = drawn(Optics(setting, noise=0.02, random=True, **changes), run)
            _append(keep, row | _outcome(motion, optics, run))
    _print_faults(keep)


def motions(first: int, runs: int, keep: Path) -> None:
    """Measure the coverage with each motion and kind of interferometer, a new ellipse each run."""
    for run in range(first, first + runs):
        for setting, motion in itertools.product((QUADRATURE, HETERODYNE), MOTIONS):
            row = {"run": run, "kind": setting.kind, "motion": motion}
            optics = drawn(Optics(setting, noise=0.02, random=True), run)
            _append(keep, row | _outcome(motion, optics, run))
    rows = _rows_of(keep)
    names = " | ".join(name.replace("_", " ") for name in PARAMETERS)
    print(
        f"| interferometer | motion | runs | {names} | rms of error / u | with a warning "
        f"|\n|{'---|' * 8}"
    )
    for kind, motion in itertools.product(("quadrature", "heterodyne"), MOTIONS):
        here = [r for r in rows if (r["kind"], r["motion"]) == (kind, motion) and r["off"]]
        held = " | ".join(
            f"{100 * share:.1f} %" for share in np.mean([r["held"] for r in here], axis=0)
        )
        rms = ", ".join(
            f"{value:.2f}"
            for value in np.sqrt(np.mean(np.square([r["off"] for r in here]), axis=0))
        )
        print(
            f"| {kind} | {motion} | {len(here)} | {held} | {rms} | "
            f"{sum(bool(r['codes']) for r in here)} |",
            flush=True,
        )


def _outcome(motion: str, optics: Optics, seed: int) -> dict[str, Any]:
    settings: dict[str, Any] = {
        "sampling_rate_hz": 51_200.0,
        "samples": 10_240,
        "amplitude": MOTIONS[motion],
    }
    if motion == "sine":
        settings |= {"frequencies_hz": [150.0, 300.0, 600.0, 1000.0], "start": "steady"}
    truth = sensor_named(SENSOR).parameters
    with tempfile.TemporaryDirectory() as folder:
        write_optical_calibration(
            folder, SENSOR, motion, optics, seed=seed, response_noise=RESPONSE_NOISE, **settings
        )
        try:
            result = identify(read(Path(folder) / "calibration.toml"))
        except InputError as error:
            return {
                "outcome": "refused",
                "codes": [str(error).splitlines()[0]],
                "off": None,
                "held": None,
            }
    estimates = [result.parameters[name] for name in PARAMETERS]
    off = [
        (p.value - truth[name]) / p.standard_uncertainty if p.standard_uncertainty else 0.0
        for name, p in zip(PARAMETERS, estimates, strict=True)
    ]
    held = [
        p.interval_95[0] <= truth[name] <= p.interval_95[1]
        for name, p in zip(PARAMETERS, estimates, strict=True)
    ]
    right = "right" if max(map(abs, off)) < 3.0 else "wrong"
    codes = list(result.warning_codes)
    return {
        "outcome": f"{right}, named" if codes else right,
        "codes": codes,
        "off": off,
        "held": held,
    }


def _print_faults(keep: Path) -> None:
    rows = _rows_of(keep)
    for kind, fault, motion in itertools.product(("quadrature", "heterodyne"), FAULTS, MOTIONS):
        here = [r for r in rows if (r["kind"], r["fault"], r["motion"]) == (kind, fault, motion)]
        outcomes = Counter(r["outcome"] for r in here)
        codes = Counter(code for r in here for code in r["codes"])
        print(f"{kind} | {fault} | {motion} |", dict(outcomes), dict(codes), flush=True)


def alarms(runs: int) -> None:
    """Records with a finding, of clean signals of many ellipses, noises and converters."""
    random = np.random.default_rng(11)
    records = 0
    findings = 0
    for run in range(runs):
        with tempfile.TemporaryDirectory() as folder:
            optics = drawn(Optics(noise=float(random.choice([0.002, 0.01, 0.05])), random=True,
                                  bits=int(random.choice([8, 10, 12, 16]))), run)  # fmt: skip
            settings = {
                "sampling_rate_hz": RATE_HZ,
                "samples": 50_000,
                "frequencies_hz": [50.0, 200.0, 500.0, 1000.0],
            }
            write_optical_calibration(
                folder, SENSOR, "sine", optics, seed=run, start="steady", **settings
            )
            calibration = read(Path(folder) / "calibration.toml")
        records += len(calibration.records)
        findings += sum(bool(codes_of(record)) for record in calibration.records)
        cyclic = any(effect.kind == "cyclic" for effect in calibration.effects)
        findings += cyclic
        if (run + 1) % 50 == 0:
            print(json.dumps({"records": records, "with_a_finding": findings}), flush=True)


def speed(kind: str, samples: int) -> None:
    """Measure samples a second from raw HDF5 to parameters, best of three warm runs, and memory."""
    with tempfile.TemporaryDirectory() as folder:
        path = write_long(Path(folder), kind, samples)
        identify(read(path))
        best = {"read": np.inf, "all": np.inf}
        for _ in range(3):
            start = time.process_time()
            calibration = read(path)
            best["read"] = min(best["read"], time.process_time() - start)
            identify(calibration)
            best["all"] = min(best["all"], time.process_time() - start)
    rates = {
        f"million_samples_a_second_{name}": samples / took / 1e6 for name, took in best.items()
    }
    print(
        json.dumps({"kind": kind, "samples": samples, **rates, "peak_memory_mb": _peak_mb()}),
        flush=True,
    )


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


ARCS_RAD = (6.28, 4.5, 3.0, 2.0, 1.0)  # parts of the circle, rad
NOISES = (0.01, 0.05)  # over the amplitude
DRAWS = 120
DRAW_SAMPLES = 600  # samples of a draw
EVERY = 20  # of the draws, the slowest peer takes one in so many


def peers(python: str) -> None:
    """Compare the error of the phase with hoqi-bench's ellipse fits, on the same arcs and noise."""
    cases = []
    random = np.random.default_rng(1)
    for arc in ARCS_RAD:
        for noise in NOISES:
            for _ in range(DRAWS):
                centre = random.uniform(-0.2, 0.2, 2)
                sizes = random.uniform(0.75, 1.25, 2)
                angle = random.uniform(-0.25, 0.25)
                middle = random.uniform(0.0, 2.0 * np.pi)
                phase = middle + 0.5 * arc * np.sin(
                    np.linspace(0.0, 20.0 * np.pi, DRAW_SAMPLES, endpoint=False)
                )
                u = centre[:, None] + np.stack(
                    [sizes[0] * np.cos(phase), sizes[1] * np.sin(phase + angle)]
                )
                cases.append((arc, noise, phase, u + noise * random.standard_normal(u.shape)))
    ours = [_our_gain(phase, u) for _, _, phase, u in cases]
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "cases.npz"
        np.savez(
            data,
            signals=np.array([u for *_, u in cases]),
            phase=np.array([p for _, _, p, _ in cases]),
            every=EVERY,
        )
        peer = Path(__file__).parent / "peers" / "hoqi_peer.py"
        done = subprocess.run(
            [python, str(peer), str(data)], capture_output=True, text=True, check=True
        )
    theirs = json.loads(done.stdout)
    for i, (arc, noise) in enumerate((a, n) for a in ARCS_RAD for n in NOISES):
        row = {
            "arc_rad": arc,
            "noise": noise,
            "vibrident": _median(ours[i * DRAWS : (i + 1) * DRAWS]),
        }
        for name, values in theirs.items():
            draws = len(values) // (len(ARCS_RAD) * len(NOISES))
            row[name] = _median(values[i * draws : (i + 1) * draws])
        print(json.dumps(row), flush=True)


def _median(values: Sequence[float | None]) -> float:
    """Median of the errors; a fit that failed is off by all."""
    return float(np.median([1.0 if value is None else min(abs(value), 1.0) for value in values]))


def _our_gain(phase: FloatArray, u: FloatArray) -> float:
    start = ellipse.fit_circle(u)
    conic = ellipse.fit_ellipse([moments.sums(*u)], start) or ellipse.fit_short_arc(u, u.shape[1])
    v = conic.for_phase.round(u)
    return gain_error(phase, np.unwrap(np.arctan2(v[1], v[0])))


def gain_error(phase: FloatArray, measured: FloatArray) -> float:
    """Relative error of the amplitude of the sine: what the ellipse does to a calibration."""
    true = phase - phase.mean()
    return float(measured @ true / (true @ true) - 1.0)


def main() -> None:
    """Run one of the studies."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "study", choices=("coverage", "alarms", "speed", "peers", "faults", "motions")
    )
    parser.add_argument("--runs", type=int, default=500)
    parser.add_argument(
        "--first", type=int, default=0, help="number of the first run, which is its seed"
    )
    parser.add_argument(
        "--keep", type=Path, default=Path("coverage.jsonl"), help="file of the runs, a line each"
    )
    parser.add_argument("--kind", choices=("quadrature", "heterodyne"), default="quadrature")
    parser.add_argument("--samples", type=int, default=20_000_000)
    parser.add_argument(
        "--python", default="python", help="of the environment that holds hoqi-bench"
    )
    options = parser.parse_args()
    if options.study == "speed":
        speed(options.kind, options.samples)
    elif options.study == "peers":
        peers(options.python)
    elif options.study in ("faults", "motions"):
        {"faults": faults, "motions": motions}[options.study](
            options.first, options.runs, options.keep
        )
    elif options.study == "alarms":
        alarms(options.runs)
    else:
        coverage(options.first, options.runs, options.keep)


if __name__ == "__main__":
    main()
