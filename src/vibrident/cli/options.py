"""Values of options: names to choose from, lists, ranges. Checked here, with a message that names the option."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from vibrident.errors import InputError, did_you_mean
from vibrident.registry import ESTIMATORS, EXPORTS, MODELS
from vibrident.workflow.choices import DISCRETISATIONS as DISCRETISATIONS
from vibrident.workflow.choices import UNCERTAINTIES as UNCERTAINTIES
from vibrident.workflow.estimators import estimator_names

OPTIMISERS = ("lm", "adam")
WEIGHTINGS = ("plain", "weighted")
EXCITATIONS = ("sine", "multisine", "sweep", "random", "shock")
QUANTITIES = ("acceleration", "velocity", "displacement", "drive")
SENSORS = ("paper", "inverted", "cubic", "two-mode", "piezo", "geophone", "seismometer")
STARTS = ("rest", "steady")
METHODS = ("exact", "rk4")
FORMATS = ("html", "pdf", "md")

CalibrationFile = Annotated[Path, typer.Argument(metavar="CAL.toml", help="Calibration file.", show_default=False)]


#: Names to choose from, or a function that returns them.
Names = Sequence[str] | Callable[[], Sequence[str]]


def choice(name: str, allowed: Names, help: str, metavar: str | None = None, **more: Any) -> Any:
    """An option that takes one of a few names, which the help lists unless there is a ``metavar`` for them.

    Names that plug-ins may add to are loaded on demand: ``metavar`` is then a key of ``REGISTERED``.
    """
    return typer.Option(
        name,
        metavar=metavar or "|".join(_given(allowed)),
        help=help,
        callback=lambda value: None if value is None else one_of(name, value, _given(allowed)),
        autocompletion=lambda: list(_given(allowed)),
        **more,
    )


def _given(names: Names) -> Sequence[str]:
    return names() if callable(names) else names


#: Settings of estimators that have an option of their own.
SETTINGS = ("discretisation", "optimiser", "steps", "learning_rate", "weighting", "residual")


def not_rational() -> tuple[str, ...]:
    """Add-ons that an export may leave out."""
    from vibrident.export.sensor import not_rational as names

    return names()


def _with(option: str) -> str:
    """Export formats that an option concerns."""
    return ", ".join(name for name, form in EXPORTS.all().items() if option in form.options)


#: Placeholder in a help text → function that gives the registered names.
REGISTERED: Mapping[str, Callable[[], str]] = {
    "{exports}": lambda: "|".join(EXPORTS.names()),
    "{add-ons apart}": lambda: ", ".join(not_rational()),
    "{models}": lambda: ", ".join(MODELS.names()),
    "{estimators}": lambda: "|".join(estimator_names()),
    "{estimators by name}": lambda: ", ".join(ESTIMATORS.names()),
    **{f"{{exports: {option}}}": partial(_with, option) for option in ("rate_hz", "channel", "country", "schema")},
}


def filled(text: str | None) -> str | None:
    """A help text with the registered names filled in."""
    for key, names in REGISTERED.items():
        if text and key in text:
            text = text.replace(key, names())
    return text


def one_of(name: str, value: str, allowed: Sequence[str]) -> str:
    """The value, if it is one of those allowed.

    Raises:
        InputError: the value is not allowed.
    """
    if value in allowed:
        return value
    raise InputError(
        f"{value!r} is not a choice of {name}.",
        expected=" | ".join(allowed),
        found=repr(value),
        where=name,
        remedy=did_you_mean(value, allowed),
    )


def listed(name: str, allowed: Names | None = None) -> Callable[[str | None], list[str] | None]:
    """Split names joined by commas; each must be allowed, if ``allowed`` is given."""

    def split(text: str | None) -> list[str] | None:
        if text is None:
            return None
        parts = [part.strip() for part in text.split(",") if part.strip()]
        if not parts:
            raise InputError(
                f"The list of {name} is empty.",
                expected="names joined by commas",
                found=repr(text),
                where=name,
                remedy=f"name at least one, or leave {name} out",
            )
        checked = [part if allowed is None else one_of(name, part, _given(allowed)) for part in parts]
        return list(dict.fromkeys(checked))

    return split


def band(text: str | None) -> tuple[float, float] | None:
    """``10:1000``, a lower and a higher frequency in Hz.

    Raises:
        InputError: the text is not such a range.
    """
    if text is None:
        return None
    try:
        low, high = (float(part) for part in text.split(":"))
    except ValueError:
        raise InputError(
            "The band cannot be read.",
            expected="two frequencies in Hz, a lower and a higher one, such as 10:1000",
            found=repr(text),
            where="--band",
            remedy="write LOW:HIGH, numbers with a point, without units",
        ) from None
    return low, high


def frequencies(text: str | None) -> list[float] | None:
    """``10:1000``, the exact one-third-octave frequencies in that range, or a list such as ``10,20,50``; in Hz.

    Raises:
        InputError: the text is neither.
    """
    if text is None:
        return None
    separator = ":" if ":" in text else ","
    try:
        numbers = [float(part) for part in text.split(separator)]
    except ValueError:
        numbers = []
    if not numbers or (separator == ":" and len(numbers) != 2):
        raise InputError(
            "The frequencies cannot be read.",
            expected="a range of one-third octaves such as 10:1000, or a list such as 10,20,50; in Hz",
            found=repr(text),
            where="--frequencies",
            remedy="write numbers with a point, without units",
        )
    if separator == ",":
        return numbers
    from vibrident.simulation import one_third_octave

    return one_third_octave(*numbers).tolist()
