"""The sensitivity of an identified sensor on another mounting.

The mounting frequency is √(k/m)/2π of the coupling's stiffness k and the sensor's whole mass m, its
damping ratio c/(2 √(k m)): another stiffness or mass changes both, while the dashpot c stays. A
mass that is added belongs to the housing, so that it lowers the mass ratio, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.brief import brief
from vibrident.base.errors import InputError
from vibrident.base.memory import in_one_thread
from vibrident.data.known.mounting import require_usable
from vibrident.data.records import FloatArray, Quantity, is_motion
from vibrident.physics.models import ADD_ONS, AddOn, with_add_ons
from vibrident.physics.simulation import one_third_octave
from vibrident.result import Curve
from vibrident.result.loading import GivenResult, as_result
from vibrident.result.sensor import IdentifiedSensor

WHERE = "another mounting"  # for errors
CURVE_POINTS = 500  # of a line in a picture


@dataclass(frozen=True, eq=False)
class MountedSensor:
    """Sensitivity of a sensor as it was identified, and on another mounting."""

    identified_sensor: IdentifiedSensor  # as the result states it
    sensor: IdentifiedSensor  # on the other mounting
    quantity: Quantity  # what both curves are per
    frequency_hz: FloatArray  # of both curves, shape (points,)

    __repr__ = brief

    @property
    def identified(self) -> Curve:
        """Return the sensitivity as it was identified."""
        return _curve(self.identified_sensor, self.quantity, self.frequency_hz)

    @property
    def predicted(self) -> Curve:
        """Return the sensitivity on the other mounting."""
        return _curve(self.sensor, self.quantity, self.frequency_hz)

    @property
    def fine(self) -> MountedSensor:
        """Return the same over the same band, at frequencies close enough for a line."""
        low = float(self.frequency_hz.min())
        high = float(self.frequency_hz.max())
        at_hz = np.geomspace(low, high, CURVE_POINTS) if high > low else self.frequency_hz
        return replace(self, frequency_hz=at_hz)

    @property
    def mounting(self) -> tuple[float, float]:
        """Return frequency, Hz, and damping ratio of the other mounting."""
        frequency, damping = (self.sensor.values[name] for name in _mounting_parameter_names())
        return frequency, damping

    @property
    def change(self) -> FloatArray:
        """Return by how much the magnitude differs, relative to that identified, (points,)."""
        return np.asarray(self.predicted.magnitude / self.identified.magnitude - 1.0)


@in_one_thread
def predict_mounted(
    result: GivenResult,
    *,
    stiffness: float = 1.0,
    mass: float = 1.0,
    frequency_hz: float | None = None,
    standard_uncertainty: float = 0.0,
    damping: float | None = None,
    frequencies_hz: Sequence[float] | FloatArray | None = None,
) -> MountedSensor:
    """Predict the sensitivity of a sensor with another coupling stiffness, or another mass.

    Args:
        result: of an identification with ``+mounting``; of any other sensor with
            ``frequency_hz``, as its result is that on a rigid mounting.
        stiffness: of the coupling, as a multiple of the present one.
        mass: of the sensor with what is fixed to it, as a multiple of the present one.
        frequency_hz: mounting frequency in place of the identified one; ``stiffness`` and ``mass``
            change it.
        standard_uncertainty: of ``frequency_hz``, relative.
        damping: damping ratio beside ``frequency_hz``; None: the identified one, or 0.
        frequencies_hz: of the curves, shape (points,); None: one-third octaves of the result's
            band.

    Raises:
        InputError: a number cannot be used, or the result has no mounting and none is stated.

    Examples:
        >>> import vibrident
        >>> calibration = vibrident.simulate(
        ...     "piezo", frequencies_hz=[1e3, 5e3, 10e3, 20e3], samples=4000, response_noise=1e-3
        ... )
        >>> sensor = vibrident.identify(calibration)
        >>> mounted = vibrident.predict_mounted(sensor, frequency_hz=30e3, frequencies_hz=[10e3])
        >>> mounted.change.round(3).tolist()  # 1/(1 - (10/30)²) - 1
        [0.125]
    """
    result = as_result(result)
    sensor = result.to_sensor("a mounting")
    if not is_motion(sensor.quantity):
        raise _refused(
            "A mounting carries a sensor of motion.",
            "a result per acceleration, velocity or displacement",
            f"a response per {sensor.quantity}",
            "give the result of a sensor",
        )
    inputs = {
        "stiffness": stiffness,
        "mass": mass,
        "frequency_hz": frequency_hz,
        "standard_uncertainty": standard_uncertainty,
        "damping": damping,
    }
    require_usable(inputs, ("stiffness", "mass", "frequency_hz"), WHERE)
    mounted = sensor
    if frequency_hz is not None:
        mounted = _remount(sensor, frequency_hz, standard_uncertainty, damping)
    elif _mounting_parameter_names()[0] not in sensor.values:
        raise _refused(
            "The result has no mounting.",
            f"a result with '+{_mounting().name}', or the frequency of the mounting",
            f"model {sensor.model.name!r}",
            "state the frequency of the mounting, √(k/m)/2π, by ⟦plan.frequency_hz⟧",
        )
    mounted = _scale_coupling(mounted, stiffness, mass)
    if frequencies_hz is None:
        low, high = sensor.band_hz or (10.0, 10e3)
        frequencies_hz = one_third_octave(low, high)
    at_hz = np.atleast_1d(np.asarray(frequencies_hz, dtype=float))
    quantity = sensor.model.stated_quantity(sensor.quantity)
    return MountedSensor(sensor, mounted, quantity, at_hz)


def mounted_document(mounted: MountedSensor) -> dict[str, FloatArray]:
    """Return both curves as columns, shapes (points,)."""
    identified = mounted.identified
    predicted = mounted.predicted
    return {
        "frequency_hz": predicted.frequency_hz,
        "magnitude_identified": identified.magnitude,
        "magnitude_identified_uncertainty": identified.magnitude_uncertainty,
        "magnitude": predicted.magnitude,
        "magnitude_uncertainty": predicted.magnitude_uncertainty,
        "phase_deg": predicted.phase_deg,
        "phase_deg_uncertainty": predicted.phase_deg_uncertainty,
        "change_percent": 100.0 * mounted.change,
    }


def _mounting() -> AddOn:
    """Return the add-on that a sensor stands on."""
    return next(addon for addon in ADD_ONS.values() if addon.before_sensor and addon.oscillator)


def _mounting_parameter_names() -> tuple[str, str]:
    """Return the names of the mounting's frequency and damping ratio."""
    oscillator = _mounting().oscillator
    assert oscillator is not None
    return oscillator


