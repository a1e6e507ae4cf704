"""Data that do not suit the model are said, quietly: no Python warning, no u of zero or none beside a firm value."""

import warnings

import numpy as np
import pytest
from bench.unsuited import DAMPING, GAIN, NATURAL_HZ, UNSUITED, suited

from vibrident import VibridentError, identify

TRUE = {"sensitivity": GAIN, "natural_frequency": NATURAL_HZ, "damping_ratio": DAMPING}


#: What is wrong is named, and no Python warning given, in ``tests/fit/judge/test_remedy.py`` too; of a wrong quantity
#: in ``tests/fit/uncertainty/test_factors.py``.
NAMED_ELSEWHERE = ("missing delay", "missing high-pass", "missing second mode", "wrong quantity")


@pytest.mark.parametrize("kind", UNSUITED)
@pytest.mark.quick(*(kind for kind in UNSUITED if kind not in NAMED_ELSEWHERE))
def test_they_are_named_or_right_without_a_python_warning(kind):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            result = identify(UNSUITED[kind](np.random.default_rng(1)))
        except VibridentError:
            return
    if not result.warnings:  # a held input is told by the records, and modelled as such
        assert result.fit.adequate
        for name, value in TRUE.items():
            found = result.parameters[name]
            assert found.standard_uncertainty is not None
            assert abs(found.value - value) < 4.0 * found.standard_uncertainty
    for parameter in result.parameters.values():
        assert parameter.standard_uncertainty is None or parameter.standard_uncertainty > 0.0
        assert parameter.standard_uncertainty is not None or not parameter.identifiable


def test_what_suits_has_none():
    assert identify(suited(np.random.default_rng(1))).warnings == ()
