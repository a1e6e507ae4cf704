"""What is shown as a command is what was done."""

from __future__ import annotations

import shlex

import pytest

from vibrident.app.cli.options import DISCRETISATIONS, UNCERTAINTIES
from vibrident.app.web.session import safe_name
from vibrident.app.web.tasks import identify_request
from vibrident.app.workflow.estimators import estimator_names


@pytest.mark.parametrize("estimator", estimator_names())
@pytest.mark.parametrize("discretisation", DISCRETISATIONS)
@pytest.mark.parametrize("uncertainty", UNCERTAINTIES)
def test_the_command_names_every_option(estimator, discretisation, uncertainty):
    choices = identify_request("calibration.toml", estimator, discretisation, uncertainty)
    _, verb, file, *words = shlex.split(choices.command)
    stated = dict(zip(words[::2], words[1::2], strict=True))
    assert (verb, file) == ("identify", "calibration.toml")
    assert {key[2:]: value for key, value in stated.items()} == choices.options
    assert ("--discretisation" in stated) == (estimator == "ipnn")  # the command line refuses it elsewhere


def test_a_name_that_was_made_safe_is_one_word_of_the_command():
    name = safe_name('my "$(calibration)" `of` today\\.toml')
    assert shlex.split(identify_request(name).command)[2] == name
