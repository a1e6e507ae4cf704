"""From names and settings, as a user gives them, to an estimator."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from vibrident.base.errors import InputError, unknown
from vibrident.fit.registry import AUTO, ESTIMATORS

if TYPE_CHECKING:
    from vibrident.fit.estimators import Estimator

# What there is to choose from, as names; nothing is loaded.
DISCRETISATIONS = ("euler", "zoh", "foh", "tustin", "bandlimited")
UNCERTAINTIES = ("auto", "noise", "inflated")


def estimator_names() -> tuple[str, ...]:
    """Return the names of estimators, the choice by the data first; nothing is loaded."""
    return (AUTO, *ESTIMATORS.names())


def estimators_with(setting: str, names: Iterable[str] | None = None) -> tuple[str, ...]:
    """Return the names of the estimators that have a setting; ``names``: those to ask, None for all."""
    asked = ESTIMATORS if names is None else names
    return tuple(name for name in asked if setting in ESTIMATORS[name].settings)


def _given(settings: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in settings.items() if value is not None}


def checked(name: str, settings: Mapping[str, Any], *, weights: bool = False) -> None:
    """Refuse settings that do not fit the estimator, and ``weights`` of one that has none; None is not given.

    Without settings, nothing is loaded.
    """
    asked = _given(settings)
    for setting in asked:
        owners = estimators_with(setting)
        if not owners:
            known = sorted({name for one in ESTIMATORS.all().values() for name in one.settings})
            raise unknown(f"No estimator has a setting {setting!r}.", setting, known, "⟦here⟧")
        if name not in owners:
            raise misfit(_option(setting), _estimators(owners), _estimators([name]))
        needs = ESTIMATORS[name].settings[setting].needs
        if needs is not None and asked.get(needs[0]) != needs[1]:
            other = asked.get(needs[0], ESTIMATORS[name].settings[needs[0]].default)
            raise misfit(_option(setting), _option(*needs), _option(needs[0], other))
    if asked:
        ESTIMATORS[name].configured(**asked)
    if weights and name != AUTO and not ESTIMATORS[name].trains_network:
        networks = [key for key, one in ESTIMATORS.all().items() if one.trains_network]
        raise misfit(_option("weights"), _estimators(networks), _estimators([name]))


def estimator(name: str, settings: Mapping[str, Any]) -> str | Estimator:
    """The argument of ``identify``: a name, or the estimator with the given settings."""
    asked = _given(settings)
    return ESTIMATORS[name].configured(**asked) if asked else name


def _option(name: str, value: Any = None) -> str:
    return f"⟦identify.{name}⟧" if value is None else f"⟦identify.{name} = {value!r}⟧"


def _estimators(names: Iterable[str]) -> str:
    return f"⟦identify.estimator = {' or '.join(map(repr, names))}⟧"


def misfit(option: str, wanted: str, found: str) -> InputError:
    """The error of an option that goes with something else than it was given with."""
    return InputError(
        f"The option {option} does not fit.",
        expected=f"{option} with {wanted}",
        found=f"{option} with {found}",
        where="⟦here⟧",
        remedy=f"add {wanted}, or leave {option} out",
    )
