"""JSON Schemas of the calibration file and of ``result.json``, from the code that checks them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

from vibrident.data.io.calibration_file import CalibrationFile
from vibrident.result import SCHEMA
from vibrident.result.document import UNKNOWN, plain
from vibrident.result.result import adapter

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def calibration_schema() -> dict[str, Any]:
    """Return the schema of ``calibration.toml``, as the JSON that its tables and values come to."""
    schema = CalibrationFile.model_json_schema()
    return {"$schema": DIALECT, **schema, "title": "calibration.toml of vibrident"}


def result_schema() -> dict[str, Any]:
    """Return the schema of ``result.json``; fields of later versions are allowed in every part."""
    schema = adapter().json_schema()
    schema["properties"] = {"schema": {"const": SCHEMA}, **schema["properties"]}
    schema["required"] = ["schema", *schema["required"]]
    for part in (schema, *schema["$defs"].values()):
        part["properties"].pop(UNKNOWN, None)
    # A default that is not known is NaN in a result and null in its file.
    return plain({"$schema": DIALECT, **schema, "title": "result.json of vibrident"})


#: File of the documentation → the schema that it holds.
SCHEMAS: Mapping[str, Callable[[], dict[str, Any]]] = {
    "schemas/calibration.schema.json": calibration_schema,
    "schemas/result.schema.json": result_schema,
}


def text(schema: Mapping[str, Any]) -> str:
    """Return a schema as JSON."""
    return json.dumps(schema, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