def _remount(
    sensor: IdentifiedSensor, frequency_hz: float, relative_u: float, damping: float | None
) -> IdentifiedSensor:
    """Return a sensor on a mounting of a stated frequency."""
    model = sensor.model
    values = dict(sensor.values)
    frequency_name, damping_name = _mounting_parameter_names()
    if frequency_name not in values:
        names = [*(addon.name for addon in model.add_ons), _mounting().name]
        model = with_add_ons(model.core, "+".join(names))
    damping_ratio = values.get(damping_name, 0.0) if damping is None else damping
    of_mounting = {
        frequency_name: (frequency_hz, relative_u * frequency_hz),
        damping_name: (damping_ratio, 0.0),
    }
    values |= {name: value for name, (value, _) in of_mounting.items()}
    covariance = np.zeros((len(model.parameter_names),) * 2)
    present = [name for name in sensor.model.parameter_names if name not in of_mounting]
    rows = [model.parameter_names.index(name) for name in present]
    before = [sensor.model.parameter_names.index(name) for name in present]
    covariance[np.ix_(rows, rows)] = sensor.covariance[np.ix_(before, before)]
    for name, (_, u) in of_mounting.items():
        index = model.parameter_names.index(name)
        covariance[index, index] = u**2
    ordered = {name: values[name] for name in model.parameter_names}
    return replace(sensor, model=model, values=ordered, covariance=covariance)


def _scale_coupling(sensor: IdentifiedSensor, stiffness: float, mass: float) -> IdentifiedSensor:
    """Return a mounted sensor with multiples of the coupling's stiffness and of the mass."""
    frequency_name, damping_name = _mounting_parameter_names()
    factors = {
        frequency_name: (stiffness / mass) ** 0.5,
        damping_name: (stiffness * mass) ** -0.5,
    }
    values = {name: value * factors.get(name, 1.0) for name, value in sensor.values.items()}
    scale = np.array([factors.get(name, 1.0) for name in sensor.model.parameter_names])
    covariance = sensor.covariance * np.outer(scale, scale)
    names = []
    for addon in sensor.model.add_ons:
        word, colon, number = addon.name.partition(":")
        names.append(f"{word}:{_mass_ratio(float(number), mass)!r}" if colon else addon.name)
    model = with_add_ons(sensor.model.core, "+".join(names))
    return replace(sensor, model=model, values=values, covariance=covariance)


def _mass_ratio(ratio: float, mass: float) -> float:
    """Return seismic mass over housing where the whole mass is a multiple of the present one."""
    if mass == 1.0:
        return ratio
    seismic = ratio / (1.0 + ratio)  # of the present mass
    if mass <= seismic:
        raise _refused(
            "The sensor cannot be lighter than its seismic mass.",
            f"mass above {seismic:.3g} of the present one",
            f"mass = {mass:g}",
            "state a larger mass",
        )
    return float(f"{seismic / (mass - seismic):.12g}")


def _curve(sensor: IdentifiedSensor, quantity: Quantity, frequency_hz: FloatArray) -> Curve:
    response = sensor.frequency_response(frequency_hz, quantity)
    relative, phase_rad = sensor.uncertainty(frequency_hz, quantity)
    size = np.abs(response)
    return Curve(
        frequency_hz,
        size,
        np.rad2deg(np.angle(response)),
        relative * size,
        np.rad2deg(phase_rad),
    )


def _refused(problem: str, expected: str, value: str, remedy: str) -> InputError:
    return InputError(problem, expected=expected, found=value, where=WHERE, remedy=remedy)
