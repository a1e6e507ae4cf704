"""What every sensor model is made of: parameters with units and bounds, a rational transfer function, a delay.

The formulas use only arithmetic operators, so the same lines serve NumPy arrays, JAX arrays and JAX tracers; a
model needs no array library of its own. A sensor is linear and time-invariant here:

    response(s) = gain · N(s)/D(s) · e^{−s τ} · acceleration(s),   D monic.

A reference given as velocity or displacement multiplies N by s or s². An add-on with a ``force`` is the exception: it
acts back on the mass by what the core's response is, in time only, and vanishes faster than the response.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from vibrident.base.errors import ModelError
from vibrident.data.records import Quantity

if TYPE_CHECKING:
    from vibrident.physics.models.model import Model

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
        """Unit of the coordinate of a ratio: the larger of its bounds, one without any."""
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

    # (core, values) → all other assignments of the labels that give the same response
    others: Callable[[Model, Values], tuple[Relabelling, ...]]
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


@dataclass(frozen=True)
class SensorModel:
    """A core with its add-ons; ``name`` is what result.json says."""

    name: str
    core: Model
    add_ons: tuple[AddOn, ...] = ()

    @property
    def parameters(self) -> tuple[ParameterSpec, ...]:
        """All parameters, core first."""
        return (*self.core.parameters, *(spec for addon in self.add_ons for spec in addon.parameters))

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of all parameters, core first."""
        return tuple(spec.name for spec in self.parameters)

    @property
    def oscillators(self) -> tuple[tuple[str, str], ...]:
        """Names of natural frequency and damping ratio of every mode, the core's first."""
        parts = (self.core.oscillator, *(addon.oscillator for addon in self.add_ons))
        return tuple(pair for pair in parts if pair is not None)

    @property
    def shares(self) -> tuple[str, ...]:
        """Names of the parameters that what add-ons add beside the core is proportional to."""
        return tuple(addon.share for addon in self.add_ons if addon.share)

    @property
    def factor_names(self) -> tuple[str, ...]:
        """Names of the parameters of the factors that are not rational."""
        return tuple(spec.name for part in self._factored for spec in part.parameters if spec.kind != "gain")

    @property
    def _factored(self) -> list[Model | AddOn]:
        """The parts that are not rational."""
        return [part for part in (self.core, *self.add_ons) if part.factor is not None]

    @property
    def windows(self) -> tuple[str, ...]:
        """Names of the lengths of windows over which the sensor averages."""
        return tuple(addon.window for addon in self.add_ons if addon.window)

    def fastest(self, parameters: Parameters) -> float:
        """Largest |pole| of the core, rad/s."""
        if self.core.oscillator is None:
            poles = np.roots(np.array(self.core.rational(parameters).denominator, dtype=float)[::-1])
            return float(np.max(np.abs(poles))) if poles.size else 0.0
        natural, damping = (parameters[name] for name in self.core.oscillator)
        faster = damping + np.sqrt(damping**2 - 1.0) if damping > 1.0 else 1.0
        return float(2.0 * np.pi * natural * faster)

    def typical_frequency(self, parameters: Parameters) -> float:
        """Natural frequency of the core, Hz; the frequency of its fastest pole where it is no oscillator."""
        if self.core.oscillator is not None:
            return float(parameters[self.core.oscillator[0]])
        return self.fastest(parameters) / (2.0 * np.pi)

    def stated_quantity(self, reference: Quantity) -> Quantity:
        """Return what a sensitivity is stated per: the sensor's own motion, or the drive.

        A pickup of velocity is stated per m/s, every other sensor per m/s², whatever the
        reference measured.
        """
        if reference == "drive":
            return "drive"
        return "velocity" if self.core.output == "velocity" else "acceleration"

    @property
    def is_gain_alone(self) -> bool:
        """True where the core is a gain alone: at one frequency it is what was measured there."""
        return len(self.core.parameters) == 1

    @property
    def has_gain(self) -> bool:
        """False for what free motion alone tells of a model."""
        return any(spec.kind == "gain" for spec in self.parameters)

    @property
    def gain_name(self) -> str:
        """Name of the parameter that the response is proportional to."""
        return next(spec.name for spec in self.parameters if spec.kind == "gain")

    def rational(self, parameters: Parameters, quantity: Quantity = "acceleration") -> Rational:
        """Rational part of the transfer function from the reference quantity to the response."""
        system = self.core.rational(parameters)
        for addon in self.add_ons:
            if addon.rational is not None:
                system = addon.rational(parameters, system)
        zeros = (0.0,) * DERIVATIVES[quantity]
        return Rational(system.gain, zeros + system.numerator, system.denominator, system.angular_scale)

    def poles(self, parameters: Parameters) -> Any:
        """Poles of the rational part, rad/s, complex, shape (n,)."""
        return np.roots(np.array(self.rational(parameters).denominator[::-1], dtype=float)).astype(complex)

    def delay_s(self, parameters: Parameters) -> Any:
        """Delay of the response channel behind the reference channel, s; positive: the response comes later."""
        return sum(addon.delay(parameters) for addon in self.add_ons if addon.delay is not None)

    @property
    def has_delay(self) -> bool:
        """True where the model has a delay parameter."""
        return any(addon.delay is not None for addon in self.add_ons)

    def frequency_response(self, parameters: Parameters, frequency_hz: Any, quantity: Quantity = "acceleration") -> Any:
        """Complex response per unit of the reference quantity, for e^{+jωt}; of a nonlinear model, for small signals.

        Args:
            parameters: name to value.
            frequency_hz: shape (points,).
            quantity: what the reference is.

        Returns:
            Complex array of shape (points,), response unit per SI unit of the quantity; lag has negative phase.
        """
        s = 2j * np.pi * frequency_hz
        system = self.rational(parameters, quantity)
        response = system.gain * polynomial(system.numerator, s) / polynomial(system.denominator, s)
        if not self.has_network:
            response = response * self.factors(parameters, frequency_hz)
        if self.has_delay:
            response = response * exponential(-s * self.delay_s(parameters))
        return response

    @property
    def has_network(self) -> bool:
        """True where the model is rational up to a delay, so that it has a state space."""
        return not self._factored

    @property
    def is_linear(self) -> bool:
        """True where no add-on acts back on the mass, so that there is a transfer function."""
        return all(addon.force is None for addon in self.add_ons)

    @property
    def linear(self) -> SensorModel:
        """The model without its nonlinear parts: its linearisation for small signals."""
        if self.is_linear:
            return self
        kept = tuple(addon for addon in self.add_ons if addon.force is None)
        return SensorModel("+".join([self.core.name, *(addon.name for addon in kept)]), self.core, kept)

    def factors(self, parameters: Parameters, frequency_hz: Any) -> Any:
        """Complex response of the parts that are not rational, the delay left out, shape (points,)."""
        s = 2j * np.pi * frequency_hz
        return math.prod((part.factor(parameters, s) for part in self._factored if part.factor), start=1.0)

    def factor_slopes(self, parameters: Parameters, frequency_hz: Any) -> dict[str, Any]:
        """Return the derivatives of :meth:`factors` with their parameters, by name.

        Each of shape (points,).
        """
        s = 2j * np.pi * frequency_hz
        parts = self._factored
        factors = [part.factor(parameters, s) for part in parts if part.factor is not None]
        slopes: dict[str, Any] = {}
        for index, part in enumerate(parts):
            others = math.prod(factors[:index] + factors[index + 1 :], start=1.0)
            each = part.factor_slopes(parameters, s) if part.factor_slopes else {}
            slopes |= {name: others * slope for name, slope in each.items()}
        return slopes

    def blocks(self, parameters: Parameters, quantity: Quantity) -> tuple[Rational, ...]:
        """The core and the parts parallel to it, from the reference quantity to their shares of the response."""
        core = self.core.rational(parameters)
        parts = [core, *(addon.beside(parameters, core) for addon in self.add_ons if addon.beside is not None)]
        zeros = (0.0,) * DERIVATIVES[quantity]
        return tuple(Rational(r.gain, zeros + r.numerator, r.denominator, r.angular_scale) for r in parts)

    def force(self, parameters: Parameters, response: Any) -> Any:
        """F(V) of all add-ons, in the shape of ``response``, the core's response V."""
        return sum(addon.force(parameters, response) for addon in self.add_ons if addon.force is not None)

    def derived(self, parameters: Parameters) -> tuple[Derived, ...]:
        """Derived quantities that exist for these parameters."""
        return tuple(quantity for quantity in self.core.derived if quantity.exists(parameters))


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
