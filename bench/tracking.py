"""The tracker: scatter beside `identify`, coverage, alarms, speed, in Python and in C.

One sensor, 20 kHz; changes of four sensors in ``bench.track_changes``. The C code is that of
``export --online``, compiled here with -O3, and for a Cortex-M4F in qemu.
"""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from tests.support import cortex
from tests.support.exported import result
from tests.support.online_c import Compiled
from tests.support.random_record import RATE_HZ, TRUTH, Real
from tests.support.tracked import answered, fed, motion, record, tracker

from bench.figures import Figure, Options, Section, steps
from bench.track_changes import delays, named
from vibrident import Calibration, identify
from vibrident.export import export

SAMPLES = 8000
NOISE = 0.01
RUNS_PER_BATCH_FIT = 5  # runs, of which one is identified as well
NAMES = tuple(TRUTH)
PIECE_SAMPLES = 1_000_000


def scatter(kind: str, runs: int) -> tuple[Figure, ...]:
    """Measure scatter over the batch's and coverage of 95 % intervals; start values off by 2 %."""
    batch_runs = max(4, runs // RUNS_PER_BATCH_FIT)
    tracked = np.zeros((runs, 3))
    u = np.zeros((runs, 3))
    batch = np.zeros((batch_runs, 3))
    for seed in steps(f"tracking {kind}", range(runs)):
        rng = np.random.default_rng(seed)
        samples = record(kind, SAMPLES, rng, NOISE)
        estimate = fed(tracker(rng), *samples).read()
        tracked[seed] = [estimate.values[name] / TRUTH[name] - 1.0 for name in NAMES]
        u[seed] = [estimate.uncertainty[name] / TRUTH[name] for name in NAMES]
        if seed < batch_runs:
            result = identify(
                Calibration.from_arrays(*samples, RATE_HZ, excitation=kind, model="accelerometer")
            )  # type: ignore[arg-type]
            batch[seed] = [result.parameters[name].value / TRUTH[name] - 1.0 for name in NAMES]
    ratio = np.sqrt(np.mean(tracked[:batch_runs] ** 2, axis=0) / np.mean(batch**2, axis=0))
    covered = np.mean(np.abs(tracked) < 1.96 * u, axis=0)
    return (
        Figure(
            f"{kind}: scatter over that of identify",
            _named(ratio),
            high=1.1,
            note=f"{batch_runs} runs",
        ),
        Figure(
            f"{kind}: coverage of 95 % intervals",
            _named(covered),
            "percent",
            0.93,
            0.97,
            note=f"{runs} runs",
        ),
    )


def _named(values: Real) -> dict[str, float]:
    return dict(zip(NAMES, values.tolist(), strict=True))


def compiled(*, single: bool = False) -> Compiled:
    """Build the C tracker at the true values with u of 0.1 %, with all exact optimisation."""
    return Compiled(sources(), 3, single=single, more=("-O3", "-march=native"))


def sources() -> Path:
    """Return a folder with the C tracker's sources."""
    folder = Path(tempfile.mkdtemp())
    export(
        result("accelerometer", TRUTH, (20.0, 4000.0)), "c", folder, rate_hz=RATE_HZ, online=True
    )
    return folder


def long_run(
    samples: int, make: Callable[[np.random.Generator], tuple[Real, Real]]
) -> tuple[float, float, Compiled]:
    """Return alarms, and the largest deviation of a parameter in u, after so many samples in C."""
    library = compiled()
    most = 0.0
    alarms = 0
    rng = np.random.default_rng(1)
    for _ in range(max(1, samples // PIECE_SAMPLES)):
        alarms = library.feed(*make(rng))
        value, u, _, _ = library.read()
        most = max(most, float(np.max(np.abs(value - np.array(list(TRUTH.values()))) / u)))
    return alarms, most, library


def _piece(kind: str, samples: int) -> Callable[[np.random.Generator], tuple[Real, Real]]:
    """Return samples that continue others: a period of a motion, its response, and new noise."""
    rng = np.random.default_rng(9)
    if kind in ("random", "tone"):
        u = motion(kind, samples, rng)
        y = answered(u)
        return lambda rng: (u, y + NOISE * np.std(y) * rng.normal(size=samples))
    u = np.full(samples, 3.3 if kind == "dead reference" else 0.0)
    y = answered(motion("random", samples, rng)) if kind == "dead reference" else np.zeros(samples)
    return lambda rng: (u, y + 1e-3 * rng.normal(size=samples))


def firmware() -> list[Figure]:
    """On a Cortex-M4F in qemu, in which the gain changes by 1 % after half a second."""
    if absent := cortex.missing():
        return [Figure("Cortex-M4F: instructions a sample", {}, note=f"left out: {absent}")]
    folder = sources()
    u, y = record("random", 2 * 10000, np.random.default_rng(2), NOISE)
    y[10000:] *= 1.01
    outcome = cortex.run(folder, u, y)
    note = "single precision, -O2; mean, and the longest: the point of linearisation is moved"
    labels = ("RAM of the tracker", "stack", "flash")
    sizes: dict[str, float] = dict(
        zip(labels, [*outcome.ram, float(cortex.flash(folder))], strict=True)
    )
    return [
        Figure(
            "Cortex-M4F: instructions a sample",
            dict(zip(("mean", "longest"), outcome.instructions, strict=True)),
            "plain",
            note=note,
        ),
        Figure(
            "Cortex-M4F: RAM of the tracker · stack · flash",
            sizes,
            "bytes",
            note="flash with what it needs of libm",
        ),
    ]


def speed() -> Figure:
    """Million samples a second on one core."""
    u, y = record("random", PIECE_SAMPLES, np.random.default_rng(1), NOISE)
    rates = {}
    in_python = tracker(None, u=1e-3)
    begin = time.process_time()
    fed(in_python, u, y, lambda n: list(range(16384, n, 16384)))
    rates["Python"] = PIECE_SAMPLES / (time.process_time() - begin) / 1e6
    for label, single in (("C, double", False), ("C, float", True)):
        library = compiled(single=single)
        library.feed(u[:1000].copy(), y[:1000].copy())
        begin = time.process_time()
        library.feed(u, y)
        rates[label] = PIECE_SAMPLES / (time.process_time() - begin) / 1e6
    return Figure("million samples a second", rates, "plain")


def measure(options: Options) -> Section:
    """Return all of it; the C code where there is a gcc."""
    runs = 4 if options.quick else 1000
    figures = [
        figure for kind in ("random", "multisine", "sweep") for figure in scatter(kind, runs)
    ]
    figures += [*delays(1 if options.quick else 20), *named()]
    if shutil.which("gcc"):
        for pieces in (1,) if options.quick else (10, 100):
            quiet = {}
            off = {}
            for kind in ("random", "tone", "rest", "dead reference")[: 4 if pieces < 100 else 1]:
                quiet[kind], off[kind], _ = long_run(
                    pieces * PIECE_SAMPLES, _piece(kind, PIECE_SAMPLES)
                )
            figures.append(
                Figure(
                    f"alarms in {pieces * PIECE_SAMPLES:.0e} samples without a change",
                    quiet,
                    "plain",
                    high=0.0,
                )
            )
            figures.append(Figure("largest deviation there, in u", off, "sigma"))
        u, y = record("random", PIECE_SAMPLES, np.random.default_rng(3), NOISE)
        ends = [
            library for library in (compiled(), compiled(single=True)) if library.feed(u, y) == 0
        ]
        (double, u_double, *_), (single, *_) = (library.read() for library in ends)
        apart = float(np.max(np.abs(double - single) / u_double))
        figures.append(Figure("float less double, in u", {"largest": apart}, "sigma", high=0.2))
        sizes = {"double": float(compiled().bytes), "float": float(compiled(single=True).bytes)}
        figures.append(Figure("RAM of a tracker", sizes, "bytes"))
        figures.append(speed())
    figures += firmware()
    return Section("tracking", "Tracking: 20 kHz, 1 % noise", tuple(figures))
