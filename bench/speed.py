"""Speed, warm and in one process: against a pass of a filter, Adam, and twice the samples."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.signal import lfilter

from bench.figures import Figure, Options, Section, steps
from bench.pairs import pairwise
from bench.truth import RATE_HZ, RESPONSE_NOISE, SAMPLES, SENSOR, model, paper_truth
from vibrident import Calibration, identify, identify_many
from vibrident.fit.estimators import Ipnn, MaximumLikelihood
from vibrident.fit.problem import Coordinates, Evidence, network_objective
from vibrident.fit.problem.time_domain import TimeProblem
from vibrident.fit.start.start import find_start
from vibrident.paper.adam import adam
from vibrident.physics.discretisation import method
from vibrident.physics.simulation import simulate, with_noise

#: Passes of a filter, at most: sines, and motion of other kinds.
FILTER_TARGETS = {"ipnn fit": 20.0, "ml fit": 15.0, "ipnn identify": 40.0, "ml identify": 40.0}
BROAD_TARGETS = {"ipnn fit": 60.0, "ipnn identify": 90.0}
BROADBAND_MOTIONS = ("random", "sweep", "multisine", "shock")
ADAM_TARGET = 100.0
TWICE_TARGET = 2.1  # for twice the samples
ADAM_STEPS = 1500  # steps of the paper's training
ADAM_TIMED = 100  # of these, timed
FILTER_PASSES = 15
#: Sensors of so many samples for the comparison with one by one: enough that the start of a process
#: is hardly seen.
MANY = {2000: 60, SAMPLES: 40}


def noisy(samples: int = SAMPLES) -> Calibration:
    """Return the calibration with 1 % response noise."""
    truth = paper_truth(RATE_HZ, samples)[0]
    return with_noise(truth, response_noise=RESPONSE_NOISE, seed=1)


def measure(options: Options) -> Section:
    """Ratios of times; a pair is A and B one after the other."""
    pairs = 3 if options.quick else options.pairs
    once = _jobs(noisy())
    twice = _jobs(noisy(2 * SAMPLES))
    filtering = _filter_pass()
    figures = []
    for name, job in steps("speed: filter", list(once.items())):
        ratio = pairwise(job, filtering, pairs, repeats_b=FILTER_PASSES)
        what = f"{name} of sines / one scipy.signal.lfilter pass"
        figures.append(
            Figure(what, {"ratio": ratio.median}, high=FILTER_TARGETS[name], note=ratio.note)
        )
    for kind in steps("speed: other motion", BROADBAND_MOTIONS):
        jobs = _jobs(broad(kind))
        for name, high in BROAD_TARGETS.items():
            ratio = pairwise(jobs[name], filtering, max(3, pairs // 3), repeats_b=FILTER_PASSES)
            what = f"{name}, {kind} / one scipy.signal.lfilter pass"
            figures.append(Figure(what, {"ratio": ratio.median}, high=high, note=ratio.note))
    training = _adam_steps(ADAM_TIMED)
    for name in steps("speed: Adam", ["ipnn fit", "ipnn identify"]):
        ratio = pairwise(training, once[name], max(3, pairs // 2)).times(ADAM_STEPS / ADAM_TIMED)
        note = f"{ADAM_TIMED} steps timed, taken {ADAM_STEPS // ADAM_TIMED} times; {ratio.note}"
        what = f"{ADAM_STEPS} Adam steps of the Euler network / {name}"
        figures.append(Figure(what, {"ratio": ratio.median}, low=ADAM_TARGET, note=note))
    for name, job in steps("speed: twice the samples", list(twice.items())):
        ratio = pairwise(job, once[name], max(3, pairs // 2))
        what = f"{name}, 32 000 / 16 000 samples"
        figures.append(Figure(what, {"ratio": ratio.median}, high=TWICE_TARGET, note=ratio.note))
    for samples in steps("speed: many", (2000, SAMPLES)):
        figures.append(_many(samples, max(2, pairs // 5)))
    remarks = (
        "21 records of 16 000 samples at 51.2 kHz, 1 % response noise, kernels compiled. fit: "
        "training from the gathered evidence; identify: screening, tones, training, uncertainty, "
        "result.",
        "The filter is of second order, float64, one call for all 21 × 16 000 samples.",
    )
    return Section("speed", "Speed, warm", tuple(figures), {"pairs": pairs}, remarks)


def broad(kind: str) -> Calibration:
    """Return as many samples of another motion, with the same noise."""
    band: dict[str, Any] = {} if kind == "shock" else {"frequencies_hz": [10.0, 4000.0]}
    truth = simulate(
        SENSOR, kind, sampling_rate_hz=RATE_HZ, samples=SAMPLES, repeats=21, seed=3, **band
    )
    return with_noise(truth, response_noise=RESPONSE_NOISE, seed=2)


def _many(samples: int, pairs: int) -> Figure:
    """Measure sensors in turn in one process over ``identify_many`` in two, start included."""
    count = MANY[samples]
    sensors = [
        with_noise(paper_truth(RATE_HZ, samples)[0], response_noise=0.01, seed=s)
        for s in range(count)
    ]
    steady: list[float] = []

    def alone() -> None:
        for sensor in sensors:
            identify(sensor)

    def together() -> None:
        ends = [time.perf_counter() for _ in identify_many(sensors, workers=2)]
        steady.append((count - count // 2) / (ends[-1] - ends[count // 2 - 1]))

    ratio = pairwise(alone, together, pairs, warm_up=False)
    rate = float(np.median(steady))
    started = float(np.median(ratio.b)) - count / rate
    what = f"{count} sensors of 21 × {samples} samples one by one / identify_many, 2 processes"
    note = (
        f"{rate:.3g} sensors a second once both work, and {started:.2g} s until they do; "
        f"{ratio.note}"
    )
    return Figure(what, {"ratio": ratio.median}, note=note)


def _jobs(calibration: Calibration) -> dict[str, Callable[[], object]]:
    evidence = Evidence.gather(calibration, model())
    _ = evidence.first_look  # belongs to the evidence, and is kept with it
    return {
        "ipnn fit": lambda: Ipnn().fit(evidence),
        "ml fit": lambda: MaximumLikelihood().fit(evidence),
        "ipnn identify": lambda: identify(calibration, estimator="ipnn"),
        "ml identify": lambda: identify(calibration, estimator="ml"),
    }


def _filter_pass() -> Callable[[], object]:
    """Run the sensor as a second-order filter over all records."""
    reference = np.array([record.reference for record in noisy().records])
    pole = np.exp(2j * np.pi * SENSOR.parameters["natural_frequency"] / RATE_HZ * (-0.182 + 0.983j))
    denominator = np.array([1.0, -2.0 * pole.real, abs(pole) ** 2])
    numerator = np.array([0.25, 0.5, 0.25]) * denominator.sum() * SENSOR.parameters["sensitivity"]
    return lambda: lfilter(numerator, denominator, reference, axis=-1)


def _adam_steps(count: int) -> Callable[[], object]:
    """Train as the paper: Euler weights, Adam, every record in every step.

    Start values are those of ``Ipnn``.
    """
    evidence = Evidence.gather(noisy(), model())
    assert evidence.first_look is not None  # there are sines
    start = find_start(evidence.first_look, evidence.model).values
    coordinates = Coordinates.at(evidence.model, start, evidence.band_hz)
    problem = TimeProblem.build(
        evidence.records, evidence.model, method("euler"), evidence.quantity, start
    )
    noise = np.array(
        [RESPONSE_NOISE * float(np.std(record.response)) for record in evidence.records]
    )
    return lambda: adam(
        network_objective, coordinates.first, (coordinates, problem, noise), steps=count
    )
