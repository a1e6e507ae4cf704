"""The one result of an identification: values only, schema ``vibrident.result/1``, to and from JSON.

Reports, plots, exports and the page render from it alone, without the data and without JAX.
"""

from __future__ import annotations

import datetime
import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any

from vibrident.errors import InputError
from vibrident.warning_kinds import WARNING_CODES as WARNING_CODES
from vibrident.warning_kinds import WarningCode as WarningCode

SCHEMA = "vibrident.result/1"

#: Most bytes of a result file; one with hundreds of records has a few millions.
MOST_BYTES = 200_000_000
_MAY_BE_ABSENT = ("deviation_percent", "deviation_phase_deg", "record", "magnitude_noise", "phase_deg_noise")
_MAY_BE_ABSENT += ("deviation_uncertainty_percent", "deviation_phase_uncertainty_deg")


@dataclass(frozen=True)
class ResultWarning:
    """One warning of the result: a fixed code and a sentence for the user."""

    code: WarningCode
    message: str

    def __post_init__(self) -> None:
        if self.code not in WARNING_CODES:
            raise ValueError(f"warning code {self.code!r} is not in the contracted list {WARNING_CODES}")


@dataclass(frozen=True)
class Parameter:
    """An identified or derived parameter.

    Attributes:
        value: best estimate, in ``unit``.
        unit: unit of value, standard uncertainty and interval.
        standard_uncertainty: u (GUM), same unit; None where it cannot be stated.
        interval_95: limits of the 95 % coverage interval; None at an end that the data do not bound.
        identifiable: False where the data do not determine the parameter.
        derived: True for a function of the estimated parameters.
    """

    value: float
    unit: str
    standard_uncertainty: float | None
    interval_95: tuple[float | None, float | None]
    identifiable: bool = True
    derived: bool = False


@dataclass(frozen=True)
class Correlation:
    """Correlation of the estimated parameters: names, and matrix of shape (names, names)."""

    names: tuple[str, ...]
    matrix: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Fit:
    """How well the model's prediction meets the data.

    For records the residual is measured minus predicted response in time, in the response unit; for a table it is
    the complex response in its unit. With e the residual and y the measured response:
    rmse = √mean(e²), mae = mean|e|, mse = rmse², r2 = 1 − mse/var(y), rpd = sd(y)/rmse (population sd),
    nrmse = rmse/sd(y). ``chi2_reduced`` compares the deviation at the excited frequencies with its
    uncertainty; ``degrees_of_freedom`` belongs to it.
    """

    rmse: float
    mae: float
    mse: float
    r2: float
    rpd: float
    nrmse: float
    chi2_reduced: float | None
    degrees_of_freedom: int
    adequate: bool


@dataclass(frozen=True)
class Curve:
    """Complex sensitivity over frequency: response per unit reference quantity, lag negative.

    All tuples have the same length; uncertainties are standard uncertainties (k = 1).
    """

    frequency_hz: tuple[float, ...]
    magnitude: tuple[float, ...]
    phase_deg: tuple[float | None, ...]
    magnitude_uncertainty: tuple[float | None, ...]
    phase_deg_uncertainty: tuple[float | None, ...]


@dataclass(frozen=True)
class MeasuredCurve(Curve):
    """What the data say at each excited frequency, and how far the model is from it.

    Attributes:
        deviation_percent: 100 (model − measured)/measured, of the magnitude.
        deviation_phase_deg: model − measured phase; None where there is no measured phase.
        record: name of the record of each point.
        magnitude_noise: the part of ``magnitude_uncertainty`` that is noise of this point alone; the rest are the
            stated systematic effects, common to all points.
        phase_deg_noise: the same of the phase.
        deviation_uncertainty_percent: standard uncertainty of ``deviation_percent``. The model was fitted to the same
            points and follows what is common to them, so it is not made of the uncertainties of both: it is the noise
            less its leverage, and of the effects what the parameters cannot follow. None where the model meets the
            point whatever it is.
        deviation_phase_uncertainty_deg: the same of the phase.
    """

    deviation_percent: tuple[float, ...] = ()
    deviation_phase_deg: tuple[float | None, ...] = ()
    record: tuple[str, ...] = ()
    magnitude_noise: tuple[float | None, ...] = ()
    phase_deg_noise: tuple[float | None, ...] = ()
    deviation_uncertainty_percent: tuple[float | None, ...] = ()
    deviation_phase_uncertainty_deg: tuple[float | None, ...] = ()


