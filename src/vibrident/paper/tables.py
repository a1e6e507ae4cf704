"""Build tables 1 to 5 of the paper, with this package's figures beside its own, and more tables."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import astuple, replace

import numpy as np

from vibrident.data.records import STANDARD_GRAVITY
from vibrident.paper import claims, methods, published
from vibrident.paper.black_box import HIDDEN_NEURONS
from vibrident.paper.dataset import SENSOR
from vibrident.paper.metrics import Metrics
from vibrident.paper.reproduction import Reproduction
from vibrident.paper.sections import PaperSection
from vibrident.paper.studies import PARAMETERS, Residual
from vibrident.physics.discretisation import method
from vibrident.physics.discretisation.weights import weight_table
from vibrident.physics.models import parse
from vibrident.physics.models.state_space import realise, state_scaling
from vibrident.show.views import Column, Table

#: Form of a number, alone or in percent, in a cell of its own.
_NUMBER = re.compile(r"[-+−]?[\d.]+(?:e[+-]?\d+)?(?: %| \(limit\))?|–|no stable sensor")


def _table(
    name: str,
    title: str,
    heads: Sequence[str],
    rows: Sequence[Sequence[str]],
    note: str = "",
    quoted: int = 0,
) -> Table:
    """Return a table of the page.

    Columns of numbers are found by their cells; the first ``quoted`` rows are the paper's.
    """
    numeric = [all(_NUMBER.fullmatch(row[j]) for row in rows if row[j]) for j in range(len(heads))]
    columns = tuple(
        Column(head, "number" if j and numeric[j] else "text") for j, head in enumerate(heads)
    )
    body = tuple(tuple(row) for row in rows)
    return Table(
        columns,
        body,
        notes=(note,) if note else (),
        title=title,
        quoted=tuple(range(quoted)),
        name=name,
    )


def all_tables(run: Reproduction) -> list[Table]:
    """Return every table of the run, in the order of the page."""
    table_4 = "Table 4. Prediction of the response, simulation"
    table_5 = "Table 5. Prediction, simulated interferometer"
    measured = "Table 5. Prediction, measured seismometer"
    wide = "Simulation from 0.1 to 1000 Hz, 41 records"
    sections: list[tuple[str, str, str, PaperSection | None, dict[str, Metrics]]] = [
        ("table4", table_4, "simulation", run.simulation, published.TABLE_4),
        ("table5", table_5, "simulated interferometer", run.interferometer, published.TABLE_5),
        ("table5-measured", measured, "measured seismometer", run.seismometer, published.TABLE_5),
        ("full-range", wide, "0.1 to 1000 Hz", run.full_range, {}),
    ]
    tables = [
        run_table(run),
        weights_table(run),
        sensor_table(),
        hyper_parameter_table(run),
    ]
    for name, title, data, section, printed in sections:
        if section is not None:
            tables += [
                prediction_table(name, title, section, printed),
                identified_table(f"{name}-sensor", f"Identified sensor and curve, {data}", section),
            ]
    tables += [rate_table(run), noise_table(run)]
    if run.residuals:
        tables.append(residual_table(run.residuals))
    return [*tables, *claim_tables(run)]


def run_table(run: Reproduction) -> Table:
    """Return what was run."""
    s = run.settings
    data = run.simulation.published
    rows = [
        ("seed", str(s.seed)),
        (
            "records",
            f"{len(data.calibration.records)} of {s.samples} samples at {s.rate_hz / 1e3:g} kHz",
        ),
        ("test records", ", ".join(data.calibration.records[i].name for i in data.test)),
        ("SHA-256 of the records", data.sha256[:16] + " …"),
        ("outliers found", str(data.outliers)),
        (
            "scale: a normalised 1 is",
            f"excitation {data.reference.unit:.4g} m/s², response {data.response.unit:.4g} V",
        ),
        (
            "shift that min–max would add",
            f"excitation {data.reference.shift:.2g}, "
            f"response {data.response.shift:.2g} (normalised)",
        ),
        ("trained", s.schedule.rule),
        ("time of the whole run", f"{run.seconds / 60:.1f} min, {s.jobs} processes"),
    ]
    trial = (
        "A trial: networks are not trained to the end, figures are not for quoting."
        if s.trial
        else ""
    )
    return _table("run", "The run", ("", ""), rows, trial)


def weights_table(run: Reproduction) -> Table:
    """Return Table 1 with numbers: weights of Table 2's sensor, in the paper's states V and V̇."""
    interval = 1.0 / run.settings.rate_hz
    system = realise(parse(SENSOR.model).rational(SENSOR.parameters))
    layers = {"W1": "B_d", "W2": "C_d", "W3": "A_d", "W4": "D_d"}
    by_name = {}
    for name in ("euler", "zoh"):
        step = method(name).weights(system, interval, 0.0, 1)
        by_name[name] = weight_table(step, np.asarray(state_scaling(system)))
    rows = [
        (
            name,
            entry["layer"],
            letter,
            entry["meaning"],
            _matrix(entry["value"]),
            _matrix(by_name["zoh"][name]["value"]),
        )
        for (name, letter), entry in zip(layers.items(), by_name["euler"].values(), strict=True)
    ]
    note = (
        "In the paper's equation (8) and Table 1 the expressions of W2 and W3 stand in each "
        "other's place: C_d is the hidden → output weight and A_d the feedback. The exact column "
        "is for a held input; the band-limited step has the same W3 and W2 and one column of W1 "
        "and W4 for each input neuron."
    )
    head = (
        "weight",
        "layer",
        "eq. 7",
        "is",
        f"Euler at {run.settings.rate_hz / 1e3:g} kHz",
        "exact (held input)",
    )
    return _table("table1", "Table 1. Weights and physics", head, rows, note)


def _matrix(value: object) -> str:
    array = np.atleast_2d(np.asarray(value, dtype=float))
    if array.shape[1] == 1:
        array = array.T
    return "[" + "; ".join(", ".join(f"{x:.5g}" for x in row) for row in array) + "]"


def sensor_table() -> Table:
    """Return Table 2, checked against equation (3)."""
    natural = 2.0 * np.pi * SENSOR.parameters["natural_frequency"]
    resonance = 2.0 * np.pi * published.RESONANCE_HZ
    # mV/g over m/s² per g is mV/(m/s²); per mm of displacement in place of m: 1e-3.
    gain = published.SENSITIVITY_MV_PER_G / STANDARD_GRAVITY * 1e-3
    rows = (
        ("resonance frequency f0", "630 Hz", "630 Hz", ""),
        ("reference sensitivity S0", "1020 mV/g", f"{gain:.6g} V/(m/s²)", ""),
        ("damping ratio δ", "0.182", "0.182", ""),
        ("natural angular frequency ωn", "4.10e3 rad/s", f"{natural:.5g} rad/s", "ωr/√(1 − 2δ²)"),
        (
            "conversion coefficient K",
            "1.63e6 mV/mm",
            f"{gain * natural**2:.4g} mV/mm",
            "S0 ωn²: equation (3)",
        ),
        ("", "", f"{gain * resonance**2:.4g} mV/mm", "S0 ωr²: what the paper prints"),
    )
    return _table("table2", "Table 2. The sensor", ("", "paper", "computed", "by"), rows)


def hyper_parameter_table(run: Reproduction) -> Table:
    """Return Table 3 beside the values used here."""
    rule = run.settings.schedule
    ours = {
        "learning rate": (f"{rule.learning_rate:g}",) * 3,
        "batch size": (f"{rule.batch}",) * 3,
        "activation": ("linear (tanh as an option)", "tanh", "tanh"),
        "bias": ("none",) * 3,
        "hidden": ("2 (V, V̇)", str(HIDDEN_NEURONS), str(HIDDEN_NEURONS)),
    }
    rows = [(name, *paper, *ours[name]) for name, *paper in published.HYPER_PARAMETERS]
    head = ("", "IPNN, paper", "LSTM, paper", "GRU, paper", "IPNN, here", "LSTM, here", "GRU, here")
    note = (
        "The paper's text gives the IPNN two hidden neurons, its Table 3 one hidden layer. A batch "
        "of 36 is of windows: 512 samples run in, 512 scored. GRU and LSTM compute in float32, all "
        "else in float64."
    )
    return _table("table3", "Table 3. Hyper-parameters", head, rows, note)


def prediction_table(
    name: str, title: str, section: PaperSection, printed: dict[str, Metrics]
) -> Table:
    """Return Table 4 or 5: metrics of the test records, number of weights, epochs and time."""
    rows = [
        (f"{label}, paper", *(f"{value:g}" for value in astuple(metrics)), "", "", "")
        for label, metrics in printed.items()
    ]
    least = section.row(methods.EXACT).seconds
    for row in section.rows:
        epochs = "" if row.epochs is None else f"{row.epochs}{'' if row.converged else ' (limit)'}"
        cells = ("no stable sensor", "–", "–", "–", "–")
        if (m := row.metrics) is not None:
            cells = (
                f"{m.rmse:.6g}",
                f"{m.mae:.6g}",
                f"{m.mse:.6g}",
                f"{m.r2:.12g}",
                f"{m.rpd:.6g}",
            )
        rows.append((row.name, *cells, str(row.weights), epochs, f"{row.seconds / least:.2g}"))
    note = (
        "Normalised units: 1 is the largest excursion in the training records. Time: of fitting, "
        f"compilation included, over that of {methods.EXACT}. Methods that give a sensor predict "
        "by the exact network of that sensor, the networks under Adam by themselves."
    )
    head = ("method", "RMSE", "MAE", "MSE", "R²", "RPD", "weights", "epochs", "time")
    return _table(name, title, head, rows, note, len(printed))


def identified_table(name: str, title: str, section: PaperSection) -> Table:
    """Return the parameters of every method that has them, and the deviation of its curve."""
    rows = []
    for row in section.rows:
        if row.parameters is None:
            continue
        if section.truth is None:
            cells = [f"{row.parameters[p]:.6g}" for p in PARAMETERS]
        else:
            cells = [
                _percent(100.0 * (row.parameters[p] / section.truth[p] - 1.0)) for p in PARAMETERS
            ]
        delay = row.parameters.get("delay")
        curve = section.deviations[row.name]
        peak = "" if curve.at_peak is None else _percent(curve.at_peak)
        cells += [
            "" if delay is None else f"{1e6 * delay:.4g}",
            f"{curve.mean:.3g}",
            f"{curve.largest:.3g}",
            peak,
        ]
        rows.append((row.name, *cells))
    unit = "" if section.truth is None else " error in %"
    reference = "the true curve"
    printed_deviations = published.SIMULATION
    if section.points[0].size:
        reference = "the interferometer's points"
        printed_deviations = published.EXPERIMENT
    head = (
        "method",
        f"S0{unit}",
        f"fn{unit}",
        f"δ{unit}",
        "delay in µs",
        "mean in %",
        "largest in %",
        "at f0 in %",
    )
    band = f"{section.band_hz[0]:.4g} to {section.band_hz[1]:.4g} Hz"
    printed = "; ".join(
        f"{name} {d.mean:.3g} % mean, {d.largest:g} % largest"
        for name, d in printed_deviations.items()
    )
    note = (
        f"Last three columns: relative deviation of the curve from {reference}, {band}. "
        f"Paper: {printed}."
    )
    return _table(name, title, head, rows, note)


def _percent(value: float) -> str:
    return f"{value:+.3g}"


def rate_table(run: Reproduction) -> Table:
    """Return the curve deviation, and Euler's parameter errors, against sampling rate."""
    rows = []
    for rate in sorted({p.rate_hz for p in run.rates}):
        at = {p.discretisation: p for p in run.rates if p.rate_hz == rate}
        errors = at["euler"].errors
        peak = at["euler"].peak_percent
        euler = ["–", "–", "–"]
        if errors is not None and peak is not None:
            named = ("resonance_frequency", "damping_ratio")
            euler = [
                _percent(100.0 * errors[name]) if name in errors else "–" for name in named
            ] + [_percent(peak)]
        means = [at[name].mean_percent for name in run.settings.discretisations]
        rows.append((f"{rate / 1e3:g}", *euler, *("–" if m is None else f"{m:.2g}" for m in means)))
    head = (
        "rate in kHz",
        "Euler: f0 in %",
        "δ in %",
        "curve at f0 in %",
        *(f"{n}: mean in %" for n in run.settings.discretisations),
    )
    note = (
        "Optimum of the plain mean squared error, noise-free exact responses, the same motion at "
        "every rate. Euler is unstable below 2 δ/ωn, here 11.3 kHz."
    )
    return _table("rates", "Error against sampling rate", head, rows, note)


