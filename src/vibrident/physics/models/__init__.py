"""Build sensor models by name: a core and its add-ons.

``parse("accelerometer+delay")`` returns a :class:`SensorModel`. Each core (:class:`Model`) and
add-on is one file in ``cores/`` or ``add_ons/``, or an entry point of the group
``vibrident.models``. ``identify`` also takes a core as an object.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
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
    """Mapping of name → element of one kind, plug-ins included, in the given order."""

    def __init__(self, kind: type[_Element], key: Callable[[Any], Any] | None = None) -> None:
        self._kind = kind
        self._key = key

    def _all(self) -> dict[str, _Element]:
        elements = [element for element in MODELS.all().values() if isinstance(element, self._kind)]
        if self._key is not None:
            elements.sort(key=self._key)
        return {element.name: element for element in elements}

    def __getitem__(self, name: str) -> _Element:
        return self._all()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())


def _chain_order(addon: AddOn) -> tuple[int, str]:
    """Return the sort key of an add-on: its place in the chain, then its name."""
    return addon.place, addon.name


CORES: Mapping[str, Model] = _Elements(Model)
ADD_ONS: Mapping[str, AddOn] = _Elements(AddOn, _chain_order)


def parse_model(name: str) -> SensorModel:
    """Build the model of a name: a core, then add-ons joined by "+", in any order.

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
        raise _unknown_element("sensor model", core_name.strip(), CORES, name)
    return with_add_ons(core, add_on_names) if "+" in name else SensorModel(core.name, core)


parse = parse_model  # within the package


def with_add_ons(core: Model, names: str) -> SensorModel:
    """Build a model with add-ons, their names joined by "+", in any order.

    Raises:
        ModelError: as :func:`parse`.
    """
    add_ons: list[AddOn] = []
    stated_name = f"{core.name}+{names}"
    for addon_name in map(str.strip, names.split("+")):
        addon = _add_on(addon_name, core, stated_name)
        if addon in add_ons:
            raise ModelError(
                f"The add-on {addon_name!r} is named twice.",
                expected="each add-on at most once",
                found=repr(stated_name),
                where="⟦identify.model⟧",
                remedy=f"leave one {addon_name!r} out",
            )
        add_ons.append(addon)
    add_ons.sort(key=_chain_order)
    name = "+".join([core.name, *(addon.name for addon in add_ons)])
    model = SensorModel(name, core, tuple(add_ons))
    _check_names(model)
    _check_parallel(model)
    if not model.is_linear:
        _check_nonlinear(model)
    return model


def _add_on(addon_name: str, core: Model, model_name: str) -> AddOn:
    """Return the add-on of its name in a model's: ``delay``, or ``mounting:0.2``.

    Raises:
        ModelError: it is unknown, takes no number, or its number cannot be used.
    """
    kind, colon, number = addon_name.partition(":")
    addon = MODELS.find(kind)
    if not isinstance(addon, AddOn):
        raise _unknown_element("add-on", kind, ADD_ONS, model_name)
    if not colon:
        return addon
    try:
        value = float(number)
    except ValueError:
        value = None
    if value is None or addon.with_number is None:
        with_number = [add_on.name for add_on in ADD_ONS.values() if add_on.with_number is not None]
        raise ModelError(
            f"The add-on {kind!r} cannot be read.",
            expected=f"a number behind the colon, of {' or '.join(with_number)} alone",
            found=repr(model_name),
            where="⟦identify.model⟧",
            remedy=f"write {kind!r} without the colon, or a number behind it",
        )
    return addon if value == 0.0 else addon.with_number(value, core)


def _require_reference(model: SensorModel, calibration: Calibration) -> None:
    """Check that a model suits the quantity of the reference and the unit of the response.

    Raises:
        ModelError: the model is of a sensor of motion and the reference a force, or the reverse;
            or the response is in another unit.
    """
    has_reference = any(record.reference is not None for record in calibration.records)
    if calibration.table is None and not has_reference:
        return  # free decays
    core = model.core
    where = calibration.source or "model"
    remedy = "choose a model of these, or correct the quantity of the reference"
    observation = f"{model.name!r} with quantity = {calibration.quantity!r}"
    if calibration.quantity == "force":
        if core.behind == "motion" or any(addon.before_sensor for addon in model.add_ons):
            fitting = [
                candidate.name for candidate in CORES.values() if candidate.behind != "motion"
            ]
            raise ModelError(
                "The model needs a motion as its reference.",
                expected=f"{' | '.join(fitting)}, without a mounting",
                found=observation,
                where=where,
                remedy=remedy,
            )
    elif core.behind == "force":
        raise ModelError(
            "The model needs a force as its reference.",
            expected='[reference] quantity = "force", in N',
            found=observation,
            where=where,
            remedy=remedy,
        )
    needed = core.response_unit
    if needed and not _is_same_unit(calibration.response_unit, needed):
        raise ModelError(
            f"The response is not in the unit of {core.name}.",
            expected=f'[response] unit = "{needed}"',
            found=f'unit = "{calibration.response_unit}"',
            where=where,
            remedy=f'state unit = "{needed}" with scale = {needed} per unit of the file, '
            "or a known_response of the sensor",
        )


