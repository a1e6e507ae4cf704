"""Errors for users: each message says what was expected, what was found, where, and the remedy."""

from __future__ import annotations

import difflib
import functools
from collections.abc import Iterable
from typing import Any

from vibrident.base.settings import Word, python_word, rendered


class VibridentError(Exception):
    """Base of every error that vibrident raises on purpose."""


class _Text:
    """A text of an error: kept with its markers of settings, read in the words of Python."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, error: Exception | None, owner: type | None = None) -> Any:
        if error is None:
            return self
        return rendered(vars(error)[self._name], python_word)

    def __set__(self, error: Exception, text: str) -> None:
        vars(error)[self._name] = text


class InputError(VibridentError):
    """The input cannot be used as it is.

    Its texts name settings by markers (``vibrident.base.settings``). They are read in the words of
    Python; ``in_words`` gives those of another surface, and ``vars`` the texts with their markers.

    Args:
        problem: one sentence, what is wrong.
        expected: what a valid input has there.
        found: what was there instead.
        where: file, line, column, key or record.
        remedy: what the user can do about it.
    """

    problem = _Text()
    expected = _Text()
    found = _Text()
    where = _Text()
    remedy = _Text()

    def __init__(
        self,
        problem: str,
        *,
        expected: str = "",
        found: str = "",
        where: str = "",
        remedy: str = "",
    ) -> None:
        self.problem = problem
        self.expected = expected
        self.found = found
        self.where = where
        self.remedy = remedy
        super().__init__(str(self))

    def __str__(self) -> str:
        return "\n".join(
            [self.problem, *(f"  {label + ':':<10}{text}" for label, text in self.parts)]
        )

    @property
    def parts(self) -> list[tuple[str, str]]:
        """Return the label and text of what is said beside the problem."""
        labels = ("expected", "found", "where", "remedy")
        return [(label, text) for label in labels if (text := getattr(self, label))]

    def at(self, where: str) -> InputError:
        """Return the same error, of another place."""
        return type(self)(**{**vars(self), "where": where})

    def within(self, place: str) -> InputError:
        """Return the same error, of a place in another one."""
        return self.at(f"{place}, {vars(self)['where']}")

    def in_words(self, word: Word) -> InputError:
        """Return the same error with a surface's words for the settings that it names."""
        return type(self)(**{key: rendered(text, word) for key, text in vars(self).items()})

    def __reduce__(self) -> tuple[object, ...]:  # pickling keeps keyword-only arguments
        return functools.partial(type(self), **vars(self)), ()


def did_you_mean(
    name: str,
    known: Iterable[str],
    otherwise: str = "choose one of the expected",
    *,
    likeness: float = 0.6,
) -> str:
    """Return the remedy for an unknown name: the nearest known one, in either case, if one is similar."""
    by_lower = {other.lower(): other for other in known}
    near = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=likeness)
    return f"did you mean {by_lower[near[0]]!r}?" if near else otherwise


class ModelError(InputError):
    """The model cannot be built or cannot be used with these data."""


def unknown(
    problem: str,
    name: object,
    known: Iterable[str],
    where: str,
    otherwise: str = "choose one of the expected",
    kind: type[InputError] = InputError,
) -> InputError:
    """Return the error of a name that is not one of those known; the remedy names the nearest one, else ``otherwise``."""
    names = tuple(known)
    remedy = did_you_mean(str(name), names, otherwise)
    return kind(problem, expected=" | ".join(names), found=repr(name), where=where, remedy=remedy)


class NotConverged(VibridentError):
    """The estimator stopped before it reached an optimum; the message says where and why."""
