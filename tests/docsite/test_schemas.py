"""The published schemas accept what this version writes and reads, and refuse what it refuses."""

from __future__ import annotations

import copy
import json
import tomllib

import jsonschema
import pytest
from docsite.schemas import SCHEMAS, calibration_schema, result_schema, text
from tests.support.sample_results import SAMPLES, table2
from tests.support.sources import ROOT

import vibrident
from vibrident.base.errors import InputError
from vibrident.data.io.writer import write_calibration
from vibrident.physics.simulation import simulate
from vibrident.result import Result
from vibrident.result.document import plain

RESULT = jsonschema.Draft202012Validator(result_schema())
CALIBRATION = jsonschema.Draft202012Validator(calibration_schema())


def calibration_files():
    return sorted([*(ROOT / "tests" / "calibrations").glob("*.toml"), *(ROOT / "examples").rglob("calibration*.toml")])


@pytest.mark.parametrize("make", SCHEMAS.values())
def test_each_is_a_schema_and_a_file(make):
    schema = json.loads(text(make()))
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema == make()


@pytest.mark.parametrize("name", SAMPLES)
def test_results_are_valid(name):
    result = SAMPLES[name]()
    for each in (result, result.without_excerpts()):
        RESULT.validate(json.loads(each.to_json()))


def test_an_identification_as_of_the_demo_is_valid(tmp_path):
    calibration = simulate("paper", frequencies_hz=(100.0, 300.0, 800.0), samples=2000, response_noise=0.01, seed=1)
    file = write_calibration(tmp_path, calibration)
    CALIBRATION.validate(plain(tomllib.loads(file.read_text(encoding="utf-8"))))
    RESULT.validate(json.loads(vibrident.identify(file).to_json()))


def test_fields_of_later_versions_are_valid():
    document = json.loads(table2(codes=("drift",)).to_json())
    document["later"] = document["fit"]["later"] = document["parameters"]["delay"]["later"] = {"a": 1}
    document["warnings"][0]["code"] = "moonstruck"
    RESULT.validate(document)


def wrong_results():
    document = json.loads(table2(codes=("drift",)).to_json())
    changes = [("schema", "vibrident.result/2"), ("fit", []), ("model", 3), ("warnings", [{"code": "drift"}])]
    for name, value in changes:
        yield document | {name: value}
    for name in ("schema", "parameters", "correlation", "fit", "response", "measured"):
        yield {key: value for key, value in document.items() if key != name}
    other = copy.deepcopy(document)
    other["parameters"]["delay"]["value"] = "1 µs"
    yield other
    other = copy.deepcopy(document)
    del other["response"]["magnitude"]
    yield other


@pytest.mark.parametrize("document", list(wrong_results()))
def test_what_the_program_refuses_is_not_valid(document):
    assert not RESULT.is_valid(document)
    with pytest.raises(InputError):
        Result.from_dict(document)


@pytest.mark.parametrize("file", calibration_files(), ids=lambda file: file.stem)
def test_calibration_files_are_valid_and_those_with_an_unknown_key_are_not(file):
    document = plain(tomllib.loads(file.read_text(encoding="utf-8")))
    CALIBRATION.validate(document)
    assert not CALIBRATION.is_valid({**document, "refrence": {}})
    assert not CALIBRATION.is_valid({**document, "response": {**document.get("response", {}), "scle": 1.0}})
    assert not CALIBRATION.is_valid({**document, "sampling": {"rate_hz": "fast"}})
