"""Comparison with peers in environments of their own (``make bench-peers``), on the same data."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench.figures import STYLES, Figure, Options, Section, steps
from bench.pairs import Ratio, seconds
from bench.speed import noisy
from bench.truth import COLUMNS, PARAMETERS, RATE_HZ, model, relative_errors
from vibrident import Calibration, ResponseTable, identify
from vibrident.data.records import FloatArray
from vibrident.fit.estimators import Ipnn, MaximumLikelihood
from vibrident.fit.estimators.base import Estimate
from vibrident.fit.problem import Evidence
from vibrident.fit.response.response import ComplexArray

HERE = Path(__file__).parent / "peers"
#: Folder of the environments; BENCH_PEERS names another.
ENVIRONMENTS = Path(os.environ.get("BENCH_PEERS", HERE / "envs"))


@dataclass(frozen=True, eq=False)
class Match:
    """Peer with a choice of settings, beside this package's estimator for the same job.

    Attributes:
        peer: folder of its environment, and its name in the table.
        script: file in bench/peers.
        settings: what was chosen, in words.
        data: arrays for the script.
        ours: name of our estimator.
        fit: our estimator on the same data, warm.
        repeats: number of our times, whose median counts.
    """

    peer: str
    script: str
    settings: str
    data: dict[str, Any]
    ours: str
    fit: Callable[[], Estimate]
    repeats: int


def measure(options: Options) -> Section:
    """Time of the peer over ours, and the errors of both."""
    pairs = 1 if options.quick else 3
    figures: list[Figure] = []
    versions: dict[str, Any] = {}
    calibration = noisy()
    matches = [*_records(calibration), *_response(calibration)]
    for match in steps("peers", matches):
        python = ENVIRONMENTS / match.peer / "bin" / "python"
        if not python.exists():
            what = f"{match.peer} ({match.settings}) / {match.ours}"
            figures.append(
                Figure(what, {}, note="left out: no environment; `make bench-peers` makes it")
            )
            continue
        figures += _played(match, python, pairs, versions)
    remarks = (
        "Times of the fits alone, without imports. Ours and PyDynamic warm; jax-sysid compiles "
        "anew in every fit, as its interface has it.",
        "jax-sysid: free two-state model, scaled channels, one initial state a record; by its "
        "defaults, and trained longer with feedthrough. PyDynamic and our fit of a table get the "
        "21 complex sensitivities that `identify` reports as measured, with their standard "
        "uncertainties.",
    )
    return Section(
        "peers",
        f"Peers; errors are relative: {COLUMNS}",
        tuple(figures),
        {"versions": versions},
        remarks,
    )


def _records(calibration: Calibration) -> list[Match]:
    evidence = Evidence.gather(calibration, model())
    data = {
        "reference": np.array([record.reference for record in calibration.records]),
        "response": np.array([record.response for record in calibration.records]),
        "rate_hz": RATE_HZ,
    }
    default = {**data, "adam_epochs": 0, "lbfgs_epochs": 1000, "feedthrough": False}
    longer = {**data, "adam_epochs": 1000, "lbfgs_epochs": 1000, "feedthrough": True}

    def match(settings: str, arrays: dict[str, Any]) -> Match:
        return Match(
            "jax-sysid",
            "jax_sysid_peer.py",
            settings,
            arrays,
            "ipnn fit",
            lambda: Ipnn().fit(evidence),
            repeats=5,
        )

    return [match("L-BFGS", default), match("Adam, L-BFGS, D", longer)]


def measured_response(calibration: Calibration) -> tuple[FloatArray, ComplexArray, FloatArray]:
    """Return frequencies, complex sensitivities and the deviation of their parts, each (n,)."""
    measured = identify(calibration, estimator="ml").measured
    frequency, magnitude, deviation = (
        np.array(column)
        for column in (measured.frequency_hz, measured.magnitude, measured.magnitude_uncertainty)
    )
    phase = np.deg2rad(np.array(measured.phase_deg, dtype=float))
    return frequency, magnitude * np.exp(1j * phase), deviation


def table_of(
    frequency: FloatArray, sensitivity: ComplexArray, deviation: FloatArray
) -> ResponseTable:
    """Return the same as magnitude and phase."""
    size = np.abs(sensitivity)
    return ResponseTable(frequency, size, np.angle(sensitivity), deviation, deviation / size)


def _response(calibration: Calibration) -> list[Match]:
    frequency, sensitivity, deviation = measured_response(calibration)
    table = table_of(frequency, sensitivity, deviation)
    evidence = Evidence.gather(Calibration(table=table, model=calibration.model), model())
    _ = evidence.first_look
    data = {
        "frequency_hz": frequency,
        "parts": np.concatenate([sensitivity.real, sensitivity.imag]),
        "deviation": np.concatenate([deviation, deviation]),
        "weighting": "cov",
    }

    def match(settings: str, uncertain: bool, repeats: int) -> Match:
        arrays = {**data, "uncertain": uncertain, "repeats": repeats}
        fit = MaximumLikelihood().fit
        return Match(
            "pydynamic",
            "pydynamic_peer.py",
            settings,
            arrays,
            "ml fit of the table",
            lambda: fit(evidence),
            repeats=15,
        )

    return [match("weighted, 10 000 draws", True, 3), match("no uncertainties", False, 15)]


def _played(match: Match, python: Path, pairs: int, versions: dict[str, Any]) -> list[Figure]:
    estimate = match.fit()  # warm
    theirs = []
    ours = []
    peer = {}
    for _ in range(pairs):
        try:
            peer = _peer(match, python)
        except subprocess.CalledProcessError as error:
            message = (error.stderr.strip().splitlines() or ["no message"])[-1]
            return [Figure(f"{match.peer} ({match.settings})", {}, note=f"failed: {message}")]
        theirs.append(peer["seconds"])
        ours.append(seconds(match.fit, match.repeats))
    versions[match.peer] = peer["versions"]
    ratio = Ratio(tuple(theirs), tuple(ours))
    errors = relative_errors(peer["parameters"])
    our_errors = relative_errors(estimate.coordinates.values(estimate.z))
    listed = " · ".join(STYLES["error"](our_errors[name]) for name in PARAMETERS)
    return [
        Figure(
            f"time: {match.peer} ({match.settings}) / {match.ours}",
            {"ratio": ratio.median},
            note=ratio.note,
        ),
        Figure(
            f"errors: {match.peer} ({match.settings})",
            errors,
            "error",
            note=f"{match.ours}: {listed}",
        ),
    ]


def _peer(match: Match, python: Path) -> dict[str, Any]:
    return ask(python, match.script, match.data)


def ask(python: Path, script: str, arrays: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a peer's script answers to these arrays, in its environment."""
    with tempfile.TemporaryDirectory(prefix="vibrident-peer-") as folder:
        source = Path(folder) / "in.npz"
        target = Path(folder) / "out.json"
        np.savez(source, **arrays)
        command = [str(python), str(HERE / script), str(source), str(target)]
        subprocess.run(command, check=True, capture_output=True, text=True)
        return json.loads(target.read_text())
