"""Parts of every sensor model: parameters with units and bounds, transfer functions, a delay.

The formulas use only arithmetic operators, so the same lines serve NumPy arrays, JAX arrays and JAX
tracers; a model needs no array library of its own. A sensor is linear and time-invariant here:

    response(s) = gain · N(s)/D(s) · e^{−s τ} · acceleration(s),   D monic.

A reference given as velocity or displacement multiplies N by s or s². An add-on with a ``force`` is
nonlinear: the force on the mass depends on the core's response at the same instant, and for small
responses it vanishes faster than the response.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from vibrident.base.errors import ModelError
from vibrident.physics.models.ratio import Coefficients, Ratio

#: Powers of s that turn the reference quantity into acceleration. A drive is proportional to
#: acceleration; the response of a model of a structure is per unit of force.
DERIVATIVES: Mapping[str, int] = {
    "acceleration": 0,
    "drive": 0,
    "force": 0,
    "velocity": 1,
    "displacement": 2,
}
Parameters = Mapping[str, Any]  # name → number, array or tracer, SI units except frequencies in Hz


@dataclass(frozen=True)
class ParameterSpec:
    """Name, unit, range and guesses of a parameter of a model.

    Attributes:
        name: in result.json and in Python; an identifier.
        unit: ``{response}`` stands for the response unit, ``{reference}`` for the unit of
            acceleration or drive.
        kind: its scale in the optimiser. ``gain``: linear, any sign, scaled by its start value;
            ``log``: positive, by its logarithm; ``duration``: positive, by its logarithm, in
            seconds; ``positive``: linear, reflected at zero; ``time``: linear, in units of the
            shortest time scale of the data; ``ratio``: linear; ``inverse``, ``inverse_square``:
            linear, in units of one over the response's size, or over its square; None: as start
            and bounds say, ``gain`` where the response is proportional to it.
        guesses: start values of an add-on's parameter, to be tried in turn, as multiples of what
            ``guess_at`` says.
        guess_at: ``lowest`` or ``highest`` frequency of the data, ``period`` of the highest, or
            ``one``; ``band``: the guesses are places in the logarithm of frequency, from zero at
            the lowest to one at the highest.
        words: name in words; empty: the name with spaces.
        symbol: usual symbol.
        describes: what calibrations of one sensor share it: the ``oscillator`` itself, for any
            output; an ``output``, where response unit and kind of reference are alike; the
            ``channel`` of one calibration alone.
        grid: of a core's parameter: the values from which start values are looked for, or ``band``
            for frequencies over the band of the data and beyond; empty: the gain, which follows
            from the others.
        start: a likely value; None: the data tell it (the gain, a frequency in Hz).
        bounds: lowest and highest value searched; None: as its kind says.

    Examples:
        >>> import vibrident
        >>> vibrident.ParameterSpec("q", "1", start=5.0, bounds=(0.5, 100.0)).size
        100.0
    """

    name: str
    unit: str
    kind: (
        Literal["gain", "log", "duration", "positive", "time", "ratio", "inverse", "inverse_square"]
        | None
    ) = None
    guesses: tuple[float, ...] = ()
    guess_at: Literal["lowest", "highest", "period", "one", "band"] = "one"
    words: str = ""
    symbol: str = ""
    describes: Literal["oscillator", "output", "channel"] = "output"
    grid: tuple[float, ...] | Literal["band"] = ()
    start: float | None = None
    bounds: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        require_identifier(self.name)

    @property
    def size(self) -> float:
        """Return the unit of a ratio's coordinate: the larger of its bounds, one without any."""
        return 1.0 if self.bounds is None else max(map(abs, self.bounds))


@dataclass(frozen=True)
class Rational:
    """Transfer function gain · N(s)/D(s): coefficients in ascending powers of s, D monic.

    ``angular_scale`` (rad/s) is a typical rate of the system; states are scaled by it to keep
    numbers near one.
    """

    gain: Any
    numerator: tuple[Any, ...]
    denominator: tuple[Any, ...]
    angular_scale: Any


def in_parallel(system: Rational, share: Any, denominator: Coefficients) -> Rational:
    """Return the system gain · [N(s)/D(s) + share/denominator(s)]; coefficients ascending."""
    total = Ratio(system.numerator, system.denominator) + Ratio((share,), denominator)
    return replace(system, numerator=total.numerator, denominator=total.denominator)


@dataclass(frozen=True)
class Derived:
    """Function of the estimated parameters; it may not exist for all values.

    Attributes:
        name: in result.json; an identifier.
        unit: as for a parameter; ``{conversion}`` stands for response unit per metre.
        value: the parameters' values → its value.
        exists: the parameters' values → whether there is one.
        words: name in words; empty: the name with spaces.
        symbol: usual symbol.
        needs: parameters without which it is not known, the gain left aside.
        positive: whether it is above zero, so that its interval is symmetric in its logarithm.
    """

    name: str
    unit: str
    value: Callable[[Parameters], Any]
    exists: Callable[[Parameters], bool] = lambda parameters: True
    words: str = ""
    symbol: str = ""
    needs: tuple[str, ...] = ()
    positive: bool = True

    def __post_init__(self) -> None:
        require_identifier(self.name)


Values = Mapping[str, Any]  # name → value
#: Takes and gives values by name, real or complex; analytic.
Relabelling = Callable[[Values], dict[str, Any]]


