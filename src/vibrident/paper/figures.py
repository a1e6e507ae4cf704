"""Figures 5, 6, 7 and 9 of the paper, and two that it lacks, in the style of the package."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.base.amounts import pretty
from vibrident.data.records import FloatArray
from vibrident.paper import methods
from vibrident.paper.dataset import SENSOR
from vibrident.paper.reproduction import Reproduction
from vibrident.paper.sections import BAND_HZ, PaperSection
from vibrident.paper.studies import NOISE_METHODS, PARAMETERS
from vibrident.paper.unrolled import plain_model
from vibrident.physics.discretisation import Weights, method
from vibrident.physics.models import parse
from vibrident.physics.models.state_space import realise
from vibrident.physics.network.readback import network_response
from vibrident.show import axes, plots
from vibrident.show.numbers import sensitivity_unit
from vibrident.show.views import BLACK, BLUE, LINES, Axis, Figure, Look, Panel, Series, Stack

Stacks = tuple[Stack, ...]

#: Frequencies of figure 5.
TYPICAL_HZ = (10.0, 125.0, 630.0, 1000.0)
#: Methods whose curves are drawn.
DRAWN_METHODS = (methods.PUBLISHED, methods.EXACT, methods.PLAIN)
_SYMBOLS = {"sensitivity": "S0", "natural_frequency": "fn", "damping_ratio": "δ"}
#: Least relative error drawn; below it is rounding.
MIN_DRAWN_ERROR = 1e-9


@dataclass(frozen=True)
class Picture:
    """Picture of the page: file name without suffix, caption, and what draws it."""

    name: str
    caption: str
    draw: Callable[[Reproduction], Stacks]


def draw_all(run: Reproduction, folder: Path) -> list[Figure]:
    """Draw every picture of the run into ``folder`` as PNG; return them in order."""
    figures = []
    for picture in PICTURES:
        if run.seismometer is None and picture.name.endswith("measured"):
            continue
        stacks = picture.draw(run)
        across = 2 if len(stacks) > 2 else 0
        figure = Figure(picture.name, "", stacks, across=across)
        plots.save(figure, folder / f"{picture.name}.png")
        figures.append(replace(figure, caption=picture.caption))
    return figures


def signals(run: Reproduction) -> Stacks:
    """Draw figure 5: excitation and response at typical frequencies, from the start."""
    section = run.simulation
    records = section.published.calibration.records
    stacks = []
    for number, frequency in enumerate(TYPICAL_HZ):
        record = min(records, key=lambda r: abs(np.log((r.frequency_hz or 1.0) / frequency)))
        span = slice(0, min(record.samples, round(6.0 * record.sampling_rate_hz / frequency)))
        time = 1e3 * record.time_s[span]
        reference = np.asarray(record.reference)[span] / section.published.reference.unit
        response = record.response[span] / section.published.response.unit
        series = (
            Series(time, reference, "excitation", Look("#9a9a9a", width=0.5)),
            Series(time, response, "response", Look(BLUE, width=1.2)),
        )
        y = axes.linear(
            "Normalised, one scale a channel" if number == 0 else "Normalised",
            np.array([-1.0, 1.0]),
        )
        panel = Panel(axes.linear("Time in ms", time, most=5, margin=0.02), y, series, 1.7)
        stacks.append(Stack((panel,), f"({'abcd'[number]}) {record.name}"))
    return tuple(stacks)


def discrete_sensitivity(run: Reproduction) -> Stacks:
    """Draw figure 6: sensitivity of the discrete models of Table 2 against the sensor's own."""
    model = parse(SENSOR.model)
    truth = dict(SENSOR.parameters)
    frequency = np.geomspace(*BAND_HZ, 301)
    reference = np.abs(model.frequency_response(truth, frequency))
    upper = [Series(frequency, reference, "reference (continuous)", Look(BLACK, width=2.2))]
    lower = []
    for name, look in zip(("euler", "zoh", "bandlimited"), LINES, strict=False):
        curve = np.abs(discrete_response(name, truth, frequency, run.settings.rate_hz))
        plain = replace(look, marker="")
        upper.append(Series(frequency, curve, name, plain))
        lower.append(Series(frequency, 100.0 * (curve / reference - 1.0), "", plain))
    return _two_panels(
        frequency, axes.size("|S| in V/(m/s²)", reference), upper, "Deviation in %", lower
    )


def _two_panels(
    frequency: FloatArray, y: Axis, upper: list[Series], label: str, lower: list[Series]
) -> Stacks:
    """Draw curves, and below them their deviation."""
    x = axes.frequency(frequency)
    deviations = np.concatenate([np.zeros(1), *(series.y for series in lower)])
    below = Panel(x, axes.linear(label, deviations), tuple(lower), 1.7)
    return (Stack((Panel(x, y, tuple(upper), 2.2), below)),)


def discrete_response(
    name: str, parameters: dict[str, float], frequency_hz: FloatArray, rate_hz: float
) -> Any:
    """Return the complex sensitivity of a network tied to the physics, shape (points,).

    ``name``: of the discretisation.
    """
    step = method(name)
    interval = 1.0 / rate_hz
    system = realise(parse(SENSOR.model).rational(parameters))
    terms = step.terms(2.0 * np.pi * parameters["natural_frequency"] * interval)
    weights = Weights(
        *(np.asarray(weight) for weight in step.weights(system, interval, 0.0, terms))
    )
    return network_response(weights, frequency_hz, interval, name)


