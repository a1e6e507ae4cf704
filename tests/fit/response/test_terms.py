"""Terms of a sine fit by tables are those written out, sample by sample."""

import numpy as np
import pytest

from vibrident.fit.response.terms import Exponentials, TermTable, fitted

TURNS = 0.0123


@pytest.mark.parametrize("pole", [-2e-4 + 0.0125j * 2 * np.pi, -0.03 + 0j, -1e-3 + 2e-3j])
def test_terms_by_tables_are_those_written_out(pole):
    first, n = 37, 5003
    exponents = np.append(2j * np.pi * TURNS * np.arange(1, 4), pole)
    place, trend = np.arange(first, first + n), np.linspace(-0.4, 0.5, n)
    waves = np.exp(np.multiply.outer(exponents, place))
    rows = np.concatenate([waves.real, waves.imag, np.ones((1, n)), trend[None]])
    order = np.array([0, 4, 1, 5, 2, 6, 8, 9, 3, 7] if pole.imag else [0, 4, 1, 5, 2, 6, 8, 9, 3])
    tabled, written = Exponentials.of(exponents, first, trend, order), TermTable.of(rows[order])
    size = np.sqrt(np.diag(written.gram))
    assert np.max(np.abs(tabled.gram - written.gram) / np.outer(size, size)) < 1e-11
    values = np.random.default_rng(1).standard_normal(n) + rows[0]
    assert tabled.products(values) == pytest.approx(written.products(values), abs=1e-12 * n)
    which = np.array([0, 1, 6, 7])
    for one, other in ((tabled, written), (tabled.only(which), written.only(which))):
        assert fitted(one, values)[1] == pytest.approx(fitted(other, values)[1], abs=1e-9)
        amounts = np.arange(1.0, len(one.gram) + 1.0)
        assert one.sum(amounts) == pytest.approx(other.sum(amounts), abs=1e-10)
