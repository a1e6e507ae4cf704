"""The optimiser and its covariance on NIST's Statistical Reference Datasets for nonlinear regression.

https://www.itl.nist.gov/div898/strd/nls/nls_main.shtml: certified estimates and standard deviations, to eleven digits,
from two starts each. The coordinates are relative to the start.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from vibrident.fit.information import inverse_normal
from vibrident.fit.optimise import levenberg_marquardt
from vibrident.fit.problem import Local


@dataclass(frozen=True)
class Dataset:
    x: np.ndarray
    y: np.ndarray
    model: object
    starts: tuple
    values: tuple
    deviations: tuple
    residual: float


MISRA1A = Dataset(
    np.array([77.6, 114.9, 141.1, 190.8, 239.9, 289.0, 332.8, 378.4, 434.8, 477.3, 536.8, 593.1, 689.1, 760.0]),
    np.array([10.07, 14.73, 17.94, 23.93, 29.61, 35.18, 40.02, 44.82, 50.76, 55.05, 61.01, 66.40, 75.47, 81.78]),
    lambda b, x: b[0] * (1.0 - np.exp(-b[1] * x)),
    ((500.0, 0.0001), (250.0, 0.0005)),
    (2.3894212918e02, 5.5015643181e-04),
    (2.7070075241e00, 7.2668688436e-06),
    1.2455138894e-01,
)
DANWOOD = Dataset(
    np.array([1.309, 1.471, 1.490, 1.565, 1.611, 1.680]),
    np.array([2.138, 3.421, 3.597, 4.340, 4.882, 5.660]),
    lambda b, x: b[0] * x ** b[1],
    ((1.0, 5.0), (0.7, 4.0)),
    (7.6886226176e-01, 3.8604055871e00),
    (1.8281973860e-02, 5.1726610913e-02),
    4.3173084083e-03,
)


@pytest.mark.parametrize("start", [0, 1])
@pytest.mark.parametrize("data", [MISRA1A, DANWOOD], ids=["Misra1a", "DanWood"])
def test_certified_estimates_and_deviations(data, start):
    begin = np.array(data.starts[start])

    def residual(z):
        return data.y - data.model(z * begin, data.x)

    def objective(z, args):
        """Slopes by a complex step, which subtracts nothing: they are exact to rounding."""
        slopes = [residual(z + 1e-30j * direction).imag / 1e-30 for direction in np.eye(2)]
        return Local.of(residual(z), np.stack(slopes, axis=1))

    trace = levenberg_marquardt(objective, np.ones(2), None, tolerance=1e-20, max_evaluations=200)
    found = trace.last * begin
    local = objective(trace.last, None)
    variance = float(local.cost) / (len(data.x) - 2)
    deviation = np.sqrt(np.diag(inverse_normal(np.asarray(local.matrix))) * variance) * begin
    assert trace.converged
    assert found == pytest.approx(data.values, rel=1e-8)
    assert deviation == pytest.approx(data.deviations, rel=1e-7)
    assert float(local.cost) == pytest.approx(data.residual, rel=1e-9)
