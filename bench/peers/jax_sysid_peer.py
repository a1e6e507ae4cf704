"""Fits of jax-sysid on the records of the benchmark: ``python X.py IN.npz OUT.json``.

IN: reference and response, shape (records, samples), rate_hz, adam_epochs, lbfgs_epochs,
feedthrough. OUT: parameters in the units of IN, seconds of ``fit``, versions. A two-state model
without physics is trained, one initial state a record; the parameters are then read from its poles
and its gain at zero frequency. Imports only what that environment holds.
"""

import importlib.metadata
import json
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("JAX_PLATFORMS", "cpu")

import numpy as np
from jax_sysid.models import LinearModel


def main(source: str, target: str) -> None:
    """Train, read the parameters, write them."""
    data = np.load(source)
    reference = data["reference"]
    response = data["response"]
    # One scale a channel for all records: L-BFGS wants numbers near one.
    reference_scale = float(np.std(reference))
    response_scale = float(np.std(response))
    model = LinearModel(nx=2, ny=1, nu=1, feedthrough=bool(data["feedthrough"]))
    model.loss(rho_x0=0.0, rho_th=0.0, train_x0=True)
    epochs = {name: int(data[name]) for name in ("adam_epochs", "lbfgs_epochs")}
    model.optimization(**epochs, iprint=-1)
    outputs = [row[:, None] / response_scale for row in response]
    inputs = [row[:, None] / reference_scale for row in reference]
    begin = time.perf_counter()
    model.fit(outputs, inputs)
    seconds = time.perf_counter() - begin
    a, b, c, d = (np.asarray(matrix) for matrix in model.ssdata())
    poles = np.log(np.linalg.eigvals(a).astype(complex)) * float(data["rate_hz"])
    angular = float(np.sqrt(np.abs(np.prod(poles))))
    gain = (
        float((c @ np.linalg.solve(np.eye(2) - a, b) + d)[0, 0]) * response_scale / reference_scale
    )
    parameters = {
        "sensitivity": gain,
        "natural_frequency": angular / (2.0 * np.pi),
        "damping_ratio": float(-np.sum(poles).real / (2.0 * angular)),
    }
    versions = {
        name: importlib.metadata.version(name) for name in ("jax-sysid", "jax", "numpy", "scipy")
    }
    Path(target).write_text(
        json.dumps({"parameters": parameters, "seconds": seconds, "versions": versions})
    )


if __name__ == "__main__":
    main(*sys.argv[1:3])
