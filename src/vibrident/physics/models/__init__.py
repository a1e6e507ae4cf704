"""Sensor models: one core a file, add-ons beside them, put together by name.

``parse("accelerometer+delay")`` gives a :class:`SensorModel`. A new core or add-on is one file in ``cores/`` or
``add_ons/``, or an entry point of the group ``vibrident.models``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

from vibrident.base.errors import ModelError, did_you_mean
from vibrident.data.records import Calibration
from vibrident.physics.models.base import AddOn, Core, Derived, ParameterSpec, Rational, SensorModel
from vibrident.physics.registry import MODELS

__all__ = [
    "ADD_ONS",
    "CORES",
    "AddOn",
    "Core",
    "Derived",
    "ParameterSpec",
    "Rational",
    "SensorModel",
    "installed",
    "model_of",
    "parse",
]

_Part = TypeVar("_Part", Core, AddOn)


class _Parts(Mapping[str, _Part]):
    """Name → every core, or every add-on in the order of their places; those of plug-ins too."""

    def __init__(self, kind: type[_Part]) -> None:
        self._kind = kind

    def _all(self) -> dict[str, _Part]:
        found = [part for part in MODELS.all().values() if isinstance(part, self._kind)]
        if self._kind is AddOn:
            found.sort(key=_in_chain)
        return {part.name: part for part in found}

    def __getitem__(self, name: str) -> _Part:
        return self._all()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())


CORES: Mapping[str, Core] = _Parts(Core)
ADD_ONS: Mapping[str, AddOn] = _Parts(AddOn)


def _in_chain(addon: Any) -> tuple[int, str]:
    return addon.place, addon.name


def parse(name: str) -> SensorModel:
    """Build the model that ``name`` says: a core, then add-ons joined by "+", in any order.

    Raises:
        ModelError: the core or an add-on is unknown, an add-on is named twice, or two of them cannot be combined.
    """
    first, *rest = (part.strip() for part in name.split("+"))
    core = MODELS.find(first)
    if not isinstance(core, Core):
        raise _unknown("sensor model", first, CORES, name)
    add_ons: list[AddOn] = []
    for part in rest:
        addon = MODELS.find(part)
        if not isinstance(addon, AddOn):
            raise _unknown("add-on", part, ADD_ONS, name)
        if addon in add_ons:
            raise ModelError(
                f"The add-on {part!r} is named twice.",
                expected="each add-on at most once",
                found=repr(name),
                where="model",
                remedy=f"leave one {part!r} out",
            )
        add_ons.append(addon)
    add_ons.sort(key=_in_chain)
    model = SensorModel("+".join([core.name, *(addon.name for addon in add_ons)]), core, tuple(add_ons))
    _check_names(model)
    if not model.is_linear:
        _check_nonlinear(model)
    return model


def model_of(calibration: Calibration, name: str | None = None) -> SensorModel:
    """The model that ``name`` says; without one that of the calibration.

    Raises:
        ModelError: as :func:`parse`; it names the calibration file where the name stands there.
    """
    if name is not None:
        return parse(name)
    try:
        return parse(calibration.model)
    except ModelError as error:
        raise (error.at(f"{calibration.source}, [sensor] model") if calibration.source else error) from None


def installed(name: str) -> SensorModel | None:
    """The model of this name; None if a part of it is not installed, or two parts cannot be combined."""
    try:
        return parse(name)
    except ModelError:
        return None


def _check_names(model: SensorModel) -> None:
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


def _check_nonlinear(model: SensorModel) -> None:
    """Check that the equation of a nonlinear add-on holds: V is the core's response, with at most a delay in series."""
    nonlinear = [addon.name for addon in model.add_ons if addon.force is not None]
    others = [addon.name for addon in model.add_ons if addon.force is None and not addon.is_delay]
    if model.core.output != "displacement" or others:
        fitting = next(core.name for core in CORES.values() if core.output == "displacement")
        raise ModelError(
            f"The add-on {nonlinear[0]!r} cannot be combined with this model.",
            expected=f"'{fitting}+{nonlinear[0]}', with or without a delay",
            found=repr(model.name),
            where="model",
            remedy=f"leave out {', '.join(repr(o) for o in others) or repr(nonlinear[0])}",
        )


def _unknown(kind: str, part: str, table: Mapping[str, Core] | Mapping[str, AddOn], name: str) -> ModelError:
    return ModelError(
        f"The {kind} {part!r} is not known.",
        expected=" | ".join(table),
        found=repr(name),
        where="model",
        remedy=did_you_mean(part, table),
    )
