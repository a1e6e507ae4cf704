"""What a rejected model is said to do follows from what rejects it: all frequencies together, or one alone."""

import numpy as np
import pytest

from vibrident.fit.judge.misfit import describe_misfit
from vibrident.fit.uncertainty.adequacy import Points, assess


def judged(squares):
    """A model with a response of one, tested at as many frequencies with deviations of 0.1 %."""
    count = len(squares)
    hz = np.arange(1.0, count + 1.0)
    measured = 1.0 + 1e-3 * np.sqrt(squares) + 0j
    points = Points(hz, measured, np.full(count, 1e-3), ("r",) * count, np.asarray(squares), np.full(count, 1e3))
    adequacy = assess([points], 3)
    return adequacy, describe_misfit(adequacy, [points], lambda at: np.ones(len(at), complex))


def test_one_frequency_that_is_far_off_is_named_and_not_the_sum():
    """The sentence said that deviations were 0.97 times what the noise explains, of a rejected model."""
    adequacy, sentence = judged([1.8] * 199 + [31.0])
    assert not adequacy.adequate
    assert adequacy.chi2_reduced < 1.0
    assert "at 200 Hz: it is 5.5" in sentence
    assert "no further off than noise" in sentence


@pytest.mark.parametrize("worst", [4.0, 400.0])
def test_deviations_everywhere_are_said_of_all_frequencies(worst):
    adequacy, sentence = judged([4.0] * 199 + [worst])
    assert not adequacy.adequate
    assert "times what the noise explains" in sentence
