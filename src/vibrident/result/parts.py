"""What a result is made of: parameters, curves, excerpts, warnings; each keeps unknown fields."""

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
    """In a document, an array is a list of numbers, null where one is not known."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        return handler.generate_schema(tuple[float | None, ...])


class _NullIsNaN:
    """In a document, null stands for a required number that is not finite; read, it is NaN."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        return core_schema.no_info_before_validator_function(_number_or_nan, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return {"anyOf": [handler(schema), {"type": "null"}]}


class _AnyCode:
    """A code is written of a fixed list; read, it may be one of a later version."""

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
class Part:
    """A part of a result, with the fields of a later version that this one does not know."""

    unknown_fields: Mapping[str, Any] = field(
        default_factory=dict, kw_only=True, repr=False, hash=False
    )


@dataclass(frozen=True, eq=False, repr=False)
class _OfNumbers(Part):
    """A part whose ``Numbers`` are read-only arrays; equal where all fields are, NaN to NaN."""

    __repr__ = brief

    def __post_init__(self) -> None:
        for each in fields(self):  # type: ignore[arg-type]
            if each.type == "Numbers":
                object.__setattr__(self, each.name, frozen(getattr(self, each.name)))

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        pairs = ((value, vars(other)[name]) for name, value in vars(self).items())
        return all(
            np.array_equal(one, two, equal_nan=True) if isinstance(one, np.ndarray) else one == two
            for one, two in pairs
        )


@dataclass(frozen=True)
class ResultWarning(Part):
    """One warning of the result: a fixed code and a sentence for the user."""

    code: Code
    message: str


@dataclass(frozen=True)
class Finding(Part):
    """What departs from the fit significantly, whether it matters or not."""

    code: Code  # the warning that it is, where it matters
    record: str | None  # name of the record; None where it concerns all
    time_s: float | None  # where in the record; None where that has no place
    probability: float  # that noise alone shows it
    # parameter → how far it moves the stated value, in the parameter's unit: stated less without
    impact: Mapping[str, float]
    message: str  # a sentence for the user


@dataclass(frozen=True)
class Parameter(Part):
    """An identified or derived parameter."""

    value: Number  # best estimate, in ``unit``
    unit: str  # unit of value, standard uncertainty and interval
    standard_uncertainty: float | None  # u (GUM), same unit; None where it cannot be stated
    # limits of the 95 % coverage interval; None at an end that the data do not bound
    interval_95: tuple[float | None, float | None]
    identifiable: bool = True  # False where the data do not determine the parameter
    derived: bool = False  # True for a function of the estimated parameters


@dataclass(frozen=True)
class Correlation(Part):
    """Correlation of the estimated parameters: names, and matrix of shape (names, names)."""

    names: tuple[str, ...]
    matrix: tuple[tuple[Number, ...], ...]

    __repr__ = brief


@dataclass(frozen=True)
class Fit(Part):
    """How well the model's prediction meets the data.

    For records the residual is measured minus predicted response in time, in the response unit; for
    a table it is
    the complex response in its unit. With e the residual and y the measured response:
    rmse = √mean(e²), mae = mean|e|, mse = rmse², r2 = 1 − mse/var(y), rpd = sd(y)/rmse (population
    sd),
    nrmse = rmse/sd(y). ``chi2_reduced`` compares the deviation at the excited frequencies with its
    uncertainty; ``degrees_of_freedom`` belongs to it. ``explained`` is the share of the response's
    power, in the band of the motion, that the model explains, and ``coherent`` the share that any
    linear sensor could explain.
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
class Curve(_OfNumbers):
    """Complex sensitivity over frequency: response per the sensor's own quantity, lag negative.

    Each is an array of shape (points,), NaN where a number is not known; uncertainties are standard
    uncertainties
    (k = 1).
    """

    frequency_hz: Numbers
    magnitude: Numbers
    phase_deg: Numbers
    magnitude_uncertainty: Numbers
    phase_deg_uncertainty: Numbers

    @classmethod
    def none(cls) -> Self:
        """A curve without points."""
        return cls(*(no_numbers() for _ in range(5)))


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredCurve(Curve):
    """What the data say at each excited frequency, and how far the model is from it."""

    deviation_percent: Numbers = field(
        default_factory=no_numbers
    )  # 100 (model − measured)/measured, of the magnitude
    # model − measured phase; NaN where there is no measured phase
    deviation_phase_deg: Numbers = field(default_factory=no_numbers)
    record: tuple[str, ...] = ()  # name of the record of each point
    # the part of ``magnitude_uncertainty`` that is noise of this point alone; the rest are the
    # stated systematic
    # effects, common to all points
    magnitude_noise: Numbers = field(default_factory=no_numbers)
    phase_deg_noise: Numbers = field(default_factory=no_numbers)  # the same of the phase
    # standard uncertainty of ``deviation_percent``. The model was fitted to the same points and
    # follows what is common
    # to them, so it is not made of the uncertainties of both: it is the noise less its leverage,
    # and of the effects
    # what the parameters cannot follow. NaN where the model meets the point whatever it is
    deviation_uncertainty_percent: Numbers = field(default_factory=no_numbers)
    deviation_phase_uncertainty_deg: Numbers = field(
        default_factory=no_numbers
    )  # the same of the phase


@dataclass(frozen=True, eq=False, repr=False)
class Signal(_OfNumbers):
    """How well one record is met, with a short excerpt of it for pictures.

    Sample ``i`` of the excerpt lies at ``start_s`` + ``i`` ``interval_s``. Values have six
    significant digits; NaN is a sample that took no part in the fit. Without excerpt there are
    none.
    """

    record: str
    start_s: Number
    interval_s: Number
    measured: Numbers
    residual: Numbers  # measured less predicted, with six digits of its own
    unit: str
    rmse: Number  # of the whole record
    nrmse: Number

    def __post_init__(self) -> None:
        for name in ("measured", "residual"):
            values = np.asarray(getattr(self, name), dtype=float).tolist()
            object.__setattr__(self, name, [float(f"{value:.6g}") for value in values])
        super().__post_init__()

    @property
    def time_s(self) -> FloatArray:
        """Times of the samples, shape (samples,)."""
        count = np.arange(self.measured.size, dtype=np.float64)
        return self.start_s + self.interval_s * count

    @property
    def predicted(self) -> FloatArray:
        """The model's response, shape (samples,)."""
        return self.measured - self.residual


@dataclass(frozen=True)
class Training(Part):
    """Course of the optimisation: mean squared weighted residual and parameters by iteration.

    ``weighting_changes`` are the iterations from which on the residual has other weights: losses on
    both sides of one
    cannot be compared.
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
    """Check what the parts of a result say of each other; ValueError where they contradict."""
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
