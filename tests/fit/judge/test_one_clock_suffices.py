"""Two clocks are said of data only where one does not explain them as well."""

from dataclasses import dataclass
from types import SimpleNamespace

import pytest
from bench.adversary.cases import BY_NAME
from bench.adversary.judge import judged

from vibrident.fit.judge.clocks import _fit_at_one_clock, _suffices
from vibrident.fit.uncertainty.explained import UNKNOWN_SHARES


def fit(adequate, explained, chi2=1.0):
    return SimpleNamespace(adequate=adequate, judgement=SimpleNamespace(unexplained=1.0 - explained), chi2=chi2)


@pytest.mark.parametrize(
    ("at_no_offset", "suffices"),
    [
        (fit(True, 0.999), True),
        (fit(True, 0.9985), True),
        (fit(True, 0.99), False),  # a misfit that passes for noise
        (fit(False, 0.999), False),
    ],
)
def test_one_clock_suffices_where_it_explains_as_much(at_no_offset, suffices):
    assert _suffices(at_no_offset, fit(True, 0.999), has_offset=True) is suffices


def test_where_two_clocks_explain_nothing_the_better_fit_is_kept():
    rejected = fit(False, 0.5, chi2=4.0)
    assert _suffices(fit(False, 0.5, chi2=3.0), rejected, has_offset=False)
    assert _suffices(fit(True, 0.5, chi2=5.0), rejected, has_offset=False)
    assert not _suffices(fit(False, 0.5, chi2=5.0), rejected, has_offset=False)


def test_a_fit_at_a_wrong_clock_is_no_start_at_one_clock():
    """Ringing of a whole record let another clock seem to explain more, and its fit led nowhere at one clock."""
    assert judged(BY_NAME["clean/below-light+delay=300/multisine/16 bit"].trial(115))["class"] == "right"


def test_a_fit_that_leaves_nothing_to_compare_is_none_at_one_clock():
    """Of two clocks 2e-3 apart it was taken for the better one, as adequate as nothing is."""

    @dataclass(frozen=True)
    class Stub:
        is_trial: bool = False
        evidence: object = None
        judgement: object = None

    rejected = Stub(judgement=SimpleNamespace(shares=UNKNOWN_SHARES))
    best = SimpleNamespace(evidence=SimpleNamespace(at_clock=lambda _: Stub()), once=lambda _: rejected)
    assert _fit_at_one_clock(best) is None