def noise_table(run: Reproduction) -> Table:
    """Return the RMS errors over the bound."""
    study = run.noise
    rows = []
    for level in sorted({p.level for p in study.points}):
        least = study.bound.deviations(level)
        rows.append(
            (
                f"{100 * level:g} %",
                "Cramér–Rao bound",
                *(f"{least[p]:.2e}" for p in PARAMETERS),
                "–",
            )
        )
        for point in (p for p in study.points if p.level == level):
            over = study.over_bound(point.method, level)
            cells = [f"{point.rms_error[p]:.2e} ({over[p]:.3g} ×)" for p in PARAMETERS]
            rows.append(("", point.method, *cells, f"{point.mean_percent:.2g}"))
    head = ("noise", "method", "S0", "fn", "δ", "curve, mean in %")
    note = (
        f"Root-mean-square relative error over {study.draws} draws of white response noise, "
        "relative to each record's rms; in brackets over the bound's standard deviation. GRU and "
        "LSTM have no parameters to compare."
    )
    return _table("noise", "Error against noise", head, rows, note)


def residual_table(residuals: Sequence[Residual]) -> Table:
    """Return the learned residual beside the physics."""
    rows = []
    for r in residuals:
        errors = [
            ", ".join(_percent(100.0 * e[p]) for p in PARAMETERS)
            for e in (r.errors_alone, r.errors)
        ]
        numbers = (
            f"{r.alone:.3g}",
            f"{r.together:.3g}",
            f"{r.alone / r.together:.3g}",
            f"{100 * r.share:.3g}",
        )
        rows.append((r.sensor, *numbers, *errors, f"{r.moved:.1e}"))
    head = (
        "sensor",
        "RMSE, physics alone",
        "with residual",
        "ratio",
        "its share in %",
        "S0, fn, δ alone, error in %",
        "with residual, error in %",
        "moved by",
    )
    note = (
        "RMSE in V on noise-free records of frequencies that were not trained on; "
        "0.1 % noise on those that were."
    )
    return _table("residual", "A learned residual beside the physics", head, rows, note)


def claim_tables(run: Reproduction) -> list[Table]:
    """Return the paper's claims and this package's own."""
    tables = []
    for name, title, verdict, checked in (
        ("claims", "The paper's claims", "reproduced", claims.check_paper_claims(run)),
        ("own", "Our own", "met", claims.check_own_targets(run)),
    ):
        rows = tuple((c.claim, c.figures, c.verdict, c.reason) for c in checked)
        doubtful = tuple(i for i, c in enumerate(checked) if not c.is_met)
        table = _table(name, title, ("claim", "here", verdict, "why"), rows)
        tables.append(replace(table, doubtful=doubtful))
    return tables