@dataclass(frozen=True)
class Labels:
    """Rule that labels parts whose exchange gives the same response.

    Attributes:
        alternatives: (core, a ``Model``, values) → all other assignments of the labels that give
            the same response.
        in_order: (values, those of the first alternative) → whether these have the stated form.
        undecided: (values, standard uncertainties) → whether the data leave the form open.
        question: what the response does not tell, in words.
    """

    alternatives: Callable[[Any, Values], tuple[Relabelling, ...]]
    in_order: Callable[[Values, Values], bool]
    undecided: Callable[[Values, Values], bool]
    question: str


@dataclass(frozen=True)
class AddOn:
    """Part in series with, or parallel to, the core.

    ``rational`` changes the core's transfer function; ``factor`` multiplies its frequency response
    where that is not rational, given s = jω. ``force`` makes the sensor nonlinear: given the core's
    response V it is F in V̈ + 2 δ ωn V̇ + ωn² V = K a + ωn² F(V).

    Attributes:
        name: in the names of models, behind a "+".
        title: what it is, in a few words.
        parameters: each with ``guesses``, but for a delay and what acts back on the mass.
        rational: (values, system) → the system with it.
        delay: values → delay, s.
        factor: (values, s) → factor on the frequency response.
        factor_slopes: (values, s) → derivatives of the factor by name.
        force: (values, V) → F(V).
        parallel: (values, core) → what ``rational`` adds in parallel to the core, which a force
            does not see.
        in_series: whether ``rational`` multiplies the whole response; else it adds something in
            parallel to the core.
        oscillator: names of natural frequency (Hz) and damping ratio of a mode that it adds.
        corner: name of the corner frequency (Hz) of a real pole that it adds.
        share: name of the parameter that what it adds in parallel is proportional to.
        window: name of the length, s, of a window over which it averages.
        before_sensor: whether it changes the motion that reaches the sensor: its ``rational`` is
            then given core and parallel parts alone.
        moves_poles: whether the poles of the core become others, so that no part parallel to the
            core may stand beside it.
        with_number: (number behind ":" in a model's name, core, a ``Model``) → the add-on for it.
        labels: how its part is told from a like one, where it adds such.
        remark: what a report says beside the results of such a model.
    """

    name: str
    title: str
    parameters: tuple[ParameterSpec, ...]
    rational: Callable[[Parameters, Rational], Rational] | None = None
    delay: Callable[[Parameters], Any] | None = None
    factor: Callable[[Parameters, Any], Any] | None = None
    factor_slopes: Callable[[Parameters, Any], Mapping[str, Any]] | None = None
    force: Callable[[Parameters, Any], Any] | None = None
    parallel: Callable[[Parameters, Rational], Rational] | None = None
    in_series: bool = True
    oscillator: tuple[str, str] | None = None
    corner: str = ""
    share: str = ""
    window: str = ""
    before_sensor: bool = False
    moves_poles: bool = False
    with_number: Callable[[float, Any], AddOn] | None = None
    labels: Labels | None = None
    remark: str = ""

    @property
    def place(self) -> int:
        """Return the position in a model's name and in the chain.

        Forces come first, then parallel modes, the mounting, filters behind, average, delay.
        """
        if self.force is not None:
            return 0
        if self.rational is not None:
            return 2 + (not self.before_sensor) if self.in_series else 1
        return 4 if self.factor is not None else 5

    @property
    def is_delay(self) -> bool:
        """Return whether it does nothing but delay."""
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
    """Return a polynomial with ascending coefficients at ``s``, by Horner's rule."""
    value = coefficients[-1] + 0.0 * s
    for coefficient in reversed(coefficients[:-1]):
        value = value * s + coefficient
    return value


def exponential(z: Any) -> Any:
    """Return e^z of NumPy or JAX arrays."""
    return array_library(z).exp(z)


def sinc(x: Any) -> Any:
    """Return sin(x)/x of NumPy or JAX arrays."""
    return array_library(x).sinc(x / np.pi)


def array_library(*values: Any) -> Any:
    """Return NumPy where every value is a number or a NumPy array, ``jax.numpy`` otherwise."""
    if all(isinstance(value, (np.ndarray, np.generic, complex, float, int)) for value in values):
        return np
    import jax.numpy as jnp  # only tracers and JAX arrays reach this line, so JAX is loaded already

    return jnp


OSCILLATOR = ("natural_frequency", "damping_ratio")  # names of natural frequency and damping ratio
#: From which start values are looked for.
_DAMPINGS = (0.0005, 0.003, 0.02, 0.08, 0.2, 0.4, 0.6, 0.8, 1.2, 2.5)

NATURAL_FREQUENCY = ParameterSpec(
    OSCILLATOR[0], "Hz", "log", symbol="fn", describes="oscillator", grid="band"
)
DAMPING_RATIO = ParameterSpec(
    OSCILLATOR[1], "1", "positive", symbol="δ", describes="oscillator", grid=_DAMPINGS
)
ANGULAR_FREQUENCY = Derived(
    "natural_angular_frequency",
    "rad/s",
    lambda parameters: 2.0 * np.pi * parameters[OSCILLATOR[0]],
    symbol="ωn",
    needs=OSCILLATOR[:1],
)
FREE_PERIOD = Derived(
    "free_period",
    "s",
    lambda parameters: 1.0 / parameters[OSCILLATOR[0]],
    symbol="T0",
    needs=OSCILLATOR[:1],
)


def has_peak(parameters: Parameters) -> bool:
    """Return whether the response has a maximum: δ < 1/√2."""
    return 2.0 * parameters[OSCILLATOR[1]] ** 2 < 1.0
