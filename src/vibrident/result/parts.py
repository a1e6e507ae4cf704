"""Parts of a result: parameters, curves, excerpts, warnings; each keeps unknown fields."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from typing import Annotated, Any, Self, get_args

import numpy as np

from vibrident.base.brief import brief
from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import FloatArray
from vibrident.data.records.basis import frozen
from vibrident.result.document import UNKNOWN


def no_numbers() -> FloatArray:
    """Return a column that is absent: shape (0,)."""
    return np.empty(0)


class _Listed:
    """Schema of an array: a list of numbers, null where one is not known."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        return handler.generate_schema(tuple[float | None, ...])


class _NullIsNaN:
    """Schema of a required number; null stands for one that is not finite, and is read as NaN."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        return core_schema.no_info_before_validator_function(_number_or_nan, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return {"anyOf": [handler(schema), {"type": "null"}]}


class _AnyCode:
    """Schema of a code of a fixed list; read, it may be one of a later version."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        return handler.generate_schema(str)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return handler(schema) | {"examples": list(get_args(WarningCode))}


def _number_or_nan(value: Any) -> Any:
    return math.nan if value is None else value


Numbers = Annotated[FloatArray, _Listed()]  # shape (points,); made of any sequence, None is NaN
Number = Annotated[float, _NullIsNaN()]
Code = Annotated[WarningCode, _AnyCode()]


@dataclass(frozen=True)
class ResultPart:
    """Part of a result, with the fields of a later version that this one does not know."""

    unknown_fields: Mapping[str, Any] = field(
        default_factory=dict, kw_only=True, repr=False, hash=False
    )


@dataclass(frozen=True, eq=False, repr=False)
class _NumericPart(ResultPart):
    """Part whose ``Numbers`` are read-only arrays; equal where all fields are, NaN to NaN."""

    __repr__ = brief

    def __post_init__(self) -> None:
        for field_of_part in fields(self):  # type: ignore[arg-type]
            name = field_of_part.name
            if field_of_part.type == "Numbers":
                object.__setattr__(self, name, frozen(getattr(self, name)))

    def __eq__(self, value: object) -> bool:
        if type(self) is not type(value):
            return NotImplemented
        return all(_are_equal(item, vars(value)[name]) for name, item in vars(self).items())


def _are_equal(first: Any, second: Any) -> bool:
    """Return whether two values of a field are equal; NaN equals NaN in arrays."""
    if isinstance(first, np.ndarray):
        return np.array_equal(first, second, equal_nan=True)
    return first == second


@dataclass(frozen=True)
class ResultWarning(ResultPart):
    """Warning of a result: a fixed code and a sentence for the user."""

    code: Code
    message: str


@dataclass(frozen=True)
class Finding(ResultPart):
    """Significant departure from the fit, whether it matters or not.

    Attributes:
        code: the warning that it is, where it matters.
        record: name of the record; None where it concerns all.
        time_s: where in the record; None where that has no place.
        probability: that noise alone shows it.
        impact: parameter → how far it moves the stated value, in the parameter's unit: stated less
            without.
        message: a sentence for the user.
    """

    code: Code
    record: str | None
    time_s: float | None
    probability: float
    impact: Mapping[str, float]
    message: str


@dataclass(frozen=True)
class Parameter(ResultPart):
    """Identified or derived parameter.

    Attributes:
        value: best estimate, in ``unit``.
        unit: unit of value, standard uncertainty and interval.
        standard_uncertainty: u (GUM), same unit; None where it cannot be stated.
        interval_95: limits of the 95 % coverage interval; None at an end that the data do not
            bound.
        identifiable: False where the data do not determine the parameter.
        derived: True for a function of the estimated parameters.
    """

    value: Number
    unit: str
    standard_uncertainty: float | None
    interval_95: tuple[float | None, float | None]
    identifiable: bool = True
    derived: bool = False


@dataclass(frozen=True)
class Correlation(ResultPart):
    """Correlation of the estimated parameters: names, and matrix of shape (names, names)."""

    names: tuple[str, ...]
    matrix: tuple[tuple[Number, ...], ...]

    __repr__ = brief


@dataclass(frozen=True)
class Fit(ResultPart):
    """Quality of a fit: how well the model's prediction meets the data.

    For records the residual is measured minus predicted response in time, in the response unit; for
    a table it is that of the complex response, in its unit. With e the residual and y the measured
    response, rmse = √mean(e²), mae = mean|e|, mse = rmse², r2 = 1 − mse/var(y), rpd = sd(y)/rmse
    (population sd), nrmse = rmse/sd(y). ``chi2_reduced`` compares the deviation at the excited
    frequencies with its uncertainty; ``degrees_of_freedom`` belongs to it. ``explained`` is the
    share of the response's power, in the band of the motion, that the model explains, and
    ``coherent`` the share that any linear sensor could explain.
    """

    rmse: Number
    mae: Number
    mse: Number
    r2: Number
    rpd: Number
    nrmse: Number
    chi2_reduced: float | None
    degrees_of_freedom: int
    adequate: bool
    explained: Number = math.nan
    coherent: Number = math.nan


