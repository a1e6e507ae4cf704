"""The optimum of the paper's own loss: the unrolled network of any discretisation under the plain mean squared error.

Adam comes near it; Levenberg–Marquardt reaches it, so that the remaining error is the discretisation's, not the
optimiser's. Initial state and offset of each record are eliminated; records are not weighted.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vibrident.discretize import method
from vibrident.estimators.optimise import levenberg_marquardt
from vibrident.models import parse
from vibrident.problem import Coordinates, network_objective, network_of
from vibrident.records import Calibration


def optimum(calibration: Calibration, discretisation: str, near: Mapping[str, float]) -> dict[str, float]:
    """Parameters of least mean squared error, sought from ``near``.

    Raises:
        NotConverged: the network is unstable there.
    """
    model = parse(calibration.model)
    frequencies = [record.frequency_hz or record.sampling_rate_hz / 4.0 for record in calibration.records]
    coordinates = Coordinates.at(model, near, (min(frequencies), max(frequencies)))
    start = {name: float(near[name]) for name in model.parameter_names}
    problem = network_of(calibration.records, model, method(discretisation), calibration.quantity, start)
    size = float(np.sqrt(np.mean([np.var(record.response) for record in calibration.records])))
    args = (coordinates, problem, np.full(len(calibration.records), size))
    trace = levenberg_marquardt(network_objective, coordinates.first, args, tolerance=1e-9)
    return coordinates.values(trace.last)
