"""Extended Kalman filter of filterpy on the tracked records: ``python X.py IN OUT``.

IN (npz): inputs of the network's cell, shape (runs, samples, q), responses, shape (runs, samples),
start values of sensitivity, natural frequency and damping ratio, shape (runs, 3), their relative
standard uncertainty, the standard deviation of the noise, shape (runs,), interval_s. OUT (JSON):
values and standard uncertainties at the end, shape (runs, 3), seconds a sample, versions. The state
is that of the network's cell with the three parameters beside it, in units of their start values;
no process noise, as the sensor is constant. Imports only what that environment holds.
"""

import importlib.metadata
import json
import sys
import time
from pathlib import Path

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

# Of the matrix exponential, whose argument has a norm below 64: an error below 1e-12.
SQUARINGS = 6
TAYLOR = 9
STEP = 1e-6  # of the finite differences
UNKNOWN = 1e3  # standard deviation of the initial states, in units of the response's


def weights(values, terms, interval_s):
    """Return transition and drive of a step.

    Its inputs are the Legendre coefficients of the reference over it.

    ``values``: shape (k, 3); the weights have k in front.
    """
    gain = values[:, 0]
    w = 2.0 * np.pi * values[:, 1] * interval_s
    damping = values[:, 2]
    g = np.zeros((len(values), 2 + terms, 2 + terms))
    g[:, 0, 1] = w
    g[:, 1, 0] = -w
    g[:, 1, 1] = -2.0 * w * damping
    for j in range(terms):
        g[:, 1, 2 + j] = w * gain * (-1.0) ** j
        for i in range(j - 1, -1, -2):
            g[:, 2 + i, 2 + j] = 2.0 * (2.0 * i + 1.0)
    g /= 2.0**SQUARINGS
    identity = np.eye(2 + terms)
    exponential = identity + g / TAYLOR
    for k in range(TAYLOR - 1, 0, -1):
        exponential = identity + g @ exponential / k
    for _ in range(SQUARINGS):
        exponential = exponential @ exponential
    return exponential[:, :2, :2], exponential[:, :2, 2:]


class Filter(ExtendedKalmanFilter):
    """State: the cell's two, and the parameters over their start values."""

    def __init__(self, start, terms, interval_s):
        super().__init__(dim_x=5, dim_z=1)
        self.start = start
        self.terms = terms
        self.interval_s = interval_s

    def predict_x(self, u=0):
        """Propagate by the cell, and linearise it."""
        state = self.x[:2, 0]
        theta = self.x[2:, 0]
        moved = theta + STEP * np.vstack([np.zeros(3), np.eye(3)])
        phi, gamma = weights(moved * self.start, self.terms, self.interval_s)
        after = phi @ state + gamma @ u
        self.F = np.eye(5)
        self.F[:2, :2] = phi[0]
        self.F[:2, 2:] = (after[1:] - after[0]).T / STEP
        self.x[:2, 0] = after[0]


def main(source: str, target: str) -> None:
    """Filter each run, write the parameters at its end."""
    data = np.load(source)
    values = []
    uncertainties = []
    seconds = 0.0
    row = np.array([[1.0, 0.0, 0.0, 0.0, 0.0]])
    runs = zip(data["inputs"], data["response"], data["start"], data["noise"], strict=True)
    for inputs, response, start, noise in runs:
        begin = time.process_time()
        filter_ = Filter(start, inputs.shape[1], float(data["interval_s"]))
        filter_.x = np.array([[0.0, 0.0, 1.0, 1.0, 1.0]]).T
        filter_.P = np.diag(
            [(UNKNOWN * np.std(response)) ** 2] * 2 + [float(data["relative_u"]) ** 2] * 3
        )
        filter_.R = np.array([[noise**2]])
        filter_.Q = np.zeros((5, 5))
        for c, y in zip(inputs, response, strict=True):
            filter_.update(np.array([[y]]), lambda x: row, lambda x: row @ x)
            filter_.predict(c)
        seconds += time.process_time() - begin
        values.append((filter_.x[2:, 0] * start).tolist())
        uncertainties.append((np.sqrt(np.diag(filter_.P)[2:]) * start).tolist())
    outcome = {
        "values": values,
        "uncertainties": uncertainties,
        "seconds": seconds / data["response"].size,
    }
    out = {"ekf": outcome}
    out["versions"] = {
        name: importlib.metadata.version(name) for name in ("filterpy", "numpy", "scipy")
    }
    Path(target).write_text(json.dumps(out))


if __name__ == "__main__":
    main(*sys.argv[1:3])
