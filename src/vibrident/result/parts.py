"""What a result is made of: parameters, curves, excerpts, warnings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from vibrident.brief import brief
from vibrident.warning_kinds import WARNING_CODES, WarningCode


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

    __repr__ = brief


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

    __repr__ = brief


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

    __repr__ = brief


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

    __repr__ = brief