def curves(section: PaperSection) -> Stacks:
    """Draw figures 7 and 9: sensitivity curves, and their relative deviation from the reference."""
    calibration = section.published.calibration
    model = plain_model(calibration.model)
    unit = sensitivity_unit(calibration.response_unit, pretty(calibration.reference_unit))
    frequency = np.geomspace(*section.band_hz, 401)
    upper = []
    lower = []
    if section.points[0].size:
        order = np.argsort(section.points[0])
        reference = section.points[1][order]
        look = Look(BLACK, marker="o")
        upper.append(
            Series(section.points[0][order], reference, "laser interferometer", look, "points")
        )
    else:
        reference = np.abs(model.frequency_response(section.truth or {}, frequency))
        upper.append(Series(frequency, reference, "theory", Look(BLACK, width=2.4)))
    for name, look in zip(DRAWN_METHODS, LINES, strict=False):
        parameters = section.row(name).parameters
        deviation = section.deviations.get(name)
        if parameters is None or deviation is None:
            continue
        plain = replace(look, marker="")
        upper.append(
            Series(frequency, np.abs(model.frequency_response(parameters, frequency)), name, plain)
        )
        order = np.argsort(deviation.frequency_hz)
        where = np.array(deviation.frequency_hz)[order]
        percent = np.array(deviation.percent)[order]
        lower.append(Series(where, percent, "", look if len(where) < 100 else plain))
    return _two_panels(
        frequency,
        axes.size(f"(a) |S| in {unit}", reference),
        upper,
        "(b) relative deviation in %",
        lower,
    )


def by_rate(run: Reproduction) -> Stacks:
    """Draw the parameter error against sampling rate for every discretisation."""
    lines = []
    for discretisation in run.settings.discretisations:
        points = [
            p for p in run.rates if p.discretisation == discretisation and p.errors is not None
        ]
        errors = {name: [abs((p.errors or {})[name]) for p in points] for name in PARAMETERS}
        errors["curve"] = [0.01 * (p.mean_percent or 0.0) for p in points]
        lines.append((discretisation, [p.rate_hz for p in points], errors))
    return _four_panels(lines, "Sampling rate in Hz")


def by_noise(run: Reproduction) -> Stacks:
    """Draw the RMS error against response noise for every method, and the Cramér–Rao bound."""
    study = run.noise
    lines = []
    for label in NOISE_METHODS:
        points = [p for p in study.points if p.method == label]
        errors = {name: [p.rms_error[name] for p in points] for name in PARAMETERS}
        errors["curve"] = [0.01 * p.mean_percent for p in points]
        lines.append((label, [100.0 * p.level for p in points], errors))
    levels = sorted({p.level for p in study.points})
    least = {name: [study.bound.deviations(level)[name] for level in levels] for name in PARAMETERS}
    least["curve"] = [0.01 * study.bound_mean_percent * level for level in levels]
    bound = "Cramér–Rao bound", [100.0 * level for level in levels], least
    return _four_panels(lines, "Response noise, % of the rms", bound)


#: Panels of the two studies, and their titles.
_PANELS = {
    **{name: f"error of {_SYMBOLS[name]}" for name in PARAMETERS},
    "curve": "mean deviation of the curve",
}


#: A line of each panel: its name, and x and y by panel.
_Line = tuple[str, list[float], dict[str, list[float]]]


def _four_panels(lines: Sequence[_Line], label: str, bound: _Line | None = None) -> Stacks:
    """Draw relative errors on logarithmic axes: a panel for each parameter and for the curve."""
    stacks = []
    for panel, title in _PANELS.items():
        series = []
        if bound is not None:
            name, x, y = bound
            series.append(Series(np.array(x), np.array(y[panel]), name, Look("#a6a6a6", width=3.0)))
        for (name, x, y), look in zip(lines, LINES, strict=False):
            series.append(Series(np.array(x), np.maximum(y[panel], MIN_DRAWN_ERROR), name, look))
        across = axes.frequency(np.concatenate([line.x for line in series]), label)
        errors = axes.size("Relative error", np.concatenate([line.y for line in series]))
        stacks.append(Stack((Panel(across, errors, tuple(series), 2.0),), f"{title}, relative"))
    return tuple(stacks)


PICTURES = (
    Picture(
        "figure5",
        "Figure 5. Excitation and response at typical frequencies, from the start at rest.",
        signals,
    ),
    Picture(
        "figure6",
        "Figure 6. Sensitivity of the discrete model with Table 2's parameters against the "
        "reference: Euler's, a zero-order hold's, and the band-limited step's (on the reference to "
        "rounding).",
        discrete_sensitivity,
    ),
    Picture(
        "figure7",
        "Figure 7. Simulation: (a) sensitivity curves, (b) relative deviation from the true curve.",
        lambda run: curves(run.simulation),
    ),
    Picture(
        "figure9-simulated",
        "Figure 9, simulated interferometer: (a) sensitivity curves, (b) relative deviation from "
        "the interferometer's points.",
        lambda run: curves(run.interferometer),
    ),
    Picture(
        "figure9-measured",
        "Figure 9, measured (SM-3 seismometer, laser): (a) sensitivity curves, (b) relative "
        "deviation from the laser's points.",
        lambda run: curves(run.seismometer or run.interferometer),
    ),
    Picture(
        "rates",
        "Beyond the paper: error of each discretisation against sampling rate, at the optimum of "
        "the mean squared error, on noise-free exact responses.",
        by_rate,
    ),
    Picture(
        "noise",
        "Beyond the paper: root-mean-square error against white response noise, with the "
        "Cramér–Rao bound.",
        by_noise,
    ),
)
