"""The paper's figures 5, 6, 7 and 9, and two that it lacks, drawn in the look of the package's other pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vibrident.discretize import Weights, method
from vibrident.models import parse
from vibrident.models.state_space import realise
from vibrident.network.readback import network_response
from vibrident.paper import methods
from vibrident.paper.dataset import SENSOR
from vibrident.paper.reproduction import Reproduction
from vibrident.paper.sections import BAND_HZ, Section
from vibrident.paper.studies import NOISE_METHODS, PARAMETERS
from vibrident.paper.unrolled import plain_model
from vibrident.plots import style
from vibrident.records import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Of figure 5.
TYPICAL_HZ = (10.0, 125.0, 630.0, 1000.0)
SHOWN = (methods.PUBLISHED, methods.EXACT, methods.PLAIN)
_SYMBOLS = {"sensitivity": "S0", "natural_frequency": "fn", "damping_ratio": "δ"}
#: Errors below this are drawn at it: rounding.
_LEAST = 1e-9


@dataclass(frozen=True)
class Picture:
    """A picture of the page: file name without suffix, caption, and what draws it."""

    name: str
    caption: str
    draw: Callable[[Reproduction], Figure]


def draw_all(run: Reproduction, folder: Path) -> list[Picture]:
    """Draw every picture that the run has numbers for into ``folder`` as PNG; return them in order."""
    wanted = [p for p in PICTURES if run.seismometer is not None or not p.name.endswith("measured")]
    for picture in wanted:
        figure = picture.draw(run)
        figure.set_dpi(110)
        with style.styled():
            figure.savefig(folder / f"{picture.name}.png", dpi=110)
    return wanted


def signals(run: Reproduction) -> Figure:
    """Figure 5: excitation and response at typical frequencies, from the start."""
    section = run.simulation
    records = section.published.calibration.records
    with style.styled():
        figure = style.new_figure(6.7, 5.2)
        for place, frequency in enumerate(TYPICAL_HZ):
            record = min(records, key=lambda r: abs(np.log((r.frequency_hz or 1.0) / frequency)))
            axes = figure.add_subplot(2, 2, place + 1)
            shown = slice(0, min(record.samples, round(6.0 * record.sampling_rate_hz / frequency)))
            time = 1e3 * record.time_s[shown]
            reference = np.asarray(record.reference)[shown] / section.published.reference.unit
            axes.plot(time, reference, color="#9a9a9a", lw=0.5, label="excitation")
            response = record.response[shown] / section.published.response.unit
            axes.plot(time, response, color=style.BLUE, lw=1.2, label="response")
            axes.set_title(f"({'abcd'[place]}) {record.name}", loc="left")
            axes.set_xlabel("Time in ms")
            axes.set_ylim(-1.08, 1.08)
            if place % 2 == 0:
                axes.set_ylabel("Normalised, one scale a channel")
            if place == 0:
                axes.legend(loc="upper right")
        return figure


def discrete_sensitivity(run: Reproduction) -> Figure:
    """Figure 6: the sensitivity of the discrete models with Table 2's parameters against the sensor's own."""
    model, truth = parse(SENSOR.model), dict(SENSOR.parameters)
    frequency = np.geomspace(*BAND_HZ, 301)
    reference = np.abs(model.frequency_response(truth, frequency))
    with style.styled():
        figure = style.new_figure(6.7, 4.8)
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1.4, 1.0))
        upper.plot(frequency, reference, color=style.BLACK, lw=2.2, label="reference (continuous)")
        for name, (colour, line, _) in zip(("euler", "zoh", "bandlimited"), style.LINES, strict=False):
            curve = np.abs(discrete_response(name, truth, frequency, run.settings.rate_hz))
            upper.plot(frequency, curve, color=colour, ls=line, label=name)
            lower.plot(frequency, 100.0 * (curve / reference - 1.0), color=colour, ls=line)
        upper.set_ylabel("|S| in V/(m/s²)")
        lower.set_ylabel("Deviation in %")
        upper.legend(loc="upper left")
        style.frequency_axis(upper, frequency, label=False)
        style.frequency_axis(lower, frequency)
        return figure


def discrete_response(name: str, parameters: dict[str, float], frequency_hz: FloatArray, rate_hz: float) -> Any:
    """Complex sensitivity of the network whose weights are the physics under a discretisation, shape (points,)."""
    step, interval = method(name), 1.0 / rate_hz
    system = realise(parse(SENSOR.model).rational(parameters))
    terms = step.terms(2.0 * np.pi * parameters["natural_frequency"] * interval)
    weights = Weights(*(np.asarray(part) for part in step.weights(system, interval, 0.0, terms)))
    return network_response(weights, frequency_hz, interval, name)


def curves(section: Section) -> Figure:
    """Figures 7 and 9: (a) sensitivity curves, (b) their relative deviation from the reference."""
    model = plain_model(section.published.calibration.model)
    frequency = np.geomspace(*section.band_hz, 401)
    with style.styled():
        figure = style.new_figure(6.7, 5.4)
        upper, lower = figure.subplots(2, 1, sharex=True)
        if section.points[0].size:
            order = np.argsort(section.points[0])
            reference = section.points[1][order]
            upper.plot(
                section.points[0][order],
                reference,
                "o",
                color=style.BLACK,
                mfc="white",
                ms=4.5,
                label="laser interferometer",
                zorder=5,
            )
        else:
            reference = np.abs(model.frequency_response(section.truth or {}, frequency))
            upper.plot(frequency, reference, color=style.BLACK, lw=2.4, label="theory")
        for name, (colour, line, mark) in zip(SHOWN, style.LINES, strict=False):
            found, deviation = section.row(name).parameters, section.deviations.get(name)
            if found is None or deviation is None:
                continue
            upper.plot(frequency, np.abs(model.frequency_response(found, frequency)), color=colour, ls=line, label=name)
            order = np.argsort(deviation.frequency_hz)
            where, percent = np.array(deviation.frequency_hz)[order], np.array(deviation.percent)[order]
            marks = {"marker": mark, "ms": 3.5} if len(where) < 100 else {}
            lower.plot(where, percent, color=colour, ls=line, label=name, **marks)
        upper.set_ylabel(f"(a) |S| in {_unit(section)}")
        style.size_axis(upper, reference)
        lower.set_ylabel("(b) relative deviation in %")
        upper.legend(loc="best")
        style.frequency_axis(upper, frequency, label=False)
        style.frequency_axis(lower, frequency)
        return figure


def _unit(section: Section) -> str:
    calibration = section.published.calibration
    below = calibration.reference_unit.replace("m/s^2", "m/s²")
    return f"{calibration.response_unit}/({below})" if "/" in below else f"{calibration.response_unit}/{below}"


def by_rate(run: Reproduction) -> Figure:
    """Parameter error against sampling rate for every discretisation."""
    lines: dict[str, list[tuple[str, list[float], list[float]]]] = {panel: [] for panel in _PANELS}
    for discretisation in run.settings.discretisations:
        points = [p for p in run.rates if p.discretisation == discretisation and p.errors is not None]
        rates = [p.rate_hz for p in points]
        for name in PARAMETERS:
            lines[name].append((discretisation, rates, [abs((p.errors or {})[name]) for p in points]))
        lines["curve"].append((discretisation, rates, [0.01 * (p.mean_percent or 0.0) for p in points]))
    return _four(lines, {}, "Sampling rate in Hz")


def by_noise(run: Reproduction) -> Figure:
    """RMS error against response noise for every method that gives parameters, and the Cramér–Rao bound."""
    study = run.noise
    lines: dict[str, list[tuple[str, list[float], list[float]]]] = {panel: [] for panel in _PANELS}
    for label in NOISE_METHODS:
        points = [p for p in study.points if p.method == label]
        levels = [100.0 * p.level for p in points]
        for name in PARAMETERS:
            lines[name].append((label, levels, [p.rms_error[name] for p in points]))
        lines["curve"].append((label, levels, [0.01 * p.mean_percent for p in points]))
    levels = sorted({p.level for p in study.points})
    bounds = {name: [study.bound.deviations(level)[name] for level in levels] for name in PARAMETERS}
    bounds["curve"] = [0.01 * study.bound_mean_percent * level for level in levels]
    return _four(lines, bounds, "Response noise, % of the rms", [100.0 * level for level in levels])


#: Panels of the two studies, and their titles.
_PANELS = {**{name: f"error of {_SYMBOLS[name]}" for name in PARAMETERS}, "curve": "mean deviation of the curve"}


def _four(
    lines: dict[str, list[tuple[str, list[float], list[float]]]],
    bounds: dict[str, list[float]],
    label: str,
    x_of_bounds: Sequence[float] = (),
) -> Figure:
    """One panel for each parameter and one for the curve, relative errors on logarithmic axes."""
    from matplotlib.ticker import FuncFormatter

    with style.styled():
        figure = style.new_figure(6.7, 6.2)
        panels = figure.subplots(2, 2, sharex=True).ravel()
        for axes, (panel, title) in zip(panels, _PANELS.items(), strict=True):
            shown: list[float] = []
            if panel in bounds:
                axes.plot(x_of_bounds, bounds[panel], color=style.BLACK, lw=3, alpha=0.35, label="Cramér–Rao bound")
                shown += bounds[panel]
            for (name, x, y), (colour, line, mark) in zip(lines[panel], style.LINES, strict=False):
                drawn = np.maximum(y, _LEAST)
                axes.plot(x, drawn, color=colour, ls=line, marker=mark, ms=3.5, label=name)
                shown += drawn.tolist()
            axes.set_title(f"{title}, relative", loc="left")
            style.size_axis(axes, np.array(shown))
            axes.yaxis.set_major_formatter(FuncFormatter(_power))
            style.frequency_axis(axes, np.array([value for _, x, _ in lines[panel] for value in x]), label=False)
        for axes in panels[2:]:
            axes.set_xlabel(label)
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
        return figure


def _power(value: float, _position: int | None) -> str:
    """A power of ten; nothing at what stands between."""
    exponent = np.log10(value)
    if abs(exponent - round(exponent)) > 1e-6:
        return ""
    return "10" + str(round(exponent)).translate(str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻"))


PICTURES = (
    Picture("figure5", "Figure 5. Excitation and response at typical frequencies, from the start at rest.", signals),
    Picture(
        "figure6",
        "Figure 6. Sensitivity of the discrete model with Table 2's parameters against the reference: Euler's, a "
        "zero-order hold's, and the band-limited step's (on the reference to rounding).",
        discrete_sensitivity,
    ),
    Picture(
        "figure7",
        "Figure 7. Simulation: (a) sensitivity curves, (b) relative deviation from the true curve.",
        lambda run: curves(run.simulation),
    ),
    Picture(
        "figure9-simulated",
        "Figure 9, simulated interferometer: (a) sensitivity curves, (b) relative deviation from the interferometer's "
        "points.",
        lambda run: curves(run.interferometer),
    ),
    Picture(
        "figure9-measured",
        "Figure 9, measured (SM-3 seismometer, laser): (a) sensitivity curves, (b) relative deviation from the laser's "
        "points.",
        lambda run: curves(run.seismometer or run.interferometer),
    ),
    Picture(
        "rates",
        "Beyond the paper: error of each discretisation against sampling rate, at the optimum of the mean squared "
        "error, on noise-free exact responses.",
        by_rate,
    ),
    Picture(
        "noise",
        "Beyond the paper: root-mean-square error against white response noise, with the Cramér–Rao bound.",
        by_noise,
    ),
)