@dataclass(frozen=True)
class Signal:
    """A short excerpt of one record for pictures: measured and predicted response, and the residual."""

    record: str
    time_s: tuple[float, ...]
    measured: tuple[float, ...]
    predicted: tuple[float, ...]
    unit: str
    rmse: float
    nrmse: float


@dataclass(frozen=True)
class Training:
    """Course of the optimisation: mean squared weighted residual and parameters at each iteration of its optimiser.

    ``weighting_changes`` are the iterations from which on the residual has other weights: losses on both sides of one
    are not alike.
    """

    optimiser: str
    status: str
    iterations: int
    loss: tuple[float, ...]
    parameters: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    weighting_changes: tuple[int, ...] = ()


@dataclass(frozen=True)
class Result:
    """The outcome of one identification. See DESIGN's contract for each field's meaning.

    Attributes:
        model: model name, such as "accelerometer+delay".
        estimator: estimator that produced the values.
        settings: what was chosen, by the user or by ``auto``, with the reason.
        provenance: package and library versions, file names and SHA-256, seed, time.
        parameters: name to parameter.
        correlation: of the estimated parameters.
        fit: fit metrics.
        response: the model's curve.
        measured: the data's curve.
        warnings: empty for a clean calibration of an adequate model.
        sensor: free text of the calibration file.
        reference: quantity and unit of the reference.
        response_unit: unit of the response channel.
        signals: excerpts for pictures.
        training: trace of the optimiser.
        weights: the identified network weights W1…W4 as nested lists (paper's Table 1), where a network was trained.
        certificate: what the calibration file states for a certificate; empty where it states nothing.
    """

    model: str
    estimator: str
    settings: Mapping[str, Any]
    provenance: Mapping[str, Any]
    parameters: Mapping[str, Parameter]
    correlation: Correlation
    fit: Fit
    response: Curve
    measured: MeasuredCurve
    warnings: tuple[ResultWarning, ...] = ()
    sensor: Mapping[str, str] = field(default_factory=dict)
    reference: Mapping[str, str] = field(default_factory=dict)
    response_unit: str = "V"
    signals: tuple[Signal, ...] = ()
    training: Training | None = None
    weights: Mapping[str, Any] = field(default_factory=dict)
    certificate: Mapping[str, Any] = field(default_factory=dict)

    @property
    def warning_codes(self) -> tuple[str, ...]:
        """Codes of the warnings, in order, without repeats."""
        return tuple(dict.fromkeys(w.code for w in self.warnings))

    @property
    def quantity(self) -> str:
        """What the reference gives; acceleration where it is not stated."""
        return self.reference.get("quantity", "acceleration")

    @property
    def has_gain(self) -> bool:
        """Whether there is a gain, and so a curve over frequency; free decays alone determine neither."""
        own = {name for name, parameter in self.parameters.items() if not parameter.derived}
        return own != {"natural_frequency", "damping_ratio"}

    def require_gain(self, use: str) -> None:
        """Refuse a result of free decays alone for a ``use`` (in words) that needs the gain.

        Raises:
            InputError: the result is of free decays alone.
        """
        if not self.has_gain:
            raise InputError(
                f"The result has no gain, which {use} needs: free decays alone tell natural frequency and damping.",
                expected="a result of records with a reference, or of a table",
                found=f"parameters {', '.join(self.parameters)}",
                where="result.json, parameters",
                remedy="identify records with a reference; decays may be among them, or in a calibration file beside",
            )

    def to_dict(self) -> dict[str, Any]:
        """Plain types only; numbers that are not finite become None."""
        return {"schema": SCHEMA, **_plain(self)}

    def to_json(self) -> str:
        """JSON text, RFC 8259: no NaN, no Infinity; floats round-trip exactly."""
        return json.dumps(self.to_dict(), indent=2, allow_nan=False, ensure_ascii=False) + "\n"

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write ``result.json`` at ``path``, whole or not at all; return the path."""
        target = Path(path)
        target.parent.mkdir(parents=True, exist_ok=True)
        partial = target.with_name(f".{target.name}.{os.getpid()}.part")
        try:
            partial.write_text(self.to_json(), encoding="utf-8")
            partial.replace(target)
        finally:
            partial.unlink(missing_ok=True)
        return target

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> Result:
        """Build a result from ``to_dict``'s form.

        Raises:
            InputError: the document has another schema or lacks a field.
        """
        found = document.get("schema") if isinstance(document, Mapping) else type(document).__name__
        if found != SCHEMA:
            raise InputError(
                "This is not a vibrident result.",
                expected=f'"schema": "{SCHEMA}"',
                found=repr(found),
                remedy="give the result.json that `vibrident identify` wrote",
            )
        from pydantic import TypeAdapter, ValidationError

        try:
            result = TypeAdapter(cls).validate_python({**document, **_with_numbers(_measured_part(document))})
            result.require_consistent()
        except ValidationError as error:
            finding = error.errors()[0]
            place = ".".join(str(part) for part in finding["loc"])
            raise _damaged(f"{place}: {finding['msg']}") from None
        except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
            raise _damaged(f"{type(error).__name__}: {error}") from error
        return result

    def require_consistent(self) -> None:
        """Check what the fields say of each other.

        Raises:
            ValueError: a curve's columns differ in length, or the matrix of correlation is not square.
        """
        for name, curve in (("response", self.response), ("measured", self.measured)):
            points = len(curve.frequency_hz)
            for column in fields(curve):
                length = len(getattr(curve, column.name))
                if length != points and not (length == 0 and column.name in _MAY_BE_ABSENT):
                    raise ValueError(f"{name}.{column.name} has {length} values for {points} frequencies")
        size = len(self.correlation.names)
        if [len(row) for row in self.correlation.matrix] != [size] * size:
            raise ValueError(f"the matrix of correlation is not {size} by {size}")
        for signal in self.signals:
            if not len(signal.time_s) == len(signal.measured) == len(signal.predicted):
                raise ValueError(f"the parts of the signal {signal.record!r} differ in length")

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Result:
        """Read a result file.

        Raises:
            InputError: the file cannot be read or is not a result.
        """
        try:
            file = Path(path)
            if (size := file.stat().st_size) > MOST_BYTES:
                raise ValueError(f"{size} bytes, which is more than any result has")
            document = json.loads(file.read_text(encoding="utf-8"), parse_constant=_refuse_constant)
        except (OSError, ValueError, RecursionError, MemoryError) as error:  # UnicodeDecodeError is a ValueError
            raise InputError(
                "The result file cannot be read.",
                expected="a JSON file written by `vibrident identify`",
                found=str(error),
                where=str(path),
                remedy="check the path",
            ) from error
        return cls.from_dict(document)


#: Fields in which JSON's null means a number that is not finite; in other fields it means that there is no value.
_NUMBERS = {"value", "matrix", "magnitude", "deviation_percent", "rmse", "mae", "mse", "r2", "rpd", "nrmse"}


def _measured_part(document: Mapping[str, Any]) -> dict[str, Any]:
    return {key: document[key] for key in ("parameters", "correlation", "fit", "response", "measured")}


def _with_numbers(value: Any, key: str = "") -> Any:
    """Plain values in which null is replaced by NaN in fields that require a number."""
    if isinstance(value, Mapping):
        return {name: _with_numbers(item, str(name)) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_with_numbers(item, key) for item in value]
    return math.nan if value is None and key in _NUMBERS else value


def _plain(value: Any) -> Any:
    if type(value) is float:  # by far the most
        return value if math.isfinite(value) else None
    if is_dataclass(value):
        return {item.name: _plain(getattr(value, item.name)) for item in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, bool) or value is None or isinstance(value, (str, int)):
        return value
    if isinstance(value, datetime.date | datetime.time):  # a certificate's, in a calibration made in memory
        return value.isoformat()
    number = float(value)
    return number if math.isfinite(number) else None


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name}, which is no number of JSON")


def _damaged(found: str) -> InputError:
    return InputError(
        "The result file is incomplete or damaged.",
        expected=f"all fields of {SCHEMA}",
        found=found[:500],
        remedy="run `vibrident identify` again",
    )
