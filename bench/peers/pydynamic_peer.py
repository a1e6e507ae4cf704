"""Fits of PyDynamic on the response of the benchmark: ``python X.py IN.npz OUT.json``.

IN: frequency_hz, shape (n,); parts and deviation of parts, shape (2 n,), real parts first;
uncertain (with uncertainties), weighting (of the fit) and repeats; where there are draws, shape (m,
2 n), each is fitted too. OUT: parameters, median seconds of ``fit_som`` after one untimed call,
versions, and values and standard uncertainties of the draws in the order of the parameters, each of
shape (m, 3). Imports only what that environment holds.
"""

import importlib.metadata
import json
import sys
import time
import warnings
from pathlib import Path

import numpy as np

warnings.simplefilter("ignore", DeprecationWarning)  # the archived project warns on import
from PyDynamic import fit_som  # noqa: E402

MONTE_CARLO_RUNS = 10000  # its default


def main(source: str, target: str) -> None:
    """Fit, time, write."""
    data = np.load(source)
    frequency = data["frequency_hz"]
    parts = data["parts"]
    settings = {}
    if bool(data["uncertain"]):
        weighting = str(data["weighting"]) or None  # empty: its default, equal weights
        settings = {"UH": data["deviation"], "weighting": weighting, "MCruns": MONTE_CARLO_RUNS}
    np.random.seed(1)  # noqa: NPY002 - the generator it uses
    fitted = fit_som(frequency, parts, **settings)
    seconds = []
    for _ in range(int(data["repeats"])):
        begin = time.perf_counter()
        fitted = fit_som(frequency, parts, **settings)
        seconds.append(time.perf_counter() - begin)
    values = fitted[0] if isinstance(fitted, tuple) else fitted
    parameters = {
        "sensitivity": float(values[0]),
        "natural_frequency": float(values[2]),
        "damping_ratio": float(values[1]),
    }
    versions = {name: importlib.metadata.version(name) for name in ("PyDynamic", "numpy", "scipy")}
    out = {"parameters": parameters, "seconds": float(np.median(seconds)), "versions": versions}
    if "draws" in data:
        fits = [fit_som(frequency, draw, **settings) for draw in data["draws"]]
        order = [0, 2, 1]  # it gives S0, damping, natural frequency
        out["values"] = [np.asarray(values)[order].tolist() for values, _ in fits]
        out["uncertainties"] = [
            np.sqrt(np.diag(covariance))[order].tolist() for _, covariance in fits
        ]
    Path(target).write_text(json.dumps(out))


if __name__ == "__main__":
    main(*sys.argv[1:3])
