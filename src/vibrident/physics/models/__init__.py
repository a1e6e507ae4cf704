"""Sensor models: one core a file, add-ons beside them, put together by name.

``parse("accelerometer+delay")`` gives a :class:`SensorModel`. A new core (:class:`Model`) or add-on
is one file in ``cores/`` or ``add_ons/``, or an entry point of the group ``vibrident.models``. A
core may also be given to ``identify``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

from vibrident.base.errors import ModelError, did_you_mean
from vibrident.data.records import Calibration
from vibrident.physics.models.base import AddOn, Derived, ParameterSpec, Rational
from vibrident.physics.models.model import Model
from vibrident.physics.models.sensor_model import SensorModel
from vibrident.physics.registry import MODELS

__all__ = [
    "ADD_ONS",
    "CORES",
    "AddOn",
    "Derived",
    "GivenModel",
    "Model",
    "ParameterSpec",
    "Rational",
    "SensorModel",
    "installed",
    "model_of",
    "named",
    "parse",
    "parse_model",
    "with_add_ons",
    "with_number_moved",
]

GivenModel = str | Model | SensorModel  # a model by its name, or as an object
_Element = TypeVar("_Element", Model, AddOn)


class _Elements(Mapping[str, _Element]):
    """Mapping of name → core, or add-on in the order of their places; those of plug-ins too."""

    def __init__(self, kind: type[_Element]) -> None:
        self._kind = kind

    def _all(self) -> dict[str, _Element]:
        elements = [element for element in MODELS.all().values() if isinstance(element, self._kind)]
        if self._kind is AddOn:
            elements.sort(key=_chain_order)
        return {element.name: element for element in elements}

    def __getitem__(self, name: str) -> _Element:
        return self._all()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())


CORES: Mapping[str, Model] = _Elements(Model)
ADD_ONS: Mapping[str, AddOn] = _Elements(AddOn)


def _chain_order(addon: Any) -> tuple[int, str]:
    """Return the sort key of an add-on: its place, then its name."""
    return addon.place, addon.name


def parse_model(name: str) -> SensorModel:
    """Build the model that ``name`` says: a core, then add-ons joined by "+", in any order.

    Raises:
        ModelError: the core or an add-on is unknown, an add-on is named twice, or two of them
            cannot be combined.

    Examples:
        >>> import numpy as np
        >>> import vibrident
        >>> model = vibrident.parse_model("accelerometer+delay")
        >>> model.parameter_names
        ('sensitivity', 'natural_frequency', 'damping_ratio', 'delay')
        >>> values = dict(zip(model.parameter_names, (0.1, 650.0, 0.18, 1e-5)))
        >>> abs(model.frequency_response(values, np.array([65.0]))).round(4).tolist()
        [0.1009]
    """
    core_name, _, add_on_names = name.partition("+")
    core = MODELS.find(core_name.strip())
    if not isinstance(core, Model):
        raise _unknown("sensor model", core_name.strip(), CORES, name)
    return with_add_ons(core, add_on_names) if "+" in name else SensorModel(core.name, core)


parse = parse_model  # within the package


def with_add_ons(core: Model, names: str) -> SensorModel:
    """Build a model with add-ons, their names joined by "+", in any order.

    Raises:
        ModelError: as :func:`parse`.
    """
    add_ons: list[AddOn] = []
    name = f"{core.name}+{names}"
    for addon_name in (addon_name.strip() for addon_name in names.split("+")):
        addon = _add_on(addon_name, core, name)
        if addon in add_ons:
            raise ModelError(
                f"The add-on {addon_name!r} is named twice.",
                expected="each add-on at most once",
                found=repr(name),
                where="model",
                remedy=f"leave one {addon_name!r} out",
            )
        add_ons.append(addon)
    add_ons.sort(key=_chain_order)
    model = SensorModel(
        "+".join([core.name, *(addon.name for addon in add_ons)]), core, tuple(add_ons)
    )
    _check_names(model)
    _check_parallel(model)
    if not model.is_linear:
        _check_nonlinear(model)
    return model


def _add_on(addon_name: str, core: Model, name: str) -> AddOn:
    """Return the add-on of a part of a model's name: ``delay``, or ``mounting:0.2``.

    Raises:
        ModelError: it is unknown, or takes no number, or not this one.
    """
    word, colon, number = addon_name.partition(":")
    addon = MODELS.find(word)
    if not isinstance(addon, AddOn):
        raise _unknown("add-on", word, ADD_ONS, name)
    if not colon:
        return addon
    try:
        value = float(number)
    except ValueError:
        value = None
    if value is None or addon.with_number is None:
        takers = [each.name for each in ADD_ONS.values() if each.with_number is not None]
        raise ModelError(
            f"The add-on {word!r} cannot be read.",
            expected=f"a number behind the colon, of {' or '.join(takers)} alone",
            found=repr(name),
            where="model",
            remedy=f"write {word!r} without the colon, or a number behind it",
        )
    return addon if value == 0.0 else addon.with_number(value, core)


def _require_reference(model: SensorModel, calibration: Calibration) -> None:
    """Check that a model stands behind what the reference measures, in the unit that it needs.

    Raises:
        ModelError: a sensor of motion stands behind a force, a structure behind none, or its
            response is in another unit.
    """
    if calibration.table is None and all(
        record.reference is None for record in calibration.records
    ):
        return  # free decays
    core = model.core
    by_force = calibration.quantity == "force"
    on_mounting = by_force and any(addon.before_sensor for addon in model.add_ons)
    if on_mounting or (core.behind != "any" and (core.behind == "force") != by_force):
        fitting = [each.name for each in CORES.values() if each.behind != "motion"]
        raise ModelError(
            "This model does not stand behind a force."
            if by_force
            else "This model stands behind a force.",
            expected=f"{' | '.join(fitting)}, without a mounting"
            if by_force
            else '[reference] quantity = "force", in N',
            found=f"{model.name!r} with quantity = {calibration.quantity!r}",
            where=calibration.source or "model",
            remedy="choose a model of these, or correct the quantity of the reference",
        )
    needed = core.response_unit
    if needed and not _is_same_unit(calibration.response_unit, needed):
        raise ModelError(
            f"The response is not in the unit of {core.name}.",
            expected=f'[response] unit = "{needed}"',
            found=f'unit = "{calibration.response_unit}"',
            where=calibration.source or "model",
            remedy=f'state unit = "{needed}" with scale = {needed} per unit of the file, '
            "or a known_response of the sensor",
        )


def _is_same_unit(unit: str, needed: str) -> bool:
    """Return whether two texts name one unit: "m/s²" and "m/s^2"."""
    from vibrident.data.io.units import factor_between  # loads the readers

    return unit == needed or factor_between(unit, needed) == 1.0


def with_number_moved(model: SensorModel, step: float) -> SensorModel:
    """Return a model whose add-on with a number in its name, if there is one, has another one."""
    pieces = [addon.name.partition(":") for addon in model.add_ons]
    names = [
        f"{word}:{float(number) + step!r}" if colon else word for word, colon, number in pieces
    ]
    return with_add_ons(model.core, "+".join(names)) if names else model


def named(model: GivenModel | None) -> str | None:
    """Return the name of a model; one made in Python is known by it in this process from now on.

    Raises:
        ModelError: it is no model, or its name is that of an installed one.
    """
    if model is None or isinstance(model, str):
        return model
    core = model.core if isinstance(model, SensorModel) else model
    if not isinstance(core, Model):
        raise ModelError(
            "This is no sensor model.",
            expected="a name, such as 'accelerometer+delay', or a vibrident.Model",
            found=f"one of {type(core).__qualname__}",
            where="model",
            remedy="give a name or a Model",
        )
    MODELS.give(core)
    return model.name


def model_of(calibration: Calibration, name: str | None = None) -> SensorModel:
    """Return the model of a name, or without one that of the calibration.

    Raises:
        ModelError: as :func:`parse`; it names the calibration file where the name stands there.
    """
    if name is not None:
        return _as_mounted(parse(name), calibration)
    try:
        return _as_mounted(parse(calibration.model), calibration)
    except ModelError as error:
        raise (
            error.at(f"{calibration.source}, [sensor] model") if calibration.source else error
        ) from None


def _as_mounted(model: SensorModel, calibration: Calibration) -> SensorModel:
    """Return a model with the mass ratio that the calibration states of a mounting to be fitted.

    Raises:
        ModelError: the mounting is known and fitted, or neither.
    """
    _require_reference(model, calibration)
    mounting = calibration.mounting
    fitted = next((addon for addon in model.add_ons if addon.before_sensor), None)
    if mounting is None or (mounting.is_known and fitted is None):
        return model
    if mounting.is_known or fitted is None:
        raise ModelError(
            "The mounting is both known and fitted."
            if mounting.is_known
            else "The mounting is neither known nor fitted.",
            expected="its frequency in the calibration, or the add-on 'mounting' in the model",
            found=f"{model.name!r}, and a frequency of the mounting"
            if mounting.is_known
            else f"{model.name!r}, and the mass ratio alone",
            where="model",
            remedy="leave one of the two out"
            if mounting.is_known
            else f"use {model.name + '+mounting'!r}, or state frequency_hz under [mounting]",
        )
    if fitted.with_number is None:  # the model has its own number
        return model
    numbered = f"{fitted.name}:{float(mounting.mass_ratio)!r}"
    names = [numbered if addon is fitted else addon.name for addon in model.add_ons]
    return with_add_ons(model.core, "+".join(names))


def installed(name: str) -> SensorModel | None:
    """Return the model of this name, or None if it cannot be built.

    A part of it is not installed, or two parts cannot be combined.
    """
    try:
        return parse(name)
    except ModelError:
        return None


def _check_names(model: SensorModel) -> None:
    """Check that no two parameters have the same name."""
    names = model.parameter_names
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ModelError(
            "Two parts of the model have a parameter of the same name.",
            expected="parts with parameters of their own",
            found=f"{', '.join(twice)} twice in {model.name!r}",
            where="model",
            remedy="leave one of the parts out",
        )


def _check_parallel(model: SensorModel) -> None:
    """Check that nothing stands parallel to a core whose own mass acts back on its mounting."""
    alone = [addon.name for addon in model.add_ons if addon.moves_poles]
    parallel = [addon.name for addon in model.add_ons if not addon.in_series]
    if alone and parallel:
        raise ModelError(
            f"The add-on {parallel[0]!r} cannot be combined with {alone[0]!r}.",
            expected="a sensor of one mode on a mounting with a mass ratio",
            found=repr(model.name),
            where="model",
            remedy=f"leave out {parallel[0]!r}, or the mass ratio",
        )


def _check_nonlinear(model: SensorModel) -> None:
    """Check that the equation of a nonlinear add-on holds.

    V is the core's response, with at most a delay in series.
    """
    nonlinear = [addon.name for addon in model.add_ons if addon.force is not None]
    unfit = [addon.name for addon in model.add_ons if addon.force is None and not addon.is_delay]
    if model.core.output != "displacement" or unfit:
        fitting = next(core.name for core in CORES.values() if core.output == "displacement")
        raise ModelError(
            f"The add-on {nonlinear[0]!r} cannot be combined with this model.",
            expected=f"'{fitting}+{nonlinear[0]}', with or without a delay",
            found=repr(model.name),
            where="model",
            remedy=f"leave out {', '.join(repr(addon) for addon in unfit) or repr(nonlinear[0])}",
        )


def _unknown(
    kind: str, element: str, table: Mapping[str, Model] | Mapping[str, AddOn], name: str
) -> ModelError:
    return ModelError(
        f"The {kind} {element!r} is not known.",
        expected=" | ".join(table),
        found=repr(name),
        where="model",
        remedy=did_you_mean(element, table),
    )
