"""Complete a model made in Python: find its gain, and choose where to search for its values."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np

from vibrident.base.errors import ModelError
from vibrident.physics.models.base import ParameterSpec

#: Factor by which values are searched around a start value without bounds, either way.
SEARCH_FACTOR = 1e3
#: Factor by which the grid extends around a start value, either way.
GRID_FACTOR = 30.0
#: Largest number of points of the grid of all parameters together.
MAX_GRID_POINTS = 1000
#: Fewest and most points of the grid along one parameter.
MIN_POINTS_OF_PARAMETER = 3
MAX_POINTS_OF_PARAMETER = 40
#: Approximate number of points over the band of the data.
POINTS_OVER_BAND = 32
#: Most parameters without a start value: they are searched over the whole band.
MAX_PARAMETERS_OVER_BAND = 2
#: Lowest value searched of a parameter whose lower bound is zero, as a part of its start value.
MIN_RELATIVE_VALUE = 1e-6
#: jω at which a response is tried, rad/s.
_TRIAL_S = 1j * 2.0 * np.pi * np.geomspace(1e-2, 1e5, 15)
#: Relative deviation from proportionality that is rounding.
_PROPORTIONALITY_TOLERANCE = 1e-9


def require_signature(name: str, response: Any, parameters: Any) -> None:
    """Refuse a response that is no function of s and the parameters.

    Raises:
        ModelError: the response is no such function, or the parameters are no list of
            ``ParameterSpec`` with different names.
    """
    if not callable(response):
        expected = "response = a function of s and the parameters"
        raise _refusal(name, "is no function", expected, repr(response))
    is_list = isinstance(parameters, Sequence) and not isinstance(parameters, str | bytes)
    kinds = [type(parameter) for parameter in parameters] if is_list else [type(parameters)]
    if not kinds or not all(issubclass(kind, ParameterSpec) for kind in kinds) or not is_list:
        expected = "parameters = a list of one ParameterSpec a parameter"
        observation = ", ".join(kind.__name__ for kind in kinds) or "an empty list"
        raise _refusal(name, "has no list of parameters", expected, observation)
    names = [spec.name for spec in cast(Sequence[ParameterSpec], parameters)]
    repeated = sorted(
        {
            parameter_name
            for parameter_name in names
            if names.count(parameter_name) > 1 or parameter_name == "s"
        }
    )
    if repeated:
        expected = "names of their own, and not s"
        raise _refusal(name, "has a name twice", expected, ", ".join(repeated))
    try:
        inspect.signature(response).bind(None, **dict.fromkeys(names))
    except (TypeError, ValueError) as error:
        problem = "is no function of s and the parameters"
        expected = f"a function (s, {', '.join(names)})"
        raise _refusal(name, problem, expected, str(error)) from None


def completed(
    name: str, response: Callable[..., Any], specs: Sequence[ParameterSpec]
) -> tuple[ParameterSpec, ...]:
    """Return the parameters with kind, bounds and grid of each.

    Raises:
        ModelError: the response cannot be computed, none or several of the parameters are its gain,
            or a start value is missing or outside its bounds.
    """
    values = {spec.name: _likely_value(spec) for spec in specs}
    gain = _gain_name(name, response, specs, values)
    shapes = [spec for spec in specs if spec.name != gain]
    over_band = [spec.name for spec in shapes if _is_over_band(spec)]
    if len(over_band) > MAX_PARAMETERS_OVER_BAND:
        raise _refusal(
            name,
            "needs start values",
            f"at most {MAX_PARAMETERS_OVER_BAND} parameters in Hz without start value",
            f"none for {', '.join(over_band)}",
            "give ParameterSpec a start",
        )
    points = MAX_GRID_POINTS / POINTS_OVER_BAND ** len(over_band)
    count = int(points ** (1.0 / max(len(shapes) - len(over_band), 1)))
    count = min(max(count, MIN_POINTS_OF_PARAMETER), MAX_POINTS_OF_PARAMETER)
    completed_specs = tuple(
        replace(spec, kind="gain") if spec.name == gain else _with_grid(name, spec, count)
        for spec in specs
    )
    _require_slopes(name, response, completed_specs, values)
    return completed_specs


def _likely_value(spec: ParameterSpec) -> float:
    """Return a likely value of a parameter: its start value, or one between its bounds."""
    if spec.start is not None:
        return float(spec.start)
    if spec.bounds is None:
        return 1.5
    low, high = spec.bounds
    return float(np.sqrt(low * high) if low > 0.0 else 0.5 * (low + high))


def _is_over_band(spec: ParameterSpec) -> bool:
    """Return whether a parameter is a frequency of which nothing is stated.

    The band of the data tells where to look for it.
    """
    return spec.grid == "band" or (spec.unit == "Hz" and spec.start is None and spec.bounds is None)


def _trial_response(name: str, response: Callable[..., Any], values: Mapping[str, Any]) -> Any:
    """Return the complex response at the trial frequencies, shape (…, frequencies).

    Raises:
        ModelError: it cannot be computed, or has no finite value.
    """
    problem = "cannot be computed"
    expected = "a complex array by frequency"
    try:
        with np.errstate(all="ignore"):
            value = np.asarray(response(_TRIAL_S, **values)) + 0.0 * _TRIAL_S
    except Exception as error:  # a function of a user may raise any error
        observation = f"{type(error).__name__}: {error}"
        remedy = "write it with Python's operators and NumPy's functions, which take complex arrays"
        raise _refusal(name, problem, expected, observation, remedy) from None
    if value.dtype.kind not in "fc":
        raise _refusal(name, problem, expected, f"{value.dtype} of shape {value.shape}")
    if value.shape[-1:] != _TRIAL_S.shape or not np.any(np.isfinite(value)):
        raise _refusal(name, problem, expected, "no finite value")
    return value


def _gain_name(
    name: str,
    response: Callable[..., Any],
    specs: Sequence[ParameterSpec],
    values: Mapping[str, float],
) -> str:
    """Return the name of the parameter that the response is proportional to.

    Raises:
        ModelError: there is none, or there are several.
    """
    single = _trial_response(name, response, values)
    usable = np.isfinite(single)
    gains = []
    for spec in specs:
        if spec.kind not in (None, "gain"):
            continue
        double = _trial_response(name, response, {**values, spec.name: 2.0 * values[spec.name]})
        with np.errstate(all="ignore"):
            deviation = np.abs(double - 2.0 * single)
            deviates = deviation > _PROPORTIONALITY_TOLERANCE * np.abs(double)
        if not np.any(deviates[usable]) and values[spec.name] != 0.0:
            gains.append(spec.name)
    expected = "one parameter that the response is proportional to"
    if not gains:
        remedy = "write the response as a gain times the rest"
        raise _refusal(name, "has no gain", expected, "0 gains", remedy)
    if len(gains) > 1:
        observation = f"{len(gains)} gains: {', '.join(gains)}"
        remedy = "fix all but one of them"
        raise _refusal(name, "has several gains", expected, observation, remedy)
    return gains[0]


def _with_grid(name: str, spec: ParameterSpec, count: int) -> ParameterSpec:
    """Return a parameter with kind, bounds and a grid of ``count`` points.

    Raises:
        ModelError: its start value or its bounds are missing or do not fit together.
    """
    if spec.kind is not None and spec.grid:
        return spec
    if _is_over_band(spec):
        return replace(spec, kind="log", grid="band")
    if spec.start is None and spec.bounds is None:
        expected = f"ParameterSpec({spec.name!r}, …, start=…, bounds=(lowest, highest))"
        raise _refusal(name, "needs a start value", expected, f"none for {spec.name}")
    start = _likely_value(spec)
    if spec.bounds is None and start <= 0.0:
        expected = f"bounds=(lowest, highest) of {spec.name}, as its start value is not positive"
        raise _refusal(name, "needs bounds", expected, f"start={start:g}")
    low, high = spec.bounds or (start / SEARCH_FACTOR, start * SEARCH_FACTOR)
    if not low <= start <= high or not low < high or not np.isfinite([low, high]).all():
        problem = "has a start value outside its bounds"
        expected = f"bounds=(lowest, highest) of {spec.name} around its start value"
        raise _refusal(name, problem, expected, f"start={start:g}, bounds={spec.bounds}")
    if low < 0.0:
        kind = "ratio"
        grid = np.linspace(low, high, count + 2)[1:-1]
    else:
        kind = "log"
        low = low or MIN_RELATIVE_VALUE * start
        ends = (low, high) if spec.bounds else (start / GRID_FACTOR, start * GRID_FACTOR)
        grid = np.geomspace(*ends, count + 2)[1:-1]
    grid[np.argmin(np.abs(grid - start))] = start
    points = tuple(sorted(grid.tolist()))
    return replace(spec, kind=kind, start=start, bounds=(low, high), grid=points)


def _require_slopes(
    name: str,
    response: Callable[..., Any],
    specs: Sequence[ParameterSpec],
    values: Mapping[str, float],
) -> None:
    """Refuse a response that complex steps cannot differentiate: with abs, real or imag in it.

    The difference of a real step and that of an imaginary one must give the same derivative.
    """
    for spec in specs:
        step = 1e-5 * (abs(values[spec.name]) or 1.0)
        ahead, back, turned_ahead, turned_back = (
            _trial_response(name, response, {**values, spec.name: values[spec.name] + step * turn})
            for turn in (1, -1, 1j, -1j)
        )
        with np.errstate(all="ignore"):
            real = ahead - back
            imaginary = (turned_ahead - turned_back) / 1j
            size = np.abs(ahead) * 1e-5 + np.abs(real)
            differs = np.abs(real - imaginary) > 1e-2 * size
        if np.any(differs & np.isfinite(size)):
            raise _refusal(
                name,
                "cannot be differentiated",
                f"an analytic function of {spec.name}: without abs, real, imag and conj",
                "derivatives that disagree",
                "write it without them",
            )


def _refusal(
    name: str, problem: str, expected: str, observation: str, remedy: str = "correct the model"
) -> ModelError:
    """Return the error of a model that cannot be used; ``problem``: a clause after its name."""
    return ModelError(
        f"The model {name!r} {problem}.",
        expected=expected,
        found=observation,
        where=f"Model {name!r}",
        remedy=remedy,
    )