@dataclass(frozen=True, eq=False, repr=False)
class Curve(_NumericPart):
    """Complex sensitivity over frequency: response per the sensor's own quantity, lag negative.

    Each is an array of shape (points,), NaN where a number is not known; uncertainties are standard
    uncertainties (k = 1).
    """

    frequency_hz: Numbers
    magnitude: Numbers
    phase_deg: Numbers
    magnitude_uncertainty: Numbers
    phase_deg_uncertainty: Numbers

    @classmethod
    def none(cls) -> Self:
        """Return a curve without points."""
        return cls(*(no_numbers() for _ in range(5)))


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredCurve(Curve):
    """Measured sensitivity at each excited frequency, and the deviation of the model from it.

    Attributes:
        deviation_percent: 100 (model − measured)/measured, of the magnitude.
        deviation_phase_deg: model − measured phase; NaN where there is no measured phase.
        record: name of the record of each point.
        magnitude_noise: the part of ``magnitude_uncertainty`` that is noise of this point alone;
            the rest are the stated systematic effects, common to all points.
        phase_deg_noise: the same of the phase.
        deviation_uncertainty_percent: standard uncertainty of ``deviation_percent``. The model was
            fitted to the same points and follows what is common to them, so it is not made of the
            uncertainties of both: it is the noise less its leverage, and of the effects what the
            parameters cannot follow. NaN where the model meets the point whatever it is.
        deviation_phase_uncertainty_deg: the same of the phase.
    """

    deviation_percent: Numbers = field(default_factory=no_numbers)
    deviation_phase_deg: Numbers = field(default_factory=no_numbers)
    record: tuple[str, ...] = ()
    magnitude_noise: Numbers = field(default_factory=no_numbers)
    phase_deg_noise: Numbers = field(default_factory=no_numbers)
    deviation_uncertainty_percent: Numbers = field(default_factory=no_numbers)
    deviation_phase_uncertainty_deg: Numbers = field(default_factory=no_numbers)


@dataclass(frozen=True, eq=False, repr=False)
class Signal(_NumericPart):
    """Quality of the fit of a record, with a short excerpt of it for pictures.

    Sample ``i`` of the excerpt lies at ``start_s`` + ``i`` ``interval_s``. Values have six
    significant digits; NaN is a sample that took no part in the fit. Without excerpt there are
    none.

    Attributes:
        residual: measured less predicted, with six digits of its own.
        rmse: of the whole record.
    """

    record: str
    start_s: Number
    interval_s: Number
    measured: Numbers
    residual: Numbers
    unit: str
    rmse: Number
    nrmse: Number

    def __post_init__(self) -> None:
        for name in ("measured", "residual"):
            values = np.asarray(getattr(self, name), dtype=float).tolist()
            object.__setattr__(self, name, [float(f"{value:.6g}") for value in values])
        super().__post_init__()

    @property
    def time_s(self) -> FloatArray:
        """Return the times of the samples, shape (samples,)."""
        count = np.arange(self.measured.size, dtype=np.float64)
        return self.start_s + self.interval_s * count

    @property
    def predicted(self) -> FloatArray:
        """Return the model's response, shape (samples,)."""
        return self.measured - self.residual


@dataclass(frozen=True)
class Training(ResultPart):
    """Course of the optimisation: mean squared weighted residual and parameters by iteration.

    ``weighting_changes`` are the iterations from which on the residual has other weights: losses on
    both sides of one cannot be compared.
    """

    optimiser: str
    status: str
    iterations: int
    loss: tuple[float, ...]
    parameters: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    weighting_changes: tuple[int, ...] = ()

    __repr__ = brief


def require_consistent(
    response: Curve, measured: MeasuredCurve, correlation: Correlation, signals: Sequence[Signal]
) -> None:
    """Raise ValueError where the parts of a result contradict each other."""
    for name, curve in (("response", response), ("measured", measured)):
        points = len(curve.frequency_hz)
        for column in fields(curve):
            if column.name == UNKNOWN:
                continue
            length = len(getattr(curve, column.name))
            optional = column.default is not MISSING or column.default_factory is not MISSING
            if length != points and not (length == 0 and optional):
                raise ValueError(
                    f"{name}.{column.name} has {length} values for {points} frequencies"
                )
    size = len(correlation.names)
    if [len(row) for row in correlation.matrix] != [size] * size:
        raise ValueError(f"the matrix of correlation is not {size} by {size}")
    for signal in signals:
        if signal.measured.size != signal.residual.size:
            raise ValueError(f"the parts of the signal {signal.record!r} differ in length")
