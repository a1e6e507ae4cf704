"""What a result is made of: parameters, curves, excerpts, warnings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Annotated, Any, Self

import numpy as np

from vibrident.base.brief import brief
from vibrident.base.warning_kinds import WARNING_CODES, WarningCode
from vibrident.data.records import FloatArray
from vibrident.data.records.basis import frozen


def no_numbers() -> FloatArray:
    """Of a column that is absent: shape (0,)."""
    return np.empty(0)


class _Listed:
    """In a document, an array is a list of numbers, null where one is not known."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        return handler.generate_schema(tuple[float | None, ...])


Numbers = Annotated[FloatArray, _Listed()]  # shape (points,); made of any sequence, whose None becomes NaN


class _OfNumbers:
    """A dataclass whose ``Numbers`` are arrays that cannot be written to; equal where all fields are, NaN to NaN."""

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
class ResultWarning:
    """One warning of the result: a fixed code and a sentence for the user."""

    code: WarningCode
    message: str

    def __post_init__(self) -> None:
        if self.code not in WARNING_CODES:
            raise ValueError(f"warning code {self.code!r} is not in the contracted list {WARNING_CODES}")


@dataclass(frozen=True)
class Finding:
    """What departs from the fit significantly, whether it matters or not."""

    code: WarningCode  # the warning that it is, where it matters
    record: str | None  # name of the record; None where it concerns all
    time_s: float | None  # where in the record; None where that has no place
    probability: float  # that noise alone shows it
    # parameter → how far it moves the stated value, in the parameter's unit: stated less without
    impact: Mapping[str, float]
    message: str  # a sentence for the user


@dataclass(frozen=True)
class Parameter:
    """An identified or derived parameter."""

    value: float  # best estimate, in ``unit``
    unit: str  # unit of value, standard uncertainty and interval
    standard_uncertainty: float | None  # u (GUM), same unit; None where it cannot be stated
    # limits of the 95 % coverage interval; None at an end that the data do not bound
    interval_95: tuple[float | None, float | None]
    identifiable: bool = True  # False where the data do not determine the parameter
    derived: bool = False  # True for a function of the estimated parameters


@dataclass(frozen=True)
class Correlation:
    """Correlation of the estimated parameters: names, and matrix of shape (names, names)."""

    names: tuple[str, ...]
    matrix: tuple[tuple[float, ...], ...]

    __repr__ = brief


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


@dataclass(frozen=True, eq=False, repr=False)
class Curve(_OfNumbers):
    """Complex sensitivity over frequency: response per unit reference quantity, lag negative.

    Each is an array of shape (points,), NaN where a number is not known; uncertainties are standard uncertainties
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

    deviation_percent: Numbers = field(default_factory=no_numbers)  # 100 (model − measured)/measured, of the magnitude
    # model − measured phase; NaN where there is no measured phase
    deviation_phase_deg: Numbers = field(default_factory=no_numbers)
    record: tuple[str, ...] = ()  # name of the record of each point
    # the part of ``magnitude_uncertainty`` that is noise of this point alone; the rest are the stated systematic
    # effects, common to all points
    magnitude_noise: Numbers = field(default_factory=no_numbers)
    phase_deg_noise: Numbers = field(default_factory=no_numbers)  # the same of the phase
    # standard uncertainty of ``deviation_percent``. The model was fitted to the same points and follows what is common
    # to them, so it is not made of the uncertainties of both: it is the noise less its leverage, and of the effects
    # what the parameters cannot follow. NaN where the model meets the point whatever it is
    deviation_uncertainty_percent: Numbers = field(default_factory=no_numbers)
    deviation_phase_uncertainty_deg: Numbers = field(default_factory=no_numbers)  # the same of the phase


@dataclass(frozen=True, eq=False, repr=False)
class Signal(_OfNumbers):
    """A short excerpt of one record for pictures: measured and predicted response, and the residual."""

    record: str
    time_s: Numbers
    measured: Numbers
    predicted: Numbers
    unit: str
    rmse: float
    nrmse: float


@dataclass(frozen=True)
class Training:
    """Course of the optimisation: mean squared weighted residual and parameters at each iteration of its optimiser.

    ``weighting_changes`` are the iterations from which on the residual has other weights: losses on both sides of one
    cannot be compared.
    """

    optimiser: str
    status: str
    iterations: int
    loss: tuple[float, ...]
    parameters: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    weighting_changes: tuple[int, ...] = ()

    __repr__ = brief
