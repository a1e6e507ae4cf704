"""A result file of another version: read, said, and given back whole; or refused where its schema is another."""

from __future__ import annotations

import copy
import json
import logging
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.sample_results import SAMPLES, excerpt, single_point, table2

from vibrident.base.errors import InputError
from vibrident.result import Finding, Result
from vibrident.result.document import UNKNOWN
from vibrident.show import fit_figures, report
from vibrident.show.numbers import fit_unit

FINDINGS = (Finding("drift", "a", 0.1, 1e-9, {"sensitivity": 1e-4}, "a drifts."),)
TIME_S = np.arange(6) / 1000
#: Mappings whose entries are of one kind each, by place: a new entry is data and no field.
DATA = {("parameters",), ("training", "parameters"), ("findings", "[]", "impact")}

numbers = st.integers() | st.floats(allow_nan=False, allow_infinity=False)
values = st.recursive(
    st.none() | st.booleans() | numbers | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=6,
)
names = st.text(min_size=1, max_size=8) | st.sampled_from([UNKNOWN, "time_s", "schema ", "später"])
extras = st.lists(st.tuples(st.integers(0, 10_000), names, values), min_size=1, max_size=12)


def whole(codes=("drift",)) -> Result:
    """Everything that a result may hold, at one frequency."""
    made, one = table2(codes=codes), single_point()
    return replace(
        made,
        response=one.response,
        measured=one.measured,
        signals=(excerpt("a", TIME_S, np.cos(TIME_S), np.sin(TIME_S), "V", 0.1, 0.2),),
        findings=FINDINGS,
        certificate={"number": "1"},
    )


def mappings(value: object, place: tuple = ()) -> Iterator[dict]:
    """Every object of a document that has fields."""
    if isinstance(value, dict):
        if place not in DATA:
            yield value
        for name, item in value.items():
            yield from mappings(item, (*place, name))
    if isinstance(value, list):
        for item in value:
            yield from mappings(item, (*place, "[]"))


@settings(max_examples=40)
@given(extras)
def test_fields_of_a_later_version_are_given_back_wherever_they_are(drawn):
    document = json.loads(whole().to_json())
    places = list(mappings(document))
    for at, name, value in drawn:
        places[at % len(places)].setdefault(name, copy.deepcopy(value))
    first = Result.from_dict(json.loads(json.dumps(document)))
    again = json.loads(first.to_json())
    assert again == document
    assert Result.from_dict(again).to_json() == first.to_json()
    # what is changed meanwhile takes nothing along
    changed = replace(first, parameters=dict(first.parameters), warnings=first.warnings, estimator="x")
    assert changed.to_dict() == {**document, "estimator": "x"}


def test_fields_are_kept_in_every_part(tmp_path):
    """The law above draws places; here is every one of them."""
    document = json.loads(whole().to_json())
    for number, place in enumerate(list(mappings(document))):
        place["later"] = {"number": number}
    assert Result.from_dict(document).to_dict() == document
    file = tmp_path / "later.json"
    file.write_text(json.dumps(document), encoding="utf-8")
    assert json.loads(Result.load(file).save(file).read_text(encoding="utf-8")) == document


def test_codes_that_are_not_known_are_kept_and_explained():
    document = whole().to_dict()
    document["warnings"].append({"code": "moonstruck", "message": "The moon was full."})
    document["findings"][0]["code"] = "moonstruck"
    result = Result.from_dict(document)
    assert result.warning_codes == ("drift", "moonstruck")
    assert result.to_dict() == document
    assert "The moon was full." in report.render(result)
    assert result.unknown == ("warnings: moonstruck", "findings: moonstruck")


def test_what_is_not_known_is_said_once_a_file(tmp_path, caplog):
    document = whole().to_dict()
    assert Result.from_dict(document).unknown == ()
    document["colour"] = document["fit"]["aic"] = document["parameters"]["delay"]["prior"] = 1
    document["sensor"]["year"] = 1999
    document["warnings"][0]["code"] = "moonstruck"
    file = tmp_path / "later.json"
    file.write_text(json.dumps(document), encoding="utf-8")
    with caplog.at_level(logging.WARNING):
        for _ in range(3):
            Result.load(file)
    (said,) = caplog.messages
    places = ("colour", "fit.aic", "parameters.delay.prior", "sensor", "warnings: moonstruck")
    assert str(file) in said
    assert all(place in said for place in places)


