"""Define options: names to choose from, lists, ranges; their messages name the option."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import typer

from vibrident.app.workflow.estimators import DISCRETISATIONS as DISCRETISATIONS
from vibrident.app.workflow.estimators import UNCERTAINTIES as UNCERTAINTIES
from vibrident.app.workflow.estimators import estimator_names
from vibrident.base.errors import InputError, unknown
from vibrident.base.fields import Fields, NamedTexts
from vibrident.export.registry import EXPORTS
from vibrident.fit.registry import ESTIMATORS
from vibrident.physics.registry import ADD_ONS, MODELS

EXCITATIONS = ("sine", "multisine", "sweep", "random", "shock")
QUANTITIES = ("acceleration", "velocity", "displacement", "drive", "force")
SENSORS = ("paper", "inverted", "cubic", "two-mode", "piezo", "geophone", "seismometer")

FORMATS = ("html", "pdf", "md")
#: Sampling rates, Hz: from a sample in a month to the largest of a light's detector.
RATES_HZ = (1e-7, 1e12)
MIN_FREQUENCY_HZ = 1e-9
#: Quantities above 0 in their units; relative ones; noise relative to what it is noise of.
SIZES = (1e-15, 1e15)
RELATIVE = (1e-12, 1e3)
RELATIVE_NOISE = (0.0, 1e6)

# names to choose from, or a function that returns them
Names = Sequence[str] | Callable[[], Sequence[str]]


# ``value``: that of a command's parameter without the option (...: there is none, it must be
# given). ``default``: what holds without it, in words, or whether to print the value.


def argument(metavar: str, help: str, value: Any = ..., default: str = "") -> Any:
    """Define an argument of a command."""
    return typer.Argument(
        value, metavar=metavar, help=without_markup(help), show_default=default or False
    )


def option(
    name: str,
    metavar: str,
    help: str,
    value: Any = None,
    default: str | bool = True,
    panel: str | None = None,
    **more: Any,
) -> Any:
    """Define an option with a value."""
    return typer.Option(
        value,
        name,
        metavar=metavar,
        help=without_markup(help),
        show_default=default,
        rich_help_panel=panel,
        **more,
    )


def flag(*names: str, help: str, value: bool = False, panel: str | None = None) -> Any:
    """Define an option without a value."""
    return typer.Option(value, *names, help=without_markup(help), rich_help_panel=panel)


def refuse_unused(is_given: Mapping[str, bool], belongs_to: str) -> None:
    """Refuse options that have no effect.

    Args:
        is_given: whether each option is, by name.
        belongs_to: what they need, in words.

    Raises:
        InputError: names those that are given.
    """
    unused = [name for name, is_set in is_given.items() if is_set]
    if unused:
        raise InputError(
            f"{', '.join(unused)} would have no effect.",
            expected=f"{belongs_to} beside it",
            found="none",
            where="command line",
            remedy=f"leave {' and '.join(unused)} out",
        )


def without_markup(text: str) -> str:
    """Return a text whose words in brackets, such as [[records]], are printed as they stand."""
    return re.sub(r"(\[[a-z#/@][^\[]*?\])", r"\\\1", text)


def rate(name: str, help: str, default: str | bool = True, panel: str | None = None) -> Any:
    """Define the option of a sampling rate, Hz."""
    return between(name, "HZ", help, *RATES_HZ, default=default, panel=panel)


def factor(name: str, metavar: str, help: str, default: str) -> Any:
    """Define an option that takes a finite number other than zero."""

    def check(number: float | None) -> float | None:
        if number is None or (math.isfinite(number) and number != 0.0):
            return number
        raise InputError(
            f"{marked(name)} is no factor.",
            expected="a finite number other than 0",
            found=f"{number:g}",
            where=marked(name),
            remedy=f"give another number, or leave {marked(name)} out",
        )

    return option(name, metavar, help, default=default, callback=check)


def between(
    name: str,
    metavar: str,
    help: str,
    low: float,
    high: float,
    value: Any = None,
    default: str | bool = True,
    panel: str | None = None,
) -> Any:
    """Define an option that takes a number between two limits, or one of them."""

    def check(value: float | None) -> float | None:
        if value is None or low <= value <= high:
            return value
        raise InputError(
            f"{marked(name)} is out of range.",
            expected=f"a number from {low:g} to {high:g}",
            found=f"{value:g}",
            where=marked(name),
            remedy=f"give another number, or leave {marked(name)} out",
        )

    return option(name, metavar, help, value, default, panel, callback=check)


def choice(
    name: str,
    allowed: Names,
    help: str,
    value: Any = None,
    metavar: str = "",
    default: str | bool = True,
    panel: str | None = None,
) -> Any:
    """Define an option that takes one of a few names, listed in the help.

    Names that plug-ins may add to are loaded on demand: ``metavar`` is then a key of
    ``REGISTERED``.
    """
    return option(
        name,
        metavar or "|".join(_resolve_names(allowed)),
        help,
        value,
        default,
        panel,
        callback=lambda value: None if value is None else require_choice(name, value, allowed),
        autocompletion=lambda: list(_resolve_names(allowed)),
    )


CALIBRATION_FILE = argument("CAL.toml", "Calibration file.")
RESULT_FILE = argument("RESULT", "result.json of an identification.")
CERTIFICATE_FILES = option(
    "--certificate",
    "FILE.toml",
    "What a certificate states, given after the fit; of several files the last one counts.",
    default="as in the calibration file",
)
PICTURES = flag(
    "--pictures/--no-pictures", help="Draw a picture (PNG) into the folder.", value=True
)
RESULT_FILES = argument("RESULT...", "result.json, one or more.")


def _resolve_names(names: Names) -> Sequence[str]:
    return names() if callable(names) else names


#: Settings of estimators that have an option of their own.
SETTINGS = ("discretisation", "optimiser", "steps", "learning_rate", "weighting", "residual")


def not_rational() -> tuple[str, ...]:
    """Return the add-ons that an export may leave out."""
    from vibrident.export.sensor import not_rational as names

    return names()


def formats_with(option: str) -> str:
    """Return the export formats that an option concerns."""
    return ", ".join(name for name, form in EXPORTS.all().items() if option in form.options)


def _cores() -> list[str]:
    """Return the names of the models that stand alone."""
    add_ons = MODELS.built_in_names(ADD_ONS)
    return [name for name in MODELS.names() if name not in add_ons]


#: Placeholder in a help text → function that gives the registered names.
REGISTERED: Mapping[str, Callable[[], str]] = {
    "{exports}": lambda: "|".join(EXPORTS.names()),
    "{add-ons apart}": lambda: ", ".join(not_rational()),
    "{cores}": lambda: ", ".join(_cores()),
    "{add-ons}": lambda: ", ".join(MODELS.built_in_names(ADD_ONS)),
    "{estimators}": lambda: "|".join(estimator_names()),
    "{estimators by name}": lambda: ", ".join(ESTIMATORS.names()),
    **{
        f"{{exports: {option}}}": partial(formats_with, option)
        for option in ("rate_hz", "channel", "country", "schema", "online")
    },
}


def fill_in_names(text: str | None) -> str | None:
    """Return a help text with the registered names filled in."""
    for key, names in REGISTERED.items():
        if text and key in text:
            text = text.replace(key, names())
    return text


def require_choice(name: str, value: str, allowed: Names) -> str:
    """Return the value if it is one of those allowed; else InputError."""
    names = _resolve_names(allowed)
    if value in names:
        return value
    raise unknown(f"{value!r} is not a choice of {marked(name)}.", value, names, marked(name))


def listed(name: str, allowed: Names | None = None) -> Callable[[str | None], list[str] | None]:
    """Return a function that splits names joined by commas; ``allowed``: the names it accepts."""

    def split(text: str | None) -> list[str] | None:
        if text is None:
            return None
        words = [word.strip() for word in text.split(",") if word.strip()]
        if not words:
            remedy = f"name at least one, or leave {marked(name)} out"
            raise unreadable_error(name, text, "names joined by commas", remedy)
        checked = [
            word if allowed is None else require_choice(name, word, allowed) for word in words
        ]
        return list(dict.fromkeys(checked))

    return split


def unreadable_error(name: str, text: str, expected: str, remedy: str) -> InputError:
    """Return the error of an option whose value cannot be read."""
    option_name = marked(name)
    return InputError(
        f"{option_name} cannot be read.",
        expected=expected,
        found=repr(text),
        where=option_name,
        remedy=remedy,
    )


def marked(name: str) -> str:
    """Return an option's name as a marker, for which the page prints the label of its field."""
    flag, blank, more = name.partition(" ")
    return f"⟦{flag}⟧{blank}{more}" if flag.startswith("--") else name


