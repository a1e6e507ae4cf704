"""The coverage probability printed beside k = 2, and what a certificate loads to state it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import stdtr
from tests.support.sample_results import table2

from vibrident.show.coverage import coverage


@pytest.mark.parametrize("freedom", [0.3, 1.0, 2.0, 4.7, 30.0, 1690.0, 9.9e5])
def test_it_is_that_of_students_t(freedom):
    result = replace(table2(), settings={"effective_degrees_of_freedom": freedom})
    assert coverage(result).probability == pytest.approx(2 * stdtr(freedom, 2.0) - 1, abs=1e-8)


def test_it_grows_to_that_of_the_normal_distribution():
    stated = [{"effective_degrees_of_freedom": freedom} for freedom in (1.0, 3.0, 10.0, 100.0, 1e5, None)]
    found = [coverage(replace(table2(), settings=settings)).probability for settings in stated]
    assert np.all(np.diff(found) > 0)
    assert found[-1] == coverage(replace(table2(), settings={})).probability == pytest.approx(0.9544997361, abs=1e-10)