def _is_same_unit(unit: str, needed: str) -> bool:
    """Return whether two texts name one unit: "m/s²" and "m/s^2"."""
    from vibrident.data.io.units import factor_between  # loads the readers

    return unit == needed or factor_between(unit, needed) == 1.0


def with_number_moved(model: SensorModel, step: float) -> SensorModel:
    """Return a model with ``step`` added to the numbers in the names of its add-ons."""
    names = []
    for addon in model.add_ons:
        kind, colon, number = addon.name.partition(":")
        names.append(f"{kind}:{float(number) + step!r}" if colon else kind)
    return with_add_ons(model.core, "+".join(names)) if names else model


def named(model: GivenModel | None) -> str | None:
    """Return the name of a model, and register a model given as an object under its name.

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
            where="⟦identify.model⟧",
            remedy="give a name or a Model",
        )
    MODELS.register(core)
    return model.name


def model_of(calibration: Calibration, name: str | None = None) -> SensorModel:
    """Return the model of a name, or without one that of the calibration.

    Raises:
        ModelError: as :func:`parse`, or the model does not suit the calibration; it names the
            calibration file where that states the model.
    """
    try:
        return _as_mounted(parse(calibration.model if name is None else name), calibration)
    except ModelError as error:
        if name is None and calibration.source:
            raise error.at(f"{calibration.source}, [sensor] model") from None
        raise


def _as_mounted(model: SensorModel, calibration: Calibration) -> SensorModel:
    """Return the model whose mounting has the mass ratio that the calibration states.

    Raises:
        ModelError: the mounting is both known and fitted, or neither.
    """
    _require_reference(model, calibration)
    mounting = calibration.mounting
    fitted = next((addon for addon in model.add_ons if addon.before_sensor), None)
    if mounting is None or (mounting.is_known and fitted is None):
        return model
    expected = "its frequency in the calibration, or the add-on 'mounting' in the model"
    if mounting.is_known:
        raise ModelError(
            "The mounting is both known and fitted.",
            expected=expected,
            found=f"{model.name!r}, and a frequency of the mounting",
            where="⟦identify.model⟧",
            remedy="leave one of the two out",
        )
    if fitted is None:
        raise ModelError(
            "The mounting is neither known nor fitted.",
            expected=expected,
            found=f"{model.name!r}, and the mass ratio alone",
            where="⟦identify.model⟧",
            remedy=f"use {model.name + '+mounting'!r}, or state frequency_hz under [mounting]",
        )
    if fitted.with_number is None:  # the model states its mass ratio
        return model
    numbered = f"{fitted.name}:{float(mounting.mass_ratio)!r}"
    names = [numbered if addon is fitted else addon.name for addon in model.add_ons]
    return with_add_ons(model.core, "+".join(names))


def installed(name: str) -> SensorModel | None:
    """Return the model of this name.

    None if a part is not installed, or if two parts cannot be combined.
    """
    try:
        return parse(name)
    except ModelError:
        return None


def _check_names(model: SensorModel) -> None:
    """Check that no two parameters have the same name."""
    names = model.parameter_names
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise ModelError(
            "Two parts of the model have a parameter of the same name.",
            expected="parts with parameters of their own",
            found=f"{', '.join(repeated)} twice in {model.name!r}",
            where="⟦identify.model⟧",
            remedy="leave one of the parts out",
        )


def _check_parallel(model: SensorModel) -> None:
    """Check that nothing is parallel to a core whose seismic mass acts back on its mounting."""
    alone = [addon.name for addon in model.add_ons if addon.moves_poles]
    parallel = [addon.name for addon in model.add_ons if not addon.in_series]
    if alone and parallel:
        raise ModelError(
            f"The add-on {parallel[0]!r} cannot be combined with {alone[0]!r}.",
            expected="a sensor of one mode on a mounting with a mass ratio",
            found=repr(model.name),
            where="⟦identify.model⟧",
            remedy=f"leave out {parallel[0]!r}, or the mass ratio",
        )


def _check_nonlinear(model: SensorModel) -> None:
    """Check that a nonlinear add-on has a second-order core, and at most a delay beside it."""
    nonlinear = [addon.name for addon in model.add_ons if addon.force is not None]
    unfit = [addon.name for addon in model.add_ons if addon.force is None and not addon.is_delay]
    if model.core.output != "displacement" or unfit:
        fitting = next(core.name for core in CORES.values() if core.output == "displacement")
        raise ModelError(
            f"The add-on {nonlinear[0]!r} cannot be combined with this model.",
            expected=f"'{fitting}+{nonlinear[0]}', with or without a delay",
            found=repr(model.name),
            where="⟦identify.model⟧",
            remedy=f"leave out {', '.join(repr(addon) for addon in unfit) or repr(nonlinear[0])}",
        )


def _unknown_element(
    kind: str, element: str, table: Mapping[str, Model] | Mapping[str, AddOn], name: str
) -> ModelError:
    return ModelError(
        f"The {kind} {element!r} is not known.",
        expected=" | ".join(table),
        found=repr(name),
        where="⟦identify.model⟧",
        remedy=did_you_mean(element, table),
    )