def pairs(name: str, texts: Sequence[str], example: str) -> NamedTexts:
    """Return the names and values of ``NAME=VALUE``."""
    values = {}
    for text in texts:
        key, separator, value = (piece.strip() for piece in text.partition("="))
        if not (key and separator and value):
            raise unreadable_error(
                name, text, f"NAME=VALUE, such as {example}", "write a name, = and a value"
            )
        values[key] = value
    return values


def settings(texts: Sequence[str]) -> Fields:
    """Return the settings of ``--set NAME=VALUE``: numbers, true, false, or text."""
    values: Fields = {}
    for name, text in pairs("--set", texts, "limit=2").items():
        if name in SETTINGS:
            raise InputError(
                f"The setting {name!r} has an option of its own.",
                expected=f"--{name.replace('_', '-')}",
                found=f"--set {name}={text}",
                where="--set",
                remedy="use that option",
            )
        try:
            values[name] = json.loads(text)
        except ValueError:
            values[name] = text
    return values


def band(text: str | None) -> tuple[float, float] | None:
    """Return both ends of ``10:1000``, a lower and a higher frequency in Hz."""
    if text is None:
        return None
    try:
        low, high = (float(limit) for limit in text.split(":"))
    except ValueError:
        expected = "two frequencies in Hz, a lower and a higher one, such as 10:1000"
        raise unreadable_error(
            "--band", text, expected, "write LOW:HIGH, numbers with a point, without units"
        ) from None
    return low, high