def test_another_major_schema_is_refused():
    with pytest.raises(InputError, match=r"vibrident\.result/2"):
        Result.from_dict({**whole().to_dict(), "schema": "vibrident.result/2"})


@pytest.mark.parametrize("name", SAMPLES)
def test_every_result_is_read_as_it_was_written(name, tmp_path):
    result = SAMPLES[name]()
    assert Result.load(result.save(tmp_path / "r.json")).to_json() == result.to_json()
    assert result.unknown == ()


@given(st.lists(st.floats(-1e30, 1e30).filter(lambda x: abs(x) > 1e-30), min_size=2, max_size=30), st.integers(0, 9))
def test_an_excerpt_has_six_digits_of_each_value_and_of_each_residual(measured, places):
    measured = np.array(measured)
    residual = measured * 10.0**-places / 3.0
    signal = excerpt("a", 0.1 + 0.01 * np.arange(measured.size), measured, measured - residual)
    exact = measured - (measured - residual)
    assert np.all(np.abs(signal.measured - measured) <= 5.000001e-6 * np.abs(measured))
    assert np.all(np.abs(signal.residual - exact) <= 5.000001e-6 * np.abs(exact))
    again = replace(signal, record="b")
    assert np.array_equal(again.measured, signal.measured)
    assert all(float(f"{value:.6g}") == value for value in signal.measured.tolist())


def earlier(document: dict, time_s, measured, predicted) -> dict:
    """A document with an excerpt as earlier versions wrote it."""
    columns = {"time_s": time_s.tolist(), "measured": measured.tolist(), "predicted": predicted.tolist()}
    return {**document, "signals": [{"record": "a", **columns, "unit": "V", "rmse": 0.1, "nrmse": 0.2}]}


def test_excerpts_of_earlier_versions_are_read(rng):
    time_s = 3.0 + np.arange(50) / 51200.0
    measured, predicted = rng.standard_normal((2, 50))
    document = whole().to_dict()
    (signal,) = Result.from_dict(earlier(document, time_s, measured, predicted)).signals
    np.testing.assert_allclose(signal.time_s, time_s, rtol=0, atol=1e-9)
    np.testing.assert_allclose(signal.measured, measured, rtol=5e-6)
    np.testing.assert_allclose(signal.residual, measured - predicted, rtol=5e-6)
    assert (signal.rmse, signal.nrmse, signal.unit) == (0.1, 0.2, "V")
    used = np.delete(np.arange(50), [7, 8, 30])  # samples that took no part
    (gaps,) = Result.from_dict(earlier(document, time_s[used], measured[used], predicted[used])).signals
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(gaps.measured)), [7, 8, 30])
    np.testing.assert_array_equal(gaps.measured[used], signal.measured[used])
    with pytest.raises(InputError, match="differ in length"):
        Result.from_dict(earlier(document, time_s[:-1], measured, predicted))
    for odd in (np.zeros(50), time_s[::-1], np.append(time_s[:-1], 1e9), np.full(50, np.nan)):
        assert Result.from_dict(earlier(document, odd, measured, predicted)).signals[0].measured.size <= 100_000


def test_a_result_without_excerpts_says_the_rest(tmp_path):
    full = whole()
    bare = Result.load(full.save(tmp_path / "r.json", excerpts=False))
    assert bare.to_json() == full.without_excerpts().to_json()
    assert [(s.record, s.rmse, s.nrmse) for s in bare.signals] == [(s.record, s.rmse, s.nrmse) for s in full.signals]
    assert replace(bare, signals=()).to_json() == replace(full, signals=()).to_json()
    assert fit_unit(bare) == fit_unit(full)
    assert fit_figures.signals(bare) is None
    by_record, of_full = (fit_figures.residuals(result).stacks[0].panels[0] for result in (bare, full))
    np.testing.assert_array_equal(by_record.series[0].y, of_full.series[0].y)
    assert "Residuals" in report.render(bare)
