"""Results made by hand: a sensor whose parameters and covariance are stated, not identified."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vibrident.physics.models import parse
from vibrident.result import Correlation, Curve, Fit, MeasuredCurve, Parameter, Result

#: Relative standard uncertainties of a decent calibration.
DECENT = {"sensitivity": 1e-3, "generator_constant": 1e-3, "natural_frequency": 5e-4, "damping_ratio": 5e-3}


def known_result(
    model: str,
    values: Mapping[str, float],
    relative: Mapping[str, float] | None = None,
    correlation: np.ndarray | None = None,
    rng: np.random.Generator | None = None,
) -> Result:
    """A result with these values and uncertainties; with ``rng``, the values are a draw from them."""
    names = parse(model).parameter_names
    truth = np.array([values[name] for name in names])
    u = np.abs(truth) * np.array([(relative or {}).get(name, 0.0) for name in names])
    matrix = np.eye(len(names)) if correlation is None else correlation
    if rng is not None:
        truth = truth + rng.multivariate_normal(np.zeros(len(names)), matrix * np.outer(u, u))
    pairs = zip(names, truth, u, strict=True)
    return Result(
        model=model,
        estimator="ml",
        settings={"effective_degrees_of_freedom": 1e6},
        provenance={},
        parameters={name: Parameter(float(v), "1", float(s), (None, None)) for name, v, s in pairs},
        correlation=Correlation(names, tuple(tuple(row) for row in matrix.tolist())),
        fit=Fit(0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 1.0, 1, True),
        response=Curve((), (), (), (), ()),
        measured=MeasuredCurve((), (), (), (), ()),
        reference={"quantity": "acceleration", "unit": "m/s^2"},
    )
