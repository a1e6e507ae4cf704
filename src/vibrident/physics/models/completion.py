"""Completion of a model made in Python: its gain, and where values are searched."""

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
#: Factor by which the grid extends around it, either way.
GRID_FACTOR = 30.0
#: Places of the grid of all parameters together, and the fewest and most along one of them.
MAX_GRID_PLACES = 1000
MIN_PLACES_OF_PARAMETER = 3
MAX_PLACES_OF_PARAMETER = 40
#: Places over the band of the data, about.
PLACES_OVER_BAND = 32
#: Most parameters without a start value, which are looked for over the whole band.
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
        ModelError: it is none.
    """
    if not callable(response):
        raise _refused(
            name, "is no function", "response = a function of s and the parameters", repr(response)
        )
    is_list = isinstance(parameters, Sequence) and not isinstance(parameters, str | bytes)
    if (
        not is_list
        or not parameters
        or not all(isinstance(spec, ParameterSpec) for spec in parameters)
    ):
        expected = "parameters = a list of one ParameterSpec a parameter"
        raise _refused(name, "has no list of parameters", expected, _kinds(parameters))
    names = [spec.name for spec in cast(Sequence[ParameterSpec], parameters)]
    repeated = sorted({each for each in names if names.count(each) > 1 or each == "s"})
    if repeated:
        raise _refused(
            name, "has a name twice", "names of their own, and not s", ", ".join(repeated)
        )
    try:
        inspect.signature(response).bind(None, **dict.fromkeys(names))
    except (TypeError, ValueError) as error:
        expected = f"a function (s, {', '.join(names)})"
        raise _refused(
            name, "is no function of s and the parameters", expected, str(error)
        ) from None


def completed(
    name: str, response: Callable[..., Any], specs: Sequence[ParameterSpec]
) -> tuple[ParameterSpec, ...]:
    """Return the parameters with kind, bounds and grid of each.

    Raises:
        ModelError: the response cannot be computed, none or several of the parameters are its gain,
            or a start value is missing or outside its bounds.
    """
    values = {spec.name: _likely(spec) for spec in specs}
    gains = _gains(name, response, specs, values)
    if len(gains) != 1:
        observation = f"{len(gains)} gains" + (f": {', '.join(gains)}" if gains else "")
        remedy = (
            "fix all but one of them" if gains else "write the response as a gain times the rest"
        )
        expected = "one parameter that the response is proportional to"
        raise _refused(
            name, "has no gain" if not gains else "has several gains", expected, observation, remedy
        )
    shapes = [spec for spec in specs if spec.name not in gains]
    over_band = [spec for spec in shapes if _is_over_band(spec)]
    if len(over_band) > MAX_PARAMETERS_OVER_BAND:
        observation = f"none for {', '.join(spec.name for spec in over_band)}"
        expected = f"at most {MAX_PARAMETERS_OVER_BAND} parameters in Hz without start value"
        raise _refused(
            name, "needs start values", expected, observation, "give ParameterSpec a start"
        )
    searched = max(len(shapes) - len(over_band), 1)
    share = MAX_GRID_PLACES / PLACES_OVER_BAND ** len(over_band)
    count = int(share ** (1.0 / searched))
    count = min(max(count, MIN_PLACES_OF_PARAMETER), MAX_PLACES_OF_PARAMETER)
    each = [
        replace(spec, kind="gain") if spec.name in gains else _searched(name, spec, count)
        for spec in specs
    ]
    _require_slopes(name, response, each, values)
    return tuple(each)


def _likely(spec: ParameterSpec) -> float:
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


def _computed(name: str, response: Callable[..., Any], values: Mapping[str, Any]) -> Any:
    """Return the response at the frequencies tried, complex."""
    try:
        with np.errstate(all="ignore"):
            value = np.asarray(response(_TRIAL_S, **values)) + 0.0 * _TRIAL_S
    except Exception as error:  # a function of a user may raise any error
        text = f"{type(error).__name__}: {error}"
        remedy = "write it with Python's operators and NumPy's functions, which take complex arrays"
        raise _refused(
            name, "cannot be computed", "a complex array by frequency", text, remedy
        ) from None
    if (
        value.dtype.kind not in "fc"
        or value.shape[-1:] != _TRIAL_S.shape
        or not np.any(np.isfinite(value))
    ):
        observation = (
            f"{value.dtype} of shape {value.shape}"
            if value.dtype.kind not in "fc"
            else "no finite value"
        )
        raise _refused(name, "cannot be computed", "a complex array by frequency", observation)
    return value


def _gains(
    name: str,
    response: Callable[..., Any],
    specs: Sequence[ParameterSpec],
    values: Mapping[str, float],
) -> list[str]:
    """Return the names of the parameters that the response is proportional to."""
    single = _computed(name, response, values)
    usable = np.isfinite(single)
    gains = []
    for spec in specs:
        if spec.kind not in (None, "gain"):
            continue
        double = _computed(name, response, {**values, spec.name: 2.0 * values[spec.name]})
        with np.errstate(all="ignore"):
            off = np.abs(double - 2.0 * single) > _PROPORTIONALITY_TOLERANCE * np.abs(double)
        if not np.any(off[usable]) and values[spec.name] != 0.0:
            gains.append(spec.name)
    return gains


def _searched(name: str, spec: ParameterSpec, count: int) -> ParameterSpec:
    """Return a parameter with kind, bounds and grid."""
    if spec.kind is not None and spec.grid:
        return spec
    if _is_over_band(spec):
        return replace(spec, kind="log", grid="band")
    if spec.start is None and spec.bounds is None:
        expected = f"ParameterSpec({spec.name!r}, …, start=…, bounds=(lowest, highest))"
        raise _refused(name, "needs a start value", expected, f"none for {spec.name}")
    start = _likely(spec)
    if spec.bounds is None and start <= 0.0:
        expected = f"bounds=(lowest, highest) of {spec.name}, as its start value is not positive"
        raise _refused(name, "needs bounds", expected, f"start={start:g}")
    low, high = spec.bounds or (start / SEARCH_FACTOR, start * SEARCH_FACTOR)
    if not low <= start <= high or not low < high or not np.isfinite([low, high]).all():
        expected = f"bounds=(lowest, highest) of {spec.name} around its start value"
        raise _refused(
            name,
            "has a start value outside its bounds",
            expected,
            f"start={start:g}, bounds={spec.bounds}",
        )
    if low < 0.0:
        grid = _with(start, np.linspace(low, high, count + 2)[1:-1])
        return replace(spec, kind="ratio", start=start, bounds=(low, high), grid=grid)
    low = low or MIN_RELATIVE_VALUE * start
    ends = (low, high) if spec.bounds else (start / GRID_FACTOR, start * GRID_FACTOR)
    values = np.geomspace(ends[0], ends[1], count + 2)[1:-1]
    return replace(spec, kind="log", start=start, bounds=(low, high), grid=_with(start, values))


def _with(start: float, grid: Any) -> tuple[float, ...]:
    """Return the places with the start value in place of the one nearest to it."""
    grid[int(np.argmin(np.abs(grid - start)))] = start
    return tuple(sorted(grid.tolist()))


def _require_slopes(
    name: str,
    response: Callable[..., Any],
    specs: Sequence[ParameterSpec],
    values: Mapping[str, float],
) -> None:
    """Refuse a response that complex steps cannot differentiate: with abs, real or imag in it."""
    for spec in specs:
        step = 1e-5 * (abs(values[spec.name]) or 1.0)
        moved = [
            _computed(name, response, {**values, spec.name: values[spec.name] + step * turn})
            for turn in (1, -1)
        ]
        turned = [
            _computed(name, response, {**values, spec.name: values[spec.name] + step * turn})
            for turn in (1j, -1j)
        ]
        with np.errstate(all="ignore"):
            real = moved[0] - moved[1]
            imaginary = (turned[0] - turned[1]) / 1j
            size = np.abs(moved[0]) * 1e-5 + np.abs(real)
            off = np.abs(real - imaginary) > 1e-2 * size
        if np.any(off & np.isfinite(size)):
            expected = f"an analytic function of {spec.name}: without abs, real, imag and conj"
            remedy = "write it without them"
            raise _refused(
                name, "cannot be differentiated", expected, "derivatives that disagree", remedy
            )


def _kinds(parameters: Any) -> str:
    """Return the types of parameters, for a message."""
    if isinstance(parameters, Sequence) and not isinstance(parameters, str | bytes):
        return ", ".join(type(each).__name__ for each in parameters) or "an empty list"
    return type(parameters).__name__


def _refused(
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
