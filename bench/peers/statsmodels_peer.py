"""RecursiveLS of statsmodels on the tracked records: ``python X.py IN.npz OUT.json``.

IN: inputs of the network's cell, shape (runs, samples, q), responses, shape (runs, samples),
interval_s; columns of the network linearised at the start values, shape (runs, samples, m), the
parameters last, what the response is more than the network's, shape (runs, samples), and the start
values, shape (runs, 3). OUT: values and standard uncertainties of sensitivity, natural frequency
and damping ratio by either regression, shape (runs, 3), seconds a sample, versions.

``arx``: the state space as a regression on the last two responses and inputs; the parameters are
read from its poles and its gain at rest, their uncertainties by finite differences. ``linearised``:
on the columns. Imports only what that environment holds.
"""

import importlib.metadata
import json
import sys
import time
from pathlib import Path

import numpy as np
from statsmodels.regression.recursive_ls import RecursiveLS

#: Inputs of a step in ARX: mean and slope; with more of them its columns are collinear, and it
#: gives NaN.
TERMS = 2


def physical(coefficients, interval_s):
    """Sensitivity, natural frequency and damping ratio of y = a1 y1 + a2 y2 + b1 c1 + b2 c2."""
    a1, a2 = coefficients[:2]
    poles = np.log(np.roots([1.0, -a1, -a2]).astype(complex)) / interval_s
    angular = np.sqrt(np.abs(np.prod(poles)))
    # The first input of a step is its mean.
    gain = (coefficients[2] + coefficients[2 + TERMS]) / (1.0 - a1 - a2)
    return np.array([gain, angular / (2.0 * np.pi), -np.sum(poles).real / (2.0 * angular)])


def fitted(y, rows):
    """Coefficients, their covariance, seconds."""
    size = np.std(rows, axis=0)
    size[size == 0.0] = 1.0  # an offset
    begin = time.process_time()
    fit = RecursiveLS(y, rows / size).fit()
    seconds_ = time.process_time() - begin
    return (
        np.asarray(fit.params) / size,
        np.asarray(fit.cov_params()) / np.outer(size, size),
        seconds_,
    )


def arx(c, y, interval_s):
    """Return the values, standard uncertainties, seconds."""
    c = c[:, :TERMS]
    best, covariance, seconds_ = fitted(
        y[2:], np.hstack([y[1:-1, None], y[:-2, None], c[1:-1], c[:-2]])
    )
    slopes = []
    for step in np.diag(1e-4 * np.sqrt(np.diag(covariance))):
        either = [physical(best + sign * step, interval_s) for sign in (1.0, -1.0)]
        slopes.append((either[0] - either[1]) / (2.0 * step.sum()))
    j = np.array(slopes).T
    return physical(best, interval_s), np.sqrt(np.diag(j @ covariance @ j.T)), seconds_


def main(source: str, target: str) -> None:
    """Fit each run both ways, write the parameters."""
    data = np.load(source)
    out = {
        "versions": {
            name: importlib.metadata.version(name) for name in ("statsmodels", "numpy", "scipy")
        }
    }
    both = {"arx": [], "linearised": []}
    keys = ("inputs", "response", "columns", "more", "start")
    for c, y, columns, more, start in zip(*(data[key] for key in keys), strict=True):
        both["arx"].append(arx(c, y, float(data["interval_s"])))
        best, covariance, seconds_ = fitted(more, columns)
        both["linearised"].append(
            (start * (1.0 + best[-3:]), start * np.sqrt(np.diag(covariance)[-3:]), seconds_)
        )
    for kind, fits in both.items():
        values, uncertainties, seconds_ = zip(*fits, strict=True)
        seconds = sum(seconds_) / data["response"].size
        out[kind] = {
            "values": np.array(values).tolist(),
            "uncertainties": np.array(uncertainties).tolist(),
        }
        out[kind]["seconds"] = seconds
    Path(target).write_text(json.dumps(out))


if __name__ == "__main__":
    main(*sys.argv[1:3])
