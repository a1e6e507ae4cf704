"""Errors for users: each message says what was expected, what was found, where, and the remedy."""

from __future__ import annotations

import difflib
import functools
from collections.abc import Iterable
from typing import Self, overload

from vibrident.base.settings import Word, python_word, rendered


class VibridentError(Exception):
    """Base class of every error that vibrident raises on purpose.

    Examples:
        >>> import vibrident
        >>> try:
        ...     vibrident.read("calibration.txt")
        ... except vibrident.VibridentError as error:
        ...     print(type(error).__name__)
        InputError
    """


class _Text:
    """Text of an error: stored with its markers of settings, read in the words of Python."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, error: None, owner: type | None = None) -> Self: ...

    @overload
    def __get__(self, error: Exception, owner: type | None = None) -> str: ...

    def __get__(self, error: Exception | None, owner: type | None = None) -> Self | str:
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

    Examples:
        >>> import vibrident
        >>> try:
        ...     vibrident.read("no-such-folder/calibration.toml")
        ... except vibrident.InputError as error:
        ...     print(error.where)
        no-such-folder/calibration.toml
    """

    problem: _Text = _Text()
    expected: _Text = _Text()
    found: _Text = _Text()
    where: _Text = _Text()
    remedy: _Text = _Text()

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
        """Return label and text of each part of the message after the problem."""
        labels = ("expected", "found", "where", "remedy")
        return [(label, text) for label in labels if (text := getattr(self, label))]

    def at(self, where: str) -> InputError:
        """Return the error with another place."""
        return type(self)(**{**vars(self), "where": where})

    def within(self, place: str) -> InputError:
        """Return the error with its place inside another one."""
        return self.at(f"{place}, {vars(self)['where']}")

    def in_words(self, word: Word) -> InputError:
        """Return the error with a surface's words for the settings that it names."""
        return type(self)(**{key: rendered(text, word) for key, text in vars(self).items()})

    def __reduce__(self) -> tuple[object, ...]:  # pickling keeps keyword-only arguments
        return functools.partial(type(self), **vars(self)), ()


def did_you_mean(
    name: str,
    names: Iterable[str],
    otherwise: str = "choose one of the expected",
    *,
    likeness: float = 0.6,
) -> str:
    """Return the remedy for an unknown name: the most similar known one, else ``otherwise``."""
    by_lower = {known_name.lower(): known_name for known_name in names}
    near = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=likeness)
    return f"did you mean {by_lower[near[0]]!r}?" if near else otherwise


class ModelError(InputError):
    """The model cannot be built or cannot be used with these data.

    Examples:
        >>> import vibrident
        >>> try:
        ...     vibrident.parse_model("acelerometer")
        ... except vibrident.ModelError as error:
        ...     print(error.remedy)
        did you mean 'accelerometer'?
    """


def unknown(
    problem: str,
    name: object,
    valid_names: Iterable[str],
    where: str,
    otherwise: str = "choose one of the expected",
    kind: type[InputError] = InputError,
) -> InputError:
    """Return the error of an unknown name.

    The remedy names the most similar known one, else ``otherwise``.
    """
    names = tuple(valid_names)
    remedy = did_you_mean(str(name), names, otherwise)
    return kind(problem, expected=" | ".join(names), found=repr(name), where=where, remedy=remedy)


class NotConverged(VibridentError):
    """The estimator stopped before it reached an optimum; the message says where and why.

    Examples:
        >>> import vibrident
        >>> issubclass(vibrident.NotConverged, vibrident.VibridentError)
        True
    """
