"""A sensor model as one object: a response as a formula of s, and its parameters.

    import numpy as np
    from vibrident import Model, ParameterSpec, identify

    convective = Model(
        "convective",
        lambda s, sensitivity, cutoff: sensitivity / (1 + s / (2 * np.pi * cutoff)),
        [ParameterSpec("sensitivity", "V/(m/s^2)"), ParameterSpec("cutoff", "Hz")],
    )
    result = identify(calibration, model=convective)

The built-in sensors are such objects, and so is what a plug-in registers. A formula that is a ratio
of polynomials in s becomes exact coefficients; any other function of frequency acts as a filter on
the reference.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from vibrident.base.binding import bound
from vibrident.base.errors import ModelError
from vibrident.physics.models.base import Derived, Parameters, ParameterSpec, Rational
from vibrident.physics.models.completion import completed, require_signature
from vibrident.physics.models.ratio import Coefficients, Ratio, S

_NAME = re.compile(r"[A-Za-z][\w.-]*")
#: Pole and zero at −100 rad/s, which cancel at every frequency, give a model without poles a state
#: for the network. It decays within a record of a second, and not within a sample of a slow one.
_CANCELLED: Coefficients = (100.0, 1)
#: Points of a circle around a value, and its radius as a part of the value, for derivatives.
_CIRCLE = np.exp(0.5j * np.pi * np.arange(4))
_RADIUS = 1e-5


@dataclass(frozen=True)
class Model:
    """A sensor model: the response as a formula of s, and its parameters.

    Attributes:
        name: in calibration files and results; letters, digits, "_", "." and "-".
        response: (s, one keyword a parameter) → response per m/s² of acceleration, or per unit of a
            drive, for e^{st}. Of Python operators where it is a ratio of polynomials, else of
            NumPy's functions of arrays.
        parameters: in the order of the results; those of the built-in models state the gain first.
        title: what it is, in a few words.
        slopes: (s, one keyword a parameter) → derivatives of a response that is not rational with
            its parameters, by name, at a gain of one; None: by complex steps.
        derived: what follows from the parameters.
        oscillator: names of natural frequency (Hz) and damping ratio, where the denominator is
            s² + 2 δ ωn s + ωn²; None where the sensor is no damped oscillator.
        output: ``displacement`` where the gain is the response to static acceleration and the
            numerator ωn²; ``velocity`` where the numerator is s; ``other``.
        derivative: power of s by which the response follows what the formula gives.
        behind: what its reference measures: ``motion`` (or a drive), ``force``, or ``any``.
        response_unit: of the response, where the units of the parameters need that one.

    Raises:
        ModelError: the response is no function of s and the parameters, or no parameter is its
            gain.

    Examples:
        >>> import numpy as np
        >>> import vibrident
        >>> sensor = vibrident.Model(
        ...     "first-order",
        ...     lambda s, gain, corner: gain / (1 + s / (2 * np.pi * corner)),
        ...     [vibrident.ParameterSpec("gain", "V/Pa"), vibrident.ParameterSpec("corner", "Hz")],
        ... )
        >>> round(abs(sensor.response(2j * np.pi * 100.0, gain=1.0, corner=100.0)), 4)
        0.7071
    """

    name: str
    response: Callable[..., Any]
    parameters: Sequence[ParameterSpec]
    title: str = ""
    slopes: Callable[..., Mapping[str, Any]] | None = None
    derived: tuple[Derived, ...] = ()
    oscillator: tuple[str, str] | None = None
    output: Literal["displacement", "velocity", "other"] = "other"
    derivative: int = 0
    behind: Literal["motion", "force", "any"] = "any"
    response_unit: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not _NAME.fullmatch(self.name):
            raise ModelError(
                "This cannot be the name of a model.",
                expected='letters, digits, "_", "." and "-", such as "convective"',
                found=repr(self.name),
                where="Model, name",
                remedy="give the model another name",
            )
        require_signature(self.name, self.response, self.parameters)
        object.__setattr__(self, "parameters", tuple(self.parameters))
        if any(spec.kind is None for spec in self.parameters):
            object.__setattr__(
                self, "parameters", completed(self.name, self.response, self.parameters)
            )
            object.__setattr__(self, "title", self.title or self.name)

    def __add__(self, add_ons: str) -> Any:
        """Return the model with add-ons by name: ``model + "delay"``.

        Returns:
            ``vibrident.physics.models.SensorModel``.
        """
        return bound("with_add_ons")(self, add_ons)

    def __repr__(self) -> str:
        """Return name and parameters."""
        return f"<Model {self.name}: {', '.join(spec.name for spec in self.parameters)}>"

    @functools.cached_property
    def is_rational(self) -> bool:
        """Return whether the response is a ratio of polynomials in s."""
        likely = {spec.name: 1.5 if spec.start is None else spec.start for spec in self.parameters}
        return self._ratio(likely) is not None

    def _ratio(self, parameters: Parameters) -> Ratio | None:
        """Return the response at a gain of one as a ratio; None if it is none."""
        try:
            value = self.response(S, **self._at_unit_gain(parameters))
        except (TypeError, AttributeError):
            return None
        return value if isinstance(value, Ratio) else Ratio((value,))

    def _at_unit_gain(self, parameters: Parameters) -> dict[str, Any]:
        """Return the values with a gain of one; none is a whole number, which stands for itself."""
        values: dict[str, Any] = {}
        for spec in self.parameters:
            value = 1.0 if spec.kind == "gain" else parameters[spec.name]
            values[spec.name] = float(value) if type(value) is int else value
        return values

    def _gain(self, parameters: Parameters) -> Any:
        return next((parameters[spec.name] for spec in self.parameters if spec.kind == "gain"), 1.0)

    def rational(self, parameters: Parameters) -> Rational:
        """Return the rational transfer function from acceleration; without one, the gain alone."""
        gain = self._gain(parameters)
        ratio = self._ratio(parameters) if self.is_rational else None
        numerator, denominator = ((1,), (1,)) if ratio is None else ratio.reduced()
        if len(denominator) == 1:
            ratio = Ratio(numerator) * Ratio(_CANCELLED)
            numerator = ratio.numerator
            denominator = _CANCELLED
        return Rational(gain, _floats(numerator), _floats(denominator), _scale(denominator))

    @property
    def factor(self) -> Callable[[Parameters, Any], Any] | None:
        """Return (values, s) → response at a gain of one, where it is not rational; else None."""
        return None if self.is_rational else self._filter

    @property
    def factor_slopes(self) -> Callable[[Parameters, Any], Mapping[str, Any]] | None:
        """Return (values, s) → the derivatives of :attr:`factor` by name."""
        return None if self.is_rational else self._filter_slopes

    def _filter(self, parameters: Parameters, s: Any) -> Any:
        values = self._at_unit_gain(parameters)
        return self.response(_avoid_zero(s), **values) + 0.0 * s

    def _filter_slopes(self, parameters: Parameters, s: Any) -> dict[str, Any]:
        """Return the derivatives by Cauchy's formula on a small circle (Lyness & Moler 1967).

        The response is complex itself, so that one complex step does not tell its derivative.
        """
        values = self._at_unit_gain(parameters)
        at = _avoid_zero(s)
        if self.slopes is not None:
            return {name: slope + 0.0 * s for name, slope in self.slopes(at, **values).items()}
        slopes: dict[str, Any] = {}
        for spec in self.parameters:
            if spec.kind == "gain":
                continue
            value = values[spec.name]
            radius = _RADIUS * np.maximum(
                np.abs(value), 1e-3 * spec.size if spec.kind == "ratio" else 0.0
            )
            around = [
                self.response(at, **{**values, spec.name: value + radius * turn}) / turn
                for turn in _CIRCLE
            ]
            slopes[spec.name] = np.mean(np.broadcast_arrays(*around), axis=0) / radius + 0.0 * s
        return slopes


def _floats(coefficients: Coefficients) -> Coefficients:
    """Return coefficients with the whole numbers of a formula as floats."""
    return tuple(
        float(coefficient) if isinstance(coefficient, int) else coefficient
        for coefficient in coefficients
    )


def _scale(denominator: Coefficients) -> Any:
    """Return the geometric mean of the sizes of the poles that are not zero, rad/s.

    Of a complex step, too: |c| would take its derivative away.
    """
    order = len(denominator) - 1
    for power, coefficient in enumerate(denominator[:-1]):
        if not (type(coefficient) is int and coefficient == 0):
            return (coefficient * coefficient) ** (0.5 / (order - power))
    return float(_CANCELLED[0])


def _avoid_zero(s: Any) -> Any:
    """Return s with a frequency next to zero in place of zero, where many a formula is 0/0."""
    sizes = np.abs(np.asarray(s))
    moving = sizes[sizes > 0.0]
    least = 1e-6 * float(np.min(moving)) if moving.size else 1e-6
    return np.where(sizes > 0.0, s, 1j * least)
