"""Tails of distributions against SciPy's, from next to nothing to a million degrees of freedom."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import special

from vibrident.base.tails import chi2_tail, f_tail, gamma_tail, student_quantile

DEGREES = (0.5, 1.0, 2.0, 3.3, 10.0, 41.0, 200.0, 3e3, 1e5, 2e6)
CHANCES = (1e-8, 1e-5, 1e-3, 0.025, 0.3, 0.5, 0.9, 0.999)


@pytest.mark.parametrize("degrees", DEGREES)
def test_tails_are_scipys(degrees):
    for chance in CHANCES:
        value = special.chdtri(degrees, chance)
        assert chi2_tail(degrees, value) == pytest.approx(special.chdtrc(degrees, value), rel=1e-12)
        assert gamma_tail(degrees, value) == pytest.approx(special.gammaincc(degrees, value), rel=1e-12, abs=1e-290)
        for below in (1.0, 2.0, 5.0, 39.0, 1e4):
            value = special.fdtri(degrees, below, 1.0 - chance)
            assert f_tail(degrees, below, value) == pytest.approx(special.fdtrc(degrees, below, value), rel=1e-12)


def test_f_over_what_is_known_is_chi2():
    """No end of degrees of freedom below: the numerator's alone."""
    for above in (1.0, 3.0, 40.0):
        for value in (0.1, 1.0, 3.0):
            assert f_tail(above, np.inf, value) == pytest.approx(special.chdtrc(above, above * value), rel=1e-12)


@pytest.mark.parametrize("degrees", [1.0, 2.0, 5.5, 39.0, 3e5, 1e9])
def test_students_quantile_is_scipys(degrees):
    for chance in (0.6, 0.95, 0.975, 0.9995):
        assert student_quantile(degrees, chance) == pytest.approx(special.stdtrit(degrees, chance), rel=1e-13)


def test_what_no_distribution_has():
    """No value, nothing, everything: as SciPy has it, and it ends."""
    for value in (np.nan, np.inf, 0.0, -1.0):
        assert chi2_tail(3.0, value) == pytest.approx(special.chdtrc(3.0, max(value, 0.0)), nan_ok=True)
        assert f_tail(3.0, 4.0, value) == pytest.approx(special.fdtrc(3.0, 4.0, max(value, 0.0)), nan_ok=True)
    assert np.isnan(f_tail(2.0, 0.0, 1.0))
    assert np.isnan(student_quantile(0.0, 0.975))
