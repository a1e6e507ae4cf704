"""[mounting]: what is known of how the sensor is mounted."""

from __future__ import annotations

import math
from dataclasses import fields

from vibrident.base.errors import InputError
from vibrident.data.io.keys import key
from vibrident.data.io.sections import FileSection, NotNegative, Positive, require_one
from vibrident.data.known import Mounting

#: Key of an uncertainty → key of the value that it belongs to.
_UNCERTAINTY_OF = {
    "standard_uncertainty": "frequency_hz",
    "stiffness_uncertainty": "stiffness_n_per_m",
    "mass_uncertainty": "mass_kg",
    "mass_ratio_uncertainty": "mass_ratio",
}


class MountingSection(FileSection):
    """[mounting]: a coupling between surface and sensor; taken out of the data where it is known.

    With the add-on ``mounting`` in the model it is fitted instead, and ``mass_ratio`` is all that
    is stated.
    """

    frequency_hz: Positive | None = key(
        "Mounted resonance", "Hz", about="√(k/m)/2π of the sensor as one mass on its coupling."
    )
    standard_uncertainty: NotNegative = key(
        "u of the resonance, relative", default=0.0, about="Standard uncertainty (k = 1)."
    )
    stiffness_n_per_m: Positive | None = key(
        "Stiffness of the coupling", "N/m", about="With mass_kg, in place of frequency_hz."
    )
    stiffness_uncertainty: NotNegative = key("u of the stiffness, relative", default=0.0)
    mass_kg: Positive | None = key("Mass of the sensor", "kg", about="Housing and seismic mass.")
    mass_uncertainty: NotNegative = key("u of the mass, relative", default=0.0)
    damping_ratio: NotNegative = key("Damping ratio of the coupling", default=0.0)
    damping_uncertainty: NotNegative = key("u of the damping ratio", default=0.0)
    mass_ratio: NotNegative = key(
        "Seismic mass over housing", default=0.0, about="0: the sensor is one rigid mass."
    )
    mass_ratio_uncertainty: NotNegative = key("u of the mass ratio", default=0.0)
    natural_frequency_hz: Positive | None = key(
        "Natural frequency on a fixed base", "Hz", about="Of the sensor, beside mass_ratio."
    )
    sensor_damping_ratio: NotNegative = key(
        "Damping ratio of the sensor", default=0.0, about="Beside natural_frequency_hz."
    )


def mounting_of(section: MountingSection, where: str) -> Mounting:
    """Return the mounting that a section states.

    Raises:
        InputError: it states too much or too little; ``where`` names the file.
    """
    location = f"{where}, [mounting]"
    ways = {"frequency_hz": "frequency_hz", "stiffness_n_per_m": "stiffness_n_per_m with mass_kg"}
    problem = "The frequency of the mounting is given twice."
    require_one(section, ways, problem, location, needed=False)
    if (section.stiffness_n_per_m is None) != (section.mass_kg is None):
        pair = ["mass_kg", "stiffness_n_per_m"]
        stated, missing = pair[::-1] if section.mass_kg is None else pair
        raise InputError(
            "Stiffness and mass together give the frequency of a mounting.",
            expected="stiffness_n_per_m and mass_kg",
            found=f"{stated} alone",
            where=location,
            remedy=f"add {missing}, or give frequency_hz",
        )
    for name, value_name in _UNCERTAINTY_OF.items():
        if getattr(section, name) > 0.0 and not getattr(section, value_name):
            raise InputError(
                "The uncertainty of a value that is not stated has no use.",
                expected=f"{value_name} with {name}",
                found=f"{name} alone",
                where=location,
                remedy=f"add {value_name}, or remove {name}",
            )
    values = {field.name: getattr(section, field.name) for field in fields(Mounting)}
    if section.stiffness_n_per_m is not None and section.mass_kg is not None:
        values["frequency_hz"] = math.sqrt(section.stiffness_n_per_m / section.mass_kg) / math.tau
        values["standard_uncertainty"] = 0.5 * math.hypot(
            section.stiffness_uncertainty, section.mass_uncertainty
        )
    try:
        return Mounting(**values)
    except InputError as error:
        raise error.at(location) from None
