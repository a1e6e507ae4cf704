"""Make an estimator of the name and the settings that a user gives."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from vibrident.base.errors import InputError, unknown
from vibrident.base.fields import Fields, GivenFields
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
    """Return the names of the estimators that have a setting.

    ``names``: those to search, None for all.
    """
    candidates = ESTIMATORS if names is None else names
    return tuple(name for name in candidates if setting in ESTIMATORS[name].settings)


def _without_none(settings: GivenFields) -> Fields:
    return {name: value for name, value in settings.items() if value is not None}


def check_settings(name: str, settings: GivenFields, *, weights: bool = False) -> None:
    """Refuse settings that do not fit the estimator; None is not given.

    ``weights``: whether a network's weights are requested. Without settings, nothing is loaded.
    """
    given_settings = _without_none(settings)
    for setting in given_settings:
        owners = estimators_with(setting)
        if not owners:
            names = sorted(
                {name for registered in ESTIMATORS.all().values() for name in registered.settings}
            )
            raise unknown(f"No estimator has a setting {setting!r}.", setting, names, "⟦here⟧")
        if name not in owners:
            raise misfit_error(_option(setting), _estimators(owners), _estimators([name]))
        needs = ESTIMATORS[name].settings[setting].needs
        if needs is not None and given_settings.get(needs[0]) != needs[1]:
            present = given_settings.get(needs[0], ESTIMATORS[name].settings[needs[0]].default)
            raise misfit_error(_option(setting), _option(*needs), _option(needs[0], present))
    if given_settings:
        ESTIMATORS[name].configured(**given_settings)
    if weights and name != AUTO and not ESTIMATORS[name].trains_network:
        networks = [
            key for key, registered in ESTIMATORS.all().items() if registered.trains_network
        ]
        raise misfit_error(_option("weights"), _estimators(networks), _estimators([name]))


def estimator(name: str, settings: GivenFields) -> str | Estimator:
    """Return the argument of ``identify``: a name, or the estimator with the given settings."""
    given_settings = _without_none(settings)
    return ESTIMATORS[name].configured(**given_settings) if given_settings else name


def _option(name: str, value: Any = None) -> str:
    return f"⟦identify.{name}⟧" if value is None else f"⟦identify.{name} = {value!r}⟧"


def _estimators(names: Iterable[str]) -> str:
    return f"⟦identify.estimator = {' or '.join(map(repr, names))}⟧"


def misfit_error(option: str, needed: str, actual: str) -> InputError:
    """Return the error of an option that does not go with the other options given."""
    return InputError(
        f"The option {option} does not fit.",
        expected=f"{option} with {needed}",
        found=f"{option} with {actual}",
        where="⟦here⟧",
        remedy=f"add {needed}, or leave {option} out",
    )
