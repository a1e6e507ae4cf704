"""The GUM's own examples through the package's propagation: correlated inputs (H.2), degrees of freedom (H.1).

JCGM 100:2008. The example's quantities take the place of a sensor's parameters; coordinates, slopes, propagation by
automatic differentiation, correlation, Welch–Satterthwaite and coverage factor are those of every result.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from vibrident.base.backend import jnp
from vibrident.fit.problem import Coordinates
from vibrident.fit.uncertainty.budget import BudgetRow, effective_degrees_of_freedom
from vibrident.fit.uncertainty.parameters import correlation, coverage_factor, parameter_table
from vibrident.physics.models import Derived, Model, ParameterSpec, SensorModel

#: Table H.2: five simultaneous observations of V in V, I in A, φ in rad.
OBSERVED = np.array(
    [
        [5.007, 4.994, 5.005, 4.990, 4.999],
        [19.663e-3, 19.639e-3, 19.640e-3, 19.685e-3, 19.678e-3],
        [1.0456, 1.0438, 1.0468, 1.0428, 1.0433],
    ]
)
MEASURED = ("voltage", "current", "phase")
WANTED = {
    "resistance": lambda p: p["voltage"] / p["current"] * jnp.cos(p["phase"]),
    "reactance": lambda p: p["voltage"] / p["current"] * jnp.sin(p["phase"]),
    "impedance": lambda p: p["voltage"] / p["current"],
}


def circuit() -> SensorModel:
    """V, I and φ as parameters, one of each kind of coordinate; R, X, Z and their sums in pairs as derived ones."""
    kinds = {"voltage": "gain", "current": "log", "phase": "ratio"}
    derived = [Derived(name, "Ω", value) for name, value in WANTED.items()]
    for one, other in itertools.combinations(WANTED, 2):
        derived.append(
            Derived(f"{one}_plus_{other}", "Ω", lambda p, one=one, other=other: WANTED[one](p) + WANTED[other](p))
        )
    specs = tuple(ParameterSpec(name, "1", kind) for name, kind in kinds.items())
    core = Model("circuit", lambda s, **values: 1.0, specs, derived=tuple(derived))
    return SensorModel("circuit", core)


@pytest.fixture(scope="module")
def estimated():
    """Coordinates, z and the covariance of z of the means."""
    mean = OBSERVED.mean(axis=1)
    start = dict(zip(MEASURED, mean * [1.01, 0.97, 1.0], strict=True))  # away from the estimate, as a fit's are
    coordinates = Coordinates.at(circuit(), start, (1e-3, 1e3))
    z = np.array([1 / 1.01, -np.log(0.97), mean[2]])
    assert list(coordinates.values(z).values()) == pytest.approx(mean.tolist(), rel=1e-14)
    change = coordinates.slopes(z)
    return coordinates, z, np.cov(OBSERVED) / 5.0 / np.outer(change, change)


def test_gum_h2_means_and_their_correlation(estimated):
    """Table H.2: u(V) = 0.0032 V, u(I) = 0.0095 mA, u(φ) = 0.00075 rad; r = −0.36, 0.86, −0.65."""
    coordinates, z, covariance = estimated
    table = parameter_table(coordinates, z, covariance, 4.0, {}, {})
    u = [table[name].standard_uncertainty for name in MEASURED]
    assert (round(u[0], 4), round(u[1], 7), round(u[2], 5)) == (0.0032, 9.5e-6, 0.00075)
    r = np.array(correlation(coordinates.model, covariance).matrix)
    assert (round(r[0, 1], 2), round(r[0, 2], 2), round(r[1, 2], 2)) == (-0.36, 0.86, -0.65)


def test_gum_h2_resistance_and_reactance(estimated):
    """Table H.4: R = 127.732(71) Ω, X = 219.847(295) Ω, Z = 254.260(236) Ω; r = −0.588, −0.485, 0.993."""
    coordinates, z, covariance = estimated
    table = parameter_table(coordinates, z, covariance, 4.0, {}, {})
    assert [round(table[name].value, 3) for name in WANTED] == [127.732, 219.847, 254.260]
    u = {name: table[name].standard_uncertainty for name in WANTED}
    # To the last digit printed: u(X) is 0.2956 from these means and 0.2948 from X of each observation, approach 2.
    assert list(u.values()) == pytest.approx([0.071, 0.295, 0.236], abs=1e-3)
    found = []
    for one, other in itertools.combinations(WANTED, 2):  # u²(a + b) = u²(a) + u²(b) + 2 r u(a) u(b)
        together = table[f"{one}_plus_{other}"].standard_uncertainty
        found.append((together**2 - u[one] ** 2 - u[other] ** 2) / (2.0 * u[one] * u[other]))
    assert [round(r, 3) for r in found] == [-0.588, -0.485, 0.993]


def test_gum_h2_without_the_correlation_the_uncertainties_are_wrong(estimated):
    """H.2.4 warns of it: r left out, u(R) is nearly three times too large and u(X) too small by a third."""
    coordinates, z, covariance = estimated
    alone = parameter_table(coordinates, z, np.diag(np.diag(covariance)), 4.0, {}, {})
    assert alone["resistance"].standard_uncertainty > 2.5 * 0.071
    assert alone["reactance"].standard_uncertainty < 0.75 * 0.295


def test_gum_h1_effective_degrees_of_freedom_of_an_end_gauge():
    """H.1.6: 25, 9.7, 2.9 and 16.6 nm with 18, 25.6, 50 and 2 degrees of freedom: 32 nm with ν_eff = 16.7.

    The 9.7 nm are 5.8, 3.9 and 6.7 nm with 24, 5 and 8 degrees of freedom, together 25.6.
    """

    def row(u: float, freedom: float) -> BudgetRow:
        return BudgetRow("", "data", None, "nm", freedom, np.array([[u * u]]))

    difference = [row(5.8, 24.0), row(3.9, 5.0), row(6.7, 8.0)]
    # 25.45 from the unrounded 9.688 nm; the GUM goes on with 9.7.
    assert float(effective_degrees_of_freedom(difference)[0]) * (9.7 / 9.688) ** 4 == pytest.approx(25.6, abs=0.05)
    rows = [row(25.0, 18.0), row(9.7, 25.6), row(2.9, 50.0), row(16.6, 2.0)]
    assert round(float(np.sqrt(sum(r.covariance[0, 0] for r in rows)))) == 32
    # 16.76 from these printed figures, whose squares add up to 1003 nm²; the GUM has 1002 nm².
    assert float(effective_degrees_of_freedom(rows)[0]) == pytest.approx(16.7, abs=0.1)
    assert round(coverage_factor(16.0), 2) == 2.12  # Table G.2