def frequencies(text: str | None) -> list[float] | None:
    """Return frequencies in Hz from a list such as ``10,20,50`` or a range such as ``10:1000``.

    A range stands for the exact one-third-octave frequencies in it.
    """
    if text is None:
        return None
    separator = ":" if ":" in text else ","
    try:
        numbers = [float(number_text) for number_text in text.split(separator)]
    except ValueError:
        numbers = []
    is_range = separator == ":"
    if not numbers or (is_range and len(numbers) != 2) or not _are_frequencies(numbers):
        raise unreadable_error(
            "--frequencies",
            text,
            "a range of one-third octaves such as 10:1000, or a list such as 10,20,50; in Hz, "
            "above 0",
            "write numbers with a point, without units",
        )
    return _one_third_octaves(*numbers) if is_range else numbers


def _are_frequencies(numbers: Sequence[float]) -> bool:
    """Tell whether each number is a frequency in Hz that can be planned or simulated."""
    return all(MIN_FREQUENCY_HZ <= number <= RATES_HZ[1] for number in numbers)


def _one_third_octaves(low_hz: float, high_hz: float) -> list[float]:
    from vibrident.physics.simulation import one_third_octave

    try:
        return one_third_octave(low_hz, high_hz).tolist()
    except InputError as error:
        raise error.at(marked("--frequencies")) from None
