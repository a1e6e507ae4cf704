"""What every sensor model is made of: parameters with units and bounds, a rational transfer function, a delay.

The formulas use only arithmetic operators, so the same lines serve NumPy arrays, JAX arrays and JAX tracers; a
model needs no array library of its own. A sensor is linear and time-invariant here:

    response(s) = gain · N(s)/D(s) · e^{−s τ} · acceleration(s),   D monic.

A reference given as velocity or displacement multiplies N by s or s². An add-on with a ``force`` is the exception: it
acts back on the mass by what the core's response is, in time only, and vanishes faster than the response.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from vibrident.base.errors import ModelError

#: Powers of s that turn the reference quantity into acceleration. A drive acts as acceleration up to a constant.
DERIVATIVES: Mapping[str, int] = {"acceleration": 0, "drive": 0, "velocity": 1, "displacement": 2}
Parameters = Mapping[str, Any]  # name → number, array or tracer, SI units except frequencies in Hz


@dataclass(frozen=True)
class ParameterSpec:
    """One parameter of a model."""

    name: str  # in result.json and in Python; an identifier
    # unit; ``{response}`` stands for the response unit, ``{reference}`` for the unit of acceleration or drive
    unit: str
    # its scale in the optimiser. ``gain``: linear, any sign, scaled by its start value; ``log``: positive, by its
    # logarithm; ``duration``: positive, by its logarithm, in seconds; ``positive``: linear, reflected at zero;
    # ``time``: linear, in units of the shortest time scale of the data; ``ratio``: linear; ``inverse``,
    # ``inverse_square``: linear, in units of one over the response's size, or over its square; None: as start and
    # bounds say, ``gain`` where the response is proportional to it
    kind: Literal["gain", "log", "duration", "positive", "time", "ratio", "inverse", "inverse_square"] | None = None
    # start values of an add-on's parameter, to be tried in turn, as multiples of what ``guess_at`` says
    guesses: tuple[float, ...] = ()
    # ``lowest`` or ``highest`` frequency of the data, ``period`` of the highest, or ``one``; ``band``: the guesses are
    # places in the logarithm of frequency, from zero at the lowest to one at the highest
    guess_at: Literal["lowest", "highest", "period", "one", "band"] = "one"
    words: str = ""  # name in words; empty: the name with spaces
    symbol: str = ""  # usual symbol
    # what calibrations of one sensor share it: the ``oscillator`` itself, for any output; an ``output``, where response
    # unit and kind of reference are alike; the ``channel`` of one calibration alone
    describes: Literal["oscillator", "output", "channel"] = "output"
    # of a core's parameter: the values from which start values are looked for, or ``band`` for frequencies over the
    # band of the data and beyond; empty: the gain, which follows from the rest
    grid: tuple[float, ...] | Literal["band"] = ()
    start: float | None = None  # a likely value; None: the data tell it (the gain, a frequency in Hz)
    bounds: tuple[float, float] | None = None  # lowest and highest value searched; None: as its kind says

    def __post_init__(self) -> None:
        require_identifier(self.name)

    @property
    def size(self) -> float:
        """Return the unit of the coordinate of a ratio: the larger of its bounds, one without any."""
        return 1.0 if self.bounds is None else max(map(abs, self.bounds))


@dataclass(frozen=True)
class Rational:
    """gain · N(s)/D(s): coefficients in ascending powers of s, D monic.

    ``angular_scale`` (rad/s) is a typical rate of the system; states are scaled by it to keep numbers near one.
    """

    gain: Any
    numerator: tuple[Any, ...]
    denominator: tuple[Any, ...]
    angular_scale: Any


@dataclass(frozen=True)
class Derived:
    """A function of the estimated parameters; it may not exist for all values."""

    name: str  # in result.json; an identifier
    unit: str  # as for a parameter; ``{conversion}`` stands for response unit per metre
    value: Callable[[Parameters], Any]  # of the parameters' values
    exists: Callable[[Parameters], bool] = lambda parameters: True  # whether there is one for these values
    words: str = ""  # name in words; empty: the name with spaces
    symbol: str = ""  # usual symbol
    needs: tuple[str, ...] = ()  # parameters without which it is not known, the gain left aside
    positive: bool = True  # whether it is above zero, so that its interval is symmetric in its logarithm

    def __post_init__(self) -> None:
        require_identifier(self.name)


Values = Mapping[str, Any]  # name → value
Relabelling = Callable[[Values], dict[str, Any]]  # takes and gives values by name, real or complex; analytic


@dataclass(frozen=True)
class Labels:
    """Which of several parts that give the same response has which name."""

    # (core, a ``Model``, values) → all other assignments of the labels that give the same response
    others: Callable[[Any, Values], tuple[Relabelling, ...]]
    # (values, those of the first other way) → whether these have the one form that is stated
    in_order: Callable[[Values, Values], bool]
    # (values, standard uncertainties) → whether the data leave the form open
    undecided: Callable[[Values, Values], bool]
    question: str  # what the response does not tell, in words


@dataclass(frozen=True)
class AddOn:
    """A part in series with, or parallel to, the core.

    ``rational`` changes the core's transfer function; ``factor`` multiplies its frequency response where that is not
    rational, given s = jω, and ``factor_slopes`` are its derivatives by name. ``force`` makes the sensor nonlinear:
    given the core's response V it is F in V̈ + 2 δ ωn V̇ + ωn² V = K a + ωn² F(V). ``beside`` is what a ``rational``
    adds in parallel to the core, which such a force does not see.
    """

    name: str  # in the names of models, behind a "+"
    title: str  # what it is, in a few words
    parameters: tuple[ParameterSpec, ...]  # each with ``guesses``, but for a delay and what acts back on the mass
    rational: Callable[[Parameters, Rational], Rational] | None = None  # (values, system) → the system with it
    delay: Callable[[Parameters], Any] | None = None  # values → delay, s
    factor: Callable[[Parameters, Any], Any] | None = None  # (values, s) → factor on the frequency response
    factor_slopes: Callable[[Parameters, Any], Mapping[str, Any]] | None = None  # (values, s) → its derivatives by name
    force: Callable[[Parameters, Any], Any] | None = None  # (values, V) → F(V)
    # (values, core) → the part in parallel to the core
    beside: Callable[[Parameters, Rational], Rational] | None = None
    # whether ``rational`` multiplies the whole response; False: it adds something beside the core
    in_series: bool = True
    # names of natural frequency (Hz) and damping ratio of a mode that it adds
    oscillator: tuple[str, str] | None = None
    corner: str = ""  # name of the corner frequency (Hz) of a real pole that it adds
    share: str = ""  # name of the parameter that what it adds beside the core is proportional to
    window: str = ""  # name of the length, s, of a window over which it averages
    labels: Labels | None = None  # which of several like parts has which name, where it adds one like another
    remark: str = ""  # what a report says beside the results of such a model

    @property
    def place(self) -> int:
        """Its position in a model's name and in the chain: forces, modes beside, filters behind, average, delay."""
        if self.force is not None:
            return 0
        if self.rational is not None:
            return 2 if self.in_series else 1
        return 3 if self.factor is not None else 4

    @property
    def is_delay(self) -> bool:
        """True where it does nothing but delay."""
        return self.delay is not None and not (self.rational or self.factor or self.force)


