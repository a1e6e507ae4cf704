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
    made = CalibrationFile.model_json_schema()
    return {"$schema": DIALECT, **made, "title": "calibration.toml of vibrident"}


def result_schema() -> dict[str, Any]:
    """Return the schema of ``result.json``; fields of later versions are allowed in every part."""
    made = adapter().json_schema()
    made["properties"] = {"schema": {"const": SCHEMA}, **made["properties"]}
    made["required"] = ["schema", *made["required"]]
    for part in (made, *made["$defs"].values()):
        part["properties"].pop(UNKNOWN, None)
    # A default that is not known is NaN in a result and null in its file.
    return plain({"$schema": DIALECT, **made, "title": "result.json of vibrident"})


#: File of the documentation → the schema that it holds.
SCHEMAS: Mapping[str, Callable[[], dict[str, Any]]] = {
    "schemas/calibration.schema.json": calibration_schema,
    "schemas/result.schema.json": result_schema,
}


def text(schema: Mapping[str, Any]) -> str:
    """Return a schema as JSON."""
    return json.dumps(schema, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
