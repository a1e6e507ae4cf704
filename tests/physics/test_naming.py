"""Messages name a parameter in words and give its number with a unit, whichever code they carry."""

from __future__ import annotations

import numpy as np
import pytest

import vibrident
from vibrident.base.amounts import amount
from vibrident.data.records import Calibration, ResponseTable
from vibrident.physics.models import ADD_ONS, parse
from vibrident.physics.naming import in_words

MODELS = [parse(name) for name in ("accelerometer", "velocity-pickup")]
NAMES = [spec.name for model in MODELS for spec in model.parameters]
NAMES += [spec.name for addon in ADD_ONS.values() for spec in addon.parameters]


def test_every_parameter_of_every_model_has_words():
    assert not [name for name in NAMES if "_" in in_words(name) or not in_words(name)]


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (812.3441, "Hz", "812.34 Hz"),
        (1.2e-6, "s", "1.2 µs"),
        (3.84e-7, "V", "384 nV"),
        (0, "V", "0 V"),
    ],
)
def test_numbers_carry_their_unit(value, unit, text):
    assert amount(value, unit) == text


def tabled(model, values, frequency, relative=1e-3):
    response = np.asarray(parse(model).frequency_response(values, frequency))
    u = np.full(frequency.size, relative)
    table = ResponseTable(frequency, np.abs(response), np.angle(response), u * np.abs(response), u)
    return Calibration(table=table, model="accelerometer+delay", response_unit="mV")


def test_no_message_of_a_fit_holds_a_parameters_name_as_the_program_writes_it():
    values = {"sensitivity": -2.0, "natural_frequency": 800.0, "damping_ratio": 0.01}
    far = tabled("accelerometer", values, np.geomspace(5.0, 60.0, 12))
    second = {"mode2_frequency": 900.0, "mode2_damping": 0.02, "mode2_gain": 0.05}
    bent = tabled("accelerometer+mode2", {**values, **second}, np.geomspace(50.0, 2000.0, 30))
    results = [vibrident.identify(one, estimator="ml") for one in (far, bent)]
    said = [one for result in results for one in (*result.warnings, *result.findings)]
    messages, codes = [one.message for one in said], {one.code for one in said}
    assert {"weakly_determined", "polarity", "lack_of_fit"} <= codes
    assert not [text for text in messages if any(f"{name}" in text for name in NAMES if "_" in name)]