def require_identifier(name: str) -> None:
    """Check a name: it is used in files, code and tables."""
    if not (name.isidentifier() and name.isascii()):
        raise ModelError(
            f"{name!r} cannot be the name of a parameter.",
            expected="letters, digits and _, such as natural_frequency",
            found=repr(name),
            where="sensor model",
            remedy="correct the model",
        )


def polynomial(coefficients: tuple[Any, ...], s: Any) -> Any:
    """Value of a polynomial with ascending coefficients at ``s``, by Horner's rule."""
    value = coefficients[-1] + 0.0 * s
    for coefficient in reversed(coefficients[:-1]):
        value = value * s + coefficient
    return value


def exponential(z: Any) -> Any:
    """e^z of NumPy or JAX arrays."""
    return array_library(z).exp(z)


def sinc(x: Any) -> Any:
    """sin(x)/x of NumPy or JAX arrays."""
    return array_library(x).sinc(x / np.pi)


def array_library(*values: Any) -> Any:
    """NumPy where every value is a number or a NumPy array, ``jax.numpy`` otherwise."""
    if all(isinstance(value, (np.ndarray, np.generic, complex, float, int)) for value in values):
        return np
    import jax.numpy as jnp  # only tracers and JAX arrays reach this line, so JAX is loaded already

    return jnp


OSCILLATOR = ("natural_frequency", "damping_ratio")  # names of natural frequency and damping ratio
_DAMPINGS = (0.0005, 0.003, 0.02, 0.08, 0.2, 0.4, 0.6, 0.8, 1.2, 2.5)  # from which start values are looked for

NATURAL_FREQUENCY = ParameterSpec(OSCILLATOR[0], "Hz", "log", symbol="fn", describes="oscillator", grid="band")
DAMPING_RATIO = ParameterSpec(OSCILLATOR[1], "1", "positive", symbol="δ", describes="oscillator", grid=_DAMPINGS)
ANGULAR_FREQUENCY = Derived(
    "natural_angular_frequency",
    "rad/s",
    lambda parameters: 2.0 * np.pi * parameters[OSCILLATOR[0]],
    symbol="ωn",
    needs=OSCILLATOR[:1],
)


def has_peak(parameters: Parameters) -> bool:
    """Whether the response has a maximum: δ < 1/√2."""
    return 2.0 * parameters[OSCILLATOR[1]] ** 2 < 1.0
