"""Sensor models: one core a file, add-ons beside them, put together by name.

``parse("accelerometer+delay")`` gives a :class:`SensorModel`. A new core or add-on is one file and one line in the
tables below.
"""

from __future__ import annotations

from vibrident.errors import ModelError, did_you_mean
from vibrident.models.accelerometer import ACCELEROMETER
from vibrident.models.base import AddOn, Core, Derived, ParameterSpec, Rational, SensorModel
from vibrident.models.boxcar import BOXCAR
from vibrident.models.cubic import CUBIC
from vibrident.models.delay import DELAY
from vibrident.models.highpass import HIGHPASS
from vibrident.models.mode2 import MODE2
from vibrident.models.velocity_pickup import VELOCITY_PICKUP

CORES: dict[str, Core] = {core.name: core for core in (ACCELEROMETER, VELOCITY_PICKUP)}
ADD_ONS: dict[str, AddOn] = {addon.name: addon for addon in (CUBIC, MODE2, HIGHPASS, BOXCAR, DELAY)}
#: What the equation of a nonlinear add-on stands for: V is the core's own response, with nothing but a delay behind it.
_BESIDE_NONLINEAR = {"delay"}

__all__ = ["ADD_ONS", "CORES", "Derived", "ParameterSpec", "Rational", "SensorModel", "parse"]


def parse(name: str) -> SensorModel:
    """Build the model that ``name`` says: a core, then add-ons joined by "+", in any order.

    Raises:
        ModelError: the core or an add-on is unknown, an add-on is named twice, or two of them do not go together.
    """
    first, *rest = (part.strip() for part in name.split("+"))
    if first not in CORES:
        raise _unknown("sensor model", first, CORES, name)
    for index, part in enumerate(rest):
        if part not in ADD_ONS:
            raise _unknown("add-on", part, ADD_ONS, name)
        if part in rest[:index]:
            raise ModelError(
                f"The add-on {part!r} is named twice.",
                expected="each add-on at most once",
                found=repr(name),
                where="model",
                remedy=f"leave one {part!r} out",
            )
    ordered = [addon for addon in ADD_ONS if addon in rest]
    model = SensorModel("+".join([first, *ordered]), CORES[first], tuple(ADD_ONS[part] for part in ordered))
    if not model.is_linear:
        _check_nonlinear(model)
    return model


def _check_nonlinear(model: SensorModel) -> None:
    nonlinear = [addon.name for addon in model.add_ons if addon.force is not None]
    others = [addon.name for addon in model.add_ons if addon.force is None and addon.name not in _BESIDE_NONLINEAR]
    if model.core is not ACCELEROMETER or others:
        raise ModelError(
            f"The add-on {nonlinear[0]!r} does not go with this model.",
            expected=f"'accelerometer+{nonlinear[0]}', with or without '+delay'",
            found=repr(model.name),
            where="model",
            remedy=f"leave out {', '.join(repr(o) for o in others) or repr(nonlinear[0])}",
        )


def _unknown(kind: str, part: str, table: dict[str, Core] | dict[str, AddOn], name: str) -> ModelError:
    return ModelError(
        f"The {kind} {part!r} is not known.",
        expected=" | ".join(table),
        found=repr(name),
        where="model",
        remedy=did_you_mean(part, table, f"choose a {kind} from the list"),
    )
