"""What a certificate states: the measured value first, no rejected model, no phase of nobody."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from lxml import etree
from tests.support.printed import CERTIFICATE
from tests.support.sample_results import table2, table_only

from vibrident.base.nominal import Nominal
from vibrident.data.io.certificate import certificate_section
from vibrident.export import export
from vibrident.result import MeasuredCurve, Result
from vibrident.show import certificate_tables
from vibrident.show.certificate import certificate
from vibrident.show.certified import certified, states_phase
from vibrident.show.points import measured_at, reference_point, reference_value
from vibrident.use.conformity import judge_requirements

SPACE = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
COVERS = {"covers": ["noise", "gain", "phase"]}
AT_160 = Nominal(160.0, 10**2.2)


def stated(result: Result, **more) -> Result:
    return replace(result, certificate={**CERTIFICATE, **more}, uncertainty=COVERS)


def sections(result: Result) -> dict:
    return {part.name: part for part in certificate(result).sections}


def test_the_result_at_the_reference_frequency_is_the_measured_one():
    result = stated(table2())
    (i,) = np.flatnonzero(np.isclose(result.measured.frequency_hz, AT_160.frequency_hz))
    value = reference_value(result)
    assert value.magnitude == result.measured.magnitude[i]
    assert value.magnitude_uncertainty == result.measured.magnitude_uncertainty[i]
    labels = [str(label) for label, _ in certificate_tables.reference(result).rows]
    assert labels == [
        "Reference frequency",
        "Magnitude |S|, measured",
        "Phase of S, measured",
        "Magnitude |S|, identified model",
        "Phase of S, identified model",
    ]


def test_repeated_points_are_averaged_and_keep_what_they_share():
    noise, shared = np.array([0.01, 0.02]), 0.03
    u = np.hypot(noise, shared)
    phases = np.array([179.0, -179.0])
    f = np.full(2, 160.0)
    curve = MeasuredCurve(f, [1.0, 1.1], phases, u, u, magnitude_noise=noise, phase_deg_noise=noise)
    value = measured_at(replace(table2(), measured=curve), Nominal(160.0, 160.0))
    weights = noise**-2 / np.sum(noise**-2)
    assert value.magnitude == pytest.approx(weights @ [1.0, 1.1])
    assert value.magnitude_uncertainty == pytest.approx(np.hypot(shared, np.sum(noise**-2) ** -0.5))
    assert value.phase_deg == pytest.approx(weights @ [179.0, 181.0])


def test_where_nothing_was_measured_the_models_value_stands_alone():
    result = stated(table2(), reference_frequency_hz=170.0)
    assert reference_value(result) == reference_point(result)[0]
    labels = [str(label) for label, _ in certificate_tables.reference(result).rows]
    assert "Magnitude |S|, measured" not in labels


def test_no_u_of_the_model_is_below_that_of_the_measured_values():
    result = stated(table2())
    shown = certified(result)
    measured = result.measured
    least = np.min(measured.magnitude_uncertainty / measured.magnitude)
    f = np.log(shown.response.frequency_hz)
    u = measured.magnitude_uncertainty / measured.magnitude
    floor = np.interp(f, np.log(measured.frequency_hz), u)
    relative = shown.response.magnitude_uncertainty / shown.response.magnitude
    own = result.response.magnitude_uncertainty / result.response.magnitude
    assert np.allclose(relative, np.maximum(own, floor))
    assert np.any(relative > own)
    gain = shown.parameters["sensitivity"]
    assert gain.standard_uncertainty == pytest.approx(least * gain.value)
    assert any("is raised" in str(block.text) for block in sections(result)["statements"].blocks)


def test_a_model_that_is_less_certain_stays_as_it_is():
    result = stated(table2())
    wide = replace(result.response, magnitude_uncertainty=result.response.magnitude)
    wide = replace(wide, phase_deg_uncertainty=np.full(wide.frequency_hz.size, 90.0))
    parameters = dict(result.parameters)
    parameters["sensitivity"] = replace(parameters["sensitivity"], standard_uncertainty=1.0)
    result = replace(result, response=wide, parameters=parameters)
    assert certified(result) == result


def test_a_rejected_model_states_nothing():
    limits = [
        {"quantity": "natural_frequency", "low": 1.0},
        {"quantity": "sensitivity_deviation", "low": -50.0, "high": 50.0, "to_hz": 500.0},
    ]
    result = stated(table2(codes=("lack_of_fit",)), requirements=limits)
    made = sections(result)
    assert "parameters" not in made
    assert "budget" not in made
    assert "data reject the model" in str(made["sensitivity"].blocks[0].text)
    shown = certified(result)
    value = reference_value(shown)
    assert value.magnitude == reference_value(result).magnitude
    first, second = judge_requirements(shown, value.frequency_hz, (value.magnitude, value.magnitude_uncertainty))
    assert first.met is None
    assert second.met
    labels = [str(label) for label, _ in certificate_tables.reference(shown).rows]
    assert not [label for label in labels if "model" in label]


def test_a_rejected_model_is_in_no_digital_certificate(tmp_path):
    (path,) = export(stated(table2(codes=("lack_of_fit",))), "dcc", tmp_path, country="DE")
    names = {node.get("id") for node in etree.parse(str(path)).iterfind(".//dcc:result", SPACE)}
    assert "measured" in names
    assert "response" not in names


PHASES = {
    "measured and stated": (table2, {}, COVERS, True),
    "not asked for": (table2, {"quantities": ["magnitude"]}, COVERS, False),
    "no source": (table2, {}, {"covers": ["noise", "gain"]}, False),
    "a report": (table2, {}, {"covers": ["noise"]}, True),
    "not measured": (table_only, {}, COVERS, False),
}


@pytest.mark.parametrize(("make", "more", "covers", "there"), PHASES.values(), ids=PHASES)
def test_a_phase_is_stated_where_it_is_known(make, more, covers, there, tmp_path):
    result = replace(stated(make(), **more), uncertainty=covers)
    assert states_phase(result) is there
    shown = certified(result)
    tables = [certificate_tables.measured(shown), certificate_tables.sensitivity(shown)]
    for table in tables:
        assert any(str(column.title) == "phase" for column in table.columns) is there
    labels = [str(label) for label, _ in certificate_tables.reference(shown).rows]
    assert any("Phase" in label for label in labels) is there
    symbols = [row[0] for row in certificate_tables.parameters(shown).rows]
    assert ("delay" in symbols) is there
    (path,) = export(result, "dcc", tmp_path, country="DE")
    text = path.read_text(encoding="utf-8")
    assert ("Phase, lag negative" in text) is there
    assert (">delay<" in text) is there


def test_a_phase_that_nobody_measured_is_not_certified_from_its_model():
    """A magnitude alone has a model, and that has a phase."""
    full = table2()
    nothing = np.full(full.measured.frequency_hz.size, np.nan)
    measured = replace(full.measured, phase_deg=nothing, phase_deg_uncertainty=nothing)
    result = stated(replace(full, measured=measured))
    assert not states_phase(result)
    assert np.isnan(certified(result).response.phase_deg).all()


def test_magnitude_alone_asks_for_no_source_of_the_phase():
    result = replace(stated(table2(), quantities=["magnitude"]), uncertainty={"covers": ["noise", "gain"]})
    made = certificate(result)
    assert str(made.title) == "Calibration certificate"
    assert "not certified" not in repr(made.head)


def test_the_key_takes_one_or_both():
    for given, kept in (("magnitude", ["magnitude"]), (["magnitude", "phase"], ["magnitude", "phase"])):
        assert certificate_section({"quantities": given}, "test")["quantities"] == kept
