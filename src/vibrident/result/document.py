"""A result as a document: plain values, and JSON text (RFC 8259)."""

from __future__ import annotations

import contextlib
import datetime
import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from vibrident.base.errors import InputError

SCHEMA = "vibrident.result/1"
#: Fields in which JSON's null means a number that is not finite; in other fields it means that there is no value.
_NUMBERS = {"value", "matrix", "rmse", "mae", "mse", "r2", "rpd", "nrmse"}


def with_numbers(value: Any, key: str = "") -> Any:
    """Plain values in which null is replaced by NaN in fields that require a number."""
    if isinstance(value, Mapping):
        return {name: with_numbers(item, str(name)) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [with_numbers(item, key) for item in value]
    return math.nan if value is None and key in _NUMBERS else value


def plain(value: Any) -> Any:
    """Plain types only; numbers that are not finite become None."""
    if type(value) is float:  # by far the most
        return value if math.isfinite(value) else None
    if isinstance(value, np.ndarray):
        return [plain(item) for item in value.tolist()]
    if is_dataclass(value):
        return {item.name: plain(getattr(value, item.name)) for item in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, bool) or value is None or isinstance(value, (str, int)):
        return value
    if isinstance(value, datetime.date | datetime.time):  # a certificate's, in a calibration made in memory
        return value.isoformat()
    number = float(value)
    return number if math.isfinite(number) else None


def json_text(document: Any) -> str:
    """A document as JSON, RFC 8259: no NaN, no Infinity; ``?`` for a byte of a file's name that is no UTF-8."""
    from pydantic_core import PydanticSerializationError, to_json

    with contextlib.suppress(PydanticSerializationError):  # in a twentieth of the time
        text = to_json(document, indent=2).decode() + "\n"
        if "NaN" not in text and "Infinity" not in text:
            return text
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    return text.encode(errors="replace").decode()


def refuse_constant(name: str) -> float:
    """Refuse NaN and Infinity, which are no numbers of JSON."""
    raise ValueError(f"{name}, which is no number of JSON")


def damaged(found: str) -> InputError:
    """The error of a result file that lacks something, or holds what it may not."""
    return InputError(
        "The result file is incomplete or damaged.",
        expected=f"all fields of {SCHEMA}",
        found=found[:500],
        remedy="run ⟦command = identify⟧ again",
    )
