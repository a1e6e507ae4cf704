"""Outcome of a calibration as plain values: a row of the table."""

from __future__ import annotations

import time
import traceback
from pathlib import Path

from vibrident.base.errors import InputError, VibridentError
from vibrident.base.fields import Fields, NamedTexts
from vibrident.result import Result
from vibrident.result.document import plain

IDENTIFIED = "identified"
REFUSED = "refused"
FAILED = "failed"

#: Fields: key, status, message, serial_number, type, model, estimator, parameters, adequate,
#: chi2_reduced, warnings, seconds as in the table, ``parameters`` being name → [value, u, unit];
#: ``finished``: when, in seconds since 1970; ``passing``: True if the next run is to try again,
#: because another attempt may have another outcome.
Row = Fields


def identified(key: str, result: Result, seconds: float) -> Row:
    """Return the row of a result."""
    parameters = {
        name: [plain(parameter.value), plain(parameter.standard_uncertainty), parameter.unit]
        for name, parameter in result.parameters.items()
    }
    return {
        **_row(key, IDENTIFIED, "", dict(result.sensor), seconds),
        "model": result.model,
        "estimator": result.estimator,
        "parameters": parameters,
        "adequate": bool(result.fit.adequate),
        "chi2_reduced": plain(result.fit.chi2_reduced),
        "warnings": list(result.warning_codes),
    }


def refused(
    key: str, error: VibridentError, sensor: NamedTexts, model: str | None, seconds: float
) -> Row:
    """Return the row of data that cannot be used, with the whole message.

    A fit that did not converge has failed.
    """
    status = REFUSED if isinstance(error, InputError) else FAILED
    row = _row(key, status, str(error), sensor, seconds)
    row["model"] = model or sensor.get("model")
    row["passing"] = isinstance(error, InputError) and error.remedy.startswith("pip install")
    return row


def failed(
    key: str, error: InputError, sensor: NamedTexts, model: str | None, seconds: float
) -> Row:
    """Return the row of a calibration that was not completed."""
    return {**refused(key, error, sensor, model, seconds), "status": FAILED}


def fault(error: Exception) -> InputError:
    """Return the message for a fault of this program."""
    frames = traceback.extract_tb(error.__traceback__)
    last = frames[-1] if frames else None
    return InputError(
        "Identifying this calibration met a fault of the program.",
        expected="a result, or a message that says what is wrong with the data",
        found=f"{type(error).__name__}: {error}"[:500],
        where=f"{Path(last.filename).name}, line {last.lineno}" if last else "",
        remedy="identify it by itself with ⟦command = identify⟧, and report what it prints",
    )


def _row(key: str, status: str, message: str, sensor: NamedTexts, seconds: float) -> Row:
    return {
        "key": key,
        "status": status,
        "message": message,
        "serial_number": sensor.get("serial_number"),
        "type": sensor.get("type"),
        "model": None,
        "estimator": None,
        "parameters": {},
        "adequate": None,
        "chi2_reduced": None,
        "warnings": [],
        "seconds": seconds,
        "finished": time.time(),
        "passing": False,
    }
